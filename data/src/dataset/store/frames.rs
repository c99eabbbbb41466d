//! The frames of a dataset: `frames.npy`.

use std::path::Path;

use memmap2::Mmap;

use super::files::{check_sha256, name};
use super::meta::{Meta, MetaFile};
use crate::error::{Error, Result};
use crate::file::bounded_file;
use crate::frame::Frame;

/// Length of the header of `frames.npy`, bytes: fixed, so that the count can be filled in last, and a
/// multiple of 64 as the npy format asks.
pub(super) const HEADER_LEN: usize = 128;

/// Bytes of one frame.
pub(super) fn frame_len(meta: &Meta) -> usize {
    3 * meta.frame_px[0] * meta.frame_px[1]
}

/// The npy header, version 1.0: magic, version, u16 length of the rest, the shape as Python writes it,
/// spaces, a newline.
pub(super) fn npy_header(n_frames: usize, meta: &Meta) -> Vec<u8> {
    let [width, height] = meta.frame_px;
    let shape = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({n_frames}, {height}, {width}, 3), }}");
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((HEADER_LEN as u16 - 10).to_le_bytes());
    header.extend(shape.as_bytes());
    header.resize(HEADER_LEN - 1, b' ');
    header.push(b'\n');
    header
}

pub(super) fn map_frames(path: &Path, content: &MetaFile) -> Result<Mmap> {
    let (file, got) = bounded_file::open(path)?;
    let mut header = vec![0; HEADER_LEN.min(usize::try_from(got).unwrap_or(HEADER_LEN))];
    std::io::Read::read_exact(&mut &file, &mut header).map_err(Error::io(path))?;
    let expected_header = npy_header(content.n_frames, &content.meta);
    if header != expected_header {
        let shape = |bytes: &[u8]| String::from_utf8_lossy(bytes.get(10..).unwrap_or_default()).trim().to_owned();
        return Err(Error::invalid(name(path), shape(&expected_header), shape(&header)));
    }
    let expected = content
        .n_frames
        .checked_mul(frame_len(&content.meta))
        .and_then(|body| body.checked_add(HEADER_LEN))
        .map(|len| len as u64);
    if Some(got) != expected {
        let expected = expected.map_or("a size that fits in memory".to_owned(), |len| format!("{len} bytes"));
        return Err(Error::invalid(name(path), expected, format!("{got} bytes")));
    }
    check_sha256(path, &content.frames_sha256)?;
    // SAFETY: the map is read-only, and u8 has no invalid value. What the type system cannot promise is
    // that no other program shortens or rewrites the file meanwhile; datasets take their name only when
    // they are complete and are not written again.
    #[expect(unsafe_code, reason = "a file can only be mapped so")]
    let mapped = unsafe { Mmap::map(&file) };
    mapped.map_err(Error::io(path))
}

pub(super) fn check_size(frame: &Frame, meta: &Meta, what: &str) -> Result<()> {
    let got = [frame.width_px(), frame.height_px()];
    if got == meta.frame_px {
        return Ok(());
    }
    let show = |[width, height]: [usize; 2]| format!("{width}x{height} pixels");
    Err(Error::invalid(what, show(meta.frame_px), show(got)))
}

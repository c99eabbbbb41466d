//! Reads a dataset.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use memmap2::Mmap;
use sha2::{Digest, Sha256};

use super::files::{FRAMES, INDEX, META, NO_CONTACT, check_sha256, json_error, name};
use super::frames::{HEADER_LEN, check_size, frame_len, map_frames};
use super::meta::{Meta, MetaFile, read_meta};
use crate::dataset::shard::Fragment;
use crate::dataset::touch::{Side, Touch};
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::frame::picture;
use crate::frame::{Background, Frame, Preprocessing};

/// The most bytes of a touch in the index, on average: ten times as many as a touch with every field has.
const MOST_LINE_BYTES: u64 = 4_096;

/// A dataset opened for reading; its frames stay on disk until they are looked at.
#[derive(Debug)]
pub struct Dataset {
    meta: Meta,
    fragment: Option<Fragment>,
    frames_sha256: String,
    index_sha256: String,
    frames: Mmap,
    touches: Vec<Touch>,
    no_contact: Frame,
}

impl Dataset {
    /// Opens a dataset, checking its schema, sizes and checksums: it is read through once.
    pub fn open(path: &Path) -> Result<Self> {
        let content = read_meta(path)?;
        let frames = map_frames(&path.join(FRAMES), &content)?;
        let touches_bytes = (content.n_frames as u64).saturating_add(1).saturating_mul(MOST_LINE_BYTES);
        let index = bounded_file::open_kind(&path.join(INDEX), Kind { name: "an index", most_bytes: touches_bytes })?;
        check_sha256(&path.join(INDEX), &content.index_sha256)?;
        let mut touches = read_index(&path.join(INDEX), index)?;
        if let Some(peg_from_hole) = content.meta.peg_from_hole {
            let hole_from_peg = peg_from_hole.inverse();
            let pegs = touches.iter_mut().filter(|touch| touch.side == Some(Side::Peg));
            pegs.filter_map(|touch| touch.part_from_sensor.as_mut()).for_each(|pose| *pose = hole_from_peg * *pose);
        }
        if touches.len() != content.n_frames {
            let got = format!("{} lines", touches.len());
            return Err(Error::invalid(name(&path.join(INDEX)), format!("{} lines", content.n_frames), got));
        }
        let no_contact = read_no_contact(path, &content.meta)?;
        let MetaFile { meta, fragment, frames_sha256, index_sha256, .. } = content;
        Ok(Self { meta, fragment, frames_sha256, index_sha256, frames, touches, no_contact })
    }

    /// Whether a folder says that it is a dataset.
    pub fn is_at(path: &Path) -> bool {
        path.join(META).is_file()
    }

    /// What holds for the whole dataset.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// Which shard it is of which dataset; `None` for a whole one.
    pub fn fragment(&self) -> Option<&Fragment> {
        self.fragment.as_ref()
    }

    /// SHA-256 of the frames, 64 hex digits: the identity of the dataset.
    pub fn frames_sha256(&self) -> &str {
        &self.frames_sha256
    }

    /// SHA-256 of all that it holds, 64 hex digits: frames, index, meta data and the sensor at rest. What is made of two
    /// datasets with the same one is the same.
    ///
    /// # Errors
    /// Meta data that JSON cannot hold: none that was read from a file.
    pub fn sha256(&self) -> Result<String> {
        let meta = serde_json::to_vec(&self.meta).map_err(json_error(Path::new(META), "meta data"))?;
        let mut hash = Sha256::new_with_prefix(&self.frames_sha256);
        hash.update(&self.index_sha256);
        hash.update(meta);
        hash.update(self.no_contact.rgb());
        Ok(format!("{:x}", hash.finalize()))
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.touches.len()
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.touches.is_empty()
    }

    /// The RGB bytes of frame `i`, rows from the top, straight from the mapped file. `i` is below [`len`](Self::len).
    pub fn frame_bytes(&self, i: usize) -> &[u8] {
        let frame_len = frame_len(&self.meta);
        &self.frames[HEADER_LEN + i * frame_len..HEADER_LEN + (i + 1) * frame_len]
    }

    /// A copy of frame `i`. `i` is below [`len`](Self::len).
    pub fn frame(&self, i: usize) -> Frame {
        let [width, height] = self.meta.frame_px;
        Frame::from_parts(width, height, self.frame_bytes(i).to_vec())
    }

    /// What is known of frame `i`. `i` is below [`len`](Self::len).
    pub fn touch(&self, i: usize) -> &Touch {
        &self.touches[i]
    }

    /// What is known of every frame, in order.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// The sensor at rest.
    pub fn no_contact(&self) -> &Frame {
        &self.no_contact
    }

    /// The sensor at rest, prepared: its lamps, where they are known, are made up for.
    ///
    /// # Errors
    /// A frame that shows nothing, or lamps that do not show slopes in all directions.
    pub fn background(&self, preprocessing: &Preprocessing) -> Result<Background> {
        Background::new(&self.no_contact, preprocessing)?.lit_by(&self.meta.lamps)
    }
}

/// The sensor at rest of a dataset.
pub(crate) fn read_no_contact(dataset: &Path, meta: &Meta) -> Result<Frame> {
    let path = dataset.join(NO_CONTACT);
    let frame = picture::read(&path)?;
    check_size(&frame, meta, &name(&path)).map(|()| frame)
}

fn read_index(path: &Path, file: File) -> Result<Vec<Touch>> {
    let lines = BufReader::new(file).lines();
    lines
        .enumerate()
        .map(|(row, line)| {
            let line = line.map_err(Error::io(path))?;
            let place = || format!("{} line {}", path.display(), row + 1);
            let touch: Touch =
                serde_json::from_str(&line).map_err(|e| Error::invalid(place(), "a touch", e.to_string()))?;
            touch.check_names().map_err(|error| error.within(place()))?;
            Ok(touch)
        })
        .collect()
}

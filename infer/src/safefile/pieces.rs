//! The same files, written and read piece by piece: no copy of a large tensor is made on the way.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use safetensors::tensor::{Metadata, TensorInfo};
use sha2::{Digest, Sha256};
use tactile_data::file::bounded_file;

use super::{CHECKSUM, SCHEMA, hex};
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};

/// The longest header that is read, bytes: as many as the library of the format allows.
const MOST_HEADER_BYTES: u64 = 100_000_000;

/// The longest file, bytes: 10,000 parts at 1,053 poses each, rows of 128 values in f32, take 5.4 GB.
const MOST_BYTES: u64 = 8 << 30;

/// What a header says of a tensor: its name, format and shape.
pub(crate) type Entry<'n> = (&'n str, Precision, Vec<usize>);

/// The bytes of a file before the values of its tensors, as [`SafeFile::save_as`](super::SafeFile::save_as) writes
/// them; the values follow in this order.
///
/// # Errors
/// None that a file could have; building the text of it may fail in principle.
pub(crate) fn header(
    entries: &[Entry<'_>],
    text: Vec<(String, String)>,
    schema: &str,
    sha256: String,
) -> Result<Vec<u8>> {
    let mut metadata: BTreeMap<String, String> = text.into_iter().collect();
    metadata.insert(SCHEMA.into(), schema.into());
    metadata.insert(CHECKSUM.into(), sha256);
    let malformed = |e: serde_json::Error| Error::invalid("header", "values JSON can hold", e.to_string());
    let mut all = BTreeMap::from([("__metadata__", serde_json::to_value(metadata).map_err(malformed)?)]);
    let mut start = 0;
    for (name, precision, shape) in entries {
        let dtype = precision.dtype();
        let end = start + shape.iter().product::<usize>() * dtype.bitsize() / 8;
        let info = TensorInfo { dtype, shape: shape.clone(), data_offsets: (start, end) };
        all.insert(name, serde_json::to_value(info).map_err(malformed)?);
        start = end;
    }
    let mut json = serde_json::to_vec(&all).map_err(malformed)?;
    json.resize(json.len().next_multiple_of(8), b' ');
    Ok([&(json.len() as u64).to_le_bytes()[..], &json].concat())
}

/// SHA-256 of bytes that come in pieces, 64 hex digits.
pub(crate) fn sha256_of(pieces: &[&[u8]]) -> String {
    let mut hash = Sha256::new();
    pieces.iter().for_each(|piece| hash.update(piece));
    hex(&hash.finalize())
}

/// A file whose header was read and fits its length; its tensors can be read, none of it is checked.
#[derive(Debug)]
pub(crate) struct Opened {
    path: PathBuf,
    file: BufReader<File>,
    header: Metadata,
    /// Where the values begin.
    values_at: u64,
    /// The text entries but for schema and checksum.
    pub(crate) text: Vec<(String, String)>,
    /// The checksum that the file states.
    pub(crate) sha256: String,
}

impl Opened {
    /// Opens a file of a schema.
    ///
    /// # Errors
    /// A file that cannot be read, is no whole one of the format, or is of another schema.
    pub(crate) fn new(path: &Path, schema: &str) -> Result<Self> {
        let broken =
            |got: &str| Error::invalid(path.display().to_string(), "a whole safetensors file", got.to_string());
        let (file, n_bytes) = bounded_file::open(path)?;
        if n_bytes > MOST_BYTES {
            return Err(broken(&format!("{n_bytes} bytes, more than {MOST_BYTES}")));
        }
        let mut file = BufReader::new(file);
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => broken("less than 8 bytes"),
            _ => Error::io(path)(error),
        })?;
        let length = u64::from_le_bytes(length);
        if length > MOST_HEADER_BYTES || length + 8 > n_bytes {
            return Err(broken(&format!("a header of {length} bytes in a file of {n_bytes}")));
        }
        let mut json = vec![0; length as usize];
        file.read_exact(&mut json).map_err(Error::io(path))?;
        let header: Metadata = serde_json::from_slice(&json).map_err(|e| broken(&e.to_string()))?;
        let expected = 8 + length + header.data_len() as u64;
        if expected != n_bytes {
            return Err(broken(&format!("{n_bytes} bytes instead of {expected}")));
        }
        let mut text: BTreeMap<String, String> = header.metadata().clone().unwrap_or_default().into_iter().collect();
        let found = text.remove(SCHEMA).unwrap_or_else(|| "no schema".into());
        if found != schema {
            return Err(Error::invalid(path.display().to_string(), schema, found));
        }
        let sha256 = text.remove(CHECKSUM).unwrap_or_default();
        let text = text.into_iter().collect();
        Ok(Self { path: path.into(), file, header, values_at: 8 + length, text, sha256 })
    }

    /// Names of the tensors, in alphabetical order.
    pub(crate) fn names(&self) -> Vec<String> {
        let mut names = self.header.offset_keys();
        names.sort_unstable();
        names
    }

    /// Format and shape of a tensor.
    ///
    /// # Errors
    /// A file without it, or in a format that these files do not hold.
    pub(crate) fn entry(&self, name: &str) -> Result<(Precision, Vec<usize>)> {
        let Some(info) = self.header.info(name) else { return Err(Error::invalid(name, "a tensor", "none")) };
        match Precision::from_dtype(info.dtype) {
            Some(precision) => Ok((precision, info.shape.clone())),
            None => Err(Error::invalid(name, "f32, f16, bf16 or i8", format!("{:?}", info.dtype))),
        }
    }

    /// Reads the values of a tensor, as many as [`Self::entry`] says.
    ///
    /// # Errors
    /// What reading brings.
    pub(crate) fn read<T>(
        &mut self,
        name: &str,
        values: impl FnOnce(&mut BufReader<File>) -> std::io::Result<T>,
    ) -> Result<T> {
        let start = self.header.info(name).map_or(0, |info| info.data_offsets.0) as u64;
        let all = self.file.seek(SeekFrom::Start(self.values_at + start)).and_then(|_| values(&mut self.file));
        all.map_err(Error::io(&self.path))
    }
}

/// Reads `n` values of `SIZE` bytes each.
pub(crate) fn read_values<const SIZE: usize, T>(
    reader: &mut impl Read,
    n: usize,
    of: impl Fn([u8; SIZE]) -> T,
) -> std::io::Result<Vec<T>> {
    /// Values read at a time.
    const PIECE: usize = 1 << 16;
    let (mut values, mut bytes) = (Vec::new(), vec![0; SIZE * n.min(PIECE)]);
    values.try_reserve_exact(n)?;
    while values.len() < n {
        let piece = &mut bytes[..SIZE * (n - values.len()).min(PIECE)];
        reader.read_exact(piece)?;
        values.extend(piece.as_chunks::<SIZE>().0.iter().map(|bytes| of(*bytes)));
    }
    Ok(values)
}

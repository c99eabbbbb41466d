//! A file of records, some of them in chunks: what MCAP and ROS 1 bags have in common.
//!
//! Nothing is read ahead and no length is believed: memory follows the largest single record. A file that was cut off
//! gives everything before the cut.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::file::bounded_file;

/// The largest record, and the largest message once it is unpacked, bytes: a picture of 9000 x 9000 pixels.
pub const MAX_RECORD_BYTES: u64 = 1 << 28;

/// Read ahead of a file, bytes.
const BUFFER_BYTES: usize = 1 << 16;

/// What comes next.
pub enum Step<Record> {
    /// This.
    Record(Record),
    /// Nothing more.
    End,
    /// The file was cut off.
    Cut,
}

/// A file that is being read.
pub struct RecordFile {
    path: PathBuf,
    bytes: BufReader<File>,
    /// Its length when it was opened, bytes.
    pub len: u64,
    /// Where its next record starts.
    pub at: u64,
}

impl RecordFile {
    /// Opens a file and reads as many bytes as `magic` has; those, where they are others.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn open(path: &Path, magic: &[u8]) -> Result<(Self, Option<Vec<u8>>)> {
        // Of any length: its records are read one by one, each of a bounded length.
        let (file, len) = bounded_file::open(path)?;
        let bytes = BufReader::with_capacity(BUFFER_BYTES, file);
        let mut file = Self { path: path.to_path_buf(), bytes, len, at: magic.len() as u64 };
        let mut there = Vec::new();
        file.bytes.by_ref().take(file.at).read_to_end(&mut there).map_err(Error::io(path))?;
        Ok((file, Some(there).filter(|there| there != magic)))
    }

    /// Its next record or chunk, for errors.
    pub fn place(&self, what: &str) -> Arc<str> {
        format!("{}, {what} at byte {}", self.path.display(), self.at).into()
    }

    /// The next `len` bytes; `None` where they end before.
    pub fn read(&mut self, len: u64) -> Result<Option<Vec<u8>>> {
        read(&mut self.bytes, len).map_err(Error::io(&self.path))
    }

    /// The place of the byte that is read next.
    pub fn position(&mut self) -> Result<u64> {
        self.bytes.stream_position().map_err(Error::io(&self.path))
    }

    /// Goes to the record that starts at `at`.
    pub fn skip_to(&mut self, at: u64) -> Result<()> {
        self.at = at;
        self.bytes.seek(SeekFrom::Start(at)).map(drop).map_err(Error::io(&self.path))
    }

    /// The `len` bytes from `start`, read by themselves.
    pub fn piece(&self, start: u64, len: u64) -> Result<impl BufRead + Send + use<>> {
        let (mut piece, _) = bounded_file::open(&self.path)?;
        piece.seek(SeekFrom::Start(start)).map_err(Error::io(&self.path))?;
        Ok(BufReader::with_capacity(BUFFER_BYTES, piece).take(len))
    }
}

/// A chunk that is being read.
pub struct Chunk {
    /// Where it is, for errors.
    pub place: Arc<str>,
    /// Its bytes, unpacked.
    pub bytes: Box<dyn Read + Send>,
    /// Bytes still to come, unpacked; `None` where that was not written any more.
    pub left: Option<u64>,
    /// Where the record after it starts.
    pub end: u64,
    /// Whether the file ends before the chunk.
    pub is_cut: bool,
}

impl Chunk {
    /// The next `len` bytes; `None` where they end before.
    pub fn read(&mut self, len: u64) -> Result<Option<Vec<u8>>> {
        match read(&mut self.bytes, len) {
            // What is packed cannot be unpacked to its last byte where it is cut.
            Err(_) if self.is_cut => Ok(None),
            Err(error) => Err(self.damage(&error)),
            Ok(bytes) => Ok(bytes),
        }
    }

    /// What is wrong with bytes that cannot be unpacked.
    pub fn damage(&self, error: &std::io::Error) -> Error {
        Error::invalid(&*self.place, "bytes that can be unpacked", error.to_string())
    }

    /// Counts a record of `len` bytes.
    ///
    /// # Errors
    /// More than are left of the chunk.
    pub fn count(&mut self, len: u64) -> Result<()> {
        let Some(left) = self.left else { return Ok(()) };
        self.left = left.checked_sub(len);
        let expected = || format!("a record within the {left} bytes left of the chunk");
        self.left.map(drop).ok_or_else(|| Error::invalid(&*self.place, expected(), format!("{len} bytes")))
    }

    /// What follows where its bytes ended in a record.
    pub fn ended_early<Record>(&self) -> Result<Step<Record>> {
        match self.left {
            Some(left) if !self.is_cut => Err(Error::invalid(&*self.place, format!("{left} more bytes"), "its end")),
            _ => Ok(Step::Cut),
        }
    }
}

/// The next `len` bytes; `None` where they end before. Memory grows with what is there, not with `len`.
fn read(bytes: &mut dyn Read, len: u64) -> std::io::Result<Option<Vec<u8>>> {
    let mut there = Vec::new();
    bytes.take(len).read_to_end(&mut there)?;
    Ok((there.len() as u64 == len).then_some(there))
}

/// Refuses a record that is too large.
pub fn check_len(len: u64, place: &str) -> Result<()> {
    if len <= MAX_RECORD_BYTES {
        return Ok(());
    }
    Err(Error::invalid(place, format!("records of at most {MAX_RECORD_BYTES} bytes"), format!("{len} bytes")))
}

/// The little endian number that `bytes` are: at most 8.
pub fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

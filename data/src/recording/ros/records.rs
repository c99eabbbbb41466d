//! The records of an MCAP file, one after the other, its chunks unpacked (<https://mcap.dev/spec>).
//!
//! Nothing is read ahead and no length is believed: memory follows the largest single record. A file that was cut off
//! gives everything before the cut.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use mcap::MAGIC;
use mcap::records::op;

use crate::error::{Error, Result};
use crate::recording::ros::unpack::unpack;

/// The largest record, bytes: a picture of 9000 x 9000 pixels.
const MAX_RECORD_BYTES: u64 = 1 << 28;

/// Opcode and length in front of every record, bytes.
const PREFIX_BYTES: u64 = 9;

/// A record as it is in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Its kind ([`mcap::records::op`]).
    pub opcode: u8,
    /// What it holds.
    pub body: Vec<u8>,
}

/// What comes next.
enum Step {
    Record(Record),
    End,
    Cut,
}

/// The bytes of a chunk, unpacked.
enum Unpacked {
    /// As they are in the file.
    InFile,
    /// From a reader of their own, at the chunk's place in the file.
    Stream(Box<dyn Read + Send>),
}

struct Chunk {
    /// Where it starts, for errors.
    at: u64,
    bytes: Unpacked,
    /// Bytes still to come, unpacked.
    left: u64,
    hash: Hasher,
    /// The checksum that its header states; 0 for none.
    crc: u32,
    /// Where the record after it starts.
    end: u64,
    /// Whether the file ends before the chunk.
    is_cut: bool,
}

/// Reads the records of the data section in order.
pub struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Length of the file when it was opened, bytes.
    len: u64,
    /// Where the next record of the file starts.
    at: u64,
    chunk: Option<Chunk>,
    is_done: bool,
    cut_at: Option<u64>,
}

impl Records {
    /// Opens a file.
    ///
    /// # Errors
    /// No such file, or not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(Error::io(path))?);
        let len = file.get_ref().metadata().map_err(Error::io(path))?.len();
        let mut magic = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut magic).map_err(Error::io(path))?;
        if magic != MAGIC {
            let got = format!("{len} bytes that begin otherwise");
            return Err(Error::invalid(path.display().to_string(), "an MCAP file", got));
        }
        let at = MAGIC.len() as u64;
        Ok(Self { path: path.to_path_buf(), file, len, at, chunk: None, is_done: false, cut_at: None })
    }

    /// The byte at which the file was cut off, once the records before it have been read.
    pub fn cut_at(&self) -> Option<u64> {
        self.cut_at
    }

    /// The next record; `None` at the end of the data, and at a cut.
    ///
    /// # Errors
    /// Damage in the middle of the file, with its place; a compression that is not known.
    pub fn next(&mut self) -> Result<Option<Record>> {
        while !self.is_done {
            let step = match &mut self.chunk {
                Some(chunk) => chunk.next(&mut self.file, &self.path)?,
                None => self.next_in_file()?,
            };
            match (step, self.chunk.take()) {
                (Step::Record(record), chunk) => {
                    self.chunk = chunk;
                    return Ok(Some(record));
                }
                (Step::End, Some(chunk)) => {
                    self.file.seek(SeekFrom::Start(chunk.end)).map_err(Error::io(&self.path))?;
                    self.at = chunk.end;
                }
                (Step::End, None) => self.is_done = true,
                (Step::Cut, _) => (self.is_done, self.cut_at) = (true, Some(self.len)),
            }
        }
        Ok(None)
    }

    /// The next record outside chunks; enters a chunk where one begins.
    fn next_in_file(&mut self) -> Result<Step> {
        loop {
            let Some((opcode, len)) = prefix(&mut self.file).map_err(Error::io(&self.path))? else {
                return Ok(Step::Cut);
            };
            let place = format!("{}, record at byte {}", self.path.display(), self.at);
            let Some(end) = self.at.checked_add(PREFIX_BYTES).and_then(|body| body.checked_add(len)) else {
                return Err(Error::invalid(place, "a length that a file can have", format!("{len} bytes")));
            };
            match opcode {
                op::DATA_END | op::FOOTER => return Ok(Step::End),
                op::CHUNK => {
                    let Some(chunk) = self.open_chunk(end, &place)? else { return Ok(Step::Cut) };
                    let step = self.chunk.insert(chunk).next(&mut self.file, &self.path)?;
                    return Ok(step);
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    check_len(len, &place)?;
                    let Some(body) = body(&mut self.file, len).map_err(Error::io(&self.path))? else {
                        return Ok(Step::Cut);
                    };
                    self.at = end;
                    return Ok(Step::Record(Record { opcode, body }));
                }
                // Indices, attachments, metadata: nothing that is asked for here.
                _ if end > self.len => return Ok(Step::Cut),
                _ => {
                    self.file.seek(SeekFrom::Start(end)).map_err(Error::io(&self.path))?;
                    self.at = end;
                }
            }
        }
    }

    /// Reads the header of a chunk whose record ends at `end`; `None` where the file ends in it.
    fn open_chunk(&mut self, end: u64, place: &str) -> Result<Option<Chunk>> {
        let Some(header) = ChunkHeader::read(&mut self.file, place)? else { return Ok(None) };
        let ChunkHeader { compression, packed_len, unpacked_len, crc } = header;
        let start = self.file.stream_position().map_err(Error::io(&self.path))?;
        if start.checked_add(packed_len).is_none_or(|records_end| records_end > end) {
            let expected = format!("a chunk of at most {} bytes", end.saturating_sub(start));
            return Err(Error::invalid(place, expected, format!("{packed_len} bytes")));
        }
        let bytes = if compression.is_empty() {
            if packed_len != unpacked_len {
                let got = format!("{packed_len} bytes");
                return Err(Error::invalid(place, format!("{unpacked_len} bytes in a chunk that is not packed"), got));
            }
            Unpacked::InFile
        } else {
            let mut packed = File::open(&self.path).map_err(Error::io(&self.path))?;
            packed.seek(SeekFrom::Start(start)).map_err(Error::io(&self.path))?;
            let packed = BufReader::with_capacity(1 << 16, packed).take(packed_len);
            let stream = unpack(&compression, packed);
            Unpacked::Stream(stream.ok_or_else(|| {
                Error::invalid(place, "a chunk that is not packed, or in zstd or lz4", format!("\"{compression}\""))
            })?)
        };
        let is_cut = start + packed_len > self.len;
        Ok(Some(Chunk { at: self.at, bytes, left: unpacked_len, hash: Hasher::new(), crc, end, is_cut }))
    }
}

impl Chunk {
    fn next(&mut self, file: &mut BufReader<File>, path: &Path) -> Result<Step> {
        let place = format!("{}, chunk at byte {}", path.display(), self.at);
        loop {
            if self.left == 0 {
                return self.end(&place);
            }
            let Some((opcode, len)) = self.read(file, &place, prefix)? else { return self.ended_early(&place) };
            let left = self.left.checked_sub(PREFIX_BYTES).and_then(|left| left.checked_sub(len));
            let Some(left) = left else {
                let expected = format!("a record within the {} bytes left of the chunk", self.left);
                return Err(Error::invalid(place, expected, format!("{len} bytes")));
            };
            check_len(len, &place)?;
            let Some(body) = self.read(file, &place, |bytes| body(bytes, len))? else {
                return self.ended_early(&place);
            };
            self.hash.update(&[&[opcode][..], &len.to_le_bytes()].concat());
            self.hash.update(&body);
            self.left = left;
            if matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                return Ok(Step::Record(Record { opcode, body }));
            }
        }
    }

    /// Reads with `read`; `None` where the bytes end before.
    fn read<T>(
        &mut self,
        file: &mut BufReader<File>,
        place: &str,
        read: impl FnOnce(&mut dyn Read) -> io::Result<Option<T>>,
    ) -> Result<Option<T>> {
        let result = match &mut self.bytes {
            Unpacked::InFile => read(file),
            Unpacked::Stream(stream) => read(stream),
        };
        match result {
            // What is packed cannot be unpacked to its last byte where it is cut.
            Err(_) if self.is_cut => Ok(None),
            Err(error) => Err(Error::invalid(place, "bytes that can be unpacked", error.to_string())),
            Ok(value) => Ok(value),
        }
    }

    fn ended_early(&self, place: &str) -> Result<Step> {
        if self.is_cut {
            return Ok(Step::Cut);
        }
        Err(Error::invalid(place, format!("{} more bytes", self.left), "its end"))
    }

    fn end(&mut self, place: &str) -> Result<Step> {
        let got = std::mem::take(&mut self.hash).finalize();
        if self.crc != 0 && self.crc != got {
            return Err(Error::invalid(place, format!("bytes with the CRC {:08x}", self.crc), format!("{got:08x}")));
        }
        Ok(Step::End)
    }
}

/// What is needed of a chunk's header.
struct ChunkHeader {
    compression: String,
    packed_len: u64,
    unpacked_len: u64,
    crc: u32,
}

impl ChunkHeader {
    /// `None` where the file ends in it.
    fn read(file: &mut BufReader<File>, place: &str) -> Result<Option<Self>> {
        /// The longest name of a compression.
        const MAX_NAME_BYTES: u32 = 32;
        // First and last time, unpacked length, CRC, length of the name.
        let Some(fixed) = body(file, 32).map_err(Error::io(place))? else { return Ok(None) };
        let name_len = u32_at(&fixed, 28);
        if name_len > MAX_NAME_BYTES {
            let expected = format!("a name of a compression of at most {MAX_NAME_BYTES} bytes");
            return Err(Error::invalid(place, expected, format!("{name_len} bytes")));
        }
        let Some(name) = body(file, u64::from(name_len)).map_err(Error::io(place))? else { return Ok(None) };
        let Some(packed_len) = body(file, 8).map_err(Error::io(place))? else { return Ok(None) };
        Ok(Some(Self {
            compression: String::from_utf8_lossy(&name).into_owned(),
            packed_len: u64_at(&packed_len, 0),
            unpacked_len: u64_at(&fixed, 16),
            crc: u32_at(&fixed, 24),
        }))
    }
}

/// Opcode and length of the next record; `None` where the bytes end before.
fn prefix(bytes: &mut dyn Read) -> io::Result<Option<(u8, u64)>> {
    Ok(body(bytes, PREFIX_BYTES)?.map(|prefix| (prefix[0], u64_at(&prefix, 1))))
}

/// The next `len` bytes; `None` where they end before. Memory grows with what is there, not with `len`.
fn body(bytes: &mut dyn Read, len: u64) -> io::Result<Option<Vec<u8>>> {
    let mut body = Vec::new();
    Read::take(bytes, len).read_to_end(&mut body)?;
    Ok((body.len() as u64 == len).then_some(body))
}

fn check_len(len: u64, place: &str) -> Result<()> {
    if len <= MAX_RECORD_BYTES {
        return Ok(());
    }
    Err(Error::invalid(place, format!("records of at most {MAX_RECORD_BYTES} bytes"), format!("{len} bytes")))
}

/// The little endian number at `at`, which is there.
fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes[at..at + 8].iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// The little endian number at `at`, which is there.
fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

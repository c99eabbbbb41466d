//! The records of a ROS 1 bag, one after the other, its chunks unpacked (<http://wiki.ros.org/Bags/Format/2.0>).
//!
//! The file is read from its beginning and the index passed over, so a bag without one is read as any other.

use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use bzip2::bufread::BzDecoder;

use crate::error::{Error, Result};
use crate::recording::ros::record_file::{Chunk, RecordFile, Step, check_len, number};
use crate::recording::ros::unpack::unpack;

/// The first bytes of the format that is read.
pub const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// The kinds of records.
pub mod op {
    /// A message.
    pub const MESSAGE: u8 = 2;
    /// The first record: where the index is.
    pub const BAG_HEADER: u8 = 3;
    /// Connections and messages, packed or not.
    pub const CHUNK: u8 = 5;
    /// A topic and its type.
    pub const CONNECTION: u8 = 7;
}

/// The largest header: a few numbers and the name of a topic.
const MAX_HEADER_BYTES: u64 = 1 << 16;

/// Two lengths are in every record, bytes.
const LENGTHS_BYTES: u64 = 8;

/// A connection or a message.
#[derive(Clone, Debug)]
pub struct Record {
    /// Its kind ([`op`]).
    pub op: u8,
    /// Its fields, to be read by [`Fields`].
    pub header: Vec<u8>,
    /// What it holds.
    pub data: Vec<u8>,
    /// Where it is, for errors: the file, and the byte where it or its chunk starts.
    pub place: Arc<str>,
}

/// How a file ends that does not end as it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// At this byte, in a record or before the index.
    Cut(u64),
    /// Behind a whole record, without an index: the program that recorded it was ended.
    NotClosed,
}

/// What is in front of a record's data.
struct Head {
    op: u8,
    header: Vec<u8>,
    data_len: u64,
}

/// Reads the records in order.
pub struct Records {
    file: RecordFile,
    /// Where the index starts, as the first record says; 0 until a bag is closed.
    index_at: u64,
    chunk: Option<Chunk>,
    is_done: bool,
    ending: Option<Ending>,
}

impl Records {
    /// Opens a file and checks that it begins as a ROS 1 bag of format 2.0 does.
    ///
    /// # Errors
    /// A file that cannot be read, or another format.
    pub fn open(path: &Path) -> Result<Self> {
        let (file, other) = RecordFile::open(path, MAGIC)?;
        if let Some(magic) = other {
            let got = match magic.strip_prefix(b"#ROSBAG ") {
                Some(version) => format!("format {}", String::from_utf8_lossy(version).trim().escape_debug()),
                None => format!("{} bytes that begin otherwise", file.len),
            };
            return Err(Error::invalid(path.display().to_string(), "a ROS 1 bag of format V2.0", got));
        }
        Ok(Self { file, index_at: 0, chunk: None, is_done: false, ending: None })
    }

    /// How the file ends where it does not end as it should, once the records before have been read.
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// The next connection or message; `None` at the end of the file, and at a cut.
    ///
    /// # Errors
    /// Damage in the middle of the file, with its place; a compression that is not known.
    pub fn next(&mut self) -> Result<Option<Record>> {
        while !self.is_done {
            let step = match &mut self.chunk {
                Some(chunk) => next_in_chunk(chunk)?,
                None => self.next_in_file()?,
            };
            match (step, self.chunk.take()) {
                (Step::Record(record), chunk) => {
                    self.chunk = chunk;
                    return Ok(Some(record));
                }
                (Step::End, Some(chunk)) => self.file.skip_to(chunk.end)?,
                (Step::End, None) => {
                    self.is_done = true;
                    self.ending = match self.index_at {
                        0 => Some(Ending::NotClosed),
                        at if at > self.file.len => Some(Ending::Cut(self.file.len)),
                        _ => None,
                    };
                }
                (Step::Cut, _) => (self.is_done, self.ending) = (true, Some(Ending::Cut(self.file.len))),
            }
        }
        Ok(None)
    }

    /// The next record outside chunks; enters a chunk where one begins.
    fn next_in_file(&mut self) -> Result<Step<Record>> {
        while self.file.at < self.file.len {
            let place = self.file.place("record");
            let head = head(&mut |len| self.file.read(len), &place)?;
            let Some(Head { op, header, data_len }) = head else { return Ok(Step::Cut) };
            let start = self.file.at + LENGTHS_BYTES + header.len() as u64;
            let end = start + data_len;
            match op {
                op::CONNECTION | op::MESSAGE => {
                    check_len(data_len, &place)?;
                    let Some(data) = self.file.read(data_len)? else { return Ok(Step::Cut) };
                    self.file.at = end;
                    return Ok(Step::Record(Record { op, header, data, place }));
                }
                op::CHUNK => {
                    let chunk = self.open_chunk(&Fields::of(&header, &place)?, start, data_len)?;
                    return next_in_chunk(self.chunk.insert(chunk));
                }
                op::BAG_HEADER => self.index_at = Fields::of(&header, &place)?.u64("index_pos")?,
                // The index.
                _ => {}
            }
            if end > self.file.len {
                return Ok(Step::Cut);
            }
            self.file.skip_to(end)?;
        }
        Ok(Step::End)
    }

    /// The chunk whose `packed_len` bytes begin at `start`.
    fn open_chunk(&self, fields: &Fields, start: u64, packed_len: u64) -> Result<Chunk> {
        let place = self.file.place("chunk");
        let (compression, size) = (fields.text("compression")?, u64::from(fields.u32("size")?));
        let is_packed = compression != "none";
        // Lengths are written when a chunk is closed. The records of one that is not packed go on behind it.
        let is_open = self.index_at == 0 && packed_len == 0 && is_packed;
        let packed_len = if is_open { self.file.len - start } else { packed_len };
        if !is_packed && size != packed_len {
            let got = format!("{packed_len} bytes");
            return Err(Error::invalid(&*place, format!("{size} bytes in a chunk that is not packed"), got));
        }
        let packed = self.file.piece(start, packed_len)?;
        let bytes: Option<Box<dyn Read + Send>> = match compression.as_str() {
            "none" => unpack("", packed),
            "bz2" => Some(Box::new(BzDecoder::new(packed))),
            "lz4" => unpack("lz4", packed),
            _ => None,
        };
        let Some(bytes) = bytes else {
            let got = compression.escape_debug().to_string();
            return Err(Error::invalid(&*place, "a chunk in none, bz2 or lz4", got));
        };
        let (left, end) = ((!is_open).then_some(size), start + packed_len);
        Ok(Chunk { place, bytes, left, end, is_cut: is_open || end > self.file.len })
    }
}

/// The next record of a chunk.
fn next_in_chunk(chunk: &mut Chunk) -> Result<Step<Record>> {
    let place = Arc::clone(&chunk.place);
    while chunk.left != Some(0) {
        let Some(head) = head(&mut |len| chunk.read(len), &place)? else { return chunk.ended_early() };
        let Head { op, header, data_len } = head;
        chunk.count(LENGTHS_BYTES + header.len() as u64 + data_len)?;
        check_len(data_len, &place)?;
        let Some(data) = chunk.read(data_len)? else { return chunk.ended_early() };
        if matches!(op, op::CONNECTION | op::MESSAGE) {
            return Ok(Step::Record(Record { op, header, data, place }));
        }
    }
    // Reads past the last byte, behind which the checksum of lz4 and bz2 is.
    match chunk.bytes.read(&mut [0]) {
        _ if chunk.is_cut => Ok(Step::Cut),
        Ok(0) => Ok(Step::End),
        Ok(_) => Err(Error::invalid(&*place, "as many bytes as its size says", "more")),
        Err(error) => Err(chunk.damage(&error)),
    }
}

/// The fields of a header: names with their values.
pub struct Fields<'a> {
    all: Vec<(&'a [u8], &'a [u8])>,
    place: &'a str,
}

impl<'a> Fields<'a> {
    /// Takes a header apart; `place` names it in errors.
    ///
    /// # Errors
    /// Bytes that are not fields.
    pub fn of(mut header: &'a [u8], place: &'a str) -> Result<Self> {
        let mut all = Vec::new();
        while !header.is_empty() {
            let field = header.split_first_chunk().and_then(|(len, rest)| {
                let (field, rest) = rest.split_at_checked(u32::from_le_bytes(*len) as usize)?;
                let equals = field.iter().position(|byte| *byte == b'=')?;
                Some((&field[..equals], &field[equals + 1..], rest))
            });
            let Some((name, value, rest)) = field else {
                let got = format!("{} bytes after {} of them", header.len(), all.len());
                return Err(Error::invalid(place, "fields, each a length, a name, = and a value", got));
            };
            all.push((name, value));
            header = rest;
        }
        Ok(Self { all, place })
    }

    fn bytes(&self, name: &str) -> Result<&'a [u8]> {
        let found = self.all.iter().find(|(known, _)| *known == name.as_bytes());
        found.map(|(_, value)| *value).ok_or_else(|| Error::invalid(self.place, format!("a field {name}"), "none"))
    }

    fn number<const N: usize>(&self, name: &str) -> Result<[u8; N]> {
        let value = self.bytes(name)?;
        let bad = |_| Error::invalid(self.place, format!("{N} bytes of {name}"), value.len().to_string());
        value.try_into().map_err(bad)
    }

    /// A byte.
    pub fn u8(&self, name: &str) -> Result<u8> {
        self.number(name).map(|[byte]| byte)
    }

    /// An unsigned number of 32 bits.
    pub fn u32(&self, name: &str) -> Result<u32> {
        self.number(name).map(u32::from_le_bytes)
    }

    /// An unsigned number of 64 bits.
    pub fn u64(&self, name: &str) -> Result<u64> {
        self.number(name).map(u64::from_le_bytes)
    }

    /// A time, nanoseconds: two numbers of 32 bits, seconds and nanoseconds.
    pub fn time_ns(&self, name: &str) -> Result<i64> {
        let time = self.u64(name)?;
        Ok((time & u64::from(u32::MAX)) as i64 * 1_000_000_000 + (time >> 32) as i64)
    }

    /// A string of UTF-8.
    pub fn text(&self, name: &str) -> Result<String> {
        let text = std::str::from_utf8(self.bytes(name)?);
        text.map(str::to_owned).map_err(|e| Error::invalid(self.place, format!("{name} in UTF-8"), e.to_string()))
    }
}

/// What is in front of the data of the next record; `None` where the bytes, which `read` takes, end before.
fn head(read: &mut dyn FnMut(u64) -> Result<Option<Vec<u8>>>, place: &str) -> Result<Option<Head>> {
    let Some(header_len) = read(4)?.map(|len| number(&len)) else { return Ok(None) };
    if header_len > MAX_HEADER_BYTES {
        let expected = format!("a header of at most {MAX_HEADER_BYTES} bytes");
        return Err(Error::invalid(place, expected, format!("{header_len} bytes")));
    }
    let Some(header) = read(header_len)? else { return Ok(None) };
    let Some(data_len) = read(4)?.map(|len| number(&len)) else { return Ok(None) };
    let op = Fields::of(&header, place)?.u8("op")?;
    Ok(Some(Head { op, header, data_len }))
}

//! The records of a ROS 1 bag, one after the other, its chunks unpacked (<http://wiki.ros.org/Bags/Format/2.0>).
//!
//! The file is read from its beginning and the index passed over, so a bag without one is read as any other. No length
//! is believed: memory follows the largest single record.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bzip2::bufread::BzDecoder;

use crate::error::{Error, Result};
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

/// The largest message, bytes: a picture of 9000 x 9000 pixels.
const MAX_DATA_BYTES: u64 = 1 << 28;

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

/// What comes next.
enum Step {
    Record(Record),
    End,
    Cut,
}

/// What is in front of a record's data.
struct Head {
    op: u8,
    header: Vec<u8>,
    data_len: u64,
}

struct Chunk {
    /// Where it is, for errors.
    place: Arc<str>,
    bytes: Box<dyn Read + Send>,
    /// Bytes still to come, unpacked; `None` where that was not written any more.
    left: Option<u64>,
    /// Where the record after it starts.
    end: u64,
    /// Whether the file ends before the chunk.
    is_cut: bool,
}

/// Reads the records in order.
pub struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Length of the file when it was opened, bytes.
    len: u64,
    /// Where the next record of the file starts.
    at: u64,
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
        let mut file = BufReader::new(File::open(path).map_err(Error::io(path))?);
        let len = file.get_ref().metadata().map_err(Error::io(path))?.len();
        let mut magic = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut magic).map_err(Error::io(path))?;
        if magic != MAGIC {
            let got = match magic.strip_prefix(b"#ROSBAG ") {
                Some(version) => format!("format {}", String::from_utf8_lossy(version).trim().escape_debug()),
                None => format!("{len} bytes that begin otherwise"),
            };
            return Err(Error::invalid(path.display().to_string(), "a ROS 1 bag of format V2.0", got));
        }
        let (path, at) = (path.to_path_buf(), MAGIC.len() as u64);
        Ok(Self { path, file, len, at, index_at: 0, chunk: None, is_done: false, ending: None })
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
                Some(chunk) => chunk.next()?,
                None => self.next_in_file()?,
            };
            match (step, self.chunk.take()) {
                (Step::Record(record), chunk) => {
                    self.chunk = chunk;
                    return Ok(Some(record));
                }
                (Step::End, Some(chunk)) => self.skip_to(chunk.end)?,
                (Step::End, None) => {
                    self.is_done = true;
                    self.ending = match self.index_at {
                        0 => Some(Ending::NotClosed),
                        at if at > self.len => Some(Ending::Cut(self.len)),
                        _ => None,
                    };
                }
                (Step::Cut, _) => (self.is_done, self.ending) = (true, Some(Ending::Cut(self.len))),
            }
        }
        Ok(None)
    }

    /// The next record outside chunks; enters a chunk where one begins.
    fn next_in_file(&mut self) -> Result<Step> {
        while self.at < self.len {
            let place: Arc<str> = format!("{}, record at byte {}", self.path.display(), self.at).into();
            let mut read = |len| body(&mut self.file, len).map_err(Error::io(&self.path));
            let Some(Head { op, header, data_len }) = head(&mut read, &place)? else { return Ok(Step::Cut) };
            let start = self.at + LENGTHS_BYTES + header.len() as u64;
            let end = start + data_len;
            match op {
                op::CONNECTION | op::MESSAGE => {
                    check_len(data_len, &place)?;
                    let Some(data) = read(data_len)? else { return Ok(Step::Cut) };
                    self.at = end;
                    return Ok(Step::Record(Record { op, header, data, place }));
                }
                op::CHUNK => {
                    let chunk = self.open_chunk(&Fields::of(&header, &place)?, start, data_len)?;
                    return self.chunk.insert(chunk).next();
                }
                op::BAG_HEADER => self.index_at = Fields::of(&header, &place)?.u64("index_pos")?,
                // The index.
                _ => {}
            }
            if end > self.len {
                return Ok(Step::Cut);
            }
            self.skip_to(end)?;
        }
        Ok(Step::End)
    }

    fn skip_to(&mut self, at: u64) -> Result<()> {
        self.at = at;
        self.file.seek(SeekFrom::Start(at)).map(drop).map_err(Error::io(&self.path))
    }

    /// The chunk whose `packed_len` bytes begin at `start`.
    fn open_chunk(&self, fields: &Fields, start: u64, packed_len: u64) -> Result<Chunk> {
        let place: Arc<str> = format!("{}, chunk at byte {}", self.path.display(), self.at).into();
        let (compression, size) = (fields.text("compression")?, u64::from(fields.u32("size")?));
        let is_packed = compression != "none";
        // Lengths are written when a chunk is closed. The records of one that is not packed go on behind it.
        let is_open = self.index_at == 0 && packed_len == 0 && is_packed;
        let packed_len = if is_open { self.len - start } else { packed_len };
        if !is_packed && size != packed_len {
            let got = format!("{packed_len} bytes");
            return Err(Error::invalid(&*place, format!("{size} bytes in a chunk that is not packed"), got));
        }
        let mut packed = File::open(&self.path).map_err(Error::io(&self.path))?;
        packed.seek(SeekFrom::Start(start)).map_err(Error::io(&self.path))?;
        let packed = BufReader::with_capacity(1 << 16, packed).take(packed_len);
        let bytes: Option<Box<dyn Read + Send>> = match compression.as_str() {
            "none" => Some(Box::new(packed)),
            "bz2" => Some(Box::new(BzDecoder::new(packed))),
            "lz4" => unpack("lz4", packed),
            _ => None,
        };
        let Some(bytes) = bytes else {
            let got = compression.escape_debug().to_string();
            return Err(Error::invalid(&*place, "a chunk in none, bz2 or lz4", got));
        };
        let (left, end) = ((!is_open).then_some(size), start + packed_len);
        Ok(Chunk { place, bytes, left, end, is_cut: is_open || end > self.len })
    }
}

impl Chunk {
    fn next(&mut self) -> Result<Step> {
        let place = Arc::clone(&self.place);
        while self.left != Some(0) {
            let Some(head) = head(&mut |len| self.read(len), &place)? else { return self.ended_early() };
            let Head { op, header, data_len } = head;
            let len = LENGTHS_BYTES + header.len() as u64 + data_len;
            if let Some(left) = self.left {
                self.left = Some(left.checked_sub(len).ok_or_else(|| {
                    let expected = format!("a record within the {left} bytes left of the chunk");
                    Error::invalid(&*place, expected, format!("{len} bytes"))
                })?);
            }
            check_len(data_len, &place)?;
            let Some(data) = self.read(data_len)? else { return self.ended_early() };
            if matches!(op, op::CONNECTION | op::MESSAGE) {
                return Ok(Step::Record(Record { op, header, data, place }));
            }
        }
        self.end()
    }

    /// The next `len` bytes; `None` where they end before.
    fn read(&mut self, len: u64) -> Result<Option<Vec<u8>>> {
        match body(&mut self.bytes, len) {
            // What is packed cannot be unpacked to its last byte where it is cut.
            Err(_) if self.is_cut => Ok(None),
            Err(error) => Err(self.damage(&error)),
            Ok(bytes) => Ok(bytes),
        }
    }

    fn damage(&self, error: &io::Error) -> Error {
        Error::invalid(&*self.place, "bytes that can be unpacked", error.to_string())
    }

    fn ended_early(&self) -> Result<Step> {
        match self.left {
            Some(left) if !self.is_cut => Err(Error::invalid(&*self.place, format!("{left} more bytes"), "its end")),
            _ => Ok(Step::Cut),
        }
    }

    /// Reads past the last byte, behind which the checksum of lz4 and bz2 is.
    fn end(&mut self) -> Result<Step> {
        match self.bytes.read(&mut [0]) {
            _ if self.is_cut => Ok(Step::Cut),
            Ok(0) => Ok(Step::End),
            Ok(_) => Err(Error::invalid(&*self.place, "as many bytes as its size says", "more")),
            Err(error) => Err(self.damage(&error)),
        }
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
    let number = |bytes: Vec<u8>| bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
    let Some(header_len) = read(4)?.map(number) else { return Ok(None) };
    if header_len > MAX_HEADER_BYTES {
        let expected = format!("a header of at most {MAX_HEADER_BYTES} bytes");
        return Err(Error::invalid(place, expected, format!("{header_len} bytes")));
    }
    let Some(header) = read(header_len)? else { return Ok(None) };
    let Some(data_len) = read(4)?.map(number) else { return Ok(None) };
    let op = Fields::of(&header, place)?.u8("op")?;
    Ok(Some(Head { op, header, data_len }))
}

/// The next `len` bytes; `None` where they end before. Memory grows with what is there, not with `len`.
fn body(bytes: &mut dyn Read, len: u64) -> io::Result<Option<Vec<u8>>> {
    let mut body = Vec::new();
    Read::take(bytes, len).read_to_end(&mut body)?;
    Ok((body.len() as u64 == len).then_some(body))
}

fn check_len(len: u64, place: &str) -> Result<()> {
    if len <= MAX_DATA_BYTES {
        return Ok(());
    }
    Err(Error::invalid(place, format!("messages of at most {MAX_DATA_BYTES} bytes"), format!("{len} bytes")))
}

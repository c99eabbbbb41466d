//! The records of an MCAP file, one after the other, its chunks unpacked (<https://mcap.dev/spec>).

use std::path::Path;

use crc32fast::Hasher;
use mcap::MAGIC;
use mcap::records::op;

use crate::error::{Error, Result};
use crate::recording::ros::record_file::{Chunk, RecordFile, Step, check_len, number};
use crate::recording::ros::unpack::unpack;

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

/// A chunk and its checksum.
struct CheckedChunk {
    chunk: Chunk,
    hash: Hasher,
    /// The checksum that its header states; 0 for none.
    crc: u32,
}

/// Reads the records of the data section in order.
pub struct Records {
    file: RecordFile,
    chunk: Option<CheckedChunk>,
    is_done: bool,
    cut_at: Option<u64>,
}

impl Records {
    /// Opens a file.
    ///
    /// # Errors
    /// No such file, or not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        let (file, other) = RecordFile::open(path, MAGIC)?;
        if other.is_some() {
            let got = format!("{} bytes that begin otherwise", file.len);
            return Err(Error::invalid(path.display().to_string(), "an MCAP file", got));
        }
        Ok(Self { file, chunk: None, is_done: false, cut_at: None })
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
                Some(chunk) => chunk.next()?,
                None => self.next_in_file()?,
            };
            match (step, self.chunk.take()) {
                (Step::Record(record), chunk) => {
                    self.chunk = chunk;
                    return Ok(Some(record));
                }
                (Step::End, Some(CheckedChunk { chunk, .. })) => self.file.skip_to(chunk.end)?,
                (Step::End, None) => self.is_done = true,
                (Step::Cut, _) => (self.is_done, self.cut_at) = (true, Some(self.file.len)),
            }
        }
        Ok(None)
    }

    /// The next record outside chunks; enters a chunk where one begins.
    fn next_in_file(&mut self) -> Result<Step<Record>> {
        loop {
            let Some(prefix) = self.file.read(PREFIX_BYTES)? else { return Ok(Step::Cut) };
            let (opcode, len) = (prefix[0], number(&prefix[1..]));
            let place = self.file.place("record");
            let Some(end) = self.file.at.checked_add(PREFIX_BYTES).and_then(|body| body.checked_add(len)) else {
                return Err(Error::invalid(&*place, "a length that a file can have", format!("{len} bytes")));
            };
            match opcode {
                // No record has it: a hole in the file, as a crash leaves at its end.
                0 => return Ok(Step::Cut),
                op::DATA_END | op::FOOTER => return Ok(Step::End),
                op::CHUNK => {
                    let Some(chunk) = self.open_chunk(end, &place)? else { return Ok(Step::Cut) };
                    return self.chunk.insert(chunk).next();
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    check_len(len, &place)?;
                    let Some(body) = self.file.read(len)? else { return Ok(Step::Cut) };
                    self.file.at = end;
                    return Ok(Step::Record(Record { opcode, body }));
                }
                // Indices, attachments, metadata: nothing that is asked for here.
                _ if end > self.file.len => return Ok(Step::Cut),
                _ => self.file.skip_to(end)?,
            }
        }
    }

    /// Reads the header of a chunk whose record ends at `end`; `None` where the file ends in it.
    fn open_chunk(&mut self, end: u64, place: &str) -> Result<Option<CheckedChunk>> {
        let Some(header) = ChunkHeader::read(&mut self.file, place)? else { return Ok(None) };
        let ChunkHeader { compression, packed_len, unpacked_len, crc } = header;
        let start = self.file.position()?;
        if start.checked_add(packed_len).is_none_or(|records_end| records_end > end) {
            let expected = format!("a chunk of at most {} bytes", end.saturating_sub(start));
            return Err(Error::invalid(place, expected, format!("{packed_len} bytes")));
        }
        if compression.is_empty() && packed_len != unpacked_len {
            let got = format!("{packed_len} bytes");
            return Err(Error::invalid(place, format!("{unpacked_len} bytes in a chunk that is not packed"), got));
        }
        let bytes = unpack(&compression, self.file.piece(start, packed_len)?).ok_or_else(|| {
            Error::invalid(place, "a chunk that is not packed, or in zstd or lz4", format!("\"{compression}\""))
        })?;
        let is_cut = start + packed_len > self.file.len;
        let chunk = Chunk { place: self.file.place("chunk"), bytes, left: Some(unpacked_len), end, is_cut };
        Ok(Some(CheckedChunk { chunk, hash: Hasher::new(), crc }))
    }
}

impl CheckedChunk {
    fn next(&mut self) -> Result<Step<Record>> {
        let chunk = &mut self.chunk;
        while chunk.left != Some(0) {
            let Some(prefix) = chunk.read(PREFIX_BYTES)? else { return chunk.ended_early() };
            let (opcode, len) = (prefix[0], number(&prefix[1..]));
            if opcode == 0 {
                return chunk.ended_early();
            }
            chunk.count(PREFIX_BYTES.saturating_add(len))?;
            check_len(len, &chunk.place)?;
            let Some(body) = chunk.read(len)? else { return chunk.ended_early() };
            self.hash.update(&prefix);
            self.hash.update(&body);
            if matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                return Ok(Step::Record(Record { opcode, body }));
            }
        }
        let got = std::mem::take(&mut self.hash).finalize();
        if self.crc != 0 && self.crc != got {
            let expected = format!("bytes with the CRC {:08x}", self.crc);
            return Err(Error::invalid(&*self.chunk.place, expected, format!("{got:08x}")));
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
    fn read(file: &mut RecordFile, place: &str) -> Result<Option<Self>> {
        /// The longest name of a compression.
        const MAX_NAME_BYTES: u64 = 32;
        // First and last time, unpacked length, CRC, length of the name.
        let Some(fixed) = file.read(32)? else { return Ok(None) };
        let name_len = number(&fixed[28..]);
        if name_len > MAX_NAME_BYTES {
            let expected = format!("a name of a compression of at most {MAX_NAME_BYTES} bytes");
            return Err(Error::invalid(place, expected, format!("{name_len} bytes")));
        }
        let Some(name) = file.read(name_len)? else { return Ok(None) };
        let Some(packed_len) = file.read(8)? else { return Ok(None) };
        Ok(Some(Self {
            compression: String::from_utf8_lossy(&name).into_owned(),
            packed_len: number(&packed_len),
            unpacked_len: number(&fixed[16..24]),
            crc: number(&fixed[24..28]) as u32,
        }))
    }
}

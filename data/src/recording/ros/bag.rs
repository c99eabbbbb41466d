//! A ROS 2 bag in MCAP: one file, or a folder of files that one recording was split into.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{Record as Parsed, op};
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::recording::ros::records::{Record, Records};
use crate::recording::ros::unpack::{ZSTD_MAGIC, Zstd};

/// The largest message once it is unpacked, bytes: as the largest record.
const MAX_MESSAGE_BYTES: u64 = 1 << 28;

/// A recording's files, in order.
#[derive(Clone, Debug)]
pub struct Bag {
    files: Vec<PathBuf>,
}

/// A topic with the type of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its name: `/gelsight/image`.
    pub topic: String,
    /// Its type: `sensor_msgs/msg/Image`.
    pub type_name: String,
}

/// One message as it was recorded.
#[derive(Clone, Debug)]
pub struct Message {
    /// Where it was sent.
    pub channel: Arc<Channel>,
    /// When it was recorded, nanoseconds.
    pub log_time_ns: i64,
    file: Arc<str>,
    data: Vec<u8>,
}

impl Message {
    /// Where it is, for errors: file, topic and the time at which it was recorded.
    pub fn place(&self) -> String {
        format!("{}, {}, {:.3} s", self.file, self.channel.topic, self.log_time_ns as f64 * 1e-9)
    }

    /// Its bytes in CDR, unpacked where rosbag2 packed each message by itself.
    ///
    /// # Errors
    /// Bytes that cannot be unpacked.
    pub fn cdr(self) -> Result<Vec<u8>> {
        if !self.data.starts_with(&ZSTD_MAGIC) {
            return Ok(self.data);
        }
        let place = self.place();
        let mut cdr = Vec::new();
        let unpacked = Zstd::new(Cursor::new(self.data)).take(MAX_MESSAGE_BYTES).read_to_end(&mut cdr);
        unpacked.map_err(|e| Error::invalid(place, "a message packed with zstd", e.to_string()))?;
        Ok(cdr)
    }
}

/// Whether a source is a bag, readable here or not: by the name of the file, or of a file in the folder.
pub fn is_bag(source: &Path) -> bool {
    let is_bag_file = |path: &Path| kind(path).is_some();
    if !source.is_dir() {
        return is_bag_file(source);
    }
    fs::read_dir(source).is_ok_and(|mut entries| entries.any(|entry| entry.is_ok_and(|e| is_bag_file(&e.path()))))
}

/// The kinds of bags, by the ends of their names.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Mcap,
    Sqlite,
    Ros1,
    /// A whole file in zstd.
    Packed,
}

fn kind(path: &Path) -> Option<Kind> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let kinds = [
        (".mcap", Kind::Mcap),
        (".db3", Kind::Sqlite),
        (".bag", Kind::Ros1),
        (".mcap.zstd", Kind::Packed),
        (".db3.zstd", Kind::Packed),
    ];
    kinds.into_iter().find(|(end, _)| name.ends_with(end)).map(|(_, kind)| kind)
}

impl Bag {
    /// Finds the files of a bag: `source` itself, or the `.mcap` files in it, by the numbers at the ends of their names.
    ///
    /// # Errors
    /// No MCAP; bags in another format, with the command that converts them.
    pub fn open(source: &Path) -> Result<Self> {
        if !source.is_dir() {
            return match kind(source) {
                Some(kind @ (Kind::Sqlite | Kind::Ros1 | Kind::Packed)) => Err(other_format(source, kind)),
                _ => Ok(Self { files: vec![source.to_path_buf()] }),
            };
        }
        let entries = fs::read_dir(source).map_err(Error::io(source))?;
        let paths = entries.map(|entry| entry.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>();
        let paths = paths.map_err(Error::io(source))?;
        let mut files: Vec<PathBuf> = paths.iter().filter(|path| kind(path) == Some(Kind::Mcap)).cloned().collect();
        files.sort_by_cached_key(|path| number_last(path));
        if files.is_empty() {
            let other = paths.iter().find_map(|path| Some((path, kind(path)?)));
            return Err(match other {
                Some((path, Kind::Packed)) => other_format(path, Kind::Packed),
                Some((_, kind)) => other_format(source, kind),
                None => Error::invalid(source.display().to_string(), "at least one .mcap file", "none"),
            });
        }
        Ok(Self { files })
    }

    /// SHA-256 of the file, or of the files one behind the other, in hexadecimal.
    pub fn sha256(&self) -> Result<String> {
        let mut hash = Sha256::new();
        for path in &self.files {
            let mut file = File::open(path).map_err(Error::io(path))?;
            std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
        }
        Ok(format!("{:x}", hash.finalize()))
    }

    /// The messages in the order in which they were recorded.
    pub fn messages(&self) -> Messages<'_> {
        Messages { files: self.files.iter(), file: None, cuts: Vec::new() }
    }
}

fn other_format(source: &Path, kind: Kind) -> Error {
    let path = source.display();
    let got = match kind {
        Kind::Packed => format!("one packed as a whole; first: zstd -d {path}"),
        Kind::Ros1 => format!("a ROS 1 bag; first: rosbags-convert --src {path} --dst out --dst-storage mcap"),
        _ => format!("SQLite; first: rosbags-convert --src {path} --dst out --dst-storage mcap"),
    };
    Error::invalid(path.to_string(), "a bag in MCAP", got)
}

/// The name without the number at its end, the number, and the name: `bag_9.mcap` comes before `bag_10.mcap`.
fn number_last(path: &Path) -> (String, u64, PathBuf) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    (text.to_owned(), stem[text.len()..].parse().unwrap_or_default(), path.to_path_buf())
}

/// The messages of a bag, one at a time.
pub struct Messages<'a> {
    files: std::slice::Iter<'a, PathBuf>,
    file: Option<OpenFile>,
    cuts: Vec<String>,
}

/// A file and what its records have said so far.
struct OpenFile {
    name: Arc<str>,
    records: Records,
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Arc<Channel>>,
    n_messages: usize,
}

impl Messages<'_> {
    /// The files read so far that were cut off, a line each.
    pub fn cuts(&self) -> &[String] {
        &self.cuts
    }

    fn step(&mut self) -> Result<Option<Message>> {
        loop {
            if self.file.is_none() {
                let Some(path) = self.files.next() else { return Ok(None) };
                self.file = Some(OpenFile::new(path)?);
            }
            let Some(file) = &mut self.file else { continue };
            if let Some(message) = file.next()? {
                return Ok(Some(message));
            }
            if let Some(at) = file.records.cut_at() {
                let (name, n_messages) = (&file.name, file.n_messages);
                self.cuts.push(format!("{name} is cut off at byte {at}: the {n_messages} messages before are kept"));
            }
            self.file = None;
        }
    }
}

impl Iterator for Messages<'_> {
    type Item = Result<Message>;

    fn next(&mut self) -> Option<Self::Item> {
        let step = self.step();
        if step.is_err() {
            (self.file, self.files) = (None, [].iter());
        }
        step.transpose()
    }
}

impl OpenFile {
    fn new(path: &Path) -> Result<Self> {
        Ok(Self {
            name: path.display().to_string().into(),
            records: Records::open(path)?,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            n_messages: 0,
        })
    }

    fn next(&mut self) -> Result<Option<Message>> {
        while let Some(record) = self.records.next()? {
            if record.opcode == op::MESSAGE {
                self.n_messages += 1;
                return self.message(record.body).map(Some);
            }
            self.note(&record)?;
        }
        Ok(None)
    }

    /// Remembers a schema or a channel.
    fn note(&mut self, record: &Record) -> Result<()> {
        let bad = |got: String| Error::invalid(&*self.name, "a schema or channel record", got);
        match mcap::parse_record(record.opcode, &record.body).map_err(|e| bad(e.to_string()))? {
            Parsed::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Parsed::Channel(channel) => {
                let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                self.channels.insert(channel.id, Arc::new(Channel { topic: channel.topic, type_name }));
            }
            _ => {}
        }
        Ok(())
    }

    fn message(&self, mut body: Vec<u8>) -> Result<Message> {
        let parsed = match mcap::parse_record(op::MESSAGE, &body) {
            Ok(Parsed::Message { header, data }) => Some((header, body.len() - data.len())),
            _ => None,
        };
        let Some((header, header_len)) = parsed else {
            return Err(Error::invalid(&*self.name, "a message record", format!("{} bytes", body.len())));
        };
        let Some(channel) = self.channels.get(&header.channel_id) else {
            let got = format!("channel {}", header.channel_id);
            return Err(Error::invalid(&*self.name, "a message of a channel that came before it", got));
        };
        body.drain(..header_len);
        let log_time_ns = i64::try_from(header.log_time).unwrap_or(i64::MAX);
        Ok(Message { channel: Arc::clone(channel), log_time_ns, file: Arc::clone(&self.name), data: body })
    }
}

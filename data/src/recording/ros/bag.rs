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
    /// The number that its writer gave it.
    pub sequence: u32,
    file: Arc<str>,
    data: Vec<u8>,
}

impl Message {
    /// Where it is, for errors: file, topic and the time at which it was recorded.
    pub fn place(&self) -> String {
        format!("{}, {}, {:.3} s", self.file, self.channel.topic, self.log_time_ns as f64 * 1e-9)
    }

    /// Its bytes as they were written.
    pub fn bytes(&self) -> &[u8] {
        &self.data
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
        let sequence = header.sequence;
        Ok(Message { channel: Arc::clone(channel), log_time_ns, sequence, file: Arc::clone(&self.name), data: body })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::ros::test_bag::{self, PACKINGS, Packing, Sent, image, pose};

    fn sent() -> Vec<Sent> {
        (1..=8)
            .map(
                |i| {
                    if i % 3 == 0 { pose("/pose", i, "hole/A", [1.0, 2.0, f64::from(i)]) } else { image("/gel", i, 40) }
                },
            )
            .collect()
    }

    struct Written {
        folder: tempfile::TempDir,
    }

    impl Written {
        fn new(bytes: &[u8]) -> Self {
            let written = Self { folder: tempfile::tempdir().unwrap() };
            fs::write(written.path(), bytes).unwrap();
            written
        }

        fn path(&self) -> PathBuf {
            self.folder.path().join("bag.mcap")
        }

        /// All messages up to an error or the end, and what is said of the end.
        fn read(&self) -> (Vec<(String, i64, Vec<u8>)>, String) {
            let bag = Bag::open(&self.path()).unwrap();
            let mut messages = bag.messages();
            let mut read = Vec::new();
            for message in &mut messages {
                match message {
                    Ok(message) => {
                        let channel = Arc::clone(&message.channel);
                        read.push((channel.topic.clone(), message.log_time_ns, message.cdr().unwrap_or_default()));
                    }
                    Err(error) => return (read, error.to_string()),
                }
            }
            (read, messages.cuts().concat())
        }
    }

    fn expected(sent: &[Sent]) -> Vec<(String, i64, Vec<u8>)> {
        sent.iter().map(|(topic, _, time, data)| ((*topic).to_owned(), *time as i64, data.clone())).collect()
    }

    #[test]
    fn every_packing_gives_the_same_messages() {
        for packing in PACKINGS {
            let (read, end) = Written::new(&test_bag::bag(packing, &sent())).read();
            assert_eq!((read, end.as_str()), (expected(&sent()), ""), "{packing:?}");
        }
    }

    #[test]
    fn a_bag_cut_anywhere_gives_what_is_before_the_cut() {
        for packing in PACKINGS {
            let bytes = test_bag::bag(packing, &sent());
            let expected = expected(&sent());
            let mut n_before = 0;
            for end in (9..bytes.len()).step_by(50) {
                let (read, said) = Written::new(&bytes[..end]).read();
                assert_eq!(read, expected[..read.len()], "{packing:?} {end}");
                assert!(read.len() >= n_before, "{packing:?} {end}");
                n_before = read.len();
                // The end of the data and the summary behind it are 13 + 29 + 8 bytes.
                if end < bytes.len() - 50 {
                    let cut = format!("cut off at byte {end}: the {n_before} messages before are kept");
                    assert!(said.contains(&cut), "{said}");
                }
            }
            assert!(n_before >= 6, "{packing:?}: only {n_before}");
        }
    }

    #[test]
    fn a_message_that_is_whole_before_the_cut_is_kept() {
        for packing in [Packing::NoChunks, Packing::Chunks("")] {
            let bytes = test_bag::bag(packing, &sent());
            let ends = expected(&sent()).into_iter().map(|(_, _, data)| {
                let at = bytes.windows(data.len()).position(|window| window == data).unwrap();
                at + data.len()
            });
            // Pictures differ by their time only, so each message is found once.
            for (n_before, end) in ends.enumerate() {
                assert_eq!(Written::new(&bytes[..end]).read().0.len(), n_before + 1, "{packing:?}");
                assert_eq!(Written::new(&bytes[..end - 1]).read().0.len(), n_before, "{packing:?}");
            }
        }
    }

    #[test]
    fn forged_lengths_and_damage_are_errors_of_one_line() {
        let short: Vec<Sent> = (1..=4).map(|i| pose("/pose", i, "hole/A", [1.0, 2.0, 3.0])).collect();
        for packing in PACKINGS {
            let bytes = test_bag::bag(packing, &short);
            let written = Written::new(&bytes);
            for at in 8..bytes.len() - 8 {
                for forged in [u64::MAX - 9, 1 << 40] {
                    let mut damaged = bytes.clone();
                    damaged[at..at + 8].copy_from_slice(&forged.to_le_bytes());
                    fs::write(written.path(), damaged).unwrap();
                    let (read, said) = written.read();
                    assert!(read.len() <= 4 && !said.contains('\n'), "{packing:?} {at}: {said}");
                }
            }
        }
    }

    #[test]
    fn a_changed_bit_in_a_chunk_is_found() {
        let bytes = test_bag::bag(Packing::Chunks(""), &sent());
        let data = &sent()[0].3;
        let at = bytes.windows(data.len()).position(|window| window == *data).unwrap();
        let mut damaged = bytes.clone();
        damaged[at + data.len() / 2] ^= 4;
        let (_, said) = Written::new(&damaged).read();
        assert!(said.contains("chunk at byte") && said.contains("CRC"), "{said}");
        let unknown = test_bag::bag(Packing::Chunks("brotli"), &sent());
        assert!(Written::new(&unknown).read().1.contains("zstd or lz4, got \"brotli\""));
    }

    #[test]
    fn a_split_recording_is_read_in_the_order_of_its_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for (i, sent) in sent().into_iter().enumerate() {
            let bytes = test_bag::bag(Packing::Chunks("zstd"), &[sent]);
            fs::write(folder.path().join(format!("bag_{}.mcap", i + 5)), bytes).unwrap();
        }
        fs::write(folder.path().join("metadata.yaml"), "").unwrap();
        assert!(is_bag(folder.path()));
        let bag = Bag::open(folder.path()).unwrap();
        let times: Vec<i64> = bag.messages().map(|message| message.unwrap().log_time_ns).collect();
        assert_eq!(times, (1..=8).map(|i| i * 1_000_000).collect::<Vec<_>>());
        let whole: Vec<u8> =
            (5..13).flat_map(|i| fs::read(folder.path().join(format!("bag_{i}.mcap"))).unwrap()).collect();
        assert_eq!(bag.sha256().unwrap(), format!("{:x}", Sha256::digest(&whole)));
    }

    #[test]
    fn other_formats_are_refused_with_the_command_that_converts_them() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, reason) in [
            ("a.db3", "a.db3 --dst out --dst-storage mcap"),
            ("a.bag", "a.bag --dst out --dst-storage mcap"),
            ("a.mcap.zstd", "zstd -d "),
        ] {
            fs::write(at(name), "something").unwrap();
            assert!(is_bag(&at(name)));
            let message = Bag::open(&at(name)).unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        }
        fs::remove_file(at("a.bag")).unwrap();
        fs::remove_file(at("a.mcap.zstd")).unwrap();
        assert!(is_bag(folder.path()));
        assert!(Bag::open(folder.path()).unwrap_err().to_string().contains("rosbags-convert"));
        fs::write(at("b.mcap"), "not MCAP").unwrap();
        let message = Bag::open(folder.path()).unwrap().messages().next().unwrap().unwrap_err().to_string();
        assert!(message.contains("b.mcap: expected an MCAP file"), "{message}");
        assert!(!is_bag(&at("a.png")));
    }
}

//! A bag: one file, or a folder of files that one recording was split into. ROS 2 bags are in MCAP; ROS 1 bags are read
//! with the feature `ros1`.

use std::fs;
use std::path::{Path, PathBuf};

use crate::dataset::store::provenance;
use crate::error::{Error, Result};
pub use crate::recording::ros::bag_message::{Channel, Message};
use crate::recording::ros::mcap_file::McapFile;
#[cfg(feature = "ros1")]
use crate::recording::ros::ros1::Ros1File;

/// A recording's files, in order.
#[derive(Clone, Debug)]
pub struct Bag {
    files: Vec<PathBuf>,
}

/// Whether a source is a bag, readable here or not: by the name of the file, or of a file in the folder.
pub fn is_bag(source: &Path) -> bool {
    let is_bag_file = |path: &Path| kind(path).is_some();
    if !source.is_dir() {
        return is_bag_file(source);
    }
    fs::read_dir(source).is_ok_and(|mut entries| entries.any(|entry| entry.is_ok_and(|e| is_bag_file(&e.path()))))
}

/// The kinds of bags, by the ends of their names; of a folder with several the first is taken.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Mcap,
    Ros1,
    /// A whole file in zstd.
    Packed,
    Sqlite,
}

impl Kind {
    /// Whether this build reads it.
    fn is_read(self) -> bool {
        self == Self::Mcap || (self == Self::Ros1 && cfg!(feature = "ros1"))
    }
}

fn kind(path: &Path) -> Option<Kind> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let kinds = [
        (".mcap", Kind::Mcap),
        (".db3", Kind::Sqlite),
        (".bag", Kind::Ros1),
        // As it is called until its recording is closed.
        (".bag.active", Kind::Ros1),
        (".mcap.zstd", Kind::Packed),
        (".db3.zstd", Kind::Packed),
    ];
    kinds.into_iter().find(|(end, _)| name.ends_with(end)).map(|(_, kind)| kind)
}

impl Bag {
    /// Finds the files of a bag: `source` itself, or the `.mcap` files in it, or else the `.bag` files in it where
    /// ROS 1 is read, by the numbers at the ends of their names.
    ///
    /// # Errors
    /// No bag; bags in another format, with the command that converts them.
    pub fn open(source: &Path) -> Result<Self> {
        if !source.is_dir() {
            return match kind(source) {
                Some(kind) if !kind.is_read() => Err(other_format(source, kind)),
                _ => Ok(Self { files: vec![source.to_path_buf()] }),
            };
        }
        let entries = fs::read_dir(source).map_err(Error::io(source))?;
        let paths = entries.map(|entry| entry.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>();
        let mut paths = paths.map_err(Error::io(source))?;
        let Some(first) = paths.iter().filter_map(|path| kind(path)).min() else {
            return Err(Error::invalid(source.display().to_string(), "at least one .mcap file", "none"));
        };
        paths.retain(|path| kind(path) == Some(first));
        if !first.is_read() {
            return Err(other_format(if first == Kind::Packed { &paths[0] } else { source }, first));
        }
        paths.sort_by_cached_key(|path| number_last(path));
        Ok(Self { files: paths })
    }

    /// SHA-256 of the file, or of the files one behind the other, in hexadecimal.
    pub fn sha256(&self) -> Result<String> {
        provenance::sha256(&self.files)
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
        Kind::Ros1 => format!(
            "a ROS 1 bag, which a build with --features ros1 reads; or first: rosbags-convert --src {path} --dst out \
             --dst-storage mcap"
        ),
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

/// A file of a bag that is being read.
enum OpenFile {
    Mcap(McapFile),
    #[cfg(feature = "ros1")]
    Ros1(Ros1File),
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
            self.cuts.extend(file.cut());
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
        #[cfg(feature = "ros1")]
        if kind(path) == Some(Kind::Ros1) {
            return Ros1File::open(path).map(Self::Ros1);
        }
        McapFile::open(path).map(Self::Mcap)
    }

    fn next(&mut self) -> Result<Option<Message>> {
        match self {
            Self::Mcap(file) => file.next(),
            #[cfg(feature = "ros1")]
            Self::Ros1(file) => file.next(),
        }
    }

    /// What is said of a file that was cut off, once it has been read.
    fn cut(&self) -> Option<String> {
        match self {
            Self::Mcap(file) => file.cut(),
            #[cfg(feature = "ros1")]
            Self::Ros1(file) => file.cut(),
        }
    }
}

#[cfg(test)]
#[path = "bag_tests.rs"]
mod tests;

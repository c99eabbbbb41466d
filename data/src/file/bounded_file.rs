//! Files that a user names, opened and read with a bound: reading ends for any file that a path leads to, and takes no more
//! memory than a file of its kind may have.

use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::path::Path;

use crate::error::{Error, Result};

/// The most bytes that a file of a kind may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// What it is, with its article: `a scene`.
    pub name: &'static str,
    /// The most bytes of one.
    pub most_bytes: u64,
}

impl Kind {
    /// A text that people write: settings, parameters, a calibration, the place of a touch. A thousand pages of it.
    pub const SETTINGS: Self = Self { name: "a file of settings", most_bytes: 4 << 20 };
    /// A scene: 10,000 parts of the user's own take 2 MB.
    pub const SCENE: Self = Self { name: "a scene", most_bytes: 64 << 20 };
    /// A frame of 16,384 pixels each way is not stored in more; decoded pictures are bounded by as much.
    pub const PICTURE: Self = Self { name: "a picture", most_bytes: 512 << 20 };
    /// An outline of a million corners takes 20 MB.
    pub const DRAWING: Self = Self { name: "a drawing", most_bytes: 64 << 20 };
    /// 5 million triangles in binary, one for each hundredth of a square millimetre of a large part.
    pub const MESH: Self = Self { name: "a mesh", most_bytes: 256 << 20 };
    /// The index of a recording: two million touches of 250 bytes.
    pub const INDEX: Self = Self { name: "an index", most_bytes: 512 << 20 };
    /// What programs write of figures and settings that were measured: 16 kB for each of 16,000 settings.
    pub const FIGURES: Self = Self { name: "a file of figures", most_bytes: 256 << 20 };
    /// Episodes of one shard: 400,000 of 2.5 kB.
    pub const EPISODES: Self = Self { name: "a shard of episodes", most_bytes: 1 << 30 };
    /// A page with all its pictures; a page of 1,000 parts has 30 MB.
    pub const PAGE: Self = Self { name: "a page", most_bytes: 256 << 20 };
}

/// Opens a file for reading, and returns it with its length, bytes. Of any length: what is read from it is bounded by
/// who reads.
///
/// # Errors
/// [`Error::Io`] for what cannot be read and for what is no file: a folder, a device, a named pipe (which is not waited
/// for).
pub fn open(path: &Path) -> Result<(File, u64)> {
    // Before it is opened: opening a pipe waits for its writer.
    check_is_file(path, &fs::metadata(path).map_err(Error::io(path))?)?;
    let file = File::open(path).map_err(Error::io(path))?;
    // What was opened may be something else by now.
    let about = file.metadata().map_err(Error::io(path))?;
    check_is_file(path, &about)?;
    Ok((file, about.len()))
}

/// [`open`] of a file that is no longer than its kind may be.
///
/// # Errors
/// As [`open`], and a longer file.
pub fn open_kind(path: &Path, kind: Kind) -> Result<File> {
    let (file, n_bytes) = open(path)?;
    if n_bytes > kind.most_bytes { Err(too_long(path, kind, &format!("{n_bytes} bytes"))) } else { Ok(file) }
}

/// All bytes of a file.
///
/// # Errors
/// As [`open_kind`].
pub fn read(path: &Path, kind: Kind) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // One more than there may be: the length that the system states is not always true.
    open_kind(path, kind)?.take(kind.most_bytes + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > kind.most_bytes { Err(too_long(path, kind, "more")) } else { Ok(bytes) }
}

/// All of a file of text.
///
/// # Errors
/// As [`open_kind`], and bytes that are no UTF-8.
pub fn read_to_string(path: &Path, kind: Kind) -> Result<String> {
    let text = String::from_utf8(read(path, kind)?);
    text.map_err(|error| Error::io(path)(io::Error::new(io::ErrorKind::InvalidData, error.utf8_error())))
}

fn too_long(path: &Path, Kind { name, most_bytes }: Kind, got: &str) -> Error {
    Error::invalid(path.display().to_string(), format!("{name} of at most {most_bytes} bytes"), got)
}

/// Refuses a folder, a device, a pipe and a socket.
pub(crate) fn check_is_file(path: &Path, about: &Metadata) -> Result<()> {
    if about.is_file() {
        return Ok(());
    }
    let got = if about.is_dir() { "a folder" } else { "a device, a pipe or a socket" };
    let source = io::Error::new(io::ErrorKind::InvalidInput, format!("expected a file, got {got}"));
    Err(Error::Io { path: path.to_path_buf(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: Kind = Kind { name: "a note", most_bytes: 5 };

    #[test]
    fn a_file_is_read_up_to_the_length_of_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("note");
        fs::write(&path, "12345").unwrap();
        assert_eq!(read_to_string(&path, SMALL).unwrap(), "12345");
        fs::write(&path, "123456").unwrap();
        let error = read(&path, SMALL).unwrap_err().to_string();
        assert!(error.ends_with("note: expected a note of at most 5 bytes, got 6 bytes"), "{error}");
        fs::write(&path, [0xff]).unwrap();
        assert!(read_to_string(&path, SMALL).unwrap_err().to_string().contains("utf-8"));
        // A hole of 6 GB is not read.
        File::create(&path).unwrap().set_len(6 << 30).unwrap();
        assert!(read(&path, SMALL).unwrap_err().to_string().contains("6442450944 bytes"));
        assert_eq!(open(&path).unwrap().1, 6 << 30);
    }

    #[test]
    fn what_is_no_file_is_named_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |path: &Path, got: &str| {
            for error in [open(path).map(drop), read(path, SMALL).map(drop)].map(Result::unwrap_err) {
                let text = error.to_string();
                assert!(matches!(error, Error::Io { .. }) && text.contains(got), "{text}");
                assert!(text.starts_with(&path.display().to_string()), "{text}");
            }
        };
        refused(folder.path(), "expected a file, got a folder");
        refused(&folder.path().join("nowhere"), "No such file");
        #[cfg(unix)]
        {
            let endless = folder.path().join("endless");
            std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
            refused(&endless, "expected a file, got a device");
            let pipe = folder.path().join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            refused(&pipe, "a pipe");
        }
    }
}

//! Lines of another program or person: from a file, a terminal, or a FIFO that outlives its writers.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::error::{Error, Result};

/// A longer line is cut.
const MAX_BYTES: u64 = 4096;

/// Between two tries to open what is gone.
const RETRY: Duration = Duration::from_secs(1);

/// Between two looks for the next writer of a FIFO.
const POLL: Duration = Duration::from_millis(20);

/// Where lines come from.
#[derive(Debug)]
pub struct Lines {
    path: PathBuf,
    /// A FIFO: the end of one writer is not the end.
    is_fifo: bool,
}

impl Lines {
    /// Lines of a file, a terminal or a FIFO. A FIFO is not opened yet: that waits for its first writer.
    ///
    /// # Errors
    /// Nothing at the path, a folder, a file that cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let metadata = fs::metadata(path).map_err(Error::io(path))?;
        if metadata.is_dir() {
            return Err(Error::invalid(path.display().to_string(), "a file, a FIFO or a terminal", "a folder"));
        }
        let is_fifo = is_fifo(&metadata);
        if !is_fifo {
            File::open(path).map_err(Error::io(path))?;
        }
        Ok(Self { path: path.to_path_buf(), is_fifo })
    }

    /// Gives each line that is not empty to `take`, without its end, until the lines end or `take` says `false`. A FIFO
    /// stays open after its writer has ended, so that the next one always finds a reader; it is tried again where it is
    /// gone. What cannot be read is a line of its own: `Err` with the reason, once until it can be read again.
    pub fn each(&self, mut take: impl FnMut(std::result::Result<Vec<u8>, String>) -> bool) {
        let mut is_gone = false;
        loop {
            let read = File::open(&self.path).and_then(|file| {
                is_gone = false;
                self.each_of_file(file, &mut |line| take(Ok(line)))
            });
            let Err(error) = read else { return };
            let goes_on = is_gone || take(Err(format!("{}: {error}", self.path.display())));
            if !goes_on || !self.is_fifo {
                return;
            }
            is_gone = true;
            std::thread::sleep(RETRY);
        }
    }

    /// Gives each line to `take` until it wants no more, the file ends, or the FIFO is no longer at its path (`Err` where
    /// nothing is there).
    fn each_of_file(&self, file: File, take: &mut dyn FnMut(Vec<u8>) -> bool) -> io::Result<()> {
        let mut lines = BufReader::new(file);
        while each_of(&mut lines, take)? && self.is_fifo {
            // Without a writer a FIFO is read as ended, at once; the same handle reads what the next writer writes.
            std::thread::sleep(POLL);
            if !is_same(&fs::metadata(&self.path)?, &lines.get_ref().metadata()?) {
                lines = BufReader::new(File::open(&self.path)?);
            }
        }
        Ok(())
    }
}

/// Gives each line to `take`; whether it wants more.
fn each_of(lines: &mut impl BufRead, take: &mut dyn FnMut(Vec<u8>) -> bool) -> io::Result<bool> {
    loop {
        let mut line = Vec::new();
        match lines.by_ref().take(MAX_BYTES).read_until(b'\n', &mut line) {
            Ok(0) => return Ok(true),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        }
        if !line.trim_ascii().is_empty() && !take(line.trim_ascii().to_vec()) {
            return Ok(false);
        }
    }
}

#[cfg(unix)]
fn is_fifo(metadata: &fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_fifo()
}

#[cfg(not(unix))]
fn is_fifo(_: &fs::Metadata) -> bool {
    false
}

/// Whether both are of one file.
#[cfg(unix)]
fn is_same(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(not(unix))]
fn is_same(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_and_nothing_are_refused_at_once() {
        let scratch = tempfile::tempdir().unwrap();
        let said = Lines::of(scratch.path()).unwrap_err().to_string();
        assert!(said.ends_with("expected a file, a FIFO or a terminal, got a folder"), "{said}");
        let said = Lines::of(&scratch.path().join("none")).unwrap_err().to_string();
        assert!(said.contains("none") && !said.contains('\n'), "{said}");
    }

    #[test]
    fn a_file_has_an_end_and_bytes_that_are_no_text_do_not_end_it() {
        let scratch = tempfile::tempdir().unwrap();
        let file = scratch.path().join("commands");
        let long = [b'x'; 5000];
        fs::write(&file, [&b"rest\r\n\n\xff\xfe\n"[..], &long, b"\nquit"].concat()).unwrap();
        let mut found = Vec::new();
        Lines::of(&file).unwrap().each(|line| {
            found.push(line.unwrap());
            true
        });
        assert_eq!(found, [&b"rest"[..], b"\xff\xfe", &long[..4096], &long[4096..], b"quit"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_fifo_outlives_its_writers_and_is_found_again_when_it_was_gone() {
        let scratch = tempfile::tempdir().unwrap();
        let path = scratch.path().join("fifo");
        let make = || assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        make();
        let lines = Lines::of(&path).unwrap();
        let (sender, receiver) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || {
            lines.each(|line| {
                let is_last = line == Ok(b"quit".to_vec());
                sender.send(line).unwrap();
                !is_last
            });
        });
        let next = || receiver.recv_timeout(Duration::from_secs(30)).unwrap();
        // Opened, written and closed each time: a writer of its own, also where the one before has ended just now.
        for i in 0..500 {
            fs::write(&path, format!("touch {i}\n")).unwrap();
        }
        for i in 0..500 {
            assert_eq!(next(), Ok(format!("touch {i}").into_bytes()));
        }
        fs::rename(&path, scratch.path().join("aside")).unwrap();
        let gone = next().unwrap_err();
        assert!(gone.contains("fifo: "), "{gone}");
        make();
        fs::write(&path, "quit\n").unwrap();
        assert_eq!(next(), Ok(b"quit".to_vec()));
        reader.join().unwrap();
    }
}

//! Locks on outputs, so that one run at a time writes each: datasets, banks, models, evaluations and all else with a
//! name that two runs may be given.
//!
//! The system holds a lock and lets it go when a process ends, however it ends: a file that a killed run has left locks
//! nothing. On a file system without locks nothing is checked.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// An output that no other run writes until this is dropped.
///
/// Its lock is a file of its own next to the output, `OUT.lock`, which goes when this is dropped.
#[derive(Debug)]
#[must_use = "an output is locked only for as long as its lock is kept"]
pub struct OutputLock {
    path: PathBuf,
    /// Holds the lock until it is closed.
    file: File,
}

impl OutputLock {
    /// Locks an output, which need not exist, in a folder that does.
    ///
    /// # Errors
    /// An output that another run is writing, and a folder where nothing can be written.
    pub fn take(out: &Path) -> Result<Self> {
        let path = with_ending(out, ".lock");
        let file = lock_file(&path, out)?;
        Ok(Self { path, file })
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        // A file with content is somebody's own, such as a Cargo.lock.
        if self.file.metadata().is_ok_and(|about| about.len() == 0) {
            // Before the lock itself: another run that opened the file meanwhile finds that it has no name any more. One
            // that stays does no harm.
            drop(fs::remove_file(&self.path));
        }
    }
}

/// Opens the file `path` for writing, its content kept, and holds its lock until it is closed. `out` is named where
/// another run has it.
///
/// # Errors
/// A file that another run is writing, or that cannot be written.
pub fn lock_file(path: &Path, out: &Path) -> Result<File> {
    loop {
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(Error::io(path))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => {
                let expected = "an output that no other run is writing";
                return Err(Error::invalid(out.display().to_string(), expected, "another run at work"));
            }
            Err(TryLockError::Error(error)) if error.kind() != ErrorKind::Unsupported => {
                return Err(Error::Io { path: path.to_path_buf(), source: error });
            }
            // Otherwise the run that held the lock has removed or renamed the file in this moment.
            _ if is_at(&file, path) => return Ok(file),
            _ => {}
        }
    }
}

/// Whether an open file is the one that has this name.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |about: &fs::Metadata| (about.dev(), about.ino());
    matches!((file.metadata(), fs::metadata(path)), (Ok(file), Ok(named)) if place(&file) == place(&named))
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

/// A path with a few more letters.
pub fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(ending);
    path.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

    #[test]
    fn an_output_has_one_writer_at_a_time_and_keeps_no_lock_file() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("pegs.bank");
        let first = OutputLock::take(&out).unwrap();
        let error = OutputLock::take(&out).unwrap_err().to_string();
        assert_eq!(
            error,
            format!("{}: expected an output that no other run is writing, got another run at work", out.display())
        );
        // Another output of the folder is another's.
        drop(OutputLock::take(&folder.path().join("other.bank")).unwrap());
        drop(first);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        // A killed run leaves its lock file, unlocked.
        fs::write(folder.path().join("pegs.bank.lock"), "").unwrap();
        drop(OutputLock::take(&out).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        // A file of that name with content is not one that a lock has made.
        fs::write(folder.path().join("Cargo.lock"), "version = 4").unwrap();
        drop(OutputLock::take(&folder.path().join("Cargo")).unwrap());
        assert_eq!(fs::read(folder.path().join("Cargo.lock")).unwrap(), b"version = 4");
        assert!(OutputLock::take(&folder.path().join("nowhere/out")).unwrap_err().to_string().contains("nowhere"));
    }

    /// A lock file is removed while others open it: never do two hold the lock.
    #[test]
    fn of_many_that_take_and_leave_a_lock_one_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let (is_held, n_taken) = (AtomicBool::new(false), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        let Ok(lock) = OutputLock::take(&out) else { continue };
                        assert!(!is_held.swap(true, Ordering::SeqCst), "two have the lock");
                        n_taken.fetch_add(1, Ordering::SeqCst);
                        is_held.store(false, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert!(n_taken.into_inner() >= 1 && !folder.path().join("out.lock").exists());
    }
}

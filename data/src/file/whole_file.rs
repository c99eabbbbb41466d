//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::file::output_lock::{lock_file, with_ending};

/// Writes a file under a name for the meantime, `OUT.partial`, and renames it: a crash or a full disk leaves the old file
/// as it was. Makes the folder that it is in.
///
/// # Errors
/// A place where nothing can be written, or a file that another run is writing at this moment.
pub fn write(path: &Path, content: &[u8]) -> Result<()> {
    write_in_pieces(path, &|file| file.write_all(content))
}

/// [`write()`] of what `write` writes.
///
/// # Errors
/// As [`write()`], and what `write` returns.
pub fn write_in_pieces(path: &Path, write: &dyn Fn(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let partial = with_ending(path, ".partial");
    let mut file = BufWriter::new(lock_file(&partial, path)?);
    let emptied = file.get_ref().set_len(0);
    let written = emptied.and_then(|()| write(&mut file)).and_then(|()| file.flush());
    if let Err(error) = written.and_then(|()| file.get_ref().sync_all()) {
        // The half-written file is of no use; the error that matters is the first one.
        drop(fs::remove_file(&partial));
        return Err(Error::io(path)(error));
    }
    // The file stays locked until it has its name.
    fs::rename(&partial, path).map_err(Error::io(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_written_whole_over_an_old_one_or_a_crashed_run_s() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/out");
        write(&path, b"first").unwrap();
        fs::write(folder.path().join("new/out.partial"), "longer than all of it").unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        let failed = write_in_pieces(&path, &|file| {
            file.write_all(b"half")?;
            Err(io::Error::other("the disk is full"))
        });
        assert!(failed.unwrap_err().to_string().ends_with("out: the disk is full"));
        assert_eq!(
            (fs::read(&path).unwrap(), fs::read_dir(path.parent().unwrap()).unwrap().count()),
            (b"second".to_vec(), 1)
        );
    }

    #[test]
    fn a_file_that_is_being_written_is_refused_to_a_second_writer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        let second = std::cell::RefCell::new(String::new());
        write_in_pieces(&path, &|file| {
            file.write_all(b"the first's")?;
            *second.borrow_mut() = write(&path, b"the second's").unwrap_err().to_string();
            Ok(())
        })
        .unwrap();
        let second = second.into_inner();
        assert!(second.contains("out: expected an output that no other run is writing"), "{second}");
        assert_eq!(fs::read(&path).unwrap(), b"the first's");
    }
}

//! An output that is whole or not there.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::file::output_lock::{OutputLock, with_ending};

/// A file or folder under a name for the meantime, removed where it is dropped unfinished. No other run writes the same
/// output meanwhile.
#[derive(Debug)]
pub struct Partial {
    out: PathBuf,
    path: PathBuf,
    is_finished: bool,
    /// Dropped last.
    _lock: OutputLock,
}

impl Partial {
    /// Begins a folder; `out` must not exist. What a killed run left of one is removed first: a folder that holds nothing
    /// but files which `is_ours` knows by their names.
    pub fn folder(out: &Path, is_ours: fn(&str) -> bool) -> Result<Self> {
        let mut partial = Self::begin(out)?;
        if partial.path.is_dir() {
            partial.check_is_ours(is_ours)?;
            fs::remove_dir_all(&partial.path).map_err(Error::io(&partial.path))?;
        }
        fs::create_dir(&partial.path).map_err(Error::io(&partial.path))?;
        partial.is_finished = false;
        Ok(partial)
    }

    /// Begins a file, over one that a killed run left; `out` must not exist.
    #[cfg_attr(not(feature = "mcap"), allow(dead_code, reason = "only a bag is one file"))]
    pub fn file(out: &Path) -> Result<(Self, File)> {
        let mut partial = Self::begin(out)?;
        let file = File::create(&partial.path).map_err(Error::io(&partial.path))?;
        partial.is_finished = false;
        Ok((partial, file))
    }

    /// Locks the output. Nothing is made yet that would have to be removed.
    fn begin(out: &Path) -> Result<Self> {
        let Some(name) = out.file_name() else {
            return Err(Error::invalid(out.display().to_string(), "a new name", "none"));
        };
        if let Some(above) = out.parent() {
            fs::create_dir_all(above).map_err(Error::io(above))?;
        }
        let path = out.with_file_name(with_ending(Path::new(name), ".partial"));
        let lock = OutputLock::take(&out.with_file_name(name))?;
        if fs::symlink_metadata(out).is_ok() {
            return Err(Error::invalid(out.display().to_string(), "a name not in use", "an existing file or folder"));
        }
        Ok(Self { out: out.to_path_buf(), path, is_finished: true, _lock: lock })
    }

    fn check_is_ours(&self, is_ours: fn(&str) -> bool) -> Result<()> {
        for entry in fs::read_dir(&self.path).map_err(Error::io(&self.path))? {
            let name = entry.map_err(Error::io(&self.path))?.file_name();
            if !name.to_str().is_some_and(is_ours) {
                let expected = "nothing but the files of an unfinished export";
                return Err(Error::invalid(self.path.display().to_string(), expected, name.to_string_lossy()));
            }
        }
        Ok(())
    }

    /// Where to write.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the output its name.
    pub fn finish(mut self) -> Result<()> {
        fs::rename(&self.path, &self.out).map_err(Error::io(&self.out))?;
        self.is_finished = true;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.is_finished {
            return;
        }
        // What cannot be removed keeps a name that nothing takes for a whole export.
        drop(if self.path.is_dir() { fs::remove_dir_all(&self.path) } else { fs::remove_file(&self.path) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn is_ours(name: &str) -> bool {
        name == "a"
    }

    #[test]
    fn an_output_is_there_only_when_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (partial, mut file) = Partial::file(&at("new/out.mcap")).unwrap();
        file.write_all(b"half").unwrap();
        assert!(Partial::file(&at("new/out.mcap")).unwrap_err().to_string().contains("another run at work"));
        drop(partial);
        assert_eq!(fs::read_dir(at("new")).unwrap().count(), 0);
        let partial = Partial::folder(&at("out"), is_ours).unwrap();
        fs::write(partial.path().join("a"), "a").unwrap();
        assert!(Partial::folder(&at("out"), is_ours).unwrap_err().to_string().contains("another run at work"));
        assert!(!at("out").exists() && at("out.partial/a").exists());
        partial.finish().unwrap();
        assert!(at("out/a").exists() && Partial::folder(&at("out"), is_ours).is_err() && !at("out.partial").exists());
        assert!(!at("out.lock").exists());
    }

    #[test]
    fn what_a_killed_run_left_is_cleared_and_what_others_keep_there_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("out.mcap.partial"), "longer than what comes").unwrap();
        let (partial, mut file) = Partial::file(&at("out.mcap")).unwrap();
        file.write_all(b"new").unwrap();
        partial.finish().unwrap();
        assert_eq!(fs::read(at("out.mcap")).unwrap(), b"new");
        fs::create_dir(at("out.partial")).unwrap();
        fs::write(at("out.partial/a"), "old").unwrap();
        let partial = Partial::folder(&at("out"), is_ours).unwrap();
        assert!(!partial.path().join("a").exists());
        fs::write(partial.path().join("mine"), "kept").unwrap();
        // As if killed: neither finished nor removed.
        fs::rename(at("out.partial"), at("kept")).unwrap();
        drop(partial);
        fs::rename(at("kept"), at("out.partial")).unwrap();
        let error = Partial::folder(&at("out"), is_ours).unwrap_err().to_string();
        assert!(
            error.contains("out.partial: expected nothing but the files of an unfinished export, got mine"),
            "{error}"
        );
        assert_eq!(fs::read(at("out.partial/mine")).unwrap(), b"kept");
    }
}

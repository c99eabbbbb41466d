//! An output that is whole or not there.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// A file or folder under a name for the meantime, removed where it is dropped unfinished.
#[derive(Debug)]
pub struct Partial {
    out: PathBuf,
    path: PathBuf,
    is_finished: bool,
}

impl Partial {
    /// Begins a folder; `out` must not exist.
    pub fn folder(out: &Path) -> Result<Self> {
        Self::begin(out, |path| fs::create_dir(path))
    }

    /// Begins a file; `out` must not exist.
    #[cfg_attr(not(feature = "mcap"), allow(dead_code, reason = "only a bag is one file"))]
    pub fn file(out: &Path) -> Result<(Self, File)> {
        let mut file = None;
        let partial = Self::begin(out, |path| File::create_new(path).map(|created| file = Some(created)))?;
        let file = file.ok_or_else(|| Error::invalid(out.display().to_string(), "a new file", "none"))?;
        Ok((partial, file))
    }

    fn begin(out: &Path, create: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<Self> {
        if fs::symlink_metadata(out).is_ok() {
            return Err(Error::invalid(out.display().to_string(), "a name not in use", "an existing file or folder"));
        }
        let Some(name) = out.file_name() else {
            return Err(Error::invalid(out.display().to_string(), "a new name", "none"));
        };
        if let Some(above) = out.parent() {
            fs::create_dir_all(above).map_err(Error::io(above))?;
        }
        let mut name = name.to_owned();
        name.push(".partial");
        let path = out.with_file_name(name);
        create(&path).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                let got = "one of a run at work or of one that crashed: remove it in that case";
                Error::invalid(path.display().to_string(), "no unfinished export", got)
            }
            _ => Error::io(&path)(error),
        })?;
        Ok(Self { out: out.to_path_buf(), path, is_finished: false })
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

    #[test]
    fn an_output_is_there_only_when_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (partial, mut file) = Partial::file(&at("new/out.mcap")).unwrap();
        file.write_all(b"half").unwrap();
        assert!(Partial::file(&at("new/out.mcap")).unwrap_err().to_string().contains("no unfinished export"));
        drop(partial);
        assert_eq!(fs::read_dir(at("new")).unwrap().count(), 0);
        let partial = Partial::folder(&at("out")).unwrap();
        fs::write(partial.path().join("a"), "a").unwrap();
        assert!(!at("out").exists());
        partial.finish().unwrap();
        assert!(at("out/a").exists() && Partial::folder(&at("out")).is_err() && !at("out.partial").exists());
    }
}

//! The folder of a run: writable, of one run at a time, and never the folder of an input.

use std::fs;
use std::path::{Path, PathBuf};

use tactile_data::file::output_lock::OutputLock;

use crate::error::{Error, Result};

/// A folder that this process may write to and that no other run uses until it is dropped.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// The model's lock; there until this is dropped.
    lock: Option<OutputLock>,
    /// Folders that were made for this one, the deepest first.
    made: Vec<PathBuf>,
}

impl OutputFolder {
    /// Creates the folder if it is missing, and locks it.
    ///
    /// # Errors
    /// A folder that cannot be written to or that another run uses, or one where the run would overwrite a file or
    /// dataset of `inputs`.
    pub fn claim(path: &Path, inputs: &[&Path]) -> Result<Self> {
        for input in inputs {
            if is_same(input, path) || FILES.iter().any(|file| is_same(input, &path.join(file))) {
                let got = format!("{}, which is an input", input.display());
                return Err(Error::invalid("--out", "a folder of its own", got));
            }
        }
        let made: Vec<PathBuf> =
            path.ancestors().take_while(|at| !at.as_os_str().is_empty() && !at.exists()).map(PathBuf::from).collect();
        fs::create_dir_all(path).map_err(Error::io(path))?;
        // A model is written by a calibration of it as well.
        let lock = OutputLock::take(&path.join(MODEL))?;
        Ok(Self { path: path.to_path_buf(), lock: Some(lock), made })
    }

    /// The maps that a run is to write.
    ///
    /// # Errors
    /// Maps that are there already.
    pub fn new_maps(&self) -> Result<PathBuf> {
        let file = self.file(MAPS);
        if file.exists() {
            return Err(Error::invalid(file.display().to_string(), "an empty --out", "the maps of an earlier run"));
        }
        Ok(file)
    }

    /// A file of the run.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }
}

/// What a run writes.
pub(crate) const FILES: [&str; 6] = [MODEL, STATE, SETTINGS, CURVE, PAGE, MAPS];
pub(crate) const MODEL: &str = "model.safetensors";
pub(crate) const STATE: &str = "state.safetensors";
pub(crate) const SETTINGS: &str = "train.toml";
pub(crate) const CURVE: &str = "curve.csv";
pub(crate) const PAGE: &str = "curve.html";
/// The network that draws maps, of a run of its own.
pub(crate) const MAPS: &str = "maps.safetensors";

impl Drop for OutputFolder {
    fn drop(&mut self) {
        drop(self.lock.take());
        // A folder that the run has written to is not empty and stays.
        self.made.iter().take_while(|folder| fs::remove_dir(folder).is_ok()).for_each(drop);
    }
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_of_one_run_and_leaves_nothing_without_files() {
        let scratch = tempfile::tempdir().unwrap();
        let path = scratch.path().join("a/b");
        let claimed = OutputFolder::claim(&path, &[]).unwrap();
        let error = OutputFolder::claim(&path, &[]).unwrap_err().to_string();
        let expected =
            "a/b/model.safetensors: expected an output that no other run is writing, got another run at work";
        assert!(error.ends_with(expected), "{error}");
        drop(claimed);
        assert_eq!(fs::read_dir(scratch.path()).unwrap().count(), 0);
        // A killed process leaves its lock file, unlocked.
        fs::create_dir_all(&path).unwrap();
        fs::write(path.join("model.safetensors.lock"), "").unwrap();
        fs::write(path.join("kept"), "").unwrap();
        drop(OutputFolder::claim(&path, &[]).unwrap());
        assert_eq!(fs::read_dir(&path).unwrap().count(), 1);
    }

    #[test]
    fn inputs_are_never_overwritten_and_what_cannot_be_written_is_named() {
        let scratch = tempfile::tempdir().unwrap();
        let data = scratch.path().join("data");
        fs::create_dir(&data).unwrap();
        fs::write(data.join("train.toml"), "").unwrap();
        for input in [data.join("../data"), data.join("train.toml")] {
            let error = OutputFolder::claim(&data, &[&input]).unwrap_err().to_string();
            assert!(error.starts_with("--out: expected a folder of its own"), "{error}");
        }
        let below_a_file = data.join("train.toml/model");
        let error = OutputFolder::claim(&below_a_file, &[]).unwrap_err().to_string();
        assert!(error.starts_with(&below_a_file.display().to_string()), "{error}");
    }
}

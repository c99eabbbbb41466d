//! A tiny chain from boards to a bank: enough to run every program, far too little to learn.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use serde_json::Value;
use tempfile::TempDir;

use crate::programs::run;

/// Width and height of every frame, as `--frame-px` takes it: twice the network's input, the least that
/// training takes.
pub const FRAME_PX: &str = "80x60";

/// Two letters on 3 x 3 x 3 poses.
pub const SCENE: &str = r#"
name = "two-letters"

[parts.letters]
letters = "TX"
height_mm = 12.0
max_width_mm = 16.0

[reach]
xy_half_mm = 4.0
xy_step_mm = 4.0
theta_half_deg = 30.0
theta_step_deg = 30.0

[sensor]
frame_px = [80, 60]
"#;

/// A folder with everything that the programs make of each other: the datasets `maze`, `pegs` and
/// `holes`, the scene `two.toml`, the training run `model` and the bank `pegs.bank`.
#[derive(Debug)]
pub struct Sample {
    folder: TempDir,
    /// Checksum of the model, as `tactile-train --json` tells it.
    pub model_sha256: String,
}

impl Sample {
    /// Makes a sample by running the programs; the same one each time.
    ///
    /// # Panics
    /// Where a program fails.
    pub fn make() -> Self {
        let folder = tempfile::tempdir().expect("a folder for the sample");
        let at = folder.path();
        fs::write(at.join("two.toml"), SCENE).expect("room for the scene");
        let generate = |args: &[&str]| {
            run("tactile-data", at, &[&["generate"], args].concat()).done();
        };
        generate(&["--scene", "maze", "--out", "maze", "--pairs", "24", "--boards", "3", "--frame-px", FRAME_PX]);
        generate(&["--scene", "two.toml", "--sides", "peg", "--out", "pegs"]);
        generate(&["--scene", "two.toml", "--sides", "hole", "--out", "holes", "--seed", "2"]);
        let trained = run("tactile-train", at, &TRAIN);
        let outcome: Value = serde_json::from_str(trained.done()).expect("--json prints JSON");
        let model_sha256 = outcome["sha256"].as_str().expect("a checksum").to_owned();
        run(
            "tactile-infer",
            at,
            &["bank", "--model", "model/model.safetensors", "--data", "pegs", "--out", "pegs.bank"],
        )
        .done();
        Self { folder, model_sha256 }
    }

    /// A sample to read only, shared by the tests that run at the same time and removed after the last.
    ///
    /// # Panics
    /// Where a program fails.
    pub fn shared() -> Arc<Self> {
        static SHARED: Mutex<Weak<Sample>> = Mutex::new(Weak::new());
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        shared.upgrade().unwrap_or_else(|| {
            let made = Arc::new(Self::make());
            *shared = Arc::downgrade(&made);
            made
        })
    }

    /// The sample's folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// A file or folder of the sample, as an argument.
    ///
    /// # Panics
    /// Where the folder for temporary files has a name that is not Unicode.
    pub fn at(&self, name: &str) -> String {
        text(self.folder().join(name))
    }

    /// Copies one of the sample's datasets into a folder, to be spoilt there; returns the copy.
    ///
    /// # Panics
    /// Where a file cannot be copied.
    pub fn copy(&self, dataset: &str, into: &Path) -> PathBuf {
        let copy = into.join(dataset);
        fs::create_dir(&copy).expect("a new folder");
        for entry in fs::read_dir(self.folder().join(dataset)).expect("a dataset of the sample") {
            let entry = entry.expect("a readable folder");
            fs::copy(entry.path(), copy.join(entry.file_name())).expect("room for a copy");
        }
        copy
    }
}

/// The sample's training run: two checkpoints in four steps.
const TRAIN: [&str; 11] =
    ["--data", "maze", "--out", "model", "--steps", "4", "--batch", "8", "--set", "save_every=2", "--json"];

/// A path as an argument.
///
/// # Panics
/// Where it is not Unicode.
pub fn text(path: PathBuf) -> String {
    path.into_os_string().into_string().expect("a path in Unicode")
}

//! LeRobot datasets, version 3 (<https://github.com/huggingface/lerobot>, `src/lerobot/datasets`): what their files are called and
//! what `meta/info.json` says. [`crate::dataset::export::lerobot`] writes them, [`crate::recording::lerobot`] reads them.

pub mod columns;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::light::lamps::Lamps;

/// What [`Info::codebase_version`] says of this layout.
pub const VERSION: &str = "v3.0";

/// Where [`Info`] is, from the dataset's folder.
pub const INFO: &str = "meta/info.json";

/// Statistics of each feature.
pub const STATS: &str = "meta/stats.json";

/// Tasks and their numbers.
pub const TASKS: &str = "meta/tasks.parquet";

/// Episodes, and which file their frames are in.
pub const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";

/// The frame at rest; LeRobot itself has no place for one.
pub const NO_CONTACT: &str = "meta/no_contact.png";

/// The feature whose pictures an export writes.
pub const PICTURES: &str = "observation.images.tactile";

/// The feature of the robot's state.
pub const STATE: &str = "observation.state";

/// Files of frames in a folder.
pub const CHUNK: usize = 1000;

/// A dataset's meta data take less.
const ABOUT: Kind = Kind { name: "a LeRobot dataset's meta data", most_bytes: 64 << 20 };

/// `meta/info.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// [`VERSION`].
    pub codebase_version: String,
    /// What moved the sensor.
    #[serde(default)]
    pub robot_type: Option<String>,
    /// Episodes in all.
    pub total_episodes: usize,
    /// Frames in all.
    pub total_frames: usize,
    /// Distinct tasks.
    pub total_tasks: usize,
    /// Files in a folder.
    pub chunks_size: usize,
    /// About as large a file of frames is, megabytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_files_size_in_mb: Option<f64>,
    /// The same of videos.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub video_files_size_in_mb: Option<f64>,
    /// Frames a second.
    pub fps: f64,
    /// Which episodes are for what.
    #[serde(default)]
    pub splits: BTreeMap<String, String>,
    /// Names of the files of frames.
    pub data_path: String,
    /// Names of the videos, where there are any.
    #[serde(default)]
    pub video_path: Option<String>,
    /// What each frame has.
    pub features: BTreeMap<String, Feature>,
}

/// What a frame has under one name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Feature {
    /// `image`, `video`, `string`, or a type of NumPy.
    pub dtype: String,
    /// Sides of it; a picture's are height, width and channels, in the order that `names` tells.
    #[serde(default)]
    pub shape: Vec<usize>,
    /// Names of its values.
    #[serde(default)]
    pub names: Value,
    /// More about it; of our own pictures a [`Sensor`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub info: Option<Value>,
}

/// What is known of the sensor that took the pictures of a feature: [`Feature::info`] of an export.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Width and height of what a picture shows of the gel, mm.
    pub field_of_view_mm: [f64; 2],
    /// The frame at rest, from the dataset's folder.
    pub no_contact: String,
    /// Lamps and gel where they are known and differ from a default Mini's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Lamps>,
}

impl Info {
    /// Reads `meta/info.json` of the dataset in a folder.
    ///
    /// # Errors
    /// None, no JSON, or another version, with the command that converts it.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(INFO);
        let text = bounded_file::read_to_string(&path, ABOUT)?;
        let bad = |e: serde_json::Error| {
            Error::invalid(path.display().to_string(), "a LeRobot dataset's meta data", e.to_string())
        };
        let json: Value = serde_json::from_str(&text).map_err(bad)?;
        let version = json.get("codebase_version").and_then(Value::as_str).unwrap_or("none");
        if version != VERSION {
            let got = format!(
                "{version}; version 2.1 is converted by python -m lerobot.datasets.v30.convert_dataset_v21_to_v30 \
                 --repo-id=NAME --root=FOLDER"
            );
            return Err(Error::invalid(format!("{}: codebase_version", path.display()), VERSION, got));
        }
        serde_json::from_value(json).map_err(bad)
    }

    /// What is known of the sensor whose pictures a feature has; `None` where the feature says nothing of the kind.
    pub fn sensor(&self, feature: &str) -> Option<Sensor> {
        serde_json::from_value(self.features.get(feature)?.info.clone()?).ok()
    }
}

/// The file number `n` of frames, from the dataset's folder.
pub(crate) fn data_file(n: usize) -> PathBuf {
    PathBuf::from(format!("data/chunk-{:03}/file-{:03}.parquet", n / CHUNK, n % CHUNK))
}

//! What a dataset says of itself: `meta.json`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::files::{META, SCHEMA, json_error};
use super::provenance::Recording;
use crate::dataset::shard::Fragment;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::file::whole_file;
use crate::light::lamps::Lamps;
use crate::pose::grid::PoseGrid;
use crate::pose::se2::Se2;
use crate::text::printable::is_printable;

/// What holds for a whole dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Name of the dataset, for people.
    pub name: String,
    /// Width and height of its frames, pixels.
    pub frame_px: [usize; 2],
    /// Size of a pixel along x and along y on the gel, mm.
    pub mm_per_px: [f64; 2],
    /// The grid on which each part was touched, where there is one.
    pub reach: Option<PoseGrid>,
    /// Names of the parts that training must not see.
    pub held_out: Vec<String>,
    /// The scene that was simulated.
    pub scene: Option<serde_json::Value>,
    /// The seed it was simulated with.
    pub seed: Option<u64>,
    /// Where the frames come from, for people.
    pub source: String,
    /// How a recording became this dataset; `None` for simulated touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<Recording>,
    /// The sensor's lamps where they are known and differ from the lamps that the network knows
    /// ([`Lamps::default`]); the frames show them as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Lamps>,
    /// The pose of the hole board in the peg board's frame, as it was estimated or given.
    /// [`Dataset::open`](super::Dataset::open) gives the poses
    /// of pegs in the hole board's frame, so that a hole and its peg touched at one place have one pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peg_from_hole: Option<Se2>,
}

impl Meta {
    /// What holds for any dataset; all else is not known.
    pub fn new(name: impl Into<String>, source: impl Into<String>, frame_px: [usize; 2], mm_per_px: [f64; 2]) -> Self {
        Self {
            name: name.into(),
            frame_px,
            mm_per_px,
            reach: None,
            held_out: Vec::new(),
            scene: None,
            seed: None,
            source: source.into(),
            recording: None,
            lamps: None,
            peg_from_hole: None,
        }
    }

    /// Width and height of what a frame shows, mm.
    pub fn field_of_view_mm(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.mm_per_px[axis] * self.frame_px[axis] as f64)
    }
}

/// `meta.json` as it is on disk.
#[derive(Serialize, Deserialize)]
pub(crate) struct MetaFile {
    pub(super) schema: String,
    pub(crate) n_frames: usize,
    pub(super) frames_sha256: String,
    pub(super) index_sha256: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) fragment: Option<Fragment>,
    #[serde(flatten)]
    pub(crate) meta: Meta,
}

/// Notes the pose of the hole board in the peg board's frame with a dataset, whole or not at all; frames and index stay as
/// they are.
///
/// # Errors
/// No dataset, or a folder that cannot be written to.
pub fn set_peg_from_hole(dataset: &Path, peg_from_hole: Se2) -> Result<()> {
    let mut content = read_meta(dataset)?;
    content.meta.peg_from_hole = Some(peg_from_hole);
    let path = dataset.join(META);
    let json = serde_json::to_vec_pretty(&content).map_err(json_error(&path, "meta data"))?;
    whole_file::write(&path, &json)
}

/// The scene of 10,000 parts and the names of 100,000 boards take 20 MB.
const ABOUT: Kind = Kind { name: "a dataset's meta data", most_bytes: 64 << 20 };

/// What a dataset says of itself, without a look at its frames.
pub(crate) fn read_meta(dataset: &Path) -> Result<MetaFile> {
    let path = &dataset.join(META);
    let text = bounded_file::read_to_string(path, ABOUT)?;
    let json: serde_json::Value = serde_json::from_str(&text).map_err(json_error(path, "JSON"))?;
    // The schema comes first: another version may well have other fields.
    let schema = json.get("schema").and_then(|s| s.as_str()).unwrap_or("none");
    if schema != SCHEMA {
        return Err(Error::invalid(format!("{}: schema", path.display()), SCHEMA, schema));
    }
    let content: MetaFile = serde_json::from_value(json).map_err(json_error(path, "a dataset's meta data"))?;
    check_meta(&content.meta, path)?;
    Ok(content)
}

/// Refuses meta data that make no sense; `path` names the dataset in errors.
pub(crate) fn check_meta(meta: &Meta, path: &Path) -> Result<()> {
    if !meta.mm_per_px.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
        let got = format!("{:?}", meta.mm_per_px);
        return Err(Error::invalid(format!("{}: mm_per_px", path.display()), "positive sizes", got));
    }
    if let Some(name) = meta.held_out.iter().chain([&meta.name]).find(|name| !is_printable(name)) {
        let expected = "names without control characters";
        return Err(Error::invalid(format!("{}: name, held_out", path.display()), expected, format!("{name:?}")));
    }
    // Bounds the arithmetic on sizes; no camera comes near.
    if !meta.frame_px.iter().all(|px| (1..=1 << 14).contains(px)) {
        let got = format!("{:?}", meta.frame_px);
        return Err(Error::invalid(format!("{}: frame_px", path.display()), "1 to 16384 pixels each way", got));
    }
    meta.reach.as_ref().map_or(Ok(()), PoseGrid::validate)
}

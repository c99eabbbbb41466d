//! A LeRobot dataset of version 3 whose touches are pictures (dtype image), read with the feature `lerobot`.

#[cfg(feature = "lerobot")]
pub mod format;
#[cfg(feature = "lerobot")]
mod import;
#[cfg(feature = "lerobot")]
mod state;
#[cfg(feature = "lerobot")]
#[cfg(test)]
mod tests;

use std::path::Path;

#[cfg(feature = "lerobot")]
pub use import::import;

use crate::dataset::touch::Side;
use crate::pose::se2::Se2;
use crate::recording::folder::Import;

#[cfg(not(feature = "lerobot"))]
use crate::error::{Error, Result};
#[cfg(not(feature = "lerobot"))]
use crate::recording::folder::Imported;

/// Whether a source is the folder of a LeRobot dataset, of any version, readable here or not.
pub fn is_lerobot(source: &Path) -> bool {
    source.join("meta/info.json").is_file()
}

/// What an import of a LeRobot dataset asks for.
#[derive(Clone, Debug, Default)]
pub struct LeRobot {
    /// The feature that holds the pictures of touches; `None`: the only one, or the only one that sounds like touch.
    pub pictures: Option<String>,
    /// The names in `observation.state` of x, y and the angle of the sensor's pose, each with its unit: `x:m,y:m,yaw:rad`. A name
    /// that ends with its unit (`x_mm`, `theta_deg`) needs no other. `None`: those of an export.
    pub state: Option<String>,
    /// The part that was touched, where the frames do not say.
    pub part: Option<String>,
    /// Its side.
    pub side: Option<Side>,
    /// Pose of the sensor in the frame that the poses are of.
    pub tool_from_sensor: Option<Se2>,
    /// Pose of the part in the frame that the poses are in.
    pub board: Option<Se2>,
    /// Frames.
    pub frames: Import,
}

/// Imports the dataset in a folder to a dataset at `out`.
///
/// # Errors
/// A build that does not read these.
#[cfg(not(feature = "lerobot"))]
pub fn import(source: &Path, _: &LeRobot, _: &Path, _: &dyn Fn(usize, usize)) -> Result<Imported> {
    let got = "a LeRobot dataset, which a build with --features lerobot reads";
    Err(Error::invalid(source.display().to_string(), "pictures or a bag", got))
}

//! How a recording became a dataset: what its meta data keep of the source.

use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::file::bounded_file;

/// How a recording became a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// SHA-256 of what was read: the index and every picture, in order, or the files of a bag or of tables.
    pub source_sha256: String,
    /// Size of the source's pictures, pixels.
    pub source_px: [usize; 2],
    /// What was kept of each picture, after turning and mirroring: left, top, width and height, pixels.
    pub crop_px: [usize; 4],
    /// Quarter turns counter-clockwise made first, 0..=3.
    pub quarter_turns: u8,
    /// The axis that was turned round after turning and before cropping.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mirror: Option<Mirror>,
    /// The order of the source's colours.
    #[serde(default, skip_serializing_if = "Channels::is_rgb")]
    pub channels: Channels,
}

/// SHA-256 of files, one behind the other, in hexadecimal.
///
/// # Errors
/// A file that cannot be read.
pub fn sha256(files: &[PathBuf]) -> Result<String> {
    let mut hash = Sha256::new();
    for path in files {
        let (mut file, _) = bounded_file::open(path)?;
        std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    }
    Ok(format!("{:x}", hash.finalize()))
}

/// The axis of a picture that is turned round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mirror {
    /// Left and right change places.
    X,
    /// Top and bottom change places.
    Y,
}

impl FromStr for Mirror {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "x" => Ok(Self::X),
            "y" => Ok(Self::Y),
            _ => Err(Error::invalid("mirror", "x (left and right) or y (top and bottom)", text)),
        }
    }
}

/// The order in which a source holds the colours of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channels {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Blue, green, red: files that were written by OpenCV from pictures in the other order.
    Bgr,
}

impl Channels {
    fn is_rgb(&self) -> bool {
        *self == Self::Rgb
    }
}

impl FromStr for Channels {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            _ => Err(Error::invalid("channels", "rgb or bgr", text)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_before_mirrors_and_channels_is_read() {
        let old = r#"{"source_sha256": "ab", "source_px": [4, 2], "crop_px": [0, 0, 4, 2], "quarter_turns": 1}"#;
        let recording: Recording = serde_json::from_str(old).unwrap();
        assert_eq!((recording.mirror, recording.channels), (None, Channels::Rgb));
        let turned = Recording { mirror: Some(Mirror::X), channels: Channels::Bgr, ..recording };
        let json = serde_json::to_string(&turned).unwrap();
        assert!(json.contains(r#""mirror":"x","channels":"bgr""#), "{json}");
        assert_eq!(serde_json::from_str::<Recording>(&json).unwrap(), turned);
    }

    #[test]
    fn other_names_are_refused() {
        assert_eq!(("y".parse().ok(), "bgr".parse().ok()), (Some(Mirror::Y), Some(Channels::Bgr)));
        assert!("z".parse::<Mirror>().unwrap_err().to_string().contains("got z"));
        assert!("rbg".parse::<Channels>().unwrap_err().to_string().contains("expected rgb or bgr, got rbg"));
    }
}

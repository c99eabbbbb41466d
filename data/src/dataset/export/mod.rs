//! Datasets out: as a folder of pictures, as NumPy arrays, as a ROS 2 bag, as a LeRobot dataset.
//!
//! An export is whole or not there: it is written to `OUT.partial` and then takes its name.

pub mod arrays;
#[cfg(feature = "mcap")]
pub mod bag;
pub mod folder;
#[cfg(feature = "lerobot")]
pub mod lerobot;
mod partial;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::error::{Error, Result};
use crate::frame::Frame;

/// The bytes of a frame as a JPEG of a quality, 1 to 100.
///
/// # Errors
/// Another quality, a frame of more than 65,535 pixels a side.
pub fn jpeg(frame: &Frame, quality: u8) -> Result<Vec<u8>> {
    if !(1..=100).contains(&quality) {
        return Err(Error::invalid("--jpeg", "a quality of 1 to 100", quality.to_string()));
    }
    let size = [frame.width_px(), frame.height_px()];
    let too_large = || Error::invalid("frame", "a size that a JPEG can have", format!("{size:?} pixels"));
    let [Ok(width), Ok(height)] = size.map(u16::try_from) else { return Err(too_large()) };
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    let encoded = encoder.encode(frame.rgb(), width.into(), height.into(), ExtendedColorType::Rgb8);
    encoded.map_err(Error::picture("JPEG"))?;
    Ok(bytes)
}

#[cfg(test)]
pub(crate) mod tests;

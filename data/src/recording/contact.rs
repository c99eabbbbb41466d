//! Whether a frame shows contact.

use std::ops::RangeInclusive;

use rayon::prelude::*;

use crate::dataset::store::Dataset;
use crate::error::Result;
use crate::frame::{Background, Frame, Preprocessing, TactileImage};

/// Largest size at which contact is looked for, pixels: small enough that noise averages out, large
/// enough that an edge does not.
const CONTACT_PX: [usize; 2] = [40, 30];

/// A frame whose share of edge pixels is above this shows contact: more than 3 of 40 x 30 pixels.
///
/// On recorded presses of a GelSight Mini no pixel at rest passes for an edge, in any frame, even with a
/// single palette-quantised frame to compare with; the first visible touch of a point, less than 1 mm
/// wide, gives 4. What is below is a dead pixel or a speck of dust.
pub const CONTACT_SHARE: f32 = 0.0025;

/// How one frame of a dataset differs from the sensor at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameContact {
    /// Share of pixels that show an edge, 0..=1 ([`TactileImage::edge_share`]).
    pub edge_share: f32,
    /// Root mean square of the difference over pixels and channels, counts.
    pub difference_rms: f32,
}

impl FrameContact {
    /// Compares an image made with [`Preprocessing::counts`] with rest.
    pub fn of(image: &TactileImage) -> Self {
        let square: f32 = image.planes.iter().map(|p| p * p).sum();
        Self { edge_share: image.edge_share, difference_rms: (square / image.planes.len() as f32).sqrt() }
    }

    /// Whether the sensor touches something with an edge in view. A face that fills the view changes
    /// nothing that a camera sees, so it counts as no contact.
    pub fn is_contact(&self) -> bool {
        self.edge_share > CONTACT_SHARE
    }
}

/// Compares every frame with rest, in order; an error replaces a frame that cannot be compared
/// (black, white or constant). Fails where the no-contact frame itself is of no use.
pub fn measure(dataset: &Dataset) -> Result<Vec<Result<FrameContact>>> {
    let background = background(dataset.no_contact())?;
    let compare = |i| Ok(FrameContact::of(&background.tactile_image(&dataset.frame(i))?));
    Ok((0..dataset.len()).into_par_iter().map(compare).collect())
}

/// The sensor at rest, reduced to the size at which contact is looked for. Fails where the frame is of no use.
pub fn background(no_contact: &Frame) -> Result<Background> {
    let size = [no_contact.width_px().min(CONTACT_PX[0]), no_contact.height_px().min(CONTACT_PX[1])];
    Background::new(no_contact, &Preprocessing::counts(size))
}

/// The runs of consecutive frames that show contact.
pub fn contact_runs(frames: &[Result<FrameContact>]) -> Vec<RangeInclusive<usize>> {
    let mut runs: Vec<RangeInclusive<usize>> = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        if !frame.as_ref().is_ok_and(FrameContact::is_contact) {
            continue;
        }
        match runs.last_mut() {
            Some(run) if *run.end() + 1 == i => *run = *run.start()..=i,
            _ => runs.push(i..=i),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(edge_share: f32) -> Result<FrameContact> {
        Ok(FrameContact { edge_share, difference_rms: 0.0 })
    }

    #[test]
    fn runs_are_joined_and_parted_where_contact_is() {
        let frames = [0.1, 0.1, 0.0, 0.2, 0.0, 0.3, 0.3, 0.3].map(frame);
        assert_eq!(contact_runs(&frames), [0..=1, 3..=3, 5..=7]);
        assert!(contact_runs(&[frame(3.0 / 1200.0)]).is_empty());
    }

    #[test]
    fn rms_is_over_pixels_and_channels() {
        let image = TactileImage { size_px: [1, 1], planes: vec![2.0, -1.0, 2.0], edge_share: 0.0 };
        assert!((FrameContact::of(&image).difference_rms - 3.0_f32.sqrt()).abs() < 1e-6);
    }
}

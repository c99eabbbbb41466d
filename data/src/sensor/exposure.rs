//! From the gel's depths to a frame, by each tier above geometry.

use rand::rngs::ChaCha8Rng;

use super::camera::{Camera, to_frame};
use super::optics::Optics;
use super::rounding::to_byte;
use super::{Fidelity, geometry, shadow};
use crate::frame::Frame;

/// What takes a frame of the gel.
#[derive(Clone, Copy, Debug)]
pub struct Exposure<'a> {
    /// How much of the sensor is computed; not [`Fidelity::Geometry`].
    pub fidelity: Fidelity,
    /// The light on the gel.
    pub optics: &'a Optics,
    /// The camera, for the tiers that have one.
    pub camera: &'a Camera,
    /// Size of a pixel in x and y, mm.
    pub mm_per_px: [f64; 2],
}

impl Exposure<'_> {
    /// The frame of depths `[height + 2, width + 2]` in mm; what the camera adds is drawn from `rng`.
    pub fn frame(&self, depths: &[f32], rng: &mut ChaCha8Rng) -> Frame {
        if self.fidelity <= Fidelity::Gel {
            return grey(depths, self.optics.size_px());
        }
        let mut rgb = self.optics.shade(depths, self.mm_per_px);
        if self.fidelity >= Fidelity::Shadow {
            shadow::cast(&mut rgb, depths, self.optics, self.mm_per_px);
        }
        if self.fidelity >= Fidelity::Camera {
            let deepest_mm = depths.iter().copied().fold(0.0, f32::max);
            self.camera.add_light_field(&mut rgb, f64::from(deepest_mm), rng);
        }
        self.expose(rgb, rng)
    }

    /// A frame of the sensor at rest.
    pub fn at_rest(&self, rng: &mut ChaCha8Rng) -> Frame {
        let size_px = self.optics.size_px();
        if self.fidelity <= Fidelity::Gel {
            return grey(&vec![0.0; (size_px[0] + 2) * (size_px[1] + 2)], size_px);
        }
        self.expose(self.optics.at_rest().to_vec(), rng)
    }

    fn expose(&self, rgb: Vec<f32>, rng: &mut ChaCha8Rng) -> Frame {
        if self.fidelity >= Fidelity::Camera {
            self.camera.expose(rgb, rng)
        } else {
            to_frame(&rgb, self.optics.size_px())
        }
    }
}

/// Depths `[height + 2, width + 2]` in mm as grey levels.
fn grey(depths: &[f32], [width, height]: [usize; 2]) -> Frame {
    let mut rgb = vec![0; 3 * width * height];
    for (line, depths) in rgb.chunks_exact_mut(3 * width).zip(depths[width + 2..].chunks_exact(width + 2)) {
        for (pixel, depth) in line.as_chunks_mut::<3>().0.iter_mut().zip(&depths[1..]) {
            *pixel = [to_byte(60.0 + 150.0 * depth); 3];
        }
    }
    geometry::marked(rgb, [width, height])
}

//! Presses of a ball simulated with a known light, for tests.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::ball::BallPress;
use super::circle::Circle;
use crate::frame::Frame;
use crate::sensor::SensorSpec;
use crate::sensor::camera::to_frame;
use crate::sensor::light::{LightRig, Walls};
use crate::sensor::optics::Optics;

/// The ball's diameter, mm.
pub const BALL_MM: f64 = 4.7;

/// A frame at rest and presses with their true circles.
pub type Set = (Frame, Vec<(String, Frame, Option<Circle>)>);

/// A Mini whose walls are lit as well.
pub fn spec() -> SensorSpec {
    let flat = |counts: [f32; 3]| counts.map(|counts| [counts, 0.0, 5.0, 0.0, 0.0, 0.0]);
    let walls =
        Walls { steep: flat([25.0, 30.0, 12.0]), across: flat([-20.0, -10.0, 15.0]), diagonal: flat([0.0, 8.0, -4.0]) };
    SensorSpec {
        frame_px: [160, 120],
        gel_length_mm: 1.2,
        light: LightRig { walls: Some(walls), ..LightRig::named("mini").unwrap() },
        ..SensorSpec::default()
    }
}

/// Depths `[height + 2, width + 2]` round a ball, mm.
pub fn depths(ball: &BallPress, centre_px: [f64; 2], size_px: [usize; 2], mm_per_px: [f64; 2]) -> Vec<f32> {
    let [width, height] = size_px.map(|side| side + 2);
    let depth = |i: usize| {
        let place = [(i % width) as f64 - 1.0, (i / width) as f64 - 1.0];
        let [x, y] = [0, 1].map(|axis| (place[axis] - centre_px[axis]) * mm_per_px[axis]);
        ball.depth_mm(x.hypot(y)) as f32
    };
    (0..width * height).map(depth).collect()
}

/// Twelve presses all over the frame, with noise of 1.8 counts and gains of some per cent.
pub fn presses(seed: u64) -> Set {
    presses_on(&spec(), seed)
}

/// The same on another sensor of the same view.
pub fn presses_on(spec: &SensorSpec, seed: u64) -> Set {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (optics, mm_per_px) = (Optics::new(spec), spec.mm_per_px());
    let expose = |rgb: Vec<f32>, gain: f32, rng: &mut ChaCha8Rng| {
        let noisy = rgb.iter().map(|value| {
            let noise: f32 = StandardNormal.sample(rng);
            value * gain + 1.8 * noise
        });
        to_frame(&noisy.collect::<Vec<_>>(), spec.frame_px)
    };
    let no_contact = to_frame(optics.at_rest(), spec.frame_px);
    let frames = (0..12).map(|i| {
        let centre_px = [30.0 + 33.0 * f64::from(i % 4), 25.0 + 34.0 * f64::from(i / 4)]
            .map(|at| at + 6.0 * (rng.random::<f64>() - 0.5));
        let contact_mm = 1.2 + 0.5 * rng.random::<f64>();
        let ball = BallPress::new(0.5 * BALL_MM, contact_mm, spec.gel_length_mm, 25.0);
        let rgb = optics.shade(&depths(&ball, centre_px, spec.frame_px, mm_per_px), mm_per_px);
        let radius_px = contact_mm / (mm_per_px[0] * mm_per_px[1]).sqrt();
        let gain = 0.95 + 0.15 * rng.random::<f32>();
        (format!("press{i:02}.png"), expose(rgb, gain, &mut rng), Some(Circle { centre_px, radius_px }))
    });
    (no_contact, frames.collect())
}

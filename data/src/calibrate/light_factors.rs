//! What a pixel's light depends on linearly: five functions of the gel's slope times six of the place.

use super::ball::BallPress;
use crate::sensor::light::{LightRig, Quadratic, Shadow, Walls};

/// The five functions of the slope in [`LightRig`] at a place near a ball's axis.
pub(super) fn bases(ball: &BallPress, [x_mm, y_mm]: [f64; 2]) -> [f64; 5] {
    let r = x_mm.hypot(y_mm);
    let slope = ball.slope(r);
    // Deeper towards the axis.
    let [gx, gy] = if r > 0.0 { [-x_mm / r * slope, -y_mm / r * slope] } else { [0.0; 2] };
    slope_bases(gx, gy)
}

/// The five functions of [`LightRig`] of a slope.
pub(super) fn slope_bases(gx: f64, gy: f64) -> [f64; 5] {
    let share = 1.0 / (1.0 + gx * gx + gy * gy);
    [2.0 * gx, 2.0 * gy, gx * gx + gy * gy, gx * gx - gy * gy, 2.0 * gx * gy].map(|basis| basis * share)
}

/// Each of `bases` times each term of a [`Quadratic`] at a place of the frame, -1..=1.
pub(super) fn factors(bases: [f64; 5], [x, y]: [f64; 2]) -> [f64; 30] {
    let terms = [1.0, x, y, x * x, x * y, y * y];
    std::array::from_fn(|i| bases[i / 6] * terms[i % 6])
}

/// The light of 30 weights for each channel, as [`factors`] orders them.
pub(super) fn light(weights: &[Vec<f64>; 3], has_walls: bool, at_rest: [Quadratic; 3]) -> LightRig {
    let part = |basis: usize| {
        weights.each_ref().map(|weights| -> Quadratic { std::array::from_fn(|i| weights[6 * basis + i] as f32) })
    };
    let walls = has_walls.then(|| Walls { steep: part(2), across: part(3), diagonal: part(4) });
    LightRig { at_rest, along_x: part(0), along_y: part(1), walls, shadow: Shadow::default() }
}

/// Where a pixel's middle is in the frame, -1..=1.
pub(super) fn place(pixel: usize, [width, height]: [usize; 2]) -> [f64; 2] {
    let share = |at: usize, n: usize| (at as f64 + 0.5) / n as f64 * 2.0 - 1.0;
    [share(pixel % width, width), share(pixel / width, height)]
}

//! What a pixel's light depends on linearly: functions of the gel's slope and depth, times six of the place.

use super::ball::BallPress;
use crate::sensor::light::{LightRig, Quadratic, Shadow, Walls};

/// Functions of the slope in [`LightRig`].
pub(super) const N_SLOPES: usize = 5;

/// Functions of the slope, and the depth.
pub(super) const N_BASES: usize = N_SLOPES + 1;

/// Terms of a [`Quadratic`].
pub(super) const N_TERMS: usize = 6;

/// Everything in [`LightRig`] at a place near a ball's axis: the functions of the slope, then the depth in mm.
pub(super) fn bases(ball: &BallPress, [x_mm, y_mm]: [f64; 2]) -> [f64; N_BASES] {
    let r = x_mm.hypot(y_mm);
    let slope = ball.slope(r);
    // Deeper towards the axis.
    let [gx, gy] = if r > 0.0 { [-x_mm / r * slope, -y_mm / r * slope] } else { [0.0; 2] };
    let [along_x, along_y, steep, across, diagonal] = slope_bases(gx, gy);
    [along_x, along_y, steep, across, diagonal, ball.depth_mm(r)]
}

/// Everything in [`LightRig`] at a pixel, by its column and row, of depths `[height + 2, width + 2]` with a margin of one, mm.
pub(super) fn depth_bases(
    depths: &[f32],
    width: usize,
    [column, row]: [usize; 2],
    mm_per_px: [f64; 2],
) -> [f64; N_BASES] {
    let at = (row + 1) * (width + 2) + column + 1;
    let slope = |before: usize, after: usize, mm: f64| f64::from(depths[after] - depths[before]) / (2.0 * mm);
    let (gx, gy) = (slope(at - 1, at + 1, mm_per_px[0]), slope(at - (width + 2), at + width + 2, mm_per_px[1]));
    let [along_x, along_y, steep, across, diagonal] = slope_bases(gx, gy);
    [along_x, along_y, steep, across, diagonal, f64::from(depths[at])]
}

/// The weights of each channel of a light, as [`factors`] orders them: what [`light`] takes.
pub(super) fn weights_of(rig: &LightRig) -> [Vec<f64>; 3] {
    let dark = [[0.0; N_TERMS]; 3];
    let [steep, across, diagonal] =
        rig.walls.as_ref().map_or([dark; 3], |Walls { steep, across, diagonal }| [*steep, *across, *diagonal]);
    let parts = [rig.along_x, rig.along_y, steep, across, diagonal, rig.pressed.unwrap_or(dark)];
    [0, 1, 2].map(|channel| parts.iter().flat_map(|part| part[channel].map(f64::from)).collect())
}

/// The functions of [`LightRig`] of a slope.
pub(super) fn slope_bases(gx: f64, gy: f64) -> [f64; N_SLOPES] {
    let share = 1.0 / (1.0 + gx * gx + gy * gy);
    [2.0 * gx, 2.0 * gy, gx * gx + gy * gy, gx * gx - gy * gy, 2.0 * gx * gy].map(|basis| basis * share)
}

/// Each of `bases` times each term of a [`Quadratic`] at a place of the frame, -1..=1: `N * N_TERMS` of them.
pub(super) fn factors<const N: usize>(bases: [f64; N], [x, y]: [f64; 2]) -> [[f64; N_TERMS]; N] {
    let terms = [1.0, x, y, x * x, x * y, y * y];
    bases.map(|basis| terms.map(|term| basis * term))
}

/// What a light of these weights changes of a pixel with these factors, RGB, counts.
pub(super) fn change(weights: &[Vec<f64>; 3], factors: &[[f64; N_TERMS]]) -> [f64; 3] {
    let factors = factors.as_flattened();
    weights.each_ref().map(|weights| weights.iter().zip(factors).map(|(w, f)| w * f).sum())
}

/// The light of the weights of each channel, as [`factors`] orders them. What has no weight is left out.
pub(super) fn light(weights: &[Vec<f64>; 3], at_rest: [Quadratic; 3]) -> LightRig {
    let part = |basis: usize| {
        weights.each_ref().map(|weights| -> Quadratic {
            std::array::from_fn(|i| weights.get(N_TERMS * basis + i).copied().unwrap_or(0.0) as f32)
        })
    };
    let [along_x, along_y, steep, across, diagonal, pressed] = std::array::from_fn(part);
    let is_lit = |part: &[Quadratic; 3]| part.iter().flatten().any(|weight| *weight != 0.0);
    let walls = [steep, across, diagonal].iter().any(is_lit).then_some(Walls { steep, across, diagonal });
    let pressed = Some(pressed).filter(is_lit);
    LightRig { at_rest, along_x, along_y, walls, pressed, shadow: Shadow::default() }
}

/// Where a pixel's middle is in the frame, -1..=1.
pub(super) fn place(pixel: usize, [width, height]: [usize; 2]) -> [f64; 2] {
    let share = |at: usize, n: usize| (at as f64 + 0.5) / n as f64 * 2.0 - 1.0;
    [share(pixel % width, width), share(pixel / width, height)]
}

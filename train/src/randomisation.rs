//! Sensors that differ from the one that recorded the frames, drawn anew for each batch: other lamps, and the smooth
//! change of the whole picture that comes with a press. To first order each is a change of the difference image, so
//! that nothing needs to be rendered again.
//!
//! Lamps are drawn for a group of pairs, and shared by hole and peg: were they each pair's own, the lamps would tell
//! which hole goes with which peg. The smooth field is drawn for each picture, since it comes with each press.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tactile_data::frame::Preprocessing;

use crate::relighting::{Affine, Relighting};

/// Weakest and strongest lamp of another sensor, as a multiple of the mean of one's own.
const STRENGTH: [f64; 2] = [0.55, 1.7];

/// Three lamps stand at least this far apart, degrees: a Mini's 77 to 180, of other sensors 83 to 181.
const LEAST_GAP_DEG: f64 = 55.0;

/// The most of a channel's light that comes from all lamps alike.
const MOST_SHARED: f64 = 0.3;

/// Quadratic coefficients of a field are this share of the linear ones.
const QUADRATIC_SHARE: f64 = 0.6;

/// A smooth field's coefficients of `x, y, x^2 - 1/3, x y, y^2 - 1/3` for red, green and blue, normalised values;
/// x and y are -1..=1 over the picture.
pub type Field = [[f32; 5]; 3];

/// Lamps around the gel: for each channel its change with a slope along x and along y, as a multiple of the mean
/// length of one's own lamps.
pub fn lamps(rng: &mut ChaCha8Rng) -> [[f64; 2]; 3] {
    let between = |rng: &mut ChaCha8Rng, [low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
    let first = TAU * rng.random::<f64>();
    let room = 360.0 - 3.0 * LEAST_GAP_DEG;
    let mut cuts = [0; 2].map(|_| room * rng.random::<f64>());
    cuts.sort_by(f64::total_cmp);
    let gaps = [LEAST_GAP_DEG + cuts[0], LEAST_GAP_DEG + cuts[1] - cuts[0]].map(f64::to_radians);
    let mut angles = [first, first + gaps[0], first + gaps[0] + gaps[1]];
    if rng.random() {
        angles.swap(1, 2);
    }
    let common = between(rng, STRENGTH.map(f64::ln)).exp();
    let own = angles.map(|angle| {
        let strength = common * between(rng, [-0.35, 0.35]).exp();
        [strength * angle.cos(), strength * angle.sin()]
    });
    let shared = MOST_SHARED * rng.random::<f64>();
    let mean = [0, 1].map(|axis| own.iter().map(|lamp| lamp[axis]).sum::<f64>() / 3.0);
    own.map(|lamp| [0, 1].map(|axis| (1.0 - shared) * lamp[axis] + shared * mean[axis]))
}

/// A smooth field whose linear coefficients have a standard deviation of up to `counts`.
pub fn field(rng: &mut ChaCha8Rng, counts: f64, preprocessing: &Preprocessing) -> Field {
    let amplitude = counts * rng.random::<f64>();
    [0, 1, 2].map(|channel| {
        let scale = amplitude / f64::from(preprocessing.std[channel]);
        [1.0, 1.0, QUADRATIC_SHARE, QUADRATIC_SHARE, QUADRATIC_SHARE].map(|share| {
            let normal: f64 = StandardNormal.sample(rng);
            (share * scale * normal) as f32
        })
    })
}

/// Adds a field to `[3, height, width]` values.
pub fn add(field: &Field, planes: &mut [f32], [width, height]: [usize; 2]) {
    let place = |at: usize, n: usize| (at as f32 + 0.5) / n as f32 * 2.0 - 1.0;
    for (plane, [x1, y1, xx, xy, yy]) in planes.chunks_exact_mut(width * height).zip(field) {
        for (row, line) in plane.chunks_exact_mut(width).enumerate() {
            let y = place(row, height);
            for (column, value) in line.iter_mut().enumerate() {
                let x = place(column, width);
                *value += x1 * x + y1 * y + xx * (x * x - 1.0 / 3.0) + xy * x * y + yy * (y * y - 1.0 / 3.0);
            }
        }
    }
}

/// The light of groups of pairs: under one's own lamps, or as others would show the same slopes.
pub fn groups(rng: &mut ChaCha8Rng, n: usize, other_lamps: f64, relighting: &Relighting) -> Vec<Option<Affine>> {
    (0..n).map(|_| (rng.random::<f64>() < other_lamps).then(|| relighting.under(&lamps(rng)))).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn lamps_stand_apart_and_all_round() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut quadrants = [0; 4];
        for _ in 0..2_000 {
            let drawn = lamps(&mut rng);
            let [x, y] = drawn[0];
            quadrants[usize::from(x > 0.0) + 2 * usize::from(y > 0.0)] += 1;
            assert!(drawn.iter().all(|[x, y]| (0.1..2.5).contains(&x.hypot(*y))), "{drawn:?}");
            // No two channels answer alike, or a slope across them would not be seen.
            let cross = |a: usize, b: usize| drawn[a][0] * drawn[b][1] - drawn[a][1] * drawn[b][0];
            assert!([cross(0, 1), cross(1, 2), cross(0, 2)].iter().any(|c| c.abs() > 0.02), "{drawn:?}");
        }
        // Five standard errors of a quarter of 2,000.
        assert!(quadrants.iter().all(|n| (403..=597).contains(n)), "{quadrants:?}");
    }

    #[test]
    fn a_field_has_no_mean_and_the_stated_slope() {
        let mut planes = vec![0.0; 3 * 40 * 30];
        add(&[[2.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0, 0.0], [0.0; 5]], &mut planes, [40, 30]);
        // From the middle of the first pixel to that of the last: 39 / 40 of 2 x 2.
        assert!((planes[39] - planes[0] - 4.0 * 39.0 / 40.0).abs() < 1e-5);
        for plane in planes.chunks(1_200) {
            // The mean of x^2 over 40 pixels is less than a third by 1 / 4,800.
            assert!((plane.iter().sum::<f32>() / 1_200.0).abs() < 1e-3);
        }
    }
}

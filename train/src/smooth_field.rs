//! The smooth change of a whole picture that comes with a press, drawn for each picture of a batch: what differs
//! between a press and its like, and says nothing of the part. It is added to the difference image, so that nothing
//! needs to be rendered again.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tactile_data::frame::Preprocessing;

/// Quadratic coefficients of a field are this share of the linear ones.
const QUADRATIC_SHARE: f64 = 0.6;

/// A smooth field's coefficients of `x, y, x^2 - 1/3, x y, y^2 - 1/3` for red, green and blue, normalised values;
/// x and y are -1..=1 over the picture.
pub type Field = [[f32; 5]; 3];

/// A smooth field whose linear coefficients have a standard deviation of up to `counts`.
pub fn draw(rng: &mut ChaCha8Rng, counts: f64, preprocessing: &Preprocessing) -> Field {
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

#[cfg(test)]
mod tests {
    use super::*;

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

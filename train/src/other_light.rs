//! Pictures as other sensors would show them: mirrored, under lamps that are turned, stronger, weaker or fade otherwise, and with
//! the smooth change of a whole picture that comes with a press.
//!
//! A picture is brought under the lamps that the network knows ([`tactile_data::light::lamps`]) as far as a user's calibration
//! knows its own; what is left of the difference, and what of it is not of first order, a network must not take for shape.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::frame::Preprocessing;
use tactile_data::light::lamps::{Lamps, recolour};

use crate::smooth_field::{self, Field};

/// How far each lamp is turned at most, degrees.
const TURN_DEG: f64 = 15.0;

/// How many times as strong all lamps are at most, and each next to the others.
const STRONGER: [f64; 2] = [1.5, 1.2];

/// How much a lamp gains or loses from the middle of the picture to its border, along x and along y, at most.
const UNEVEN: f64 = 0.3;

/// Strongest smooth change, counts, as the encoder is trained with.
const FIELD_COUNTS: f64 = 4.0;

/// Another light for a picture, drawn.
#[derive(Clone, Debug)]
pub struct OtherLight {
    /// Whether left and right, top and bottom are exchanged.
    mirrored: [bool; 2],
    /// For each pixel its colours under the other lamps, counts.
    colours: Vec<[[f32; 3]; 3]>,
    field: Field,
}

impl OtherLight {
    /// Draws one for pictures under the lamps that the network knows.
    pub fn draw(rng: &mut ChaCha8Rng, preprocessing: &Preprocessing) -> Self {
        let mirrored: [bool; 2] = rng.random();
        let mut between = |most: f64| rng.random_range(-most..=most);
        let together = between(STRONGER[0].ln());
        let strength = [0, 1, 2].map(|_| (together + between(STRONGER[1].ln())).exp());
        let turn_deg = [0, 1, 2].map(|_| between(TURN_DEG));
        let uneven = [0, 1, 2].map(|_| [0, 1].map(|_| between(UNEVEN)));
        let lamps = Lamps::default().varied(strength, turn_deg).fading(uneven);
        let colours = Lamps::default().mirrored(mirrored).change_to(&lamps, preprocessing.input_px);
        Self { mirrored, colours, field: smooth_field::draw(rng, FIELD_COUNTS, preprocessing) }
    }

    /// Exchanges what is to be exchanged of values by pixel, rows of `width`.
    pub fn mirror<T>(&self, values: &mut [T], width: usize) {
        let [x, y] = self.mirrored;
        if x != y {
            values.chunks_exact_mut(width).for_each(<[T]>::reverse);
        }
        if y {
            // Both at once are a turn by half.
            values.reverse();
        }
    }

    /// Mirrors and lights a picture, `[3, height, width]` normalised values.
    pub fn apply(&self, planes: &mut [f32], preprocessing: &Preprocessing) {
        let Preprocessing { input_px: [width, height], mean, std, .. } = *preprocessing;
        let n = width * height;
        planes.chunks_exact_mut(n).for_each(|plane| self.mirror(plane, width));
        for (c, plane) in planes.chunks_exact_mut(n).enumerate() {
            plane.iter_mut().for_each(|value| *value = *value * std[c] + mean[c]);
        }
        recolour(&self.colours, planes);
        for (c, plane) in planes.chunks_exact_mut(n).enumerate() {
            plane.iter_mut().for_each(|value| *value = (*value - mean[c]) / std[c]);
        }
        smooth_field::add(&self.field, planes, [width, height]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use tactile_data::light::lamps::value;

    const SIZE: [usize; 2] = [20, 15];

    /// A surface of waves under lamps, `[3, height, width]` counts: to first order, what a picture shows of its slope.
    fn waves(lamps: &Lamps, [sx, sy]: [f64; 2]) -> Vec<f32> {
        let [width, height] = SIZE;
        let mut planes = Vec::new();
        for c in 0..3 {
            for pixel in 0..width * height {
                let place = |at: usize, n: usize| (at as f64 + 0.5) / n as f64 * 2.0 - 1.0;
                let (x, y) = (place(pixel % width, width), place(pixel / width, height));
                // The slope of sin(3 x + y) + 0.5 cos(2 y - x) at the mirrored place, as a mirror turns it.
                let (u, v) = (sx * x, sy * y);
                let (a, b) = ((3.0 * u + v).cos(), -0.5 * (2.0 * v - u).sin());
                let slope = [sx * (3.0 * a - b), sy * (a + 2.0 * b)];
                let lamp = [&lamps.along_x[c], &lamps.along_y[c]].map(|k| f64::from(value(k, x as f32, y as f32)));
                planes.push((lamp[0] * slope[0] + lamp[1] * slope[1]) as f32 * 0.2);
            }
        }
        planes
    }

    #[test]
    fn a_picture_is_that_of_the_mirrored_surface_under_the_other_lamps() {
        let preprocessing =
            Preprocessing { mean: [1.0, -2.0, 0.5], std: [4.0, 2.0, 3.0], ..Preprocessing::counts(SIZE) };
        let n = SIZE[0] * SIZE[1];
        for mirrored in [[false, false], [true, false], [false, true], [true, true]] {
            let (strength, turn_deg) = ([1.3, 0.8, 1.1], [12.0, -9.0, 4.0]);
            let uneven = [[0.2, -0.1], [0.0, 0.3], [-0.3, 0.1]];
            let lamps = Lamps::default().varied(strength, turn_deg).fading(uneven);
            let colours = Lamps::default().mirrored(mirrored).change_to(&lamps, SIZE);
            let light = OtherLight { mirrored, colours, field: [[0.0; 5]; 3] };
            let normal = |planes: &[f32]| -> Vec<f32> {
                planes
                    .iter()
                    .enumerate()
                    .map(|(i, v)| (v - preprocessing.mean[i / n]) / preprocessing.std[i / n])
                    .collect()
            };
            let mut planes = normal(&waves(&Lamps::default(), [1.0, 1.0]));
            light.apply(&mut planes, &preprocessing);
            let sign = mirrored.map(|is| if is { -1.0 } else { 1.0 });
            let expected = normal(&waves(&lamps, sign));
            let middle = |i: &usize| {
                let (x, y) = (i % n % SIZE[0], i % n / SIZE[0]);
                (5..15).contains(&x) && (4..11).contains(&y)
            };
            let square =
                |of: &dyn Fn(usize) -> f32| (0..3 * n).filter(middle).map(|i| of(i).powi(2)).sum::<f32>().sqrt();
            let (off, size) = (square(&|i| planes[i] - expected[i]), square(&|i| expected[i]));
            // The doubt in a slope keeps some of the picture as it was: along x, where the light is weak, a tenth of the slope, which
            // a mirror turns round.
            let bound = if mirrored == [false, false] { 0.1 } else { 0.25 };
            assert!(off < bound * size, "{mirrored:?}: {off} of {size}");
        }
    }

    #[test]
    fn lights_differ_and_come_again_from_their_seed() {
        let preprocessing = Preprocessing::counts(SIZE);
        let lit = |seed: u64| {
            let mut planes = waves(&Lamps::default(), [1.0, 1.0]);
            OtherLight::draw(&mut ChaCha8Rng::seed_from_u64(seed), &preprocessing).apply(&mut planes, &preprocessing);
            planes
        };
        assert_eq!(lit(1), lit(1));
        assert_ne!(lit(1), lit(2));
    }

    #[test]
    fn values_are_mirrored_as_the_picture_is() {
        let mut light = OtherLight { mirrored: [true, false], colours: Vec::new(), field: [[0.0; 5]; 3] };
        let mirror = |light: &OtherLight| {
            let mut values: Vec<usize> = (0..6).collect();
            light.mirror(&mut values, 3);
            values
        };
        assert_eq!(mirror(&light), [2, 1, 0, 5, 4, 3]);
        light.mirrored = [false, true];
        assert_eq!(mirror(&light), [3, 4, 5, 0, 1, 2]);
        light.mirrored = [true, true];
        assert_eq!(mirror(&light), [5, 4, 3, 2, 1, 0]);
    }
}

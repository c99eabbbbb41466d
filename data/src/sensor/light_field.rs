//! The smooth change of the whole picture that comes with a press.
//!
//! Far from a contact a real picture changes by more than the camera's noise. On 42 presses of a ball (FOTS) four
//! fifths of that are the gel's own slope, which the membrane and the lamps explain (`data/NOTES.md`); the rest is
//! smooth, another one in each press, and not seen in frames without contact. Light that the pressed gel sends
//! another way is the likely cause. It is drawn here: for each channel a plane and a quadratic over the frame.

use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// How strong the smooth change is, for a press that is [`Self::REFERENCE_MM`] deep; it grows with the depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightField {
    /// Standard deviation of the coefficients of `x` and `y`, which are -1..=1 over the frame, counts.
    pub linear_counts: f64,
    /// Standard deviation of the coefficients of `x^2 - 1/3`, `x y` and `y^2 - 1/3`, counts.
    pub quadratic_counts: f64,
}

/// The most that a standard deviation may be, counts.
const MOST_COUNTS: f64 = 100.0;

impl LightField {
    /// The depth of the press for which the field is stated, mm.
    pub const REFERENCE_MM: f64 = 1.0;

    /// What the presses of a ball leave, once the light on the gel's slopes is taken away: 1.0 and 1.2 counts, for presses
    /// that are about 2 mm deep in the gel that is fitted to them. A film of a digit, pressed half a millimetre, has 0.20 and
    /// 0.35 counts.
    pub const FITTED: Self = Self { linear_counts: 0.5, quadratic_counts: 0.6 };

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.linear_counts == 0.0 && self.quadratic_counts == 0.0
    }

    /// The same field, `factor` times as strong.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { linear_counts: factor * self.linear_counts, quadratic_counts: factor * self.quadratic_counts }
    }

    /// Refuses what no light does, naming the field.
    pub fn validate(&self) -> Result<()> {
        for (field, counts) in [("linear_counts", self.linear_counts), ("quadratic_counts", self.quadratic_counts)] {
            if !(0.0..=MOST_COUNTS).contains(&counts) {
                let expected = format!("0 to {MOST_COUNTS} counts");
                return Err(Error::invalid(format!("sensor.light_field.{field}"), expected, counts.to_string()));
            }
        }
        Ok(())
    }

    /// Draws the field of a press whose deepest point in the view is `depth_mm` and adds it to interleaved RGB
    /// counts. Draws nothing where there is no field.
    pub fn add(&self, rgb: &mut [f32], [width, height]: [usize; 2], depth_mm: f64, rng: &mut ChaCha8Rng) {
        if self.is_none() {
            return;
        }
        let share = depth_mm / Self::REFERENCE_MM;
        let [plane, square] = [self.linear_counts, self.quadratic_counts].map(|counts| (share * counts) as f32);
        let mut normal = |scale: f32| -> f32 {
            let value: f32 = StandardNormal.sample(rng);
            scale * value
        };
        let channels = [0; 3].map(|_| [plane, plane, square, square, square].map(&mut normal));
        let place = |at: usize, n: usize| (at as f32 + 0.5) / n as f32 * 2.0 - 1.0;
        for (row, line) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let y = place(row, height);
            for (column, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let x = place(column, width);
                for (value, [kx, ky, kxx, kxy, kyy]) in pixel.iter_mut().zip(&channels) {
                    *value += (kx + kxx * x + kxy * y) * x + (ky + kyy * y) * y - (kxx + kyy) / 3.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn a_field_has_the_stated_energy_and_grows_with_the_press() {
        let field = LightField { linear_counts: 2.0, quadratic_counts: 3.0 };
        let size = [24, 18];
        let energy = |depth_mm: f64| {
            let mut rng = ChaCha8Rng::seed_from_u64(4);
            let (mut sum, mut mean) = (0.0, 0.0);
            for _ in 0..600 {
                let mut rgb = vec![0.0; 3 * size[0] * size[1]];
                field.add(&mut rgb, size, depth_mm, &mut rng);
                sum += rgb.iter().map(|v| f64::from(v * v)).sum::<f64>() / rgb.len() as f64;
                mean += rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / rgb.len() as f64;
            }
            [sum / 600.0, mean / 600.0]
        };
        // Over the square: x^2 has a mean of 1/3, (x^2 - 1/3)^2 of 4/45, (x y)^2 of 1/9.
        let law = 4.0 * 2.0 / 3.0 + 9.0 * (2.0 * 4.0 / 45.0 + 1.0 / 9.0);
        let [whole, mean] = energy(1.0);
        // 1,800 independent channels of few coefficients each: some 3 %.
        assert!((whole / law - 1.0).abs() < 0.1, "{whole} {law}");
        assert!(mean.abs() < 0.1, "{mean}");
        assert!((energy(0.5)[0] / whole - 0.25).abs() < 1e-4);
    }

    #[test]
    fn no_field_changes_nothing_and_draws_nothing() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut rgb = vec![7.0; 3 * 4 * 4];
        LightField::default().add(&mut rgb, [4, 4], 1.0, &mut rng);
        assert_eq!(rgb, vec![7.0; 48]);
        assert_eq!(rng, ChaCha8Rng::seed_from_u64(4));
    }

    #[test]
    fn a_field_that_is_no_number_is_refused() {
        let error = LightField { linear_counts: f64::NAN, ..LightField::FITTED }.validate().unwrap_err().to_string();
        assert!(error.starts_with("sensor.light_field.linear_counts"), "{error}");
    }
}

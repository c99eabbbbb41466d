//! How parts seem under a sensor: deeper presses and other gels draw every outline farther out, and of another shape.

use serde::{Deserialize, Serialize};

use super::strain::Strain;

/// How much larger along both axes parts seem that are there, under any sensor: one standard deviation.
const STRAIN: f64 = 0.02;

/// How far their maps are off beyond what is usual, under any sensor, nats: one standard deviation.
const MISFIT: f64 = 0.5;

/// How far those of a few touches are off, under one sensor, nats: one standard deviation.
const MISFIT_OF_TOUCHES: f64 = 0.4;

/// A part tells at most of an offset of so many standard deviations: a wrong name costs little.
const MOST: f64 = 3.0;

/// No sensor makes parts seem larger, or smaller, by more than this: 1 for twice as large.
pub const MOST_STRAIN: f64 = 1.0;

/// No sensor makes maps farther off than usual, or nearer, by more than this, nats.
pub const MOST_MISFIT: f64 = 20.0;

/// What a sensor adds to what every part shows, learnt from parts that are there; nothing at first. A normal offset with its conjugate
/// prior.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorOffset {
    /// As it is estimated.
    pub mean: f64,
    /// What the parts tell of it: one over the variance of their mean.
    pub information: f64,
}

impl SensorOffset {
    /// How much larger along both axes parts seem, 1 for twice as long, with what one more part tells, whose touches came to this strain.
    pub fn with_strain(&self, Strain { mean: [x, y, _], covariance: c }: &Strain) -> Self {
        self.with([0.5 * (x + y), 0.25 * (c[0][0] + 2.0 * c[0][1] + c[1][1])], STRAIN.powi(-2))
    }

    /// How far maps are off, nats, with what one more part tells, whose maps are so far off beyond what is usual.
    pub fn with_misfit(&self, nats: f64) -> Self {
        self.with([nats, MISFIT_OF_TOUCHES * MISFIT_OF_TOUCHES], MISFIT.powi(-2))
    }

    /// With one more value and its variance. `before`: what was known of the sensor before any, one over the variance.
    pub fn with(&self, [value, variance]: [f64; 2], before: f64) -> Self {
        let known = before + self.information;
        let most = MOST * (variance + known.recip()).sqrt();
        let apart = (value - self.mean).clamp(-most, most);
        let information = variance.recip();
        Self {
            mean: self.mean + apart * information / (known + information),
            information: self.information + information,
        }
    }

    /// Whether these are numbers that parts can give, of which none is so far off.
    pub fn is_within(&self, most: f64) -> bool {
        self.mean.abs() < most
            && (0.0..1e12).contains(&self.information)
            && (self.information > 0.0 || self.mean == 0.0)
    }

    /// Whether nothing was learnt.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strain(x: f64, y: f64, sd: f64) -> Strain {
        let variance = sd * sd;
        Strain { mean: [x, y, 0.01], covariance: [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]] }
    }

    #[test]
    fn parts_tell_what_a_sensor_shares() {
        let sd = 0.01;
        let found = [0.02, 0.03, 0.04]
            .iter()
            .fold(SensorOffset::default(), |known, x| known.with_strain(&strain(*x, 0.06 - x, sd)));
        // Each tells 0.03 to half of that variance; together with none, known to 0.02.
        let n = 6.0 / (sd * sd);
        assert!((found.mean - 0.03 * n / (n + STRAIN.powi(-2))).abs() < 1e-12, "{found:?}");
        assert!((found.information - n).abs() < 1e-6 * n && found.is_within(MOST_STRAIN) && !found.is_none());
        assert!(SensorOffset::default().is_none() && SensorOffset::default().is_within(MOST_STRAIN));
        // A part that is another moves it by at most three standard deviations.
        let wrong = found.with_strain(&strain(0.9, 0.9, sd));
        let known = STRAIN.powi(-2) + n;
        let most = MOST * (0.5 * sd * sd + 1.0 / known).sqrt();
        assert!(
            (wrong.mean - found.mean - most * (2.0 / (sd * sd)) / (known + 2.0 / (sd * sd))).abs() < 1e-12,
            "{wrong:?}"
        );
    }

    #[test]
    fn maps_of_parts_tell_how_far_off_a_sensor_is() {
        let found = [1.0, 0.6, 0.8].iter().fold(SensorOffset::default(), |known, nats| known.with_misfit(*nats));
        // The mean of three of variance 0.16 next to none of variance 0.25.
        let n = 3.0 / (MISFIT_OF_TOUCHES * MISFIT_OF_TOUCHES);
        assert!((found.mean - 0.8 * n / (n + MISFIT.powi(-2))).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn numbers_that_no_parts_give_are_not_possible() {
        for [mean, information] in [[f64::NAN, 1.0], [2.0, 1.0], [0.1, 0.0], [0.1, -1.0]] {
            assert!(!SensorOffset { mean, information }.is_within(MOST_STRAIN), "{mean} {information}");
        }
    }
}

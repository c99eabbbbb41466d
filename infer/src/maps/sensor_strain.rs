//! How much larger parts seem under a sensor: deeper presses and other gels draw every outline farther out.

use serde::{Deserialize, Serialize};

use super::strain::Strain;

/// How much larger along both axes parts seem that are there, under any sensor: one standard deviation.
const OF_SENSORS: f64 = 0.02;

/// A part tells at most of a strain of so many standard deviations: a wrong name costs little.
const MOST: f64 = 3.0;

/// How much larger along both axes every part seems under a sensor, learnt from parts that are there; nothing at first. A normal
/// strain with its conjugate prior.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorStrain {
    /// As it is estimated, 1 for twice as long.
    pub mean: f64,
    /// What the parts tell of it: one over the variance of their mean.
    pub information: f64,
}

impl SensorStrain {
    /// With what one more part tells, whose touches came to this strain.
    pub fn with(&self, Strain { mean: [x, y, _], covariance: c }: &Strain) -> Self {
        let variance = 0.25 * (c[0][0] + 2.0 * c[0][1] + c[1][1]);
        let known = OF_SENSORS.powi(-2) + self.information;
        let most = MOST * (variance + known.recip()).sqrt();
        let apart = (0.5 * (x + y) - self.mean).clamp(-most, most);
        let information = variance.recip();
        Self {
            mean: self.mean + apart * information / (known + information),
            information: self.information + information,
        }
    }

    /// Whether these are numbers that parts can give.
    pub fn is_possible(&self) -> bool {
        self.mean.abs() < 1.0 && (0.0..1e12).contains(&self.information) && (self.information > 0.0 || self.mean == 0.0)
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
        let found =
            [0.02, 0.03, 0.04].iter().fold(SensorStrain::default(), |known, x| known.with(&strain(*x, 0.06 - x, sd)));
        // Each tells 0.03 to half of that variance; together with none, known to 0.02.
        let n = 6.0 / (sd * sd);
        assert!((found.mean - 0.03 * n / (n + OF_SENSORS.powi(-2))).abs() < 1e-12, "{found:?}");
        assert!((found.information - n).abs() < 1e-6 * n && found.is_possible() && !found.is_none());
        assert!(SensorStrain::default().is_none() && SensorStrain::default().is_possible());
        // A part that is another moves it by at most three standard deviations.
        let wrong = found.with(&strain(0.9, 0.9, sd));
        let known = OF_SENSORS.powi(-2) + n;
        let most = MOST * (0.5 * sd * sd + 1.0 / known).sqrt();
        assert!(
            (wrong.mean - found.mean - most * (2.0 / (sd * sd)) / (known + 2.0 / (sd * sd))).abs() < 1e-12,
            "{wrong:?}"
        );
    }

    #[test]
    fn numbers_that_no_parts_give_are_not_possible() {
        for [mean, information] in [[f64::NAN, 1.0], [2.0, 1.0], [0.1, 0.0], [0.1, -1.0]] {
            assert!(!SensorStrain { mean, information }.is_possible(), "{mean} {information}");
        }
    }
}

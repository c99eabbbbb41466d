//! How well the touches of this sensor match, learnt from the holes of a run that were named with confidence.
//!
//! A calibration over many sensors says what to expect of any; the cosines of one sensor differ from it by one offset and lie
//! nearer together, or farther apart, by one factor. The holes of a run tell both: a normal offset of unknown variance with its
//! conjugate prior (normal and inverse gamma; Gelman et al., Bayesian Data Analysis, 3.3). The caller keeps the value: it goes into
//! [`EpisodeConfig::sensor`](crate::EpisodeConfig) and comes out of [`Episode::learn`](crate::Episode::learn).

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::likelihood::ExpectedMatch;

/// How far the mean cosine of a sensor may be from that of the simulated ones: one real Mini is so far off.
const OFFSET_COSINE: f64 = 0.027;

/// Shape of the prior of a sensor's own variance: that of seven drawn sensors on MAZE parts differs by 0.7 of its mean.
const SHAPE: f64 = 4.0;

/// A hole tells at most of an offset of so many standard deviations: a wrong name costs little.
const MOST: f64 = 3.0;

/// What was learnt of a sensor from the confident holes of a run; nothing at first. A new gel or another camera begins anew, with
/// the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorMatch {
    /// Holes it was learnt from.
    pub n_holes: u32,
    /// The sensor's offset, as estimated, cosine.
    pub offset: f64,
    /// What is known of the offset from these holes: one over its variance, 1 / cosine^2, where the sensor's factor is 1.
    pub weight: f64,
    /// Half the sum of squares about the offset, each in its variance.
    pub squares: f64,
}

/// The mean of the standard scores of a hole's edged touches, how many they are, and what was expected of each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scores {
    pub(crate) mean: f64,
    pub(crate) n: usize,
    pub(crate) expected: ExpectedMatch,
}

impl Scores {
    /// How far the touches are from what was expected of them, cosine.
    fn apart(&self) -> f64 {
        self.mean * self.expected.sd()
    }

    /// The variance of that under one sensor.
    fn variance(&self) -> f64 {
        let ExpectedMatch { touches, holes, .. } = self.expected;
        (holes + touches / self.n as f64).max(f64::EPSILON)
    }
}

impl SensorMatch {
    /// The mean score of a hole's touches in standard deviations of such a mean, as this sensor's are expected.
    pub(crate) fn fit(&self, scores: Scores) -> f64 {
        (scores.apart() - self.offset) / self.variance(scores).sqrt()
    }

    /// What is known of the offset, 1 / cosine^2.
    fn known(&self) -> f64 {
        OFFSET_COSINE.powi(-2) + self.weight
    }

    /// The variance of the mean of a hole's touches about the offset.
    fn variance(&self, scores: Scores) -> f64 {
        if self.n_holes == 0 {
            return scores.expected.sensors + scores.variance();
        }
        let factor = (SHAPE - 1.0 + self.squares) / (SHAPE - 1.0 + 0.5 * f64::from(self.n_holes));
        factor * (scores.variance() + self.known().recip())
    }

    /// With what one more confident hole tells.
    pub(crate) fn with(&self, scores: Scores) -> Self {
        let (weight, known) = (scores.variance().recip(), self.known());
        let most = MOST * self.variance(scores).sqrt();
        let apart = (scores.apart() - self.offset).clamp(-most, most);
        Self {
            n_holes: self.n_holes.saturating_add(1),
            offset: self.offset + apart * weight / (known + weight),
            weight: self.weight + weight,
            squares: self.squares + 0.5 * apart * apart * weight * known / (known + weight),
        }
    }

    /// Refuses numbers that no holes tell.
    pub(crate) fn validate(&self) -> Result<()> {
        let is_told =
            self.offset.abs() < 1e6 && (0.0..1e12).contains(&self.weight) && (0.0..1e12).contains(&self.squares);
        let is_none = self.n_holes > 0 || *self == Self::default();
        if is_told && is_none {
            return Ok(());
        }
        Err(Error::config("episode.sensor", "numbers that Episode::learn returned, or none", format!("{self:?}")))
    }

    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Touches of a hole: a tenth of the variance is between sensors, a tenth of the rest between holes.
    fn scores(mean: f64, n: usize) -> Scores {
        let all = 0.0386 * 0.0386;
        Scores {
            mean,
            n,
            expected: ExpectedMatch { mean: 0.9, touches: 0.81 * all, holes: 0.09 * all, sensors: 0.1 * all },
        }
    }

    #[test]
    fn without_holes_the_fit_is_that_of_the_calibration() {
        // -0.6 of four touches: by sqrt(0.19 + 0.81 / 4).
        let fit = SensorMatch::default().fit(scores(-0.6, 4));
        assert!((fit + 0.6 / 0.3925_f64.sqrt()).abs() < 1e-12, "{fit}");
        // As much variance again is of a part that the bank does not know.
        let mut unknown = scores(-0.6, 4);
        unknown.expected.holes += 0.0386 * 0.0386;
        let fit = SensorMatch::default().fit(unknown);
        assert!((fit + 0.6 / 0.69625_f64.sqrt()).abs() < 1e-12, "{fit}");
    }

    /// The posterior on a grid of offsets and factors, from the density of each hole's mean.
    #[test]
    fn holes_tell_what_the_posterior_on_a_grid_has() {
        let holes = [scores(0.8, 3), scores(1.1, 2), scores(0.6, 5), scores(0.9, 4)];
        let learnt = holes.iter().fold(SensorMatch::default(), |known, hole| known.with(*hole));
        let (mut total, mut offsets, mut factors) = (0.0, 0.0, 0.0);
        for i in 0..400 {
            let factor = 0.01 * (1.015_f64).powi(i); // up to 3.9; even in the logarithm
            for j in 0..601 {
                let offset = -0.06 + 0.0002 * f64::from(j);
                let mut log = -(SHAPE + 1.0) * factor.ln() - (SHAPE - 1.0) / factor + factor.ln();
                let normal = |x: f64, of: f64| -0.5 * (x * x / of + of.ln());
                log += normal(offset, factor * OFFSET_COSINE * OFFSET_COSINE);
                let each = |hole: &Scores| {
                    let ExpectedMatch { touches, holes, .. } = hole.expected;
                    normal(hole.mean * 0.0386 - offset, factor * (holes + touches / hole.n as f64))
                };
                log += holes.iter().map(each).sum::<f64>();
                let density = log.exp();
                total += density;
                offsets += density * offset;
                factors += density * factor;
            }
        }
        let (offset, factor) = (offsets / total, factors / total);
        assert!((learnt.offset - offset).abs() < 1e-4, "{learnt:?} {offset}");
        // The mean of an inverse gamma is its scale over its shape less one.
        let found = learnt.variance(scores(0.0, 1)) / (scores(0.0, 1).variance() + learnt.known().recip());
        assert!((found - factor).abs() < 0.02 * factor, "{found} {factor}");
    }

    #[test]
    fn a_wrong_name_moves_little_and_many_holes_make_it_sharp() {
        let good = scores(1.0, 3);
        let many = (0..20).fold(SensorMatch::default(), |known, _| known.with(good));
        assert!((many.offset - 0.0386).abs() < 0.002, "{many:?}");
        let stranger = scores(-0.5, 4);
        assert!(many.fit(stranger) < 2.0 * SensorMatch::default().fit(stranger));
        let wrong = many.with(scores(-50.0, 3));
        assert!(many.offset - wrong.offset < 0.004, "{wrong:?}");
    }

    #[test]
    fn a_part_that_the_bank_does_not_know_says_less_of_the_sensor() {
        let mut unknown = scores(1.0, 8);
        unknown.expected.holes += 0.0386 * 0.0386;
        let [known, unknown] = [scores(1.0, 8), unknown].map(|hole| SensorMatch::default().with(hole));
        assert!(unknown.weight < 0.3 * known.weight && unknown.offset < known.offset, "{known:?} {unknown:?}");
    }

    #[test]
    fn numbers_that_no_holes_tell_are_refused() {
        for sensor in [
            SensorMatch { offset: f64::NAN, n_holes: 1, ..SensorMatch::default() },
            SensorMatch { squares: -1.0, n_holes: 1, ..SensorMatch::default() },
            SensorMatch { offset: 1.0, ..SensorMatch::default() },
        ] {
            let error = sensor.validate().unwrap_err().to_string();
            assert!(error.starts_with("episode.sensor: expected numbers that Episode::learn returned"), "{error}");
        }
    }
}

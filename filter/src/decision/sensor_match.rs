//! How well the touches of this sensor match, learnt from the holes of a run that were named with confidence.
//!
//! A calibration over many sensors says what to expect of any; the cosines of one sensor differ from it by one offset and lie
//! nearer together. The holes of a run tell both: a normal offset of unknown variance with its conjugate prior (normal and
//! inverse gamma; Gelman et al., Bayesian Data Analysis, 3.3), in standard deviations of the calibration. The caller keeps the
//! value: it goes into [`EpisodeConfig::sensor`](crate::EpisodeConfig) and comes out of [`Episode::learn`](crate::Episode::learn).

use serde::{Deserialize, Serialize};
use tactile_infer::calibration::presence::{PresenceOdds, Verified};
use tactile_infer::maps::sensor_offset::{MOST_STRAIN, SensorOffset};
use tactile_infer::maps::strain::Strain;

use crate::decision::{Placed, VerifierOffset};
use crate::error::{Error, Result};
use crate::touch_model::{SHARED_VARIANCE, TouchModel};

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
    /// The sensor's offset, as estimated, standard deviations of the calibration.
    pub offset: f64,
    /// Touches that the offset is known from, counted as independent ones.
    pub weight: f64,
    /// Half the sum of squares about the offset, in those deviations squared.
    pub squares: f64,
    /// What a verifier says of its touches, where there is one.
    #[serde(skip_serializing_if = "VerifierOffset::is_none")]
    pub verifier: VerifierOffset,
    /// How much larger parts seem than [`TouchModel::sensor_strain`] has it, where there are maps.
    #[serde(skip_serializing_if = "SensorOffset::is_none")]
    pub strain: SensorOffset,
}

/// The mean of the standard scores of a hole's edged touches, and how many they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scores {
    pub(crate) mean: f64,
    pub(crate) n: usize,
}

/// The prior of a sensor under a calibration.
struct Prior {
    /// Variance of one sensor, share of the calibration's; the rest is between sensors.
    within: f64,
    /// Touches that an offset of zero counts as.
    weight: f64,
}

impl Prior {
    fn of(model: &TouchModel) -> Self {
        let within = (1.0 - model.matched_shared) / (1.0 - SHARED_VARIANCE);
        let reality = (OFFSET_COSINE / model.matched_sd).powi(2);
        Self { within, weight: within / reality }
    }
}

/// Touches of one hole that count as independent ones: they share a part of their variance.
pub(super) fn independent(n: f64) -> f64 {
    (SHARED_VARIANCE + (1.0 - SHARED_VARIANCE) / n).recip()
}

impl SensorMatch {
    /// The mean score of a hole's touches in standard deviations of such a mean, as this sensor's are expected.
    pub(crate) fn fit(&self, model: &TouchModel, scores: Scores) -> f64 {
        let variance = match self.n_holes {
            0 => model.matched_shared + (1.0 - model.matched_shared) / scores.n as f64,
            _ => self.variance(model, scores.n),
        };
        (scores.mean - self.offset) / variance.sqrt()
    }

    /// The variance of the mean of `n` scores of one hole about the offset, where holes were learnt from.
    fn variance(&self, model: &TouchModel, n: usize) -> f64 {
        let prior = Prior::of(model);
        let of_one = (prior.within * (SHAPE - 1.0) + self.squares) / (SHAPE - 1.0 + 0.5 * f64::from(self.n_holes));
        of_one * (independent(n as f64).recip() + (prior.weight + self.weight).recip())
    }

    /// With what one more confident hole tells, where the part that it is was found. `odds`: what a verifier's words are worth; `None`
    /// without one.
    pub(crate) fn with_hole(&self, model: &TouchModel, placed: &Placed, odds: Option<&PresenceOdds>) -> Self {
        let Some(scores) = placed.scores else { return *self };
        let of_scores = self.with(model, scores);
        let Some((verified, odds)) = placed.verified.zip(odds) else { return of_scores };
        let strain = |seems: Strain| self.strain.with_strain(&seems.without(model.sensor_strain));
        Self {
            verifier: self.verifier.with(model, &verified, odds.usual),
            strain: verified.strain.map_or(self.strain, strain),
            ..of_scores
        }
    }

    /// How much larger parts seem under this sensor, 1 for twice as long.
    pub(crate) fn strain(&self, model: &TouchModel) -> f64 {
        model.sensor_strain + self.strain.mean
    }

    /// What a verifier says, the strain and the misfit, less what is this sensor's. The misfit is what known touches tell alone: confident
    /// holes are those whose maps happen to be near.
    pub(crate) fn taken_off(&self, model: &TouchModel, verified: Verified) -> Verified {
        let strain = verified.strain.map(|strain| strain.without(self.strain(model)));
        let verified = verified.with_misfit_less(model.sensor_misfit);
        self.verifier.taken_off(model, Verified { strain, ..verified })
    }

    /// With what the scores of one more confident hole tell.
    fn with(&self, model: &TouchModel, scores: Scores) -> Self {
        let prior = Prior::of(model);
        let (weight, known) = (independent(scores.n as f64), prior.weight + self.weight);
        let most = MOST * self.variance(model, scores.n).sqrt();
        let apart = (scores.mean - self.offset).clamp(-most, most);
        Self {
            n_holes: self.n_holes.saturating_add(1),
            offset: self.offset + apart * weight / (known + weight),
            weight: self.weight + weight,
            squares: self.squares + 0.5 * apart * apart * weight * known / (known + weight),
            ..*self
        }
    }

    /// Refuses numbers that no holes tell.
    pub(crate) fn validate(&self) -> Result<()> {
        let is_told =
            self.offset.abs() < 1e6 && (0.0..1e12).contains(&self.weight) && (0.0..1e12).contains(&self.squares);
        let is_told = is_told && self.verifier.is_valid() && self.strain.is_within(MOST_STRAIN);
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

    fn model() -> TouchModel {
        TouchModel { matched_sd: 0.0386, matched_shared: 0.19, ..TouchModel::default() }
    }

    #[test]
    fn without_holes_the_fit_is_that_of_the_calibration() {
        // -0.6 of four touches: by sqrt(0.19 + 0.81 / 4).
        let fit = SensorMatch::default().fit(&model(), Scores { mean: -0.6, n: 4 });
        assert!((fit + 0.6 / 0.3925_f64.sqrt()).abs() < 1e-12, "{fit}");
    }

    /// The posterior on a grid of offsets and variances, from the density of each hole's mean.
    #[test]
    fn holes_tell_what_the_posterior_on_a_grid_has() {
        let model = model();
        let holes = [(0.8, 3), (1.1, 2), (0.6, 5), (0.9, 4)];
        let learnt = holes
            .iter()
            .fold(SensorMatch::default(), |known, (mean, n)| known.with(&model, Scores { mean: *mean, n: *n }));
        let prior = Prior::of(&model);
        let (mut total, mut offsets, mut variances) = (0.0, 0.0, 0.0);
        for i in 0..400 {
            let variance = 0.01 * (1.015_f64).powi(i); // up to 3.9; even in the logarithm
            for j in 0..601 {
                let offset = -1.5 + 0.005 * f64::from(j);
                let mut log = -(SHAPE + 1.0) * variance.ln() - prior.within * (SHAPE - 1.0) / variance + variance.ln();
                let normal = |x: f64, of: f64| -0.5 * (x * x / of + of.ln());
                log += normal(offset, variance / prior.weight);
                log +=
                    holes.iter().map(|(mean, n)| normal(mean - offset, variance / independent(*n as f64))).sum::<f64>();
                let density = log.exp();
                total += density;
                offsets += density * offset;
                variances += density * variance;
            }
        }
        let (offset, variance) = (offsets / total, variances / total);
        assert!((learnt.offset - offset).abs() < 2e-3, "{learnt:?} {offset}");
        // The mean of an inverse gamma is its scale over its shape less one.
        let of_one = learnt.variance(&model, 1) / (1.0 + (prior.weight + learnt.weight).recip());
        assert!((of_one - variance).abs() < 0.02 * variance, "{of_one} {variance}");
    }

    #[test]
    fn a_wrong_name_moves_little_and_many_holes_make_it_sharp() {
        let model = model();
        let good = Scores { mean: 1.0, n: 3 };
        let many = (0..20).fold(SensorMatch::default(), |known, _| known.with(&model, good));
        assert!((many.offset - 1.0).abs() < 0.05, "{many:?}");
        let stranger = Scores { mean: -0.5, n: 4 };
        assert!(many.fit(&model, stranger) < 2.0 * SensorMatch::default().fit(&model, stranger));
        let wrong = many.with(&model, Scores { mean: -50.0, n: 3 });
        assert!(many.offset - wrong.offset < 0.1, "{wrong:?}");
    }

    #[test]
    fn numbers_that_no_holes_tell_are_refused() {
        for sensor in [
            SensorMatch { offset: f64::NAN, n_holes: 1, ..SensorMatch::default() },
            SensorMatch { squares: -1.0, n_holes: 1, ..SensorMatch::default() },
            SensorMatch { offset: 1.0, ..SensorMatch::default() },
            SensorMatch { n_holes: 1, verifier: VerifierOffset { nats: -2.0, weight: 0.0 }, ..SensorMatch::default() },
            SensorMatch { n_holes: 1, strain: SensorOffset { mean: 0.1, information: 0.0 }, ..SensorMatch::default() },
        ] {
            let error = sensor.validate().unwrap_err().to_string();
            assert!(error.starts_with("episode.sensor: expected numbers that Episode::learn returned"), "{error}");
        }
    }
}

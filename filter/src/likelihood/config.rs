//! How similarities become probabilities: the settings, and what a calibration and a bank say of them.

use serde::{Deserialize, Serialize};
use tactile_data::touch::Side;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::calibration::{BLANK_SHARE, Calibration, Spread};
use tactile_infer::views::Views;

use crate::error::{Error, Result};
use crate::likelihood::interpolation::Interpolation;
use crate::likelihood::overlap::Overlap;

/// How similarities become probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LikelihoodConfig {
    /// tau: the difference of cosine that changes a probability by a factor e. Positive.
    pub temperature: f64,
    /// Share of the touches that look like any view rather than like their own, 0 to below 1: a slip, a crumb. It bounds
    /// what one touch can cost a state, to the log of it. Zero: one bad match can rule a state out for good.
    pub outlier_share: f64,
    /// A view with a smaller share of edge pixels is blank, 0..=1. Zero: no view is blank.
    pub blank_share: f32,
    /// Probability that hole and peg at one pose are both blank or both edged; above 0 and below 1.
    pub blank_agreement: f64,
    /// Where the nearest recorded view is taken: how far from its pose it is still trusted wholly, in steps of the
    /// grid; positive.
    /// No pose inside the recorded area is farther than 0.71 steps, so 1 trusts every view.
    pub nearest_tolerance: f64,
    /// How views between recorded poses are judged.
    pub interpolation: Interpolation,
    /// Where views are interpolated, one view in five outside the recorded area is as likely as a recorded one whose cosine
    /// with an edged touch is this, -1..=1. The others, and all where it is `None` or views are not interpolated: as an
    /// average recorded one, the same for every touch.
    pub unknown_similarity: Option<f64>,
    /// What a part's fit is measured by ([`crate::Estimate::fit`]): the cosine of an edged touch with the view that it was
    /// made at, mean ...
    pub matched_mean: f64,
    /// ... and standard deviation, positive ...
    pub matched_sd: f64,
    /// ... of whose square the touches of one hole have this share in common, 0..=1: the same print, the same sensor ...
    pub matched_shared: f64,
    /// ... of a bank with such views. In one of others a part's own mean counts, as far as it is known.
    pub matched_views: Views,
    /// Share of their error that the touches of one hole have in common where they match their views well, 0..=1: the same
    /// print, the same network; up to six times as much, and at most 1, the worse their best matches are. Zero: all they say
    /// is multiplied. Else n touches count as n / (1 + share (n - 1)), each likelihood taken to that power of n, as the mean
    /// of n numbers of which any two correlate so much.
    pub shared_error: f64,
    /// Touches nearer than this share evidence, mm, not negative; zero: all count as independent.
    pub overlap_mm: f64,
    /// Touches at one place turned by less than this share evidence, degrees; positive.
    pub overlap_deg: f64,
}

impl Default for LikelihoodConfig {
    /// Bounded, blank-aware. Temperature and share of outliers for a model without calibration; agreement from 94-99 %
    /// measured at equal poses.
    fn default() -> Self {
        Self {
            temperature: 0.03,
            outlier_share: 0.02,
            blank_share: BLANK_SHARE,
            blank_agreement: 0.96,
            nearest_tolerance: 0.25,
            interpolation: Interpolation::Auto,
            unknown_similarity: Some(0.74),
            matched_mean: 0.94,
            matched_sd: 0.03,
            matched_shared: SHARED_VARIANCE,
            matched_views: Views::Pegs,
            shared_error: 0.05,
            overlap_mm: 3.0,
            overlap_deg: 15.0,
        }
    }
}

impl LikelihoodConfig {
    /// The paper's weight (Eq. 2, Alg. 1 line 14) read as log-likelihood = cosine / temperature, at the temperature
    /// that is best for Alg. 1: no outliers, no blank views, every view inside the recorded area trusted.
    pub fn paper() -> Self {
        Self {
            temperature: PAPER_TEMPERATURE,
            outlier_share: 0.0,
            blank_share: 0.0,
            nearest_tolerance: 1.0,
            interpolation: Interpolation::Nearest,
            unknown_similarity: None,
            shared_error: 0.0,
            overlap_mm: 0.0,
            ..Self::default()
        }
    }

    /// The defaults with what was measured of a model where this side is touched, where it was. A model without a
    /// calibration for touched pegs is believed as for holes: measured, the two hardly differ (`infer/NOTES.md`).
    ///
    /// The share of outliers never falls below the default: few touches of a calibration have any.
    pub fn of_side(model: &Model, side: Side) -> Self {
        let default = Self::default();
        let Some(calibration) = calibration_of(model, side) else { return default };
        let Spread { mean, sd } = calibration.matched.unwrap_or_else(|| matched_by_best(calibration, &default));
        let matched = Spread { mean, sd: sd.max(LEAST_SD) };
        Self {
            temperature: calibration.temperature,
            outlier_share: calibration.outlier_share.max(default.outlier_share),
            blank_agreement: calibration.blank_agreement.clamp(0.5, default.blank_agreement),
            unknown_similarity: Some(unknown_similarity(matched, calibration.low_similarity)),
            matched_mean: matched.mean,
            matched_sd: matched.sd,
            matched_shared: shared_variance(calibration),
            matched_views: calibration.views,
            ..default
        }
    }

    /// [`Self::of_side`] where holes are touched.
    pub fn of(model: &Model) -> Self {
        Self::of_side(model, Side::Hole)
    }

    /// The same where a bank compares embeddings in a metric of its own: what was measured by the cosine alone, scaled as the
    /// bank's own touches are. Half of what these ask for counts, on a logarithmic scale: how much of it another sensor
    /// leaves is not known (`NOTES.md`).
    #[must_use]
    pub fn in_metric_of(&self, bank: &Bank) -> Self {
        let Some(metric) = bank.metric() else { return *self };
        let scaled = |cosine: f64| (1.0 - metric.counted_scale() * (1.0 - cosine)).max(-1.0);
        let calibrated = metric.counted_scale() * self.temperature;
        Self {
            temperature: metric.measured().temperature.map_or(calibrated, |own| (own * calibrated).sqrt()),
            unknown_similarity: self.unknown_similarity.map(scaled),
            matched_mean: scaled(self.matched_mean),
            matched_sd: metric.counted_scale() * self.matched_sd,
            ..*self
        }
    }

    /// Refuses numbers outside their ranges.
    pub fn validate(&self) -> Result<()> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let check = |name: &str, expected: &str, got: f64, fine: bool| {
            if fine { Ok(()) } else { Err(Error::config(format!("likelihood.{name}"), expected, got.to_string())) }
        };
        check("temperature", "a positive number", self.temperature, positive(self.temperature))?;
        check("outlier_share", "0 to below 1", self.outlier_share, (0.0..1.0).contains(&self.outlier_share))?;
        let share = f64::from(self.blank_share);
        check("blank_share", "0..=1", share, (0.0..=1.0).contains(&share))?;
        let agreement = self.blank_agreement;
        check("blank_agreement", "above 0 and below 1", agreement, agreement > 0.0 && agreement < 1.0)?;
        check("nearest_tolerance", "a positive number", self.nearest_tolerance, positive(self.nearest_tolerance))?;
        let cosines = -1.0..=1.0;
        if let Some(unknown) = self.unknown_similarity {
            check("unknown_similarity", "-1..=1", unknown, cosines.contains(&unknown))?;
        }
        check("matched_mean", "-1..=1", self.matched_mean, cosines.contains(&self.matched_mean))?;
        check("matched_sd", "a positive number", self.matched_sd, positive(self.matched_sd))?;
        check("matched_shared", "0..=1", self.matched_shared, (0.0..=1.0).contains(&self.matched_shared))?;
        check("shared_error", "0..=1", self.shared_error, (0.0..=1.0).contains(&self.shared_error))?;
        let apart = self.overlap_mm.is_finite() && self.overlap_mm >= 0.0;
        check("overlap_mm", "a number, not negative", self.overlap_mm, apart)?;
        check("overlap_deg", "a positive number", self.overlap_deg, positive(self.overlap_deg))
    }

    /// How touches share evidence.
    pub fn overlap(&self) -> Overlap {
        Overlap { mm: self.overlap_mm, deg: self.overlap_deg }
    }

    /// Whether a view with this share of edge pixels is blank.
    pub fn is_blank(&self, edge_share: f32) -> bool {
        edge_share < self.blank_share
    }
}

/// The temperature at which Alg. 1 as printed, with the shipped model, names most of the tuning letters M to X after 3,
/// 5 and 10 touches at recorded poses, the columns of the paper's tables: on average 93.8 % of the large ones in 2,000
/// episodes. Between 0.04 and 0.1 93 to 94 %, which chance explains; 92.3 at 0.03, 88.7 at 0.13. It names all of the
/// small ones from 0.02 to 0.08.
const PAPER_TEMPERATURE: f64 = 0.08;

/// What was measured of a model where a side is touched; without it, what was measured where holes are.
pub(crate) fn calibration_of(model: &Model, side: Side) -> Option<&Calibration> {
    model.calibration(side).or_else(|| model.calibration(Side::Hole))
}

/// The cosine with the view touched, of a calibration made before that was measured. It says which best cosine 99 in 100
/// touches reach: were they normal, it is 2.33 standard deviations below the mean.
fn matched_by_best(calibration: &Calibration, default: &LikelihoodConfig) -> Spread {
    let sd = calibration.gap.map_or(default.matched_sd, |gap| gap.sd.max(default.matched_sd));
    Spread { mean: (f64::from(calibration.low_similarity) + 2.33 * sd).min(default.matched_mean), sd }
}

/// Share of the cosines' variance that the touches of one hole under one sensor have in common: the same print, the same
/// network. On the tuning letters anywhere the mean of eight has a standard deviation of 0.015, each one of 0.034.
const SHARED_VARIANCE: f64 = 0.1;

/// The share with what sensors differ by, which all touches of one have in common.
fn shared_variance(calibration: &Calibration) -> f64 {
    match (calibration.between_sensors, calibration.matched) {
        (Some(between), Some(matched)) if matched.sd > 0.0 => {
            let between = (between / matched.sd).powi(2).min(1.0);
            between + (1.0 - between) * SHARED_VARIANCE
        }
        _ => SHARED_VARIANCE,
    }
}

/// Few touches may agree by chance; cosines of no sensor lie nearer together.
const LEAST_SD: f64 = 0.01;

/// A recorded view whose cosine is so many standard deviations below that of the view touched is less likely than one that
/// nobody recorded. With 4 more parts of the bank are taken for none of these (`NOTES.md`).
const UNKNOWN_SDS: f64 = 5.0;

/// The cosine as which a view counts that nobody recorded. Few touches of one sensor may lie near together, yet one in a
/// hundred is below the low similarity: what is unknown is no likelier than those.
fn unknown_similarity(matched: Spread, low_similarity: f32) -> f64 {
    (matched.mean - UNKNOWN_SDS * matched.sd).min(f64::from(low_similarity)).max(-1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_nobody_recorded_is_no_likelier_than_the_worst_match_in_a_hundred() {
        // Over many sensors five standard deviations are far; of ten touches of one they are near.
        for (mean, sd, low, unknown) in
            [(0.907, 0.0386, 0.744, 0.714), (0.97, 0.01, 0.78, 0.78), (-0.9, 0.1, 0.5, -1.0)]
        {
            let found = unknown_similarity(Spread { mean, sd }, low);
            assert!((found - unknown).abs() < 1e-6, "{found} {unknown}");
        }
    }
}

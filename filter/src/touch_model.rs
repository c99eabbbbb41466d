//! What the filter takes a touch to say: what a calibration or a bank measured, and what is fixed, each with its reason.
//!
//! A user sets none of it. On which parts each fixed number was chosen is in `filter/eval/NOTES.md`; T are the letters M to X.

use tactile_data::touch::Side;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::calibration::{BLANK_SHARE, Calibration, Spread};
use tactile_infer::views::Views;

use crate::error::Result;
use crate::likelihood::Overlap;
use crate::likelihood::interpolation::Interpolation;
use crate::number::{Range, numbers};

numbers! {
    /// How similarities become probabilities, how touches share evidence, and what else is measured or fixed.
    pub struct TouchModel in "touch_model" {
        /// tau: the difference of cosine that changes a probability by a factor e.
        temperature: f64 = 0.03, "cosine", Range::POSITIVE,
            Measured: "calibration; in a bank that learns the geometric mean of that, scaled, and the bank's own";
            "one touch says too much, or nothing";
        /// Share of the touches that look like any view rather than like their own: a slip, a crumb. It bounds what one
        /// touch can cost a state, to the log of it. Zero: one bad match can rule a state out for good.
        outlier_share: f64 = 0.02, "", Range::BELOW_ONE,
            Fixed: "T small, T large, T small rough, T connectors, outlines 77; a calibration may only raise it, since slips \
                and crumbs are not among its touches"; "one bad touch rules the part out";
        /// A view with a smaller share of edge pixels is blank. Zero: no view is blank.
        blank_share: f32 = BLANK_SHARE, "", Range::SHARE,
            Fixed: "network and bank are made with it"; "noise is taken for an edge";
        /// Probability that hole and peg at one pose are both blank or both edged.
        blank_agreement: f64 = 0.96, "", Range::INSIDE,
            Fixed: "94 to 99 % at equal poses of a prototype; a calibration may only lower it"; "a wrong blank view rules a state out";
        /// Where the nearest recorded view is taken: how far from its pose it is still trusted wholly. No pose inside the
        /// recorded area is farther than 0.71 steps, so 1 trusts every view.
        nearest_tolerance: f64 = 0.25, "steps of the grid", Range::POSITIVE,
            Fixed: "not noted; coarse banks alone"; "a view is believed where it is not seen";
        /// Where views are interpolated, one view in five outside the recorded area is as likely as a recorded one whose
        /// cosine with an edged touch is this. The others, and all where it is none or views are not interpolated: as an
        /// average recorded one, the same for every touch.
        unknown_similarity: Option<f64> = Some(0.74), "cosine", Range::COSINE,
            Measured: "5 standard deviations below the match, at most the warning's cosine";
            "a touch whose view was not recorded speaks for the best of the recorded ones";
        /// What a part's fit is measured by ([`crate::Estimate::fit`]): the cosine of an edged touch with the view that it
        /// was made at, mean ...
        matched_mean: f64 = 0.94, "cosine", Range::COSINE,
            Measured: "calibration; of each part the lower of that and the bank's"; "a present part is refused";
        /// ... and standard deviation ...
        matched_sd: f64 = 0.03, "cosine", Range::POSITIVE,
            Measured: "calibration; of each part the larger of that and the bank's"; "a present part is refused";
        /// ... of whose square the touches of one hole have this share in common: the same print, the same sensor.
        matched_shared: f64 = SHARED_VARIANCE, "", Range::SHARE,
            Measured: "calibration over sensors; 0.1 of it is fixed (T small anywhere)"; "many touches refuse a present part";
        /// Share of their error that the touches of one hole have in common where they match their views well: the same
        /// print, the same network; up to six times as much, and at most 1, the worse their best matches are. Zero: all they
        /// say is multiplied. Else n touches count as n / (1 + share (n - 1)), each likelihood taken to that power of n, as
        /// the mean of n numbers of which any two correlate so much.
        shared_error: f64 = 0.05, "", Range::SHARE,
            Fixed: "T small, T large, T small over a wide area, both rough, T connectors, outlines 77; banks of pegs and of both \
                sides"; "ten touches are surer than they are right";
        /// Touches nearer than this share evidence; zero: all count as independent.
        overlap_mm: f64 = 3.0, "mm", Range::NOT_NEGATIVE,
            Fixed: "not noted; other settings of that time on T small and large"; "a touch made twice counts twice";
        /// Touches at one place turned by less than this share evidence.
        overlap_deg: f64 = 15.0, "degrees", Range::POSITIVE,
            Fixed: "not noted; other settings of that time on T small and large"; "a touch made twice counts twice";
        /// To be confident the fit of `n` touches ([`crate::Estimate::n_fitted`]) must be at least
        /// `none_fit + fit_margin / sqrt(n)`. Large: parts that are not in the bank are recognised, at the price of touches.
        fit_margin: f64 = 4.6, "standard deviations", Range::NOT_NEGATIVE,
            Fixed: "T small, T large, both rough, outlines 77, three times the noise"; "one touch is sure of a stranger";
        /// A fit below `none_fit` means none of these parts from this many touches on, where it is of more than one of them
        /// ([`crate::Estimate::n_fitted`]). With 1 the fit of the first touch is enough.
        none_touches: usize = 4, "", Range::COUNT,
            Fixed: "not noted; other thresholds of that time on T small and T large"; "one bad touch refuses a present part";
        /// An estimate warns where no edged touch reached this cosine with any recorded view.
        low_similarity: f32 = 0.8, "cosine", Range::COSINE,
            Measured: "calibration: what 99 in 100 touches reach; without one, T small, and real presses with a bank of A to L";
            "no warning of what resembles nothing";
        /// A touch keeps at least this far from every earlier one ...
        min_separation_mm: f64 = 4.0, "mm", Range::NOT_NEGATIVE,
            Fixed: "T small; 12 mm drove touches out of the recorded area of small parts"; "the next touch says the same again";
        /// ... or is turned against it by at least this much. None: by a full turn, which counts only once the separation
        /// was halved.
        min_separation_deg: Option<f64> = None, "degrees", Range::NOT_NEGATIVE,
            Fixed: "not noted"; "a place is touched again at another angle before a new one";
        /// delta_act: a motion counts only from those supposed states where it would show a larger share of edge pixels.
        contact_threshold: f32 = 0.01, "", Range::SHARE,
            Fixed: "as `blank_share`"; "the next touch is made where nothing is felt";
    }
    more {
        /// How views between recorded poses are judged.
        interpolation: Interpolation = Interpolation::Auto;
        /// What the views of the bank are of that `matched_mean` and `matched_sd` were measured with. In a bank of others a
        /// part's own mean counts, as far as it is known.
        matched_views: Views = Views::Pegs;
    }
}

impl TouchModel {
    /// The paper's weight (Eq. 2, Alg. 1 line 14) read as log-likelihood = cosine / temperature, at the temperature
    /// that is best for Alg. 1: no outliers, no blank views, every view inside the recorded area trusted, any pose touched.
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
            min_separation_mm: 0.0,
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
            low_similarity: calibration.low_similarity,
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
        self.check_ranges()
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
/// touches reach: of normal cosines, 2.33 standard deviations below the mean.
fn matched_by_best(calibration: &Calibration, default: &TouchModel) -> Spread {
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

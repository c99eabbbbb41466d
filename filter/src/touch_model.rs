//! What the filter takes a touch to say: what a calibration or a bank measured, and what is fixed, each with its reason.
//!
//! A user sets none of it. On which parts each fixed number was chosen is in `filter/eval/NOTES.md`; T are the letters M to X.

use tactile_data::dataset::touch::Side;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::bank::views::Views;
use tactile_infer::calibration::match_odds::OUTLIER_SHARE;
use tactile_infer::calibration::own_by_edge::OwnByEdge;
use tactile_infer::calibration::presence::{PresenceOdds, Tail};
use tactile_infer::calibration::{BLANK_SHARE, Calibration, OfVerifier, Spread};
use tactile_infer::maps::Maps;

use crate::error::Result;
use crate::likelihood::interpolation::Interpolation;
use crate::number::{Range, numbers};

numbers! {
    /// How similarities become probabilities, how touches share evidence, and what else is measured or fixed.
    pub struct TouchModel in "touch_model" {
        /// The log-odds that a touch was made at a view, where it is as rare as the average touch and as far from the view as
        /// touches are from their own.
        match_offset: f64 = 11.3, "nats", Range::ANY,
            Measured: "fit; without one, the shipped model's"; "what nobody recorded is likelier than what was, or never likely";
        /// How much a distance of 1 between touch and view costs, where a usual share of the touch is edge.
        steepness: f64 = 20.8, "nats", Range::POSITIVE,
            Measured: "fit, times what a calibration of the user's sensor says; without a fit, the shipped model's";
            "one touch says too much, or nothing";
        /// By which power of its share of edge a touch is steeper.
        steepness_by_edge: f64 = 0.21, "", Range::ANY,
            Measured: "fit; without one, the shipped model's"; "a touch that shows hardly any edge is as sure as others";
        /// How far touches are from their own views, in a bank that does not know it of its parts.
        own_distance: f64 = 0.4, "", Range::DISTANCE,
            Measured: "fit; without one, the shipped model's"; "what nobody recorded is likelier than what was, or never likely";
        /// By which power of that over its own a bank's distances count: where touches are far from their own views, under a
        /// rough sensor, a distance says less.
        distance_by_own: f64 = 0.42, "", Range::ANY,
            Measured: "fit; without one, the shipped model's"; "a rough sensor's touches say too much";
        /// b: so much farther touches with less edge are from their own views, `own exp(-b (l - usual_edge))` by the logarithm `l` of the edge
        /// ([`log_edge`](tactile_infer::calibration::match_odds::MatchOdds::log_edge)).
        own_by_edge: f64 = 0.0, "", Range::BY_EDGE,
            Measured: "`tactile-infer calibrate`; else 0"; "a rough sensor's touches at a rim are believed too much, and chosen";
        /// The `l` at which touches are as far as on average.
        usual_edge: f64 = 0.0, "", Range::ANY,
            Measured: "`tactile-infer calibrate`"; "touches are taken to be farther off, or nearer, than they are";
        /// Share of the touches that are of something else than they were meant for: a slip, a crumb. It bounds what one
        /// touch can cost a state, to the log of it. Zero: one bad match can rule a state out for good.
        outlier_share: f64 = OUTLIER_SHARE, "", Range::BELOW_ONE,
            Fixed: "slips and crumbs are not simulated"; "one bad touch rules the part out";
        /// Alg. 1 as printed instead of all these: the log-likelihood is the cosine over this.
        temperature: Option<f64> = None, "cosine", Range::POSITIVE,
            Fixed: "T large, 2,000 episodes; the paper's method alone"; "Alg. 1 cannot be compared with";
        /// A touch with a smaller share of edge pixels is blank: nothing was felt. Zero: no touch is blank.
        blank_share: f32 = BLANK_SHARE, "", Range::SHARE,
            Fixed: "network and bank are made with it"; "noise is taken for an edge";
        /// Where the nearest recorded view is taken: how far from its pose it is still trusted wholly. No pose inside the
        /// recorded area is farther than 0.71 steps, so 1 trusts every view.
        nearest_tolerance: f64 = 0.25, "steps of the grid", Range::POSITIVE,
            Fixed: "not noted; coarse banks alone"; "a view is believed where it is not seen";
        /// What a part's fit is measured by ([`crate::Estimate::fit`]): the cosine of an edged touch with the view that it
        /// was made at, mean ...
        matched_mean: f64 = 0.94, "cosine", Range::COSINE,
            Measured: "the bank, of each part; where it does not know, or of the user's own sensor, the calibration"; "a present part is refused";
        /// ... and standard deviation ...
        matched_sd: f64 = 0.03, "cosine", Range::POSITIVE,
            Measured: "calibration; of each part the larger of that and the bank's"; "a present part is refused";
        /// ... of whose square the touches of one hole have this share in common: the same print, the same sensor.
        matched_shared: f64 = SHARED_VARIANCE, "", Range::SHARE,
            Measured: "calibration over sensors; 0.1 of it is fixed (T small anywhere)"; "many touches refuse a present part";
        /// Touches so far from each other, or turned by a radian, have all but 1 / e of their error for themselves: the likelihood
        /// of a touch is taken to the power of `1 - exp(-sqrt((d / shared_mm)^2 + turn^2))` by the earlier touch nearest to it.
        /// Zero: all they say is multiplied.
        shared_mm: f64 = 8.0, "mm", Range::NOT_NEGATIVE,
            Fixed: "fitted: MAZE parts 0 to 11 and 36 to 47, banks of pegs and of both sides, four sensors each";
            "ten touches are surer than they are right, and a touch made twice counts twice";
        /// The log-odds that a named part is there, against a stranger ([`crate::Estimate::presence`],
        /// [`PresenceOdds`]), where no verifier judges: of no touch ...
        presence_offset: f64 = 0.14, "nats", Range::ANY,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "a stranger is named, or nothing is";
        /// ... by the fit and the root of the number of touches that it is of ...
        presence_by_fit: f64 = 0.68, "nats", Range::ANY,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "a stranger is named, or nothing is";
        /// ... and by each of these touches.
        presence_by_touch: f64 = 0.74, "nats", Range::ANY,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "one touch is as sure as ten";
        /// Ten in a hundred strangers come to log-odds beyond this at one of their touches ...
        stranger_at: f64 = 0.26, "nats", Range::ANY,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "no rate is promised";
        /// ... by so much on average ...
        stranger_scale: f64 = 0.99, "nats", Range::POSITIVE,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "no rate is promised";
        /// ... where they are compared with so many parts.
        stranger_parts: f64 = 11.0, "", Range::POSITIVE,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "a large bank names strangers";
        /// Ten in a hundred parts that are there come to log-odds below the negative of this ...
        present_at: f64 = 0.69, "nats", Range::ANY,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "parts that are there are refused";
        /// ... by so much on average.
        present_scale: f64 = 1.83, "nats", Range::POSITIVE,
            Measured: "`tactile-filter certify`; without it, the shipped model's"; "parts that are there are refused";
        /// What a verifier says of a touch of this sensor more than of a simulated one ...
        verifier_offset: f64 = 0.0, "nats", Range::ANY,
            Measured: "`tactile-infer calibrate --maps`; else the confident holes of a run tell it"; "parts that are pressed deeper than the bank's are refused";
        /// ... as it is known from so many touches: presses a millimetre deeper than the bank's are some 4 nats off, a touch varies by 2.
        verifier_touches: f64 = 0.25, "touches", Range::POSITIVE,
            Measured: "`tactile-infer calibrate --maps`; else (2 / 4)^2, MAZE parts 0 to 11, six drawn sensors"; "a run learns it too late";
        /// How much larger along both axes parts seem under this sensor than under a simulated one.
        sensor_strain: f64 = 0.0, "", Range::STRAIN,
            Measured: "`tactile-infer calibrate --maps`; else the confident holes of a run tell it"; "parts that are pressed deeper than the bank's are refused";
        /// How much farther off than usual their maps are under this sensor.
        sensor_misfit: f64 = 0.0, "nats", Range::MISFIT,
            Measured: "`tactile-infer calibrate --maps`; else the confident holes of a run tell it"; "parts that are pressed deeper than the bank's are refused";
        /// An estimate warns where no edged touch reached this cosine with any recorded view.
        low_similarity: f32 = 0.8, "cosine", Range::COSINE,
            Measured: "calibration: what 99 in 100 touches reach; without one, T small, and real presses with a bank of A to L";
            "no warning of what resembles nothing";
        /// A touch keeps at least this far from every earlier one.
        min_separation_mm: f64 = 4.0, "mm", Range::NOT_NEGATIVE,
            Fixed: "T small; 12 mm drove touches out of the recorded area of small parts"; "the next touch says the same again";
    }
    more {
        /// How views between recorded poses are judged.
        interpolation: Interpolation = Interpolation::Auto;
        /// Where `matched_mean` and `matched_sd` are of the user's own sensor: what the views of the bank were of that they were
        /// measured with. In a bank of such views a part matches no better than that; in others its own mean counts.
        sensor_views: Option<Views> = None;
    }
}

impl TouchModel {
    /// The paper's weight (Eq. 2, Alg. 1 line 14) read as log-likelihood = cosine / temperature, at the temperature
    /// that is best for Alg. 1: no outliers, no blank views, every view inside the recorded area trusted, any pose touched.
    pub fn paper() -> Self {
        Self {
            temperature: Some(PAPER_TEMPERATURE),
            outlier_share: 0.0,
            nearest_tolerance: 1.0,
            interpolation: Interpolation::Nearest,
            shared_mm: 0.0,
            min_separation_mm: 0.0,
            ..Self::default()
        }
    }

    /// The defaults with what was fitted and measured of a model where this side is touched, where it was. A model without a
    /// calibration for touched pegs is believed as for holes.
    pub fn of_side(model: &Model, side: Side) -> Self {
        let mut of_model = Self::default();
        if let Some(odds) = model.match_odds(side).or_else(|| model.match_odds(Side::Hole)) {
            of_model = Self {
                match_offset: odds.offset,
                steepness: odds.steepness,
                steepness_by_edge: odds.steepness_by_edge,
                own_distance: odds.own_distance,
                distance_by_own: odds.distance_by_own,
                ..of_model
            };
        }
        if let Some(odds) = model.presence(side).or_else(|| model.presence(Side::Hole)) {
            of_model = of_model.with_presence(odds);
        }
        let Some(calibration) = calibration_of(model, side) else { return of_model };
        let maps = model.maps().map(Maps::sha256);
        let of_verifier =
            calibration.verifier.as_ref().filter(|of| maps.is_some_and(|sha256| **sha256 == *of.maps_sha256));
        if let Some(OfVerifier { nats, n_touches, strain, misfit, .. }) = of_verifier {
            let known = of_model.verifier_touches + *n_touches as f64;
            of_model.verifier_offset = nats * *n_touches as f64 / known;
            of_model.sensor_strain = *strain;
            of_model.sensor_misfit = *misfit;
            of_model.verifier_touches = (known.recip() + CHOSEN).recip();
        }
        let default = Spread { mean: of_model.matched_mean, sd: of_model.matched_sd };
        let Spread { mean, sd } = calibration.matched.unwrap_or(default);
        Self {
            matched_mean: mean,
            matched_sd: sd.max(LEAST_SD),
            matched_shared: shared_variance(calibration),
            sensor_views: calibration.prior.map(|_| calibration.views),
            low_similarity: calibration.low_similarity,
            steepness: of_model.steepness * calibration.steepness.unwrap_or(1.0),
            own_by_edge: calibration.own_by_edge.map_or(of_model.own_by_edge, |own| own.by_edge),
            usual_edge: calibration.own_by_edge.map_or(of_model.usual_edge, |own| own.usual_edge),
            ..of_model
        }
    }

    /// [`Self::of_side`] where holes are touched.
    pub fn of(model: &Model) -> Self {
        Self::of_side(model, Side::Hole)
    }

    /// The same where a bank compares embeddings in a metric of its own: what was measured by the cosine alone, scaled as the
    /// bank's own touches are. Half of that counts, on a logarithmic scale: how much of it another sensor leaves is not known
    /// (`NOTES.md`).
    #[must_use]
    pub fn in_metric_of(&self, bank: &Bank) -> Self {
        let Some(metric) = bank.metric() else { return *self };
        let scale = metric.counted_scale();
        Self {
            matched_mean: (1.0 - scale * (1.0 - self.matched_mean)).max(-1.0),
            matched_sd: scale * self.matched_sd,
            ..*self
        }
    }

    /// The same with these log-odds that a named part is there.
    fn with_presence(self, odds: &PresenceOdds) -> Self {
        Self {
            presence_offset: odds.offset,
            presence_by_fit: odds.by_fit,
            presence_by_touch: odds.by_touch,
            stranger_at: odds.strangers.at,
            stranger_scale: odds.strangers.scale,
            stranger_parts: odds.n_parts,
            present_at: odds.present.at,
            present_scale: odds.present.scale,
            ..self
        }
    }

    /// The log-odds that a named part is there, where no verifier judges.
    pub(crate) fn presence(&self) -> PresenceOdds {
        PresenceOdds {
            offset: self.presence_offset,
            by_fit: self.presence_by_fit,
            by_touch: self.presence_by_touch,
            by_verifier: 0.0,
            by_expected: 0.0,
            by_size: 0.0,
            by_strain: 0.0,
            by_misfit: 0.0,
            shared: None,
            usual: 0.0,
            usual_misfit: 0.0,
            strangers: Tail { at: self.stranger_at, scale: self.stranger_scale },
            present: Tail { at: self.present_at, scale: self.present_scale },
            n_parts: self.stranger_parts,
            n_strangers: 0,
            n_present: 0,
        }
    }

    /// Refuses numbers outside their ranges.
    pub fn validate(&self) -> Result<()> {
        self.check_ranges()
    }

    /// How far a touch with this share of edge is from its own view, where touches are so far on average.
    pub(crate) fn own_at(&self, own_distance: f64, edge_share: f32) -> f64 {
        own_distance * OwnByEdge { by_edge: self.own_by_edge, usual_edge: self.usual_edge }.factor(edge_share)
    }

    /// Whether a touch, or a view, with this share of edge pixels is blank.
    pub fn is_blank(&self, edge_share: f32) -> bool {
        edge_share < self.blank_share
    }
}

/// The temperature at which Alg. 1 as printed, with the shipped model, names most of the tuning letters M to X after 3,
/// 5 and 10 touches at recorded poses, the columns of the paper's tables: on average 93.8 % of the large ones in 2,000
/// episodes. Between 0.04 and 0.1 93 to 94 %, which chance explains; 92.3 at 0.03, 88.7 at 0.13. It names all of the
/// small ones from 0.02 to 0.08.
pub(crate) const PAPER_TEMPERATURE: f64 = 0.08;

/// What was measured of a model where a side is touched; without it, what was measured where holes are.
pub(crate) fn calibration_of(model: &Model, side: Side) -> Option<&Calibration> {
    model.calibration(side).or_else(|| model.calibration(Side::Hole))
}

/// Share of the cosines' variance that the touches of one hole under one sensor have in common: the same print, the same
/// network. On the tuning letters anywhere the mean of eight has a standard deviation of 0.015, each one of 0.034.
pub(crate) const SHARED_VARIANCE: f64 = 0.1;

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

/// How far what a verifier says of touches that were chosen is from what it says of any, the variance in that of one touch: where touches
/// are pressed otherwise than the bank's, of places with more detail it says 1.4 nats less; a touch varies by 2.
const CHOSEN: f64 = 0.5;

/// Few touches may agree by chance; cosines of no sensor lie nearer together.
const LEAST_SD: f64 = 0.01;

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::touch::Sensor;
    use tactile_data::frame::{Frame, Preprocessing};
    use tactile_infer::DeviceKind;
    use tactile_infer::calibration::match_odds::MatchOdds;
    use tactile_infer::embedding::architecture::NetworkConfig;
    use tactile_infer::embedding::checkpoint::{Checkpoint, Provenance};

    /// A network that has learnt nothing, with what was fitted where holes are touched, and where pegs are.
    fn model(of_sides: [Option<MatchOdds>; 2]) -> Model {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        Model::new(Checkpoint { match_odds: of_sides, ..checkpoint }, "of a test".into(), DeviceKind::Flex).unwrap()
    }

    fn odds(offset: f64) -> MatchOdds {
        MatchOdds {
            offset,
            steepness: 17.5,
            steepness_by_edge: 0.125,
            own_distance: 0.3125,
            distance_by_own: 0.625,
            rarity_by_edge: 0.5,
            usual_rarity: 0.0,
            rarity: (0..6).map(|i| (i as f32 * 0.7).sin()).collect(),
            n_touches: 100,
            log_probability: 2.0,
        }
    }

    #[test]
    fn what_was_fitted_of_a_model_counts_and_without_it_the_defaults() {
        let default = TouchModel::default();
        let fitted = |match_offset| TouchModel {
            match_offset,
            steepness: 17.5,
            steepness_by_edge: 0.125,
            own_distance: 0.3125,
            distance_by_own: 0.625,
            ..default
        };
        for (of_sides, expected) in [
            ([None, None], [default; 2]),
            ([Some(odds(2.5)), None], [fitted(2.5); 2]),
            ([None, Some(odds(1.5))], [default, fitted(1.5)]),
            ([Some(odds(2.5)), Some(odds(1.5))], [fitted(2.5), fitted(1.5)]),
        ] {
            let model = model(of_sides);
            assert_eq!([Side::Hole, Side::Peg].map(|side| TouchModel::of_side(&model, side)), expected);
            assert_eq!(TouchModel::of(&model), expected[0]);
        }
    }

    #[test]
    fn a_sensor_says_how_rare_a_touch_is_as_was_fitted_of_its_side() {
        let frame =
            |times: usize| Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (times * i % 90) as u8).collect()).unwrap();
        let observe = |of_sides: [Option<MatchOdds>; 2], side| {
            let sensor = Sensor::new(Arc::new(model(of_sides)), &frame(1)).unwrap().of_side(side);
            sensor.observe(&frame(7)).unwrap()
        };
        let other = MatchOdds { rarity_by_edge: -2.0, rarity: vec![0.25; 6], ..odds(1.5) };
        for (side, of_side) in [(Side::Hole, odds(2.5)), (Side::Peg, other.clone())] {
            let seen = observe([Some(odds(2.5)), Some(other.clone())], side);
            let of_query: f64 =
                of_side.rarity.iter().zip(&seen.query).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            let of_edge = of_side.rarity_by_edge * ((f64::from(seen.edge_share) + 0.003) / 0.05).ln();
            assert!((f64::from(seen.rarity) - of_query - of_edge).abs() < 1e-6, "{seen:?}");
            assert!(seen.rarity != 0.0);
            assert_eq!(observe([None, None], side).rarity, 0.0);
        }
    }
}

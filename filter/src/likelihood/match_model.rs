//! The log-odds that an edged or blank touch was made at a view, by their cosine.

use tactile_infer::calibration::match_odds::{MatchOdds, distance};

use crate::likelihood::softplus::softplus;
use crate::simd;
use crate::touch_model::TouchModel;

/// What one touch's cosine with a view says of whether it was made there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum MatchModel {
    /// The fitted log-odds against a touch of anything in the world, but for a share eps of all touches, which are of
    /// something else than they were meant for: `log((1 - eps) e^odds + eps)`, less what a touch of what nobody recorded has.
    Odds(Odds),
    /// Alg. 1 as printed: the cosine over a temperature, relative to the mean of its power over all views.
    Cosine {
        /// tau.
        temperature: f64,
        /// tau times the log of the mean of `exp(cosine / tau)`.
        average: f64,
    },
}

/// The formula of [`tactile_infer::calibration::match_odds`], of one touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Odds {
    /// At a distance of 0, and what it falls by with a distance of 1, nats.
    at_zero: f64,
    steepness: f64,
    /// Logs of eps, -inf where it is 0, as it counts, and of 1 - eps.
    log_outlier: f64,
    log_rest: f64,
}

impl MatchModel {
    /// The model of a touch with this rarity and share of edge, whose bank's touches are so far from their own views.
    pub fn of_odds(model: &TouchModel, [rarity, own_distance]: [f64; 2], edge_share: f32) -> Self {
        Self::Odds(Odds::new(model, [rarity, model.own_at(own_distance, edge_share)], edge_share))
    }

    /// The same against what nobody recorded, which has these log-odds.
    pub fn against(self, unknown: f64) -> Self {
        match self {
            Self::Odds(odds) => Self::Odds(odds.against(unknown)),
            Self::Cosine { .. } => self,
        }
    }

    /// The log of the mean over views of what [`Self::log`] is the log of, but at least 0: of Alg. 1 it is 0.
    pub fn log_mean(self, cosines: impl Iterator<Item = f32>) -> f64 {
        match self {
            Self::Odds(odds) => odds.log_mean(cosines).max(0.0),
            Self::Cosine { .. } => 0.0,
        }
    }

    /// Alg. 1, by the cosines with all views.
    pub fn of_cosines(temperature: f64, cosines: &[f64]) -> Self {
        let best = simd::largest(cosines).max(-1.0);
        // Divided: the smallest temperatures have no reciprocal.
        let above_best: Vec<f64> = cosines.iter().map(|cosine| (cosine - best) / temperature).collect();
        let [sum, _] = simd::sums_of_powers(&above_best, 0.0);
        let mean = if cosines.is_empty() { 1.0 } else { (sum / cosines.len() as f64).max(f64::MIN_POSITIVE) };
        Self::Cosine { temperature, average: best + temperature * mean.ln() }
    }

    /// The log-odds of a touch that may be of anything; -inf where no touch is.
    pub fn log_outlier(self) -> f64 {
        match self {
            Self::Odds(odds) => odds.log_outlier,
            Self::Cosine { .. } => f64::NEG_INFINITY,
        }
    }

    /// A cosine below this is of a touch less than so many nats likelier than an outlier.
    pub fn above_outliers(self, nats: f64) -> f64 {
        match self {
            Self::Odds(odds) => {
                let log = odds.log_outlier - odds.log_rest + nats.exp_m1().ln();
                let farthest = ((odds.at_zero - log) / odds.steepness).max(0.0);
                1.0 - 0.5 * farthest * farthest
            }
            Self::Cosine { .. } => f64::NEG_INFINITY,
        }
    }

    /// For one cosine, -1..=1.
    pub fn log(self, cosine: f64) -> f64 {
        match self {
            Self::Odds(odds) => odds.log(distance(cosine)),
            Self::Cosine { temperature, average } => ((cosine - average) / temperature).clamp(-MOST, MOST),
        }
    }

    /// The same of many, in f32 where that is fine enough, each with `more` added.
    pub fn logs(self, mut cosines: Vec<f32>, more: f64) -> Vec<f64> {
        let odds = match self {
            Self::Odds(odds) if odds.log_outlier > f64::NEG_INFINITY => odds,
            _ => return cosines.into_iter().map(|cosine| self.log(f64::from(cosine)) + more).collect(),
        };
        let Odds { at_zero, steepness, log_outlier, log_rest } = odds;
        let (at_zero, steepness) = ((at_zero + log_rest - log_outlier) as f32, steepness as f32);
        for cosine in &mut cosines {
            let square = 2.0 - 2.0 * *cosine;
            *cosine = at_zero - steepness * if square > 0.0 { square } else { 0.0 }.sqrt();
        }
        simd::softplus(&mut cosines);
        let more = log_outlier + more;
        cosines.into_iter().map(|log| more + f64::from(log)).collect()
    }
}

/// What the touches made lead to expect of the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Felt {
    /// How rare it is in the world, nats.
    pub rarity: f64,
    /// How far it is from its own view.
    pub own_distance: f64,
    /// The log-odds of what nobody recorded.
    pub unknown: f64,
}

/// How likely views are where a touch is made at another one, as far as that is known beforehand: the touch will be as far from
/// its own view as touches are, in a direction of its own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foreseen {
    odds: Odds,
    own_square: f64,
    /// The power to which it is taken: how much of it is new.
    new_share: f64,
}

impl Foreseen {
    /// What is foreseen of a touch with this share of edge, as rare and as far from its own view as is said, against views that
    /// nobody recorded; `new_share` of it is new.
    pub fn new(model: &TouchModel, felt: Felt, edge_share: f32, new_share: f64) -> Self {
        let Felt { rarity, own_distance, unknown } = felt;
        let own_distance = model.own_at(own_distance, edge_share);
        let odds = Odds::new(model, [rarity, own_distance], edge_share).against(unknown);
        Self { odds, own_square: own_distance * own_distance, new_share }
    }

    /// The likelihood at views by their cosines with the one touched. The power of a sum is taken as the sum of powers.
    pub fn likely(self, cosines: impl Iterator<Item = f64>) -> Vec<f64> {
        let Self { odds, own_square, new_share } = self;
        let log = |cosine: f64| {
            odds.log_rest + odds.at_zero - odds.steepness * (2.0 * (1.0 - cosine).max(0.0) + own_square).sqrt()
        };
        let logs: Vec<f64> = cosines.map(log).collect();
        // No log is above that of the view itself.
        let most = log(1.0);
        let (scale, outlier) = ((new_share * most).min(MOST_FORESEEN).exp(), (new_share * odds.log_outlier).exp());
        let mut likely = simd::powers(&logs, most, new_share);
        likely.iter_mut().for_each(|likely| *likely = *likely * scale + outlier);
        likely
    }
}

impl Odds {
    fn new(model: &TouchModel, [rarity, own_distance]: [f64; 2], edge_share: f32) -> Self {
        let steepness = model.steepness * (model.steepness_by_edge * MatchOdds::log_edge(edge_share)).exp();
        let usual = model.own_distance;
        let counted = (usual / own_distance).powf(model.distance_by_own);
        // Of a bank whose touches are at their own views, say, or infinitely far: as usual.
        let counted = if counted.is_finite() { counted } else { 1.0 };
        let at_usual = (steepness * usual).min(MOST);
        let steepness = (steepness * counted).min(MOST);
        let (log_outlier, log_rest) = (model.outlier_share.ln(), (-model.outlier_share).ln_1p());
        let at_zero = (model.match_offset + rarity + at_usual).clamp(-MOST, MOST);
        Self { at_zero, steepness, log_outlier, log_rest }
    }

    fn against(self, unknown: f64) -> Self {
        Self { at_zero: self.at_zero - unknown, log_outlier: self.log_outlier - unknown, ..self }
    }

    /// -inf of no views.
    fn log_mean(self, cosines: impl Iterator<Item = f32>) -> f64 {
        let logs: Vec<f64> = cosines.map(|cosine| -self.steepness * distance(f64::from(cosine))).collect();
        let largest = simd::largest(&logs);
        let [sum, _] = simd::sums_of_powers(&logs, largest);
        if logs.is_empty() {
            return f64::NEG_INFINITY;
        }
        self.or_outlier(self.log_rest + self.at_zero + largest + (sum / logs.len() as f64).ln())
    }

    fn log(self, distance: f64) -> f64 {
        self.or_outlier(self.log_rest + self.at_zero - self.steepness * distance)
    }

    /// What has these log-odds, or is an outlier.
    fn or_outlier(self, log: f64) -> f64 {
        if self.log_outlier > f64::NEG_INFINITY { self.log_outlier + softplus(log - self.log_outlier) } else { log }
    }
}

/// No log-odds, and no steepness, are of more nats either way: what is infinite cannot be weighed. However cold the temperature a
/// match is never impossible, and a view between recorded ones that is more like a touch than the best of them is not certain. Two
/// opposite views are 2e4 apart at the coldest temperature that a cosine in f32 can bear.
const MOST: f64 = 1e12;

/// No view is foreseen to be likelier than e to this many nats.
const MOST_FORESEEN: f64 = 200.0;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Round numbers; four times the usual share of edge doubles the steepness.
    fn model(outlier_share: f64) -> TouchModel {
        TouchModel {
            match_offset: 2.0,
            steepness: 10.0,
            steepness_by_edge: 0.5,
            own_distance: 0.3,
            distance_by_own: 1.5,
            outlier_share,
            ..TouchModel::default()
        }
    }

    /// Cosines whose distances are round: 0, 0.2, 0.4, 1 and 2.
    const COSINES: [(f64, f64); 5] = [(1.0, 0.0), (0.98, 0.2), (0.92, 0.4), (0.5, 1.0), (-1.0, 2.0)];

    /// Shares of edge and how steep a touch is that shows so much: usual with the noise, four times that, none at all.
    const STEEPNESSES: [(f32, f64); 3] = [(0.047, 10.0), (0.197, 20.0), (0.0, 2.449_489_742_783)];

    #[test]
    fn the_odds_agree_with_hand_arithmetic() {
        for (edge_share, steepness) in STEEPNESSES {
            for (cosine, distance) in COSINES {
                // Rare by 0.5, and as far from its own view as 0.3.
                let odds = 2.0 + 0.5 - steepness * (distance - 0.3);
                let found = MatchModel::of_odds(&model(0.0), [0.5, 0.3], edge_share).log(cosine);
                // The share in f32 is off by 2^-25 of itself, the distance by 1e-16 over itself.
                assert!((found - odds).abs() < 1e-6, "{edge_share} {cosine}: {found} {odds}");
                let mixed = (0.9 * odds.exp() + 0.1).ln();
                let found = MatchModel::of_odds(&model(0.1), [0.5, 0.3], edge_share).log(cosine);
                assert!((found - mixed).abs() < 1e-6, "{edge_share} {cosine}: {found} {mixed}");
            }
        }
    }

    /// Where touches are four times as far from their own views as usual, a distance counts an eighth.
    #[test]
    fn a_rough_sensors_distances_count_for_less() {
        for (own, counted) in [(0.3, 1.0), (1.2, 0.125), (0.075, 8.0)] {
            for (cosine, distance) in COSINES {
                let odds = 2.0 - 10.0 * (counted * distance - 0.3);
                let found = MatchModel::of_odds(&model(0.0), [0.0, own], 0.047).log(cosine);
                // The share in f32 is off by 2^-25 of itself.
                assert!((found - odds).abs() < 1e-6 * counted.max(1.0), "{own} {cosine}: {found} {odds}");
            }
        }
        // No bank has touches at their own views; were it so, they would count as usual.
        let usual = MatchModel::of_odds(&model(0.0), [0.0, 0.3], 0.047).log(0.5);
        assert_eq!(MatchModel::of_odds(&model(0.0), [0.0, 0.0], 0.047).log(0.5), usual);
    }

    /// The odds at a distance, in probabilities and without the outliers: no logs.
    fn odds_of(model: &TouchModel, [rarity, own]: [f64; 2], edge_share: f32, distance: f64) -> f64 {
        let steepness = model.steepness * ((f64::from(edge_share) + 0.003) / 0.05).powf(model.steepness_by_edge);
        (model.match_offset + rarity).exp() * (steepness * own).exp() / (steepness * distance).exp()
    }

    proptest! {
        #[test]
        fn many_in_f32_are_each_in_f64_which_is_its_definition(
            offset in -2.0..6.0_f64, steepness in 1.0..60.0_f64, by_edge in 0.0..0.5_f64, own in 0.1..0.6_f64,
            rarity in -3.0..3.0_f64, outlier_share in prop::sample::select(vec![0.0, 1e-9, 5e-3, 0.3]),
            edge_share in 0.0..0.5_f32, cosines in prop::collection::vec(-1.0..=1.0_f32, 1..20), more in -5.0..5.0_f64,
        ) {
            let model = TouchModel {
                match_offset: offset, steepness, steepness_by_edge: by_edge, own_distance: own, outlier_share,
                ..TouchModel::default()
            };
            let seen = MatchModel::of_odds(&model, [rarity, own], edge_share);
            let steep = steepness * ((f64::from(edge_share) + 0.003) / 0.05).powf(by_edge);
            let log_outlier = outlier_share.max(f64::MIN_POSITIVE).ln();
            let at_zero = offset + rarity + steep * own - log_outlier;
            let many = seen.logs(cosines.clone(), more);
            prop_assert_eq!(many.len(), cosines.len());
            for (cosine, of_many) in cosines.into_iter().map(f64::from).zip(many) {
                let one = seen.log(cosine);
                // The chord of the angle.
                let chord = 2.0 * (cosine.acos() / 2.0).sin();
                let odds = odds_of(&model, [rarity, own], edge_share, chord);
                let exact = ((1.0 - outlier_share) * odds + outlier_share).ln();
                // The table of ln(1 + e^z) is exact to 4e-10; a chord by its angle to 1e-16 over its length.
                prop_assert!((one - exact).abs() < 1e-9 + 1e-8 * steep, "{cosine}: {one} {exact}");
                // In f32 the first term, the distance (three roundings and half of one), their product and their sum are
                // each rounded by 2^-24 of themselves; the softplus adds 3e-7 and 1e-7 of itself.
                let cost = steep * distance(cosine);
                let rounded = (at_zero.abs() + 3.5 * cost + (at_zero - cost).abs()) * 2.0_f64.powi(-24);
                let of_softplus = 3e-7 + 1e-7 * (one - log_outlier).abs();
                let most = if outlier_share == 0.0 { 1e-12 } else { rounded + of_softplus + 1e-9 };
                prop_assert!((of_many - more - one).abs() < most, "{cosine}: {of_many} {one}");
            }
        }

        #[test]
        fn an_outlier_share_bounds_what_one_touch_costs(
            cosine in -1.0..=1.0_f64, steepness in 1.0..1e4_f64, outlier_share in 1e-6..0.5_f64,
        ) {
            let model = TouchModel { steepness, outlier_share, ..TouchModel::default() };
            let seen = MatchModel::of_odds(&model, [0.0, 0.4], 0.1);
            prop_assert!((seen.log_outlier() - outlier_share.ln()).abs() < 1e-12);
            prop_assert!(seen.log(cosine) >= outlier_share.ln());
            let without = MatchModel::of_odds(&TouchModel { outlier_share: 0.0, ..model }, [0.0, 0.4], 0.1);
            prop_assert_eq!(without.log_outlier(), f64::NEG_INFINITY);
            // The outliers' share is taken from the others.
            prop_assert!((without.log(cosine) + (1.0 - outlier_share).ln()) <= seen.log(cosine) + 1e-9);
        }

        #[test]
        fn below_a_cosine_a_touch_is_hardly_likelier_than_an_outlier(
            steepness in 5.0..60.0_f64, outlier_share in 1e-4..0.1_f64, nats in 1e-3..2.0_f64, own in 0.1..0.6_f64,
        ) {
            let model = TouchModel { steepness, outlier_share, ..TouchModel::default() };
            let seen = MatchModel::of_odds(&model, [0.0, own], 0.1);
            let cosine = seen.above_outliers(nats);
            prop_assert!(cosine <= 1.0);
            if cosine > -1.0 {
                // The table of ln(1 + e^z) is exact to 4e-10.
                prop_assert!((seen.log(cosine) - seen.log_outlier() - nats).abs() < 1e-8);
            } else {
                prop_assert!(seen.log(-1.0) - seen.log_outlier() >= nats - 1e-8);
            }
        }

        /// The power of a sum is taken as the sum of powers.
        #[test]
        fn what_is_foreseen_is_the_odds_of_a_touch_as_far_from_its_own_view_as_touches_are(
            rarity in -3.0..3.0_f64, own in 0.1..0.6_f64, edge_share in 0.0..0.5_f32, share in 0.1..=1.0_f64,
            unknown in 0.0..3.0_f64,
            outlier_share in prop::sample::select(vec![0.0, 5e-3]), cosines in prop::collection::vec(-1.0..=1.0_f64, 1..9),
        ) {
            let model = TouchModel { outlier_share, own_distance: own, ..TouchModel::default() };
            let felt = Felt { rarity, own_distance: own, unknown };
            let found = Foreseen::new(&model, felt, edge_share, share).likely(cosines.iter().copied());
            for (cosine, found) in cosines.into_iter().zip(found) {
                // A touch at right angles to the way between the views is from the other one by Pythagoras.
                let apart = (distance(cosine).powi(2) + own * own).sqrt();
                let odds = (1.0 - outlier_share) * odds_of(&model, [rarity, own], edge_share, apart);
                let expected = (odds / unknown.exp()).powf(share) + (outlier_share / unknown.exp()).powf(share);
                prop_assert!((found / expected - 1.0).abs() < 1e-9, "{cosine}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_view_alike_is_foreseen_as_likely_as_touches_match_their_own() {
        // e^(offset + rarity), however much a distance costs.
        for steepness in [1.0, 30.0] {
            let model = TouchModel { steepness, ..model(0.0) };
            let felt = Felt { rarity: -0.5, own_distance: 0.3, unknown: 0.0 };
            let found = Foreseen::new(&model, felt, 0.1, 1.0).likely([1.0, 1.0 + 1e-9].into_iter());
            assert!(found.iter().all(|found| (found - 1.5_f64.exp()).abs() < 1e-12), "{found:?}");
        }
    }

    #[test]
    fn what_nobody_recorded_is_as_likely_as_the_mean_view_and_no_less_than_the_world() {
        let seen = MatchModel::of_odds(&model(0.1), [0.5, 0.3], 0.047);
        // Distances of 0.2, 1 and 2 by hand: 3.5 nats and outliers.
        let likely = |distance: f64| 0.9 * (2.5 - 10.0 * (distance - 0.3)).exp() + 0.1;
        let mean = (likely(0.2) + likely(1.0) + likely(2.0)) / 3.0;
        let unknown = seen.log_mean([0.98, 0.5, -1.0].into_iter());
        assert!((unknown - mean.ln()).abs() < 1e-6, "{unknown} {}", mean.ln());
        let against = seen.against(unknown);
        for (cosine, distance) in COSINES {
            assert!((against.log(cosine) - (likely(distance) / mean).ln()).abs() < 1e-5);
            assert!((against.logs(vec![cosine as f32], 0.5)[0] - 0.5 - against.log(cosine)).abs() < 1e-4);
        }
        assert!((against.above_outliers(0.1) - seen.above_outliers(0.1)).abs() < 1e-12);
        // The world is likelier than views that do not match, and all there is where nothing was recorded.
        assert_eq!([seen.log_mean([-1.0; 2].into_iter()), seen.log_mean(std::iter::empty())], [0.0; 2]);
    }

    /// Alg. 1 as printed: all that counts is the cosine over the temperature, and views at random average to 1.
    #[test]
    fn alg_1_is_the_power_of_the_cosine_over_its_mean() {
        let cosines = [0.9, 0.3, -0.2, -1.0];
        for temperature in [0.05, 0.5] {
            let seen = MatchModel::of_cosines(temperature, &cosines);
            let mean = cosines.iter().map(|cosine: &f64| (cosine / temperature).exp()).sum::<f64>() / 4.0;
            for cosine in cosines {
                let expected = cosine / temperature - mean.ln();
                assert!((seen.log(cosine) - expected).abs() < 1e-12, "{cosine} {expected}");
                let many = seen.logs(vec![cosine as f32], 0.5)[0];
                // A cosine in f32 over the temperature.
                assert!((many - 0.5 - expected).abs() < 6e-8 / temperature, "{cosine} {expected}");
            }
        }
        let seen = MatchModel::of_cosines(0.05, &cosines);
        assert_eq!([seen.log_outlier(), seen.above_outliers(0.1)], [f64::NEG_INFINITY; 2]);
        // However cold, and however few: what is infinite cannot be weighed.
        for cosines in [&cosines[..], &[]] {
            for temperature in [f64::MIN_POSITIVE, 1e-300, 1e300] {
                let seen = MatchModel::of_cosines(temperature, cosines);
                assert!(seen.log(-1.0).is_finite() && seen.log(1.0).is_finite());
            }
        }
    }
}

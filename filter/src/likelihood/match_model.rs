//! The log-odds that an edged or blank touch was made at a view, by their cosine.

use tactile_infer::match_odds::{MatchOdds, distance};

use crate::likelihood::softplus::softplus;
use crate::simd;
use crate::touch_model::TouchModel;

/// What one touch's cosine with a view says of whether it was made there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum MatchModel {
    /// The fitted log-odds against a touch of anything in the world, but for a share eps of all touches, which are of
    /// something else than they were meant for: `log((1 - eps) e^odds + eps)`.
    Odds(Odds),
    /// Alg. 1 as printed: the cosine over a temperature, relative to the mean of its power over all views.
    Cosine {
        /// tau.
        temperature: f64,
        /// tau times the log of the mean of `exp(cosine / tau)`.
        average: f64,
    },
}

/// The formula of [`tactile_infer::match_odds`], of one touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Odds {
    /// At a distance of 0, and what it falls by with a distance of 1, nats.
    at_zero: f64,
    steepness: f64,
    /// Logs of eps, -inf where it is 0, and of 1 - eps.
    log_outlier: f64,
    log_rest: f64,
}

impl MatchModel {
    /// Of a touch with this rarity and share of edge, whose bank's touches are so far from their own views.
    pub fn of_odds(model: &TouchModel, [rarity, own_distance]: [f64; 2], edge_share: f32) -> Self {
        Self::Odds(Odds::new(model, [rarity, own_distance], edge_share))
    }

    /// Of Alg. 1, by the cosines with all views.
    pub fn of_cosines(temperature: f64, cosines: &[f64]) -> Self {
        let best = simd::largest(cosines).max(-1.0);
        // Divided: the smallest temperatures have no reciprocal.
        let above_best: Vec<f64> = cosines.iter().map(|cosine| (cosine - best) / temperature).collect();
        let [sum, _] = simd::sums_of_powers(&above_best, 0.0, 1.0);
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
            Self::Cosine { temperature, average } => ((cosine - average) / temperature).max(LOWEST),
        }
    }

    /// The same of many, in f32 where that is fine enough, each with `more` added.
    pub fn logs(self, mut cosines: Vec<f32>, more: f64) -> Vec<f64> {
        let Self::Odds(odds) = self else {
            return cosines.into_iter().map(|cosine| self.log(f64::from(cosine)) + more).collect();
        };
        if odds.log_outlier == f64::NEG_INFINITY {
            return cosines.into_iter().map(|cosine| self.log(f64::from(cosine)) + more).collect();
        }
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

/// How likely views are where a touch is made at another one, as far as that is known beforehand: the touch will be as far from
/// its own view as touches are, in a direction of its own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foreseen {
    odds: Odds,
    own_square: f64,
    /// The power to which it counts together with the touches made.
    joint: f64,
}

impl Foreseen {
    /// Of a touch with this rarity and share of edge, as [`MatchModel::of_odds`].
    pub fn new(model: &TouchModel, [rarity, own_distance]: [f64; 2], edge_share: f32, joint: f64) -> Self {
        let odds = Odds::new(model, [rarity, own_distance], edge_share);
        Self { odds, own_square: own_distance * own_distance, joint }
    }

    /// The likelihood at views by their cosines with the one touched. The power of a sum is taken as the sum of powers.
    pub fn likely(self, cosines: impl Iterator<Item = f64>) -> Vec<f64> {
        let Self { odds, own_square, joint } = self;
        let log = |cosine: f64| {
            odds.log_rest + odds.at_zero - odds.steepness * (2.0 * (1.0 - cosine).max(0.0) + own_square).sqrt()
        };
        let logs: Vec<f64> = cosines.map(log).collect();
        // No log is above that of the view itself.
        let most = log(1.0);
        let (scale, outlier) = ((joint * most).exp(), (joint * odds.log_outlier).exp());
        let mut likely = simd::powers(&logs, most, joint);
        likely.iter_mut().for_each(|likely| *likely = *likely * scale + outlier);
        likely
    }
}

impl Odds {
    fn new(model: &TouchModel, [rarity, own_distance]: [f64; 2], edge_share: f32) -> Self {
        let steepness = model.steepness * (model.steepness_by_edge * MatchOdds::log_edge(edge_share)).exp();
        let (log_outlier, log_rest) = (model.outlier_share.ln(), (-model.outlier_share).ln_1p());
        let at_zero = model.match_offset + rarity + steepness * own_distance;
        Self { at_zero, steepness, log_outlier, log_rest }
    }

    fn log(self, distance: f64) -> f64 {
        let log = self.log_rest + self.at_zero - self.steepness * distance;
        if self.log_outlier > f64::NEG_INFINITY { self.log_outlier + softplus(log - self.log_outlier) } else { log }
    }
}

/// A match is never impossible, however cold the temperature: what is infinite cannot be weighed, nats. Two opposite
/// views are 2e4 apart at the coldest temperature that a cosine in f32 can bear.
const LOWEST: f64 = -1e12;

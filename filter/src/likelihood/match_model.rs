//! How likely an edged touch is at a recorded view, by their cosine.

use crate::likelihood::softplus::softplus;
use crate::simd;

/// `log((1 - eps) exp(d / tau) / M + eps)` for a cosine `d` above the one that it is measured from, mostly below it: a
/// touch is of the view that matches, `M` being the mean of `exp(d / tau)` over all views, but for a share eps of all
/// touches, which may look like any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MatchModel {
    temperature: f64,
    /// The mean over all views.
    pub mean: f64,
    /// Log of `eps M / (1 - eps)`; -inf where no touch is an outlier.
    log_floor: f64,
    /// Log of `M / (1 - eps)`.
    log_scale: f64,
}

impl MatchModel {
    /// By a temperature tau, a share of outliers eps and the cosines of all views. No cosine is above the
    /// reference.
    pub fn new(temperature: f64, outlier_share: f64, mut above_best: Vec<f64>) -> Self {
        let n = above_best.len() as f64;
        // Divided: the smallest temperatures have no reciprocal.
        above_best.iter_mut().for_each(|d| *d /= temperature);
        let [sum, _] = simd::sums_of_powers(&above_best, 0.0, 1.0);
        let mean = if n > 0.0 { (sum / n).max(f64::MIN_POSITIVE) } else { 1.0 };
        let scale = mean / (1.0 - outlier_share);
        Self { temperature, mean, log_floor: (outlier_share * scale).ln(), log_scale: scale.ln() }
    }

    /// The log-likelihood of a touch that may look like any view; -inf where no touch is an outlier.
    pub fn log_outlier(self) -> f64 {
        self.log_floor - self.log_scale
    }

    /// A cosine below this, above the one that it is measured from, makes a touch less than so many nats likelier than
    /// an outlier.
    pub fn above_outliers(self, nats: f64) -> f64 {
        self.temperature * (self.log_floor + nats.exp_m1().ln())
    }

    /// For one cosine.
    pub fn log(self, above_best: f64) -> f64 {
        let log = (above_best / self.temperature).clamp(LOWEST, HIGHEST);
        let above =
            if self.log_floor > f64::NEG_INFINITY { self.log_floor + softplus(log - self.log_floor) } else { log };
        above - self.log_scale
    }

    /// The same of many, in f32 where that is fine enough, each with `more` added.
    pub fn logs(self, mut above_best: Vec<f32>, more: f64) -> Vec<f64> {
        // No cosine in f32 is good to more than 1e-7, which below this temperature is a thousandth of a nat.
        const COLDEST: f64 = 1e-4;
        if self.temperature < COLDEST || self.log_floor == f64::NEG_INFINITY {
            return above_best.into_iter().map(|above_best| self.log(f64::from(above_best)) + more).collect();
        }
        let (per_cosine, floor) = ((1.0 / self.temperature) as f32, self.log_floor as f32);
        for value in &mut above_best {
            let log = *value * per_cosine;
            *value = if log < HIGHEST as f32 { log } else { HIGHEST as f32 } - floor;
        }
        simd::softplus(&mut above_best);
        let more = self.log_floor - self.log_scale + more;
        above_best.into_iter().map(|log| more + f64::from(log)).collect()
    }
}

/// Between recorded views a cosine may rise above the best of them, but by no more than this says anything, nats.
const HIGHEST: f64 = 30.0;

/// A match is never impossible, however cold the temperature: what is infinite cannot be weighed, nats. Two opposite
/// views are 2e4 apart at the coldest temperature that a cosine in f32 can bear.
const LOWEST: f64 = -1e12;

//! Temperature and share of outliers from compared touches, with what was known before them.

use rayon::prelude::*;

use super::compared::{Compared, Weights};
use crate::calibration::Prior;

/// How uncertain one touch's worth of prior leaves the share: the standard deviation of its natural logarithm, a factor of
/// ten. Most touches say nothing of it.
const SHARE_SPREAD: f64 = std::f64::consts::LN_10;

/// By how much the negative log-posterior rises to the ends of a 95 % interval of one number: half of 1.96 squared.
const INTERVAL_RISE: f64 = 1.92;

/// A temperature and a share of outliers, and how well they explain touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    pub temperature: f64,
    pub share: f64,
    /// The negative log-posterior a touch; without a prior the mean negative log-likelihood.
    score: f64,
}

/// The temperature and share of outliers of least mean negative log-likelihood, by a search on a logarithmic grid that is refined once
/// around its best point. With a prior the largest posterior; then the prior's own numbers are tried, too, and the grid is
/// refined once more.
///
/// The prior of the temperature is as if its touches were below the best by an exponential of its temperature; the
/// prior of the share is a normal distribution of its logarithm.
pub(super) fn fit(holes: &[Compared], prior: Option<&Prior>) -> Fit {
    let best_of = |temperatures: &[f64], shares: &[f64]| {
        let points = temperatures.iter().flat_map(|t| shares.iter().map(move |f| (*t, *f))).collect::<Vec<_>>();
        let scored = points.into_par_iter().map(|(temperature, share)| {
            let score = score(holes, prior, temperature, share);
            Fit { temperature, share, score }
        });
        let none = Fit { temperature: f64::NAN, share: f64::NAN, score: f64::INFINITY };
        scored.reduce(|| none, better)
    };
    let around = |fit: Fit, by: f64, shares_by: f64| {
        best_of(
            &log_grid(fit.temperature / by, fit.temperature * by, 9),
            &log_grid(fit.share / shares_by, (fit.share * shares_by).min(0.9), 7),
        )
    };
    let coarse = best_of(&log_grid(0.005, 0.5, 16), &log_grid(1e-5, 0.5, 11));
    let refined = around(coarse, 1.4, 3.0);
    let Some(prior) = prior else { return refined };
    let finest = around(refined, 1.07, 1.5);
    better(best_of(&[prior.temperature], &[prior.outlier_share]), better(refined, finest))
}

/// The better of two; the first where they are equal.
fn better(a: Fit, b: Fit) -> Fit {
    if b.score < a.score { b } else { a }
}

fn log_grid(low: f64, high: f64, n: usize) -> Vec<f64> {
    (0..n).map(|i| (low.ln() + (high / low).ln() * i as f64 / (n - 1) as f64).exp()).collect()
}

/// The 95 % interval of the temperature, whichever share goes with it.
pub(super) fn temperature_interval(holes: &[Compared], prior: Option<&Prior>, fit: &Fit) -> [f64; 2] {
    const STEP: f64 = 1.05;
    /// No temperature farther than this factor is tried.
    const FARTHEST: f64 = 16.0;
    let shares = log_grid(fit.share / 100.0, (fit.share * 100.0).min(0.5), 5);
    let n = holes.len().max(1) as f64;
    let is_within = |temperature: f64| {
        let least = shares.iter().map(|f| score(holes, prior, temperature, *f)).fold(f64::INFINITY, f64::min);
        n * (least - fit.score) < INTERVAL_RISE
    };
    [1.0 / STEP, STEP].map(|step| {
        let mut temperature = fit.temperature;
        while is_within(temperature) && (1.0 / FARTHEST..=FARTHEST).contains(&(temperature / fit.temperature)) {
            temperature *= step;
        }
        temperature
    })
}

/// The mean negative log-likelihood, nats.
pub(super) fn nll(holes: &[Compared], temperature: f64, share: f64) -> f64 {
    let weights = Weights::new(temperature, share);
    holes.iter().map(|hole| hole.nll(&weights)).sum::<f64>() / holes.len() as f64
}

/// The negative log-posterior a touch; of the prior alone where there are none.
fn score(holes: &[Compared], prior: Option<&Prior>, temperature: f64, share: f64) -> f64 {
    let of_prior = prior.map_or(0.0, |prior| penalty(prior, temperature, share));
    if holes.is_empty() { of_prior } else { nll(holes, temperature, share) + of_prior / holes.len() as f64 }
}

/// What it costs to leave the prior, nats; 0 at its own numbers.
fn penalty(prior: &Prior, temperature: f64, share: f64) -> f64 {
    let ratio = prior.temperature / temperature;
    let shares = (share / prior.outlier_share).ln() / SHARE_SPREAD;
    prior.n_touches * (ratio - ratio.ln() - 1.0 + 0.5 * shares * shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::Views;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Cosines drawn so that the posterior is a softmax at a known temperature: one of `n_rows` is drawn with
    /// probability proportional to `exp(s / tau)` and called the true one.
    fn drawn(n: usize, n_rows: usize, temperature: f64, seed: u64) -> Vec<Compared> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let one = |_| {
            let cosines: Vec<f32> = (0..n_rows).map(|_| 0.4 * rng.random::<f32>()).collect();
            let weights: Vec<f64> = cosines.iter().map(|s| (f64::from(*s) / temperature).exp()).collect();
            let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
            let drawn = weights.iter().position(|w| {
                left -= w;
                left <= 0.0
            });
            Compared::new(&cosines, &[drawn.unwrap_or(0)])
        };
        (0..n).map(one).collect()
    }

    fn prior(temperature: f64, n_touches: f64) -> Prior {
        Prior {
            n_touches,
            temperature,
            outlier_share: 1e-4,
            blank_agreement: 0.96,
            low_similarity: 0.74,
            gap: None,
            matched: None,
            between_sensors: None,
            views: Views::Pegs,
        }
    }

    #[test]
    fn a_known_temperature_is_found() {
        let holes = drawn(400, 200, 0.06, 5);
        let found = fit(&holes, None);
        // 400 draws: some 10 % on the temperature; outliers are not called for.
        assert!((found.temperature / 0.06 - 1.0).abs() < 0.3, "{found:?}");
        assert!(found.share < 0.05 && nll(&holes, found.temperature, found.share) < 200.0_f64.ln());
        let [low, high] = temperature_interval(&holes, None, &found);
        assert!(low < 0.06 && 0.06 < high && high / low < 1.8, "{low} {high}");
    }

    #[test]
    fn no_touch_leaves_the_prior_and_many_leave_it_behind() {
        let prior = prior(0.029, 10.0);
        let none = fit(&[], Some(&prior));
        assert_eq!((none.temperature, none.share), (0.029, 1e-4));
        let [few, more, many] = [10, 60, 600].map(|n| fit(&drawn(n, 200, 0.09, 7), Some(&prior)).temperature);
        let alone = fit(&drawn(600, 200, 0.09, 7), None).temperature;
        assert!(0.029 < few && few < alone && few < more, "{few} {more} {alone}");
        assert!((many / alone - 1.0).abs() < 0.1, "{many} {alone}");
    }

    #[test]
    fn few_touches_are_nearer_to_the_truth_with_a_prior_that_is_not_far_off() {
        let error = |temperature: f64| (temperature / 0.06).ln().abs();
        let errors = |prior: Option<&Prior>| -> f64 {
            (0..20).map(|seed| error(fit(&drawn(10, 200, 0.06, seed), prior).temperature)).sum()
        };
        let (alone, with) = (errors(None), errors(Some(&prior(0.045, 10.0))));
        assert!(with < alone, "{with} {alone}");
    }

    #[test]
    fn leaving_the_prior_costs_what_touches_of_its_temperature_would() {
        // n exponential gaps of mean T0: each costs ln T + gap / T, on average ln T + T0 / T.
        let expected = |t: f64| 10.0 * ((t.ln() + 0.03 / t) - (0.03_f64.ln() + 1.0));
        for t in [0.01, 0.03, 0.2] {
            assert!((penalty(&prior(0.03, 10.0), t, 1e-4) - expected(t)).abs() < 1e-9);
        }
        // Ten times the share is one standard deviation of one touch.
        assert!((penalty(&prior(0.03, 1.0), 0.03, 1e-3) - 0.5).abs() < 1e-9);
    }
}

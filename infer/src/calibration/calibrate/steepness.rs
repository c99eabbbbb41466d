//! How steep the likelihood of one touch is under a user's own sensor: the factor of the fitted steepness at which touches of known
//! parts are most probable at their own states, among all views of a bank ([`crate::calibration::match_odds`]).

use tactile_data::dataset::touch::Side;

use crate::bank::Bank;
use crate::calibration::match_odds::{MatchOdds, OUTLIER_SHARE, distance};
use crate::calibration::own_by_edge::OwnByEdge;

/// Distances are counted in so many steps; the largest is 2.
const N_STEPS: usize = 400;

/// The factors that are tried: e to the power of minus so much up to 0, in such steps. Never steeper than fitted: touches whose
/// sensor is the bank's to the bit would have it as steep as can be.
const MOST: f64 = 2.0;
const STEP: f64 = 0.02;

/// How far a touch is from its own view and from all views of a bank.
#[derive(Clone, Debug)]
pub(super) struct AmongViews {
    /// Log-odds of a touch that is as far from a view as usual, nats.
    at_usual: f64,
    /// What a distance costs, and what is taken off for the usual one, nats.
    slope: f64,
    usual: f64,
    own_distance: f64,
    /// [`MatchOdds::log_edge`].
    log_edge: f64,
    distance_by_own: f64,
    /// How many of the bank's views are so far away.
    views: Vec<u32>,
}

impl AmongViews {
    /// A touch with an embedding, `[dim]`, an edge share and the cosine with the view that it was made at, by the cosines with all views
    /// of a bank.
    pub(super) fn new(
        (odds, side): (&MatchOdds, Side),
        bank: &Bank,
        (query, edge_share): (&[f32], f32),
        (own, all): (f32, &[f32]),
    ) -> Self {
        let steepness = odds.steepness * (odds.steepness_by_edge * MatchOdds::log_edge(edge_share)).exp();
        let of_bank = bank.matches().own_distance(side).unwrap_or(odds.own_distance);
        let scale = (odds.own_distance / of_bank).powf(odds.distance_by_own);
        let mut views = vec![0; N_STEPS + 1];
        for (_, cosine) in all.iter().enumerate().filter(|(row, _)| bank.is_recorded(*row)) {
            let step = 0.5 * distance(f64::from(cosine.clamp(-1.0, 1.0))) * N_STEPS as f64;
            views[step.round() as usize] += 1;
        }
        Self {
            at_usual: odds.offset + odds.rarity_of(query, edge_share),
            slope: steepness * scale,
            usual: steepness * odds.own_distance,
            own_distance: distance(f64::from(own)),
            log_edge: MatchOdds::log_edge(edge_share),
            distance_by_own: odds.distance_by_own,
            views,
        }
    }

    /// How much edge it shows, and how far it is from its own view.
    pub(super) fn own(&self) -> [f64; 2] {
        [self.log_edge, self.own_distance]
    }

    /// The same where distances count by how far touches with as much edge are from their own views.
    pub(super) fn by_edge(&self, own: &OwnByEdge) -> Self {
        let counted = own.factor_at(self.log_edge).powf(-self.distance_by_own);
        Self { slope: self.slope * counted, ..self.clone() }
    }

    /// The logarithm of its probability at its own view, each view as likely before, at a factor e to the power `ln_factor`, nats.
    fn log_probability(&self, ln_factor: f64) -> f64 {
        let factor = ln_factor.exp();
        let likelihood = |distance: f64| {
            let log_odds = self.at_usual + factor * (self.usual - self.slope * distance);
            (1.0 - OUTLIER_SHARE) * log_odds.exp() + OUTLIER_SHARE
        };
        let views = self.views.iter().enumerate().filter(|(_, n)| **n > 0);
        let of_views =
            views.map(|(step, n)| f64::from(*n) * likelihood(2.0 * step as f64 / N_STEPS as f64)).sum::<f64>();
        (likelihood(self.own_distance) / of_views).ln()
    }
}

/// The factor of the fitted steepness, 1 at most, at which touches are most probable. That it is 1 counts as `n_before` touches, each of
/// which says as much as these do; `None` of no touches.
pub(super) fn steepness(touches: &[AmongViews], n_before: f64) -> Option<f64> {
    let mean =
        |at: f64| touches.iter().map(|touch| touch.log_probability(at)).sum::<f64>() / touches.len().max(1) as f64;
    let bend = 0.1;
    let information = -(mean(bend) + mean(-bend) - 2.0 * mean(0.0)) / (bend * bend);
    let weight = 0.5 * n_before / touches.len() as f64 * information.max(0.0);
    let n = (MOST / STEP) as i32;
    let value = |at: i32| mean(f64::from(at) * STEP) - weight * (f64::from(at) * STEP).powi(2);
    let best = (-n..=0).map(|at| (at, value(at))).max_by(|a, b| a.1.total_cmp(&b.1));
    best.filter(|_| !touches.is_empty()).map(|(at, _)| (f64::from(at) * STEP).exp())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Touches that are off their own view by an exponential distribution of this mean, and 500 other views as far as any up to 1: by Bayes
    /// a distance of 1 costs the inverse of that mean.
    pub(in crate::calibration::calibrate) fn touches(mean: f64) -> Vec<AmongViews> {
        let step = |distance: f64| ((0.5 * distance * N_STEPS as f64).round() as usize).min(N_STEPS);
        let touch = |i: usize| {
            let mut views = vec![0; N_STEPS + 1];
            (0..500).for_each(|j| views[step((j as f64 + 0.5) / 500.0)] += 1);
            let own_distance = -(1.0 - (i as f64 + 0.5) / 400.0).ln() * mean;
            views[step(own_distance)] += 1;
            AmongViews {
                at_usual: 12.0,
                slope: 20.0,
                usual: 8.0,
                own_distance,
                log_edge: 1.0,
                distance_by_own: 0.5,
                views,
            }
        };
        (0..400).map(touch).collect()
    }

    #[test]
    fn it_is_what_bayes_says_and_never_more_than_was_fitted() {
        for (mean, expected) in [(0.1, 0.5), (0.0625, 0.8), (0.02, 1.0)] {
            let found = steepness(&touches(mean), 0.0).unwrap();
            assert!((found - expected).abs() < 0.03, "{mean}: {found} {expected}");
        }
        assert_eq!(steepness(&[], 0.0), None);
    }

    #[test]
    fn it_is_the_factor_of_the_largest_mean_and_what_was_known_counts_as_touches() {
        let touches = touches(0.1);
        let mean = |factor: f64| touches.iter().map(|touch| touch.log_probability(factor.ln())).sum::<f64>();
        let found = steepness(&touches, 0.0).unwrap();
        assert!(mean(found) >= mean(found * 1.02) && mean(found) >= mean(found / 1.02), "{found}");
        // Ten thousand touches of before leave it as it was, as many as these half of the way, about.
        let [half, none] = [400.0, 1e6].map(|n_before| steepness(&touches, n_before).unwrap());
        assert!(
            none == 1.0 && half > found + 0.1 * (1.0 - found) && half < 1.0 - 0.1 * (1.0 - found),
            "{found} {half}"
        );
    }

    #[test]
    fn views_count_as_they_would_one_by_one() {
        let mut views = vec![0; N_STEPS + 1];
        // 0.5, 1 and 1, 2.
        [(100, 1), (200, 2), (400, 1)].into_iter().for_each(|(step, n)| views[step] = n);
        let touch = AmongViews {
            at_usual: 1.5,
            slope: 4.0,
            usual: 2.0,
            own_distance: 0.5,
            log_edge: 1.0,
            distance_by_own: 0.5,
            views,
        };
        let f = |d: f64| 0.995 * (1.5 + 0.5 * (2.0 - 4.0 * d)).exp() + 0.005;
        let expected = (f(0.5) / (f(0.5) + 2.0 * f(1.0) + f(2.0))).ln();
        assert!((touch.log_probability(0.5_f64.ln()) - expected).abs() < 1e-12);
        // Four times as far as on average: a distance counts half, as does a factor of a half but for the usual one.
        let own = OwnByEdge { by_edge: 4.0_f64.ln(), usual_edge: 2.0 };
        assert!((touch.by_edge(&own).slope - 2.0).abs() < 1e-12);
    }
}

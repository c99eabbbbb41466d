//! What a touch is expected to tell, against the expectation over all of the belief, in f64.
//!
//! The filter draws states from the belief; here each counts as often as it is believed. What is left between them is
//! chance, whose size follows from the spread of what the supposed states tell and from how states are drawn.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_filter::{Episode, TouchModel};
use tactile_infer::embedding::precision::Precision;

use super::between::Recorded;
use super::case::{Case, Group};
use super::evidence::{Evidence, Judged};
use super::production::{cosine_errors, kept_queries};
use super::reference::{Likelihood, Pose, new_share};
use super::scene::{DIM, GRID, Scene};
use crate::Result;

/// States drawn, systematically, and states supposed true, one by one.
const N_DRAWS: usize = 6_000;
const N_SUPPOSED: usize = 500;

/// A few candidates after one, three and five touches, with rows in f32 and i8.
pub fn cases(seed: u64) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for (precision, side, n_touches) in [
        (Precision::F32, Side::Hole, 3),
        (Precision::I8, Side::Hole, 1),
        (Precision::I8, Side::Hole, 3),
        (Precision::I8, Side::Peg, 5),
    ] {
        let scene = Scene { precision, side, ..Scene::draw(6, GRID, n_touches, seed) };
        let bank = Arc::new(scene.bank()?);
        let config = scene.config().changed(|settings, model, _| {
            (settings.n_draws, settings.n_suppositions, settings.n_finalists) = (N_DRAWS, N_SUPPOSED, Some(4));
            model.min_separation_mm = 0.0;
        });
        let episode = scene.episode(&bank, config)?;
        let rows = bank.rows().to_f32();
        let recorded = scene.recorded(&rows);
        let queries = scene.queries()?;
        let touches = scene.felt(&rows, &kept_queries(&scene, queries.clone()));
        let errors = cosine_errors(&scene, &queries);
        let evidence = Evidence::new(&recorded, &touches, errors);
        let views = Views { edge_shares: &scene.edge_shares, rows: &rows };
        let expectation = Expectation::new(&episode, &evidence, views, errors[0].max(errors[1]));
        let side = if side == Side::Hole { "holes" } else { "pegs" };
        // Where the hole is recorded, between its poses: from some states the last two lead beyond the recorded area.
        let targets = [(3.1, 0.4, 7.0), (-2.3, 4.2, -31.0), (0.6, -5.7, 52.0), (-6.8, -1.9, 84.0)];
        let away = scene.part_from_sensor.inverse();
        let candidates = targets.map(|(x, y, degrees)| away * Se2::from_degrees(x, y, degrees));
        let scored = episode.explain(&candidates).map(|choice| choice.scored).unwrap_or_default();
        for (number, candidate) in candidates.iter().enumerate() {
            let Expected { nats, bound } = expectation.of(candidate);
            let got =
                scored.iter().find(|scored| scored.sensor_from_next == *candidate).and_then(|scored| scored.score);
            let variant = format!("{side}, {precision}: candidate {}", number + 1);
            let error = (got.unwrap_or(f64::NAN) - nats).abs();
            let case = Case::measured(Group::Choice, variant, "nats, the mean over all of the belief", error, bound);
            let source = "four standard errors of the supposed states and of the draws, and rounding";
            cases.push(case.at(n_touches as f64).by(source));
        }
    }
    Ok(cases)
}

/// What is compared with each other.
#[derive(Clone, Copy)]
struct Views<'a> {
    /// The edge share of each row.
    edge_shares: &'a [f32],
    /// `[n_rows, DIM]`.
    rows: &'a [f32],
}

/// The expected information in f64.
struct Expectation<'a> {
    recorded: &'a Recorded,
    views: Views<'a>,
    /// Where the sensor is by each state that is believed, its part and its probability.
    states: Vec<(Pose, usize, f64)>,
    /// Where the sensor was at each touch, since the first.
    made: Vec<Pose>,
    model: Model,
    /// How far a cosine may be off.
    cosine_error: f64,
}

/// The likelihood of one view where another would be touched, against that of what nobody recorded: the touch will be as
/// rare as those with an edge were, what nobody recorded as likely, and it as far from its own view as touches are, at a
/// right angle to all views.
struct Model {
    config: TouchModel,
    rarity: f64,
    unknown: f64,
    own: f64,
}

impl Model {
    fn new(evidence: &Evidence) -> Self {
        let config = evidence.recorded.config;
        let edged: Vec<_> = evidence.touches.iter().filter(|touch| touch.is_edged).collect();
        let mean = |of: &dyn Fn(&Judged) -> f64| {
            edged.iter().map(|touch| of(touch)).sum::<f64>() / (edged.len() as f64).max(1.0)
        };
        let unknown = mean(&|touch| match touch.likelihood {
            Likelihood::Odds { unknown, .. } => unknown,
            Likelihood::Paper { .. } => 0.0,
        });
        Self { config, rarity: mean(&|touch| touch.rarity), unknown, own: evidence.recorded.own_distance() }
    }

    fn steepness(&self, edge_share: f32) -> f64 {
        let log_edge = ((f64::from(edge_share) + 0.003) / 0.05).ln();
        self.counted() * self.config.steepness * (self.config.steepness_by_edge * log_edge).exp()
    }

    /// What a distance counts as, by how far the bank's touches are from their own views.
    fn counted(&self) -> f64 {
        (self.config.own_distance / self.own).powf(self.config.distance_by_own)
    }

    /// How likely a view is, by its cosine with the one touched, of which so much is edge, as far as the touch is new; the
    /// power of a sum is taken as a sum of powers.
    fn likely(&self, cosine: f64, edge_share: f32, new: f64) -> f64 {
        let Self { config: TouchModel { match_offset, outlier_share, .. }, rarity, unknown, own } = self;
        let distance = (2.0 - 2.0 * cosine + own * own).sqrt();
        let usual = self.config.own_distance / self.counted();
        let odds = (match_offset + rarity - self.steepness(edge_share) * (distance - usual)).exp();
        ((1.0 - outlier_share) * odds / unknown.exp()).powf(new) + (outlier_share / unknown.exp()).powf(new)
    }

    /// How far the log of that may be off where the cosine is, by `error`, and so those of the touches made, on which
    /// what nobody recorded depends.
    fn off(&self, edge_share: f32, error: f64) -> f64 {
        2.0 * self.steepness(edge_share) * error / self.own
    }
}

/// An expectation and how far chance and rounding may take the filter's from it.
struct Expected {
    nats: f64,
    bound: f64,
}

impl<'a> Expectation<'a> {
    fn new(episode: &Episode, evidence: &'a Evidence<'a>, views: Views<'a>, cosine_error: f64) -> Self {
        let (belief, recorded) = (episode.belief(), evidence.recorded);
        let sensor = Pose::of(&belief.first_from_sensor());
        let placed = |(state, mass): (tactile_filter::belief::Hypothesis, f64)| {
            (Pose::of(&belief.posterior().grid().pose(state.cell)).then(&sensor), state.part, mass)
        };
        // A millionth of the belief in each is drawn once in ten.
        let states = belief.posterior().states_from(1e-8).into_iter().map(placed).collect();
        let made = evidence.touches.iter().map(|touch| touch.now).collect();
        Self { recorded, views, states, made, model: Model::new(evidence), cosine_error }
    }

    /// The recorded view nearest to a state's after a motion; `None` where none is within half a step on each axis.
    fn row(&self, (pose, part, _): &(Pose, usize, f64), candidate: &Se2) -> Option<usize> {
        let (grid, pose) = (&self.recorded.grid, pose.then(&Pose::of(candidate)));
        let degrees = pose.turn[1].atan2(pose.turn[0]).to_degrees();
        let nearest = |value: f64, half: f64, step: f64| {
            let (place, n) = (((value + half) / step).round(), (2.0 * half / step).round());
            (0.0..=n).contains(&place).then_some(place as usize)
        };
        let [x, y] = [pose.x, pose.y].map(|mm| nearest(mm, grid.xy_half_mm, grid.xy_step_mm));
        let theta = nearest(degrees, grid.theta_half_deg, grid.theta_step_deg);
        let cell = (x? * grid.n_xy() + y?) * grid.n_theta() + theta?;
        let row = part * grid.len() + cell;
        self.recorded.is_recorded[row].then_some(row)
    }

    /// What a state adds that would see a row, where another is touched and so much of the touch is new.
    fn value(&self, row: Option<usize>, touched: usize, new: f64) -> f64 {
        let Some(row) = row else { return 1.0 };
        let at = |row: usize| &self.views.rows[row * DIM..(row + 1) * DIM];
        let cosine: f64 = at(row).iter().zip(at(touched)).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        self.model.likely(cosine.clamp(-1.0, 1.0), self.views.edge_shares[touched], new)
    }

    fn of(&self, candidate: &Se2) -> Expected {
        // States that see one view are one; with the variance of how often they are drawn of so many.
        let mut seen: Vec<(Option<usize>, f64, f64)> = Vec::new();
        for state in &self.states {
            let row = self.row(state, candidate);
            // Drawn systematically it is the expected number, rounded up or down.
            let variance = (N_DRAWS as f64 * state.2).min(0.25);
            match seen.iter_mut().find(|(other, _, _)| *other == row) {
                Some((_, mass, all)) => (*mass, *all) = (*mass + state.2, *all + variance),
                None => seen.push((row, state.2, variance)),
            }
        }
        let now = self.made.last().map(|last| last.then(&Pose::of(candidate)));
        let of = |before: &Pose| now.map_or(1.0, |now| new_share(before, &now, &self.recorded.config));
        let new = self.made.iter().map(of).fold(1.0, f64::min);
        let whole: f64 = seen.iter().map(|(_, mass, _)| mass).sum();
        let (mut mean, mut square, mut of_draws, mut of_rounding) = (0.0, 0.0, 0.0, 0.0);
        for (row, mass, _) in &seen {
            // Contact is expected of edged views alone.
            let shows = |row: &usize| self.views.edge_shares[*row] > self.recorded.config.blank_share;
            let Some(touched) = row.filter(shows) else { continue };
            let values: Vec<f64> = seen.iter().map(|(row, _, _)| self.value(*row, touched, new)).collect();
            let all = values.iter().zip(&seen).map(|(value, (_, mass, _))| value * mass).sum::<f64>() / whole;
            let nats = (self.value(Some(touched), touched, new) / all).ln();
            // Of the likelihood where it is touched and of the mean.
            of_rounding += mass / whole * 2.0 * self.model.off(self.views.edge_shares[touched], self.cosine_error);
            (mean, square) = (mean + mass / whole * nats, square + mass / whole * nats * nats);
            let of_drawn =
                values.iter().zip(&seen).map(|(value, (_, _, variance))| value * value * variance).sum::<f64>();
            of_draws += mass / whole * 4.0 * of_drawn.sqrt() / N_DRAWS as f64 / all;
        }
        let deviation = (square - mean * mean).max(0.0).sqrt();
        Expected { nats: mean, bound: 4.0 * deviation / (N_SUPPOSED as f64).sqrt() + of_draws + of_rounding + 1e-6 }
    }
}

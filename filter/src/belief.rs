//! Where the sensor may have evidence first, and on which part: the belief over all hypotheses.
//!
//! A state is a part and the grid cell of the FIRST touch; later touches follow from the motions the
//! controller reports, `part_from_sensor = part_from_first * first_from_sensor` (paper, Sec. IV-D). The
//! likelihood of each touch is kept, so that any state can be scored again over all touches.

use std::ops::Range;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_data::symmetry::Symmetry;
use tactile_infer::Bank;

use crate::blocks::{Blocks, Layout};
use crate::doubt::shared_error;
use crate::evidence::Evidence;
use crate::exact::{Exact, keep_heaviest};
pub use crate::hypothesis::Hypothesis;
use crate::hypothesis::states_between;
use crate::likelihood::{LikelihoodConfig, TouchLikelihood};
use crate::modes::is_one_hill;
use crate::particle::{Particle, ParticleConfig};
use crate::refine::{Refined, refine};
use crate::resample::{log_normalize, systematic};

/// Which inference runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EngineConfig {
    /// All states: exact on the grid, but for [`ALLOWED_ERROR`].
    #[default]
    Exact,
    /// The paper's particle filter.
    Particle(ParticleConfig),
}

/// The share of the belief that the exact engine may leave out after each touch, in states that cannot hold more of it
/// together: the total variation from the posterior over all states is at most this, however many touches were made.
/// [`Belief::of_all_states`] leaves none out.
pub const ALLOWED_ERROR: f64 = 5e-4;

#[derive(Clone, Debug)]
enum Engine {
    Exact(Exact),
    Particle {
        particle: Particle,
        /// log p(touch | state) of each touch, to score states that particles move to.
        log_likelihoods: Vec<Vec<f64>>,
    },
}

/// S: the probability of each hypothesis given all touches so far, of which there is at least one.
#[derive(Clone, Debug)]
pub struct Belief {
    views: PoseGrid,
    grid: PoseGrid,
    n_parts: usize,
    touches: Vec<Evidence>,
    engine: Engine,
    class_posterior: Vec<f64>,
    log_evidence: f64,
}

impl Belief {
    /// The belief after the first touch; every state was equally likely before it (paper, Eq. 3).
    ///
    /// `subdivisions`: parts of a step of 2 mm and 15 degrees between two states, at least 1; a finer bank has at least the states
    /// of its views. More than 1 only where views are interpolated between the bank's poses: a state may then lie between
    /// them.
    pub fn new(bank: &Bank, engine: EngineConfig, subdivisions: usize, seed: u64, first: TouchLikelihood) -> Self {
        let EngineConfig::Particle(config) = engine else {
            return Self::within(ALLOWED_ERROR, bank, subdivisions, first);
        };
        let (views, grid) = (*bank.grid(), states_between(bank.grid(), subdivisions));
        let mut log_states = Vec::new();
        let mut take = |log_part: &[f64]| log_states.extend_from_slice(log_part);
        let first = Evidence::new([&views, &grid], Se2::IDENTITY, 1.0, first, &mut take);
        let mut log_posterior = log_states.clone();
        let log_sum = log_normalize(&mut log_posterior).unwrap_or(f64::NEG_INFINITY);
        let log_evidence = log_sum - (log_states.len() as f64).ln();
        let particle = Particle::draw(config, &log_posterior, seed);
        Self::begun(bank, grid, first, Engine::Particle { particle, log_likelihoods: vec![log_states] }, log_evidence)
    }

    /// Like [`Self::new`] with the exact engine, which here leaves no state out: slower, and for comparison.
    pub fn of_all_states(bank: &Bank, subdivisions: usize, first: TouchLikelihood) -> Self {
        Self::within(0.0, bank, subdivisions, first)
    }

    fn within(allowed: f64, bank: &Bank, subdivisions: usize, first: TouchLikelihood) -> Self {
        let (views, grid) = (*bank.grid(), states_between(bank.grid(), subdivisions));
        let Layout { n_angles, n_places } = Layout::of(&grid);
        let mut exact = Exact::uniform(bank.parts().len() * n_angles, n_places, allowed);
        let first = Evidence::of(&views, Se2::IDENTITY, 1.0, first);
        let log_evidence = weigh(&mut exact, [&views, &grid], std::slice::from_ref(&first), 1.0);
        Self::begun(bank, grid, first, Engine::Exact(exact), log_evidence)
    }

    fn begun(bank: &Bank, grid: PoseGrid, first: Evidence, engine: Engine, log_evidence: f64) -> Self {
        let (views, n_parts) = (*bank.grid(), bank.parts().len());
        let class_posterior = engine.of_parts(n_parts, &grid);
        Self { views, grid, n_parts, touches: vec![first], engine, class_posterior, log_evidence }
    }

    /// The settings that the first touch was judged with.
    fn config(&self) -> &LikelihoodConfig {
        self.touches[0].likelihood.config()
    }

    /// Takes in a touch after the motion `sensor_from_next`, and returns its log-evidence
    /// log p(touch | touches before), up to the constant of [`TouchLikelihood`].
    pub fn update(&mut self, sensor_from_next: &Se2, likelihood: TouchLikelihood) -> f64 {
        let first_from_sensor = self.first_from_sensor() * *sensor_from_next;
        let overlap = self.config().overlap();
        let new_share = |earlier: &Evidence| overlap.new_share(&earlier.first_from_sensor, &first_from_sensor);
        let weight = if self.is_beyond(&first_from_sensor) {
            0.0
        } else {
            self.touches.iter().map(new_share).fold(1.0, f64::min)
        };
        let (before, joint) = (self.joint_weight(0.0, None), self.joint_weight(weight, Some(&likelihood)));
        let (grid, n_cells) = (&self.grid, self.grid.len());
        let log_evidence = match &mut self.engine {
            Engine::Exact(exact) => {
                self.touches.push(Evidence::of(&self.views, first_from_sensor, weight, likelihood));
                weigh(exact, [&self.views, grid], &self.touches, joint)
            }
            Engine::Particle { particle, log_likelihoods } => {
                let mut log_states = Vec::with_capacity(self.n_parts * n_cells);
                let mut take = |log_part: &[f64]| log_states.extend_from_slice(log_part);
                let grids = [&self.views, grid];
                self.touches.push(Evidence::new(grids, first_from_sensor, weight, likelihood, &mut take));
                let earlier =
                    |state| if joint == before { 0.0 } else { (joint - before) * log_score(log_likelihoods, state) };
                let log_evidence = particle.update(|state| joint * log_states[state] + earlier(state));
                log_likelihoods.push(log_states);
                particle.rejuvenate(
                    |state, direction| {
                        let cell = neighbour(grid, state % n_cells, direction)?;
                        Some(state - state % n_cells + cell)
                    },
                    |state| joint * log_score(log_likelihoods, state),
                    |state| joint * log_score(log_likelihoods, state) - log_likelihoods[0][state],
                );
                log_evidence
            }
        };
        self.class_posterior = self.engine.of_parts(self.n_parts, &self.grid);
        self.log_evidence += log_evidence;
        log_evidence
    }

    /// The total variation from the posterior over all states is at most this, 0..=1: what was left out of the belief
    /// because it cannot hold more together. At most [`ALLOWED_ERROR`]; of particles nothing is known, and it is 0.
    pub fn left_out(&self) -> f64 {
        match &self.engine {
            Engine::Exact(exact) => exact.left_out(),
            Engine::Particle { .. } => 0.0,
        }
    }

    /// Whether no state sees a recorded view after a motion since the first touch: such a touch says nothing.
    fn is_beyond(&self, first_from_sensor: &Se2) -> bool {
        let PoseGrid { xy_half_mm, xy_step_mm, .. } = self.views;
        // From one corner of the recorded area to the other, and what is trusted beyond its rim.
        let tolerance = self.config().nearest_tolerance;
        let diagonal_mm = 2.0 * std::f64::consts::SQRT_2 * xy_half_mm;
        let rim_mm = xy_step_mm * (8.0 * tolerance).max(2.0);
        first_from_sensor.x_mm.hypot(first_from_sensor.y_mm) > diagonal_mm + rim_mm
    }

    /// The power to which the likelihood of each touch is taken, 0..=1, with another one, as far as it is known, of which
    /// `new_share` is new: [`LikelihoodConfig::shared_error`](crate::LikelihoodConfig::shared_error).
    pub(crate) fn joint_weight(&self, new_share: f64, next: Option<&TouchLikelihood>) -> f64 {
        let n_touches = self.touches.iter().map(|touch| touch.weight).sum::<f64>() + new_share;
        let touches = self.touches.iter().map(|touch| &touch.likelihood).chain(next);
        (1.0 + shared_error(self.config(), touches) * (n_touches - 1.0).max(0.0)).recip()
    }

    /// log p(all touches), up to the constants of [`TouchLikelihood`]: 0 says no more than chance, -inf
    /// that no state explains a touch.
    pub fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// All touches, in order.
    pub fn touches(&self) -> &[Evidence] {
        &self.touches
    }

    /// The grid of the states: the bank's, or a finer one.
    pub fn grid(&self) -> &PoseGrid {
        &self.grid
    }

    /// The sensor's motion since the first touch.
    pub fn first_from_sensor(&self) -> Se2 {
        self.touches.last().map_or(Se2::IDENTITY, |evidence| evidence.first_from_sensor)
    }

    /// The distinct states of positive probability in ascending order, with their probabilities, which sum to 1.
    pub fn states(&self) -> Vec<(Hypothesis, f64)> {
        self.states_from(0.0)
    }

    /// Those of [`Self::states`] that have at least a probability.
    pub fn states_from(&self, least: f64) -> Vec<(Hypothesis, f64)> {
        self.states_of(0..self.n_parts, least)
    }

    /// The likeliest of [`Self::states_from`], `most` at most, ascending.
    pub fn heaviest_states(&self, least: f64, most: usize) -> Vec<(Hypothesis, f64)> {
        let mut states = match &self.engine {
            Engine::Exact(exact) => {
                let layout = Layout::of(&self.grid);
                let heaviest = exact.heaviest(least, most).into_iter();
                heaviest.map(|(state, mass)| (layout.hypothesis(state), mass)).collect()
            }
            Engine::Particle { .. } => {
                let mut states = self.states_from(least);
                keep_heaviest(&mut states, most);
                states
            }
        };
        states.sort_unstable_by_key(|(hypothesis, _)| *hypothesis);
        states
    }

    /// Those of some parts.
    fn states_of(&self, parts: Range<usize>, least: f64) -> Vec<(Hypothesis, f64)> {
        let n_cells = self.grid.len();
        let is_held = |(_, mass): &(Hypothesis, f64)| *mass > 0.0 && *mass >= least;
        match &self.engine {
            Engine::Exact(exact) => {
                let Layout { n_angles, n_places } = Layout::of(&self.grid);
                let mut states = Vec::new();
                for part in parts {
                    let of_angle = |angle| Some((angle, exact.probabilities(part * n_angles + angle)?));
                    let held: Vec<(usize, Vec<f64>)> = (0..n_angles).filter_map(of_angle).collect();
                    for place in 0..n_places {
                        let state = |(angle, masses): &(usize, Vec<f64>)| {
                            (Hypothesis { part, cell: place * n_angles + angle }, masses[place])
                        };
                        states.extend(held.iter().map(state).filter(is_held));
                    }
                }
                states
            }
            Engine::Particle { particle, .. } => {
                let masses = masses(particle, self.n_states());
                let all = parts.start * n_cells..parts.end * n_cells;
                let state = |state| (Hypothesis { part: state / n_cells, cell: state % n_cells }, masses[state]);
                all.map(state).filter(is_held).collect()
            }
        }
    }

    /// The number of states, held or not.
    pub fn n_states(&self) -> usize {
        self.n_parts * self.grid.len()
    }

    /// The probability of each part, `[n_parts]`, which sum to 1 (paper, Eq. 7).
    pub fn class_posterior(&self) -> &[f64] {
        &self.class_posterior
    }

    /// Shannon entropy over the states, nats.
    pub fn entropy_nats(&self) -> f64 {
        match &self.engine {
            Engine::Exact(exact) => exact.entropy(),
            Engine::Particle { particle, .. } => {
                let masses = masses(particle, self.n_states());
                masses.iter().filter(|mass| **mass > 0.0).map(|mass| -mass * mass.ln()).sum()
            }
        }
    }

    /// The state of largest log-posterior accumulated over all touches, among the states that the engine
    /// holds and, where `part` is given, among those of that part. The lowest of equals.
    ///
    /// `None` only where no state of `part` is held.
    pub fn best(&self, part: Option<usize>) -> Option<Hypothesis> {
        let n_cells = self.grid.len();
        let parts = part.map_or(0..self.n_parts, |part| part..part + 1);
        match &self.engine {
            Engine::Exact(exact) => {
                let layout = Layout::of(&self.grid);
                let likeliest = exact.likeliest(parts.start * layout.n_angles..parts.end * layout.n_angles);
                likeliest.into_iter().map(|state| layout.hypothesis(state)).min()
            }
            Engine::Particle { particle, log_likelihoods } => {
                let masses = masses(particle, self.n_states());
                let held = (parts.start * n_cells..parts.end * n_cells).filter(|state| masses[*state] > 0.0);
                let scored = held.map(|state| (log_score(log_likelihoods, state), state));
                let best = scored.reduce(|best, next| if next.0 > best.0 { next } else { best });
                best.map(|(_, state)| Hypothesis { part: state / n_cells, cell: state % n_cells })
            }
        }
    }

    /// The pose of the first touch around a state, to below the grid's step.
    pub fn refine(&self, state: Hypothesis) -> Refined {
        let start = self.grid.pose(state.cell);
        refine(&self.views, &self.touches, self.joint_weight(0.0, None), state.part, &start)
    }

    /// By how much one touch alone, the one that tells most, speaks for a part at a pose rather than for another at its own,
    /// nats. Poses are of the first touch.
    pub fn told_apart(&self, (part, pose): (usize, &Se2), (other, other_pose): (usize, &Se2)) -> f64 {
        let log = |touch: &Evidence, part, pose| touch.log_at(&self.views, part, pose);
        let nats = self.touches.iter().map(|touch| log(touch, part, pose) - log(touch, other, other_pose));
        nats.fold(f64::NEG_INFINITY, f64::max)
    }

    /// How well a part at a pose explains what was felt: the mean over the edged touches of [`Evidence::standard_score`], in
    /// standard deviations of such a mean; `None` where no edge was felt within the recorded area.
    pub fn fit(&self, part: usize, part_from_first: &Se2) -> Option<f64> {
        let scores = self.touches.iter().filter_map(|touch| touch.standard_score(&self.views, part, part_from_first));
        let (sum, n) = scores.fold((0.0, 0.0), |(sum, n), score| (sum + score, n + 1.0));
        // By the standard deviation of the mean of scores that share a part of their variance.
        let shared = self.config().matched_shared;
        (n > 0.0).then(|| sum / n / (shared + (1.0 - shared) / n).sqrt())
    }

    /// Share of the belief in a part, 0..=1, in states whose first touch was made within `mm` of a pose or, by the part's
    /// symmetry, of one that feels the same; a state is as wide as its cell. 0 where the part is ruled out.
    pub fn share_near(&self, part: usize, part_from_first: &Se2, mm: f64, symmetry: &Symmetry) -> f64 {
        let of_part = self.states_of(part..part + 1, 0.0);
        let reach = mm + self.grid.xy_step_mm * std::f64::consts::FRAC_1_SQRT_2;
        let is_near = |cell: usize| {
            let pose = self.grid.pose(cell);
            symmetry.nearest_twin(&pose, part_from_first).distance_mm(part_from_first) <= reach
        };
        // A ten-thousandth of it in the lightest states does not matter, and is most of them.
        let all: f64 = of_part.iter().map(|(_, mass)| mass).sum();
        let least = 1e-4 * all / self.grid.len() as f64;
        let near = of_part.iter().filter(|(state, mass)| *mass > least && is_near(state.cell));
        if all > 0.0 { near.map(|(_, mass)| mass).sum::<f64>() / all } else { 0.0 }
    }

    /// Covariance of a part's pose at the first touch, (x mm, y mm, theta rad), over all of the belief in that part: that of the
    /// hill around `refined`, and how far the states of other hills lie from there, each as often as it is believed. Of poses
    /// that the part's symmetry turns into each other the nearest counts.
    pub(crate) fn covariance(&self, part: usize, refined: &Refined, symmetry: &Symmetry) -> [[f64; 3]; 3] {
        /// Lighter states move no variance by more than this times the square of the way across the bank.
        const NEGLIGIBLE: f64 = 1e-7;
        let (of_part, here) = (self.states_of(part..part + 1, 0.0), &refined.part_from_first);
        let all: f64 = of_part.iter().map(|(_, mass)| mass).sum();
        let mut covariance = refined.covariance;
        for (state, mass) in of_part.iter().filter(|(_, mass)| *mass > NEGLIGIBLE * all) {
            let there = symmetry.nearest_twin(&self.grid.pose(state.cell), here);
            if !is_one_hill(&self.views, &there, here) {
                let turned = wrap_angle(there.theta_rad - here.theta_rad);
                let off = [there.x_mm - here.x_mm, there.y_mm - here.y_mm, turned];
                (0..3).for_each(|i| (0..3).for_each(|j| covariance[i][j] += mass / all * off[i] * off[j]));
            }
        }
        covariance
    }

    /// `n` states drawn from the belief in a part, ascending, each about as often as it is probable there; none where the
    /// belief holds none of it.
    pub fn draw_of(&self, part: usize, n: usize, rng: &mut ChaCha8Rng) -> Vec<Hypothesis> {
        let states = self.states_of(part..part + 1, 0.0);
        let all: f64 = states.iter().map(|(_, mass)| mass).sum();
        if all <= 0.0 {
            return Vec::new();
        }
        let masses: Vec<f64> = states.iter().map(|(_, mass)| mass / all).collect();
        let mut drawn: Vec<Hypothesis> =
            systematic(&masses, n, rng.random()).into_iter().map(|i| states[i].0).collect();
        drawn.sort_unstable();
        drawn
    }

    /// `n` states drawn from the belief, ascending, each about as often as it is probable.
    pub fn draw(&self, n: usize, rng: &mut ChaCha8Rng) -> Vec<Hypothesis> {
        let (offset, n_cells) = (rng.random(), self.grid.len());
        let mut drawn: Vec<Hypothesis> = match &self.engine {
            Engine::Exact(exact) => {
                let layout = Layout::of(&self.grid);
                exact.draw(n, offset).into_iter().map(|state| layout.hypothesis(state)).collect()
            }
            Engine::Particle { particle, .. } => {
                let drawn = systematic(&masses(particle, self.n_states()), n, offset);
                drawn.into_iter().map(|state| Hypothesis { part: state / n_cells, cell: state % n_cells }).collect()
            }
        };
        drawn.sort_unstable();
        drawn
    }
}

impl Engine {
    /// The probability of each part, `[n_parts]`.
    fn of_parts(&self, n_parts: usize, grid: &PoseGrid) -> Vec<f64> {
        let mut of_parts = vec![0.0; n_parts];
        match self {
            Self::Exact(exact) => {
                let n_angles = Layout::of(grid).n_angles;
                exact.shares().enumerate().for_each(|(block, share)| of_parts[block / n_angles] += share);
            }
            Self::Particle { particle, .. } => {
                particle.weighted().for_each(|(state, weight)| of_parts[state / grid.len()] += weight);
            }
        }
        of_parts
    }
}

/// Takes in the last of some touches.
fn weigh(exact: &mut Exact, grids: [&PoseGrid; 2], touches: &[Evidence], joint: f64) -> f64 {
    let mut blocks = Blocks::of(grids, touches);
    let highest = blocks.highest();
    exact.update(joint, &highest, &mut |block, touch, sums| blocks.add(block, touch, sums))
}

/// The probability of each state by its particles, `[n_states]`.
fn masses(particle: &Particle, n_states: usize) -> Vec<f64> {
    let mut masses = vec![0.0; n_states];
    particle.weighted().for_each(|(state, weight)| masses[state] += weight);
    masses
}

fn log_score(log_likelihoods: &[Vec<f64>], state: usize) -> f64 {
    log_likelihoods.iter().map(|log_states| log_states[state]).sum()
}

/// The cell one step along x (directions 0, 1), y (2, 3) or theta (4, 5); `None` off the grid.
fn neighbour(grid: &PoseGrid, cell: usize, direction: usize) -> Option<usize> {
    let (n_xy, axis) = (grid.n_xy(), direction / 2);
    let (stride, length) = (grid.strides()[axis], [n_xy, n_xy, grid.n_theta()][axis]);
    let index = cell / stride % length;
    if direction.is_multiple_of(2) {
        (index > 0).then(|| cell - stride)
    } else {
        (index + 1 < length).then(|| cell + stride)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Observation;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use tactile_data::se2::wrap_angle;
    use tactile_infer::rows::Rows;

    /// 3 x 3 x 3 = 27 poses.
    const GRID: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
    const N_CELLS: usize = 27;
    const DIM: usize = 4;

    fn unit_rows(n_rows: usize, seed: u64) -> Vec<Vec<f32>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut row = || {
            let values: Vec<f32> = (0..DIM).map(|_| rng.random::<f32>() - 0.5).collect();
            let norm = values.iter().map(|value| value * value).sum::<f32>().sqrt();
            values.iter().map(|value| value / norm).collect()
        };
        (0..n_rows).map(|_| row()).collect()
    }

    fn bank(parts: &[&[Vec<f32>]]) -> Bank {
        let names = (0..parts.len()).map(|part| part.to_string()).collect();
        let rows: Vec<f32> = parts.iter().flat_map(|rows| rows.concat()).collect();
        let shares = (0..parts.len() * N_CELLS).map(|row| if row % 5 == 0 { 0.0 } else { 0.3 }).collect();
        Bank::from_rows(names, GRID, Rows::new(DIM, rows).unwrap(), shares, "").unwrap()
    }

    fn touches(n: usize, seed: u64) -> Vec<(Se2, Observation)> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed + 1000);
        unit_rows(n, seed + 500)
            .into_iter()
            .map(|query| {
                let mut step = |scale: f64| scale * (rng.random::<f64>() - 0.5);
                let moved = Se2::from_degrees(step(8.0), step(8.0), step(60.0));
                let edge_share = if step(1.0) > 0.3 { 0.0 } else { 0.3 };
                (moved, Observation::new(query, edge_share))
            })
            .collect()
    }

    #[test]
    fn two_places_that_feel_the_same_are_not_one() {
        let mut rows = unit_rows(N_CELLS, 4);
        let [left, right] = [-4.0, 4.0].map(|x| GRID.nearest(&Se2::new(x, 0.0, 0.0)).unwrap());
        rows[right] = rows[left].clone();
        let bank = bank(&[&rows]);
        let config =
            LikelihoodConfig { temperature: 1e-3, outlier_share: 0.0, blank_share: 0.0, ..LikelihoodConfig::default() };
        let touch = TouchLikelihood::new(&Observation::new(rows[left].clone(), 0.3), &bank, &config).unwrap();
        let belief = Belief::new(&bank, EngineConfig::Exact, 1, 1, touch);
        let near = |x: f64, mm: f64, symmetry: Symmetry| belief.share_near(0, &Se2::new(x, 0.0, 0.0), mm, &symmetry);
        // A cell of 4 mm reaches 2.8 mm from its centre.
        let [at_left, between] = [-4.0, 0.0].map(|x| near(x, 1.0, Symmetry::NONE));
        assert!((at_left - 0.5).abs() < 0.01 && between < 0.01, "{at_left} {between}");
        assert!((near(-4.0, 6.0, Symmetry::NONE) - 1.0).abs() < 0.01);
        // By half a turn about the middle the state at the right is the place at the left, seen the other way round.
        let half_turn = Symmetry { order: Some(2), centre_mm: [0.0; 2] };
        let turned = Se2::new(-4.0, 0.0, std::f64::consts::PI);
        assert!((belief.share_near(0, &turned, 1.0, &half_turn) - 0.5).abs() < 0.01);
    }

    /// The probability of each state, in order.
    fn masses_of(belief: &Belief) -> Vec<f64> {
        let mut masses = vec![0.0; belief.n_states()];
        belief.states().iter().for_each(|(state, mass)| masses[state.part * belief.grid().len() + state.cell] = *mass);
        masses
    }

    /// log p(touch | state) of a touch, judged again.
    fn log_states(belief: &Belief, touch: usize) -> Vec<f64> {
        let Evidence { first_from_sensor, likelihood, weight, .. } = &belief.touches()[touch];
        let mut log_states = Vec::new();
        let mut take = |log_part: &[f64]| log_states.extend_from_slice(log_part);
        Evidence::new([&belief.views, &belief.grid], *first_from_sensor, *weight, likelihood.clone(), &mut take);
        log_states
    }

    /// Touches that share no evidence, wherever they are, and no error.
    fn independent() -> LikelihoodConfig {
        LikelihoodConfig { overlap_mm: 0.0, shared_error: 0.0, ..LikelihoodConfig::default() }
    }

    fn run(bank: &Bank, engine: EngineConfig, touches: &[(Se2, Observation)], config: &LikelihoodConfig) -> Belief {
        let likelihood = |touch: &Observation| TouchLikelihood::new(touch, bank, config).unwrap();
        let mut belief = Belief::new(bank, engine, 1, 3, likelihood(&touches[0].1));
        for (moved, touch) in &touches[1..] {
            belief.update(moved, likelihood(touch));
        }
        belief
    }

    /// The same with all states.
    fn run_all(bank: &Bank, touches: &[(Se2, Observation)], config: &LikelihoodConfig) -> Belief {
        let likelihood = |touch: &Observation| TouchLikelihood::new(touch, bank, config).unwrap();
        let mut belief = Belief::of_all_states(bank, 1, likelihood(&touches[0].1));
        for (moved, touch) in &touches[1..] {
            belief.update(moved, likelihood(touch));
        }
        belief
    }

    /// Every fifth row is blank.
    fn blank_row(row: usize) -> bool {
        row.is_multiple_of(5)
    }

    /// The power of each touch's likelihood: one of `n` by how much error they share, six times as much where the best rows
    /// have a cosine of 0.7 with the edged ones as where that is 0.95.
    fn joint(rows: &[Vec<f32>], touches: &[(Se2, Observation)], c: &LikelihoodConfig) -> f64 {
        let cosine = |row: usize, touch: &Observation| {
            rows[row].iter().zip(&touch.query).map(|(a, b)| f64::from(a * b)).sum::<f64>()
        };
        let best = |touch: &Observation| {
            (0..rows.len()).filter(|row| !blank_row(*row)).map(|row| cosine(row, touch)).fold(-1.0, f64::max)
        };
        let edged = touches.iter().map(|(_, touch)| touch).filter(|touch| touch.edge_share > 0.0);
        let bests: Vec<f64> = edged.map(best).collect();
        let mean = bests.iter().sum::<f64>() / bests.len().max(1) as f64;
        let doubt = if bests.is_empty() { 0.0 } else { ((0.95 - mean) / 0.25).clamp(0.0, 1.0) };
        1.0 / (1.0 + c.shared_error * (1.0 + 5.0 * doubt) * (touches.len() - 1) as f64)
    }

    /// The posterior straight from its definition, in f64 probabilities: no logs, no shared interpolation.
    fn brute_force(
        rows: &[Vec<f32>],
        n_parts: usize,
        touches: &[(Se2, Observation)],
        c: &LikelihoodConfig,
    ) -> Vec<f64> {
        let likelihoods: Vec<Vec<f64>> = touches
            .iter()
            .map(|(_, touch)| {
                let cosine = |row: &Vec<f32>| -> f64 {
                    row.iter().zip(&touch.query).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
                };
                let cosines: Vec<f64> = rows.iter().map(cosine).collect();
                let edged = || (0..rows.len()).filter(|row| !blank_row(*row));
                let best = edged().map(|row| cosines[row]).fold(-1.0, f64::max);
                let alike = |row: usize| ((cosines[row] - best) / c.temperature).exp();
                let mean = edged().map(alike).sum::<f64>() / edged().count() as f64;
                let look = |row: usize| (1.0 - c.outlier_share) * alike(row) / mean + c.outlier_share;
                (0..rows.len())
                    .map(|row| match (blank_row(row), touch.edge_share == 0.0) {
                        (false, false) => c.blank_agreement * look(row),
                        (true, true) => c.blank_agreement,
                        _ => 1.0 - c.blank_agreement,
                    })
                    .collect()
            })
            .collect();
        let joint = joint(rows, touches, c);
        let mut masses: Vec<f64> = (0..n_parts * N_CELLS)
            .map(|state| {
                let mut pose = GRID.pose(state % N_CELLS);
                let mut product = 1.0;
                for (index, (moved, _)) in touches.iter().enumerate() {
                    if index > 0 {
                        pose = pose * *moved;
                    }
                    // Blank or not, an unknown view is as likely one as the other.
                    let average = 0.5;
                    let distance = |cell: usize| {
                        let recorded = GRID.pose(cell);
                        let shift = recorded.distance_mm(&pose) / 4.0;
                        shift.max((recorded.theta_rad - pose.theta_rad).to_degrees().abs() / 30.0)
                    };
                    let inside = pose.x_mm.abs() <= 6.0 && pose.y_mm.abs() <= 6.0 && pose.theta_deg().abs() <= 45.0;
                    let apart = |a: f64, b: f64, step: f64| (a - b).abs() <= step / 2.0;
                    let cell = (0..N_CELLS).find(|cell| {
                        let recorded = GRID.pose(*cell);
                        apart(recorded.x_mm, pose.x_mm, 4.0)
                            && apart(recorded.y_mm, pose.y_mm, 4.0)
                            && apart(recorded.theta_deg(), pose.theta_deg(), 30.0)
                    });
                    product *= match cell.filter(|_| inside) {
                        None => average,
                        Some(cell) => {
                            let excess = (distance(cell) / c.nearest_tolerance - 1.0).max(0.0);
                            let trust = (-excess * excess / 2.0).exp();
                            trust * likelihoods[index][state / N_CELLS * N_CELLS + cell] + (1.0 - trust) * average
                        }
                    };
                }
                product.powf(joint)
            })
            .collect();
        let sum: f64 = masses.iter().sum();
        masses.iter_mut().for_each(|mass| *mass /= sum);
        masses
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn the_exact_engine_agrees_with_the_definition(seed in 0..1000_u64, n_touches in 1..6_usize) {
            let rows = unit_rows(3 * N_CELLS, seed);
            let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
            let touches = touches(n_touches, seed);
            let config = LikelihoodConfig { shared_error: 0.1, ..independent() };
            let belief = run_all(&bank, &touches, &config);
            let expected = brute_force(&rows, 3, &touches, &config);
            for (got, expected) in masses_of(&belief).iter().zip(&expected) {
                // Cosines are f32 (error 1e-7), divided by tau 0.1, over at most 5 touches.
                prop_assert!((got - expected).abs() <= 1e-5 * expected + 1e-12, "{got} {expected}");
            }
        }

        /// Of touches at random, which contradict each other, after each of them.
        #[test]
        fn what_is_left_out_moves_the_posterior_no_more_than_it_says(seed in 0..1000_u64, cubic in any::<bool>()) {
            let rows = unit_rows(3 * N_CELLS, seed);
            let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
            let interpolation =
                if cubic { crate::interpolation::Interpolation::Cubic } else { crate::interpolation::Interpolation::Nearest };
            let config = LikelihoodConfig { interpolation, ..LikelihoodConfig::default() };
            let touches = touches(10, seed);
            for n_touches in 1..=10 {
                let belief = run(&bank, EngineConfig::Exact, &touches[..n_touches], &config);
                let all = run_all(&bank, &touches[..n_touches], &config);
                let (belief_masses, all_masses) = (masses_of(&belief), masses_of(&all));
                let apart = belief_masses.iter().zip(&all_masses).map(|(a, b)| (a - b).abs()).sum::<f64>() / 2.0;
                prop_assert!(apart <= belief.left_out() + 1e-12 && belief.left_out() <= ALLOWED_ERROR, "{apart}");
                prop_assert_eq!(all.left_out(), 0.0);
            }
        }

        #[test]
        fn the_posterior_is_normalised(seed in 0..1000_u64, particles in any::<bool>()) {
            let rows = unit_rows(2 * N_CELLS, seed);
            let bank = bank(&[&rows[..27], &rows[27..]]);
            let engine = if particles { EngineConfig::Particle(ParticleConfig::default()) } else { EngineConfig::Exact };
            let belief = run(&bank, engine, &touches(4, seed), &LikelihoodConfig::default());
            prop_assert!((belief.class_posterior().iter().sum::<f64>() - 1.0).abs() < 1e-9);
            prop_assert!((belief.states().iter().map(|(_, mass)| mass).sum::<f64>() - 1.0).abs() < 1e-9);
            prop_assert!(belief.entropy_nats() >= 0.0 && belief.entropy_nats() <= 54.0_f64.ln() + 1e-9);
        }

        #[test]
        fn permuting_the_parts_permutes_the_posterior(seed in 0..1000_u64) {
            let rows = unit_rows(2 * N_CELLS, seed);
            // Nothing blank: this bank's blank rows do not move with their parts.
            let config = LikelihoodConfig { blank_share: 0.0, ..LikelihoodConfig::default() };
            let posterior = |parts: &[&[Vec<f32>]]| {
                run(&bank(parts), EngineConfig::Exact, &touches(4, seed), &config).class_posterior().to_vec()
            };
            let (there, back) = (posterior(&[&rows[..27], &rows[27..]]), posterior(&[&rows[27..], &rows[..27]]));
            prop_assert!((there[0] - back[1]).abs() < 1e-9 && (there[1] - back[0]).abs() < 1e-9);
        }

        #[test]
        fn an_action_and_its_inverse_look_up_the_same_rows(
            x in -30.0..30.0_f64, y in -30.0..30.0_f64, theta in -170.0..170.0_f64,
        ) {
            let rows = unit_rows(N_CELLS, 1);
            let bank = bank(&[&rows]);
            let there = Se2::from_degrees(x, y, theta);
            let mut touches = touches(3, 1);
            touches[1].0 = there;
            touches[2].0 = there.inverse();
            touches[2].1 = touches[0].1.clone();
            let belief = run(&bank, EngineConfig::Exact, &touches, &independent());
            let logs = [2, 0].map(|touch| log_states(&belief, touch));
            let apart = logs[0].iter().zip(&logs[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            prop_assert!(apart < 1e-9);
        }
    }

    #[test]
    fn many_particles_agree_with_the_exact_engine() {
        let rows = unit_rows(3 * N_CELLS, 11);
        let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
        let (touches, config) = (touches(4, 11), LikelihoodConfig::default());
        let exact = run(&bank, EngineConfig::Exact, &touches, &config);
        for n_moves in [0, 4] {
            let engine = ParticleConfig { n_particles: 20_000, n_moves, adaptive: false, ..ParticleConfig::default() };
            let particle = run(&bank, EngineConfig::Particle(engine), &touches, &config);
            for (a, b) in particle.class_posterior().iter().zip(exact.class_posterior()) {
                // Standard error of a share of 2e4 draws: 0.0035; at an effective size of a tenth: 0.011; four of those.
                assert!((a - b).abs() < 0.045, "{a} {b} with {n_moves} moves");
            }
            assert_eq!(particle.best(None), exact.best(None));
        }
    }

    #[test]
    fn one_part_and_one_particle_and_half_a_turn_are_fine() {
        let rows = unit_rows(N_CELLS, 2);
        let bank = bank(&[&rows]);
        let mut touches = touches(3, 2);
        touches[1].0 = Se2::from_degrees(0.0, 0.0, 180.0);
        touches[2].0 = Se2::from_degrees(0.0, 0.0, -180.0);
        let engine = ParticleConfig { n_particles: 1, ..ParticleConfig::default() };
        for engine in [EngineConfig::Exact, EngineConfig::Particle(engine)] {
            let belief = run(&bank, engine, &touches, &LikelihoodConfig::default());
            assert!((belief.class_posterior()[0] - 1.0).abs() < 1e-12);
            // Half a turn leads out of a reach of 30 degrees: unknown, never no contact.
            let unknown = |touch: usize| belief.touches()[touch].likelihood.log_unknown;
            assert!(log_states(&belief, 1).iter().all(|log| *log == unknown(1)));
            assert!(log_states(&belief, 0).iter().any(|log| *log != unknown(0)));
        }
    }

    #[test]
    fn the_same_touch_twice_tells_nothing_new() {
        let rows = unit_rows(2 * N_CELLS, 6);
        let bank = bank(&[&rows[..27], &rows[27..]]);
        let mut touches = touches(2, 6);
        touches[1] = (Se2::IDENTITY, touches[0].1.clone());
        let once = run_all(&bank, &touches[..1], &LikelihoodConfig::default());
        let twice = run_all(&bank, &touches, &LikelihoodConfig::default());
        assert!(masses_of(&once).iter().zip(masses_of(&twice).iter()).all(|(a, b)| (a - b).abs() < 1e-12));
        let counted_twice = run(&bank, EngineConfig::Exact, &touches, &independent());
        assert!(counted_twice.entropy_nats() < once.entropy_nats() - 0.1);
    }

    #[test]
    fn a_finer_grid_of_states_holds_the_coarser_one() {
        let rows = unit_rows(2 * N_CELLS, 8);
        let bank = bank(&[&rows[..27], &rows[27..]]);
        let config = LikelihoodConfig { interpolation: crate::interpolation::Interpolation::Cubic, ..independent() };
        let (touches, likelihood) = (touches(1, 8), |touch| TouchLikelihood::new(touch, &bank, &config).unwrap());
        let belief = |n| Belief::new(&bank, EngineConfig::Exact, n, 3, likelihood(&touches[0].1));
        let (coarse, fine) = (belief(1), belief(2));
        assert_eq!(fine.grid().len(), 5 * 5 * 5);
        let logs = [&coarse, &fine].map(|belief| log_states(belief, 0));
        for cell in 0..N_CELLS {
            let same = fine.grid().nearest(&GRID.pose(cell)).unwrap();
            assert!((logs[0][cell] - logs[1][same]).abs() < 1e-4);
        }
        assert!((fine.class_posterior().iter().sum::<f64>() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_touch_outside_the_recorded_area_changes_nothing() {
        let rows = unit_rows(2 * N_CELLS, 4);
        let bank = bank(&[&rows[..27], &rows[27..]]);
        let mut touches = touches(2, 4);
        touches[1].0 = Se2::from_degrees(100.0, 0.0, 0.0);
        let config = LikelihoodConfig::default();
        let (before, after) = (run_all(&bank, &touches[..1], &config), run_all(&bank, &touches, &config));
        for (a, b) in masses_of(&before).iter().zip(masses_of(&after).iter()) {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn neighbours_are_one_step_away_and_back() {
        for cell in 0..N_CELLS {
            for direction in 0..6 {
                let Some(next) = neighbour(&GRID, cell, direction) else { continue };
                let (a, b) = (GRID.pose(cell), GRID.pose(next));
                let turned = wrap_angle(a.theta_rad - b.theta_rad).to_degrees().abs();
                assert!((a.distance_mm(&b) / 4.0 + turned / 30.0 - 1.0).abs() < 1e-9);
                assert_eq!(neighbour(&GRID, next, direction ^ 1), Some(cell));
            }
        }
    }
}

//! Where the sensor may have evidence first, and on which part: the belief over all hypotheses.
//!
//! A state is a part and the grid cell of the FIRST touch; later touches follow from the motions the
//! controller reports, `part_from_sensor = part_from_first * first_from_sensor` (paper, Sec. IV-D). The
//! likelihood of each touch is kept, so that any state can be scored again over all touches.

mod of_part;
mod spread;

use std::ops::Range;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;
use tactile_infer::Bank;

use crate::blocks::{Blocks, Layout};
use crate::doubt::shared_error;
use crate::evidence::Evidence;
use crate::exact::{Exact, keep_heaviest};
pub use crate::hypothesis::Hypothesis;
use crate::hypothesis::states_between;
use crate::likelihood::{LikelihoodConfig, TouchLikelihood};
use crate::particle::{Particle, ParticleConfig};
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
    /// `subdivisions`: parts of a step of 2 mm and 15 degrees between two states, at least 1; a finer bank has at least
    /// the states of its views. More than 1 only where views are interpolated between the bank's poses: a state may
    /// then lie between them.
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

    /// The power to which the likelihood of each touch is taken, 0..=1, with another one, as far as it is known, of
    /// which `new_share` is new: [`LikelihoodConfig::shared_error`](crate::LikelihoodConfig::shared_error).
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

    /// The states among [`Self::states`] that have at least a probability.
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

    /// The states of some parts.
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

/// The cell one step along x (directions 0, 1), y (2, 3) or theta (4, 5), round the circle where the angles go round;
/// `None` off the grid.
fn neighbour(grid: &PoseGrid, cell: usize, direction: usize) -> Option<usize> {
    let (n_xy, axis) = (grid.n_xy(), direction / 2);
    let (stride, length) = (grid.strides()[axis], [n_xy, n_xy, grid.n_theta()][axis]);
    let index = cell / stride % length;
    if axis == 2 && grid.goes_round() {
        let step = if direction.is_multiple_of(2) { length - 1 } else { 1 };
        return Some(cell - index + (index + step) % length);
    }
    if direction.is_multiple_of(2) {
        (index > 0).then(|| cell - stride)
    } else {
        (index + 1 < length).then(|| cell + stride)
    }
}

#[cfg(test)]
mod tests;

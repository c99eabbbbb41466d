//! The two ways to weigh states by touches.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;

use crate::belief::bayes::ALLOWED_ERROR;
use crate::belief::blocks::{Blocks, log_states};
use crate::belief::exact::Exact;
use crate::belief::hypothesis::{Hypothesis, Layout};
use crate::belief::particle::{Particle, ParticleConfig};
use crate::belief::posterior::{Best, Block, Posterior, Values, Weighed};
use crate::belief::resample::log_normalize;
use crate::likelihood::evidence::Evidence;

/// Which inference runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EngineConfig {
    /// All states: exact on the grid, but for [`ALLOWED_ERROR`](crate::belief::ALLOWED_ERROR).
    #[default]
    Exact,
    /// The paper's particle filter.
    Particle(ParticleConfig),
}

/// How an engine begins.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Start {
    /// All states; `allowed` as in [`Exact::uniform`].
    Exact { allowed: f64 },
    /// Particles drawn after the first touch.
    Particles { config: ParticleConfig, seed: u64 },
}

impl Start {
    /// As an engine begins by default.
    pub(crate) fn of(engine: EngineConfig, seed: u64) -> Self {
        match engine {
            EngineConfig::Exact => Self::Exact { allowed: ALLOWED_ERROR },
            EngineConfig::Particle(config) => Self::Particles { config, seed },
        }
    }
}

/// What weighs states. Two grids are always the bank's grid and the states' grid.
#[derive(Clone, Debug)]
pub(crate) enum Engine {
    Exact(Exact),
    Particles(Particles),
}

/// Particles, and log p(touch | state) of each touch, to score the states that they hold.
#[derive(Clone, Debug)]
pub(crate) struct Particles {
    particle: Particle,
    log_likelihoods: Vec<Vec<f64>>,
}

impl Engine {
    /// An engine after one touch of some parts; with its log-evidence.
    pub fn begin(grids: [&PoseGrid; 2], n_parts: usize, start: Start, first: &Evidence) -> (Self, f64) {
        match start {
            Start::Exact { allowed } => {
                let layout = Layout::of(grids[1]);
                let mut engine = Self::Exact(Exact::uniform(layout, n_parts * layout.n_angles, allowed));
                let log_evidence = engine.weigh(grids, std::slice::from_ref(first));
                (engine, log_evidence)
            }
            Start::Particles { config, seed } => Self::draw(grids, config, seed, first),
        }
    }

    fn draw(grids: [&PoseGrid; 2], config: ParticleConfig, seed: u64, first: &Evidence) -> (Self, f64) {
        let log_states = log_states(grids, first);
        let mut log_posterior = log_states.clone();
        let log_sum = log_normalize(&mut log_posterior).unwrap_or(f64::NEG_INFINITY);
        let log_evidence = log_sum - (log_states.len() as f64).ln();
        let particle = Particle::draw(config, &log_posterior, seed);
        (Self::Particles(Particles { particle, log_likelihoods: vec![log_states] }), log_evidence)
    }

    /// Bayes' rule (paper, Eq. 4) for the last of some touches; returns its log-evidence, up to the constant of
    /// [`TouchLikelihood`](crate::likelihood::TouchLikelihood).
    pub fn weigh(&mut self, grids: [&PoseGrid; 2], touches: &[Evidence]) -> f64 {
        match self {
            Self::Exact(exact) => {
                let mut blocks = Blocks::of(grids, touches);
                let highest = blocks.highest();
                exact.update(&highest, &mut |block, touch, sums| blocks.add(block, touch, sums))
            }
            Self::Particles(particles) => {
                let log_states = touches.last().map_or_else(Vec::new, |touch| log_states(grids, touch));
                particles.weigh(log_states)
            }
        }
    }

    /// What is believed now of the states of some parts at the poses of a grid.
    pub fn posterior(&self, states: &PoseGrid, n_parts: usize) -> Posterior {
        match self {
            Self::Exact(exact) => Posterior::new(*states, Layout::of(states), exact.weighed()),
            Self::Particles(particles) => {
                let layout = Layout { n_angles: 1, n_places: states.len() };
                Posterior::new(*states, layout, particles.weighed(n_parts, states.len()))
            }
        }
    }
}

impl Particles {
    fn weigh(&mut self, log_states: Vec<f64>) -> f64 {
        let log_evidence = self.particle.update(|state| log_states[state]);
        self.log_likelihoods.push(log_states);
        log_evidence
    }

    /// The probability of each state by its particles; a block is a part.
    fn weighed(&self, n_parts: usize, n_cells: usize) -> Weighed {
        let mut probabilities = vec![0.0; n_parts * n_cells];
        let mut blocks = vec![Block::default(); n_parts];
        for (state, weight) in self.particle.weighted() {
            probabilities[state] += weight;
            blocks[state / n_cells].share += weight;
        }
        let mut best: Vec<Option<Best>> = vec![None; n_parts];
        let held = probabilities.iter().copied().enumerate().filter(|(_, probability)| *probability > 0.0);
        for (state, probability) in held {
            let part = state / n_cells;
            let block = &mut blocks[part];
            block.top = block.top.max(probability);
            block.entropy -= probability * probability.ln();
            let score = log_score(&self.log_likelihoods, state);
            if best[part].is_none_or(|best| score > best.score) {
                best[part] = Some(Best { score, state: Hypothesis { part, cell: state % n_cells } });
            }
        }
        Weighed { blocks, values: Values::Probabilities(probabilities), best, left_out: 0.0 }
    }
}

fn log_score(log_likelihoods: &[Vec<f64>], state: usize) -> f64 {
    log_likelihoods.iter().map(|log_states| log_states[state]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_say_of_states_what_their_weights_sum_to() {
        let log_first: Vec<f64> = [1.0, 0.0, 3.0, 0.0, 2.0, 0.0].iter().map(|p: &f64| (p / 6.0).ln()).collect();
        let config = ParticleConfig { n_particles: 600, ..ParticleConfig::paper() };
        let particle = Particle::draw(config, &log_first, 4);
        let mut counts = [0.0; 6];
        particle.weighted().for_each(|(state, _)| counts[state] += 1.0 / 600.0);
        let particles = Particles { particle, log_likelihoods: vec![vec![0.5, 9.0, 0.7, 9.0, 0.7, 9.0]] };
        let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
        let layout = Layout { n_angles: 1, n_places: 3 };
        let posterior = Posterior::new(grid, layout, particles.weighed(2, 3));
        let held: Vec<(Hypothesis, f64)> = [0, 2, 4]
            .map(|state| (Hypothesis { part: state / 3, cell: state % 3 }, counts[state]))
            .into_iter()
            .collect();
        for ((state, p), (expected, count)) in posterior.states().iter().zip(&held) {
            assert!(state == expected && (p - count).abs() < 1e-12, "{state:?} {p} {count}");
        }
        let entropy: f64 = counts.iter().filter(|p| **p > 0.0).map(|p| -p * p.ln()).sum();
        assert!((posterior.entropy_nats() - entropy).abs() < 1e-12);
        assert!((posterior.by_part()[0] - counts[0] - counts[2]).abs() < 1e-12);
        // By the score, not by the number of particles; the first of equals.
        assert_eq!([posterior.best(None), posterior.best(Some(1))], [Some(held[1].0), Some(held[2].0)]);
        assert_eq!(posterior.heaviest_states(0.2, 1).iter().map(|(state, _)| *state).collect::<Vec<_>>(), [held[1].0]);
    }
}

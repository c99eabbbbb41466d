//! The paper's particle filter (Alg. 1): `K` states drawn after the first touch, weighted by the later ones.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::belief::resample::{effective_sample_size, log_normalize, systematic};
use crate::error::{Error, Result};

/// The most particles: each of them is weighed, and may be drawn again, at every touch.
const MOST: usize = 1_000_000;

/// How the particle filter works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ParticleConfig {
    /// K, 1 to 1,000,000.
    pub n_particles: usize,
    /// Resample when the effective sample size is at most this share of K, 0..=1. One: at each touch.
    pub resample_share: f64,
}

impl Default for ParticleConfig {
    /// 5,000, resampled when half degenerate.
    fn default() -> Self {
        Self { n_particles: 5_000, resample_share: 0.5 }
    }
}

impl ParticleConfig {
    /// Alg. 1 as printed: K = 100, resampled at each touch.
    pub fn paper() -> Self {
        Self { n_particles: 100, resample_share: 1.0 }
    }

    /// Refuses numbers outside their ranges.
    pub(crate) fn validate(&self) -> Result<()> {
        let Self { n_particles, resample_share } = *self;
        if !(0.0..=1.0).contains(&resample_share) {
            return Err(Error::config("episode.engine.resample_share", "0..=1", resample_share.to_string()));
        }
        if !(1..=MOST).contains(&n_particles) {
            let expected = format!("1 to {MOST}");
            return Err(Error::config("episode.engine.n_particles", expected, n_particles.to_string()));
        }
        Ok(())
    }
}

/// Weighted states; a state is an index below the number of states.
#[derive(Clone, Debug)]
pub struct Particle {
    config: ParticleConfig,
    states: Vec<usize>,
    log_weights: Vec<f64>,
    seed: u64,
    n_updates: u64,
}

impl Particle {
    /// Draws K particles from the first touch's categorical distribution (paper, Eq. 3; Alg. 1, lines 3-7).
    ///
    /// `first`: each state's log-posterior after the first touch, normalised.
    pub fn draw(config: ParticleConfig, first: &[f64], seed: u64) -> Self {
        let cumulate = |sum: &mut f64, log: &f64| {
            *sum += log.exp();
            Some(*sum)
        };
        let cumulative: Vec<f64> = first.iter().scan(0.0, cumulate).collect();
        let mut rng = stream(seed, 0);
        let n = config.n_particles.max(1);
        let states = (0..n).map(|_| draw_one(&cumulative, &mut rng)).collect();
        Self { config, states, log_weights: vec![-(n as f64).ln(); n], seed, n_updates: 0 }
    }

    /// Weighs the particles by a touch (Alg. 1, lines 12-17), resamples where they have degenerated, and
    /// returns the touch's log-evidence.
    ///
    /// A touch that no particle explains says nothing: the weights stay, and the log-evidence is -inf.
    pub fn update(&mut self, log_likelihood: impl Fn(usize) -> f64) -> f64 {
        let mut updated: Vec<f64> =
            self.states.iter().zip(&self.log_weights).map(|(state, log)| log + log_likelihood(*state)).collect();
        let Some(log_evidence) = log_normalize(&mut updated) else { return f64::NEG_INFINITY };
        self.log_weights = updated;
        self.n_updates += 1;
        let n = self.states.len();
        // The tolerance: K equal weights sum to an effective size of K only to rounding.
        if effective_sample_size(&self.log_weights) <= self.config.resample_share * n as f64 * (1.0 + 1e-9) {
            let weights: Vec<f64> = self.log_weights.iter().map(|log| log.exp()).collect();
            // Every second stream, as in the episodes that were published.
            let offset = stream(self.seed, 2 * self.n_updates - 1).random();
            self.states = systematic(&weights, n, offset).into_iter().map(|index| self.states[index]).collect();
            self.log_weights = vec![-(n as f64).ln(); n];
        }
        log_evidence
    }

    /// Each particle's state and its weight; the weights sum to 1.
    pub fn weighted(&self) -> impl Iterator<Item = (usize, f64)> {
        self.states.iter().copied().zip(self.log_weights.iter().map(|log| log.exp()))
    }
}

/// Random draws of their own for each step of an episode.
fn stream(seed: u64, step: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed.wrapping_add(step.wrapping_mul(0x9E37_79B9_7F4A_7C15)))
}

/// A draw from a cumulative distribution; states of probability zero never come up.
fn draw_one(cumulative: &[f64], rng: &mut ChaCha8Rng) -> usize {
    let total = cumulative.last().copied().unwrap_or(0.0);
    let position = rng.random::<f64>() * total;
    cumulative.partition_point(|sum| *sum <= position).min(cumulative.partition_point(|sum| *sum < total))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOUCHES: [[f64; 4]; 3] = [[0.4, 0.3, 0.2, 0.1], [0.1, 0.5, 0.2, 0.2], [0.3, 0.6, 0.9, 0.1]];

    fn after_all_touches(config: ParticleConfig) -> Vec<f64> {
        let first: Vec<f64> = TOUCHES[0].iter().map(|p: &f64| p.ln()).collect();
        let mut particle = Particle::draw(config, &first, 7);
        for touch in &TOUCHES[1..] {
            particle.update(|state| touch[state].ln());
        }
        let mut masses = vec![0.0; 4];
        particle.weighted().for_each(|(state, weight)| masses[state] += weight);
        masses
    }

    #[test]
    fn many_particles_agree_with_the_normalised_product() {
        let product = |state: usize| TOUCHES.iter().map(|touch| touch[state]).product::<f64>();
        let sum: f64 = (0..4).map(product).sum();
        for resample_share in [0.0, 0.5, 1.0] {
            let config = ParticleConfig { n_particles: 100_000, resample_share };
            for (state, mass) in after_all_touches(config).iter().enumerate() {
                // Standard error of a share of 1e5 draws is at most 0.0016; weights of up to 5 times the mean
                // and three rounds of resampling at most treble it; four of those.
                let exact = product(state) / sum;
                assert!((mass - exact).abs() < 0.02, "{config:?}: {mass} against {exact}");
            }
        }
    }

    #[test]
    fn a_particle_that_says_nothing_any_more_is_removed() {
        // mcl_3dl#232: the first particle was never removed; pfilter#8: weights went to other particles.
        let mut particle = Particle::draw(ParticleConfig::paper(), &[0.25_f64.ln(); 4], 1);
        let (first, others) = (particle.states[0], particle.states.clone());
        particle.update(|state| if state == first { f64::NEG_INFINITY } else { 0.0 });
        assert!(others.contains(&first) && particle.weighted().all(|(state, _)| state != first));
        let sum: f64 = particle.weighted().map(|(_, weight)| weight).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }

    #[test]
    fn dead_particles_keep_their_weights() {
        let mut particle = Particle::draw(ParticleConfig::paper(), &[0.5_f64.ln(); 2], 1);
        assert_eq!(particle.update(|_| f64::NAN), f64::NEG_INFINITY);
        assert!(particle.weighted().all(|(_, weight)| (weight - 0.01).abs() < 1e-12));
    }

    #[test]
    fn one_particle_is_enough_to_run() {
        let config = ParticleConfig { n_particles: 1, ..ParticleConfig::default() };
        let masses = after_all_touches(config);
        assert!((masses.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_evidence_is_the_same_however_often_it_resamples() {
        // LowLevelParticleFilters.jl#134: right only when resampling at each step.
        let first: Vec<f64> = TOUCHES[0].iter().map(|p| p.ln()).collect();
        let log_evidence = |resample_share| {
            let config = ParticleConfig { n_particles: 100_000, resample_share };
            let mut particle = Particle::draw(config, &first, 5);
            (1..3).map(|touch| particle.update(|state| TOUCHES[touch][state].ln())).sum::<f64>()
        };
        let product = |state: usize| TOUCHES.iter().map(|touch| touch[state]).product::<f64>();
        let exact = (0..4).map(product).sum::<f64>().ln();
        for share in [0.0, 0.5, 1.0] {
            // Relative error of a mean of 1e5 draws whose weights vary by about their mean: 0.003; four of those.
            assert!((log_evidence(share) - exact).abs() < 0.013);
        }
    }
}

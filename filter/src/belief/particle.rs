//! The paper's particle filter (Alg. 1): `K` states drawn after the first touch, weighted by the later ones.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::belief::resample::{effective_sample_size, log_normalize, systematic};
use crate::error::{Error, Result};

/// The most particles times moves and one. Within ten touches of twelve small letters 200,000 particles of four moves
/// took up to 0.6 s a touch, a million of them up to 10.5 s (one core of a busy cloud machine): each move weighs all
/// touches again.
const MAX_MOVES: f64 = 1e6;

/// How the particle filter works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ParticleConfig {
    /// K, or where it is adaptive its largest, 1 to 1,000,000; times one more than `n_moves` at most as many.
    pub n_particles: usize,
    /// Resample when the effective sample size is at most this share of K, 0..=1. One: at each touch.
    pub resample_share: f64,
    /// Whether a resampling keeps only as many particles as the states still occupied ask for (KLD
    /// sampling, Fox 2003), between 100 and `n_particles`; else always `n_particles`.
    pub adaptive: bool,
    /// Metropolis-Hastings moves of each particle after each touch; zero leaves duplicates as they are.
    pub n_moves: usize,
}

impl Default for ParticleConfig {
    /// Up to 5,000, as many as the spread of the belief asks for, resampled when half degenerate and
    /// rejuvenated.
    fn default() -> Self {
        Self { n_particles: 5_000, resample_share: 0.5, adaptive: true, n_moves: 4 }
    }
}

impl ParticleConfig {
    /// Alg. 1 as printed: K = 100, resampled at each touch, duplicates never moved.
    pub fn paper() -> Self {
        Self { n_particles: 100, resample_share: 1.0, adaptive: false, n_moves: 0 }
    }

    /// Refuses numbers outside their ranges, and particles whose moves take more than a second at each touch.
    pub(crate) fn validate(&self) -> Result<()> {
        let Self { n_particles, resample_share, n_moves, .. } = *self;
        if !(0.0..=1.0).contains(&resample_share) {
            return Err(Error::config("episode.engine.resample_share", "0..=1", resample_share.to_string()));
        }
        if !(1..=MAX_MOVES as usize).contains(&n_particles) {
            let expected = format!("1 to {MAX_MOVES}");
            return Err(Error::config("episode.engine.n_particles", expected, n_particles.to_string()));
        }
        let moves = n_particles as f64 * (1.0 + n_moves as f64);
        if moves <= MAX_MOVES {
            return Ok(());
        }
        let expected = format!("at most {MAX_MOVES:e} particles times moves, one more than n_moves");
        Err(Error::config(
            "episode.engine.n_particles, n_moves",
            expected,
            format!("{n_particles} x {}", n_moves as f64 + 1.0),
        ))
    }
}

/// Weighted states; a state is an index below the number of states.
#[derive(Clone, Debug)]
pub struct Particle {
    config: ParticleConfig,
    states: Vec<usize>,
    log_weights: Vec<f64>,
    /// Cumulative probability of each state after the first touch alone, `[n_states]`.
    first_cumulative: Vec<f64>,
    seed: u64,
    n_streams: u64,
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
        let first_cumulative: Vec<f64> = first.iter().scan(0.0, cumulate).collect();
        let mut rng = stream(seed, 0);
        let n = config.n_particles.max(1);
        let states = (0..n).map(|_| draw_one(&first_cumulative, &mut rng)).collect();
        Self { config, states, log_weights: vec![-(n as f64).ln(); n], first_cumulative, seed, n_streams: 0 }
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
        self.n_streams += 1;
        let n = self.states.len();
        // The tolerance: K equal weights sum to an effective size of K only to rounding.
        if effective_sample_size(&self.log_weights) <= self.config.resample_share * n as f64 * (1.0 + 1e-9) {
            let weights: Vec<f64> = self.log_weights.iter().map(|log| log.exp()).collect();
            let offset = stream(self.seed, self.n_streams).random();
            let most = self.config.n_particles.max(1);
            let n = if self.config.adaptive { self.enough(&systematic(&weights, most, offset)).min(most) } else { n };
            self.states = systematic(&weights, n, offset).into_iter().map(|index| self.states[index]).collect();
            self.log_weights = vec![-(n as f64).ln(); n];
        }
        log_evidence
    }

    /// Particles that stand for the states a full resampling occupies, at least 100.
    fn enough(&self, drawn: &[usize]) -> usize {
        let mut occupied: Vec<usize> = drawn.iter().map(|index| self.states[*index]).collect();
        occupied.sort_unstable();
        occupied.dedup();
        kld_bound(occupied.len()).max(100)
    }

    /// Moves each particle without changing what the particles stand for (Metropolis-Hastings), so that
    /// duplicates part and a lost state can return.
    ///
    /// Odd moves propose a `neighbour` of the state (one of the directions 0..6, symmetric; `None` stays), even
    /// ones a fresh draw from the first touch. `log_posterior` re-scores a state over all touches and
    /// `log_later` over all but the first, both up to a constant.
    pub fn rejuvenate(
        &mut self,
        neighbour: impl Fn(usize, usize) -> Option<usize>,
        log_posterior: impl Fn(usize) -> f64,
        log_later: impl Fn(usize) -> f64,
    ) {
        self.n_streams += 1;
        let mut rng = stream(self.seed, self.n_streams);
        for state in &mut self.states {
            for turn in 0..self.config.n_moves {
                let (proposed, score): (_, &dyn Fn(usize) -> f64) = if turn % 2 == 0 {
                    (neighbour(*state, rng.random_range(0..6)).unwrap_or(*state), &log_posterior)
                } else {
                    // The proposal's own density cancels the first touch.
                    (draw_one(&self.first_cumulative, &mut rng), &log_later)
                };
                let log_uniform = rng.random::<f64>().ln();
                if proposed != *state && score(proposed) - score(*state) >= log_uniform {
                    *state = proposed;
                }
            }
        }
    }

    /// Each particle's state and its weight; the weights sum to 1.
    pub fn weighted(&self) -> impl Iterator<Item = (usize, f64)> {
        self.states.iter().copied().zip(self.log_weights.iter().map(|log| log.exp()))
    }
}

/// Draws after which, with probability 0.99, the sampled distribution over `n_bins` is within a
/// Kullback-Leibler distance of 0.05 of the true one (Fox 2003, Eq. 13).
fn kld_bound(n_bins: usize) -> usize {
    const DISTANCE: f64 = 0.05;
    const NORMAL_QUANTILE_99: f64 = 2.326_347_874;
    if n_bins < 2 {
        return 1;
    }
    let k = (n_bins - 1) as f64;
    let a = 2.0 / (9.0 * k);
    (k / (2.0 * DISTANCE) * (1.0 - a + a.sqrt() * NORMAL_QUANTILE_99).powi(3)).ceil() as usize
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
        for n_touches in 2..=TOUCHES.len() {
            particle.update(|state| TOUCHES[n_touches - 1][state].ln());
            let score = |touches: &[[f64; 4]], state: usize| touches.iter().map(|t| t[state].ln()).sum();
            particle.rejuvenate(
                |state, direction| [state.checked_sub(1), (state < 3).then_some(state + 1)][direction % 2],
                |state| score(&TOUCHES[..n_touches], state),
                |state| score(&TOUCHES[1..n_touches], state),
            );
        }
        let mut masses = vec![0.0; 4];
        particle.weighted().for_each(|(state, weight)| masses[state] += weight);
        masses
    }

    #[test]
    fn many_particles_agree_with_the_normalised_product() {
        let product = |state: usize| TOUCHES.iter().map(|touch| touch[state]).product::<f64>();
        let sum: f64 = (0..4).map(product).sum();
        for (resample_share, n_moves) in [(0.0, 0), (0.5, 0), (1.0, 0), (0.5, 1), (1.0, 4)] {
            let config = ParticleConfig { n_particles: 100_000, resample_share, n_moves, adaptive: false };
            for (state, mass) in after_all_touches(config).iter().enumerate() {
                // Standard error of a share of 1e5 draws is at most 0.0016; weights of up to 5 times the mean
                // and three rounds of resampling at most treble it; four of those.
                let exact = product(state) / sum;
                assert!((mass - exact).abs() < 0.02, "{config:?}: {mass} against {exact}");
            }
        }
    }

    #[test]
    fn the_bound_agrees_with_published_values() {
        // Wilson and Hilferty's quantile of chi-square with k - 1 degrees of freedom over 2 * 0.05: the 99 %
        // quantiles of tables are 74.92 (49 degrees of freedom) and 248.3 (199).
        assert!((kld_bound(50) as f64 - 749.2).abs() < 2.0 && (kld_bound(200) as f64 - 2_483.0).abs() < 5.0);
        assert_eq!(kld_bound(1), 1);
    }

    #[test]
    fn an_adaptive_filter_keeps_what_its_spread_asks_for() {
        let mut particle = Particle::draw(
            ParticleConfig { n_particles: 20_000, ..ParticleConfig::default() },
            &[0.01_f64.ln(); 100],
            3,
        );
        // Two states of a hundred stay: their share of the particles is too small not to resample.
        particle.update(|state| if state < 2 { 0.0 } else { -50.0 });
        assert_eq!(particle.weighted().count(), 100);
        let mass: f64 = particle.weighted().filter(|(state, _)| *state == 0).map(|(_, w)| w).sum();
        // 200 of 20,000 particles were drawn of each: the share is right to some 7 %.
        assert!((mass - 0.5).abs() < 0.2, "{mass}");
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
            let config = ParticleConfig { n_particles: 100_000, resample_share, n_moves: 0, adaptive: false };
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

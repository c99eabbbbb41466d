//! How long an update takes on this computer, on one thread.

use std::hint::black_box;
use std::time::Instant;

use serde::Serialize;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;

use super::sample::Sample;
use crate::error::Result;
use tactile_filter::TouchModel;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::belief::{Belief, EngineConfig};
use tactile_filter::likelihood::TouchLikelihood;

/// So flat that the belief, and with it the particles, are on hundreds of states, as after a robot's first touch.
const FLAT: f64 = 5.0;

/// Times of one thing done again and again.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// What was done.
    pub what: String,
    /// How often.
    pub n: usize,
    /// Half were within this, ms.
    pub p50_ms: f64,
    /// 99 of 100 were within this, ms.
    pub p99_ms: f64,
    /// What was aimed at, ms: half within the first, 99 of 100 within the second.
    pub target_ms: Option<[f64; 2]>,
}

/// Times updates over the paper's large board, 12 x 847 = 10,164 states and rows of 128 values: from an embedded
/// touch to the new belief.
pub fn timings(seed: u64, quick: bool) -> Result<Vec<Timing>> {
    let sample = Sample::draw(12, PoseGrid::LARGE, 128, 2, seed);
    let bank = sample.bank()?;
    let (n_exact, n_particle, n_particles) = if quick { (20, 5, 100_000) } else { (200, 15, 1_000_000) };
    let count = if quick { "100,000 particles" } else { "1,000,000 particles" };
    let most = ParticleConfig { n_particles, ..ParticleConfig::default() };
    let all = ParticleConfig { adaptive: false, ..most };
    let of_many = (!quick).then_some([150.0, 150.0]);
    let runs = [
        ("exact update, 10,164 states x 128".into(), n_exact, Some([0.5, 1.0]), EngineConfig::Exact),
        (
            format!("update of {count}, all kept, none moved"),
            n_particle,
            of_many,
            EngineConfig::Particle(ParticleConfig { n_moves: 0, ..all }),
        ),
        (format!("update of {count}, all kept and moved"), n_particle, of_many, EngineConfig::Particle(all)),
        (format!("update of {count}, as many kept as needed"), n_particle, of_many, EngineConfig::Particle(most)),
    ];
    let time = |(what, n, target_ms, engine)| Ok(Timing { what, target_ms, ..time(n, &sample, &bank, engine)? });
    runs.into_iter().map(time).collect()
}

/// Times `n` updates by the sample's second touch, each of the same belief.
fn time(n: usize, sample: &Sample, bank: &Bank, engine: EngineConfig) -> Result<Timing> {
    let config = TouchModel { steepness: FLAT, ..Sample::model() };
    let before = Belief::new(bank, engine, 1, 1, TouchLikelihood::new(&sample.touches[0].1, bank, &config)?);
    let (moved, touch): &(Se2, _) = &sample.touches[1];
    let mut times_ms = Vec::with_capacity(n);
    // The first two warm the caches and are not counted.
    for number in 0..n + 2 {
        let mut belief = before.clone();
        let start = Instant::now();
        belief.update(moved, TouchLikelihood::new(touch, bank, &config)?);
        let elapsed_ms = 1e3 * start.elapsed().as_secs_f64();
        black_box(&belief);
        if number >= 2 {
            times_ms.push(elapsed_ms);
        }
    }
    times_ms.sort_by(f64::total_cmp);
    let quantile = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share).ceil() as usize];
    Ok(Timing { what: String::new(), n, p50_ms: quantile(0.5), p99_ms: quantile(0.99), target_ms: None })
}

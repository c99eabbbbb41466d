//! Draws from a generator that the caller seeds.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// The random numbers of one frame: a stream of its own of the generator of `seed`.
pub fn frame_rng(seed: u64, frame: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(frame);
    rng
}

/// A number between `low` and `high`, each equally likely.
pub(crate) fn uniform(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A number between `-half` and `half`, each equally likely.
pub(crate) fn around_zero(rng: &mut ChaCha8Rng, half: f64) -> f64 {
    half * (2.0 * rng.random::<f64>() - 1.0)
}

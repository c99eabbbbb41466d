//! Draws from a generator that the caller seeds.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// A number between `low` and `high`, each equally likely.
pub(crate) fn uniform(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A number between `-half` and `half`, each equally likely.
pub(crate) fn around_zero(rng: &mut ChaCha8Rng, half: f64) -> f64 {
    half * (2.0 * rng.random::<f64>() - 1.0)
}

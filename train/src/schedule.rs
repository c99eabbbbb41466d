//! Learning rate and encoder momentum at each step (MoCo-v3, Sec. 4).

use std::f64::consts::PI;

/// Linear warm-up over `n_warmup` steps, then half a cosine from `peak` to 0 at `n_steps`.
pub fn learning_rate(step: usize, n_warmup: usize, n_steps: usize, peak: f64) -> f64 {
    if step < n_warmup {
        return peak * (step + 1) as f64 / n_warmup as f64;
    }
    let share = (step - n_warmup) as f64 / n_steps.saturating_sub(n_warmup).max(1) as f64;
    peak * 0.5 * (1.0 + (PI * share.min(1.0)).cos())
}

/// Momentum of the key encoder: from `start` at step 0 to 1 at `n_steps`, on half a cosine.
pub fn encoder_momentum(step: usize, n_steps: usize, start: f64) -> f64 {
    let share = (step as f64 / n_steps.max(1) as f64).min(1.0);
    1.0 - (1.0 - start) * 0.5 * (1.0 + (PI * share).cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_rises_to_its_peak_and_falls_to_zero() {
        let rate = |step| learning_rate(step, 10, 110, 2.0);
        assert!((rate(0) - 0.2).abs() < 1e-12);
        assert!((rate(9) - 2.0).abs() < 1e-12);
        assert!((rate(60) - 1.0).abs() < 1e-12); // half way down the cosine
        assert!(rate(110).abs() < 1e-12);
    }

    #[test]
    fn momentum_starts_at_its_start_and_ends_at_one() {
        assert!((encoder_momentum(0, 100, 0.99) - 0.99).abs() < 1e-12);
        assert!((encoder_momentum(50, 100, 0.99) - 0.995).abs() < 1e-12);
        assert!((encoder_momentum(100, 100, 0.99) - 1.0).abs() < 1e-12);
    }
}

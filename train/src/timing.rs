//! The speed of a run and the time that is left, validation included.

use std::collections::VecDeque;

/// Steps over which the speed is averaged.
const RECENT: usize = 50;

/// A step passes an image through two encoders and back through one: four times a forward pass.
const PASSES: f64 = 4.0;

/// The times of recent steps and saves, in seconds; measured by the caller.
#[derive(Clone, Debug)]
pub struct Timing {
    n_pairs: usize,
    images_a_save: usize,
    steps: VecDeque<f64>,
    save: Option<f64>,
}

impl Timing {
    /// Nothing timed yet; a step takes `n_pairs` pairs, a save embeds `images_a_save` images.
    pub fn new(n_pairs: usize, images_a_save: usize) -> Self {
        Self { n_pairs, images_a_save, steps: VecDeque::new(), save: None }
    }

    /// Adds the time of a step.
    pub fn step(&mut self, seconds: f64) {
        self.steps.push_back(seconds);
        if self.steps.len() > RECENT {
            self.steps.pop_front();
        }
    }

    /// Notes the time of a validation and a checkpoint.
    pub fn save(&mut self, seconds: f64) {
        self.save = Some(seconds);
    }

    /// Pairs a second over the last 50 steps, without saves; 0 before the first.
    pub fn pairs_per_second(&self) -> f64 {
        let total: f64 = self.steps.iter().sum();
        if total > 0.0 { (self.steps.len() * self.n_pairs) as f64 / total } else { 0.0 }
    }

    /// Seconds until step `n_steps`, from step `step`, with a save each `save_every` steps and at the end.
    /// Before the first save its time is estimated from the steps' time.
    pub fn seconds_left(&self, step: usize, n_steps: usize, save_every: usize) -> f64 {
        let a_step = self.steps.iter().sum::<f64>() / self.steps.len().max(1) as f64;
        let guess = a_step * self.images_a_save as f64 / (2 * self.n_pairs).max(1) as f64 / PASSES;
        let save_every = save_every.max(1);
        let n_saves = if step < n_steps { n_steps.div_ceil(save_every) - step / save_every } else { 0 };
        n_steps.saturating_sub(step) as f64 * a_step + n_saves as f64 * self.save.unwrap_or(guess)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_counts_steps_and_saves() {
        let mut timing = Timing::new(10, 800);
        (0..4).for_each(|_| timing.step(2.0));
        assert_eq!(timing.pairs_per_second(), 5.0);
        // 6 steps of 2 s are left of 10, and the saves at 6, 9 and 10: each 800 images at 2 s / 20 / 4.
        assert!((timing.seconds_left(4, 10, 3) - (12.0 + 3.0 * 20.0)).abs() < 1e-9);
        timing.save(5.0);
        assert!((timing.seconds_left(4, 10, 3) - (12.0 + 3.0 * 5.0)).abs() < 1e-9);
        assert!((timing.seconds_left(9, 10, 3) - 7.0).abs() < 1e-9);
        assert_eq!(timing.seconds_left(10, 10, 3), 0.0);
    }

    #[test]
    fn only_the_last_50_steps_count() {
        let mut timing = Timing::new(1, 0);
        timing.step(1_000.0);
        (0..50).for_each(|_| timing.step(0.5));
        assert_eq!(timing.pairs_per_second(), 2.0);
    }
}

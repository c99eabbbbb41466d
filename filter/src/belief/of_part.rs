//! What is believed of one part: where it is, how sure that is, and how well it explains the touches.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_data::symmetry::Symmetry;

use super::Belief;
use crate::evidence::Evidence;
use crate::hypothesis::Hypothesis;
use crate::modes::is_one_hill;
use crate::refine::{Refined, refine};
use crate::resample::systematic;

impl Belief {
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
    /// standard deviations of such a mean, and of how many touches it is; `None` where no edge was felt within the recorded
    /// area.
    pub fn fit(&self, part: usize, part_from_first: &Se2) -> Option<(f64, usize)> {
        let scores = self.touches.iter().filter_map(|touch| touch.standard_score(&self.views, part, part_from_first));
        let (sum, n_fitted) = scores.fold((0.0, 0), |(sum, n), score| (sum + score, n + 1));
        // By the standard deviation of the mean of scores that share a part of their variance.
        let (shared, n) = (self.config().matched_shared, n_fitted as f64);
        (n_fitted > 0).then(|| (sum / n / (shared + (1.0 - shared) / n).sqrt(), n_fitted))
    }

    /// Share of the belief in a part, 0..=1, in states whose first touch was made within `mm` of a pose or, by the part's
    /// symmetry, of one that feels the same; a state is as wide as its cell. 0 where the part is ruled out.
    pub fn share_near(&self, part: usize, part_from_first: &Se2, mm: f64, symmetry: &Symmetry) -> f64 {
        let (of_part, all) = self.states_of_part(part);
        let reach = mm + self.grid.xy_step_mm * std::f64::consts::FRAC_1_SQRT_2;
        let is_near = |cell: usize| {
            let pose = self.grid.pose(cell);
            symmetry.nearest_twin(&pose, part_from_first).distance_mm(part_from_first) <= reach
        };
        // A ten-thousandth of it in the lightest states does not matter, and is most of them.
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
        let ((of_part, all), here) = (self.states_of_part(part), &refined.part_from_first);
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
        let (states, all) = self.states_of_part(part);
        if all <= 0.0 {
            return Vec::new();
        }
        let masses: Vec<f64> = states.iter().map(|(_, mass)| mass / all).collect();
        let mut drawn: Vec<Hypothesis> =
            systematic(&masses, n, rng.random()).into_iter().map(|i| states[i].0).collect();
        drawn.sort_unstable();
        drawn
    }

    /// The states of a part with the belief in each, and its sum.
    fn states_of_part(&self, part: usize) -> (Vec<(Hypothesis, f64)>, f64) {
        let states = self.states_of(part..part + 1, 0.0);
        let all = states.iter().map(|(_, mass)| mass).sum();
        (states, all)
    }
}

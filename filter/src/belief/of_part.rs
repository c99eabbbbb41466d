//! What is believed of one part: where it is, and how well it explains the touches.

use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;

use super::bayes::Belief;
use crate::belief::hypothesis::Hypothesis;
use crate::belief::refine::refine;
use crate::decision::Scores;

impl Belief {
    /// The pose of the first touch around a state, to below the grid's step: the mean of the belief there, however far it goes
    /// on from the state. `symmetry`: the part's.
    pub fn refine(&self, state: Hypothesis, symmetry: &Symmetry) -> Se2 {
        let start = self.posterior.grid().pose(state.cell);
        let refined = refine(&self.views, &self.touches, state.part, &start);
        if refined.is_wide {
            self.middle(state.part, &refined.part_from_first, symmetry)
        } else {
            refined.part_from_first
        }
    }

    /// How well a part at a pose matches what was felt: the mean over the edged touches of
    /// [`standard_score`](crate::likelihood::evidence::Evidence::standard_score), and of how many touches it is; `None` where no edge was
    /// felt within the recorded area.
    pub(crate) fn scores(&self, part: usize, part_from_first: &Se2) -> Option<Scores> {
        let scores = self.touches.iter().filter_map(|touch| touch.standard_score(&self.views, part, part_from_first));
        let (sum, n) = scores.fold((0.0, 0), |(sum, n), score| (sum + score, n + 1));
        (n > 0).then(|| Scores { mean: sum / n as f64, n })
    }
}

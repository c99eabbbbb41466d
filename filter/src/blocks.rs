//! The states of one part at one angle, which are judged together: one motion takes them all to poses of one angle.

use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use crate::evidence::{AngleViews, Evidence};
use crate::hypothesis::Hypothesis;
use crate::likelihood::TouchLikelihood;

/// Which hypothesis a state of a block is. Blocks are in order of the part, then the angle; their states in order of
/// the place, x slowest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Angles of the states.
    pub n_angles: usize,
    /// Places of the states, and so the states of a block.
    pub n_places: usize,
}

impl Layout {
    /// The layout of a grid's states.
    pub fn of(states: &PoseGrid) -> Self {
        Self { n_angles: states.n_theta(), n_places: states.len() / states.n_theta() }
    }

    /// The hypothesis of a state.
    pub fn hypothesis(&self, state: usize) -> Hypothesis {
        let (block, place) = (state / self.n_places, state % self.n_places);
        Hypothesis { part: block / self.n_angles, cell: place * self.n_angles + block % self.n_angles }
    }
}

/// Judges the touches of an episode block by block; what blocks share is found once.
pub(crate) struct Blocks<'a> {
    /// The bank's grid and that of the states.
    grids: [&'a PoseGrid; 2],
    touches: &'a [Evidence],
    /// How each angle sees each touch, as far as was asked.
    views: Vec<Vec<Option<AngleViews>>>,
    /// What [`Evidence::planes`] is for each touch and each part, as far as was asked.
    planes: Vec<Vec<Option<Option<Vec<f32>>>>>,
}

impl<'a> Blocks<'a> {
    /// With the bank's grid and that of the states.
    pub fn of(grids: [&'a PoseGrid; 2], touches: &'a [Evidence]) -> Self {
        let n_parts = |touch: &Evidence| touch.likelihood.similarities.len() / grids[0].len();
        let views = touches.iter().map(|_| (0..grids[1].n_theta()).map(|_| None).collect()).collect();
        let planes = touches.iter().map(|touch| vec![None; n_parts(touch)]).collect();
        Self { grids, touches, views, planes }
    }

    /// log p(last touch | state) is at most this in each block, `[n_blocks]`.
    pub fn highest(&mut self) -> Vec<f64> {
        let (grids, n_angles) = (self.grids, self.grids[1].n_theta());
        let (Some(touch), Some(views), Some(planes)) = (self.touches.last(), self.views.last_mut(), self.planes.last())
        else {
            return Vec::new();
        };
        let find = |(angle, views): (usize, &mut Option<AngleViews>)| {
            *views = Some(touch.views_of_angle(grids, angle));
        };
        views.iter_mut().enumerate().for_each(find);
        let of_block = |block: usize| {
            let views = views[block % n_angles].as_ref();
            views.map_or(f64::INFINITY, |views| touch.highest(block / n_angles, views))
        };
        (0..planes.len() * n_angles).map(of_block).collect()
    }

    /// Adds log p(touch | state) of the states of a block.
    pub fn add(&mut self, block: usize, touch: usize, sums: &mut [f64]) {
        let n_angles = self.grids[1].n_theta();
        let (part, angle) = (block / n_angles, block % n_angles);
        let evidence = &self.touches[touch];
        let views = self.views[touch][angle].get_or_insert_with(|| evidence.views_of_angle(self.grids, angle));
        let planes = self.planes[touch][part].get_or_insert_with(|| evidence.planes(self.grids[0], part));
        evidence.add_block(self.grids[0], part, (views, planes.as_deref()), sums);
    }
}

impl Evidence {
    /// Judges a touch, with the share of its evidence that counts, from every state: each part at each pose of
    /// `states`, with the views of a bank whose grid is `grid`. `take` is given log p(touch | state) of one part after
    /// the other, `[n_cells]`.
    pub fn new(
        [grid, states]: [&PoseGrid; 2],
        first_from_sensor: Se2,
        weight: f64,
        likelihood: TouchLikelihood,
        take: &mut dyn FnMut(&[f64]),
    ) -> Self {
        let evidence = Self::of(grid, first_from_sensor, weight, likelihood);
        let n_angles = states.n_theta();
        let n_parts = evidence.likelihood.similarities.len() / grid.len();
        let mut blocks = Blocks::of([grid, states], std::slice::from_ref(&evidence));
        let mut log_part = vec![0.0; states.len()];
        for part in 0..n_parts {
            for angle in 0..n_angles {
                let mut log_block = vec![0.0; states.len() / n_angles];
                blocks.add(part * n_angles + angle, 0, &mut log_block);
                let of_angle = log_part[angle..].iter_mut().step_by(n_angles);
                of_angle.zip(log_block).for_each(|(log, found)| *log = found);
            }
            take(&log_part);
        }
        drop(blocks);
        evidence
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn each_hypothesis_is_one_state_and_states_of_a_block_have_one_part_and_angle() {
        let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let layout = Layout::of(&grid);
        let all: BTreeSet<Hypothesis> = (0..2 * grid.len()).map(|state| layout.hypothesis(state)).collect();
        assert_eq!(all.len(), 2 * grid.len());
        for state in 0..2 * grid.len() {
            let hypothesis = layout.hypothesis(state);
            let pose = grid.pose(hypothesis.cell);
            // Nine places at each of five angles, from -30 degrees on.
            assert_eq!(hypothesis.part, state / 45);
            assert!((pose.theta_deg() - (-30.0 + 15.0 * (state / 9 % 5) as f64)).abs() < 1e-9);
            let expected = [-4.0 + 4.0 * (state % 9 / 3) as f64, -4.0 + 4.0 * (state % 3) as f64];
            assert!((pose.x_mm - expected[0]).abs() + (pose.y_mm - expected[1]).abs() < 1e-9);
        }
    }
}

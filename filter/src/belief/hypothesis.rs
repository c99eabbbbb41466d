//! A state of the filter, and where states are.

use tactile_data::pose::grid::PoseGrid;

/// One state: which part, and where on it the first touch was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hypothesis {
    /// Index of the part in the bank.
    pub part: usize,
    /// Cell of [`Belief::grid`](crate::belief::posterior::Posterior::grid) that holds `part_from_first_sensor`.
    pub cell: usize,
}

/// Which hypothesis a state of a block is. Blocks are in order of the part, then the angle; their states in order of
/// the place, x slowest.
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// The bank's steps at which states are as many a step as was asked for, mm and degrees.
const COARSE: [f64; 2] = [2.0, 15.0];

/// Where the first touch may be, with views recorded at some poses: so many states a step on each axis, at least one,
/// but no nearer than a bank of 2 mm and 15 degrees would have them. A bank that is finer than that has its views nearer,
/// not its states.
pub(crate) fn states_between(start: &PoseGrid, subdivisions: usize) -> PoseGrid {
    let times = |step: f64, coarse: f64| {
        ((step * subdivisions as f64 / coarse - 1e-6).ceil() as usize).clamp(1, subdivisions.max(1))
    };
    start.subdivided(times(start.xy_step_mm, COARSE[0]), times(start.theta_step_deg, COARSE[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn states_are_no_denser_where_views_are() {
        let steps = |xy_step_mm, theta_step_deg, subdivisions| {
            let views = PoseGrid { xy_half_mm: 8.0, xy_step_mm, theta_half_deg: 90.0, theta_step_deg };
            let states = states_between(&views, subdivisions);
            states.validate().unwrap();
            [states.xy_step_mm, states.theta_step_deg]
        };
        assert_eq!([steps(2.0, 15.0, 1), steps(2.0, 15.0, 2)], [[2.0, 15.0], [1.0, 7.5]]);
        assert_eq!(steps(2.0, 15.0, 3), [2.0 / 3.0, 5.0]);
        assert_eq!([steps(1.0, 15.0, 2), steps(1.0, 7.5, 2), steps(0.5, 7.5, 2)], [[1.0, 7.5], [1.0, 7.5], [0.5, 7.5]]);
        assert_eq!([steps(1.0, 15.0, 4), steps(4.0, 30.0, 2)], [[0.5, 3.75], [2.0, 15.0]]);
        assert_eq!(steps(2.0, 15.0, 0), [2.0, 15.0]);
    }

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

//! A state of the filter, and where states are.

use tactile_data::grid::PoseGrid;

/// One state: which part, and where on it the first touch was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hypothesis {
    /// Index of the part in the bank.
    pub part: usize,
    /// Cell of [`Belief::grid`](crate::belief::Belief::grid) that holds `part_from_first_sensor`.
    pub cell: usize,
}

/// The bank's steps at which states are as many a step as was asked for, mm and degrees.
const COARSE: [f64; 2] = [2.0, 15.0];

/// Where the first touch may be, with views recorded at the poses of a grid: so many states a step on each axis, at least one,
/// but no nearer than a bank of 2 mm and 15 degrees would have them. A bank that is finer than that has its views nearer,
/// not its states.
pub(crate) fn states_between(views: &PoseGrid, subdivisions: usize) -> PoseGrid {
    let times = |step: f64, coarse: f64| {
        ((step * subdivisions as f64 / coarse - 1e-6).ceil() as usize).clamp(1, subdivisions.max(1))
    };
    views.subdivided(times(views.xy_step_mm, COARSE[0]), times(views.theta_step_deg, COARSE[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

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
}

//! Where a part is known to be before it is touched: from a camera, a drawing or the robot's own cell.
//!
//! In: the pose of the first touch on the part and its covariance. Out: the log of what is believed of each pose before any touch, which
//! the first touch's evidence carries. It must not know touches.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_infer::maps::align::Start;

use crate::belief::refine::steps_of;
use crate::error::{Error, Result};
use crate::matrix::{Matrix, by_jacobian, information, square};

/// A pose that is farther from all states than this is not one where the bank's parts may be touched first, standard deviations.
const FARTHEST: f64 = 6.0;

/// By how much two numbers of a covariance that should be one may differ, mm² and rad².
const ROUNDING: f64 = 1e-6;

/// Where the first touch is thought to be made, whichever part it is: a normal distribution of its pose in the part's frame. Without one
/// every pose of the bank's start is equally likely (paper, Eq. 3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownStart {
    /// The sensor's pose at the first touch in the part's frame.
    pub part_from_first: Se2,
    /// Covariance of x, y (mm) and theta (rad).
    pub covariance: Matrix,
}

/// A [`KnownStart`] over the states of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StartBelief {
    mean: Se2,
    /// The inverse of the covariance.
    information: Matrix,
    /// Variance of theta, rad².
    theta_rad2: f64,
    /// Log of the mean over the states of what is not yet divided by it: so that states are one on average.
    log_mean: f64,
}

impl KnownStart {
    /// A pose that is known to these standard deviations: mm along x and along y, and degrees.
    pub fn known_to(part_from_first: Se2, deviations: [f64; 2]) -> Self {
        let Start { covariance, .. } = Start::known_to(part_from_first, deviations);
        Self { part_from_first, covariance }
    }

    /// The same from where the part is seen, its covariance (of x, y and theta in the same frame) and where the sensor is at the first touch:
    /// both in any one frame, as the robot's base.
    pub fn of_part(base_from_part: Se2, covariance: Matrix, base_from_first: Se2) -> Self {
        let part_from_first = base_from_part.inverse() * base_from_first;
        // x' = R(-theta) (first - part): how the pose on the part changes with the part's.
        let (sin, cos) = base_from_part.theta_rad.sin_cos();
        let by_part = [[-cos, -sin, part_from_first.y_mm], [sin, -cos, -part_from_first.x_mm], [0.0, 0.0, -1.0]];
        Self { part_from_first, covariance: by_jacobian(&by_part, &covariance) }
    }

    /// Over the states of a grid. A state is a cell of the grid, so that the belief is never narrower than one.
    ///
    /// # Errors
    /// A pose that is not finite, a covariance that no distribution has, and a start that no state is near.
    pub(crate) fn over(&self, states: &PoseGrid) -> Result<StartBelief> {
        let Self { part_from_first: mean, covariance } = *self;
        if !mean.is_finite() {
            return Err(Error::config("start", "a pose of finite numbers", format!("{mean:?}")));
        }
        let mut wide = [0, 1, 2].map(|row| [0, 1, 2].map(|at| 0.5 * (covariance[row][at] + covariance[at][row])));
        steps_of(states).iter().enumerate().for_each(|(axis, step)| wide[axis][axis] += step * step / 12.0);
        let is_symmetric =
            (0..3).all(|row| (0..3).all(|at| (wide[row][at] - covariance[row][at]).abs() <= ROUNDING || row == at));
        let is_covariance = is_symmetric && (0..3).all(|axis| covariance[axis][axis] >= 0.0);
        let information = information(&wide).filter(|_| is_covariance).ok_or_else(|| {
            let expected = "a covariance of x, y (mm) and theta (rad): symmetric, no variance below zero";
            Error::config("start", expected, format!("{covariance:?}"))
        })?;
        let start = StartBelief { mean, information, theta_rad2: wide[2][2], log_mean: 0.0 };
        let logs = (0..states.len()).map(|cell| start.log(&states.pose(cell)));
        let (nearest, n) = (logs.clone().fold(f64::NEG_INFINITY, f64::max), states.len() as f64);
        if nearest < -0.5 * FARTHEST * FARTHEST {
            let PoseGrid { xy_half_mm, theta_half_deg, .. } = states;
            let expected = format!("a pose within {xy_half_mm} mm and {theta_half_deg} degrees, or known less well");
            let Se2 { x_mm, y_mm, theta_rad } = mean;
            let got = format!("{x_mm:.2}, {y_mm:.2} mm, {:.2} degrees", theta_rad.to_degrees());
            return Err(Error::config("start", expected, got));
        }
        let log_mean = nearest + (logs.map(|log| (log - nearest).exp()).sum::<f64>() / n).ln();
        Ok(StartBelief { log_mean, ..start })
    }
}

impl StartBelief {
    /// Log of how much likelier a pose of the first touch is than the states on average.
    pub(crate) fn log(&self, pose: &Se2) -> f64 {
        let Self { mean, information, log_mean, .. } = self;
        let off = [pose.x_mm - mean.x_mm, pose.y_mm - mean.y_mm, wrap_angle(pose.theta_rad - mean.theta_rad)];
        -0.5 * square(information, off) - log_mean
    }

    /// [`Self::log`] is at most this at an angle.
    pub(crate) fn highest(&self, theta_rad: f64) -> f64 {
        let off = wrap_angle(theta_rad - self.mean.theta_rad);
        -0.5 * off * off / self.theta_rad2 - self.log_mean
    }

    /// Adds [`Self::log`] of the states of an angle, `[n_places]`.
    pub(crate) fn add_angle(&self, states: &PoseGrid, angle: usize, sums: &mut [f64]) {
        let cells = (angle..states.len()).step_by(states.n_theta());
        sums.iter_mut().zip(cells).for_each(|(sum, cell)| *sum += self.log(&states.pose(cell)));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const STATES: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 1.0, theta_half_deg: 90.0, theta_step_deg: 7.5 };

    fn covariance() -> [[f64; 3]; 3] {
        [[2.0, 0.6, 0.05], [0.6, 1.0, -0.02], [0.05, -0.02, 0.03]]
    }

    #[test]
    fn states_are_as_likely_as_the_distribution_over_their_cells_and_one_on_average() {
        let mean = Se2::from_degrees(1.3, -2.2, 20.0);
        let start = KnownStart { part_from_first: mean, covariance: covariance() }.over(&STATES).unwrap();
        let (mut sum, mut first, mut second) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for cell in 0..STATES.len() {
            let pose = STATES.pose(cell);
            let p = start.log(&pose).exp() / STATES.len() as f64;
            assert!(start.log(&pose) <= start.highest(pose.theta_rad) + 1e-12);
            let off = [pose.x_mm - mean.x_mm, pose.y_mm - mean.y_mm, pose.theta_rad - mean.theta_rad];
            sum += p;
            for row in 0..3 {
                first[row] += p * off[row];
                (0..3).for_each(|at| second[row][at] += p * off[row] * off[at]);
            }
        }
        assert!((sum - 1.0).abs() < 1e-9 && first.iter().all(|mean| mean.abs() < 0.01), "{sum} {first:?}");
        for (row, (found, known)) in second.iter().zip(covariance()).enumerate() {
            let cell = [1.0, 1.0, 7.5_f64.to_radians()][row].powi(2) / 12.0;
            for (at, (found, known)) in found.iter().zip(known).enumerate() {
                let expected = known + if row == at { cell } else { 0.0 };
                assert!((found - expected).abs() < 0.02, "{row} {at}: {found} {expected}");
            }
        }
        // All states of an angle at once.
        let mut sums = vec![2.0; STATES.n_xy().pow(2)];
        start.add_angle(&STATES, 7, &mut sums);
        for (place, sum) in sums.iter().enumerate() {
            assert_eq!(*sum, 2.0 + start.log(&STATES.pose(place * STATES.n_theta() + 7)));
        }
    }

    proptest! {
        /// By moving the part in all directions by a little: a numerical derivative.
        #[test]
        fn what_is_known_of_the_part_is_known_of_the_first_touch(
            x in -50.0..50.0_f64, y in -50.0..50.0_f64, deg in -180.0..180.0_f64, dx in -8.0..8.0_f64, dy in -8.0..8.0_f64,
        ) {
            let (part, first) = (Se2::from_degrees(x, y, deg), Se2::from_degrees(x + dx, y + dy, deg + 15.0));
            let found = KnownStart::of_part(part, covariance(), first);
            let step = 1e-6;
            let by_part: Vec<[f64; 3]> = (0..3).map(|axis| {
                let mut by = [0.0; 3];
                by[axis] = step;
                let moved = Se2::new(part.x_mm + by[0], part.y_mm + by[1], part.theta_rad + by[2]).inverse() * first;
                let mean = found.part_from_first;
                let off = [moved.x_mm - mean.x_mm, moved.y_mm - mean.y_mm, wrap_angle(moved.theta_rad - mean.theta_rad)];
                off.map(|off| off / step)
            }).collect();
            for row in 0..3 {
                for column in 0..3 {
                    let pairs = (0..3).flat_map(|a| (0..3).map(move |b| (a, b)));
                    let expected: f64 = pairs.map(|(a, b)| by_part[a][row] * covariance()[a][b] * by_part[b][column]).sum();
                    prop_assert!((found.covariance[row][column] - expected).abs() < 1e-3, "{row} {column}");
                }
            }
        }
    }

    #[test]
    fn what_no_start_is_is_refused() {
        let at = |x_mm: f64, covariance| KnownStart { part_from_first: Se2::new(x_mm, 0.0, 0.0), covariance };
        let error = |start: KnownStart| start.over(&STATES).unwrap_err().to_string();
        assert!(error(at(f64::NAN, covariance())).starts_with("start: expected a pose of finite numbers"));
        assert!(error(at(20.0, covariance())).contains("expected a pose within 8 mm and 90 degrees"));
        assert!(at(12.0, covariance()).over(&STATES).is_ok());
        for (row, column, value) in [(0, 1, 0.0), (0, 0, -1.0), (2, 2, f64::NAN), (1, 1, f64::INFINITY)] {
            let mut wrong = covariance();
            wrong[row][column] = value;
            assert!(error(at(0.0, wrong)).contains("a covariance of x, y (mm)"), "{row} {column}");
        }
        let mut wrong = covariance();
        (wrong[0][1], wrong[1][0]) = (2.0, 2.0);
        assert!(error(at(0.0, wrong)).contains("a covariance of x, y (mm)"));
        // Known exactly: to the cell of a state.
        assert!(KnownStart::known_to(Se2::IDENTITY, [0.0, 0.0]).over(&STATES).is_ok());
    }
}

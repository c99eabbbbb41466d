//! The grid of poses at which a part was touched.

#[cfg(feature = "sim")]
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::pose::se2::{Se2, wrap_angle};

/// A regular grid of `part_from_sensor` poses round a part's centre, with `x`, `y` in
/// `-xy_half_mm ..= xy_half_mm` and `theta` in `-theta_half_deg ..= theta_half_deg`. On a grid of a full turn, 180
/// degrees to either side, each angle comes once: the last is one step before +180 degrees, which is -180 degrees.
///
/// The paper's grids: small objects 8 mm by 4, large objects 20 mm by 4, both 90 degrees by 30.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseGrid {
    /// Largest |x| and |y|, mm.
    pub xy_half_mm: f64,
    /// Step in x and y, mm.
    pub xy_step_mm: f64,
    /// Largest |theta|, degrees.
    pub theta_half_deg: f64,
    /// Step in theta, degrees.
    pub theta_step_deg: f64,
}

impl PoseGrid {
    /// The paper's grid for letters of 12 mm: 5 x 5 x 7 = 175 poses a part.
    pub const SMALL: Self = Self { xy_half_mm: 8.0, xy_step_mm: 4.0, theta_half_deg: 90.0, theta_step_deg: 30.0 };
    /// The paper's grid for letters of 32 mm: 11 x 11 x 7 = 847 poses a part.
    pub const LARGE: Self = Self { xy_half_mm: 20.0, xy_step_mm: 4.0, theta_half_deg: 90.0, theta_step_deg: 30.0 };

    /// Refuses a grid whose steps are not positive or do not divide its ranges, and angles that come twice.
    pub fn validate(&self) -> Result<()> {
        for (field, half, step) in
            [("xy", self.xy_half_mm, self.xy_step_mm), ("theta", self.theta_half_deg, self.theta_step_deg)]
        {
            let steps = half / step;
            if !(step > 0.0 && half >= 0.0 && steps.is_finite() && (steps - steps.round()).abs() < 1e-6) {
                return Err(Error::invalid(
                    format!("reach.{field}"),
                    "a half range that is a whole number of positive steps",
                    format!("half {half}, step {step}"),
                ));
            }
        }
        if self.theta_half_deg > 180.0 {
            let got = format!("half {}", self.theta_half_deg);
            return Err(Error::invalid("reach.theta", "a half range of at most 180 degrees", got));
        }
        /// More poses than any bank holds; far beyond, their number overflows.
        const MOST: f64 = 1e7;
        let (xy, theta) = (self.xy_half_mm / self.xy_step_mm, self.theta_half_deg / self.theta_step_deg);
        let n_poses = (2.0 * xy + 1.0).powi(2) * (2.0 * theta + 1.0);
        if n_poses > MOST {
            return Err(Error::invalid("reach", format!("at most {MOST:e} poses"), format!("{n_poses:e}")));
        }
        Ok(())
    }

    /// The same ranges with steps in x and y and in theta that are so many times as fine; fit to use where
    /// [`Self::validate`] says so.
    pub fn subdivided(&self, xy_times: usize, theta_times: usize) -> Self {
        let (xy_step_mm, theta_step_deg) =
            (self.xy_step_mm / xy_times as f64, self.theta_step_deg / theta_times as f64);
        Self { xy_step_mm, theta_step_deg, ..*self }
    }

    /// Number of distinct x (and of y) values.
    pub fn n_xy(&self) -> usize {
        2 * rounded(self.xy_half_mm / self.xy_step_mm) + 1
    }

    /// Number of distinct angles.
    pub fn n_theta(&self) -> usize {
        let n_steps = 2 * rounded(self.theta_half_deg / self.theta_step_deg);
        if self.theta_half_deg >= 180.0 { n_steps } else { n_steps + 1 }
    }

    /// Whether the angles go round: the last is one step before the first.
    pub fn goes_round(&self) -> bool {
        (self.n_theta() as f64 * self.theta_step_deg - 360.0).abs() < 1e-6
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.n_xy() * self.n_xy() * self.n_theta()
    }

    /// Whether the grid holds no pose; a valid grid always holds one.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The cells from one x, y and angle to the next; x varies slowest, theta fastest.
    pub fn strides(&self) -> [usize; 3] {
        let n_theta = self.n_theta();
        [self.n_xy() * n_theta, n_theta, 1]
    }

    /// A pose anywhere in the range, each equally likely.
    #[cfg(feature = "sim")]
    pub fn draw(&self, rng: &mut impl RngExt) -> Se2 {
        let mut around = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
        Se2::from_degrees(around(self.xy_half_mm), around(self.xy_half_mm), around(self.theta_half_deg))
    }

    /// The pose of a cell in `0..len()`, counted as [`Self::strides`] says.
    pub fn pose(&self, cell: usize) -> Se2 {
        let [of_x, of_y, _] = self.strides();
        let (ix, iy, it) = (cell / of_x, cell % of_x / of_y, cell % of_y);
        Se2::from_degrees(
            ix as f64 * self.xy_step_mm - self.xy_half_mm,
            iy as f64 * self.xy_step_mm - self.xy_half_mm,
            it as f64 * self.theta_step_deg - self.theta_half_deg,
        )
    }

    /// The cell nearest to a pose, or `None` where the pose is more than half a step outside the
    /// recorded area: what is there is unknown.
    pub fn nearest(&self, pose: &Se2) -> Option<usize> {
        NearestCell::on(self).of(pose)
    }

    /// The cell that a pose coincides with to within `tolerance_mm` and `tolerance_deg`.
    pub fn exact(&self, pose: &Se2, tolerance_mm: f64, tolerance_deg: f64) -> Option<usize> {
        let cell = self.nearest(pose)?;
        let found = self.pose(cell);
        let turned = wrap_angle(found.theta_rad - pose.theta_rad).to_degrees().abs();
        (found.distance_mm(pose) <= tolerance_mm && turned <= tolerance_deg).then_some(cell)
    }
}

/// [`PoseGrid::nearest`] for many poses: a choice of the next touch asks for a hundred thousand.
#[derive(Clone, Copy, Debug)]
pub struct NearestCell {
    xy: Axis,
    theta: Axis,
    /// Whether -180 and +180 degrees, which are one angle, are both within half a step of the recorded ones.
    goes_round: bool,
}

#[derive(Clone, Copy, Debug)]
struct Axis {
    half: f64,
    per_step: f64,
    n: usize,
}

impl NearestCell {
    /// The axes of a grid.
    pub fn on(grid: &PoseGrid) -> Self {
        Self {
            xy: Axis { half: grid.xy_half_mm, per_step: grid.xy_step_mm.recip(), n: grid.n_xy() },
            theta: Axis { half: grid.theta_half_deg, per_step: grid.theta_step_deg.recip(), n: grid.n_theta() },
            goes_round: grid.theta_half_deg + 0.5 * grid.theta_step_deg >= 180.0,
        }
    }

    /// The cell nearest to a pose; `None` outside the recorded area.
    pub fn of(&self, pose: &Se2) -> Option<usize> {
        let (x, y) = (self.xy.nearest(pose.x_mm)?, self.xy.nearest(pose.y_mm)?);
        let turn = pose.theta_deg();
        let round = || [-360.0, 360.0].into_iter().find_map(|whole| self.theta.nearest(turn + whole));
        let theta = self.theta.nearest(turn).or_else(|| if self.goes_round { round() } else { None })?;
        Some((x * self.xy.n + y) * self.theta.n + theta)
    }
}

impl Axis {
    fn nearest(&self, value: f64) -> Option<usize> {
        // Half a step is added before the borders are asked for: the sum of a value just inside and a half may round up
        // to the border, which is no cell any more.
        let place = (value + self.half) * self.per_step + 0.5;
        (place > 0.0 && place < self.n as f64).then_some(place as usize)
    }
}

/// The nearest whole number to one that is not below -1/2; `f64::round` is a call on the oldest processors we run on.
fn rounded(value: f64) -> usize {
    (value + 0.5) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_boards_have_the_papers_counts() {
        assert_eq!(12 * PoseGrid::SMALL.len(), 2_100);
        assert_eq!(12 * PoseGrid::LARGE.len(), 10_164);
    }

    #[test]
    fn each_cell_is_nearest_to_its_own_pose() {
        let grid = PoseGrid::LARGE;
        for cell in 0..grid.len() {
            assert_eq!(grid.exact(&grid.pose(cell), 1e-9, 1e-9), Some(cell));
        }
    }

    #[test]
    fn outside_the_recorded_area_is_unknown() {
        let grid = PoseGrid::SMALL;
        assert!(grid.nearest(&Se2::from_degrees(10.1, 0.0, 0.0)).is_none());
        assert!(grid.nearest(&Se2::from_degrees(0.0, 0.0, 106.0)).is_none());
        assert!(grid.nearest(&Se2::from_degrees(9.9, 0.0, 104.0)).is_some());
    }

    #[test]
    fn the_last_number_before_a_border_is_outside_or_has_a_cell() {
        for n_steps in 0..40_u32 {
            let grid = PoseGrid { xy_half_mm: 4.0 * f64::from(n_steps), ..PoseGrid::SMALL };
            let border = grid.xy_half_mm + 2.0;
            for x_mm in [border.next_down().next_down(), border.next_down(), border, border.next_up()] {
                for pose in [Se2::new(x_mm, 0.0, 0.0), Se2::new(0.0, x_mm, 0.0), Se2::new(-x_mm, -x_mm, 0.0)] {
                    assert!(grid.nearest(&pose).is_none_or(|cell| cell < grid.len()), "{n_steps}: {pose:?}");
                }
            }
        }
        // A half and the largest number below a half make one.
        let one = PoseGrid { xy_half_mm: 0.0, theta_half_deg: 0.0, ..PoseGrid::SMALL };
        assert!(one.nearest(&Se2::new(2.0_f64.next_down(), 2.0_f64.next_down(), 0.0)).is_none_or(|cell| cell == 0));
    }

    #[test]
    fn a_full_turn_grid_has_no_seam() {
        let grid = PoseGrid { theta_half_deg: 150.0, ..PoseGrid::SMALL };
        assert!(grid.nearest(&Se2::from_degrees(0.0, 0.0, 179.0)).is_none());
        let full = PoseGrid { theta_half_deg: 180.0, ..PoseGrid::SMALL };
        let cell = |degrees| full.nearest(&Se2::from_degrees(0.0, 0.0, degrees));
        assert!(cell(-179.0).is_some() && cell(179.0) == cell(-179.0) && cell(164.0) != cell(166.0));
    }

    #[test]
    fn each_angle_of_a_full_turn_comes_once() {
        let grids = [(180.0, 30.0, 12), (180.0, 7.5, 48), (160.0, 40.0, 9), (150.0, 30.0, 11), (180.0, 180.0, 2)];
        for (theta_half_deg, theta_step_deg, n_theta) in grids {
            let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 1.0, theta_half_deg, theta_step_deg };
            let angles: Vec<f64> = (0..grid.len()).map(|cell| wrap_angle(grid.pose(cell).theta_rad)).collect();
            let apart = |a: usize, b: usize| wrap_angle(angles[a] - angles[b]).abs().to_degrees();
            let pairs = (0..angles.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
            assert!(pairs.into_iter().all(|(a, b)| apart(a, b) > theta_step_deg - 1e-6), "{theta_half_deg}");
            assert_eq!((grid.n_theta(), grid.goes_round()), (n_theta, theta_half_deg != 150.0));
            assert!((0..grid.len()).all(|cell| grid.nearest(&grid.pose(cell)) == Some(cell)));
        }
    }

    #[test]
    fn more_poses_than_can_be_counted_are_refused() {
        // 1e100 steps saturate, and their number wrapped round to 1.
        let endless = PoseGrid { xy_half_mm: 1e300, xy_step_mm: 1e200, ..PoseGrid::SMALL };
        assert!(endless.validate().unwrap_err().to_string().contains("poses"));
    }

    #[test]
    fn more_than_a_whole_turn_is_refused() {
        let twice = PoseGrid { theta_half_deg: 210.0, ..PoseGrid::SMALL };
        assert!(twice.validate().unwrap_err().to_string().contains("at most 180 degrees, got half 210"));
        PoseGrid { theta_half_deg: 180.0, ..PoseGrid::SMALL }.validate().unwrap();
    }

    #[test]
    fn a_step_that_does_not_divide_the_range_is_refused() {
        let grid = PoseGrid { xy_step_mm: 3.0, ..PoseGrid::SMALL };
        assert!(grid.validate().unwrap_err().to_string().contains("reach.xy"));
    }
}

//! The grid on which recorded poses lie, found from the poses.

use crate::error::{Error, Result};
use crate::pose::grid::PoseGrid;
use crate::pose::se2::Se2;

/// How far a recorded pose may be from its place on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Distance, mm.
    pub mm: f64,
    /// Turn, degrees.
    pub deg: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { mm: 1.0, deg: 3.0 }
    }
}

/// Share of poses that may lie off the grid: a few touches that slipped.
const MOST_OFF: f64 = 0.05;

/// Steps are rounded to these where the poses allow it: nobody records every 1.9997 mm.
const ROUND: [f64; 2] = [0.05, 0.5];

/// The regular grid, centred on the part, that recorded poses `part_from_sensor` lie on to within a tolerance.
///
/// Along each axis the values are parted where two neighbours are further apart than the tolerance; the median
/// distance of the groups is the first guess of the step, and least squares over all values gives the step. Poses may
/// be missing, but not a whole row of them at the border, which would shrink the grid.
///
/// # Errors
/// No poses, poses that lie on no grid, or on one that is not centred on the part.
pub fn fit(poses: &[Se2], tolerance: Tolerance) -> Result<PoseGrid> {
    let values = |of: fn(&Se2) -> f64| poses.iter().map(of).collect::<Vec<_>>();
    let x = Axis::fit(values(|pose| pose.x_mm), tolerance.mm, ROUND[0]).ok_or_else(|| off("x"))?;
    let y = Axis::fit(values(|pose| pose.y_mm), tolerance.mm, ROUND[0]).ok_or_else(|| off("y"))?;
    let turns = values(Se2::theta_deg);
    let theta = Axis::fit(turns, tolerance.deg, ROUND[1]).ok_or_else(|| off("theta"))?;
    let step_mm = match (x.step, y.step) {
        (Some(a), Some(b)) if (a / b - 1.0).abs() > 0.02 => {
            return Err(Error::invalid("poses", "the same step in x and in y", format!("{a:.2} and {b:.2} mm")));
        }
        (a, b) => a.or(b).unwrap_or(1.0),
    };
    let (step_deg, axes) = (theta.step.unwrap_or(1.0), [(&x, "x"), (&y, "y")]);
    for ((axis, name), step, tolerance, unit) in axes
        .map(|axis| (axis, step_mm, tolerance.mm, "mm"))
        .into_iter()
        .chain([((&theta, "theta"), step_deg, tolerance.deg, "degrees")])
    {
        let shift = axis.first - (axis.first / step).round() * step;
        if shift.abs() > tolerance {
            let got = format!("one shifted by {shift:.2} {unit} in {name}; poses can be resampled to a step");
            return Err(Error::invalid("poses", "a grid through the part's centre", got));
        }
    }
    let reach = |axis: &Axis, step: f64| (axis.first / step).round().abs().max((axis.last / step).round().abs()) * step;
    let grid = PoseGrid {
        xy_half_mm: reach(&x, step_mm).max(reach(&y, step_mm)),
        xy_step_mm: step_mm,
        theta_half_deg: reach(&theta, step_deg).min(180.0),
        theta_step_deg: step_deg,
    };
    grid.validate().map(|()| grid)
}

/// The grid with these steps that covers what poses cover: to resample poses on no grid, or on a finer one.
///
/// # Errors
/// No poses, or steps that are not positive.
pub fn covering(poses: &[Se2], step_mm: f64, step_deg: f64) -> Result<PoseGrid> {
    if poses.is_empty() {
        return Err(Error::invalid("poses", "poses of recorded touches", "none"));
    }
    let reach = |of: &dyn Fn(&Se2) -> f64| poses.iter().map(of).fold(0.0, f64::max);
    let [mm, deg] = [reach(&|pose| pose.x_mm.abs().max(pose.y_mm.abs())), reach(&|pose| pose.theta_deg().abs())];
    // The last place counts where at least half a step of it was recorded.
    let whole = |reach: f64, step: f64| (reach / step + 0.5).floor() * step;
    let grid = PoseGrid {
        xy_half_mm: whole(mm, step_mm),
        xy_step_mm: step_mm,
        theta_half_deg: whole(deg, step_deg).min(180.0),
        theta_step_deg: step_deg,
    };
    grid.validate().map(|()| grid)
}

fn off(axis: &str) -> Error {
    let expected = "poses on a regular grid, but for one in twenty";
    Error::invalid("poses", expected, format!("values of {axis} that lie on none; they can be resampled to a step"))
}

/// The regular places along an axis.
#[derive(Debug, PartialEq)]
struct Axis {
    /// `None` where there is one place only.
    step: Option<f64>,
    first: f64,
    last: f64,
}

impl Axis {
    fn fit(mut values: Vec<f64>, tolerance: f64, round: f64) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let groups: Vec<&[f64]> = values.chunk_by(|a, b| b - a <= tolerance).collect();
        // Groups of a few values are slips between the places.
        let usual = groups.iter().map(|group| group.len()).max()?;
        let is_place = |group: &&&[f64]| group.len() * 20 >= usual;
        let means: Vec<f64> = groups.iter().filter(is_place).map(|g| g.iter().sum::<f64>() / g.len() as f64).collect();
        let mut steps: Vec<f64> = means.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let at = *means.first()?;
        if steps.is_empty() {
            let is_near = values.iter().filter(|value| (**value - at).abs() <= tolerance).count();
            return is_on(is_near, values.len()).then_some(Self { step: None, first: at, last: at });
        }
        steps.sort_by(f64::total_cmp);
        let guess = steps[steps.len() / 2];
        let index = |value: f64| ((value - at) / guess).round();
        let (step, first) = line(values.iter().map(|value| (index(*value), *value)))?;
        let rounded = (step / round).round() * round;
        let n_steps = index(means[means.len() - 1]);
        let step = if rounded > 0.0 && (rounded - step).abs() * n_steps < tolerance { rounded } else { step };
        let is_near = |value: &&f64| (**value - first - index(**value) * step).abs() <= tolerance;
        let n_near = values.iter().filter(is_near).count();
        is_on(n_near, values.len()).then_some(Self { step: Some(step), first, last: first + n_steps * step })
    }
}

fn is_on(n_near: usize, n: usize) -> bool {
    n_near as f64 >= (1.0 - MOST_OFF) * n as f64
}

/// Slope and offset of the line of least squares through points; `None` where all have one abscissa.
fn line(points: impl Iterator<Item = (f64, f64)>) -> Option<(f64, f64)> {
    let [mut n, mut x, mut y, mut xx, mut xy] = [0.0; 5];
    for (a, b) in points {
        [n, x, y, xx, xy] = [n + 1.0, x + a, y + b, xx + a * a, xy + a * b];
    }
    let spread = n * xx - x * x;
    let slope = (n * xy - x * y) / spread;
    (spread > 0.0).then(|| (slope, (y - slope * x) / n))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: Tolerance = Tolerance { mm: 0.5, deg: 1.5 };

    /// Poses of a grid, each moved by up to a share of the tolerance, every `skip`th left out.
    fn poses(grid: PoseGrid, noise: f64, skip: usize) -> Vec<Se2> {
        let wave = |i: usize, k: f64| noise * (i as f64 * k).sin();
        let moved = |i: usize| {
            let at = grid.pose(i);
            Se2::from_degrees(at.x_mm + wave(i, 1.3), at.y_mm + wave(i, 2.7), at.theta_deg() + 3.0 * wave(i, 0.7))
        };
        (0..grid.len()).filter(|i| i % skip != 0).map(moved).collect()
    }

    #[test]
    fn a_robot_s_poses_give_the_grid_that_it_was_sent_to() {
        let fine = PoseGrid { xy_half_mm: 16.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };
        let turn = PoseGrid { theta_half_deg: 180.0, ..PoseGrid::SMALL };
        let place = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 1.0, theta_half_deg: 30.0, theta_step_deg: 2.5 };
        for grid in [PoseGrid::SMALL, PoseGrid::LARGE, fine, turn] {
            assert_eq!(fit(&poses(grid, 0.15, 31), TOLERANCE).unwrap(), grid);
        }
        assert_eq!(fit(&poses(place, 0.02, 1_000), Tolerance { mm: 0.1, deg: 0.2 }).unwrap(), place);
    }

    #[test]
    fn scattered_and_shifted_poses_are_refused_with_what_helps() {
        let tolerance = TOLERANCE;
        let scattered: Vec<Se2> =
            (0..500).map(|i| Se2::from_degrees(f64::from(i * 37 % 160) / 10.0 - 8.0, 0.0, 0.0)).collect();
        let shifted: Vec<Se2> = poses(PoseGrid::SMALL, 0.1, 900).iter().map(|p| Se2::new(1.5, 0.0, 0.0) * *p).collect();
        for (poses, words) in [(scattered, "on none"), (shifted, "shifted by 1.50 mm in x"), (Vec::new(), "poses")] {
            let error = fit(&poses, tolerance).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_grid_of_other_steps_covers_the_same_poses() {
        let grid = covering(&poses(PoseGrid::SMALL, 0.1, 900), 2.0, 15.0).unwrap();
        assert_eq!(grid, PoseGrid { xy_step_mm: 2.0, theta_step_deg: 15.0, ..PoseGrid::SMALL });
        for bad in [(0.0, 15.0), (2.0, f64::NAN), (-1.0, 15.0)] {
            assert!(covering(&[Se2::IDENTITY], bad.0, bad.1).is_err());
        }
    }
}

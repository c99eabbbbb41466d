//! Recorded views brought to the poses of a grid.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};

use crate::bank::nearest_touches::{BankPoses, nearest_touches};
use crate::bank::similarity::normalize_rows;

/// The recorded views of one part.
pub(crate) struct Recordings {
    /// Where each was touched.
    pub poses: Vec<Se2>,
    /// Its embedding, `[n, dim]`, of unit length.
    pub rows: Vec<f32>,
    /// Share of it that shows an edge, 0..=1.
    pub edge_shares: Vec<f32>,
}

/// What became of the cells of a grid.
pub(crate) struct Resampled {
    /// The touch that each cell's view is, where it is one.
    pub touch_of_cell: Vec<Option<usize>>,
    /// Whether each cell's view is known.
    pub is_known: Vec<bool>,
}

/// Touches further than this from a pose, in steps of the grid, say nothing of its view.
const RADIUS: f64 = 1.75;

/// Width of the weights of touches, steps: small, so that the nearest count most.
const WIDTH: f64 = 0.6;

/// A resampled view is known where a touch is at most this far from it, in steps, and ...
const NEAREST: f64 = 0.6;

/// ... this many are within the radius: a plane through fewer is not determined.
const MIN_TOUCHES: usize = 5;

impl Recordings {
    /// Adds the row and the edge share of each cell of `grid`: of the touch there, or of a local linear fit through the
    /// touches around it. Without resampling a cell without a touch of its own is not known.
    pub fn at_cells(
        &self,
        grid: &PoseGrid,
        poses: BankPoses,
        rows: &mut Vec<f32>,
        edge_shares: &mut Vec<f32>,
    ) -> Resampled {
        let dim = self.rows.len() / self.poses.len().max(1);
        let touch_of_cell = nearest_touches(grid, &self.poses, poses.tolerance);
        let mut is_known = vec![true; grid.len()];
        for (cell, touch) in touch_of_cell.iter().enumerate() {
            if let Some(touch) = touch {
                rows.extend(&self.rows[touch * dim..][..dim]);
                edge_shares.push(self.edge_shares[*touch]);
                continue;
            }
            let near = self.near(grid, &grid.pose(cell));
            let closest = near.iter().map(|near| near.distance).fold(f64::INFINITY, f64::min);
            is_known[cell] = poses.resample.is_some() && closest <= NEAREST && near.len() >= MIN_TOUCHES;
            let weights = linear_fit(&near);
            let mut row = vec![0.0; dim];
            let mut share = 0.0;
            for (Near { touch, .. }, weight) in near.iter().zip(weights) {
                let values = &self.rows[touch * dim..][..dim];
                row.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight as f32 * value);
                share += weight as f32 * self.edge_shares[*touch];
            }
            normalize_rows(&mut row, dim);
            rows.extend(row);
            edge_shares.push(share.clamp(0.0, 1.0));
        }
        Resampled { touch_of_cell, is_known }
    }

    /// The touches around a pose.
    fn near(&self, grid: &PoseGrid, pose: &Se2) -> Vec<Near> {
        let steps = |(touch, at): (usize, &Se2)| {
            let turn = wrap_angle(at.theta_rad - pose.theta_rad).to_degrees() / grid.theta_step_deg;
            let offset = [(at.x_mm - pose.x_mm) / grid.xy_step_mm, (at.y_mm - pose.y_mm) / grid.xy_step_mm, turn];
            let distance = offset.iter().map(|o| o * o).sum::<f64>().sqrt();
            (distance <= RADIUS).then_some(Near { touch, offset, distance })
        };
        self.poses.iter().enumerate().filter_map(steps).collect()
    }
}

/// A touch near a pose.
struct Near {
    touch: usize,
    /// Where it is from there, along x, y and theta, steps.
    offset: [f64; 3],
    distance: f64,
}

/// The weight of each touch in the value that a plane of weighted least squares through all has at the pose itself:
/// exact for what changes linearly. Slopes cost a little, so that a few touches in a row give one too.
fn linear_fit(near: &[Near]) -> Vec<f64> {
    const RIDGE: f64 = 1e-3;
    let weight = |near: &Near| (-0.5 * (near.distance / WIDTH).powi(2)).exp();
    let with_one = |near: &Near| [1.0, near.offset[0], near.offset[1], near.offset[2]];
    let mut normal = [[0.0_f64; 5]; 4];
    for at in near {
        let (w, x) = (weight(at), with_one(at));
        for (row, a) in normal.iter_mut().zip(x) {
            row.iter_mut().zip(x).for_each(|(sum, b)| *sum += w * a * b);
        }
    }
    let total = normal[0][0];
    for (axis, row) in normal.iter_mut().enumerate().skip(1) {
        row[axis] += RIDGE * total;
    }
    // The first row of the inverse: the solution for the first unit vector.
    normal[0][4] = 1.0;
    let first = solve(normal);
    near.iter().map(|at| weight(at) * with_one(at).iter().zip(first).map(|(a, b)| a * b).sum::<f64>()).collect()
}

/// Solves a symmetric positive definite system, its right side in the last column, by elimination.
fn solve(mut rows: [[f64; 5]; 4]) -> [f64; 4] {
    for at in 0..4 {
        let pivot = rows[at];
        for row in &mut rows[at + 1..] {
            let share = if pivot[at] > 0.0 { row[at] / pivot[at] } else { 0.0 };
            row.iter_mut().zip(pivot).for_each(|(value, above)| *value -= share * above);
        }
    }
    let mut solution = [0.0; 4];
    for at in (0..4).rev() {
        let known: f64 = (at + 1..4).map(|later| rows[at][later] * solution[later]).sum();
        solution[at] = if rows[at][at] > 0.0 { (rows[at][4] - known) / rows[at][at] } else { 0.0 };
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::pose::grid_fit::Tolerance;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };

    /// A view that turns steadily with the pose.
    fn view(pose: &Se2) -> [f32; 3] {
        let angle = 0.05 * pose.x_mm - 0.04 * pose.y_mm + 0.3 * pose.theta_rad;
        [(angle.cos() * 0.8) as f32, (angle.sin() * 0.8) as f32, 0.6]
    }

    fn recordings(poses: Vec<Se2>) -> Recordings {
        let rows = poses.iter().flat_map(view).collect();
        let edge_shares = poses.iter().map(|pose| (0.3 + 0.01 * pose.x_mm) as f32).collect();
        Recordings { poses, rows, edge_shares }
    }

    /// Cosine and difference of share at each cell.
    fn errors(poses: Vec<Se2>, settings: BankPoses) -> (Vec<f32>, Vec<f32>, Vec<bool>) {
        let (mut rows, mut shares) = (Vec::new(), Vec::new());
        let resampled = recordings(poses).at_cells(&GRID, settings, &mut rows, &mut shares);
        let cosine = |cell: usize| {
            let row = &rows[3 * cell..][..3];
            row.iter().zip(view(&GRID.pose(cell))).map(|(a, b)| a * b).sum::<f32>()
        };
        let off = |cell: usize| (shares[cell] - (0.3 + 0.01 * GRID.pose(cell).x_mm) as f32).abs();
        ((0..GRID.len()).map(cosine).collect(), (0..GRID.len()).map(off).collect(), resampled.is_known)
    }

    #[test]
    fn what_was_not_recorded_is_unknown_and_interpolated() {
        let is_lost = |cell: usize| cell.is_multiple_of(29);
        let poses = (0..GRID.len()).filter(|cell| !is_lost(*cell)).map(|cell| GRID.pose(cell)).collect();
        let (cosines, off, known) = errors(poses, BankPoses::default());
        for cell in 0..GRID.len() {
            assert_eq!(known[cell], !is_lost(cell));
            assert!(cosines[cell] > 0.9999 && off[cell] < 1e-3, "{cell}: {} {}", cosines[cell], off[cell]);
        }
    }

    #[test]
    fn scattered_touches_are_resampled_where_they_are_dense() {
        let wave = |i: usize, k: f64| (i as f64 * k).fract() * 2.0 - 1.0;
        // Three touches for each cell, and none where x is above 5 mm.
        let place =
            |i: usize| Se2::from_degrees(9.0 * wave(i, 0.618_033), 9.0 * wave(i, 0.754_877), 52.0 * wave(i, 0.569_840));
        let poses: Vec<Se2> = (0..3 * GRID.len()).map(place).filter(|pose| pose.x_mm < 5.0).collect();
        let settings = BankPoses { resample: Some([2.0, 15.0]), tolerance: Tolerance { mm: 0.1, deg: 0.5 } };
        let (cosines, off, known) = errors(poses, settings);
        let left = |cell: &usize| GRID.pose(*cell).x_mm < 5.0;
        let share = |n: usize, of: usize| n as f64 / of as f64;
        let n_left = (0..GRID.len()).filter(left).count();
        let n_known = (0..GRID.len()).filter(|cell| left(cell) && known[*cell]).count();
        assert!(share(n_known, n_left) > 0.8, "{n_known} of {n_left}");
        assert!((0..GRID.len()).filter(|cell| GRID.pose(*cell).x_mm > 7.0).all(|cell| !known[cell]));
        for cell in (0..GRID.len()).filter(|cell| known[*cell]) {
            assert!(cosines[cell] > 0.999 && off[cell] < 5e-3, "{cell}: {} {}", cosines[cell], off[cell]);
        }
    }

    #[test]
    fn a_plane_is_met_exactly() {
        let at = |touch: usize, offset: [f64; 3]| Near {
            touch,
            offset,
            distance: offset.iter().map(|o| o * o).sum::<f64>().sqrt(),
        };
        let points = [
            [0.4, -0.2, 0.1],
            [-0.7, 0.3, 0.2],
            [0.1, 0.9, -0.5],
            [0.2, -0.8, 0.6],
            [-0.3, 0.1, -0.9],
            [0.5, 0.5, 0.5],
        ];
        let near: Vec<Near> = points.iter().enumerate().map(|(i, offset)| at(i, *offset)).collect();
        let value = |o: &[f64; 3]| 2.0 + 0.3 * o[0] - 0.5 * o[1] + 0.7 * o[2];
        let found: f64 = linear_fit(&near).iter().zip(&points).map(|(w, o)| w * value(o)).sum();
        // But for what slopes cost.
        assert!((found - 2.0).abs() < 5e-3, "{found}");
        let alone = [at(0, [0.5, 0.0, 0.0])];
        assert!((linear_fit(&alone)[0] - 1.0).abs() < 1e-2);
    }
}

//! Which recorded touch is the view of each pose of a grid.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::grid_fit::Tolerance;
use tactile_data::pose::se2::{Se2, wrap_angle};

/// Which poses a bank gets from recorded touches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BankPoses {
    /// Steps in mm and degrees to resample to; `None`: the dataset's own grid, stated or found from its poses.
    pub resample: Option<[f64; 2]>,
    /// How far a touch may lie from its place on the grid.
    pub tolerance: Tolerance,
}

/// For each cell of a grid the touch nearest to it of those within the tolerance; the first of equals.
pub(crate) fn nearest_touches(grid: &PoseGrid, poses: &[Se2], tolerance: Tolerance) -> Vec<Option<usize>> {
    let mut touches: Vec<Option<(f64, usize)>> = vec![None; grid.len()];
    for (index, pose) in poses.iter().enumerate() {
        let Some(cell) = grid.nearest(pose) else { continue };
        let at = grid.pose(cell);
        let turned = wrap_angle(at.theta_rad - pose.theta_rad).to_degrees().abs();
        let off = (at.distance_mm(pose) / tolerance.mm).max(turned / tolerance.deg);
        if off <= 1.0 && touches[cell].is_none_or(|(before, _)| off < before) {
            touches[cell] = Some((off, index));
        }
    }
    touches.into_iter().map(|touch| touch.map(|(_, index)| index)).collect()
}

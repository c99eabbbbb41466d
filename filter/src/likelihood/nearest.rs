//! The recorded view nearest to a pose, and how far it can be trusted for what would be seen there.

use tactile_data::pose::grid::{NearestCell, PoseGrid};
use tactile_data::pose::se2::{Se2, wrap_angle};

/// The recorded view used for a pose, and how far it is trusted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The nearest cell of the grid.
    pub cell: usize,
    /// 1 within the tolerance, falling towards 0 with the distance to the cell's pose.
    pub trust: f64,
}

/// The recorded view nearest to a pose; `None` outside the recorded area, where the view is unknown.
///
/// With the distance `d` from the recorded pose, in grid steps (the larger of shift and turn), the trust is
/// 1 up to `tolerance` and `exp(-((d - tolerance) / tolerance)^2 / 2)` beyond it.
pub fn nearest_view(grid: &PoseGrid, part_from_sensor: &Se2, tolerance: f64) -> Option<Nearest> {
    trusted(grid, &NearestCell::on(grid), part_from_sensor, tolerance)
}

/// [`nearest_view`] for many poses; `cells` are the grid's.
pub(crate) fn trusted(grid: &PoseGrid, cells: &NearestCell, part_from_sensor: &Se2, tolerance: f64) -> Option<Nearest> {
    let cell = cells.of(part_from_sensor)?;
    // No pose is farther than half a step along each axis from the nearest recorded one.
    if tolerance > std::f64::consts::FRAC_1_SQRT_2 {
        return Some(Nearest { cell, trust: 1.0 });
    }
    let recorded = grid.pose(cell);
    let shift = recorded.distance_mm(part_from_sensor) / grid.xy_step_mm;
    let turn = wrap_angle(recorded.theta_rad - part_from_sensor.theta_rad).to_degrees().abs() / grid.theta_step_deg;
    let excess = (shift.max(turn) - tolerance) / tolerance;
    // A millionth of a step is rounding of the composed pose, not distance.
    let trust = if excess <= 1e-6 { 1.0 } else { (-0.5 * excess * excess).exp() };
    Some(Nearest { cell, trust })
}

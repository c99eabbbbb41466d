//! Which turns of a part change nothing that can be felt.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use tactile_data::se2::Se2;

use crate::calibration::BLANK_SHARE;
use crate::views::Views;

/// A part feels the same after a turn by `360 / order` degrees about its centre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Symmetry {
    /// Turns after which the part feels the same, the turn by 0 degrees among them: 1 for a part without symmetry.
    pub order: usize,
    /// The point that stays where it is, in the part's frame, mm.
    pub centre_mm: [f64; 2],
}

impl Symmetry {
    /// A part without symmetry.
    pub const NONE: Self = Self { order: 1, centre_mm: [0.0; 2] };

    /// Whether it could have been found in a bank.
    pub(crate) fn is_valid(&self) -> bool {
        (1..=ORDERS[0]).contains(&self.order) && self.centre_mm.iter().all(|mm| mm.is_finite())
    }

    /// The poses that feel the same as this one, itself first, `[order]`.
    pub fn twins(&self, part_from_sensor: &Se2) -> Vec<Se2> {
        (0..self.order).map(|k| self.turn(k) * *part_from_sensor).collect()
    }

    /// `k` turns about the centre, to the left of a pose.
    fn turn(&self, k: usize) -> Se2 {
        let [x, y] = self.centre_mm;
        let turn = Se2::new(0.0, 0.0, TAU * k as f64 / self.order as f64);
        Se2::new(x, y, 0.0) * turn * Se2::new(-x, -y, 0.0)
    }
}

/// Orders that are looked for, the highest first. A round part has the first of them.
const ORDERS: [usize; 6] = [12, 8, 6, 4, 3, 2];

/// Views that show the same have at least this cosine on average. On the tuning letters a half turn reaches 0.97 to
/// 0.99 for N, O and X, about the best centre at most 0.93 for letters without that symmetry.
const SAME: f64 = 0.95;

/// Pairs of views that a turn has to bring together at least, and at most in a first look and in a second one.
const N_PAIRS: [usize; 3] = [4, 64, 1_024];

/// Two poses count as one within this share of a step of the grid.
const TOLERANCE: f64 = 0.26;

/// The turns under which a part stays the same, as far as its recorded views can tell: those of the
/// highest order, about the centre where they fit best. Centres are looked for within one step of the part's own.
pub(crate) fn symmetry(views: &Views<'_>, part: usize) -> Symmetry {
    let places = [0.0, -0.5, 0.5, -1.0, 1.0].map(|steps| steps * views.grid.xy_step_mm);
    let centres = || places.into_iter().flat_map(|x| places.map(|y| [x, y]));
    let of_order = |order: usize| {
        let alike = |centre_mm| {
            let symmetry = Symmetry { order, centre_mm };
            likeness(views, part, &symmetry, N_PAIRS[1]).filter(|rough| *rough >= SAME - 0.1)?;
            Some((symmetry, likeness(views, part, &symmetry, N_PAIRS[2])?))
        };
        let best = centres().filter_map(alike).reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.filter(|(_, alike)| *alike >= SAME).map(|(symmetry, _)| symmetry)
    };
    ORDERS.into_iter().find_map(of_order).unwrap_or(Symmetry::NONE)
}

/// The least, over the turns of a symmetry, of the mean cosine of the views that the turn brings together,
/// -1..=1, from about `n_pairs` of them; `None` where the smallest brings too few together. A view with an edge is
/// not like one without.
fn likeness(views: &Views<'_>, part: usize, symmetry: &Symmetry, n_pairs: usize) -> Option<f64> {
    let grid = views.grid;
    let (n_theta, start) = (grid.n_theta(), part * grid.len());
    let is_edged = |cell: usize| views.edge_shares[start + cell] >= BLANK_SHARE;
    let is_known = |cell: usize| views.missing.binary_search(&(start + cell)).is_err();
    let (mm, deg) = (TOLERANCE * grid.xy_step_mm, TOLERANCE * grid.theta_step_deg);
    let of_turn = |k: usize| {
        let turn = symmetry.turn(k);
        let twin = |cell: usize| grid.exact(&(turn * grid.pose(cell)), mm, deg);
        // Most angles may have no twin within the recorded range: they are left out at once.
        let turned = Se2::new(0.0, 0.0, turn.theta_rad);
        let has_twin =
            |theta: &usize| grid.nearest(&(turned * Se2::new(0.0, 0.0, grid.pose(*theta).theta_rad))).is_some();
        let thetas: Vec<usize> = (0..n_theta).filter(|theta| has_twin(theta)).collect();
        let cells = thetas.iter().flat_map(|theta| (0..grid.len()).skip(*theta).step_by(n_theta));
        let every = (thetas.len() * grid.len() / n_theta).div_ceil(n_pairs).max(1);
        let (mut sum, mut n) = (0.0, 0);
        let pairs = cells.step_by(every).filter_map(|cell| Some((cell, twin(cell)?)));
        for (cell, twin) in pairs.filter(|(cell, twin)| is_known(*cell) && is_known(*twin)) {
            match (is_edged(cell), is_edged(twin)) {
                (true, true) => sum += f64::from(views.rows.cosine(start + cell, start + twin)),
                (false, false) => continue,
                _ => {}
            }
            n += 1;
        }
        (n >= N_PAIRS[0]).then(|| sum / n as f64)
    };
    // An order whose smallest turn no recorded angle shows is not known.
    let first = of_turn(1)?;
    Some((2..symmetry.order).filter_map(of_turn).fold(first, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::Bank;
    use crate::rows::Rows;
    use tactile_data::grid::PoseGrid;

    const DIM: usize = 24;

    /// A bank of one part whose view at a pose is a smooth function of it that is the same at the pose's twins: the
    /// sum over the turns of random waves.
    fn bank(symmetry: Symmetry, grid: PoseGrid) -> Bank {
        let wave = |i: usize, pose: &Se2| {
            let f = |n: usize| ((i * 7 + n) as f64 * 12.9898).sin() * 0.35;
            let (sin, cos) = pose.theta_rad.sin_cos();
            (f(1) * pose.x_mm + f(2) * pose.y_mm + 6.0 * f(3) * sin + 6.0 * f(4) * cos + 9.0 * f(5)).sin()
        };
        let mut rows = Vec::new();
        for cell in 0..grid.len() {
            let twins = symmetry.twins(&grid.pose(cell));
            let row = (0..DIM).map(|i| twins.iter().map(|twin| wave(i, twin)).sum::<f64>() as f32);
            rows.extend(row);
        }
        crate::similarity::normalize_rows(&mut rows, DIM);
        Bank::from_rows(vec!["A".into()], grid, Rows::new(DIM, rows).unwrap(), vec![0.3; grid.len()], "").unwrap()
    }

    /// 9 x 9 x 13 poses.
    const GRID: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

    #[test]
    fn turns_that_change_nothing_are_found_with_their_centre() {
        for (order, centre_mm) in [(1, [0.0; 2]), (2, [0.0; 2]), (2, [1.0, -2.0]), (4, [0.0; 2]), (6, [0.0, 0.0])] {
            let truth = Symmetry { order, centre_mm };
            assert_eq!(bank(truth, GRID).symmetry(0), truth);
        }
    }

    #[test]
    fn a_coarse_bank_tells_half_turns_too() {
        let truth = Symmetry { order: 2, centre_mm: [0.0; 2] };
        assert_eq!(bank(truth, PoseGrid::SMALL).symmetry(0), truth);
        assert_eq!(bank(Symmetry::NONE, PoseGrid::SMALL).symmetry(0), Symmetry::NONE);
    }

    #[test]
    fn what_no_recorded_view_tells_is_no_symmetry() {
        let narrow = PoseGrid { theta_half_deg: 15.0, ..GRID };
        assert_eq!(bank(Symmetry { order: 2, centre_mm: [0.0; 2] }, narrow).symmetry(0), Symmetry::NONE);
        let one = PoseGrid { xy_half_mm: 0.0, theta_half_deg: 0.0, ..GRID };
        assert_eq!(bank(Symmetry::NONE, one).symmetry(0), Symmetry::NONE);
    }

    #[test]
    fn twins_are_turned_about_the_centre() {
        let symmetry = Symmetry { order: 4, centre_mm: [1.0, 2.0] };
        let twins = symmetry.twins(&Se2::from_degrees(2.0, 2.0, 10.0));
        let expected = [[2.0, 2.0, 10.0], [1.0, 3.0, 100.0], [0.0, 2.0, -170.0], [1.0, 1.0, -80.0]];
        assert_eq!(twins.len(), 4);
        for (twin, [x, y, theta]) in twins.iter().zip(expected) {
            let turned = tactile_data::se2::wrap_angle(twin.theta_rad - f64::to_radians(theta)).abs();
            assert!((twin.x_mm - x).hypot(twin.y_mm - y) < 1e-12 && turned < 1e-12, "{twins:?}");
        }
    }
}

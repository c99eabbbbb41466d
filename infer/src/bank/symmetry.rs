//! The symmetry of a part as far as its recorded views tell.

use std::f64::consts::TAU;

use tactile_data::pose::symmetry::Symmetry;

use crate::bank::Bank;
use crate::calibration::BLANK_SHARE;
use crate::embedding::threads;
use crate::error::{Error, Result};

/// The highest order that is looked for.
const MAX_ORDER: usize = 12;

/// Turns of a round part that are looked at, evenly spread: a prime above [`MAX_ORDER`].
const N_ROUND: usize = 13;

/// Views that show the same have at least this cosine on average: the first of all pairs, the second of the tenth of them
/// that is least alike, where a notch shows. On tuning parts half a turn reaches 0.987 and 0.979 for N, O, X and a
/// Lightning plug; a letter S heavier at its foot 0.970 and 0.933, a mini USB plug 0.959 and 0.926, a notched ring 0.958 and
/// 0.903.
const SAME: [f64; 2] = [0.975, 0.95];

/// Below this the first pairs at the part's own centre rule a turn out, wherever its centre is.
const ROUGHLY_SAME: f64 = 0.6;

/// Pairs of views that a turn has to bring together at least, and at most in a first look and in a second one.
const N_PAIRS: [usize; 3] = [4, 48, 512];

/// Two poses count as one within this share of a step of a grid that is too coarse to be interpolated.
const TOLERANCE: f64 = 0.26;

impl Bank {
    /// The same bank, with the symmetries that its views show.
    pub(crate) fn with_found_symmetries(self) -> Self {
        let symmetries = threads::map(self.parts().len(), |part| symmetry(&self, part));
        self.of_symmetries(symmetries)
    }

    /// The same bank, with a part that is declared to feel the same after `order` turns, or after any (`None`), about the
    /// centre where its views fit that best.
    ///
    /// # Errors
    /// A part that the bank does not hold, or no number of turns.
    pub fn with_declared(self, part: &str, order: Option<usize>) -> Result<Self> {
        let Some(index) = self.parts().iter().position(|name| name == part) else {
            return Err(Error::invalid("symmetry", format!("one of the parts {}", self.parts().join(" ")), part));
        };
        if !(Symmetry { order, ..Symmetry::NONE }.is_valid()) {
            let expected = format!("1 to {} turns, or round", Symmetry::MAX_ORDER);
            let got = order.unwrap_or_default().to_string();
            return Err(Error::invalid(format!("symmetry of part {part}"), expected, got));
        }
        let mut symmetries: Vec<Symmetry> = (0..self.parts().len()).map(|part| self.symmetry(part)).collect();
        symmetries[index] = of_declared(&self, index, order);
        Ok(self.of_symmetries(symmetries))
    }
}

/// The turns under which a part stays the same, as far as its recorded views show: the turns of
/// the highest order, about the centre where they fit best. Centres are looked for within one step of the part's own.
fn symmetry(bank: &Bank, part: usize) -> Symmetry {
    let n_turns = |order: Option<usize>| order.unwrap_or(N_ROUND);
    let orders = std::iter::once(None).chain((2..=MAX_ORDER).rev().map(Some));
    orders.into_iter().find_map(|order| of_order(bank, part, order, n_turns(order))).unwrap_or(Symmetry::NONE)
}

/// The symmetry of a declared order about the centre where the views fit best; about the part's own where they tell none.
fn of_declared(bank: &Bank, part: usize, order: Option<usize>) -> Symmetry {
    let at_part = Symmetry { order, centre_mm: [0.0; 2] };
    let n_turns = order.unwrap_or(N_ROUND);
    if n_turns < 2 { at_part } else { best_centre(bank, part, order, n_turns).map_or(at_part, |(found, _)| found) }
}

fn of_order(bank: &Bank, part: usize, order: Option<usize>, n_turns: usize) -> Option<Symmetry> {
    let at_part = Symmetry { order, centre_mm: [0.0; 2] };
    likeness(bank, part, &at_part, TAU / n_turns as f64, N_PAIRS[1]).filter(|[all, _]| *all >= ROUGHLY_SAME)?;
    let (found, [all, least]) = best_centre(bank, part, order, n_turns)?;
    if all < SAME[0] || least < SAME[1] {
        return None;
    }
    let is_same = |k: usize| {
        let alike = likeness(bank, part, &found, TAU * k as f64 / n_turns as f64, N_PAIRS[2]);
        alike.is_none_or(|[all, least]| all >= SAME[0] && least >= SAME[1])
    };
    (1..n_turns).all(is_same).then_some(found)
}

/// The centre about which the smallest turn brings the views together best, and how well.
fn best_centre(bank: &Bank, part: usize, order: Option<usize>, n_turns: usize) -> Option<(Symmetry, [f64; 2])> {
    let places = [0.0, -0.5, 0.5, -1.0, 1.0].map(|steps| steps * bank.grid().xy_step_mm);
    let centres = places.into_iter().flat_map(|x| places.map(|y| [x, y]));
    let of_centre = |centre_mm| {
        let symmetry = Symmetry { order, centre_mm };
        Some((symmetry, likeness(bank, part, &symmetry, TAU / n_turns as f64, N_PAIRS[1])?))
    };
    centres.filter_map(of_centre).reduce(|best, next| if next.1[0] > best.1[0] { next } else { best })
}

/// How alike the views are that a turn brings together, from about `n_pairs` of them, -1..=1: the mean cosine of all, and
/// of the least alike tenth; `None` where it brings too few together. A view with an edge is not like one without.
fn likeness(bank: &Bank, part: usize, symmetry: &Symmetry, theta_rad: f64, n_pairs: usize) -> Option<[f64; 2]> {
    let (grid, turn) = (bank.grid(), symmetry.turn(theta_rad));
    let start = part * grid.len();
    let is_edged = |cell: usize| bank.edge_shares()[start + cell] >= BLANK_SHARE;
    let (mm, deg) = (TOLERANCE * grid.xy_step_mm, TOLERANCE * grid.theta_step_deg);
    let is_fine = crate::bank::between::is_fine(grid);
    let alike = |cell: usize| {
        let twin = turn * grid.pose(cell);
        let nearest = if is_fine { grid.nearest(&twin)? } else { grid.exact(&twin, mm, deg)? };
        let is_known = bank.is_recorded(start + cell) && bank.is_recorded(start + nearest);
        match (is_known, is_edged(cell), is_edged(nearest)) {
            (false, _, _) | (_, false, false) => None,
            (_, true, true) => bank.cosine_of_row_at(&bank.row(start + cell), part, &twin).map(f64::from),
            // At a border between the two a nearest view may be of either kind.
            _ => {
                if is_fine {
                    None
                } else {
                    Some(0.0)
                }
            }
        }
    };
    // Most angles may have no twin within the recorded range: they are left out at once.
    let has_twin = |cell: &usize| grid.nearest(&(turn * grid.pose(*cell))).is_some();
    let cells: Vec<usize> = (0..grid.len()).filter(has_twin).collect();
    let every = cells.len().div_ceil(n_pairs).max(1);
    let mut cosines: Vec<f64> = cells.into_iter().step_by(every).filter_map(alike).collect();
    if cosines.len() < N_PAIRS[0] {
        return None;
    }
    cosines.sort_unstable_by(f64::total_cmp);
    let mean = |some: &[f64]| some.iter().sum::<f64>() / some.len() as f64;
    Some([mean(&cosines), mean(&cosines[..cosines.len().div_ceil(10)])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::rows::Rows;
    use tactile_data::pose::grid::PoseGrid;
    use tactile_data::pose::se2::Se2;

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
        crate::bank::similarity::normalize_rows(&mut rows, DIM);
        Bank::from_rows(vec!["A".into()], grid, Rows::new(DIM, rows).unwrap(), vec![0.3; grid.len()], "").unwrap()
    }

    /// 9 x 9 x 13 poses.
    const GRID: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

    #[test]
    fn turns_that_change_nothing_are_found_with_their_centre() {
        for (order, centre_mm) in [(1, [0.0; 2]), (2, [0.0; 2]), (2, [1.0, -2.0]), (4, [0.0; 2]), (6, [0.0, 0.0])] {
            let truth = Symmetry { order: Some(order), centre_mm };
            assert_eq!(bank(truth, GRID).symmetry(0), truth);
        }
    }

    #[test]
    fn a_coarse_bank_tells_half_turns_too() {
        let truth = Symmetry { order: Some(2), centre_mm: [0.0; 2] };
        assert_eq!(bank(truth, PoseGrid::SMALL).symmetry(0), truth);
        assert_eq!(bank(Symmetry::NONE, PoseGrid::SMALL).symmetry(0), Symmetry::NONE);
    }

    #[test]
    fn what_no_recorded_view_tells_is_no_symmetry() {
        let narrow = PoseGrid { theta_half_deg: 15.0, ..GRID };
        assert_eq!(bank(Symmetry { order: Some(2), centre_mm: [0.0; 2] }, narrow).symmetry(0), Symmetry::NONE);
        let one = PoseGrid { xy_half_mm: 0.0, theta_half_deg: 0.0, ..GRID };
        assert_eq!(bank(Symmetry::NONE, one).symmetry(0), Symmetry::NONE);
    }
}

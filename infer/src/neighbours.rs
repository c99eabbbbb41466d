//! How alike the views beside each other on a bank's grid are: what interpolation between them needs to know.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::bank::Bank;
use crate::similarity::peg_similarity;

/// For one row of a bank, the cosine with the row `k` steps further along an axis (x, y, theta): `[axis][k - 1]`, k
/// up to 3; 1 where the grid ends before it.
pub type Neighbours = [[f32; 3]; 3];

/// The neighbours of each row, `[n_rows]`.
pub fn neighbours(bank: &Bank) -> Arc<[Neighbours]> {
    let (n_xy, n_theta) = (bank.grid().n_xy(), bank.grid().n_theta());
    let axes = [(n_xy * n_theta, n_xy), (n_theta, n_xy), (1, n_theta)];
    let norms: Vec<f32> = (0..bank.n_rows()).map(|row| peg_similarity(bank, row, row).max(0.0).sqrt()).collect();
    let of_row = |row: usize| {
        axes.map(|(stride, length)| {
            let index = row % bank.grid().len() / stride % length;
            [1, 2, 3].map(|k| {
                if index + k >= length {
                    return 1.0;
                }
                let further = row + k * stride;
                let cosine = peg_similarity(bank, row, further) / (norms[row] * norms[further]);
                if cosine.is_finite() { cosine.clamp(-1.0, 1.0) } else { 0.0 }
            })
        })
    };
    (0..bank.n_rows()).into_par_iter().map(of_row).collect::<Vec<_>>().into()
}

/// What follows from a bank's rows, worked out when it is first asked for.
#[derive(Clone, Debug)]
pub(crate) struct Once<T>(OnceLock<T>);

impl<T> Once<T> {
    /// Not asked for yet.
    pub fn new() -> Self {
        Self(OnceLock::new())
    }

    /// Known already.
    pub fn with(value: T) -> Self {
        Self(value.into())
    }

    /// The value where it was asked for.
    pub fn known(&self) -> Option<&T> {
        self.0.get()
    }

    /// The value, found by `find` the first time.
    pub fn get(&self, find: impl FnOnce() -> T) -> &T {
        self.0.get_or_init(find)
    }
}

/// It follows from the rows, which are compared.
impl<T> PartialEq for Once<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::grid::PoseGrid;

    #[test]
    fn each_row_is_compared_with_those_behind_it_on_each_axis() {
        // 3 x 3 x 5 poses; rows turn by 0.1 rad an x step, 0.2 a y step and 0.3 a step of the angle.
        let grid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let turn = |cell: usize| 0.1 * (cell / 15) as f32 + 0.2 * (cell / 5 % 3) as f32 + 0.3 * (cell % 5) as f32;
        // Lengths do not matter.
        let rows =
            (0..90).flat_map(|row| [turn(row % 45).cos(), turn(row % 45).sin()].map(|v| v * (1 + row % 3) as f32));
        let names = vec!["A".into(), "B".into()];
        let bank = Bank::from_rows(names, grid, 2, rows.collect(), vec![0.2; 90], String::new()).unwrap();
        let found = neighbours(&bank);
        // The second part's first row: two steps to the end of x and y, four of the angle.
        let expected = [[0.1, 0.2, 0.0], [0.2, 0.4, 0.0], [0.3, 0.6, 0.9]];
        for (cosines, turns) in found[45].iter().zip(expected) {
            for (cosine, turn) in cosines.iter().zip(turns) {
                assert!((cosine - f32::cos(turn)).abs() < 1e-6, "{:?}", found[45]);
            }
        }
        // Its last row ends the grid on every axis.
        assert_eq!(found[89], [[1.0; 3]; 3]);
    }
}

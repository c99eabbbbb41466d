//! How alike the views beside each other on a bank's grid are: what interpolation between them needs to know.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::bank::Bank;
use crate::similarity::peg_similarity;

/// For each view of one part, the cosines with those one to three steps further along each axis; 1 where the grid ends
/// before. All of one angle, axis and distance lie together, in order of the place on the axis: those beside each other
/// there are asked for as one.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    n_xy: usize,
    n_theta: usize,
    /// `[theta][axis][k - 1][n_xy][n_xy]`, x slowest but for the y axis, where y is.
    cosines: Vec<f32>,
}

impl Neighbours {
    /// The axes: x, y and theta.
    const N_AXES: usize = 3;

    /// The largest distance, steps.
    const MAX_STEPS: usize = 3;

    /// From the cosine of a view, by its indices along x, y and theta, with the one `k` steps further along an axis.
    pub fn new(n_xy: usize, n_theta: usize, cosine: impl Fn([usize; 3], usize, usize) -> f32) -> Self {
        let mut cosines = Vec::with_capacity(n_theta * Self::N_AXES * Self::MAX_STEPS * n_xy * n_xy);
        for theta in 0..n_theta {
            for axis in 0..Self::N_AXES {
                for k in 1..=Self::MAX_STEPS {
                    let places = (0..n_xy * n_xy).map(|place| (place / n_xy, place % n_xy));
                    let view = |(slow, fast)| if axis == 1 { [fast, slow, theta] } else { [slow, fast, theta] };
                    cosines.extend(places.map(|place| cosine(view(place), axis, k)));
                }
            }
        }
        Self { n_xy, n_theta, cosines }
    }

    /// The cosines `k` steps along an axis at each place, all at one angle: `[n_xy, n_xy]`, x slowest but for the y
    /// axis, where y is.
    ///
    /// # Panics
    /// Outside the grid, and for `k` that is not 1..=3.
    #[inline]
    pub fn plane(&self, axis: usize, k: usize, theta: usize) -> &[f32] {
        assert!(axis < Self::N_AXES && (1..=Self::MAX_STEPS).contains(&k) && theta < self.n_theta);
        let n_places = self.n_xy * self.n_xy;
        &self.cosines[((theta * Self::N_AXES + axis) * Self::MAX_STEPS + k - 1) * n_places..][..n_places]
    }
}

/// The neighbours of each part's views, `[n_parts]`.
pub fn neighbours(bank: &Bank) -> Arc<[Neighbours]> {
    let (n_xy, n_theta, n_cells) = (bank.grid().n_xy(), bank.grid().n_theta(), bank.grid().len());
    let strides = bank.grid().strides();
    let norms: Vec<f32> = (0..bank.n_rows()).map(|row| peg_similarity(bank, row, row).max(0.0).sqrt()).collect();
    let of_part = |part: usize| {
        let cosine = |view: [usize; 3], axis: usize, k: usize| {
            if view[axis] + k >= [n_xy, n_xy, n_theta][axis] {
                return 1.0;
            }
            let cell: usize = view.iter().zip(strides).map(|(index, stride)| index * stride).sum();
            let row = part * n_cells + cell;
            let further = row + k * strides[axis];
            let cosine = peg_similarity(bank, row, further) / (norms[row] * norms[further]);
            if cosine.is_finite() { cosine.clamp(-1.0, 1.0) } else { 0.0 }
        };
        Neighbours::new(n_xy, n_theta, cosine)
    };
    (0..bank.parts().len()).into_par_iter().map(of_part).collect::<Vec<_>>().into()
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
        // From the second part's first row it is two steps to the end of x and y, four of the angle.
        for (axis, turns) in [[0.1, 0.2, 0.0], [0.2, 0.4, 0.0], [0.3, 0.6, 0.9]].into_iter().enumerate() {
            for (k, turn) in turns.into_iter().enumerate() {
                assert!((found[1].plane(axis, k + 1, 0)[0] - f32::cos(turn)).abs() < 1e-6, "{axis} {k}");
                // Its last row ends the grid on every axis.
                assert_eq!(found[1].plane(axis, k + 1, 4)[8], 1.0);
            }
        }
        // At x index 1 and y index 0: one step to the end of x, two of y; the y axis counts y first.
        assert!((found[0].plane(0, 1, 2)[3] - f32::cos(0.1)).abs() < 1e-6);
        assert!((found[0].plane(1, 2, 2)[1] - f32::cos(0.4)).abs() < 1e-6);
        assert_eq!([found[0].plane(0, 2, 2)[3], found[0].plane(1, 3, 2)[1]], [1.0; 2]);
    }
}

//! How alike neighbouring views on a bank's grid are: what interpolation between them needs to know.

use std::sync::Arc;

use tactile_data::grid::PoseGrid;

use crate::rows::Rows;
use crate::threads;

/// For each view of one part, the cosines with those one to three steps further along each axis, round the circle where the
/// angles go round; 1 where the grid ends before. All of one angle, axis and distance lie together, in order of the place on the axis: neighbours are
/// asked for together.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    n_xy: usize,
    n_theta: usize,
    /// `[theta][axis][k - 1][n_xy][n_xy]`, x slowest but for the y axis, where y is.
    cosines: Arc<[f32]>,
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
        Self { n_xy, n_theta, cosines: cosines.into() }
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
pub(crate) fn neighbours(grid: &PoseGrid, rows: &Rows) -> Vec<Neighbours> {
    let (n_xy, n_theta, n_cells) = (grid.n_xy(), grid.n_theta(), grid.len());
    let strides = grid.strides();
    let norms: Vec<f32> = (0..rows.len()).map(|row| rows.cosine(row, row).max(0.0).sqrt()).collect();
    let of_part = |part: usize| {
        let cosine = |view: [usize; 3], axis: usize, k: usize| {
            let (mut moved, n) = (view, [n_xy, n_xy, n_theta][axis]);
            moved[axis] += k;
            if moved[axis] >= n {
                if axis < 2 || !grid.goes_round() {
                    return 1.0;
                }
                moved[axis] %= n;
            }
            let row_of = |view: [usize; 3]| {
                part * n_cells + view.iter().zip(strides).map(|(index, stride)| index * stride).sum::<usize>()
            };
            let (row, further) = (row_of(view), row_of(moved));
            let cosine = rows.cosine(row, further) / (norms[row] * norms[further]);
            if cosine.is_finite() { cosine.clamp(-1.0, 1.0) } else { 0.0 }
        };
        Neighbours::new(n_xy, n_theta, cosine)
    };
    threads::map(rows.len() / n_cells, of_part)
}

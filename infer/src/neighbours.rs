//! How alike neighbouring views on a bank's grid are: what interpolation between them needs to know.

use std::sync::Arc;

use tactile_data::grid::PoseGrid;

use crate::between::Around;
use crate::rows::Rows;
use crate::similarity::dot;
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
    /// `[theta][across][n_xy][n_xy]`, x slowest; empty where all are 0.
    across: Arc<[f32]>,
}

/// Half way along several axes at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Across {
    /// Along x and y.
    Xy,
    /// Along x and the angle.
    XTheta,
    /// Along y and the angle.
    YTheta,
    /// Along all three.
    All,
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
        Self { n_xy, n_theta, cosines: cosines.into(), across: Arc::default() }
    }

    /// For each view, by how much the squared length of the embedding interpolated half way from it along several axes is more
    /// than the product of its lengths along each, as a share of that: at each place, at one angle, `[n_xy, n_xy]`, x slowest.
    /// `None`: none of them is.
    #[inline]
    pub fn across(&self, axes: Across, theta: usize) -> Option<&[f32]> {
        let n_places = self.n_xy * self.n_xy;
        let first = (theta * 4 + axes as usize) * n_places;
        self.across.get(first..first + n_places)
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
        let mut unit = Vec::with_capacity(n_cells * rows.dim());
        for row in part * n_cells..(part + 1) * n_cells {
            let scale = if norms[row] > 0.0 { norms[row].recip() } else { 0.0 };
            unit.extend(rows.row(row).iter().map(|value| scale * value));
        }
        let across = Halves { grid, dim: rows.dim() }.across(&unit).into();
        Neighbours { across, ..Neighbours::new(n_xy, n_theta, cosine) }
    };
    threads::map(rows.len() / n_cells, of_part)
}

/// Embeddings half way between the recorded ones of one part.
struct Halves<'a> {
    grid: &'a PoseGrid,
    dim: usize,
}

impl Halves<'_> {
    /// [`Neighbours::across`] of all views, from their embeddings of unit length, `[n_cells, dim]`.
    fn across(&self, unit: &[f32]) -> Vec<f32> {
        let along_x = self.half_way(unit, 0);
        let [of_x, of_y, of_theta] =
            [self.squares(&along_x), self.squares(&self.half_way(unit, 1)), self.squares(&self.half_way(unit, 2))];
        let along_xy = self.half_way(&along_x, 1);
        let of_xy = self.squares(&along_xy);
        let of_all = self.squares(&self.half_way(&along_xy, 2));
        let of_x_theta = self.squares(&self.half_way(&along_x, 2));
        let of_y_theta = self.squares(&self.half_way(&self.half_way(unit, 1), 2));
        let (n, n_theta) = (self.grid.n_xy(), self.grid.n_theta());
        let mut across = vec![0.0; 4 * unit.len() / self.dim];
        for cell in 0..unit.len() / self.dim {
            let [x, y, theta] = [0, 1, 2].map(|axis| self.next(cell, axis));
            let mean = |of: &[f32], other: usize| 0.5 * (of[cell] + of[other]);
            let place = (cell % n_theta * 4 * n + cell / (n * n_theta)) * n + cell / n_theta % n;
            let mut set = |axes: Across, found: f32, product: f32| {
                let more = found / product - 1.0;
                across[place + axes as usize * n * n] = if more.is_finite() { more.clamp(-0.5, 0.5) } else { 0.0 };
            };
            if let (Some(x), Some(y)) = (x, y) {
                set(Across::Xy, of_xy[cell], mean(&of_x, y) * mean(&of_y, x));
            }
            if let (Some(x), Some(theta)) = (x, theta) {
                set(Across::XTheta, of_x_theta[cell], mean(&of_x, theta) * mean(&of_theta, x));
            }
            if let (Some(y), Some(theta)) = (y, theta) {
                set(Across::YTheta, of_y_theta[cell], mean(&of_y, theta) * mean(&of_theta, y));
            }
            if let (Some(x), Some(y), Some(_)) = (x, y, theta) {
                let pair = |of: &[f32], at: usize, axis: usize| 0.5 * (of[at] + of[self.next(at, axis).unwrap_or(at)]);
                let both = |y: usize| pair(&of_x, y, 2) * pair(&of_theta, y, 0);
                set(Across::All, of_all[cell], 0.25 * (both(cell) + both(y)) * (pair(&of_y, cell, 2) + pair(&of_y, x, 2)));
            }
        }
        across
    }

    /// The cell one step further along an axis; `None` where the grid ends.
    fn next(&self, cell: usize, axis: usize) -> Option<usize> {
        let (stride, n, goes_round) = self.axis(axis);
        let index = cell / stride % n;
        match index + 1 < n {
            true => Some(cell + stride),
            false if goes_round => Some(cell - index * stride),
            false => None,
        }
    }

    /// Stride and length of an axis, and whether it goes round.
    fn axis(&self, axis: usize) -> (usize, usize, bool) {
        let n = [self.grid.n_xy(), self.grid.n_xy(), self.grid.n_theta()][axis];
        (self.grid.strides()[axis], n, axis == 2 && self.grid.goes_round())
    }

    /// The embedding half a step further along an axis from each; zeros where the grid ends.
    fn half_way(&self, embeddings: &[f32], axis: usize) -> Vec<f32> {
        let (stride, n, goes_round) = self.axis(axis);
        let places: Vec<Around> = (0..n).map(|index| Around::half_way(index, n, goes_round)).collect();
        let mut found = vec![0.0; embeddings.len()];
        for (cell, found) in found.chunks_exact_mut(self.dim).enumerate() {
            let index = cell / stride % n;
            if self.next(cell, axis).is_none() {
                continue;
            }
            let Around { indices, weights, .. } = places[index];
            for (at, weight) in indices.into_iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
                let from = (cell + at * stride - index * stride) * self.dim;
                found.iter_mut().zip(&embeddings[from..]).for_each(|(found, value)| *found += weight * value);
            }
        }
        found
    }

    fn squares(&self, embeddings: &[f32]) -> Vec<f32> {
        embeddings.chunks_exact(self.dim).map(|embedding| dot(embedding, embedding)).collect()
    }
}

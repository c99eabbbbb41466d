//! How alike neighbouring views on a bank's grid are: what interpolation between them needs to know.

use std::sync::Arc;

use tactile_data::pose::grid::PoseGrid;

use crate::bank::between::Around;
use crate::bank::rows::Rows;
use crate::bank::similarity::dot;
use crate::embedding::threads;

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
        for (row, norm) in norms.iter().enumerate().skip(part * n_cells).take(n_cells) {
            let scale = if *norm > 0.0 { norm.recip() } else { 0.0 };
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
        let [along_x, along_y, along_theta] = [0, 1, 2].map(|axis| self.half_way(unit, axis));
        let [of_x, of_y, of_theta] = [&along_x, &along_y, &along_theta].map(|along| self.squares(along));
        let along_xy = self.half_way(&along_x, 1);
        let of_xy = self.squares(&along_xy);
        let of_all = self.squares(&self.half_way(&along_xy, 2));
        let of_x_theta = self.squares(&self.half_way(&along_x, 2));
        let of_y_theta = self.squares(&self.half_way(&along_y, 2));
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
                set(
                    Across::All,
                    of_all[cell],
                    0.25 * (both(cell) + both(y)) * (pair(&of_y, cell, 2) + pair(&of_y, x, 2)),
                );
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

#[cfg(test)]
mod tests {
    use tactile_data::pose::se2::Se2;

    use super::*;
    use crate::bank::Bank;

    const DIM: usize = 16;
    /// 5 x 5 x 5 poses.
    const PART: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
    /// 5 x 5 x 18 poses, which go round.
    const RING: PoseGrid = PoseGrid { theta_half_deg: 180.0, theta_step_deg: 20.0, ..PART };

    /// Embeddings of unit length that wave over places and angles, each value in a way of its own.
    fn bank(grid: PoseGrid) -> Bank {
        let value = |pose: &Se2, i: usize| {
            let phase = |of: f64| (i as f64 * of).sin() * 3.0;
            let place = 0.5 * (phase(1.3) / 3.0 * pose.x_mm + phase(2.1) / 3.0 * pose.y_mm) + phase(3.7);
            let turns = f64::from(i as u32 % 3);
            (place.sin() + (turns * pose.theta_rad + phase(5.3) + 0.2 * pose.x_mm).cos()) as f32
        };
        let embedding = |cell: usize| {
            let values: Vec<f32> = (0..DIM).map(|i| value(&grid.pose(cell), i)).collect();
            let length = dot(&values, &values).sqrt();
            values.into_iter().map(move |value| value / length).collect::<Vec<_>>()
        };
        let rows = Rows::new(DIM, (0..grid.len()).flat_map(embedding).collect()).unwrap();
        Bank::from_rows(vec!["only".into()], grid, rows, vec![0.3; grid.len()], "").unwrap()
    }

    /// The embedding interpolated at a pose, from all 64 around it.
    fn square_at(bank: &Bank, pose: &Se2) -> f32 {
        let embedding = bank.row_between(0, pose).unwrap();
        dot(&embedding, &embedding)
    }

    /// The squared length half way along one axis from a view, by its definition.
    fn half_way(bank: &Bank, cell: [usize; 3], steps: [f64; 3]) -> f32 {
        let grid = bank.grid();
        let [x, y, theta] = [0, 1, 2].map(|axis| cell[axis] as f64 + steps[axis]);
        let place = |index: f64| index * grid.xy_step_mm - grid.xy_half_mm;
        square_at(bank, &Se2::from_degrees(place(x), place(y), theta * grid.theta_step_deg - grid.theta_half_deg))
    }

    #[test]
    fn what_is_across_makes_products_of_lengths_those_of_the_embeddings() {
        for grid in [PART, RING] {
            let bank = bank(grid);
            let neighbours = &bank.neighbours()[0];
            let (n, n_theta) = (grid.n_xy(), grid.n_theta());
            let last = if grid.goes_round() { n_theta } else { n_theta - 1 };
            let mut largest = [0.0_f32; 4];
            for (x, y, theta) in
                (0..n - 1).flat_map(|x| (0..n - 1).flat_map(move |y| (0..last).map(move |k| (x, y, k))))
            {
                let half = |at: [usize; 3], steps: [f64; 3]| half_way(&bank, at, steps);
                let mean = |a: f32, b: f32| 0.5 * (a + b);
                let [along_x, along_y, along_theta] = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
                let cell = [x, y, theta];
                let [next_x, next_y, next_theta] = [[x + 1, y, theta], [x, y + 1, theta], [x, y, theta + 1]];
                let of = |steps, next| mean(half(cell, steps), half(next, steps));
                let products = [
                    (Across::Xy, [0.5, 0.5, 0.0], of(along_x, next_y) * of(along_y, next_x)),
                    (Across::XTheta, [0.5, 0.0, 0.5], of(along_x, next_theta) * of(along_theta, next_x)),
                    (Across::YTheta, [0.0, 0.5, 0.5], of(along_y, next_theta) * of(along_theta, next_y)),
                ];
                for (axes, steps, product) in products {
                    let across = neighbours.across(axes, theta).unwrap()[x * n + y];
                    largest[axes as usize] = largest[axes as usize].max(across.abs());
                    let exact = half(cell, steps);
                    // Sums of 16 products of 16 values in f32.
                    assert!((product * (1.0 + across) - exact).abs() < 3e-6, "{axes:?} {cell:?}: {across} {exact}");
                }
                largest[3] = largest[3].max(neighbours.across(Across::All, theta).unwrap()[x * n + y].abs());
            }
            // Without it lengths would be off by so much.
            assert!(largest.iter().all(|more| *more > 2e-3), "{largest:?}");
        }
    }

    #[test]
    fn cosines_of_embeddings_of_any_length_are_those_of_their_directions() {
        let plain = bank(PART);
        let longer = |cell: usize| plain.row(cell).iter().map(|value| 3.0 * value).collect::<Vec<_>>();
        let rows = Rows::new(DIM, (0..PART.len()).flat_map(longer).collect()).unwrap();
        let [short, long] = [plain.rows(), &rows].map(|rows| neighbours(&PART, rows).remove(0));
        for theta in 0..PART.n_theta() {
            for axis in 0..3 {
                for k in 1..=3 {
                    let pairs = short.plane(axis, k, theta).iter().zip(long.plane(axis, k, theta));
                    pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-6, "{a} {b}"));
                }
            }
            for axes in [Across::Xy, Across::XTheta, Across::YTheta, Across::All] {
                let pairs = short.across(axes, theta).unwrap().iter().zip(long.across(axes, theta).unwrap());
                pairs.for_each(|(a, b)| assert!((a - b).abs() < 3e-6, "{axes:?}: {a} {b}"));
            }
        }
    }

    #[test]
    fn the_last_views_along_an_axis_have_nothing_across_it() {
        let bank = bank(PART);
        let (neighbours, n) = (&bank.neighbours()[0], PART.n_xy());
        let at = |axes, [x, y, theta]: [usize; 3]| neighbours.across(axes, theta).unwrap()[x * n + y];
        let last = n - 1;
        for other in 0..n {
            for axes in [Across::Xy, Across::XTheta, Across::All] {
                assert_eq!(at(axes, [last, other, 0]), 0.0);
            }
            for axes in [Across::Xy, Across::YTheta, Across::All] {
                assert_eq!(at(axes, [other, last, 0]), 0.0);
            }
            for axes in [Across::XTheta, Across::YTheta, Across::All] {
                assert_eq!(at(axes, [other, other, PART.n_theta() - 1]), 0.0);
            }
        }
        assert!(at(Across::YTheta, [last, 0, 0]) != 0.0 && at(Across::Xy, [0, 0, PART.n_theta() - 1]) != 0.0);
    }
}

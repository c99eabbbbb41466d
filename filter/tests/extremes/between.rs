//! Views between recorded ones from their definition, in f64 throughout: what users run, since banks are fine enough to
//! be interpolated.
//!
//! The cosine is that with the embedding that splines make of the recorded ones, over its length. Its squared length
//! is taken as a product of those along each axis, each between the recorded lines around, and is corrected by what
//! it is half way along several axes, where it is found from the embedding itself.

use tactile_data::pose::grid::PoseGrid;
use tactile_filter::TouchModel;
use tactile_infer::calibration::Spread;

use super::place::Place;
use super::reference::U;

/// Along an axis, how far views count between which a spline runs: its four points.
const STEPS: usize = 3;

/// The axes along which a place is half way, of which the squared length there is known: x and y, x and theta, y and
/// theta, all.
const HALF_WAY: [[bool; 3]; 4] = [[true, true, false], [true, false, true], [false, true, true], [true; 3]];

/// Parts of which nothing is known match with so much more variance than those calibrated on, a standard deviation.
const OTHER_PARTS: f64 = 0.0325;

/// The weights of a spline sum to this at most along an axis, by their sizes.
const WEIGHTS: f64 = 1.25;

/// The recorded views, and the settings that matches with them are judged by.
pub struct Recorded {
    /// Where they were recorded, of each part.
    pub grid: PoseGrid,
    /// Number of parts.
    pub n_parts: usize,
    /// Whether each row was recorded, `[n_rows]`.
    pub is_recorded: Vec<bool>,
    /// As they are in the bank's metric.
    pub config: TouchModel,
    /// How well the touches of each part match, as the bank knows it; empty where it does not.
    pub matched: Vec<Spread>,
    /// The rows, `[n_rows, dim]`, each of length 1.
    unit: Vec<f64>,
    dim: usize,
    /// The cosine of each row with the one that is 1 to 3 steps further along each axis, `[axis][steps - 1][n_rows]`.
    further: [[Vec<f64>; STEPS]; 3],
    /// By how much the squared length half way from each row is more than the product of those along each axis,
    /// relative to that: `[n_rows]` for each of [`HALF_WAY`].
    more: [Vec<f64>; 4],
}

impl Recorded {
    /// Rows, `[n_rows, dim]`, of which those of each part are in the order of the grid's cells.
    pub fn new(grid: PoseGrid, rows: &[f32], dim: usize, is_recorded: Vec<bool>, config: TouchModel) -> Self {
        let mut unit: Vec<f64> = rows.iter().map(|value| f64::from(*value)).collect();
        for row in unit.chunks_exact_mut(dim) {
            let length = inner(row, row).sqrt();
            row.iter_mut().for_each(|value| *value /= length);
        }
        let n_rows = is_recorded.len();
        let of = strides(&grid);
        let cosine = |at: usize, axis: usize, k: usize| {
            let further = at + k * of[axis];
            let is_inside = at / of[axis] % counts(&grid)[axis] + k < counts(&grid)[axis];
            if is_inside { inner(&unit[at * dim..][..dim], &unit[further * dim..][..dim]) } else { f64::NAN }
        };
        let further = [0, 1, 2].map(|axis: usize| {
            [1, 2, 3].map(|k: usize| (0..n_rows).map(|at| cosine(at, axis, k)).collect::<Vec<f64>>())
        });
        let (n_parts, more) = (n_rows / grid.len(), [const { Vec::new() }; 4]);
        let recorded = Self { grid, n_parts, is_recorded, config, matched: Vec::new(), unit, dim, further, more };
        let more = HALF_WAY.map(|is_half| (0..n_rows).map(|row| recorded.more_half_way(row, is_half)).collect());
        Self { more, ..recorded }
    }

    /// How far touches are from their own views: as the bank knows, or else the settings.
    pub fn own_distance(&self) -> f64 {
        let sum = self.matched.iter().map(|matched| (2.0 - 2.0 * matched.mean).sqrt()).sum::<f64>();
        if self.matched.is_empty() { self.config.own_distance } else { sum / self.matched.len() as f64 }
    }

    /// The cosine that is expected of a touch of a part, and its standard deviation.
    pub fn expected(&self, part: usize) -> [f64; 2] {
        let TouchModel { matched_mean, matched_sd, .. } = self.config;
        match self.matched.get(part) {
            Some(Spread { mean, sd }) => [*mean, sd.max(matched_sd)],
            None => [matched_mean, matched_sd.hypot(OTHER_PARTS)],
        }
    }

    /// The row of a part nearest to a place.
    pub fn row(&self, part: usize, [x, y, theta]: &[Place; 3]) -> usize {
        part * self.grid.len() + self.cell([x.nearest, y.nearest, theta.nearest])
    }

    fn cell(&self, indices: [usize; 3]) -> usize {
        indices.iter().zip(strides(&self.grid)).map(|(index, stride)| index * stride).sum()
    }

    /// The rows of a part around a place, and how much each counts.
    fn around(&self, part: usize, [x, y, theta]: &[Place; 3]) -> Vec<(usize, f64)> {
        let first = part * self.grid.len();
        let mut rows = Vec::with_capacity(64);
        for (x, wx) in &x.weights {
            for (y, wy) in &y.weights {
                let of_theta = theta.weights.iter();
                rows.extend(of_theta.map(|(theta, wt)| (first + self.cell([*x, *y, *theta]), wx * wy * wt)));
            }
        }
        rows
    }

    /// The cosine with the view of a part between the recorded ones, -1..=1, from those with all rows.
    pub fn cosine(&self, cosines: &[f64], part: usize, at: &[Place; 3]) -> f64 {
        let value: f64 = self.around(part, at).into_iter().map(|(row, weight)| weight * cosines[row]).sum();
        (value / self.square(part, at).max(0.09).sqrt()).clamp(-1.0, 1.0)
    }

    /// The squared length of the interpolated embedding, as it is taken.
    fn square(&self, part: usize, at: &[Place; 3]) -> f64 {
        self.product(part, at) * (1.0 + self.more_at(part, at))
    }

    /// The same, as it is.
    fn exact_square(&self, part: usize, at: &[Place; 3]) -> f64 {
        let mut sum = vec![0.0; self.dim];
        for (row, weight) in self.around(part, at) {
            let row = &self.unit[row * self.dim..][..self.dim];
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
        }
        inner(&sum, &sum)
    }

    /// The squared length of the embedding interpolated along an axis alone, through a recorded place.
    fn along(&self, part: usize, axis: usize, place: &Place, through: [usize; 3]) -> f64 {
        let stride = strides(&self.grid)[axis];
        let base = part * self.grid.len() + self.cell(through) - through[axis] * stride;
        let cosine = |a: usize, b: usize| match a.abs_diff(b) {
            0 => 1.0,
            k => self.further[axis][k - 1][base + a.min(b) * stride],
        };
        let pairs = place.weights.iter().flat_map(|a| place.weights.iter().map(move |b| (a, b)));
        pairs.map(|((a, wa), (b, wb))| wa * wb * cosine(*a, *b)).sum()
    }

    /// The product of the squared lengths along each axis, each between those through the recorded places around:
    /// that along x is multiplied by that along theta at each y around, that along y at the end.
    fn product(&self, part: usize, [x, y, theta]: &[Place; 3]) -> f64 {
        let of_x = |y: usize| theta.between(|theta| self.along(part, 0, x, [0, y, theta]));
        let of_y = |x: usize| theta.between(|theta| self.along(part, 1, y, [x, 0, theta]));
        let of_theta = |x: usize, y: usize| self.along(part, 2, theta, [x, y, 0]);
        y.between(|y| of_x(y) * x.between(|x| of_theta(x, y))) * x.between(of_y)
    }

    /// By how much the squared length half way from a row along some axes is more than [`Self::product`], relative to
    /// that; at most a half, and nothing where the grid ends.
    fn more_half_way(&self, row: usize, is_half: [bool; 3]) -> f64 {
        let (part, cell) = (row / self.grid.len(), row % self.grid.len());
        let [of, n] = [strides(&self.grid), counts(&self.grid)];
        let indices = [0, 1, 2].map(|axis: usize| cell / of[axis] % n[axis]);
        if (0..3).any(|axis| is_half[axis] && indices[axis] + 1 == n[axis]) {
            return 0.0;
        }
        let place = |axis: usize| Place::at(indices[axis] as f64 + if is_half[axis] { 0.5 } else { 0.0 }, n[axis]);
        let at = [0, 1, 2].map(place);
        (self.exact_square(part, &at) / self.product(part, &at) - 1.0).clamp(-0.5, 0.5)
    }

    /// The same anywhere: that of each of [`HALF_WAY`], by how near the place is to half way along its axes, between
    /// the places around along the others.
    fn more_at(&self, part: usize, at: &[Place; 3]) -> f64 {
        let mut sum = 0.0;
        for (is_half, more) in HALF_WAY.iter().zip(&self.more) {
            // Along each axis the places that count: one half way, or both around.
            let along = |axis: usize| {
                let Place { low, share, .. } = at[axis];
                let near = (4.0 * share * (1.0 - share)).powf(1.5);
                let rest = 1.0 - near;
                let around = [(low, rest * (1.0 - share)), (low + 1, rest * share)];
                if is_half[axis] { vec![(low, near)] } else { around.to_vec() }
            };
            for (x, wx) in along(0) {
                for (y, wy) in along(1) {
                    for (theta, wt) in along(2) {
                        let weight = wx * wy * wt;
                        let row = || part * self.grid.len() + self.cell([x, y, theta]);
                        sum += if weight == 0.0 { 0.0 } else { weight * more[row()] };
                    }
                }
            }
        }
        sum
    }

    /// What a view may count with where all states are judged at once: 0.2 above the best of the recorded ones of its
    /// part with an x that counts, and of those with such a y, at the angles that count.
    pub fn most(&self, cosines: &[f64], part: usize, at: &[Place; 3]) -> f64 {
        let (first, of, n) = (part * self.grid.len(), strides(&self.grid), self.grid.n_xy());
        let on_lines = |axis: usize, other: usize| {
            let mut best = -1.0_f64;
            for line in at[axis].counting() {
                for theta in at[2].counting() {
                    let start = first + line * of[axis] + theta * of[2];
                    (0..n).for_each(|place| best = best.max(cosines[start + place * of[other]]));
                }
            }
            best
        };
        (on_lines(0, 1).min(on_lines(1, 0)) + 0.2).min(1.0)
    }

    /// How far a cosine with a view between recorded ones may be off, where one with a recorded view is, by `cosine`,
    /// and one between two of them, by `neighbours`.
    ///
    /// The value is a sum by the weights of three axes. The squared length is a product of three sums of cosines by
    /// pairs of weights, and of one more than what the exact one half way is over such a product: relative errors add
    /// up. All are the largest where embeddings are the shortest, half way between recorded views.
    pub fn error_between(&self, [cosine, neighbours]: [f64; 2]) -> f64 {
        let [mut along, mut product, mut square, mut factor] = [1.0_f64; 4];
        let n = counts(&self.grid);
        for row in 0..self.is_recorded.len() {
            let (part, cell) = (row / self.grid.len(), row % self.grid.len());
            let indices = [0, 1, 2].map(|axis: usize| cell / strides(&self.grid)[axis] % n[axis]);
            let half = |axis: usize| Place::at((indices[axis] as f64 + 0.5).min((n[axis] - 1) as f64), n[axis]);
            let at = [0, 1, 2].map(half);
            along = (0..3).map(|axis| self.along(part, axis, &at[axis], indices)).fold(along, f64::min);
            (product, square) = (product.min(self.product(part, &at)), square.min(self.square(part, &at)));
            factor = self.more.iter().map(|more| 1.0 + more[row]).fold(factor, f64::max);
        }
        let of_product = 3.0 * WEIGHTS.powi(2) * (neighbours + 8.0 * U) / along;
        let of_factor = WEIGHTS.powi(6) * (neighbours + 16.0 * U) / product + factor * of_product;
        let relative = of_product + 2.0 * (of_factor + 8.0 * U);
        WEIGHTS.powi(3) * (cosine + 12.0 * U) / square.sqrt() + 0.5 * relative
    }
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// How many places there are along x, y and theta.
fn counts(grid: &PoseGrid) -> [usize; 3] {
    [grid.n_xy(), grid.n_xy(), grid.n_theta()]
}

/// How many rows apart neighbours along x, y and theta are.
fn strides(grid: &PoseGrid) -> [usize; 3] {
    [grid.n_xy() * grid.n_theta(), grid.n_theta(), 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::Pose;
    use tactile_data::pose::se2::Se2;

    const SMALL: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };

    /// Rows of two parts in six dimensions that change with the pose by so much a step.
    fn recorded(change: f64) -> (Recorded, Vec<f32>) {
        let value = |row: usize, i: usize| {
            let pose = SMALL.pose(row % SMALL.len());
            let phase = (i * i) as f64 + 0.9 * (row / SMALL.len()) as f64;
            let turn = [pose.x_mm / 2.0, pose.y_mm / 2.0, pose.theta_deg() / 15.0];
            let turn: f64 = turn.iter().zip([1.0, 0.7, 0.4]).map(|(at, of)| at * (of + 0.3 * i as f64).sin()).sum();
            (phase + change * turn).sin() as f32
        };
        let rows: Vec<f32> = (0..2 * SMALL.len()).flat_map(|row| (0..6).map(move |i| value(row, i))).collect();
        (Recorded::new(SMALL, &rows, 6, vec![true; 2 * SMALL.len()], TouchModel::default()), rows)
    }

    fn place(x: f64, y: f64, theta: f64) -> [Place; 3] {
        Place::of_pose(&SMALL, &Pose::from_degrees(x, y, theta), &Se2::from_degrees(x, y, theta))
    }

    /// On recorded lines, and half way along any axes, lengths are those of the embeddings; elsewhere nearly.
    #[test]
    fn lengths_are_those_of_interpolated_embeddings() {
        let (recorded, _) = recorded(0.5);
        let apart = |at: &[Place; 3]| recorded.square(1, at) / recorded.exact_square(1, at) - 1.0;
        for (x, y, theta) in [
            (0.0, 2.0, -15.0),
            (0.7, 2.0, -15.0),
            (4.0, -3.1, 0.0),
            (-2.0, 0.0, 22.0),
            (1.0, -3.0, 15.0),
            (1.0, 4.0, 7.5),
            (-4.0, 3.0, -22.5),
            (3.0, 1.0, 7.5),
        ] {
            assert!(apart(&place(x, y, theta)).abs() < 1e-12, "{x} {y} {theta}: {}", apart(&place(x, y, theta)));
        }
        let plain = |at: &[Place; 3]| recorded.product(1, at) / recorded.exact_square(1, at) - 1.0;
        let anywhere: Vec<[Place; 3]> = (0..400)
            .map(|k| [0.754_877, 0.569_840, 0.430_160].map(|by| 2.0 * (by * f64::from(k)).fract() - 1.0))
            .map(|[x, y, theta]| place(4.0 * x, 4.0 * y, 30.0 * theta))
            .collect();
        let most = |of: &dyn Fn(&[Place; 3]) -> f64| anywhere.iter().map(|at| of(at).abs()).fold(0.0, f64::max);
        assert!(most(&apart) < 0.5 * most(&plain), "{} {}", most(&apart), most(&plain));
    }

    #[test]
    fn cosines_are_those_with_interpolated_embeddings() {
        let (recorded, _) = recorded(0.5);
        let query: Vec<f64> = (0..6).map(|i| (0.9 * f64::from(i)).cos()).collect();
        let length = inner(&query, &query).sqrt();
        let cosines: Vec<f64> = recorded.unit.chunks_exact(6).map(|row| inner(row, &query) / length).collect();
        for at in [place(1.0, -3.0, 15.0), place(-3.0, 1.0, 7.5), place(0.0, 0.0, 4.0)] {
            let mut sum = vec![0.0; 6];
            for (row, weight) in recorded.around(1, &at) {
                sum.iter_mut().zip(&recorded.unit[row * 6..]).for_each(|(sum, value)| *sum += weight * value);
            }
            let expected = inner(&sum, &query) / length / inner(&sum, &sum).sqrt();
            assert!((recorded.cosine(&cosines, 1, &at) - expected).abs() < 1e-12);
        }
    }

    /// The library's lengths are in f32.
    #[test]
    fn the_librarys_cosines_are_within_their_error() {
        use tactile_filter::likelihood::interpolation::ViewWeights;
        let (recorded, mut rows) = recorded(0.5);
        tactile_infer::bank::similarity::normalize_rows(&mut rows, 6);
        let names = vec!["A".into(), "B".into()];
        let bank = tactile_infer::Bank::from_rows(
            names,
            SMALL,
            tactile_infer::bank::rows::Rows::new(6, rows).unwrap(),
            vec![0.2; 2 * SMALL.len()],
            "",
        );
        let bank = bank.unwrap();
        let query = bank.row(140).into_owned();
        let mut found = Vec::new();
        bank.similarities(&query, &mut found);
        let wide: Vec<f64> = query.iter().map(|value| f64::from(*value)).collect();
        let cosines: Vec<f64> = recorded.unit.chunks_exact(6).map(|row| inner(row, &wide)).collect();
        let error = recorded.error_between([30.0 * U, 60.0 * U]);
        assert!(error < 1e-3, "{error}");
        let mut without = 0.0_f64;
        for k in 0..400 {
            let [x, y, theta] = [0.754_877, 0.569_840, 0.430_160].map(|by| 2.0 * (by * f64::from(k)).fract() - 1.0);
            let (pose, at) = (Se2::from_degrees(4.0 * x, 4.0 * y, 30.0 * theta), place(4.0 * x, 4.0 * y, 30.0 * theta));
            let weights = ViewWeights::new(&SMALL, &pose).unwrap();
            for part in 0..2 {
                let of_library = weights.cosine(&found[part * SMALL.len()..], &bank.neighbours()[part]);
                let off = (f64::from(of_library) - recorded.cosine(&cosines, part, &at)).abs();
                assert!(off < error, "{x} {y} {theta}: {off} {error}");
                let cosine = f64::from(of_library);
                without = without.max((cosine - cosine * (1.0 + recorded.more_at(part, &at)).sqrt()).abs());
            }
        }
        // Without what is more across axes it would be outside.
        assert!(without > 2.0 * error, "{without} {error}");
    }
}

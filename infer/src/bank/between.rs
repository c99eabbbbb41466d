//! Between the recorded poses of a grid: which are around a pose, and how much each counts.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};

use crate::bank::Bank;
use crate::bank::similarity::dot;

/// Whether the views between the poses of a grid can be interpolated: at most 2.5 mm and 20 degrees a step.
///
/// On the tuning letters M-X the interpolated cosine of the true pose is 0.02 below the best of all views with a grid of
/// 2 mm and 10 or 15 degrees, and 0.11 with 4 mm and 15 or 30 degrees, where the nearest view does as well.
pub fn is_fine(grid: &PoseGrid) -> bool {
    grid.xy_step_mm <= 2.5 && grid.theta_step_deg <= 20.0
}

/// The four recorded places around a place on one axis, with the weights of cubic interpolation (Catmull and Rom 1974):
/// exact at recorded places; at the border a parabola goes on through the last three, and angles that go round have none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// Indices of the four.
    pub indices: [usize; 4],
    /// Index of the nearest recorded place.
    pub nearest: usize,
    /// How far the place is from the second of the four towards the third, 0..=1.
    pub fraction: f32,
    /// Weights of the four, which sum to 1.
    pub weights: [f32; 4],
    /// How far outside the recorded area the place is, steps; negative before its beginning, 0 within.
    pub outside: f64,
}

impl Around {
    /// A place on an axis of `n` recorded ones, at least one, from `-half` on, each `step` further.
    #[inline]
    pub fn new(value: f64, half: f64, step: f64, n: usize) -> Self {
        let place = (value + half) / step;
        let inside = place.clamp(0.0, (n - 1) as f64);
        let low = (inside as usize).min(n.saturating_sub(2));
        Self {
            indices: [-1, 0, 1, 2].map(|k: isize| low.saturating_add_signed(k).min(n - 1)),
            nearest: (inside + 0.5) as usize,
            fraction: (inside - low as f64) as f32,
            weights: at_border(catmull_rom((inside - low as f64) as f32), low == 0, low + 2 >= n, n),
            outside: place - inside,
        }
    }

    /// A place on a circle of `n` recorded ones, from `-half` on, each `step` further.
    fn on_circle(value: f64, half: f64, step: f64, n: usize) -> Self {
        let place = ((value + half) / step).rem_euclid(n as f64);
        let low = place as usize;
        Self {
            indices: [n - 1, 0, 1, 2].map(|k| (low + k) % n),
            nearest: (place + 0.5) as usize % n,
            fraction: (place - low as f64) as f32,
            weights: catmull_rom((place - low as f64) as f32),
            outside: 0.0,
        }
    }

    /// Half way from one of `n` places to the next.
    pub(crate) fn half_way(index: usize, n: usize, goes_round: bool) -> Self {
        Self::part_way(2 * index + 1, 2, n, goes_round)
    }

    /// The place so many parts of a step after the first of `n` places, where a step has so many parts.
    pub(crate) fn part_way(parts: usize, of_step: usize, n: usize, goes_round: bool) -> Self {
        let place = parts as f64 / of_step as f64;
        if goes_round { Self::on_circle(place, 0.0, 1.0, n) } else { Self::new(place, 0.0, 1.0, n) }
    }

    /// A place along x or y of a grid, mm.
    #[inline]
    pub fn x_or_y(grid: &PoseGrid, mm: f64) -> Self {
        Self::new(mm, grid.xy_half_mm, grid.xy_step_mm, grid.n_xy())
    }

    /// An angle of a grid, radians.
    #[inline]
    pub fn theta(grid: &PoseGrid, theta_rad: f64) -> Self {
        let turn = wrap_angle(theta_rad).to_degrees();
        let (half, step, n) = (grid.theta_half_deg, grid.theta_step_deg, grid.n_theta());
        if grid.goes_round() { Self::on_circle(turn, half, step, n) } else { Self::new(turn, half, step, n) }
    }

    /// A pose of a grid: its x, y and angle.
    #[inline]
    pub fn pose(grid: &PoseGrid, pose: &Se2) -> [Self; 3] {
        [Self::x_or_y(grid, pose.x_mm), Self::x_or_y(grid, pose.y_mm), Self::theta(grid, pose.theta_rad)]
    }

    /// The interpolated value of what is at each index.
    pub fn value(&self, at: impl Fn(usize) -> f32) -> f32 {
        let ([a, b, c, d], w) = (self.indices, &self.weights);
        w[0] * at(a) + w[1] * at(b) + w[2] * at(c) + w[3] * at(d)
    }

    /// The value between those at the two places around, on a line.
    #[inline]
    pub fn on_line(&self, at: impl Fn(usize) -> f32) -> f32 {
        let ([_, low, high, _], share) = (self.indices, self.fraction);
        if share == 0.0 { at(low) } else { (1.0 - share) * at(low) + share * at(high) }
    }

    /// How near the place is to the one half way between the two around, 1 there and 0 at either; and how much either counts
    /// besides.
    #[inline]
    pub fn half_weights(&self) -> (f32, [f32; 2]) {
        let near = 4.0 * self.fraction * (1.0 - self.fraction);
        let half = near * near.sqrt();
        (half, [(1.0 - half) * (1.0 - self.fraction), (1.0 - half) * self.fraction])
    }

    /// How the embedding interpolated along this axis gets its squared length from the cosines between the four: its
    /// square is the constant and, so weighted, the cosines at [`Self::pairs`].
    #[inline]
    pub fn square_weights(&self) -> (f32, [f32; 6]) {
        let w = &self.weights;
        let squares = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + w[3] * w[3];
        let of = [(0, 1), (1, 2), (2, 3), (0, 2), (1, 3), (0, 3)].map(|(a, b)| 2.0 * w[a] * w[b]);
        (squares, of)
    }

    /// The pairs among the four, each as the index of the first and the steps to the second.
    #[inline]
    pub fn pairs(&self) -> [(usize, usize); 6] {
        let [a, b, c, _] = self.indices;
        [(a, 1), (b, 1), (c, 1), (a, 2), (b, 2), (a, 3)]
    }

    /// The squared length of the embedding interpolated along this axis, from the cosine of what is at an index with
    /// what is some steps further.
    pub fn square(&self, cosine: impl Fn(usize, usize) -> f32) -> f32 {
        let (constant, weights) = self.square_weights();
        let sum: f32 = weights.iter().zip(self.pairs()).map(|(weight, (index, k))| weight * cosine(index, k)).sum();
        constant + sum
    }
}

/// Weights of the four points around a place `f` between the middle two, 0..=1.
fn catmull_rom(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, -0.5 * f2 + 0.5 * f3]
}

/// Weights where the first or the last of the four points is outside the border: what a parabola through
/// the last three recorded points (a line through two) would have there.
fn at_border([a, b, c, d]: [f32; 4], first: bool, last: bool, n: usize) -> [f32; 4] {
    match (first, last) {
        _ if n == 1 => [0.0, 1.0, 0.0, 0.0],
        (true, true) => [0.0, b + 2.0 * a - d, c - a + 2.0 * d, 0.0],
        (true, false) => [0.0, b + 3.0 * a, c - 3.0 * a, d + a],
        (false, true) => [a + d, b - 3.0 * d, c + 3.0 * d, 0.0],
        (false, false) => [a, b, c, d],
    }
}

impl Bank {
    /// The cosine of a unit-length query, `[dim]`, with the view of a part at a pose: with the embedding interpolated among
    /// the recorded ones, or the nearest where the grid is too coarse for that ([`is_fine`]). `None` outside the recorded
    /// area, and where one of the views is missing.
    pub fn cosine_at(&self, query: &[f32], part: usize, part_from_sensor: &Se2) -> Option<f32> {
        self.cosine_of_row_at(&self.in_rows_metric(query), part, part_from_sensor)
    }

    /// [`Self::cosine_at`] of an embedding as the bank's metric has it.
    pub(crate) fn cosine_of_row_at(&self, query: &[f32], part: usize, part_from_sensor: &Se2) -> Option<f32> {
        let embedding = self.row_between(part, part_from_sensor)?;
        let length = dot(&embedding, &embedding).sqrt();
        (length > 0.0).then(|| (dot(&embedding, query) / length).clamp(-1.0, 1.0))
    }

    /// The view of a part at a pose, as the bank's metric has it, of any length.
    pub(crate) fn row_between(&self, part: usize, part_from_sensor: &Se2) -> Option<Vec<f32>> {
        let (grid, strides) = (self.grid(), self.grid().strides());
        let axes = Around::pose(grid, part_from_sensor);
        // Composed poses reach the border but for rounding.
        if axes.iter().any(|axis| axis.outside.abs() > 1e-9) {
            return None;
        }
        // The row of each view that counts, and its weight: one axis after the other.
        let mut views = vec![(part * grid.len(), 1.0_f32)];
        for (axis, stride) in axes.iter().zip(strides) {
            let along: Vec<(usize, f32)> = if is_fine(grid) {
                axis.indices.into_iter().zip(axis.weights).filter(|(_, weight)| *weight != 0.0).collect()
            } else {
                vec![(axis.nearest, 1.0)]
            };
            let further = |(row, weight): (usize, f32)| {
                along.iter().map(move |(index, of_axis)| (row + index * stride, weight * of_axis))
            };
            views = views.into_iter().flat_map(further).collect();
        }
        let mut embedding = vec![0.0_f32; self.dim()];
        for (row, weight) in views {
            if !self.is_recorded(row) {
                return None;
            }
            embedding.iter_mut().zip(&*self.row(row)).for_each(|(sum, value)| *sum += weight * value);
        }
        Some(embedding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::rows::Rows;

    /// 5 x 5 x 3 poses, 2 mm and 15 degrees apart.
    const GRID: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 15.0, theta_step_deg: 15.0 };

    /// A circle walked along x, 0.1 rad a mm.
    fn circle(grid: PoseGrid) -> Bank {
        let rows = (0..grid.len()).flat_map(|cell| <[f64; 2]>::from((0.1 * grid.pose(cell).x_mm).sin_cos()));
        let rows = Rows::new(2, rows.map(|value| value as f32).collect()).unwrap();
        Bank::from_rows(vec!["only".into()], grid, rows, vec![0.3; grid.len()], "").unwrap()
    }

    fn towards(x_mm: f64) -> [f32; 2] {
        let (sin, cos) = (0.1 * x_mm).sin_cos();
        [sin as f32, cos as f32]
    }

    #[test]
    fn a_view_between_recorded_ones_is_where_the_circle_is() {
        let bank = circle(GRID);
        for x in [-4.0, -3.3, -1.0, 0.0, 0.7, 3.9] {
            let at = |query| bank.cosine_at(&towards(query), 0, &Se2::from_degrees(x, 1.3, 4.0)).unwrap();
            // Best where it was made, and off by the cosine of the angle between.
            assert!((at(x) - 1.0).abs() < 1e-6, "{x}: {}", at(x));
            assert!((f64::from(at(x + 5.0)) - 0.5_f64.cos()).abs() < 1e-3, "{x}: {}", at(x + 5.0));
        }
        assert_eq!(bank.cosine_at(&towards(0.0), 0, &Se2::from_degrees(4.1, 0.0, 0.0)), None);
    }

    #[test]
    fn a_coarse_grid_has_its_nearest_view_and_a_missing_one_has_none() {
        let coarse = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, ..GRID };
        let bank = circle(coarse);
        let cosine = bank.cosine_at(&towards(1.5), 0, &Se2::from_degrees(1.5, 0.0, 0.0)).unwrap();
        assert!((f64::from(cosine) - 0.15_f64.cos()).abs() < 1e-6, "{cosine}");
        let missing = circle(coarse).with_missing(vec![coarse.nearest(&Se2::IDENTITY).unwrap()]).unwrap();
        assert_eq!(missing.cosine_at(&towards(1.5), 0, &Se2::from_degrees(1.5, 0.0, 0.0)), None);
        assert!(missing.cosine_at(&towards(1.5), 0, &Se2::from_degrees(3.5, 0.0, 0.0)).is_some());
    }
}

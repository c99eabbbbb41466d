//! What the bank knows of a pose that it did not record: the nearest view, or the views around it.

use serde::{Deserialize, Serialize};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_infer::neighbours::Neighbours;

/// How a view between recorded poses is judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LookUp {
    /// `Cubic` where the grid is fine enough for it (at most 2.5 mm and 20 degrees a step), else `Nearest`.
    #[default]
    Auto,
    /// By the nearest recorded view, trusted less the farther it is.
    Nearest,
    /// By the similarities of the recorded views around it, interpolated.
    Cubic,
}

impl LookUp {
    /// Whether similarities are interpolated on this grid.
    ///
    /// On the tuning letters M-X the interpolated cosine of the true pose is 0.02 below the best of all
    /// views with a grid of 2 mm and 10 or 15 degrees, and 0.11 with 4 mm and 15 or 30 degrees, where
    /// the nearest view does as well.
    pub fn is_cubic(self, grid: &PoseGrid) -> bool {
        match self {
            Self::Auto => grid.xy_step_mm <= 2.5 && grid.theta_step_deg <= 20.0,
            Self::Nearest => false,
            Self::Cubic => true,
        }
    }
}

/// The recorded view that stands for a pose, and how far it is trusted to.
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
pub fn look_up(grid: &PoseGrid, part_from_sensor: &Se2, tolerance: f64) -> Option<Nearest> {
    let cell = grid.nearest(part_from_sensor)?;
    let recorded = grid.pose(cell);
    let shift = recorded.distance_mm(part_from_sensor) / grid.xy_step_mm;
    let turn = wrap_angle(recorded.theta_rad - part_from_sensor.theta_rad).to_degrees().abs() / grid.theta_step_deg;
    let excess = (shift.max(turn) - tolerance) / tolerance;
    // A millionth of a step is rounding of the composed pose, not distance.
    let trust = if excess <= 1e-6 { 1.0 } else { (-0.5 * excess * excess).exp() };
    Some(Nearest { cell, trust })
}

/// The up to 4 x 4 x 4 recorded poses around a pose, with the weights of cubic (Catmull-Rom)
/// interpolation: exact at recorded poses; at the border a parabola goes on through the last three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stencil {
    /// The nearest cell of the grid.
    pub cell: usize,
    /// 1 within the recorded area, falling with the distance from it.
    pub trust: f64,
    /// For each axis (x, y, theta), how far its four places lie from the start of a part's cells, and the nearest.
    offsets: [[usize; 4]; 3],
    nearest: [usize; 3],
    weights: [[f32; 4]; 3],
}

/// Views that have nothing in common could interpolate to nothing at all.
const SHORTEST: f32 = 0.3;

/// How far outside the recorded area a view still resembles the one at its border, in steps: the trust is
/// `exp(-(d / FADE)^2 / 2)`. Were it unknown at once, a touch just outside would speak for states that
/// see it just inside, and the pose would be drawn inwards.
const FADE: f64 = 0.5;

impl Stencil {
    /// The poses around a pose, or around the border's nearest to it; `None` more than one step outside
    /// the recorded area.
    pub fn new(grid: &PoseGrid, part_from_sensor: &Se2) -> Option<Self> {
        let (n_xy, n_theta) = (grid.n_xy(), grid.n_theta());
        let turn = wrap_angle(part_from_sensor.theta_rad).to_degrees();
        let axis = |value: f64, half: f64, step: f64, n: usize, stride: usize| {
            let place = (value + half) / step;
            let inside = place.clamp(0.0, (n - 1) as f64);
            let low = (inside as usize).min(n.saturating_sub(2));
            let offsets = [-1, 0, 1, 2].map(|k: isize| low.saturating_add_signed(k).min(n - 1) * stride);
            let weights = at_border(catmull_rom((inside - low as f64) as f32), low == 0, low + 2 >= n, n);
            (offsets, weights, inside.round() as usize * stride, place - inside)
        };
        let (half, step) = (grid.xy_half_mm, grid.xy_step_mm);
        let x = axis(part_from_sensor.x_mm, half, step, n_xy, n_xy * n_theta);
        let y = axis(part_from_sensor.y_mm, half, step, n_xy, n_theta);
        let theta = axis(turn, grid.theta_half_deg, grid.theta_step_deg, n_theta, 1);
        let steps_outside = (x.3 * x.3 + y.3 * y.3 + theta.3 * theta.3).sqrt() / FADE;
        let trust = if steps_outside > 1e-6 { (-0.5 * steps_outside * steps_outside).exp() } else { 1.0 };
        (steps_outside <= 2.0).then_some(Self {
            cell: x.2 + y.2 + theta.2,
            trust,
            nearest: [x.2, y.2, theta.2],
            offsets: [x.0, y.0, theta.0],
            weights: [x.1, y.1, theta.1],
        })
    }

    /// The cosine with the view there, from the cosines with one part's recorded views, `[grid.len()]`: that with
    /// their interpolated embedding, which is shorter than 1 between views that differ and counts by its direction.
    pub fn cosine(&self, cosines: &[f32], neighbours: &[Neighbours]) -> f32 {
        (self.value(cosines) / self.length(neighbours)).clamp(-1.0, 1.0)
    }

    /// About the length of the interpolated embedding: the product of its lengths along each axis, through the
    /// nearest recorded pose.
    fn length(&self, neighbours: &[Neighbours]) -> f32 {
        let mut square = 1.0;
        for (axis, (places, w)) in self.offsets.iter().zip(&self.weights).enumerate() {
            let line = self.cell - self.nearest[axis];
            let along = |i: usize| &neighbours[line + places[i]][axis];
            let [first, second, third] = [along(0), along(1), along(2)];
            let squares = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + w[3] * w[3];
            let one_apart = w[0] * w[1] * first[0] + w[1] * w[2] * second[0] + w[2] * w[3] * third[0];
            let further = w[0] * w[2] * first[1] + w[1] * w[3] * second[1] + w[0] * w[3] * first[2];
            square *= squares + 2.0 * (one_apart + further);
        }
        square.max(SHORTEST * SHORTEST).sqrt()
    }

    /// The interpolated value of one part's `cells`, `[grid.len()]`.
    pub fn value(&self, cells: &[f32]) -> f32 {
        let [xs, ys, thetas] = &self.offsets;
        let [x_weights, y_weights, theta_weights] = &self.weights;
        let mut value = 0.0;
        for (x, x_weight) in xs.iter().zip(x_weights) {
            for (y, y_weight) in ys.iter().zip(y_weights) {
                let line = &cells[x + y..];
                let along: f32 = thetas.iter().zip(theta_weights).map(|(theta, weight)| weight * line[*theta]).sum();
                value += x_weight * y_weight * along;
            }
        }
        value
    }
}

/// Weights of the four points around a place `f` between the middle two, 0..=1 (Catmull and Rom 1974).
fn catmull_rom(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, -0.5 * f2 + 0.5 * f3]
}

/// Weights where the first or the last of the four points lies beyond the border: what a parabola through
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 3 x 3 x 3 = 27 poses.
    const COARSE: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
    /// 9 x 9 x 13 poses.
    const FINE: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

    #[test]
    fn trust_is_whole_on_the_grid_and_falls_between_its_cells() {
        let trust = |x, theta| look_up(&COARSE, &Se2::from_degrees(x, 0.0, theta), 0.25).unwrap().trust;
        assert_eq!([trust(4.0, 30.0), trust(1.0, 0.0), trust(0.0, 7.5)], [1.0; 3]);
        // Half a step is one tolerance too far: exp(-1/2).
        assert!((trust(1.99, 0.0) - (-0.5_f64 * 0.99 * 0.99).exp()).abs() < 0.02);
        assert!((trust(0.0, 14.9) - 0.61).abs() < 0.02);
        assert_eq!(look_up(&COARSE, &Se2::from_degrees(1.9, 1.9, 14.0), 1.0).unwrap().trust, 1.0);
    }

    #[test]
    fn a_fine_grid_is_interpolated_and_a_coarse_one_is_not() {
        assert!(LookUp::Auto.is_cubic(&FINE) && !LookUp::Auto.is_cubic(&COARSE));
        assert!(!LookUp::Nearest.is_cubic(&FINE) && LookUp::Cubic.is_cubic(&COARSE));
    }

    #[test]
    fn recorded_poses_are_read_back() {
        let cells: Vec<f32> = (0..FINE.len()).map(|cell| ((cell * 37) % 101) as f32).collect();
        for cell in 0..FINE.len() {
            let stencil = Stencil::new(&FINE, &FINE.pose(cell)).unwrap();
            // The composed place is off by rounding, 1e-15 steps.
            assert!((stencil.value(&cells) - cells[cell]).abs() < 1e-3 && stencil.cell == cell);
        }
    }

    #[test]
    fn half_a_turn_is_one_angle_whichever_way() {
        let ring = PoseGrid { theta_half_deg: 180.0, theta_step_deg: 20.0, ..FINE };
        let cells: Vec<f32> = (0..ring.len()).map(|cell| ring.pose(cell).theta_rad.cos() as f32).collect();
        for degrees in [179.0, -179.0, 181.0] {
            let value = Stencil::new(&ring, &Se2::from_degrees(0.0, 0.0, degrees)).unwrap().value(&cells);
            assert!((value + 1.0).abs() < 0.01, "{degrees}: {value}");
        }
        assert_eq!(Stencil::new(&FINE, &Se2::from_degrees(0.0, 0.0, 120.0)), None);
    }

    /// Embeddings that turn steadily along each axis, in planes of their own: between them too they are known.
    #[test]
    fn the_view_between_counts_by_its_direction() {
        let embedding = |pose: &Se2| -> Vec<f32> {
            let turns = [0.35 * pose.x_mm, 0.2 * pose.y_mm, 2.0 * pose.theta_rad].map(f64::sin_cos);
            // Products of sines and cosines: of unit length, and cosines multiply over the axes.
            let one = |axis: usize, of: usize| if of == 0 { turns[axis].0 } else { turns[axis].1 };
            (0..8).map(|i| (one(0, i & 1) * one(1, i >> 1 & 1) * one(2, i >> 2)) as f32).collect()
        };
        let rows: Vec<f32> = (0..FINE.len()).flat_map(|cell| embedding(&FINE.pose(cell))).collect();
        let bank =
            tactile_infer::bank::Bank::from_rows(vec!["A".into()], FINE, 8, rows, vec![0.3; FINE.len()], String::new());
        let neighbours = bank.as_ref().unwrap().neighbours();
        for (x, y, theta) in [(1.0, 1.0, 7.5), (-2.9, 5.2, -31.0), (0.4, -0.3, 44.0), (4.0, 2.0, 30.0)] {
            let pose = Se2::from_degrees(x, y, theta);
            let query = embedding(&pose);
            let dot =
                |cell: usize| -> f32 { bank.as_ref().unwrap().row(cell).iter().zip(&query).map(|(a, b)| a * b).sum() };
            let cosines: Vec<f32> = (0..FINE.len()).map(dot).collect();
            let stencil = Stencil::new(&FINE, &pose).unwrap();
            let (plain, directed) = (stencil.value(&cosines), stencil.cosine(&cosines, &neighbours));
            // Turns of 0.7 rad a step: the interpolated embedding is up to 4 % too short.
            assert!((directed - 1.0).abs() < 2e-3 && directed >= plain - 1e-6, "{directed} {plain}");
        }
    }

    proptest! {
        /// Catmull-Rom reproduces what is quadratic, up to the border.
        #[test]
        fn what_is_quadratic_is_exact(x in -8.0..8.0_f64, y in -8.0..8.0_f64, theta in -90.0..90.0_f64) {
            let plane = |pose: &Se2| {
                let (x, y) = (pose.x_mm, pose.y_mm);
                (0.03 * x * x - 0.7 * y + 2.0 * pose.theta_rad * pose.theta_rad + 0.05 * x * y + 1.0) as f32
            };
            let cells: Vec<f32> = (0..FINE.len()).map(|cell| plane(&FINE.pose(cell))).collect();
            let pose = Se2::from_degrees(x, y, theta);
            let value = Stencil::new(&FINE, &pose).unwrap().value(&cells);
            prop_assert!((value - plane(&pose)).abs() < 1e-3, "{value}, not {}", plane(&pose));
        }

        #[test]
        fn a_constant_stays_one_to_the_border(x in -8.1..8.1_f64, y in -8.1..8.1_f64, theta in -91.0..91.0_f64) {
            let stencil = Stencil::new(&FINE, &Se2::from_degrees(x, y, theta)).unwrap();
            prop_assert!((stencil.value(&vec![0.5; FINE.len()]) - 0.5).abs() < 1e-5);
        }
    }
}

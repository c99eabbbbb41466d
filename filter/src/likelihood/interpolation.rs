//! What the bank knows of a pose that it did not record: similarities interpolated between the views around it.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::bank::between::{Around, is_fine};
use tactile_infer::bank::neighbours::{Across, Neighbours};

/// How a view between recorded poses is judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// `Cubic` where the grid is fine enough for it (at most 2.5 mm and 20 degrees a step), else `Nearest`.
    #[default]
    Auto,
    /// By the nearest recorded view, trusted less the farther it is.
    Nearest,
    /// By the similarities of the recorded views around it, interpolated.
    Cubic,
}

impl Interpolation {
    /// Whether similarities are interpolated on this grid.
    pub fn is_cubic(self, grid: &PoseGrid) -> bool {
        match self {
            Self::Auto => is_fine(grid),
            Self::Nearest => false,
            Self::Cubic => true,
        }
    }
}

/// Views that have nothing in common could interpolate to nothing at all.
const SHORTEST: f32 = 0.3;

/// The cosine with an interpolated embedding, which is shorter than 1 between views that differ and counts by its
/// direction: from the interpolated cosine and the embedding's squared length.
#[inline(always)]
pub(crate) fn directed(cosine: f32, square: f32) -> f32 {
    let square = if square > SHORTEST * SHORTEST { square } else { SHORTEST * SHORTEST };
    (cosine / square.sqrt()).clamp(-1.0, 1.0)
}

/// How far outside the recorded area a view still resembles the one at its border, in steps: the trust is
/// `exp(-(d / FADE)^2 / 2)`. Were it unknown at once, a touch just outside would speak for states that
/// see it just inside, and the pose would be drawn inwards.
const FADE: f64 = 0.5;

/// How far outside along some axes a view is, and what its trust is for that.
#[derive(Clone, Copy)]
pub(crate) struct Fading {
    /// The square of the distance, steps.
    square: f64,
    trust: f64,
}

impl Fading {
    /// Along one axis, steps.
    pub(crate) fn of(outside: f64) -> Self {
        let square = outside * outside;
        Self { square, trust: if square == 0.0 { 1.0 } else { (-0.5 * square / (FADE * FADE)).exp() } }
    }

    /// Along these axes too: squares add up, so what is trusted multiplies.
    pub(crate) fn and(self, other: Self) -> Self {
        Self { square: self.square + other.square, trust: self.trust * other.trust }
    }

    /// `None` more than one step outside; all of it where only rounding is outside.
    pub(crate) fn trust(self) -> Option<f64> {
        let is_known = self.square <= 4.0 * FADE * FADE;
        is_known.then_some(if self.square <= 1e-12 * FADE * FADE { 1.0 } else { self.trust })
    }
}

/// How far a view is trusted this far outside along each axis, steps; `None` more than one step outside.
pub(crate) fn trust(outside: [f64; 3]) -> Option<f64> {
    let [x, y, theta] = outside.map(Fading::of);
    x.and(theta).and(y).trust()
}

/// The up to 4 x 4 x 4 recorded poses around a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewWeights {
    /// The nearest cell of the grid.
    pub cell: usize,
    /// 1 within the recorded area, falling with the distance from it.
    pub trust: f64,
    /// Along x, y and theta, with the cells between two places of each.
    axes: [Around; 3],
    strides: [usize; 3],
}

impl ViewWeights {
    /// The poses around a pose, or around the border's nearest to it; `None` more than one step outside
    /// the recorded area.
    pub fn new(grid: &PoseGrid, part_from_sensor: &Se2) -> Option<Self> {
        Self::of(Around::pose(grid, part_from_sensor), grid.strides())
    }

    fn of(axes: [Around; 3], strides: [usize; 3]) -> Option<Self> {
        let trust = trust(axes.map(|axis| axis.outside))?;
        let cell = axes.iter().zip(strides).map(|(axis, stride)| axis.nearest * stride).sum();
        Some(Self { cell, trust, axes, strides })
    }

    /// The cosine with the view there, from the cosines with one part's recorded views, `[grid.len()]`: that with
    /// their interpolated embedding, whose length is about the product of its lengths along each axis, each between those
    /// through the recorded poses around.
    pub fn cosine(&self, cosines: &[f32], neighbours: &Neighbours) -> f32 {
        self.directed(self.value(cosines), neighbours)
    }

    /// [`Self::cosine`] by the [`Self::value`] of the cosines.
    fn directed(&self, value: f32, neighbours: &Neighbours) -> f32 {
        let n = self.strides[0] / self.strides[1];
        let [x, y, theta] = &self.axes;
        let along_x = |y: usize| theta.on_line(|theta| x.square(|x, k| neighbours.plane(0, k, theta)[x * n + y]));
        let along_y = |x: usize| theta.on_line(|theta| y.square(|y, k| neighbours.plane(1, k, theta)[y * n + x]));
        let along_theta = |x: usize, y: usize| theta.square(|theta, k| neighbours.plane(2, k, theta)[x * n + y]);
        let along_both = y.on_line(|y| along_x(y) * x.on_line(|x| along_theta(x, y)));
        directed(value, along_both * x.on_line(along_y) * self.across(neighbours))
    }

    /// How much more the squared length is than the product of those along each axis, as a factor.
    fn across(&self, neighbours: &Neighbours) -> f32 {
        let n = self.strides[0] / self.strides[1];
        let [[x, x_next], [y, y_next], [theta, theta_next]] = self.axes.map(|axis| [axis.indices[1], axis.indices[2]]);
        let [(half_x, of_x), (half_y, of_y), (half_theta, of_theta)] = self.axes.map(|axis| axis.half_weights());
        let at =
            |axes: Across, [x, y, theta]: [usize; 3]| neighbours.across(axes, theta).map_or(0.0, |of| of[x * n + y]);
        let xy = of_theta[0] * at(Across::Xy, [x, y, theta]) + of_theta[1] * at(Across::Xy, [x, y, theta_next]);
        let xy = xy + half_theta * at(Across::All, [x, y, theta]);
        let x_theta = of_y[0] * at(Across::XTheta, [x, y, theta]) + of_y[1] * at(Across::XTheta, [x, y_next, theta]);
        let y_theta = of_x[0] * at(Across::YTheta, [x, y, theta]) + of_x[1] * at(Across::YTheta, [x_next, y, theta]);
        1.0 + half_x * half_y * xy + half_theta * (half_x * x_theta + half_y * y_theta)
    }

    /// The interpolated value of one part's `cells`, `[grid.len()]`.
    pub fn value(&self, cells: &[f32]) -> f32 {
        let ([x, y, theta], [of_x, of_y, _]) = (&self.axes, self.strides);
        x.value(|x| y.value(|y| theta.value(|theta| cells[x * of_x + y * of_y + theta])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::nearest::nearest_view;
    use proptest::prelude::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::TAU;

    /// 3 x 3 x 3 = 27 poses.
    const COARSE: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
    /// 9 x 9 x 13 poses.
    const FINE: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

    #[test]
    fn trust_is_whole_on_the_grid_and_falls_between_its_cells() {
        let trust = |x, theta| nearest_view(&COARSE, &Se2::from_degrees(x, 0.0, theta), 0.25).unwrap().trust;
        assert_eq!([trust(4.0, 30.0), trust(1.0, 0.0), trust(0.0, 7.5)], [1.0; 3]);
        // Half a step is one tolerance too far: exp(-1/2).
        assert!((trust(1.99, 0.0) - (-0.5_f64 * 0.99 * 0.99).exp()).abs() < 0.02);
        assert!((trust(0.0, 14.9) - 0.61).abs() < 0.02);
        assert_eq!(nearest_view(&COARSE, &Se2::from_degrees(1.9, 1.9, 14.0), 1.0).unwrap().trust, 1.0);
    }

    #[test]
    fn a_fine_grid_is_interpolated_and_a_coarse_one_is_not() {
        assert!(Interpolation::Auto.is_cubic(&FINE) && !Interpolation::Auto.is_cubic(&COARSE));
        assert!(!Interpolation::Nearest.is_cubic(&FINE) && Interpolation::Cubic.is_cubic(&COARSE));
    }

    #[test]
    fn recorded_poses_are_read_back() {
        let cells: Vec<f32> = (0..FINE.len()).map(|cell| ((cell * 37) % 101) as f32).collect();
        for cell in 0..FINE.len() {
            let weights = ViewWeights::new(&FINE, &FINE.pose(cell)).unwrap();
            // The composed place is off by rounding, 1e-15 steps.
            assert!((weights.value(&cells) - cells[cell]).abs() < 1e-3 && weights.cell == cell);
        }
    }

    #[test]
    fn half_a_turn_is_one_angle_whichever_way() {
        let ring = PoseGrid { theta_half_deg: 180.0, theta_step_deg: 20.0, ..FINE };
        let cells: Vec<f32> = (0..ring.len()).map(|cell| ring.pose(cell).theta_rad.cos() as f32).collect();
        for degrees in [179.0, -179.0, 181.0] {
            let value = ViewWeights::new(&ring, &Se2::from_degrees(0.0, 0.0, degrees)).unwrap().value(&cells);
            assert!((value + 1.0).abs() < 0.01, "{degrees}: {value}");
        }
        assert_eq!(ViewWeights::new(&FINE, &Se2::from_degrees(0.0, 0.0, 120.0)), None);
    }

    /// A full turn has no seam: turned by half a turn, views and pose, all is the same.
    #[test]
    fn angles_that_go_round_are_interpolated_across_half_a_turn() {
        const DIM: usize = 8;
        let ring = PoseGrid { xy_half_mm: 2.0, theta_half_deg: 180.0, ..FINE };
        let n_theta = ring.n_theta();
        let turned = |cell: usize| cell - cell % n_theta + (cell + n_theta / 2) % n_theta;
        let noise = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 1009.0 - 0.4;
        let bank = |cell_of: &dyn Fn(usize) -> usize| {
            let row = |cell: usize| {
                let mut row: Vec<f32> = (0..DIM).map(|i| noise(cell_of(cell) * DIM + i)).collect();
                tactile_infer::bank::similarity::normalize_rows(&mut row, DIM);
                row
            };
            let rows = tactile_infer::bank::rows::Rows::new(DIM, (0..ring.len()).flat_map(row).collect()).unwrap();
            tactile_infer::Bank::from_rows(vec!["A".into()], ring, rows, vec![0.3; ring.len()], "").unwrap()
        };
        let (plain, other) = (bank(&|cell| cell), bank(&turned));
        let query: Vec<f32> = (0..DIM).map(|i| noise(i + 99_999)).collect();
        for degrees in [-180.0, -176.0, -171.5, -1.0, 0.0, 4.0, 166.0, 173.0, 179.9] {
            let cosine = |bank: &tactile_infer::Bank, degrees: f64| {
                let pose = Se2::from_degrees(0.7, -0.3, degrees);
                let cosines: Vec<f32> =
                    (0..ring.len()).map(|cell| bank.row(cell).iter().zip(&query).map(|(a, b)| a * b).sum()).collect();
                ViewWeights::new(&ring, &pose).unwrap().cosine(&cosines, &bank.neighbours()[0])
            };
            let (here, there) = (cosine(&plain, degrees), cosine(&other, degrees + 180.0));
            assert!((here - there).abs() < 1e-5, "{degrees}: {here} {there}");
        }
    }

    /// Parts whose embeddings, of unit length, are smooth over places and angles: each value is a sum of waves, none shorter
    /// than 16 mm or half a turn.
    fn smooth(grid: PoseGrid, rng: &mut ChaCha8Rng) -> tactile_infer::Bank {
        const DIM: usize = 16;
        let mut wave = || {
            let (direction, turn) = (rng.random_range(0.0..TAU), f64::from(rng.random_range(-2..=2_i32)));
            let number = rng.random_range(0.0..TAU / 16.0);
            [number * f64::cos(direction), number * f64::sin(direction), turn, rng.random_range(0.0..TAU)]
        };
        let mut rows = Vec::new();
        for _ in 0..2 {
            let values: Vec<[[f64; 4]; 3]> = (0..DIM).map(|_| [(); 3].map(|()| wave())).collect();
            for pose in (0..grid.len()).map(|cell| grid.pose(cell)) {
                let of_wave = |[x, y, turn, phase]: &[f64; 4]| {
                    (x * pose.x_mm + y * pose.y_mm + turn * pose.theta_rad + phase).cos() as f32
                };
                rows.extend(values.iter().map(|waves| waves.iter().map(of_wave).sum::<f32>()));
            }
        }
        tactile_infer::bank::similarity::normalize_rows(&mut rows, DIM);
        let shares = vec![0.3; 2 * grid.len()];
        let rows = tactile_infer::bank::rows::Rows::new(DIM, rows).unwrap();
        tactile_infer::Bank::from_rows(vec!["A".into(), "B".into()], grid, rows, shares, "").unwrap()
    }

    /// Against the embedding interpolated from all 64 around a pose: half way between recorded poses, along any axes, its
    /// length is known; elsewhere to some thousandths. Angles go round in one of the grids.
    #[test]
    fn a_view_between_recorded_ones_has_the_length_of_its_interpolated_embedding() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let ring = PoseGrid { xy_half_mm: 4.0, theta_half_deg: 180.0, ..FINE };
        for grid in [PoseGrid { theta_half_deg: 45.0, ..FINE }, ring] {
            let bank = smooth(grid, &mut rng);
            // How far all are off half way between recorded poses, at any pose, and without a length of their own.
            let mut most = [0.0_f32; 3];
            for index in 0..600 {
                let is_anywhere = index % 2 == 0;
                let [x, y, angle] =
                    [grid.xy_half_mm / 2.0, grid.xy_half_mm / 2.0, grid.theta_half_deg / 15.0].map(|half| {
                        let steps: f64 = rng.random_range(-half..half);
                        if is_anywhere { steps } else { (2.0 * steps).round() / 2.0 }
                    });
                let (pose, part) = (Se2::from_degrees(2.0 * x, 2.0 * y, 15.0 * angle), index / 2 % 2);
                let weights = ViewWeights::new(&grid, &pose).unwrap();
                // A touch like the recorded view nearest to it.
                let mut query = bank.row(part * grid.len() + weights.cell).into_owned();
                query.iter_mut().for_each(|value| *value += rng.random_range(-0.1..0.1));
                let dim = query.len();
                tactile_infer::bank::similarity::normalize_rows(&mut query, dim);
                let dot = |cell: usize| -> f32 {
                    bank.row(part * grid.len() + cell).iter().zip(&query).map(|(a, b)| a * b).sum()
                };
                let cosines: Vec<f32> = (0..grid.len()).map(dot).collect();
                let exact = bank.cosine_at(&query, part, &pose).unwrap();
                let apart = (weights.cosine(&cosines, &bank.neighbours()[part]) - exact).abs();
                let at = usize::from(is_anywhere);
                most[at] = most[at].max(apart);
                most[2] = most[2].max((weights.value(&cosines) - exact).abs());
            }
            assert!(most[0] < 1e-4 && most[1] < 3e-3 && most[2] > 0.02, "{most:?}");
        }
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
        let bank = tactile_infer::Bank::from_rows(
            vec!["A".into()],
            FINE,
            tactile_infer::bank::rows::Rows::new(8, rows).unwrap(),
            vec![0.3; FINE.len()],
            "",
        );
        let neighbours = bank.as_ref().unwrap().neighbours();
        for (x, y, theta) in [(1.0, 1.0, 7.5), (-2.9, 5.2, -31.0), (0.4, -0.3, 44.0), (4.0, 2.0, 30.0)] {
            let pose = Se2::from_degrees(x, y, theta);
            let query = embedding(&pose);
            let dot =
                |cell: usize| -> f32 { bank.as_ref().unwrap().row(cell).iter().zip(&query).map(|(a, b)| a * b).sum() };
            let cosines: Vec<f32> = (0..FINE.len()).map(dot).collect();
            let weights = ViewWeights::new(&FINE, &pose).unwrap();
            let (plain, directed) = (weights.value(&cosines), weights.cosine(&cosines, &neighbours[0]));
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
            let value = ViewWeights::new(&FINE, &pose).unwrap().value(&cells);
            prop_assert!((value - plane(&pose)).abs() < 1e-3, "{value}, not {}", plane(&pose));
        }

        #[test]
        fn a_constant_stays_one_to_the_border(x in -8.1..8.1_f64, y in -8.1..8.1_f64, theta in -91.0..91.0_f64) {
            let weights = ViewWeights::new(&FINE, &Se2::from_degrees(x, y, theta)).unwrap();
            prop_assert!((weights.value(&vec![0.5; FINE.len()]) - 0.5).abs() < 1e-5);
        }
    }
}

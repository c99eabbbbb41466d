//! A world for tests: parts are random contours in the plane, a view is what a sensor-sized window shows.

use std::sync::Arc;

use std::f64::consts::TAU;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::bank::between::is_fine;
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::{dot, normalize_rows};
use tactile_infer::calibration::match_odds::distance;

use crate::touch::Observation;
use crate::touch_model::TouchModel;

/// Points of a view along each axis.
const N_POINTS: usize = 8;

/// Parts with contours, their bank, and holes that differ a little from the pegs.
pub struct World {
    pub bank: Arc<Bank>,
    holes: Vec<Vec<[f64; 4]>>,
    noise: f64,
}

impl World {
    /// Each part is the zero line of a sum of waves drawn from a common pool; its hole has one wave more,
    /// of amplitude `misfit`. Each touch adds white noise of deviation `noise` to a view of unit length.
    pub fn new(n_parts: usize, grid: PoseGrid, misfit: f64, noise: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut wave = |amplitude: f64| {
            let (direction, number) = (rng.random::<f64>() * TAU, TAU / rng.random_range(16.0..40.0));
            [number * direction.cos(), number * direction.sin(), rng.random::<f64>() * TAU, amplitude]
        };
        let pool: Vec<[f64; 4]> = (0..8).map(|_| wave(1.0)).collect();
        let pegs: Vec<Vec<_>> = (0..n_parts)
            .map(|part| (0..3).map(|k| pool[(part * (k + 1) + k) % 8]).chain([wave(0.7)]).collect())
            .collect();
        let holes = pegs.iter().map(|peg| peg.iter().copied().chain([wave(misfit)]).collect()).collect();
        let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
        for peg in &pegs {
            for cell in 0..grid.len() {
                let (row, edge_share) = view(peg, &grid.pose(cell));
                rows.extend(row.iter().map(|value| *value as f32));
                edge_shares.push(edge_share);
            }
        }
        let names = (0..n_parts).map(|part| format!("part {part}")).collect();
        let bank =
            Bank::from_rows(names, grid, Rows::new(N_POINTS * N_POINTS, rows).unwrap(), edge_shares, "synthetic");
        let bank = Arc::new(bank.unwrap());
        Self { bank, holes, noise }
    }

    /// A touch of a part's hole.
    pub fn touch(&self, part: usize, part_from_sensor: &Se2, rng: &mut ChaCha8Rng) -> Observation {
        let (mut row, edge_share) = view(&self.holes[part], part_from_sensor);
        // The sum of 12 uniform draws less 6 has variance 1 and is close to normal.
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        row.iter_mut().for_each(|value| *value += self.noise * normal());
        Observation::new(row.iter().map(|value| *value as f32).collect(), edge_share)
    }

    /// The default model but for the log-odds, fitted roughly: touches are from the nearest recorded view as far as here, a
    /// nat is so much as they differ in that, and what is half way to any view is of the world. Where the grid is too coarse
    /// for views between recorded ones, touches are made at recorded poses alone.
    pub fn model(&self) -> TouchModel {
        const N_TOUCHES: usize = 200;
        let (grid, mut rng) = (self.bank.grid(), ChaCha8Rng::seed_from_u64(77));
        let mut distances = || {
            let (part, cell) = (rng.random_range(0..self.holes.len()), rng.random_range(0..grid.len()));
            let mut pose = grid.pose(cell);
            if is_fine(grid) {
                let mut off = |step: f64| step * rng.random_range(-0.5..0.5);
                let [x, y] = [pose.x_mm, pose.y_mm].map(|mm| mm + off(grid.xy_step_mm));
                pose = Se2::from_degrees(x, y, pose.theta_deg() + off(grid.theta_step_deg));
            }
            let mut query = self.touch(part, &pose, &mut rng).query;
            normalize_rows(&mut query, N_POINTS * N_POINTS);
            let from = |row: usize| distance(f64::from(dot(&self.bank.row(row), &query)));
            [from(part * grid.len() + cell), from(rng.random_range(0..self.holes.len() * grid.len()))]
        };
        let all: Vec<[f64; 2]> = (0..N_TOUCHES).map(|_| distances()).collect();
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| all.iter().map(of).sum::<f64>() / N_TOUCHES as f64;
        let [own_distance, other] = [0, 1].map(|which: usize| mean(&|distances| distances[which]));
        let steepness = mean(&|distances| (distances[0] - own_distance).abs()).recip();
        let match_offset = steepness * 0.5 * (other - own_distance);
        TouchModel { match_offset, steepness, steepness_by_edge: 0.0, own_distance, ..TouchModel::default() }
    }

    /// The motions from a pose to every pose of the grid: what is recorded of the true hole.
    pub fn reach(&self, part_from_sensor: &Se2) -> Vec<Se2> {
        let grid = self.bank.grid();
        (0..grid.len()).map(|cell| part_from_sensor.inverse() * grid.pose(cell)).collect()
    }
}

/// Nearness to the contour on a window of 18 x 14 mm, mean removed, unit length; and the share near it.
fn view(waves: &[[f64; 4]], part_from_sensor: &Se2) -> (Vec<f64>, f32) {
    let mut values: Vec<f64> = (0..N_POINTS * N_POINTS)
        .map(|at| {
            let place =
                |index: usize, extent: f64| (index as f64 + 0.5 - N_POINTS as f64 / 2.0) * extent / N_POINTS as f64;
            let [x, y] = part_from_sensor.apply([place(at % N_POINTS, 18.0), place(at / N_POINTS, 14.0)]);
            let height: f64 = waves.iter().map(|[kx, ky, phase, a]| a * (kx * x + ky * y + phase).cos()).sum();
            (-(height / 0.4).powi(2)).exp()
        })
        .collect();
    let n = values.len() as f64;
    let edge_share = values.iter().filter(|value| **value > 0.5).count() as f64 / n;
    let mean = values.iter().sum::<f64>() / n;
    values.iter_mut().for_each(|value| *value -= mean);
    let norm = values.iter().map(|value| value * value).sum::<f64>().sqrt().max(1e-9);
    values.iter_mut().for_each(|value| *value /= norm);
    (values, edge_share as f32)
}

//! What a whole decision costs on one thread: the belief after a touch, and where to touch next.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a bench ends by a panic")]
// The macros' function has no documentation; a benchmark without its bank cannot go on.
#![allow(missing_docs)]

use std::sync::Arc;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::{Episode, EpisodeConfig, Observation};
use tactile_infer::Bank;
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::normalize_rows;

const N_PARTS: usize = 12;

/// Length of a row, as the shipped model has it.
const DIM: usize = 128;

/// Share of noise in a touch, whose row is of unit length.
const NOISE: f32 = 0.6;

/// The steps of the banks, mm and degrees: the paper's, and one fine enough to be interpolated.
const STEPS: [[f64; 2]; 2] = [[4.0, 30.0], [2.0, 15.0]];

fn decision(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("decision");
    for [xy_step_mm, theta_step_deg] in STEPS {
        let grid = PoseGrid { xy_step_mm, theta_step_deg, ..PoseGrid::SMALL };
        let bank = bank(grid);
        let touch = |pose: &Se2| {
            let row = grid.nearest(pose).expect("a pose of the grid");
            let noise = (0..DIM).map(|i| NOISE * (i as f32 * 1.7).sin() * (2.0 / DIM as f32).sqrt());
            Observation::new(bank.row(row).iter().zip(noise).map(|(value, noise)| value + noise).collect(), 0.2)
        };
        let (first, moved) = (Se2::IDENTITY, Se2::from_degrees(4.0, 0.0, 30.0));
        let (touches, second) = ([touch(&first), touch(&moved)], first * moved);
        let mut config = EpisodeConfig::default();
        (config.settings.stop_probability, config.settings.false_accept) = (1.0, None);
        let episode = Episode::begin(config, bank.clone(), &touches[0]).expect("a first touch");
        let reach: Vec<Se2> =
            (0..PoseGrid::SMALL.len()).map(|cell| second.inverse() * PoseGrid::SMALL.pose(cell)).collect();
        let name = BenchmarkId::from_parameter(format!("12 parts, {xy_step_mm} mm and {theta_step_deg} degrees"));
        group.bench_function(name, |bencher| {
            bencher.iter_batched(
                || episode.clone(),
                |mut episode| {
                    episode.observe(moved, &touches[1])?;
                    episode.decide(&reach)
                },
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

/// Rows that change smoothly with the pose, each part in its own way.
fn bank(grid: PoseGrid) -> Arc<Bank> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut rows = Vec::with_capacity(N_PARTS * grid.len() * DIM);
    for _ in 0..N_PARTS {
        // Along x and y, one period in 20 to 60 mm; over the angle, one in a turn or half a turn; and a phase.
        let mut wave = || [0.3, 0.3, 2.0, 6.0].map(|most| most * (2.0 * rng.random::<f64>() - 1.0));
        let waves: Vec<[f64; 4]> = (0..DIM).map(|_| wave()).collect();
        for cell in 0..grid.len() {
            let Se2 { x_mm, y_mm, theta_rad } = grid.pose(cell);
            let value = |[kx, ky, kt, phase]: &[f64; 4]| (kx * x_mm + ky * y_mm + kt * theta_rad + phase).cos() as f32;
            rows.extend(waves.iter().map(value));
        }
    }
    normalize_rows(&mut rows, DIM);
    let names = (0..N_PARTS).map(|part| part.to_string()).collect();
    let (rows, shares) = (Rows::new(DIM, rows).expect("rows of one length"), vec![0.2; N_PARTS * grid.len()]);
    Arc::new(Bank::from_rows(names, grid, rows, shares, "").expect("a whole bank"))
}

criterion_group!(benches, decision);
criterion_main!(benches);

//! What an embedding and a start cost with the shipped model: one image, a batch on all cores, loading model and bank.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a bench ends by a panic")]
// The macros' function has no documentation; a benchmark without its files cannot go on.
#![allow(missing_docs)]

use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use tactile_data::frame::TactileImage;
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::normalize_rows;
use tactile_infer::{Bank, Model};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/maze-small.safetensors");

/// Images of the batch.
const BATCH: usize = 64;

/// Parts of the bank, each on a grid of 2 mm and 15 degrees.
const N_PARTS: usize = 12;

fn embedding(criterion: &mut Criterion) {
    let model = Model::load(Path::new(MODEL)).expect("the shipped model");
    let size_px = model.config().input_px;
    let planes = (0..3 * size_px[0] * size_px[1]).map(|i| (i as f32 * 0.7).sin()).collect();
    let images = vec![TactileImage { size_px, planes, edge_share: 0.5 }; BATCH];
    let mut group = criterion.benchmark_group("embedding");
    group.throughput(Throughput::Elements(1));
    group.bench_function("one image, one thread", |bencher| bencher.iter(|| model.embed_holes(&images[..1])));
    group.throughput(Throughput::Elements(BATCH as u64));
    group.bench_function("64 images, one thread", |bencher| bencher.iter(|| model.embed_holes(&images)));
    // The library uses the threads of the pool that it is called in.
    let pool = rayon::ThreadPoolBuilder::new().build().expect("a pool of threads");
    group.bench_function("64 images, all cores", |bencher| {
        bencher.iter(|| pool.install(|| model.embed_holes(&images)));
    });
    group.finish();
}

fn start(criterion: &mut Criterion) {
    let model = Model::load(Path::new(MODEL)).expect("the shipped model");
    let bank = std::env::temp_dir().join(format!("tactile-infer-{}.bank", std::process::id()));
    made_up_bank(&model).save(&bank).expect("room for the bank");
    let mut group = criterion.benchmark_group("load");
    group.bench_function("model", |bencher| bencher.iter(|| Model::load(Path::new(MODEL))));
    group.bench_function("bank of 12 parts, 2 mm and 15 degrees", |bencher| bencher.iter(|| Bank::load(&bank, &model)));
    group.finish();
    std::fs::remove_file(&bank).expect("the bank is there");
}

/// A bank of the model with rows that vary from pose to pose.
fn made_up_bank(model: &Model) -> Bank {
    let grid = PoseGrid { xy_step_mm: 2.0, theta_step_deg: 15.0, ..PoseGrid::SMALL };
    let n_rows = N_PARTS * grid.len();
    let mut rows: Vec<f32> = (0..n_rows * model.dim()).map(|i| (i as f32 * 0.618).sin()).collect();
    normalize_rows(&mut rows, model.dim());
    let rows = Rows::new(model.dim(), rows).expect("rows of one length");
    let names = (0..N_PARTS).map(|part| part.to_string()).collect();
    Bank::from_rows(names, grid, rows, vec![0.2; n_rows], model.sha256().clone()).expect("a whole bank")
}

criterion_group!(benches, embedding, start);
criterion_main!(benches);

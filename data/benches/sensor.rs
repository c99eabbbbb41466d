//! What one frame of each tier of the simulated sensor costs on one core, at a Mini's full size.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a bench ends by a panic")]
// The macros' function has no documentation.
#![allow(missing_docs)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use tactile_data::dataset::generate::{Places, plan};
use tactile_data::scene::{Parts, Scene};
use tactile_data::sensor::Fidelity;
use tactile_data::sensor::simulator::{Simulator, frame_rng};

/// Boards touched: some with walls, some with islands, and few enough to prepare at once.
const N_BOARDS: usize = 4;

fn tiers(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sensor");
    group.throughput(Throughput::Elements(1));
    for &fidelity in Fidelity::ALL {
        let mut scene = Scene::preset("maze").expect("a preset");
        scene.fidelity = fidelity;
        scene.sensor.frame_px = [320, 240];
        if let Parts::Maze(boards) = &mut scene.parts {
            (boards.n_boards, boards.n_held_out, boards.n_pairs) = (N_BOARDS, 1, 128);
        }
        let touches = plan(&scene, &[], Places::EachPose, 1).expect("touches of the boards");
        let simulator = Simulator::new(scene, 1).expect("a scene that can be touched");
        let render = |i: usize| {
            let touch = &touches[i % touches.len()];
            simulator.touch(touch.part, touch.side, &touch.part_from_sensor, &mut frame_rng(1, i as u64))
        };
        // The boards are solved before the clock starts.
        (0..touches.len()).try_for_each(|i| render(i).map(|_| ())).expect("every touch renders");
        let mut i = 0;
        group.bench_function(BenchmarkId::from_parameter(fidelity.name()), |bencher| {
            bencher.iter(|| {
                i += 1;
                render(i)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, tiers);
criterion_main!(benches);

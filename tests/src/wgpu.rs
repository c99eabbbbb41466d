//! The graphics card against the CPU: the same embeddings, the same training. `cargo xtask wgpu` runs these; they
//! need a driver, Mesa's llvmpipe for one.

use std::path::Path;

use tactile_data::dataset::generate::{Places, Sampling, generate};
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::{Parts, Scene};
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::{DeviceKind, Model};
use tactile_tests::programs::workspace;
use tactile_train::config::TrainConfig;
use tactile_train::output_folder::OutputFolder;
use tactile_train::run::{Run, train};

/// Twelve touches of letters, as the shipped model sees them: more than one kernel's tile, less than its batch.
fn touches(model: &Model) -> Vec<TactileImage> {
    let simulator = Simulator::new(Scene::load("alphabet-small").unwrap(), 1).unwrap();
    let background = model.background(&simulator.no_contact(7)).unwrap();
    let touch = |i: usize| {
        let part_from_sensor = Se2 { x_mm: i as f64 - 6.0, y_mm: 0.5 * i as f64, theta_rad: 0.3 * i as f64 };
        let frame = simulator.touch(i, Side::Hole, &part_from_sensor, &mut frame_rng(7, i as u64)).unwrap();
        background.tactile_image(&frame).unwrap()
    };
    (0..12).map(touch).collect()
}

#[test]
fn the_shipped_model_embeds_alike_on_cpu_and_card() {
    let path = workspace().join("infer/models/maze-small.safetensors");
    let [cpu, card] = [DeviceKind::Flex, DeviceKind::Wgpu].map(|device| Model::load_on(&path, device).unwrap());
    let images = touches(&cpu);
    for (side, a, b) in [
        ("holes", cpu.embed_holes(&images).unwrap(), card.embed_holes(&images).unwrap()),
        ("pegs", cpu.embed_pegs(&images).unwrap(), card.embed_pegs(&images).unwrap()),
    ] {
        let largest = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("embeddings of {side}: largest difference {largest:.1e} of a row of length 1");
        // f32 sums of up to 2,560 products in another order, through ten layers.
        assert!(a.len() == 12 * cpu.dim() && largest < 1e-5, "{side}: {largest}");
    }
}

/// A network whose layers all go through our products of fours, and one of which some go through burn's.
const NETWORKS: [NetworkConfig; 2] = [
    NetworkConfig { input_px: [24, 18], width: 8, hidden: 32, dim: 16 },
    NetworkConfig { input_px: [25, 17], width: 3, hidden: 30, dim: 10 },
];

fn config(network: NetworkConfig, n_steps: usize) -> TrainConfig {
    TrainConfig { network, n_steps, n_pairs: 16, n_warmup: 1, field_counts: 3.0, ..TrainConfig::tiny() }
}

/// Losses and gradients' lengths of a run's steps, from a folder on.
fn steps(dataset: &Dataset, folder: &Path, config: &TrainConfig, device: DeviceKind, resume: bool) -> Vec<[f64; 2]> {
    let out = OutputFolder::claim(folder, &[]).unwrap();
    let run = Run { dataset, tuning: None, out: &out, config, device, resume, from: None };
    train(&run, &|| false, &mut |_| ()).unwrap();
    let curve = std::fs::read_to_string(folder.join("curve.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [1, 4].map(|column| cells[column].parse().unwrap())
    };
    curve.lines().skip(1).map(row).collect()
}

fn dataset(folder: &Path) -> Dataset {
    let maze = folder.join("maze");
    let mut scene = Scene::load("maze").unwrap();
    let Parts::Maze(boards) = &mut scene.parts else { panic!("the maze preset has boards") };
    (boards.n_boards, boards.n_held_out, boards.n_pairs) = (3, 1, 48);
    scene.sensor.frame_px = [52, 36];
    let sampling = Sampling { sides: &[], places: Places::EachPose, seed: 1, lab: None };
    generate(&scene, &sampling, &maze, &|_, _| {}).unwrap();
    Dataset::open(&maze).unwrap()
}

#[test]
fn training_begins_alike_on_cpu_and_card() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for (i, network) in NETWORKS.into_iter().enumerate() {
        let config = config(network, 5);
        let [cpu, card] = [DeviceKind::Flex, DeviceKind::Wgpu]
            .map(|device| steps(&dataset, &folder.path().join(format!("{device}-{i}")), &config, device, false));
        assert_eq!((cpu.len(), card.len()), (5, 5));
        for (step, (a, b)) in cpu.iter().zip(&card).enumerate() {
            println!("step {}: loss and gradient {a:.6?} on the CPU, {b:.6?} on the card", step + 1);
            // The card's pictures are rounded to 1 / 1,024 of a deviation, which normalisation over eight pairs enlarges; LAMB divides
            // gradients by their own size, so that each step may enlarge a difference. The kernels alone agree to 1e-4
            // (infer/src/embedding/network.rs).
            let bounds = if step == 0 { [1e-3, 5e-3] } else { [1e-2, 1e-1] };
            assert!((0..2).all(|i| (a[i] - b[i]).abs() < bounds[i] * a[i]), "step {}: {a:?} {b:?}", step + 1);
        }
    }
}

#[test]
fn a_run_goes_on_on_the_other_device() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let whole = steps(&dataset, &folder.path().join("whole"), &config(NETWORKS[0], 6), DeviceKind::Flex, false);
    for [first, then] in [[DeviceKind::Flex, DeviceKind::Wgpu], [DeviceKind::Wgpu, DeviceKind::Flex]] {
        // Stopped after three of six steps.
        let out = folder.path().join(format!("{first}-{then}"));
        let claimed = OutputFolder::claim(&out, &[]).unwrap();
        let config = config(NETWORKS[0], 6);
        let run = Run {
            dataset: &dataset,
            tuning: None,
            out: &claimed,
            config: &config,
            device: first,
            resume: false,
            from: None,
        };
        let asked = std::cell::Cell::new(0);
        let stops = || asked.replace(asked.get() + 1) == 3;
        train(&run, &stops, &mut |_| ()).unwrap();
        drop(claimed);
        let rows = steps(&dataset, &out, &config, then, true);
        assert_eq!(rows.len(), 6);
        for (a, b) in whole.iter().zip(&rows) {
            assert!((a[0] - b[0]).abs() < 1e-2 * a[0], "{first} then {then}: {whole:?} {rows:?}");
        }
    }
}

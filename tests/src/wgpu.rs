//! The graphics card against the CPU: the same embeddings, the same training. `cargo xtask wgpu` runs these; they
//! need a driver, Mesa's llvmpipe for one.

use std::path::Path;

use tactile_data::frame::TactileImage;
use tactile_data::generate::{Places, Sampling, generate};
use tactile_data::scene::{Parts, Scene};
use tactile_data::se2::Se2;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::store::Dataset;
use tactile_data::touch::Side;
use tactile_infer::architecture::NetworkConfig;
use tactile_infer::{DeviceKind, Model};
use tactile_tests::programs::workspace;
use tactile_train::config::TrainConfig;
use tactile_train::output_folder::OutputFolder;
use tactile_train::run::{Event, Run, train};

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

/// The first losses of a tiny network.
fn losses(dataset: &Dataset, out: &Path, device: DeviceKind) -> Vec<f64> {
    let network = NetworkConfig { input_px: [24, 18], width: 8, hidden: 32, dim: 16 };
    let config = TrainConfig { network, n_steps: 5, n_pairs: 16, n_warmup: 1, ..TrainConfig::tiny() };
    let mut losses = Vec::new();
    let mut note = |event: Event<'_>| {
        if let Event::Step { loss, .. } = event {
            losses.push(loss);
        }
    };
    let out = OutputFolder::claim(&out.join(device.to_string()), &[]).unwrap();
    let run = Run { dataset, tuning: None, out: &out, config: &config, device, resume: false, from: None };
    train(&run, &|| false, &mut note).unwrap();
    losses
}

#[test]
fn training_begins_alike_on_cpu_and_card() {
    let folder = tempfile::tempdir().unwrap();
    let maze = folder.path().join("maze");
    let mut scene = Scene::load("maze").unwrap();
    let Parts::Maze(boards) = &mut scene.parts else { panic!("the maze preset has boards") };
    (boards.n_boards, boards.n_held_out, boards.n_pairs) = (3, 1, 48);
    scene.sensor.frame_px = [48, 36];
    let sampling = Sampling { sides: &[], places: Places::EachPose, seed: 1, lab: None };
    generate(&scene, &sampling, &maze, &|_, _| {}).unwrap();
    let dataset = Dataset::open(&maze).unwrap();
    let [cpu, card] = [DeviceKind::Flex, DeviceKind::Wgpu].map(|device| losses(&dataset, folder.path(), device));
    assert_eq!((cpu.len(), card.len()), (5, 5));
    for (step, (a, b)) in cpu.iter().zip(&card).enumerate() {
        println!("step {}: loss {a:.6} on the CPU, {b:.6} on the card", step + 1);
        // The first step differs by the order of sums alone; AdamW divides gradients by their own size, so that each
        // step may enlarge a difference.
        let bound = if step == 0 { 1e-5 } else { 1e-3 };
        assert!((a - b).abs() < bound * a, "step {}: {a} {b}", step + 1);
    }
}

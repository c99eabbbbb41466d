//! Training with extreme settings and data: it finishes or stops with a reason, and no file ever holds a NaN.

use std::fs;
use std::path::Path;

use tactile_data::dataset::store::{Dataset, DatasetWriter, Meta};
use tactile_data::dataset::touch::{Side, Touch};
use tactile_data::frame::Frame;
use tactile_data::pose::se2::Se2;
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::{Checkpoint, DeviceKind};
use tactile_tests::samples::Sample;
use tactile_train::config::{Flips, Optimizer, TrainConfig};
use tactile_train::output_folder::OutputFolder;
use tactile_train::pairs::Pairs;
use tactile_train::run::{Event, Outcome, Run, train};
use tactile_train::{Error, Result};

const SMALL: NetworkConfig = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };

fn twelve_steps() -> TrainConfig {
    TrainConfig { network: SMALL, n_steps: 12, n_pairs: 8, n_warmup: 2, save_every: 1, ..TrainConfig::tiny() }
}

/// Trains, and asserts that each reported loss is finite and that all weights on disk are.
fn train_soundly(dataset: &Dataset, out: &Path, config: &TrainConfig) -> Result<Outcome> {
    let claimed = OutputFolder::claim(out, &[]).unwrap();
    let run = Run { dataset, tuning: None, out: &claimed, config, device: DeviceKind::Flex, resume: false, from: None };
    let mut losses = Vec::new();
    let outcome = train(&run, &|| false, &mut |event| {
        if let Event::Step { loss, .. } = event {
            losses.push(loss);
        }
    });
    assert!(losses.iter().all(|loss| loss.is_finite()), "{losses:?}");
    let model = out.join("model.safetensors");
    if model.exists() {
        let (checkpoint, _) = Checkpoint::load(&model).unwrap();
        assert!(checkpoint.tensors.iter().flat_map(|tensor| &tensor.values).all(|value| value.is_finite()));
    }
    outcome
}

fn maze() -> (std::sync::Arc<Sample>, Dataset) {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    (sample, dataset)
}

/// Twelve pairs of a board, 32 x 24 px: `rgb` of each frame by pair and side, and where it was taken.
fn pairs(folder: &Path, rgb: impl Fn(usize, Side) -> Vec<u8>, place: impl Fn(usize) -> Option<Se2>) -> Dataset {
    let meta = Meta::new("pairs", "a test", [32, 24], [0.6, 0.6]);
    let frame = |rgb| Frame::new(32, 24, rgb).unwrap();
    let out = folder.join("pairs");
    let mut writer = DatasetWriter::create(&out, meta, &frame(at_rest())).unwrap();
    for pair in 0..12 {
        for side in [Side::Hole, Side::Peg] {
            let part_from_sensor = place(pair);
            let touch = Touch { part: Some("board".into()), side: Some(side), part_from_sensor, ..Touch::default() };
            writer.push(&frame(rgb(pair, side)), &touch).unwrap();
        }
    }
    writer.finish().unwrap();
    Dataset::open(&out).unwrap()
}

/// A lit sensor with nothing on it.
fn at_rest() -> Vec<u8> {
    (0..32 * 24).flat_map(|i| [100 + (i % 32) as u8, 120, 90]).collect()
}

/// A sensor with an edge across it at a column.
fn edge(column: usize) -> Vec<u8> {
    let mut rgb = at_rest();
    for row in 0..24 {
        for channel in 0..3 {
            rgb[3 * (32 * row + column) + channel] += 60;
        }
    }
    rgb
}

#[test]
fn temperatures_from_a_hundredth_to_ten_train() {
    let (_sample, dataset) = maze();
    for temperature in [0.01, 0.1, 1.0, 10.0] {
        let folder = tempfile::tempdir().unwrap();
        let config = TrainConfig { temperature, ..twelve_steps() };
        assert!(train_soundly(&dataset, folder.path(), &config).unwrap().finished);
    }
}

#[test]
fn a_learning_rate_far_too_high_is_stopped() {
    let (_sample, dataset) = maze();
    // AdamW limits each step, so that it takes a higher rate to diverge.
    for (optimizer, factor) in [(Optimizer::Lamb, 100.0), (Optimizer::Adamw, 1_000.0)] {
        let folder = tempfile::tempdir().unwrap();
        let learning_rate = factor * optimizer.learning_rate();
        let config = TrainConfig { learning_rate, optimizer, n_steps: 400, save_every: 50, ..twelve_steps() };
        let error = train_soundly(&dataset, folder.path(), &config).unwrap_err();
        assert!(matches!(error, Error::Diverged { .. }), "{optimizer:?}: {error}");
    }
}

#[test]
fn two_pairs_are_a_batch() {
    let (_sample, dataset) = maze();
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig { n_pairs: 2, n_micro_batches: 1, ..twelve_steps() };
    assert!(train_soundly(&dataset, folder.path(), &config).unwrap().finished);
}

#[test]
fn a_run_whose_weights_overflow_stops_and_keeps_the_checkpoint_before() {
    let (_sample, dataset) = maze();
    let folder = tempfile::tempdir().unwrap();
    // Each step multiplies the weights by up to thirty: f32 overflows after about fifteen.
    let (optimizer, learning_rate) = (Optimizer::Adamw, 0.03);
    let config =
        TrainConfig { optimizer, learning_rate, weight_decay: 1e3, n_warmup: 10, n_steps: 60, ..twelve_steps() };
    let error = train_soundly(&dataset, folder.path(), &config).unwrap_err();
    let Error::Diverged { step, kept: Some(kept), .. } = error else { panic!("{error}") };
    assert!(kept < step);
    println!("{error}");
    let message = error.to_string();
    assert!(message.starts_with(&format!("stopped at step {step}: ")) && !message.contains('\n'), "{message}");
    assert!(message.contains(&format!("model.safetensors of step {kept} is kept")), "{message}");
    assert!(message.contains("learning_rate"), "{message}");
    let (checkpoint, _) = Checkpoint::load(&folder.path().join("model.safetensors")).unwrap();
    assert_eq!(checkpoint.provenance.steps, kept);
    let page = fs::read_to_string(folder.path().join("curve.html")).unwrap();
    let (words, drawn) = page.split_once("class=\"charts\"").unwrap();
    assert!(words.contains("stopped at step") && !drawn.contains("NaN") && !drawn.contains("inf"), "{page}");
}

#[test]
fn pairs_that_are_all_the_same_train_without_nan() {
    let folder = tempfile::tempdir().unwrap();
    // Their poses are unknown, so it cannot be seen beforehand that they are all one.
    let dataset = pairs(folder.path(), |_, _| edge(10), |_| None);
    assert!(train_soundly(&dataset, &folder.path().join("model"), &twelve_steps()).unwrap().finished);
}

#[test]
fn pairs_of_one_place_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = pairs(folder.path(), |_, _| edge(10), |_| Some(Se2::from_degrees(1.0, 2.0, 30.0)));
    let error = train_soundly(&dataset, &folder.path().join("model"), &twelve_steps()).unwrap_err().to_string();
    assert!(error.contains("pairs of different places") && error.contains("pairs within 1 mm"), "{error}");
    assert!(!folder.path().join("model").exists());
}

#[test]
fn pairs_that_are_all_blank_are_named() {
    let folder = tempfile::tempdir().unwrap();
    // Noise of a few counts, and no edge.
    let rgb = |pair: usize, side: Side| {
        let phase = pair * 7 + usize::from(side == Side::Peg) * 3;
        at_rest().iter().enumerate().map(|(i, value)| value + (i * 31 + phase * 17) as u8 % 5).collect()
    };
    let dataset = pairs(folder.path(), rgb, |pair| Some(Se2::from_degrees(3.0 * pair as f64, 0.0, 0.0)));
    let error = train_soundly(&dataset, &folder.path().join("model"), &twelve_steps()).unwrap_err().to_string();
    assert!(error.contains("12 blank pairs"), "{error}");
}

#[test]
fn a_batch_of_only_blank_pairs_trains_without_nan() {
    let folder = tempfile::tempdir().unwrap();
    // Two pairs show an edge, so most batches of two have none.
    let rgb = |pair: usize, _| if pair < 2 { edge(10 + pair) } else { at_rest() };
    let dataset = pairs(folder.path(), rgb, |pair| Some(Se2::from_degrees(3.0 * pair as f64, 0.0, 0.0)));
    let config = TrainConfig { n_pairs: 2, n_micro_batches: 1, n_steps: 30, near_share: 0.0, ..twelve_steps() };
    assert!(train_soundly(&dataset, &folder.path().join("model"), &config).unwrap().finished);
    // Kept out of the batch, they leave two pairs.
    let none = TrainConfig { max_blank: 0.0, ..config.clone() };
    assert!(train_soundly(&dataset, &folder.path().join("none"), &none).unwrap().finished);
    let four = TrainConfig { n_pairs: 4, n_micro_batches: 2, ..none };
    let error = train_soundly(&dataset, &folder.path().join("four"), &four).unwrap_err().to_string();
    assert!(error.contains("at least 4 pairs in a batch") && error.contains("10 of them blank"), "{error}");
}

#[test]
fn frames_that_show_no_lamps_cannot_be_relit() {
    let folder = tempfile::tempdir().unwrap();
    // Grey edges: every channel changes equally, as under one lamp from above.
    let dataset =
        pairs(folder.path(), |pair, _| edge(4 + pair), |pair| Some(Se2::from_degrees(3.0 * pair as f64, 0.0, 0.0)));
    let config = TrainConfig { flips: Flips::Relit, ..twelve_steps() };
    let error = train_soundly(&dataset, &folder.path().join("model"), &config).unwrap_err().to_string();
    assert!(error.contains("flips relit") && error.contains("--set flips=plain"), "{error}");
    let config = TrainConfig { flips: Flips::Auto, ..config };
    let warning = Pairs::new(&dataset, &config).unwrap().warning.unwrap();
    assert!(warning.starts_with("mirrored pictures are not relit"), "{warning}");
    assert!(train_soundly(&dataset, &folder.path().join("plain"), &config).unwrap().finished);
}

//! Frames of real sensors: read, played, and never mistaken for a letter.
//!
//! The recordings are not part of this project. The tests look for them where `TACTILE_REAL_GELSIGHT`
//! says, and say that they are skipped where there are none.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use image::AnimationDecoder;
use image::codecs::gif::GifDecoder;
use serde_json::Value;
use tactile_tests::programs::{run, workspace};
use tactile_tests::samples::{FRAME_PX, text};
use tempfile::TempDir;

/// A file or folder of the recordings; `None`, with a line that says so, where it is missing.
fn recording(name: &str) -> Option<PathBuf> {
    let root =
        env::var_os("TACTILE_REAL_GELSIGHT").map_or_else(|| workspace().join("../shared/real-gelsight"), PathBuf::from);
    present(root.join(name))
}

/// The shipped checkpoint; `None`, with a line that says so, where it is missing.
fn shipped_model() -> Option<PathBuf> {
    present(workspace().join("infer/models/maze-small.safetensors"))
}

fn present(path: PathBuf) -> Option<PathBuf> {
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

/// The bank of the small letters by the shipped model, shared by the tests that run at the same time.
fn bank(model: &Path) -> Arc<TempDir> {
    static SHARED: Mutex<Weak<TempDir>> = Mutex::new(Weak::new());
    let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    shared.upgrade().unwrap_or_else(|| {
        let folder = Arc::new(tempfile::tempdir().unwrap());
        let pegs = ["generate", "--scene", "alphabet-small", "--sides", "peg", "--frame-px", FRAME_PX, "--out", "pegs"];
        run("tactile-data", folder.path(), &pegs).done();
        let model = text(model.to_path_buf());
        run("tactile-infer", folder.path(), &["bank", "--model", &model, "--data", "pegs", "--out", "letters.bank"])
            .done();
        *shared = Arc::downgrade(&folder);
        folder
    })
}

/// Imports a recording and plays it against the letters; asserts that no episode passes for a letter.
/// The number of episodes.
fn play(source: &Path, import: &[&str]) -> Option<usize> {
    let model = shipped_model()?;
    let bank = bank(&model);
    let folder = tempfile::tempdir().unwrap();
    let source = text(source.to_path_buf());
    run("tactile-data", folder.path(), &[&["import", &source, "--out", "recorded"], import].concat()).done();
    let (model, bank) = (text(model), text(bank.path().join("letters.bank")));
    let args = ["replay", "--model", &model, "--bank", &bank, "--data", "recorded", "--json"];
    let replayed = run("tactile-filter", folder.path(), &args);
    let episodes: Vec<Value> = replayed.done().lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    for episode in &episodes {
        assert_eq!(episode["confident"], false, "{episode}");
    }
    Some(episodes.len())
}

/// For each frame of an animation, its mean absolute difference from the first, counts.
fn differences(gif: &Path) -> Vec<f64> {
    let file = std::io::BufReader::new(fs::File::open(gif).unwrap());
    let frames = GifDecoder::new(file).unwrap().into_frames().collect_frames().unwrap();
    let first = frames[0].buffer().as_raw().clone();
    let difference = |frame: &image::Frame| {
        let sum: u64 = frame.buffer().as_raw().iter().zip(&first).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        sum as f64 / first.len() as f64
    };
    frames.iter().map(difference).collect()
}

const DIGIT: &str = "gsmini-digits-tactilemnist/tactile-mnist-touch-real-seq-t256-320x240.gif";

#[test]
fn one_press_on_a_digit_is_one_run_of_contact() {
    let Some(gif) = recording(DIGIT) else { return };
    let folder = tempfile::tempdir().unwrap();
    run("tactile-data", folder.path(), &["import", &text(gif.clone()), "--out", "digit"]).done();
    let inspected = run("tactile-data", folder.path(), &["inspect", "digit", "--json"]);
    let summary: Value = serde_json::from_str(inspected.done()).unwrap();
    let runs = summary["contact_frames"].as_array().unwrap();
    let [first, last] = [0, 1].map(|end| runs[0][end].as_u64().unwrap() as usize);
    assert_eq!(runs.len(), 1, "{runs:?}");
    let differences = differences(&gif);
    assert_eq!(differences.len(), 56);
    let strongest = (0..56).max_by(|a, b| differences[*a].total_cmp(&differences[*b])).unwrap();
    assert!(first <= strongest && strongest <= last, "{strongest} is not in {first}..={last}");
    // A press changes more than the picture changes by itself.
    let weakest_within = differences[first..=last].iter().copied().fold(f64::INFINITY, f64::min);
    let strongest_before = differences[..first].iter().copied().fold(0.0, f64::max);
    assert!(weakest_within > strongest_before, "{weakest_within} within, {strongest_before} before: {differences:.1?}");
}

#[test]
fn a_digit_is_no_confident_letter() {
    let Some(gif) = recording(DIGIT) else { return };
    assert!(play(&gif, &[]).is_none_or(|n_episodes| n_episodes == 1));
}

#[test]
fn a_cuboid_is_no_confident_letter() {
    let (Some(press), Some(rest)) = (
        recording("gsmini-markergel-feats/cuboid_10-2-284.png"),
        recording("gsmini-markergel-feats/nocontact_train_sensor_derived.png"),
    ) else {
        return;
    };
    // 320 x 240 pixels at 14 a mm.
    let import = ["--no-contact", &text(rest), "--field-of-view-mm", "22.86", "17.14"];
    assert!(play(&press, &import).is_none_or(|n_episodes| n_episodes == 1));
}

#[test]
fn presses_of_a_ball_are_no_confident_letters() {
    let (Some(presses), Some(rest)) =
        (recording("gelsight-ball-fots/images"), recording("gelsight-ball-fots/gelsight_bg.png"))
    else {
        return;
    };
    // 240 x 320 pixels at 19.58 a mm.
    let import = ["--no-contact", &text(rest), "--field-of-view-mm", "12.26", "16.34"];
    assert!(play(&presses, &import).is_none_or(|n_episodes| n_episodes >= 1));
}

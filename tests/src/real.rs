//! Frames of real sensors: read, played, and never mistaken for a letter.
//!
//! The recordings are not part of this project. The tests look for them where `TACTILE_REAL_GELSIGHT` says; a test
//! whose recordings are missing counts as ignored.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use image::AnimationDecoder;
use image::codecs::gif::GifDecoder;
use libtest_mimic::{Arguments, Trial};
use serde_json::Value;
use tactile_tests::programs::{run, workspace};
use tactile_tests::samples::{FRAME_PX, text};
use tempfile::TempDir;

/// One press on a printed digit.
const DIGIT: &str = "gsmini-digits-tactilemnist/tactile-mnist-touch-real-seq-t256-320x240.gif";

/// A press of a cuboid's flat face, and the sensor at rest.
const CUBOID: [&str; 2] =
    ["gsmini-markergel-feats/cuboid_10-2-284.png", "gsmini-markergel-feats/nocontact_train_sensor_derived.png"];

/// Presses of a ball, and the sensor at rest.
const BALL: [&str; 2] = ["gelsight-ball-fots/images", "gelsight-ball-fots/gelsight_bg.png"];

fn main() -> ExitCode {
    let tests = vec![
        test("one_press_on_a_digit_is_one_run_of_contact", &[DIGIT], one_press_on_a_digit_is_one_run_of_contact),
        test("a_digit_is_no_confident_letter", &[DIGIT], a_digit_is_no_confident_letter),
        test("a_cuboid_is_no_confident_letter", &CUBOID, a_cuboid_is_no_confident_letter),
        test("presses_of_a_ball_are_no_confident_letters", &BALL, presses_of_a_ball_are_no_confident_letters),
    ];
    let conclusion = libtest_mimic::run(&Arguments::from_args(), tests);
    // A static value is never dropped, and the folder must not stay behind.
    drop(LETTERS.lock().unwrap_or_else(PoisonError::into_inner).take());
    conclusion.exit_code()
}

/// A test that is ignored where one of the recordings it needs is missing.
fn test(name: &'static str, needs: &[&str], claim: fn()) -> Trial {
    let is_missing = needs.iter().any(|needed| !recording(needed).exists());
    let run = move || {
        claim();
        Ok(())
    };
    Trial::test(name, run).with_ignored_flag(is_missing)
}

/// The file or folder of a recording.
fn recording(name: &str) -> PathBuf {
    let root =
        env::var_os("TACTILE_REAL_GELSIGHT").map_or_else(|| workspace().join("../shared/real-gelsight"), PathBuf::from);
    root.join(name)
}

/// The shipped checkpoint.
fn shipped_model() -> String {
    text(workspace().join("infer/models/maze-small.safetensors"))
}

/// Folder of the bank that the tests share.
static LETTERS: Mutex<Option<TempDir>> = Mutex::new(None);

/// The bank of the small letters by the shipped model, made by the test that needs it first.
fn bank() -> PathBuf {
    let mut shared = LETTERS.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = shared.get_or_insert_with(|| {
        let folder = tempfile::tempdir().unwrap();
        let pegs = ["generate", "--scene", "alphabet-small", "--sides", "peg", "--frame-px", FRAME_PX, "--out", "pegs"];
        run("tactile-data", folder.path(), &pegs).done();
        let bank = ["bank", "--model", &shipped_model(), "--data", "pegs", "--out", "letters.bank"];
        run("tactile-infer", folder.path(), &bank).done();
        folder
    });
    folder.path().join("letters.bank")
}

/// Imports a recording and plays it against the letters; asserts that no episode passes for a letter.
/// The number of episodes.
fn play(source: &str, import: &[&str]) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let source = text(recording(source));
    run("tactile-data", folder.path(), &[&["import", &source, "--out", "recorded"], import].concat()).done();
    let args = ["replay", "--model", &shipped_model(), "--bank", &text(bank()), "--data", "recorded", "--json"];
    let replayed = run("tactile-filter", folder.path(), &args);
    let episodes: Vec<Value> = replayed.done().lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    for episode in &episodes {
        assert_eq!(episode["confident"], false, "{episode}");
    }
    episodes.len()
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

fn one_press_on_a_digit_is_one_run_of_contact() {
    let gif = recording(DIGIT);
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

fn a_digit_is_no_confident_letter() {
    assert_eq!(play(DIGIT, &[]), 1);
}

fn a_cuboid_is_no_confident_letter() {
    let [press, rest] = CUBOID;
    // 320 x 240 pixels at 14 a mm.
    let import = ["--no-contact", &text(recording(rest)), "--field-of-view-mm", "22.86", "17.14"];
    assert_eq!(play(press, &import), 1);
}

fn presses_of_a_ball_are_no_confident_letters() {
    let [presses, rest] = BALL;
    // 240 x 320 pixels at 19.58 a mm.
    let import = ["--no-contact", &text(recording(rest)), "--field-of-view-mm", "12.26", "16.34"];
    assert!(play(presses, &import) >= 1);
}

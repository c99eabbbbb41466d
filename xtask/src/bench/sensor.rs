//! What each tier of the simulated sensor costs, and what training on it gives.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::Workspace;

/// The tiers, each with those before it.
const TIERS: [&str; 5] = ["geometry", "gel", "optics", "camera", "shadow"];

/// Parts for tuning, at the full tier: what each tier's model is tested on.
const TEST_SCENE: &str = "alphabet-small-dev";

/// What to measure.
#[derive(Args)]
pub struct SensorArgs {
    /// How long each tier is rendered in memory, seconds.
    #[arg(long, default_value_t = 5.0)]
    seconds: f64,
    /// Pairs written to disk at 320x240 to time that too, two images each.
    #[arg(long, default_value_t = 1000)]
    pairs: usize,
    /// Also train on each tier for this many steps and test on letters at the full tier; nought: do not.
    #[arg(long, default_value_t = 0)]
    train_steps: usize,
    /// Seed of boards, touches and training.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Prints a table: images a second of each tier in memory, and the accuracy of what is trained on it.
pub fn sensor(workspace: &Workspace, args: &SensorArgs) -> Result<()> {
    let folder = workspace.target.join(format!("bench-sensor-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    let done = measure(workspace, args, &folder);
    std::fs::remove_dir_all(&folder).map_err(Error::io(&folder))?;
    done
}

fn measure(workspace: &Workspace, args: &SensorArgs, folder: &Path) -> Result<()> {
    let seconds = args.seconds.to_string();
    let speed = ["speed", "--scene", "maze", "--frame-px", "320x240", "--seconds", &seconds, "--json"];
    let speeds = json(workspace, "tactile-data", &speed, folder)?;
    let accuracies = if args.train_steps > 0 { train(workspace, args, folder)? } else { Vec::new() };
    println!("tier        images/s   ms an image and core   accuracy of one touch, {TEST_SCENE} at the full tier");
    for (i, tier) in TIERS.iter().enumerate() {
        let number = |field: &str| speeds[i][field].as_f64().unwrap_or(f64::NAN);
        let accuracy = accuracies.get(i).map_or("not trained".into(), |share| format!("{:.1} %", 100.0 * share));
        println!("{tier:10} {:9.0} {:22.3}   {accuracy}", number("images_per_s"), number("ms_per_image"));
    }
    to_disk(workspace, args, folder)
}

/// Times one `tactile-data generate`, with its start, the boards and the writing to disk.
fn to_disk(workspace: &Workspace, args: &SensorArgs, folder: &Path) -> Result<()> {
    // The `maze` preset has as many pairs on a board.
    let (pairs, boards, seed) = (args.pairs.to_string(), args.pairs.div_ceil(150).to_string(), args.seed.to_string());
    let words = ["generate", "--scene", "maze", "--frame-px", "320x240", "--pairs", &pairs, "--boards", &boards];
    let words: Vec<&OsStr> = words.into_iter().chain(["--seed", &seed, "--out", "disk"]).map(OsStr::new).collect();
    let usage = program::run("tactile-data generate", &workspace.program("tactile-data"), &words, folder)?;
    println!(
        "to disk: {:.0} images/s at 320x240 ({} images, boards: {boards}, {:.1} s, {:.0} MiB of memory)",
        2.0 * args.pairs as f64 / usage.seconds,
        2 * args.pairs,
        usage.seconds,
        usage.peak_mib.unwrap_or(f64::NAN)
    );
    Ok(())
}

/// Trains on each tier alone, on the same boards with the same seed, and tests each on the same letters.
fn train(workspace: &Workspace, args: &SensorArgs, folder: &Path) -> Result<Vec<f64>> {
    let (steps, seed) = (args.train_steps.to_string(), args.seed.to_string());
    let other_seed = (args.seed + 100).to_string();
    let run = |program: &str, words: &[&str]| {
        let words: Vec<&OsStr> = words.iter().map(OsStr::new).collect();
        program::run(program, &workspace.program(program), &words, folder).map(|_| ())
    };
    for (sides, seed) in [("peg", &seed), ("hole", &other_seed)] {
        run("tactile-data", &["generate", "--scene", TEST_SCENE, "--sides", sides, "--seed", seed, "--out", sides])?;
    }
    let of_tier = |tier: &&str| {
        let model = format!("model-{tier}");
        run("tactile-data", &["generate", "--scene", "maze", "--fidelity", tier, "--seed", &seed, "--out", tier])?;
        run("tactile-train", &["--data", tier, "--steps", &steps, "--seed", &seed, "--out", &model])?;
        let checkpoint = PathBuf::from(&model).join("model.safetensors").display().to_string();
        let words = ["match", "--model", &checkpoint, "--pegs", "peg", "--holes", "hole", "--limit", "2000", "--json"];
        let found = json(workspace, "tactile-infer", &words, folder)?;
        std::fs::remove_dir_all(folder.join(tier)).map_err(Error::io(folder))?;
        found["moco"]["accuracy"].as_f64().ok_or_else(|| Error::invalid("tactile-infer match", "an accuracy", "none"))
    };
    TIERS.iter().map(of_tier).collect()
}

fn json(workspace: &Workspace, program: &str, words: &[&str], folder: &Path) -> Result<Value> {
    let text = program::output(workspace.program(program).as_os_str(), words, folder)?;
    serde_json::from_str(&text).map_err(|error| Error::invalid(program, "JSON", error.to_string()))
}

//! What each tier of the simulated sensor costs, and what training on it gives.

use std::path::Path;

use clap::Args;

use crate::error::Result;
use crate::json::number;
use crate::workspace::{Workspace, remove};

/// The tiers, each with those before it.
const TIERS: [&str; 5] = ["geometry", "gel", "optics", "camera", "shadow"];

/// Parts for tuning, at the full tier: what each tier's model is tested on.
const TEST_SCENE: &str = "alphabet-small-dev";

/// How long each tier is rendered in memory, seconds.
const SECONDS: f64 = 5.0;

/// Pairs written to disk at 320x240 to time that too, two images each, and boards: the `maze` preset has 150 pairs on
/// one.
const PAIRS: usize = 1_000;
const BOARDS: usize = PAIRS.div_ceil(150);

/// What to measure.
#[derive(Args)]
pub struct SensorArgs {
    /// Also train on each tier for this many steps and test on letters at the full tier; 0: do not.
    #[arg(long, default_value_t = 0)]
    train_steps: usize,
}

/// Prints a table: images a second of each tier in memory, and the accuracy of what is trained on it.
pub fn sensor(workspace: &Workspace, args: &SensorArgs) -> Result<()> {
    let name = format!("bench-sensor-{}", std::process::id());
    let folder = workspace.folder(None, &workspace.target.join(name))?;
    let done = measure(workspace, args, &folder);
    remove(&folder)?;
    done
}

fn measure(workspace: &Workspace, args: &SensorArgs, folder: &Path) -> Result<()> {
    let speed = format!("speed --scene maze --frame-px 320x240 --seconds {SECONDS} --json");
    let speeds = workspace.program("tactile-data").words(speed).json(folder)?;
    let accuracies = if args.train_steps > 0 { train(workspace, args.train_steps, folder)? } else { Vec::new() };
    println!("tier        images/s   ms an image and core   accuracy of one touch, {TEST_SCENE} at the full tier");
    for (i, tier) in TIERS.iter().enumerate() {
        let figure = |field: &str| number(&speeds, &format!("/{i}/{field}"));
        let accuracy = accuracies.get(i).map_or("not trained".into(), |share| format!("{:.1} %", 100.0 * share));
        println!("{tier:10} {:9.0} {:22.3}   {accuracy}", figure("images_per_s")?, figure("ms_per_image")?);
    }
    to_disk(workspace, folder)
}

/// Times one `tactile-data generate`, with its start, the boards and the writing to disk.
fn to_disk(workspace: &Workspace, folder: &Path) -> Result<()> {
    let generate = workspace
        .program("tactile-data")
        .words(format!("generate --scene maze --frame-px 320x240 --pairs {PAIRS} --boards {BOARDS} --out disk"));
    let usage = generate.run(folder)?;
    let n_images = 2 * PAIRS;
    let speed = n_images as f64 / usage.seconds;
    println!("to disk: {speed:.0} images/s at 320x240 ({n_images} images, boards: {BOARDS}, {usage})");
    Ok(())
}

/// Trains on each tier alone, on the same boards with the same seed, and tests each on the same letters.
fn train(workspace: &Workspace, steps: usize, folder: &Path) -> Result<Vec<f64>> {
    let program = |name: &str, words: String| workspace.program(name).words(words);
    for (sides, seed) in [("peg", 1), ("hole", 101)] {
        let words = format!("generate --scene {TEST_SCENE} --sides {sides} --seed {seed} --out {sides}");
        program("tactile-data", words).run(folder)?;
    }
    let of_tier = |tier: &&str| {
        let generate = format!("generate --scene maze --fidelity {tier} --out {tier}");
        program("tactile-data", generate).run(folder)?;
        let train = format!("--data {tier} --steps {steps} --out model-{tier}");
        program("tactile-train", train).run(folder)?;
        let words = format!("match --model model-{tier}/model.safetensors --pegs peg --holes hole --limit 2000 --json");
        let found = program("tactile-infer", words).json(folder)?;
        remove(&folder.join(tier))?;
        number(&found, "/moco/accuracy")
    };
    TIERS.iter().map(of_tier).collect()
}

//! `cargo xtask bench training`: our training step and encoder beside PyTorch's, same network, same batch, turn by turn.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::program;
use crate::python::environment;
use crate::workspace::Workspace;

/// What is compared.
const FIGURES: [(&str, &str); 3] = [
    ("pairs_per_second", "training step, pairs/s"),
    ("one_image_ms", "encoder, one image, ms"),
    ("images_per_second", "encoder, batches of 64, images/s"),
];

/// Settings of `cargo xtask bench training`.
#[derive(Args)]
pub struct TrainingArgs {
    /// Pairs in a batch: the preset's.
    #[arg(long, default_value_t = 192)]
    batch: usize,
    /// Turns; the medians count.
    #[arg(long, default_value_t = 3)]
    turns: usize,
    /// Seconds of PyTorch's steps in each turn.
    #[arg(long, default_value_t = 12.0)]
    seconds: f64,
    /// A Python with torch and safetensors [default: a virtual environment in the build folder, made once from PyPI].
    #[arg(long)]
    python: Option<PathBuf>,
}

/// Simulates a small dataset, then measures ours and PyTorch's in turns.
pub fn training(workspace: &Workspace, args: &TrainingArgs) -> Result<()> {
    let out = workspace.target.join("bench-training");
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    let python = match &args.python {
        Some(python) => python.clone(),
        None => environment(&out, &["torch", "numpy>=1.24", "safetensors==0.8.0"])?,
    };
    let [data, train, infer] =
        ["tactile-data", "tactile-train", "tactile-infer"].map(|name| workspace.program(name).into_os_string());
    let pairs = out.join("pairs");
    if !pairs.exists() {
        program::output(&data, &["generate", "--scene", "maze", "--pairs", "2000", "--out", "pairs"], &out)?;
    }
    let model = workspace.root.join("infer/models/maze-small.safetensors");
    let script = workspace.root.join("xtask/python/pytorch.py");
    let (batch, seconds) = (args.batch.to_string(), args.seconds.to_string());
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let (model, script) = (text(&model), text(&script));
    let mut figures = vec![[Vec::new(), Vec::new()]; FIGURES.len()];
    for turn in 0..args.turns.max(1) {
        let folder = out.join("model");
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(Error::io(&folder))?;
        }
        let step = ["--data", "pairs", "--out", "model", "--steps", "40", "--save-every", "40", "--batch", &batch];
        program::output(&train, &step, &out)?;
        let speed = program::output(&infer, &["speed", "--model", &model, "--seconds", "2", "--json"], &out)?;
        let mut ours = json(&speed)?;
        ours["pairs_per_second"] = last_speed(&folder.join("curve.csv"))?.into();
        let theirs = json(&program::output(python.as_os_str(), &[&script, &model, &batch, &seconds], &out)?)?;
        eprintln!("turn {}: ours {ours}, PyTorch {theirs}", turn + 1);
        for ((key, _), [a, b]) in FIGURES.iter().zip(&mut figures) {
            for (values, found) in [(a, &ours), (b, &theirs)] {
                let value = found[key].as_f64();
                values.push(value.ok_or_else(|| Error::invalid(*key, "a number", found.to_string()))?);
            }
        }
    }
    let batches = ["--data", "pairs", "--out", "model", "--batch", &batch, "--time-batches", "40"];
    println!("{}, nothing else going on", program::output(&train, &batches, &out)?.trim());
    println!("{:34} {:>9} {:>9} {:>14}", "median of turns", "ours", "PyTorch", "ours / PyTorch");
    for ((_, name), [ours, theirs]) in FIGURES.iter().zip(&mut figures) {
        let (ours, theirs) = (median(ours), median(theirs));
        println!("{name:34} {ours:9.2} {theirs:9.2} {:14.2}", ours / theirs);
    }
    Ok(())
}

fn json(text: &str) -> Result<Value> {
    serde_json::from_str(text).map_err(|e| Error::invalid("a program's figures", "JSON", e.to_string()))
}

/// Pairs a second over the run, from the last line of a training curve.
fn last_speed(path: &Path) -> Result<f64> {
    let text = fs::read_to_string(path).map_err(Error::io(path))?;
    let mut lines = text.lines();
    let column = lines.next().and_then(|head| head.split(',').position(|name| name == "pairs_per_second"));
    let cell = lines.last().zip(column).and_then(|(line, column)| line.split(',').nth(column)?.parse().ok());
    cell.ok_or_else(|| Error::invalid(path.display().to_string(), "a column 'pairs_per_second'", "none"))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

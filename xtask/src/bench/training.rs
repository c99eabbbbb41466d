//! `cargo xtask bench training`: our training step and encoder next to PyTorch's, same network, same batch, turn by turn.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::bench::table::Table;
use crate::error::Result;
use crate::json::number;
use crate::program::Program;
use crate::python::environment;
use crate::workspace::{Workspace, remove};

/// What is compared.
const FIGURES: [(&str, &str); 3] = [
    ("pairs_per_second", "training step, pairs/s"),
    ("one_image_ms", "encoder, one image, ms"),
    ("images_per_second", "encoder, batches of 64, images/s"),
];

/// Pairs in a batch: the preset's.
const BATCH: usize = 192;

/// Turns; the medians count.
const TURNS: usize = 3;

/// Seconds of PyTorch's steps in each turn.
const SECONDS: f64 = 12.0;

/// A Python in `out` with what the scripts that compare with PyTorch import.
pub(super) fn pytorch(out: &Path) -> Result<PathBuf> {
    environment(out, "torch numpy>=1.24 safetensors==0.8.0")
}

/// Simulates a small dataset, then measures ours and PyTorch's in turns.
pub fn training(workspace: &Workspace) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("bench-training"))?;
    let python = pytorch(&out)?;
    if !out.join("pairs").exists() {
        workspace.program("tactile-data").words("generate --scene maze --pairs 2000 --out pairs").output(&out)?;
    }
    let script = workspace.root.join("xtask").join("python").join("pytorch.py");
    let theirs = Program::new(python).arg(script).arg(workspace.shipped_model());
    let theirs = theirs.words(format!("{BATCH} {SECONDS}"));
    let mut figures = vec![[Vec::new(), Vec::new()]; FIGURES.len()];
    let (mut peaks, mut pair_gflop) = (Vec::new(), 0.0);
    for turn in 0..TURNS {
        let (ours, theirs) = (ours(workspace, &out)?, theirs.json(&out)?);
        eprintln!("turn {}: ours {ours}, PyTorch {theirs}", turn + 1);
        for ((key, _), [a, b]) in FIGURES.iter().zip(&mut figures) {
            a.push(number(&ours, &format!("/{key}"))?);
            b.push(number(&theirs, &format!("/{key}"))?);
        }
        peaks.push(number(&theirs, "/matrix_product_gflops")?);
        pair_gflop = number(&theirs, "/pair_gflop")?;
    }
    println!("{:34} {:>9} {:>9} {:>14}", "median of turns", "ours", "PyTorch", "ours / PyTorch");
    let peak = median(&mut peaks);
    for ((key, name), [ours, theirs]) in FIGURES.iter().zip(&mut figures) {
        let (ours, theirs) = (median(ours), median(theirs));
        println!("{name:34} {ours:9.2} {theirs:9.2} {:14.2}", ours / theirs);
        if *key == "pairs_per_second" {
            let [ours, theirs] = [ours, theirs].map(|pairs| pairs * pair_gflop / peak);
            println!("{:34} {ours:9.2} {theirs:9.2}", "  of the peak of matrix products");
        }
    }
    println!(
        "The peak: {peak:.0} GFLOP a second, PyTorch's best product of 1024x1024 matrices. A pair's step: {:.0} MFLOP, \
         convolutions counted as they are defined; ours, and some of PyTorch's, take fewer.",
        1e3 * pair_gflop
    );
    Ok(())
}

/// Our figures in one turn.
fn ours(workspace: &Workspace, out: &Path) -> Result<Value> {
    let folder = out.join("model");
    remove(&folder)?;
    let train = format!("--data pairs --out model --steps 40 --set save_every=40 --batch {BATCH}");
    workspace.program("tactile-train").words(train).output(out)?;
    let speed = workspace.program("tactile-infer").words("speed --model").arg(workspace.shipped_model());
    let mut ours = speed.words("--seconds 2 --json").json(out)?;
    let speeds = Table::read(&folder.join("curve.csv"))?.numbers(["pairs_per_second"])?;
    ours["pairs_per_second"] = speeds.last().map(|[speed]| *speed).into();
    Ok(ours)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

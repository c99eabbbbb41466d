//! `cargo xtask bench card`: our training step on a graphics card next to PyTorch's on the same card, same network, same batch.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use crate::bench::table::Table;
use crate::bench::training::pytorch;
use crate::error::{Error, Result};
use crate::json::number;
use crate::program::Program;
use crate::workspace::{Workspace, remove};

/// Steps before the speed counts: kernels are chosen and compiled in the first.
const WARM_UP: usize = 96;

/// The arithmetic of PyTorch's steps, as `xtask/python/card.py` names it.
const ARITHMETIC: [&str; 3] = ["float32", "tf32", "bfloat16"];

/// Settings of `cargo xtask bench card`.
#[derive(Args)]
pub struct CardArgs {
    /// Pairs in a batch, one table row each.
    #[arg(long, value_delimiter = ',', default_value = "256,1024,4096")]
    batches: Vec<usize>,
    /// Steps of our runs.
    #[arg(long, default_value_t = 256)]
    steps: usize,
    /// Seconds of each of PyTorch's runs.
    #[arg(long, default_value_t = 4.0)]
    seconds: f64,
    /// A Python with PyTorch for this card, numpy and safetensors [default: one is installed from PyPI].
    #[arg(long)]
    python: Option<PathBuf>,
    /// Ours alone: how many kernels a step launches, on any Vulkan driver.
    #[arg(long)]
    ours_alone: bool,
}

/// Measures ours and PyTorch's, batch by batch.
pub fn card(workspace: &Workspace, args: &CardArgs) -> Result<()> {
    if args.steps <= WARM_UP {
        return Err(Error::invalid("--steps", format!("more than {WARM_UP}"), args.steps.to_string()));
    }
    let out = workspace.folder(None, &workspace.target.join("bench-card"))?;
    workspace.cargo("build --release --workspace --exclude xtask --features tactile-tests/wgpu")?;
    if !out.join("pairs").exists() {
        workspace.program("tactile-data").words("generate --scene maze --pairs 6000 --out pairs").output(&out)?;
    }
    let python = match (&args.python, args.ours_alone) {
        (_, true) => None,
        (Some(python), false) => Some(python.clone()),
        (None, false) => Some(pytorch(&out)?),
    };
    let bench = Bench { workspace, args, out: &out, python: python.as_deref() };
    println!(
        "{:>6} {:>8} {:>9} {:>11} {:>9} {:>9} {:>9} {:>10}",
        "batch", "ours", "launches", "on the card", ARITHMETIC[0], ARITHMETIC[1], ARITHMETIC[2], "of peak"
    );
    for batch in &args.batches {
        bench.row(*batch)?;
    }
    println!(
        "Pairs a second; kernels that a step of ours launches, and milliseconds that the card works on them, by its own clock."
    );
    Ok(())
}

struct Bench<'a> {
    workspace: &'a Workspace,
    args: &'a CardArgs,
    out: &'a Path,
    python: Option<&'a Path>,
}

impl Bench<'_> {
    fn row(&self, batch: usize) -> Result<()> {
        let speed = self.ours(batch, "")?;
        let kernels = self.out.join("kernels.csv");
        self.ours(batch, "--kernels kernels.csv")?;
        let all = Table::read(&kernels)?.numbers(["launches_a_step", "microseconds_a_step"])?;
        let [launches, microseconds] = all.last().copied().unwrap_or_default();
        print!("{batch:6} {speed:8.0} {launches:9.0} {:11.2}", microseconds / 1e3);
        if let Some(python) = self.python {
            let theirs = self.theirs(python, batch)?;
            for arithmetic in ARITHMETIC {
                print!(" {:9.0}", number(&theirs, &format!("/{arithmetic}"))?);
            }
            let peak = 1e3 * number(&theirs, "/product_tflops")?;
            print!(" {:9.1}%", 100.0 * speed * number(&theirs, "/pair_gflop")? / peak);
        }
        println!();
        Ok(())
    }

    /// Pairs a second of our steps after the warm-up; `more` are further flags.
    fn ours(&self, batch: usize, more: &str) -> Result<f64> {
        let folder = self.out.join("model");
        remove(&folder)?;
        let steps = self.args.steps;
        let words = format!(
            "--data pairs --out model --device wgpu --preset small --steps {steps} --batch {batch} --set save_every={steps} {more}"
        );
        self.workspace.program("tactile-train").words(words).output(self.out)?;
        let speeds = Table::read(&folder.join("curve.csv"))?.numbers(["step", "pairs_per_second"])?;
        Ok(speeds.last().map(|[_, speed]| *speed).unwrap_or_default())
    }

    fn theirs(&self, python: &Path, batch: usize) -> Result<Value> {
        let script = self.workspace.root.join("xtask").join("python").join("card.py");
        let theirs = Program::new(python).arg(script).arg(self.workspace.shipped_model());
        theirs.words(format!("{batch} {}", self.args.seconds)).json(self.out)
    }
}

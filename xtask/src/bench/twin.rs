//! `cargo xtask bench twin`: seconds of training until one touch names most letters, ours against the same run in
//! PyTorch.

use std::fs;
use std::path::PathBuf;

use clap::Args;

use super::table::Table;
use super::training::pytorch;
use crate::error::{Error, Result};
use crate::json::number;
use crate::program::Program;
use crate::workspace::{Workspace, remove};

/// Steps over which `tactile-train` averages its speed.
const RECENT: usize = 50;

/// Pairs of a batch.
const BATCH: usize = 192;

/// Steps of each run.
const STEPS: usize = 500;

/// The share that is asked for, %.
const PERCENT: f64 = 90.0;

/// At most so many holes are matched, as `tactile-train` does.
const HOLES: usize = 1_000;

/// Settings of `cargo xtask bench twin`.
#[derive(Args)]
pub struct TwinArgs {
    /// Seeds of weights and batches: a run of each for both.
    #[arg(long, value_delimiter = ',', default_value = "1")]
    seeds: Vec<u64>,
}

/// Trains both from the same weights on the same batches, seed by seed, and compares when they name as many.
pub fn twin(workspace: &Workspace, args: &TwinArgs) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("bench-twin"))?;
    let python = pytorch(&out)?;
    let data = workspace.program("tactile-data");
    for (folder, scene) in [("maze", "maze --pairs 12000"), ("dev", "alphabet-small-dev")] {
        if !out.join(folder).join("meta.json").exists() {
            data.clone().words(format!("generate --scene {scene} --out {folder}")).output(&out)?;
        }
    }
    let bench = Twins { workspace, out, python };
    for seed in &args.seeds {
        let (ours, theirs) = (bench.ours(*seed)?, bench.theirs(*seed)?);
        println!("seed {seed}: step, s and % of ours, s and % of PyTorch's");
        for (ours, theirs) in ours.iter().zip(&theirs) {
            let [a, b] = [ours, theirs].map(|at| format!("{:8.1} {:6.1}", at.seconds, at.percent));
            println!("{:6} {a} {b}", ours.step);
        }
        match (seconds_until(&ours, PERCENT), seconds_until(&theirs, PERCENT)) {
            (Some(a), Some(b)) => {
                println!("{PERCENT} % named after {a:.1} s and {b:.1} s: {:.2} of PyTorch's time", a / b);
            }
            (a, b) => println!("{PERCENT} % named after {a:.1?} s and {b:.1?} s"),
        }
    }
    Ok(())
}

/// How good a run was at one of its saves.
#[derive(Clone, Copy, Debug)]
struct Saved {
    step: usize,
    /// The time of training until then, without what saving and validating took.
    seconds: f64,
    /// Holes whose nearest peg is of the right part, 0..=100.
    percent: f64,
}

struct Twins<'a> {
    workspace: &'a Workspace,
    out: PathBuf,
    python: PathBuf,
}

impl Twins<'_> {
    /// Runs `tactile-train` on the pairs, with more flags, into an empty folder.
    fn train(&self, seed: u64, folder: &str, more: &str) -> Result<()> {
        remove(&self.out.join(folder))?;
        let words = format!("--data maze --preset tiny --batch {BATCH} --seed {seed} --out {folder} {more}");
        self.workspace.program("tactile-train").words(words).output(&self.out).map(|_| ())
    }

    fn ours(&self, seed: u64) -> Result<Vec<Saved>> {
        let more = format!("--steps {STEPS} --set save_every={RECENT} --tune dev dev");
        self.train(seed, "ours", &more)?;
        let curve = Table::read(&self.out.join("ours").join("curve.csv"))?;
        let mut seconds = 0.0;
        let saves = curve.numbers(["step", "pairs_per_second", "tuning_accuracy"])?;
        let saved = saves.into_iter().map(|[step, speed, share]| {
            // The speed is that of the steps since the last save.
            let n_steps = (step as usize - 1) % RECENT + 1;
            seconds += (n_steps * BATCH) as f64 / speed;
            Saved { step: step as usize, seconds, percent: 100.0 * share }
        });
        Ok(saved.collect())
    }

    fn theirs(&self, seed: u64) -> Result<Vec<Saved>> {
        // A step too small to move the weights: what is saved is what they began with.
        self.train(seed, "first", "--steps 1 --set warmup=0 --set learning_rate=1e-12")?;
        let folder = self.out.join("theirs");
        remove(&folder)?;
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let trainer = self.workspace.program("tactile-train");
        let script = self.workspace.root.join("xtask").join("python").join("twin.py");
        let twin = Program::new(&self.python).arg(script).words("first/model.safetensors ours/train.toml theirs");
        let twin = twin.arg(trainer.path()).words("--data maze --config ours/train.toml --out unused --write-batches");
        twin.output(&self.out)?;
        let times = Table::read(&folder.join("times.csv"))?.numbers(["step", "seconds"])?;
        let saved = times.into_iter().map(|[step, seconds]| {
            let step = step as usize;
            let of_step = self.workspace.program("tactile-infer").words("match --pegs dev --holes dev --json --model");
            let found = of_step.arg(folder.join(format!("step-{step}.safetensors"))).words(format!("--limit {HOLES}"));
            Ok(Saved { step, seconds, percent: 100.0 * number(&found.json(&self.out)?, "/moco/accuracy")? })
        });
        saved.collect()
    }
}

/// Seconds until a share is reached, on the line between the saves around it; `None` where it never is.
fn seconds_until(saved: &[Saved], percent: f64) -> Option<f64> {
    let after = saved.iter().position(|at| at.percent >= percent)?;
    let Some(before) = after.checked_sub(1).map(|at| saved[at]) else { return Some(saved[after].seconds) };
    let share = (percent - before.percent) / (saved[after].percent - before.percent);
    Some(before.seconds + share * (saved[after].seconds - before.seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_is_on_the_line_between_two_saves() {
        let at = |seconds, percent| Saved { step: 0, seconds, percent };
        let saved = [at(10.0, 50.0), at(20.0, 80.0), at(30.0, 100.0)];
        assert_eq!(seconds_until(&saved, 90.0), Some(25.0));
        assert_eq!(seconds_until(&saved, 40.0), Some(10.0));
        assert_eq!(seconds_until(&saved[..2], 90.0), None);
    }
}

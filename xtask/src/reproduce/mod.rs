//! `cargo xtask reproduce`: every table and figure of the paper, and the trade of speed for accuracy, on one page.

mod parts;
mod sensors;

pub use parts::{Job, steps};

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use crate::error::{Error, Result};
use crate::experiments::{Amount, Experiments, Part};
use crate::step;
use crate::workspace::Workspace;

/// What `cargo xtask reproduce` takes.
#[derive(Args)]
pub struct ReproduceArgs {
    /// Folder for everything it makes [default: reproduction in the workspace].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Few episodes of everything, in minutes: whether it runs, not what it reaches.
    #[arg(long)]
    smoke: bool,
    /// Only these parts [default: all]
    #[arg(long = "part", value_enum)]
    parts: Vec<Part>,
    /// Episodes of each evaluation [default: 500 of the paper's protocol, 300 of what it does not have]
    #[arg(long)]
    episodes: Option<usize>,
    /// Compare sensors on the letters for tuning, M to X, as every choice must; the other parts stay as they are.
    #[arg(long)]
    tuning_letters: bool,
    /// Folder of real images; the sensor that is calibrated on them is skipped where they are missing.
    #[arg(long, default_value = "../shared/real-gelsight")]
    real: PathBuf,
    /// The model to evaluate [default: the one that comes with the project]
    #[arg(long)]
    model: Option<PathBuf>,
}

/// Runs what is left to do and writes the page; returns the folder where it was a whole run with the shipped model.
pub fn reproduce(workspace: &Workspace, args: &ReproduceArgs) -> Result<Option<PathBuf>> {
    let folder = match (args.smoke, args.tuning_letters) {
        (true, _) => "reproduction-smoke",
        (_, true) => "reproduction-tuning",
        _ => "reproduction",
    };
    let out = workspace.folder(args.out.as_deref(), Path::new(folder))?;
    let model = args.model.clone().unwrap_or_else(|| workspace.shipped_model());
    let model = model.canonicalize().map_err(Error::io(&model))?;
    let experiments = &Experiments::read(workspace)?;
    let amount = if args.smoke { experiments.smoke } else { experiments.whole };
    let amount = args.episodes.map_or(amount, |episodes| Amount { episodes, fewer: episodes, ..amount });
    let parts = if args.parts.is_empty() { Part::value_variants() } else { &args.parts };
    let real = workspace.root.join(&args.real);
    let is_missing = |folder: &String| !real.join(folder).is_dir();
    let without = experiments.sensors.iter().filter(|of| of.real.as_ref().is_some_and(is_missing));
    let without: Vec<String> = without.map(|of| of.name.clone()).collect();
    if !without.is_empty() && parts.contains(&Part::Sensors) {
        println!("{} is skipped: {} has no images of it", without.join(", "), real.display());
    }
    let is_whole = *parts == *Part::value_variants() && amount == experiments.whole && without.is_empty();
    let is_whole = is_whole && !args.tuning_letters && args.model.is_none();
    let tuning_letters = args.tuning_letters;
    let job = Job { amount, tuning_letters, real, without, ..Job::whole(workspace, experiments, &model) };
    step::run_all("reproduce", &steps(&job, parts)?, workspace, &out)?;
    workspace.program("tactile-filter").words("reproduction . --out reproduction.html").run(&out)?;
    println!("{}", out.join("reproduction.html").display());
    Ok(is_whole.then_some(out))
}

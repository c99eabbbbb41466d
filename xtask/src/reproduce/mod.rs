//! `cargo xtask reproduce`: every table and figure of the paper, and the trade of speed for accuracy, on one page.

mod parts;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};

use crate::error::{Error, Result};
use crate::program;
use crate::step::Notes;
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
    /// The model to evaluate [default: the one that comes with the project]
    #[arg(long)]
    model: Option<PathBuf>,
}

/// A part that can be made on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Tables I and II, and informed against random touches.
    Tables,
    /// Table III.
    Connectors,
    /// Touches anywhere, at any angle.
    Anywhere,
    /// Fewer classes.
    Classes,
    /// A part that is not in the bank.
    Absent,
    /// Belief maps and assembly of M, L, T and F.
    Assembly,
    /// Scenes where one touch tells as little as in the paper.
    Hard,
    /// Other lamps, gels, cameras, presses, and what does not belong to a part.
    Robust,
    /// Speed against accuracy.
    Tradeoff,
}

/// How much of everything.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Amount {
    /// Episodes of the paper's protocol.
    episodes: usize,
    /// Episodes of what the paper does not have.
    fewer: usize,
    /// Assemblies.
    trials: usize,
    /// Episodes of each setting of the trade-off, and how many settings; all where none is said.
    of_settings: (usize, Option<usize>),
    /// Whether models are trained to compare them.
    trains: bool,
}

impl Amount {
    /// The whole, in hours.
    const WHOLE: Self = Self { episodes: 500, fewer: 300, trials: 200, of_settings: (200, None), trains: true };
    /// Minutes.
    const SMOKE: Self = Self { episodes: 24, fewer: 12, trials: 6, of_settings: (12, Some(8)), trains: false };
}

/// Runs what is left to do and writes the page.
pub fn reproduce(workspace: &Workspace, args: &ReproduceArgs) -> Result<()> {
    let start = Instant::now();
    let folder = if args.smoke { "reproduction-smoke" } else { "reproduction" };
    let out = args.out.clone().unwrap_or_else(|| workspace.root.join(folder));
    let out = std::path::absolute(&out).map_err(Error::io(&out))?;
    let shipped = workspace.root.join("infer").join("models").join("maze-small.safetensors");
    let model = args.model.clone().unwrap_or(shipped);
    let model = std::path::absolute(&model).map_err(Error::io(&model))?;
    if !model.is_file() {
        return Err(Error::invalid(model.display().to_string(), "a model", "no such file"));
    }
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    let mut notes = Notes::open(&out, "reproduce")?;
    workspace.build()?;
    let amount = if args.smoke { Amount::SMOKE } else { Amount::WHOLE };
    let chosen: Vec<Part> = match args.parts.as_slice() {
        [] => Part::value_variants().to_vec(),
        parts => parts.to_vec(),
    };
    let steps = parts::steps(workspace, &model, &chosen, amount);
    println!("everything below happens in {}; stopped, the same command goes on", out.display());
    for (n, step) in steps.iter().enumerate() {
        step.run(&format!("step {} of {}, {}", n + 1, steps.len(), step.name), &out, &mut notes)?;
    }
    let page = out.join("reproduction.html");
    let words = [Path::new("reproduction"), Path::new("."), Path::new("--out"), Path::new("reproduction.html")];
    let words = words.map(Path::as_os_str);
    program::run("the page", &workspace.program("tactile-filter"), &words, &out)?;
    println!("{}", notes.times(&steps));
    println!("all of it this time, building included: {:.0} s", start.elapsed().as_secs_f64());
    println!("{}", page.display());
    Ok(())
}

//! `tactile-train`: trains the part-mating model on a dataset of pairs.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use tactile_data::store::Dataset;
use tactile_infer::DeviceKind;
use tactile_train::config::TrainConfig;
use tactile_train::letters::Letters;
use tactile_train::pairs::{Pairs, n_training};
use tactile_train::run::{Event, Outcome, Run, train};
use tactile_train::settings::Settings;
use tactile_train::validate::Validation;
use tactile_train::{Error, Result};

/// Trains the part-mating model on a dataset of hole and peg pairs.
#[derive(Parser)]
#[command(
    version,
    after_help = "Example:\n  tactile-data generate --scene maze --out maze\n  tactile-train --data maze --out model"
)]
struct Cli {
    /// Dataset of pairs, made by `tactile-data generate --scene maze` or imported.
    #[arg(long)]
    data: PathBuf,
    /// Folder for model.safetensors, state.safetensors, train.toml, curve.csv and curve.html.
    #[arg(long)]
    out: PathBuf,
    /// Settings in a TOML file, named as the flags with _ for -; flags go over it.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where to compute: flex (CPU, default), ndarray (older CPU backend, much slower) or wgpu (graphics card).
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Go on from the state in --out, with the settings it began with.
    #[arg(long)]
    resume: bool,
    /// Pegs of parts that are not trained on: with --tune-holes, their accuracy is measured at each save.
    #[arg(long, value_name = "DIR", requires = "tune_holes")]
    tune_pegs: Option<PathBuf>,
    /// Holes of the parts of --tune-pegs.
    #[arg(long, value_name = "DIR", requires = "tune_pegs")]
    tune_holes: Option<PathBuf>,
    /// Only make so many batches and say how fast: whether the processor, not the disk, sets the pace.
    #[arg(long, value_name = "BATCHES")]
    time_batches: Option<usize>,
    /// Print the outcome as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten, next_help_heading = "Settings, each instead of the preset's")]
    settings: Settings,
}

fn main() -> ExitCode {
    tactile_data::closed_output::fail_in_one_line();
    let cli = Cli::parse();
    if let Some(n_batches) = cli.time_batches {
        return match time_batches(&cli, n_batches) {
            Ok(pairs_per_second) => {
                println!("{pairs_per_second:.0} pairs/s decoded, augmented and batched");
                ExitCode::SUCCESS
            }
            Err(error) => {
                eprintln!("error: {error}");
                ExitCode::FAILURE
            }
        };
    }
    match run(&cli) {
        Ok(outcome) if outcome.finished => ExitCode::SUCCESS,
        Ok(outcome) => {
            eprintln!("stopped after step {}; go on with --resume", outcome.step);
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<Outcome> {
    let device: DeviceKind = cli.device.parse()?;
    let dataset = Dataset::open(&cli.data)?;
    let config = settings(cli, &dataset)?;
    let tuning = match (&cli.tune_pegs, &cli.tune_holes) {
        (Some(pegs), Some(holes)) => Some((Dataset::open(pegs)?, Dataset::open(holes)?)),
        _ => None,
    };
    let letters = tuning.as_ref().map(|(pegs, holes)| Letters::new(pegs, holes)).transpose()?;
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed))
        .map_err(|e| Error::invalid("ctrl-C handler", "one in this process", e.to_string()))?;

    let mut show = Show::new(config.n_steps);
    let should_stop = || stop.load(Ordering::Relaxed);
    let run = Run {
        dataset: &dataset,
        letters: letters.as_ref(),
        out: &cli.out,
        config: &config,
        device,
        resume: cli.resume,
    };
    let outcome = train(&run, &should_stop, &mut |event| show.event(event))?;
    let found = &outcome.validation;
    if cli.json {
        let json = serde_json::json!({
            "model": outcome.model, "sha256": outcome.sha256, "step": outcome.step,
            "finished": outcome.finished, "validation": found,
        });
        println!("{json}");
    } else {
        println!("{}: {} steps, {}", outcome.model.display(), outcome.step, measures(found));
    }
    Ok(outcome)
}

/// Pairs a second that batches are made with, nothing else going on.
fn time_batches(cli: &Cli, n_batches: usize) -> Result<f64> {
    let dataset = Dataset::open(&cli.data)?;
    let config = settings(cli, &dataset)?;
    config.validate()?;
    let pairs = Pairs::new(&dataset, &config)?;
    let started = Instant::now();
    (0..n_batches).try_for_each(|step| pairs.batch(&config, step).map(|_| ()))?;
    Ok((n_batches * config.n_pairs) as f64 / started.elapsed().as_secs_f64())
}

/// Flags over the file over the preset; a run that goes on has its own file.
fn settings(cli: &Cli, dataset: &Dataset) -> Result<TrainConfig> {
    let begun_with = Some(cli.out.join("train.toml")).filter(|path| cli.resume && path.exists());
    let file = cli.config.clone().or(begun_with).map(|path| Settings::load(&path)).transpose()?;
    cli.settings.clone().over(file.unwrap_or_default()).resolve(n_training(dataset))
}

/// How good a model is, in a line.
fn measures(found: &Validation) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let near = found.near_1.zip(found.near_chance).map_or(String::new(), |(near, chance)| {
        format!(", {} among near neighbours (chance {})", percent(near), percent(chance))
    });
    let letters = found.letters.map_or(String::new(), |share| format!(", letters {}", percent(share)));
    let (first, five) = (percent(found.retrieval_1), percent(found.retrieval_5));
    format!("held-out retrieval@1 {first}, @5 {five} of {}{near}{letters}", found.n_holes)
}

/// Progress: a bar on a terminal, a line each checkpoint elsewhere.
struct Show {
    bar: Option<ProgressBar>,
    last: Option<(f64, f64, f64)>,
}

impl Show {
    fn new(n_steps: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("training {bar:30} {pos}/{len} {msg}");
            ProgressBar::new(n_steps as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, last: None }
    }

    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Step { step, loss, pairs_per_second, seconds_left, .. } => {
                self.last = Some((loss, pairs_per_second, seconds_left));
                if let Some(bar) = &self.bar {
                    bar.set_position(step as u64);
                    let left = duration(seconds_left);
                    bar.set_message(format!("loss {loss:.3}, {pairs_per_second:.0} pairs/s, {left} left"));
                }
            }
            Event::Saved { step, validation } => {
                let (loss, speed, left) = self.last.unwrap_or_default();
                let Validation { cosine_gap, spread, .. } = validation;
                self.line(&format!(
                    "step {step}: loss {loss:.3}, {}, cosine gap {cosine_gap:.2}, spread {spread:.2}, {speed:.0} pairs/s, \
                     {} left",
                    measures(validation),
                    duration(left)
                ));
            }
            Event::Warning { step, text } => self.line(&format!("warning at step {step}: {text}")),
        }
    }

    fn line(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            None => eprintln!("{line}"),
        }
    }
}

/// Seconds as a person says them.
fn duration(seconds: f64) -> String {
    match seconds {
        ..90.0 => format!("{seconds:.0} s"),
        ..5_400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3_600.0),
    }
}

//! `tactile-train`: trains the part-mating model on a dataset of pairs.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use tactile_data::store::Dataset;
use tactile_infer::DeviceKind;
use tactile_train::run::{Event, Outcome, TrainConfig, train};
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
    /// Folder for model.safetensors, state.safetensors and curve.csv.
    #[arg(long)]
    out: PathBuf,
    /// How much to train: `tiny` takes minutes on two cores.
    #[arg(long, default_value = "tiny", value_parser = ["tiny"])]
    preset: String,
    /// Where to compute: flex (CPU, default) or ndarray (older CPU backend, much slower).
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Go on from the state in --out, with the settings it began with.
    #[arg(long)]
    resume: bool,
    /// Seed of weights, batches and augmentation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Steps instead of the preset's.
    #[arg(long)]
    steps: Option<usize>,
    /// Pairs in a batch instead of the preset's.
    #[arg(long)]
    batch: Option<usize>,
    /// Temperature of InfoNCE instead of the preset's.
    #[arg(long)]
    temperature: Option<f64>,
    /// Peak learning rate instead of the preset's.
    #[arg(long)]
    learning_rate: Option<f64>,
    /// Smallest share of each side that a random crop keeps, instead of the preset's.
    #[arg(long)]
    min_crop: Option<f32>,
    /// Share of a batch that are near neighbours, instead of the preset's.
    #[arg(long)]
    near_share: Option<f64>,
    /// Steps between checkpoints instead of the preset's.
    #[arg(long)]
    save_every: Option<usize>,
    /// Print the outcome as JSON.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
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
    let config = settings(cli);
    let dataset = Dataset::open(&cli.data)?;
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed))
        .map_err(|e| Error::invalid("ctrl-C handler", "one in this process", e.to_string()))?;

    let mut show = Show::new(config.n_steps);
    let should_stop = || stop.load(Ordering::Relaxed);
    let outcome = train(&dataset, &cli.out, &config, device, cli.resume, &should_stop, &mut |event| show.event(event))?;
    let found = &outcome.validation;
    if cli.json {
        let json = serde_json::json!({
            "model": outcome.model, "sha256": outcome.sha256, "step": outcome.step,
            "finished": outcome.finished, "validation": found,
        });
        println!("{json}");
    } else {
        println!(
            "{}: {} steps, retrieval@1 {:.1} % and @5 {:.1} % among {} held-out holes",
            outcome.model.display(),
            outcome.step,
            100.0 * found.retrieval_1,
            100.0 * found.retrieval_5,
            found.n_holes
        );
    }
    Ok(outcome)
}

fn settings(cli: &Cli) -> TrainConfig {
    let preset = TrainConfig::tiny();
    let n_steps = cli.steps.unwrap_or(preset.n_steps);
    TrainConfig {
        n_steps,
        n_pairs: cli.batch.unwrap_or(preset.n_pairs),
        temperature: cli.temperature.unwrap_or(preset.temperature),
        learning_rate: cli.learning_rate.unwrap_or(preset.learning_rate),
        n_warmup: preset.n_warmup.min(n_steps / 10),
        min_crop: cli.min_crop.unwrap_or(preset.min_crop),
        near_share: cli.near_share.unwrap_or(preset.near_share),
        save_every: cli.save_every.unwrap_or(preset.save_every),
        seed: cli.seed,
        ..preset
    }
}

/// Progress: a bar on a terminal, a line each checkpoint elsewhere.
struct Show {
    bar: Option<ProgressBar>,
    last: (f64, f64),
}

impl Show {
    fn new(n_steps: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("training {bar:30} {pos}/{len} {msg} {eta} left");
            ProgressBar::new(n_steps as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, last: (0.0, 0.0) }
    }

    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Step { step, loss, pairs_per_second, .. } => {
                self.last = (loss, pairs_per_second);
                if let Some(bar) = &self.bar {
                    bar.set_position(step as u64);
                    bar.set_message(format!("loss {loss:.3}, {pairs_per_second:.0} pairs/s"));
                }
            }
            Event::Saved { step, validation } => {
                let (loss, speed) = self.last;
                let line = format!(
                    "step {step}: loss {loss:.3}, held-out retrieval@1 {:.1} %, @5 {:.1} %, cosine gap {:.2}, spread {:.2}, {speed:.0} pairs/s",
                    100.0 * validation.retrieval_1,
                    100.0 * validation.retrieval_5,
                    validation.cosine_gap,
                    validation.spread
                );
                match &self.bar {
                    Some(bar) => bar.println(line),
                    None => eprintln!("{line}"),
                }
            }
        }
    }
}

//! The command line of `tactile-infer`.

mod convert;
mod embed;
mod speed;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use tactile_data::scene::Scene;
use tactile_data::store::Dataset;
use tactile_infer::bank::Bank;
use tactile_infer::calibrate::calibrate;
use tactile_infer::calibration::{Calibration, Gap};
use tactile_infer::checkpoint::Checkpoint;
use tactile_infer::matching::match_single_touches;
use tactile_infer::recorded::bank_of_dataset;
use tactile_infer::simulated::bank_of_scene;
use tactile_infer::{DeviceKind, Error, Model, Precision, Result};

/// The part-mating model at work: peg banks and single-touch matches.
#[derive(Parser)]
#[command(version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Embed pictures of touches: one row of numbers an image, of unit length.
    #[command(
        after_help = "Example:\n  tactile-infer embed touch.png --model model/model.safetensors --no-contact rest.png"
    )]
    Embed(embed::EmbedArgs),
    /// Embed a dataset of peg touches into one bank file, bound to the model.
    #[command(
        after_help = "Example:\n  tactile-infer bank --model model/model.safetensors --data pegs --out pegs.bank"
    )]
    Bank(BankArgs),
    /// Match each hole touch of a dataset against the pegs of another: one touch, nearest neighbour.
    #[command(
        after_help = "Example:\n  tactile-infer match --model model/model.safetensors --pegs pegs --holes holes --json"
    )]
    Match(MatchArgs),
    /// Fit the likelihood's temperature and floor on parts for tuning, and store them with the model.
    #[command(
        after_help = "Example:\n  tactile-infer calibrate --model model/model.safetensors --bank dev.bank --holes dev-holes"
    )]
    Calibrate(CalibrateArgs),
    /// Store a model's weights in another format: another model, with banks of its own.
    #[command(
        after_help = "Example:\n  tactile-infer convert --model model.safetensors --weights f16 --out half.safetensors"
    )]
    Convert(convert::ConvertArgs),
    /// How long the encoder takes: one image, and a batch of them.
    #[command(after_help = "Example:\n  tactile-infer speed --model infer/models/maze-small.safetensors")]
    Speed(speed::SpeedArgs),
}

#[derive(Args)]
struct CalibrateArgs {
    /// Checkpoint written by tactile-train; the calibration is stored in it, its identity stays.
    #[arg(long)]
    model: PathBuf,
    /// Bank of pegs made by the model: parts for tuning, never those of an evaluation.
    #[arg(long)]
    bank: PathBuf,
    /// Dataset of hole touches of the same parts, between the recorded poses.
    #[arg(long)]
    holes: PathBuf,
    /// Write the calibrated checkpoint here instead.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Where to compute: flex (CPU, default), ndarray (older CPU backend, much slower) or wgpu (graphics card).
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Print the calibration as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct BankArgs {
    /// Checkpoint written by tactile-train.
    #[arg(long)]
    model: PathBuf,
    /// Dataset with each peg touched at each pose of its reach.
    #[arg(long, required_unless_present = "scene", conflicts_with = "scene")]
    data: Option<PathBuf>,
    /// Simulate the touches of a scene (preset or TOML file) instead, and keep no dataset of them.
    #[arg(long, value_name = "PRESET|FILE.toml")]
    scene: Option<String>,
    /// With --scene: step of the recorded places in x and y, mm [default: the scene's]
    #[arg(long, value_name = "MM", requires = "scene")]
    xy_step_mm: Option<f64>,
    /// With --scene: step of the recorded angles, degrees [default: the scene's]
    #[arg(long, value_name = "DEG", requires = "scene")]
    theta_step_deg: Option<f64>,
    /// With --scene: draws jitter and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The bank file to write.
    #[arg(long)]
    out: PathBuf,
    /// Format of the bank's rows, on disk and in memory: 4, 2, 2 or 1 byte a value.
    #[arg(long, default_value = "f32", value_parser = clap::builder::PossibleValuesParser::new(Precision::ROWS))]
    rows: String,
    /// Where to compute: flex (CPU, default), ndarray (older CPU backend, much slower) or wgpu (graphics card).
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
}

#[derive(Args)]
struct MatchArgs {
    /// Checkpoint written by tactile-train.
    #[arg(long)]
    model: PathBuf,
    /// Dataset with each peg touched at each pose of its reach.
    #[arg(long)]
    pegs: PathBuf,
    /// Dataset of hole touches whose part is known.
    #[arg(long)]
    holes: PathBuf,
    /// Match at most this many holes, evenly spread over the dataset.
    #[arg(long, default_value_t = 500)]
    limit: usize,
    /// Format of the bank's rows, on disk and in memory: 4, 2, 2 or 1 byte a value.
    #[arg(long, default_value = "f32", value_parser = clap::builder::PossibleValuesParser::new(Precision::ROWS))]
    rows: String,
    /// Where to compute: flex (CPU, default), ndarray (older CPU backend, much slower) or wgpu (graphics card).
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

impl Cli {
    /// Does what was asked for.
    pub fn run(&self) -> Result<()> {
        match &self.command {
            Command::Embed(args) => args.run(),
            Command::Bank(args) => bank(args),
            Command::Match(args) => matches(args),
            Command::Calibrate(args) => calibrate_model(args),
            Command::Convert(args) => args.run(),
            Command::Speed(args) => args.run(),
        }
    }
}

fn bank(args: &BankArgs) -> Result<()> {
    let model = load(&args.model, &args.device)?;
    let bank = match (&args.data, &args.scene) {
        (Some(data), _) => build("embedding", &model, &Dataset::open(data)?, &args.rows)?,
        (_, scene) => simulate(args, &model, scene.as_deref().unwrap_or_default())?,
    };
    bank.save(&args.out)?;
    let (n_parts, n_poses) = (bank.parts().len(), bank.grid().len());
    println!(
        "{}: {n_parts} parts x {n_poses} poses = {} rows of {} {}, {:.1} MB in memory",
        args.out.display(),
        bank.n_rows(),
        bank.dim(),
        bank.rows().precision(),
        bank.rows().n_bytes() as f64 / 1e6
    );
    let symmetric = |part: usize| {
        let order = bank.symmetry(part).order;
        (order > 1).then(|| format!("{} after {} degrees", bank.parts()[part], 360 / order))
    };
    let symmetric: Vec<_> = (0..n_parts).filter_map(symmetric).collect();
    if !symmetric.is_empty() {
        println!("feels the same turned: {}", symmetric.join(", "));
    }
    Ok(())
}

/// A bank of the pegs of a scene, touched as they are embedded.
fn simulate(args: &BankArgs, model: &Model, scene: &str) -> Result<Bank> {
    let mut scene = Scene::load(scene)?;
    if let Some(reach) = &mut scene.reach {
        reach.xy_step_mm = args.xy_step_mm.unwrap_or(reach.xy_step_mm);
        reach.theta_step_deg = args.theta_step_deg.unwrap_or(reach.theta_step_deg);
    }
    scene.validate()?;
    let bar = progress("touching");
    let bank = bank_of_scene(model, &scene, args.seed, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    bank.with_precision(args.rows.parse()?)
}

/// A bank of a dataset's pegs, its rows in the format named; a bar shows how far it is.
fn build(what: &'static str, model: &Model, pegs: &Dataset, rows: &str) -> Result<Bank> {
    let bar = progress(what);
    let bank = bank_of_dataset(model, pegs, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    bank.with_precision(rows.parse()?)
}

fn matches(args: &MatchArgs) -> Result<()> {
    let model = load(&args.model, &args.device)?;
    let (pegs, holes) = (Dataset::open(&args.pegs)?, Dataset::open(&args.holes)?);
    let bank = build("matching", &model, &pegs, &args.rows)?;
    let found = match_single_touches(&model, &bank, &pegs, &holes, args.limit)?;
    if args.json {
        return print_json(&found);
    }
    println!("one touch, nearest neighbour among {} pegs, {} holes:", bank.n_rows(), found.moco.n_holes);
    let rows = [("Pixel", &found.pixel), ("Pixel, sign-flipped", &found.pixel_flipped), ("MoCo", &found.moco)];
    for (name, report) in rows {
        println!(
            "  {name:20} class {:5.1} %   exact cell {:5.1} %   xy {:4.1} mm   theta {:4.1} deg (means over right classes)",
            100.0 * report.accuracy,
            100.0 * report.exact_cell,
            report.xy_mm_mean,
            report.theta_deg_mean
        );
    }
    println!("  correlation of f_PP with f_HP: {:.3}", found.similarities.peg_similarity_correlation);
    println!("  99 in 100 holes with an edge reach cosine {:.2} with some peg", found.similarities.best_cosine_p01);
    Ok(())
}

fn calibrate_model(args: &CalibrateArgs) -> Result<()> {
    let model = load(&args.model, &args.device)?;
    let bank = Bank::load(&args.bank, &model)?;
    let calibration = calibrate(&model, &bank, &Dataset::open(&args.holes)?)?;
    let (checkpoint, _) = Checkpoint::load(&args.model)?;
    let out = args.out.as_ref().unwrap_or(&args.model);
    Checkpoint { calibration: Some(calibration), ..checkpoint }.save(out)?;
    if args.json {
        return print_json(&calibration);
    }
    let Calibration { temperature, outlier_floor, blank_agreement, low_similarity, .. } = calibration;
    println!("{}: temperature {temperature:.4}, outlier floor {outlier_floor:.1e}", out.display());
    println!("  blank agreement {blank_agreement:.3}; 99 in 100 holes reach cosine {low_similarity:.2}");
    println!(
        "  {:.3} nats to find the pose by one touch ({:.2} by chance), {} holes",
        calibration.nll_nats, calibration.chance_nats, calibration.n_holes
    );
    if let Some(Gap { mean, sd }) = calibration.gap {
        println!("  the view touched lies {mean:.3} below the best, standard deviation {sd:.3}");
    }
    Ok(())
}

fn load(path: &Path, device: &str) -> Result<Model> {
    Model::load_on(path, device.parse()?)
}

/// Prints a result for programs.
fn print_json(result: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(result);
    println!("{}", text.map_err(|e| Error::invalid("result", "values JSON can hold", e.to_string()))?);
    Ok(())
}

/// A bar on a terminal, silence elsewhere.
fn progress(what: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(&format!("{what} {{bar:30}} {{pos}}/{{len}} {{eta}} left"));
    ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

//! The command line of `tactile-infer`.

mod align;
mod calibrate;
mod convert;
mod embed;
mod speed;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use serde::Serialize;
use tactile_data::calibrate::Calibration;
use tactile_data::grid_fit::Tolerance;
use tactile_data::output;
use tactile_data::progress::reporter;
use tactile_data::scene::Scene;
use tactile_data::store::{Dataset, FILES};
use tactile_data::symmetry::Symmetry;
use tactile_data::touch::Side;
use tactile_infer::bank::Bank;
use tactile_infer::matches::PartMatch;
use tactile_infer::matching::{Touched, match_single_touches};
use tactile_infer::recorded::{BankPoses, bank_of_dataset, parts_on_grid};
use tactile_infer::simulated::SceneBank;
use tactile_infer::views::Views;
use tactile_infer::{DeviceKind, Error, Model, Precision, Result};

/// The part-mating model at work: banks of pegs, embeddings and matches of single touches.
///
/// Exit codes: 0 done, 1 failed, 2 misused.
#[derive(Parser)]
#[command(name = "tactile-infer", version)]
#[command(after_help = "Example:\n  tactile-infer bank --model infer/models/maze-small.safetensors \
                        --scene alphabet-small --out pegs.bank")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Embed the pegs of a dataset or a scene into one bank file, bound to the model.
    ///
    /// With --scene each part that is done is kept in the folder OUT.parts until the bank is written: a run that was ended
    /// goes on there when it is started again as before. It takes 1.3 MB of memory a part besides the rows in f32.
    #[command(
        after_help = "Examples:\n  tactile-infer bank --model model/model.safetensors --data pegs --out pegs.bank\n  \
                            tactile-infer bank --model infer/models/maze-small.safetensors --scene alphabet-small \
                            --xy-step-mm 2 --theta-step-deg 15 --out fine.bank"
    )]
    Bank(BankArgs),
    /// Match each hole touch of a dataset (or each peg touch) with the pegs of another: one touch, nearest neighbour.
    #[command(after_help = "Example:\n  tactile-infer match --model model/model.safetensors --pegs pegs --holes holes")]
    Match(MatchArgs),
    /// Embed pictures of touches: one row of numbers an image, of unit length.
    #[command(
        after_help = "Example:\n  tactile-infer embed touch.png --model model/model.safetensors --no-contact rest.png"
    )]
    Embed(embed::EmbedArgs),
    Align(align::AlignArgs),
    Calibrate(calibrate::CalibrateArgs),
    /// Store a model's weights in another format: another model, with banks of its own.
    #[command(
        after_help = "Example:\n  tactile-infer convert --model model.safetensors --weights f16 --out half.safetensors"
    )]
    Convert(convert::ConvertArgs),
    // For `cargo xtask bench` alone.
    /// How long the encoder takes: one image, and a batch of them.
    #[command(hide = true)]
    #[command(after_help = "Example:\n  tactile-infer speed --model infer/models/maze-small.safetensors")]
    Speed(speed::SpeedArgs),
}

/// The model, and where it is computed.
#[derive(Args)]
struct ModelArgs {
    /// Checkpoint written by tactile-train
    #[arg(long = "model", value_name = "FILE")]
    path: PathBuf,
    /// Where to compute: the CPU, an older CPU backend that is much slower, or a graphics card
    #[arg(long, value_name = "DEVICE", default_value_t, value_parser = device(), help_heading = "Machine")]
    device: DeviceKind,
}

impl ModelArgs {
    fn load(&self) -> Result<Model> {
        Model::load_on(&self.path, self.device)
    }
}

/// The parser of `--device`.
fn device() -> impl TypedValueParser<Value = DeviceKind> {
    PossibleValuesParser::new(DeviceKind::NAMES).try_map(|name| name.parse::<DeviceKind>())
}

/// The parser of a format of numbers.
fn precision(names: impl Into<PossibleValuesParser>) -> impl TypedValueParser<Value = Precision> {
    names.into().try_map(|name| name.parse::<Precision>())
}

/// The parser of `--side`.
fn side() -> impl TypedValueParser<Value = Side> {
    PossibleValuesParser::new(Side::NAMES).try_map(|name| name.parse::<Side>())
}

/// The parser of `--views`.
fn views() -> impl TypedValueParser<Value = Views> {
    PossibleValuesParser::new(Views::NAMES).try_map(|name| name.parse::<Views>())
}

/// The poses of a bank.
#[derive(Args)]
struct PosesArgs {
    /// Step of the bank's places in x and y, mm: recorded touches are resampled to it [default: as touched]
    #[arg(long, value_name = "MM", help_heading = "Poses")]
    xy_step_mm: Option<f64>,
    /// Step of the bank's angles, degrees [default: as touched]
    #[arg(long, value_name = "DEG", help_heading = "Poses")]
    theta_step_deg: Option<f64>,
    /// How far a recorded touch may lie from its place on the grid, mm
    #[arg(long, value_name = "MM", default_value_t = Tolerance::default().mm, help_heading = "Poses")]
    tolerance_mm: f64,
    /// The same, degrees
    #[arg(long, value_name = "DEG", default_value_t = Tolerance::default().deg, help_heading = "Poses")]
    tolerance_deg: f64,
}

impl PosesArgs {
    fn poses(&self) -> Result<BankPoses> {
        let tolerance = Tolerance { mm: self.tolerance_mm, deg: self.tolerance_deg };
        if !(tolerance.mm > 0.0 && tolerance.deg > 0.0 && tolerance.mm.is_finite() && tolerance.deg.is_finite()) {
            let got = format!("{} mm and {} degrees", tolerance.mm, tolerance.deg);
            return Err(Error::invalid("--tolerance-mm, --tolerance-deg", "numbers above 0", got));
        }
        match (self.xy_step_mm, self.theta_step_deg) {
            (Some(mm), Some(deg)) => Ok(BankPoses { resample: Some([mm, deg]), tolerance }),
            (None, None) => Ok(BankPoses { resample: None, tolerance }),
            _ => Err(Error::invalid("--xy-step-mm, --theta-step-deg", "both steps, to resample touches", "one")),
        }
    }
}

#[derive(Args)]
struct BankArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Dataset of pegs touched on a grid of poses, simulated or recorded; what was not recorded is unknown
    #[arg(long, value_name = "DIR", required_unless_present = "scene", conflicts_with = "scene")]
    data: Option<PathBuf>,
    /// Simulate the touches of a scene instead, and keep no dataset of them
    #[arg(long, value_name = "PRESET|FILE.toml")]
    scene: Option<String>,
    /// With --scene: simulate your sensor, as `tactile-data calibrate` measured it, instead of the scene's
    #[arg(long, value_name = "FILE.toml", requires = "scene")]
    calibration: Option<PathBuf>,
    /// With --scene: views of pegs alone, as a robot records them, or of both sides, with the holes that the scene says
    /// [default: both]
    #[arg(long, value_name = "VIEWS", requires = "scene", value_parser = views())]
    views: Option<Views>,
    /// The bank file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// A part feels the same after N turns, or is round; else its geometry tells, or of recorded touches their likeness
    #[arg(long = "symmetry", value_name = "PART=N|round", value_delimiter = ',')]
    symmetries: Vec<Declared>,
    /// Format of the bank's rows, on disk and in memory: 4, 2, 2 or 1 byte a value
    #[arg(long, value_name = "FORMAT", default_value_t = Precision::I8, value_parser = precision(Precision::ROWS))]
    rows: Precision,
    #[command(flatten)]
    poses: PosesArgs,
    /// With --scene: draws jitter and noise
    #[arg(long, default_value_t = 1, help_heading = "Poses")]
    seed: u64,
}

/// A symmetry that the user declares.
#[derive(Clone, Debug)]
struct Declared {
    part: String,
    /// `None`: round.
    order: Option<usize>,
}

impl FromStr for Declared {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (part, order) = text.rsplit_once('=').ok_or("expected PART=N or PART=round, as in --symmetry gear=12")?;
        let order = match order {
            "round" => None,
            number => match number.parse() {
                Ok(turns) if (1..=Symmetry::MAX_ORDER).contains(&turns) => Some(turns),
                _ => return Err(format!("expected 1 to {} turns or round, got {number}", Symmetry::MAX_ORDER)),
            },
        };
        Ok(Self { part: part.into(), order })
    }
}

#[derive(Args)]
struct MatchArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Dataset of pegs touched on a grid of poses, simulated or recorded
    #[arg(long, value_name = "DIR")]
    pegs: PathBuf,
    /// Dataset of touches whose part is known: holes, or with --side peg pegs
    #[arg(long, visible_alias = "touches", value_name = "DIR")]
    holes: PathBuf,
    /// Which side of it is matched; pegs of another dataset than --pegs, as each would find itself
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = side())]
    side: Side,
    /// Match at most this many touches, evenly spread over the dataset
    #[arg(long, value_name = "N", default_value_t = 500)]
    limit: usize,
    /// Format of the rows that are compared with
    #[arg(long, value_name = "FORMAT", default_value_t = Precision::F32, value_parser = precision(Precision::ROWS))]
    rows: Precision,
    #[command(flatten)]
    poses: PosesArgs,
    /// Print the result as JSON
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
            Command::Calibrate(args) => args.run(),
            Command::Convert(args) => args.run(),
            Command::Align(args) => args.run(),
            Command::Speed(args) => args.run(),
        }
    }
}

/// Parts whose holes match their own views by less than this are worth a word: letters do by 0.9, a stranger by 0.8.
const LOW_MATCH: f64 = 0.8;

fn bank(args: &BankArgs) -> Result<()> {
    let data_files = args.data.iter().flat_map(|data| FILES.map(|file| data.join(file)));
    let scene_file = args.scene.as_ref().map(PathBuf::from);
    let read = scene_file.into_iter().chain(args.calibration.clone()).chain([args.model.path.clone()]);
    output::prepare_file(&args.out, data_files.chain(read))?;
    let model = args.model.load()?;
    let declare = |bank: Bank, declared: &Declared| bank.with_declared(&declared.part, declared.order);
    let finish = |bank: Bank| -> Result<()> {
        let bank = args.symmetries.iter().try_fold(bank.with_precision(args.rows)?, declare)?;
        bank.save(&args.out)?;
        print_bank(&args.out, &bank);
        Ok(())
    };
    let Some(data) = &args.data else {
        let scene = touched_scene(args, &model)?;
        let job = SceneBank { model: &model, scene: &scene, views: args.views.unwrap_or(Views::Both), seed: args.seed };
        let kept = with_ending(&args.out, ".parts");
        finish(job.make(Some(&kept), &reporter("touches"))?)?;
        return job.forget(&kept);
    };
    let dataset = Dataset::open(data)?;
    check_declared(&args.symmetries, &parts_on_grid(&dataset, args.poses.poses()?)?)?;
    finish(embed_pegs(&model, &dataset, &args.poses)?)
}

/// A path with a few more letters.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(ending);
    path.into()
}

/// Says what a bank holds.
fn print_bank(path: &Path, bank: &Bank) {
    let (n_parts, n_poses) = (bank.parts().len(), bank.grid().len());
    println!(
        "{}: {n_parts} parts x {n_poses} poses = {} rows of {} {}, {:.1} MB in memory; views of {}",
        path.display(),
        bank.n_rows(),
        bank.dim(),
        bank.rows().precision(),
        bank.rows().n_bytes() as f64 / 1e6,
        if bank.views().is_pegs() { "pegs" } else { "pegs and their holes" }
    );
    let symmetric = |part: usize| {
        let name = &bank.parts()[part];
        match bank.symmetry(part).order {
            Some(1) => None,
            Some(order) => Some(format!("{name} after {:.0} degrees", 360.0 / order as f64)),
            None => Some(format!("{name} after any turn")),
        }
    };
    let symmetric: Vec<_> = (0..n_parts).filter_map(symmetric).collect();
    if !symmetric.is_empty() {
        println!("feels the same turned: {}", symmetric.join(", "));
    }
    for (part, name) in bank.parts().iter().enumerate() {
        if let Some(PartMatch { matched, .. }) =
            bank.matches().of(part, Side::Hole).filter(|of| of.matched.mean < LOW_MATCH)
        {
            let mean = matched.mean;
            eprintln!(
                "note: part {name}: touches of its hole hardly match its views (cosine {mean:.2} on average); often mistaken"
            );
        }
    }
}

/// Refuses a symmetry of a part that will not be there, before the work.
fn check_declared(declared: &[Declared], parts: &[String]) -> Result<()> {
    match declared.iter().find(|declared| !parts.contains(&declared.part)) {
        Some(odd) => {
            Err(Error::invalid("--symmetry", format!("one of the parts {}", parts.join(" ")), odd.part.clone()))
        }
        None => Ok(()),
    }
}

/// A bank of recorded pegs; what it lacks is said.
fn embed_pegs(model: &Model, pegs: &Dataset, poses: &PosesArgs) -> Result<Bank> {
    let recorded = bank_of_dataset(model, pegs, poses.poses()?, &reporter("pegs"))?;
    recorded.notes.iter().for_each(|note| eprintln!("note: {note}"));
    Ok(recorded.bank)
}

/// The scene whose parts are touched, at the poses that were asked for.
fn touched_scene(args: &BankArgs, model: &Model) -> Result<Scene> {
    /// A planned touch, without its row.
    const TOUCH_BYTES: usize = 64;
    let mut scene = Scene::load(args.scene.as_deref().unwrap_or_default())?;
    if let Some(path) = &args.calibration {
        scene = scene.under(&Calibration::load(path)?)?;
    }
    if let Some(reach) = &mut scene.reach {
        reach.xy_step_mm = args.poses.xy_step_mm.unwrap_or(reach.xy_step_mm);
        reach.theta_step_deg = args.poses.theta_step_deg.unwrap_or(reach.theta_step_deg);
    }
    scene.validate()?;
    check_declared(&args.symmetries, &scene.part_names())?;
    let n_rows = scene.part_names().len() * scene.reach.map_or(0, |reach| reach.len());
    let n_bytes = n_rows as f64 * (4 * model.dim() + TOUCH_BYTES) as f64;
    output::check_memory("--xy-step-mm and --theta-step-deg", format!("{n_rows} touches"), n_bytes)?;
    Ok(scene)
}

fn matches(args: &MatchArgs) -> Result<()> {
    if args.side == Side::Peg && same_folder(&args.pegs, &args.holes) {
        let got = args.holes.display().to_string();
        return Err(Error::invalid("--holes", "pegs of another dataset than --pegs: each would find itself", got));
    }
    let model = args.model.load()?;
    let (pegs, holes) = (Dataset::open(&args.pegs)?, Dataset::open(&args.holes)?);
    let bank = embed_pegs(&model, &pegs, &args.poses)?.with_precision(args.rows)?;
    let touched = Touched { dataset: &holes, side: args.side, limit: args.limit };
    let found = match_single_touches(&model, &bank, &pegs, touched)?;
    if args.json {
        return print_json(&found);
    }
    let side = args.side;
    println!("one touch, nearest neighbour among {} pegs, {} {side}s:", bank.n_rows(), found.moco.n_holes);
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
    println!("  99 in 100 {side}s with an edge reach cosine {:.2} with some peg", found.similarities.best_cosine_p01);
    Ok(())
}

/// Whether two paths lead to one folder.
fn same_folder(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}

/// Prints a result for programs.
fn print_json(result: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(result);
    println!("{}", text.map_err(|e| Error::invalid("result", "values JSON can hold", e.to_string()))?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn a_symmetry_is_a_number_of_turns_or_round() {
        let order = |text: &str| text.parse::<Declared>().map(|declared| (declared.part, declared.order));
        assert_eq!(order("gear=12"), Ok(("gear".into(), Some(12))));
        assert_eq!(order("a=b=round"), Ok(("a=b".into(), None)));
        for wrong in ["gear", "gear=0", "gear=37", "gear=-1", "gear=", "gear=square"] {
            assert!(order(wrong).unwrap_err().starts_with("expected"), "{wrong}");
        }
    }
}

//! The command line of `tactile-infer`.

mod align;
mod bank;
mod calibrate;
mod convert;
mod embed;
mod fit;
mod map;
mod matching;
mod mosaics;
mod speed;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::pose::grid_fit::Tolerance;
use tactile_data::program::progress::reporter;
use tactile_data::program::{self, named};
use tactile_data::text::printable::printable_json;
use tactile_infer::bank::Bank;
use tactile_infer::bank::recorded::{BankPoses, bank_of_dataset};
use tactile_infer::{DeviceKind, Error, Model, Result};

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
    Bank(bank::BankArgs),
    /// Match each hole touch of a dataset (or each peg touch) with the pegs of another: one touch, nearest neighbour.
    #[command(after_help = "Example:\n  tactile-infer match --model model/model.safetensors --pegs pegs --holes holes")]
    Match(matching::MatchArgs),
    /// Embed pictures of touches: one row of numbers an image, of unit length.
    #[command(
        after_help = "Example:\n  tactile-infer embed touch.png --model model/model.safetensors --no-contact rest.png"
    )]
    Embed(embed::EmbedArgs),
    /// Draw what a touch shows of its part: how far each place is from the outline of the peg, and what touches the gel.
    #[command(
        after_help = "Example:\n  tactile-infer map touch.png --maps maps/maps.safetensors --no-contact rest.png --out map.png"
    )]
    Map(map::MapArgs),
    Mosaics(mosaics::MosaicsArgs),
    Align(align::AlignArgs),
    Calibrate(calibrate::CalibrateArgs),
    Fit(fit::FitArgs),
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
    #[arg(long, value_name = "DEVICE", default_value_t, value_parser = named::<DeviceKind>(DeviceKind::NAMES), help_heading = "Machine")]
    device: DeviceKind,
}

impl ModelArgs {
    fn load(&self) -> Result<Model> {
        Model::load_on(&self.path, self.device)
    }
}

/// Reads `--tolerance`.
fn tolerance(text: &str) -> std::result::Result<Tolerance, String> {
    let read = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    let both = text.split_once(',').and_then(|(mm, deg)| Some(Tolerance { mm: read(mm)?, deg: read(deg)? }));
    both.ok_or_else(|| "expected two numbers above 0 with a comma between, such as 1,3".into())
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
    /// How far a recorded touch may be from its place on the grid, mm and degrees [default: 1,3]
    #[arg(long, value_name = "MM,DEG", value_parser = tolerance, help_heading = "Poses")]
    tolerance: Option<Tolerance>,
}

impl PosesArgs {
    fn poses(&self) -> Result<BankPoses> {
        let tolerance = self.tolerance.unwrap_or_default();
        match (self.xy_step_mm, self.theta_step_deg) {
            (Some(mm), Some(deg)) => Ok(BankPoses { resample: Some([mm, deg]), tolerance }),
            (None, None) => Ok(BankPoses { resample: None, tolerance }),
            _ => Err(Error::invalid("--xy-step-mm, --theta-step-deg", "both steps, to resample touches", "one")),
        }
    }
}

impl Cli {
    /// Does what was asked for.
    pub fn run(&self) -> Result<()> {
        match &self.command {
            Command::Embed(args) => args.run(),
            Command::Map(args) => args.run(),
            Command::Mosaics(args) => args.run(),
            Command::Bank(args) => args.run(),
            Command::Match(args) => args.run(),
            Command::Calibrate(args) => args.run(),
            Command::Fit(args) => args.run(),
            Command::Convert(args) => args.run(),
            Command::Align(args) => args.run(),
            Command::Speed(args) => args.run(),
        }
    }
}

/// A bank of recorded pegs; what it lacks is said.
fn embed_pegs(model: &Model, pegs: &Dataset, poses: &PosesArgs) -> Result<Bank> {
    let recorded = bank_of_dataset(model, pegs, poses.poses()?, &reporter("pegs"))?;
    recorded.notes.iter().for_each(program::note);
    Ok(recorded.bank)
}

/// Prints a result for programs.
fn print_json(result: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(result);
    let text = text.map_err(|e| Error::invalid("result", "values JSON can hold", e.to_string()))?;
    println!("{}", printable_json(&text));
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
    fn a_tolerance_is_two_numbers_above_zero() {
        assert_eq!(tolerance("0.5, 2"), Ok(Tolerance { mm: 0.5, deg: 2.0 }));
        for bad in ["1", "1,0", "-1,2", "1,inf", "1,2,3", ""] {
            assert!(tolerance(bad).is_err(), "{bad}");
        }
    }
}

//! The command line: one file a command.

mod calibrate;
mod compare;
mod export;
mod generate;
mod geometry;
mod import;
mod import_bag;
mod inspect;
mod lamp_table;
mod merge;
mod practice;
mod render;
mod speed;
mod validate;

use clap::{Parser, Subcommand};
use tactile_data::text::printable::printable_json;
use tactile_data::{Error, Result};

/// Make, import and inspect datasets of tactile frames, and compare simulated frames with real ones.
///
/// Exit codes: 0 done, 1 failed, 2 misused.
#[derive(Parser)]
#[command(name = "tactile-data", version)]
#[command(after_help = "Example:\n  tactile-data generate --scene alphabet-small --sides peg --out pegs\n  \
                        tactile-data inspect pegs --sheet pegs.png")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Generate(generate::Generate),
    Merge(merge::Merge),
    Calibrate(calibrate::Calibrate),
    BallPresses(practice::BallPresses),
    Render(render::Render),
    Compare(compare::Compare),
    Inspect(inspect::Inspect),
    Import(import::Import),
    Export(export::Export),
    #[command(hide = true)]
    Ring(validate::FindRing),
    #[command(hide = true)]
    Walls(validate::Walls),
    #[command(hide = true)]
    Speed(speed::Speed),
}

impl Cli {
    /// Runs the command that was asked for.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Generate(generate) => generate.run(),
            Command::Merge(merge) => merge.run(),
            Command::Calibrate(calibrate) => calibrate.run(),
            Command::BallPresses(presses) => presses.run(),
            Command::Render(render) => render.run(),
            Command::Compare(compare) => compare.run(),
            Command::Ring(ring) => ring.run(),
            Command::Walls(walls) => walls.run(),
            Command::Inspect(inspect) => inspect.run(),
            Command::Import(import) => import.run(),
            Command::Export(export) => export.run(),
            Command::Speed(speed) => speed.run(),
        }
    }
}

/// Reads a size such as `160x120`, pixels.
fn parse_size(text: &str) -> std::result::Result<[usize; 2], String> {
    let size = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    size.filter(|size| size.iter().all(|side| *side > 0)).ok_or_else(|| "expected WIDTHxHEIGHT, such as 160x120".into())
}

/// Reads numbers with commas between, such as `1.5,-2,30`.
fn parse_numbers<const N: usize>(text: &str) -> std::result::Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    let fits = numbers.and_then(|numbers| numbers.try_into().ok());
    fits.ok_or_else(|| format!("expected {N} numbers with commas between, such as {}", ["1.5"; N].join(",")))
}

/// Size of a pixel in x and y, mm, of frames that show `view_mm` along x and y.
fn mm_per_px(view_mm: &[f64], size_px: [usize; 2]) -> Result<[f64; 2]> {
    match view_mm {
        [x, y] if [x, y].iter().all(|mm| mm.is_finite() && **mm > 0.0) => {
            Ok([x / size_px[0] as f64, y / size_px[1] as f64])
        }
        _ => Err(Error::invalid("--field-of-view-mm", "two positive lengths", format!("{view_mm:?}"))),
    }
}

/// JSON for programs.
fn pretty(json: &impl serde::Serialize) -> Result<String> {
    let json = serde_json::to_string_pretty(json)
        .map_err(|e| Error::invalid("--json", "numbers that JSON can hold", e.to_string()))?;
    Ok(printable_json(&json).into_owned())
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
    fn numbers_are_as_many_as_are_asked_for_and_finite() {
        assert_eq!(parse_numbers("1.5, -2,30"), Ok([1.5, -2.0, 30.0]));
        for bad in ["1,2", "1,2,3,4", "1,2,x", "1,2,inf", ""] {
            assert!(parse_numbers::<3>(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_are_two_positive_numbers() {
        assert_eq!(parse_size("160x120"), Ok([160, 120]));
        for bad in ["160", "0x120", "160x", "160x-1", "x"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}

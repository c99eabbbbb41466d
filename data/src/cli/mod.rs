//! The command line: one file a command.

mod calibrate;
mod generate;
mod import;
mod inspect;
mod progress;
mod speed;

use clap::{Parser, Subcommand};
use tactile_data::Result;

/// Make, import and inspect datasets of tactile frames.
///
/// Exit codes: 0 done, 1 failed, 2 misused.
#[derive(Parser)]
#[command(name = "tactile-data", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Generate(generate::Generate),
    Calibrate(calibrate::Calibrate),
    Inspect(inspect::Inspect),
    Import(import::Import),
    Speed(speed::Speed),
}

impl Cli {
    /// Runs the command that was asked for.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Generate(generate) => generate.run(),
            Command::Calibrate(calibrate) => calibrate.run(),
            Command::Inspect(inspect) => inspect.run(),
            Command::Import(import) => import.run(),
            Command::Speed(speed) => speed.run(),
        }
    }
}

/// Reads a size such as `160x120`, pixels.
fn parse_size(text: &str) -> std::result::Result<[usize; 2], String> {
    let size = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    size.filter(|size| size.iter().all(|side| *side > 0)).ok_or_else(|| "expected WIDTHxHEIGHT, such as 160x120".into())
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
    fn sizes_are_two_positive_numbers() {
        assert_eq!(parse_size("160x120"), Ok([160, 120]));
        for bad in ["160", "0x120", "160x", "160x-1", "x"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}

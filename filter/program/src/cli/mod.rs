//! The command line: one file a command.

mod assemble;
mod budget;
mod evaluate;
mod extremes;
mod merge;
mod replay;
mod reproduction;
mod table;
mod tradeoff;
mod tuning;

use clap::{Parser, Subcommand};
use tactile_eval::Result;

/// Which peg fits this hole, and where the hole is, by touch alone.
///
/// Exit codes: 0 done, 1 failed, 2 misused.
#[derive(Parser)]
#[command(name = "tactile-filter", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Assemble(assemble::Assemble),
    Evaluate(evaluate::Evaluate),
    Extremes(extremes::ExtremesArgs),
    Merge(merge::Merge),
    Replay(replay::Replay),
    Reproduction(reproduction::Reproduction),
    Tradeoff(tradeoff::TradeoffArgs),
}

impl Cli {
    /// Runs the command that was asked for.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Assemble(assemble) => assemble.run(),
            Command::Evaluate(evaluate) => evaluate.run(),
            Command::Extremes(extremes) => extremes.run(),
            Command::Merge(merge) => merge.run(),
            Command::Replay(replay) => replay.run(),
            Command::Reproduction(reproduction) => reproduction.run(),
            Command::Tradeoff(tradeoff) => tradeoff.run(),
        }
    }
}

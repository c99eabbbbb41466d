//! The command line: one file a command.

mod arguments;
mod assemble;
mod budget;
mod evaluate;
mod extremes;
mod failure;
mod live;
mod merge;
mod replay;
mod reproduction;
mod robot;
mod ros;
mod simulated;
mod table;
mod tradeoff;
mod tuning;
mod watch;

use clap::{Parser, Subcommand};
use failure::Result;

/// Which peg fits this hole, and where the hole is, by touch alone.
///
/// Exit codes: 0 done, 1 failed, 2 misused.
#[derive(Parser)]
#[command(name = "tactile-filter", version)]
#[command(after_help = "Example:\n  tactile-infer bank --model infer/models/maze-small.safetensors \
                        --scene alphabet-small --out pegs.bank\n  \
                        tactile-filter evaluate --model infer/models/maze-small.safetensors --bank pegs.bank \
                        --scene alphabet-small --out evaluation")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Evaluate(Box<evaluate::Evaluate>),
    Live(Box<live::Live>),
    Replay(Box<replay::Replay>),
    Robot(robot::RobotArgs),
    Assemble(Box<assemble::Assemble>),
    Tradeoff(tradeoff::TradeoffArgs),
    Merge(merge::Merge),
    Watch(watch::Watch),
    // For `cargo xtask bench` and `cargo xtask reproduce` alone.
    #[command(hide = true)]
    Extremes(extremes::ExtremesArgs),
    #[command(hide = true)]
    Reproduction(reproduction::Reproduction),
}

impl Cli {
    /// Runs the command that was asked for.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Assemble(assemble) => Ok(assemble.run()?),
            Command::Evaluate(evaluate) => Ok(evaluate.run()?),
            Command::Extremes(extremes) => Ok(extremes.run()?),
            Command::Live(live) => live.run(),
            Command::Merge(merge) => Ok(merge.run()?),
            Command::Replay(replay) => replay.run(),
            Command::Robot(robot) => robot.run(),
            Command::Reproduction(reproduction) => Ok(reproduction.run()?),
            Command::Tradeoff(tradeoff) => Ok(tradeoff.run()?),
            Command::Watch(watch) => watch.run(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}

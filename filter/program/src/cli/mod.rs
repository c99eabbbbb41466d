//! The command line: one file a command.

mod arguments;
mod assemble;
mod budget;
mod by_hand;
mod certify;
mod evaluate;
mod failure;
mod label;
mod learn;
mod live;
mod merge;
mod numbers;
mod replay;
mod reproduction;
mod robot;
mod ros;
mod simulated;
mod table;
mod tradeoff;
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
    Certify(certify::Certify),
    Watch(watch::Watch),
    Try(by_hand::Try),
    // For `cargo xtask reproduce` alone.
    #[command(hide = true)]
    Reproduction(reproduction::Reproduction),
}

impl Cli {
    /// Runs the command that was asked for.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Assemble(assemble) => Ok(assemble.run()?),
            Command::Certify(certify) => Ok(certify.run()?),
            Command::Evaluate(evaluate) => Ok(evaluate.run()?),
            Command::Live(live) => live.run(),
            Command::Merge(merge) => Ok(merge.run()?),
            Command::Replay(replay) => replay.run(),
            Command::Robot(robot) => robot.run(),
            Command::Reproduction(reproduction) => Ok(reproduction.run()?),
            Command::Tradeoff(tradeoff) => Ok(tradeoff.run()?),
            Command::Watch(watch) => watch.run(),
            Command::Try(by_hand) => by_hand.run(),
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

    /// What clap says of a command line; nothing where it takes it.
    fn refusal(line: &str) -> Option<String> {
        Cli::try_parse_from(line.split_whitespace()).err().map(|error| error.to_string())
    }

    #[test]
    fn a_flag_that_a_command_would_not_look_at_is_refused() {
        let evaluate = "tactile-filter evaluate --model m --bank b --out o";
        let replay = "tactile-filter replay --model m --bank b";
        let assemble = "tactile-filter assemble --model m --bank b --scene s --out o";
        let live = "tactile-filter live --model m --bank b";
        for line in [
            format!("{evaluate} --scene s --set n_draws=8 --set n_particles=9 --engines particle"),
            format!(
                "{replay} --data d --set temperature=0.1 --set subdivisions=1 --engine particle --set n_particles=9 --side peg"
            ),
            format!("{replay} --log l --json --device flex"),
            format!("{assemble} --set n_draws=8 --set temperature=0.1 --other-sensor"),
            format!("{live} --simulate s --episodes 2 --seed 3 --rate-hz 9 --jpeg 90 --faults dropped=0.1"),
            "tactile-filter robot --scene s --episodes 2 --jpeg 90".into(),
            "tactile-filter watch --ros --node /n".into(),
        ] {
            assert_eq!(refusal(&line), None, "{line}");
        }
        let of_replay =
            ["--other-sensor", "--frontier rough", "--engine exact --budget ms=1", "--budget gb=1", "--set n_draws"];
        let of_log = ["--side peg", "--limit 3", "--engine exact", "--budget ms=4", "--set max_touches=3", "--data d"];
        let of_log = of_log.into_iter().chain(["--set temperature=0.1"]);
        let of_robot = ["--episodes 2", "--seed 3", "--rate-hz 9", "--jpeg 90", "--faults dropped=0.1"];
        let lines = of_replay.into_iter().map(|flag| format!("{replay} --data d {flag}"));
        let lines = lines.chain(of_log.map(|flag| format!("{replay} --log l {flag}")));
        let lines = lines.chain(of_robot.map(|flag| format!("{live} --watch w {flag}")));
        let more = [
            format!("{assemble} --set 9"),
            format!("{evaluate} --scene s --frontier f"),
            format!("{evaluate} --scene s --json --shard 1/2"),
            "tactile-filter tradeoff --model m --out o --shard 1/2 --json".into(),
            "tactile-filter watch --log l --node /n".into(),
            "tactile-filter watch --log l --ros-args -r a:=b".into(),
            format!("{live} --simulate s --once"),
            format!("{live} --watch w --commands c"),
            format!("{live} --ros --fast"),
            format!("{live} --simulate s --ros-args -r a:=b"),
        ];
        for line in lines.chain(more) {
            assert!(refusal(&line).is_some(), "{line}");
        }
    }
}

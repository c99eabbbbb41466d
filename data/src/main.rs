//! `tactile-data`: makes, imports and inspects datasets of tactile frames.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    tactile_data::program::run(|| cli.run())
}

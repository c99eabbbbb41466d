//! `tactile-filter`: evaluates the filter over simulated holes, and plays recordings back through it.

mod cli;
mod page;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    tactile_data::program::run(|| cli.run())
}

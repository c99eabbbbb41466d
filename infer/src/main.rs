//! `tactile-infer`: embeds touches, builds the bank of peg embeddings, and matches single touches against it.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    tactile_data::program::run(|| cli.run())
}

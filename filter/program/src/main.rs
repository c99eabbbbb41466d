//! `tactile-filter`: evaluates the filter over simulated holes, and plays recordings back through it.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    tactile_data::closed_output::fail_in_one_line();
    match cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

//! How fast the programs are and how exact, measured from outside.

mod extremes;
mod sensor;

use std::path::PathBuf;

use clap::Subcommand;

use crate::error::Result;
use crate::workspace::Workspace;

/// What to measure.
#[derive(Subcommand)]
pub enum Bench {
    /// The simulated sensor: images a second at 320x240 with everything on.
    #[command(after_help = "Example:\n  cargo xtask bench sensor --pairs 1000")]
    Sensor {
        /// Pairs to simulate, two images each, on one board for every 150 as in the `maze` preset.
        #[arg(long, default_value_t = 1000)]
        pairs: usize,
        /// Seed of the boards and touches.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// The filter's arithmetic at its extremes, beside an f64 reference, and the time of an update.
    #[command(after_help = "Example:\n  cargo xtask bench extremes --out extremes")]
    Extremes {
        /// Folder for extremes.json and extremes.html.
        #[arg(long, default_value = "extremes")]
        out: PathBuf,
        /// Smaller largest cases.
        #[arg(long)]
        quick: bool,
        /// Seed of the banks and touches.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
}

/// Builds the programs and measures.
pub fn bench(workspace: &Workspace, bench: &Bench) -> Result<()> {
    workspace.build()?;
    match bench {
        Bench::Sensor { pairs, seed } => sensor::sensor(workspace, *pairs, *seed),
        Bench::Extremes { out, quick, seed } => extremes::extremes(workspace, out, *quick, *seed),
    }
}

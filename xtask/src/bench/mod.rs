//! How fast and how sound the programs are, measured from outside.

mod sensor;

use clap::Subcommand;

use crate::error::Result;
use crate::workspace::Workspace;

/// What to measure.
#[derive(Subcommand)]
pub enum Bench {
    /// The simulated sensor: images a second of each tier, and what training on each tier gives.
    #[command(after_help = "Examples:\n  cargo xtask bench sensor\n  cargo xtask bench sensor --train-steps 200")]
    Sensor(sensor::SensorArgs),
}

/// Builds the programs and measures.
pub fn bench(workspace: &Workspace, bench: &Bench) -> Result<()> {
    workspace.build()?;
    match bench {
        Bench::Sensor(args) => sensor::sensor(workspace, args),
    }
}

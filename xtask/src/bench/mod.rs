//! How fast and how sound the programs are, measured from outside.

mod card;
mod decision;
mod runtimes;
mod sensor;
mod table;
mod training;
mod twin;

use clap::Subcommand;

use crate::error::Result;
use crate::workspace::Workspace;

/// What to measure.
#[derive(Subcommand)]
pub enum Bench {
    /// The simulated sensor: images a second of each tier, and what training on each tier gives.
    #[command(after_help = "Examples:\n  cargo xtask bench sensor\n  cargo xtask bench sensor --train-steps 200")]
    Sensor(sensor::SensorArgs),
    /// Our training step and encoder next to PyTorch's: same network, same batch, in turns. Needs Python 3 and PyPI.
    #[command(after_help = "Example:\n  cargo xtask bench training")]
    Training,
    /// Seconds of training until one touch names nine in ten of the tuning letters, ours and PyTorch's from the same first
    /// weights on the same batches, in turns. Needs Python 3.11 and PyPI.
    #[command(after_help = "Example:\n  cargo xtask bench twin --seeds 1,2,3")]
    Twin(twin::TwinArgs),
    /// Our training step on a graphics card next to PyTorch's on the same card, batch by batch. Needs Python 3 with PyTorch for
    /// the card.
    #[command(
        after_help = "Examples:\n  cargo xtask bench card --python python3\n  cargo xtask bench card --ours-alone"
    )]
    Card(card::CardArgs),
    /// The encoder on one core next to ONNX Runtime and tract: same network, in turns. Needs Python 3 and PyPI.
    #[command(after_help = "Example:\n  cargo xtask bench runtimes")]
    Runtimes,
    /// Whole decisions on one core: what they take, and whether a budget's promise is kept.
    #[command(after_help = "Example:\n  cargo xtask bench decision")]
    Decision(decision::DecisionArgs),
}

/// Builds the programs and measures.
pub fn bench(workspace: &Workspace, bench: &Bench) -> Result<()> {
    if let Bench::Card(args) = bench {
        return card::card(workspace, args); // builds the programs for graphics cards
    }
    workspace.build()?;
    match bench {
        Bench::Card(_) => Ok(()),
        Bench::Sensor(args) => sensor::sensor(workspace, args),
        Bench::Training => training::training(workspace),
        Bench::Runtimes => runtimes::runtimes(workspace),
        Bench::Twin(args) => twin::twin(workspace, args),
        Bench::Decision(args) => decision::decision(workspace, args),
    }
}

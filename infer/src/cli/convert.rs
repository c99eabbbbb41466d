//! `tactile-infer convert`: a model's weights in another format.

use std::path::PathBuf;

use clap::Args;
use tactile_data::file::output;
use tactile_data::program::{self, named};
use tactile_infer::embedding::checkpoint::Checkpoint;
use tactile_infer::{Error, Precision, Result};

#[derive(Args)]
pub struct ConvertArgs {
    /// Checkpoint to convert
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Format of the weights in the new file; the network computes in f32 in any case
    #[arg(long, value_name = "FORMAT", value_parser = named::<Precision>(Precision::WEIGHTS))]
    weights: Precision,
    /// The checkpoint to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl ConvertArgs {
    /// Converts, writes and prints the size of the result.
    pub fn run(&self) -> Result<()> {
        let weights = self.weights;
        let _lock = output::prepare_file(&self.out, [&self.model])?;
        let (checkpoint, _) = Checkpoint::load(&self.model)?;
        let path = |error: Error| error.within(self.model.display());
        let sha256 = checkpoint.with_weights(weights).map_err(path)?.save(&self.out)?;
        let size = std::fs::metadata(&self.out).map_err(Error::io(&self.out))?.len();
        let (out, megabytes) = (self.out.display(), size as f64 / 1e6);
        program::say(format_args!("{out}: weights {weights}, {megabytes:.2} MB, model {sha256:.12}"));
        println!("  it needs banks of its own: make them again with `tactile-infer bank`");
        Ok(())
    }
}

//! `tactile-infer convert`: a model's weights in another format.

use std::path::PathBuf;

use clap::Args;
use tactile_infer::checkpoint::Checkpoint;
use tactile_infer::{Error, Precision, Result};

#[derive(Args)]
pub struct ConvertArgs {
    /// Checkpoint to convert.
    #[arg(long)]
    model: PathBuf,
    /// Format of the weights in the new file; computing stays f32.
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(Precision::WEIGHTS))]
    weights: String,
    /// The checkpoint to write.
    #[arg(long)]
    out: PathBuf,
}

impl ConvertArgs {
    /// Converts, writes and says what it came to.
    pub fn run(&self) -> Result<()> {
        let weights = self.weights.parse()?;
        let (checkpoint, _) = Checkpoint::load(&self.model)?;
        let path = |error: Error| error.within(self.model.display());
        let sha256 = checkpoint.with_weights(weights).map_err(path)?.save(&self.out)?;
        let size = std::fs::metadata(&self.out).map_err(Error::io(&self.out))?.len();
        println!("{}: weights {weights}, {:.2} MB, model {sha256:.12}", self.out.display(), size as f64 / 1e6);
        println!("  its banks are its own: make them again with `tactile-infer bank`");
        Ok(())
    }
}

//! `tactile-data merge`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::Result;
use tactile_data::dataset::dataset_merge::merge;
use tactile_data::program;
use tactile_data::program::progress;

/// Join the shards of a dataset, given in any order, into the dataset that a single run would write.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data merge maze-1 maze-2 maze-3 maze-4 --out maze")]
pub struct Merge {
    /// All shards of one job, each once
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<PathBuf>,
    /// The dataset to write; must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Merge {
    /// Checks that all shards are there, and copies them one after the other.
    pub fn run(self) -> Result<()> {
        let n_frames = merge(&self.shards, &self.out, &progress::reporter("frames"))?;
        program::say(format_args!("{n_frames} frames of {} shards in {}", self.shards.len(), self.out.display()));
        Ok(())
    }
}

//! `tactile-filter merge`.

use std::path::{Path, PathBuf};

use clap::Args;
use tactile_eval::episodes::Episodes;
use tactile_eval::narrative::Board;
use tactile_eval::{Error, Result};

use super::arguments::Output;
use super::evaluate;

/// Make one evaluation of the shards that tactile-filter evaluate --shard wrote.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter evaluate ... --shard 1/2 --out evaluation\n  \
                        tactile-filter evaluate ... --shard 2/2 --out evaluation\n  \
                        tactile-filter merge evaluation --out evaluation")]
pub struct Merge {
    /// Folders of shards, or single ones
    #[arg(required = true, value_name = "SHARD|DIR")]
    shards: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
}

impl Merge {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let files = self.shards.iter().map(|path| shards_at(path)).collect::<Result<Vec<_>>>()?.concat();
        let episodes = merged(&files)?;
        let _locks = evaluate::prepare(&self.output, &files.iter().map(PathBuf::as_path).collect::<Vec<&Path>>())?;
        // Single episodes are shown where the frames are, by a run that is not cut into shards.
        evaluate::write(&self.output, &episodes, &episodes.evaluation()?, &Board::empty(), &[])
    }
}

/// A shard, or those of a folder.
pub fn shards_at(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(Error::io(path))? {
        let name = entry.map_err(Error::io(path))?.file_name();
        let is_shard = name.to_str().is_some_and(|name| name.starts_with("shard-") && name.ends_with(".json"));
        files.extend(is_shard.then(|| path.join(name)));
    }
    if files.is_empty() {
        return Err(Error::invalid(path.display().to_string(), "shard-I-of-N.json files", "none"));
    }
    Ok(files)
}

/// The evaluation that shards make together.
pub fn merged(files: &[PathBuf]) -> Result<Episodes> {
    Episodes::merge(files.iter().map(|path| Ok((path.clone(), Episodes::load(path)?))).collect::<Result<_>>()?)
}

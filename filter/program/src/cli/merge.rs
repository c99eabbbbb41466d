//! `tactile-filter merge`.

use std::path::PathBuf;

use clap::Args;
use tactile_eval::episodes::Episodes;
use tactile_eval::narrative::Board;
use tactile_eval::{Error, Result};

use super::{evaluate, table};

/// Make one evaluation of the shards that tactile-filter evaluate --shard wrote.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-filter evaluate ... --shard 1/2 --out evaluation\n  tactile-filter evaluate ... --shard 2/2 --out evaluation\n  tactile-filter merge evaluation --out evaluation"
)]
pub struct Merge {
    /// Folders of shards, or single ones.
    #[arg(required = true)]
    shards: Vec<PathBuf>,
    /// Folder for evaluation.json and report.html.
    #[arg(long)]
    out: PathBuf,
    /// Print evaluation.json instead of a table.
    #[arg(long)]
    json: bool,
}

impl Merge {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let mut shards = Vec::new();
        for path in self.files()? {
            shards.push((path.clone(), Episodes::load(&path)?));
        }
        let episodes = Episodes::merge(shards)?;
        let evaluation = episodes.evaluation()?;
        // Episodes are shown touch by touch where the frames are, by a single run.
        evaluate::write(&self.out, &evaluation, &Board::empty(), &[])?;
        if self.json {
            println!("{}", evaluate::to_json(&evaluation)?);
        } else {
            table::print(&evaluation, &episodes.single_rows(true));
            println!("  {}", self.out.join("report.html").display());
        }
        Ok(())
    }

    /// The shards named, and those in the folders named.
    fn files(&self) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for path in &self.shards {
            if !path.is_dir() {
                files.push(path.clone());
                continue;
            }
            let before = files.len();
            for entry in std::fs::read_dir(path).map_err(Error::io(path))? {
                let name = entry.map_err(Error::io(path))?.file_name();
                let is_shard = name.to_str().is_some_and(|name| name.starts_with("shard-") && name.ends_with(".json"));
                files.extend(is_shard.then(|| path.join(name)));
            }
            if files.len() == before {
                return Err(Error::invalid(path.display().to_string(), "shard-I-of-N.json files", "none"));
            }
        }
        Ok(files)
    }
}

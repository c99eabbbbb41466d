//! `tactile-filter reproduction`.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use tactile_eval::page::shell::write_page;
use tactile_eval::reproduction;
use tactile_eval::{Error, Result};

/// Make one page of the paper's tables and figures, ours beside them, from what cargo xtask reproduce left.
///
/// Prints what each table comes to. What is missing from the folder is told as not run.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter reproduction reproduction --out reproduction/reproduction.html")]
pub struct Reproduction {
    /// Folder with small/evaluation.json, large/, connectors/, assembly/, tradeoff/, reproduce.json and the others.
    folder: PathBuf,
    /// The page; links to the reports in the folder are relative to it.
    #[arg(long)]
    out: PathBuf,
}

impl Reproduction {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let beside = self.out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(beside).map_err(Error::io(beside))?;
        let found = reproduction::Reproduction::load(&self.folder, &self.out)?;
        write_page(&self.out, &reproduction::html(&found))?;
        reproduction::summary(&found).iter().for_each(|line| println!("{line}"));
        println!("  {}", self.out.display());
        Ok(())
    }
}

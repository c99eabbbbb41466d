//! `tactile-filter reproduction`.

use std::path::{Path, PathBuf};

use clap::Args;
use tactile_data::file::output;
use tactile_data::program;
use tactile_eval::Result;
use tactile_eval::page::shell::{check_page, write_page};
use tactile_eval::reproduction;
use tactile_infer::safefile::write_whole;

use super::arguments::to_json;

/// Make one page of the paper's tables and figures, with ours next to them, from what cargo xtask reproduce left.
///
/// Prints what each table comes to. What is missing from the folder is shown as not run. Where sensors were compared
/// their table is written as sensors.json, and README's picture as touches.svg, next to the page.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter reproduction reproduction --out reproduction/reproduction.html")]
pub struct Reproduction {
    /// Folder with small/evaluation.json, large/, connectors/, assembly/, tradeoff/, reproduce.json and the others
    folder: PathBuf,
    /// The page; links to the reports in the folder are relative to it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Reproduction {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let _lock = output::prepare_file(&self.out, [] as [&Path; 0])?;
        check_page(&self.out)?;
        let found = reproduction::Reproduction::load(&self.folder, &self.out)?;
        write_page(&self.out, &reproduction::html(&found))?;
        if let Some(table) = reproduction::sensor_table(&found) {
            let json = to_json("sensors", &table)?;
            write_whole(&self.out.with_file_name("sensors.json"), json.as_bytes())?;
        }
        if let Some(picture) = reproduction::picture(&found) {
            write_whole(&self.out.with_file_name("touches.svg"), picture.as_bytes())?;
        }
        reproduction::summary(&found).iter().for_each(program::say);
        program::say(format_args!("  {}", self.out.display()));
        Ok(())
    }
}

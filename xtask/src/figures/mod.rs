//! `cargo xtask figures`: the figures of the documents' tables, from the results of `cargo xtask reproduce` into
//! `figures.json`, and from there into the documents.

mod collect;
pub mod document;
mod file;
pub mod model;
pub mod table;

use std::path::{Path, PathBuf};

use clap::Args;

pub use file::{Evaluated, FILE, Figures};

use crate::error::Result;
use crate::experiments::Experiments;
use crate::workspace::Workspace;

/// What `cargo xtask figures` takes.
#[derive(Args)]
pub struct FiguresArgs {
    /// Take the figures from this folder, which `cargo xtask reproduce` made with all episodes; evaluations that it lacks keep
    /// their figures [default: all figures of figures.json]
    #[arg(long)]
    from: Option<PathBuf>,
}

/// Takes the figures from a folder where there is one, and writes the documents' tables.
pub fn figures(workspace: &Workspace, args: &FiguresArgs) -> Result<()> {
    match &args.from {
        Some(folder) => remake(workspace, folder),
        None => document::write_all(workspace, &Experiments::read(workspace)?, &Figures::read(workspace)?),
    }
}

/// Takes the figures of a whole run, where that is what was run.
pub fn after(workspace: &Workspace, whole: Option<&Path>) -> Result<()> {
    match whole {
        Some(folder) => remake(workspace, folder),
        None => {
            println!("{FILE} stays as it is: it has figures of whole runs with the shipped model only");
            Ok(())
        }
    }
}

/// Makes `figures.json` of a folder that `cargo xtask reproduce` made, with as many episodes as a whole run, and the documents'
/// tables of that. Evaluations that the folder lacks stay as they are, and are counted.
fn remake(workspace: &Workspace, folder: &Path) -> Result<()> {
    let experiments = Experiments::read(workspace)?;
    // A file that is damaged is an error: what it held would be lost.
    let is_there = workspace.root.join(FILE).exists();
    let before = if is_there { Figures::read(workspace)?.evaluations } else { Default::default() };
    let figures = collect::collect(workspace, &experiments, folder, &before)?;
    figures.write(workspace)?;
    let n_kept = figures.evaluations.iter().filter(|(name, of)| before.get(*name) == Some(of)).count();
    println!("{FILE}: {} evaluations, {n_kept} as before", figures.evaluations.len());
    document::write_all(workspace, &experiments, &figures)
}

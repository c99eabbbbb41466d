//! The paper's tables and figures, ours beside them, as one page: what `cargo xtask reproduce` left in a folder.
//!
//! [`Reproduction::load`] reads the folder, [`html`] makes the page, [`summary`] says it in a line a table. What is
//! missing from the folder is told as not run.

mod assembly;
mod cell;
mod classes;
mod folder;
mod hard;
mod informed;
mod page;
mod robust;
mod speed;
mod steps;
mod strangers;
mod tables;

pub use folder::{Reproduction, Step};
pub use page::{html, summary};

use super::report::shell::Section;

/// A section of the page with what it comes to, in a line for a terminal.
struct Told {
    section: Section,
    line: String,
}

impl Told {
    /// A section that tells `line` and stands under `short` in the contents.
    fn new(short: &str, title: &str, body: String, line: impl Into<String>) -> Self {
        Self { section: Section::new(short, title, body), line: line.into() }
    }

    /// A section of which nothing was measured; `name` is what would be in the folder.
    fn not_run(short: &str, title: &str, name: &str) -> Self {
        Self::new(short, title, folder::not_run(name), format!("{short}: not run"))
    }
}

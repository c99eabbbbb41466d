//! A section of the page with its line for a terminal.

use maud::{Markup, html};

use super::experiments::Section;
use crate::page::numbers::seeds;
use crate::page::shell;
use crate::result::Evaluation;

/// A section and what it comes to.
pub struct Finding {
    /// The section.
    pub section: shell::Section,
    /// In a line for a terminal.
    pub line: String,
}

impl Finding {
    /// A section that comes to `line`.
    pub fn new(of: &Section, body: Markup, line: &str) -> Self {
        let section = shell::Section::new(&of.short, &of.title, body);
        Self { section, line: format!("{}: {line}", of.short) }
    }

    /// A section of which nothing was measured; `missing` says so.
    pub fn missing(of: &Section, missing: Markup) -> Self {
        Self::new(of, missing, "not run")
    }

    /// A section of which nothing was measured; `name` is what would be in the folder.
    pub fn not_run(of: &Section, name: &str) -> Self {
        Self::missing(of, not_run(name))
    }
}

/// What is shown where a result is missing; `name` is its folder.
pub fn not_run(name: &str) -> Markup {
    html! { p.note { "Not run: " code { (name) "/" } " is not there." } }
}

/// How many episodes are behind an evaluation, and of which seeds.
pub fn made_of(evaluation: &Evaluation) -> String {
    format!("{} episodes, {}.", evaluation.n_episodes, seeds(&evaluation.seeds))
}

/// Whether an aim was met, in words.
pub fn met(is_met: bool) -> &'static str {
    if is_met { "met" } else { "not met" }
}

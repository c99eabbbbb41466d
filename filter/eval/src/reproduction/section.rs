//! A section of the page with its line for a terminal.

use maud::{Markup, html};

use crate::page::numbers::seeds;
use crate::page::shell::Section;
use crate::result::Evaluation;

/// A section and what it comes to.
pub struct Finding {
    /// The section.
    pub section: Section,
    /// In a line for a terminal.
    pub line: String,
}

impl Finding {
    /// A section that comes to `line`, under `short` in the contents.
    pub fn new(short: &str, title: &str, body: Markup, line: &str) -> Self {
        Self { section: Section::new(short, title, body), line: format!("{short}: {line}") }
    }

    /// A section of which nothing was measured; `missing` says so.
    pub fn missing(short: &str, title: &str, missing: Markup) -> Self {
        Self::new(short, title, missing, "not run")
    }

    /// A section of which nothing was measured; `name` is what would be in the folder.
    pub fn not_run(short: &str, title: &str, name: &str) -> Self {
        Self::missing(short, title, not_run(name))
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

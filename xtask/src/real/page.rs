//! The report as one HTML page.

use maud::html;

use super::bench::Bench;
use super::{SCOPE, Set};
use crate::page::page;

const TITLE: &str = "Real presses, named among simulated parts";

/// Draws the page.
pub fn draw(sets: &[Set], bench: &Bench<'_>) -> String {
    let model = bench.model.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let body = html! {
        div.scroll { table {
            thead { tr { th { "what" } th { "how it came out" } } }
            tbody {
                @for set in sets {
                    tr.set { th colspan="2" { (set.title) } }
                    @for [what, measured] in set.lines() { tr { td { (what) } td { (measured) } } }
                }
            }
        } }
        p.note {
            "Confident: a part is more probable than 95 % and explains the touches, as a robot would stop. Unsure: the "
            "presses ended first. Model: " (model) ". Made by " code { "cargo xtask real" }
            ", which prints each command that it runs."
        }
        @for Set { title, source: [repository, licence], about, .. } in sets {
            h2 { (title) }
            p { (about) }
            p.note { "Real images: " a href=(repository) { (repository) } ". Licence: " (licence) "." }
        }
    };
    page(TITLE, ["What is real here, and what simulated.", SCOPE], &body)
}

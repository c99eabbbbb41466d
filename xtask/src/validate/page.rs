//! The report as one HTML page.

use std::fs;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use maud::{Markup, html};

use super::{Picture, Row, SCOPE, Set, Source, Verdict};
use crate::error::{Error, Result};
use crate::page::page;

const TITLE: &str = "The simulated sensor against real images";

/// Draws the page, its pictures within.
pub fn draw(sets: &[Set]) -> Result<String> {
    let sections = sets.iter().filter(|set| !set.about.is_empty()).map(section).collect::<Result<Vec<_>>>()?;
    let body = html! {
        div.scroll { table {
            thead { tr { th { "what" } th { "target" } th { "measured" } th {} } }
            tbody { @for set in sets { (group(set)) } }
        } }
        p.note {
            "Pictures of two rows: real, simulated, and how what they change differs; below what the press "
            "changed really, what it changes simulated, and white the pixels compared. Changes are amplified "
            "on mid-grey. Similarity over whole frames is not reported: a bare background scores 0.94 to "
            "0.96 there. Made by " code { "cargo xtask validate" } ", which prints each command that it runs."
        }
        @for section in sections { (section) }
    };
    Ok(page(TITLE, ["What this shows, and what not.", SCOPE], &body))
}

/// The rows of a set, under its title.
fn group(set: &Set) -> Markup {
    html! {
        tr.set { th colspan="4" { (set.title) } }
        @for Row { what, target, measured, verdict } in &set.rows {
            tr {
                td { (what) } td { (target) } td { (measured) }
                td class=(verdict.words().replace(' ', "-")) {
                    @if *verdict != Verdict::Missing { (verdict.words()) }
                }
            }
        }
    }
}

/// What was done with a set, where it comes from, and its pictures.
fn section(set: &Set) -> Result<Markup> {
    let figures = set.pictures.iter().map(figure).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        h2 { (set.title) }
        p { (set.about) }
        @if let Some(Source { repository, path, licence }) = &set.source {
            p.note {
                "Real images: " a href=(repository) { (repository) }
                @if let Some(path) = path { ", " code { (path) } }
                ", at a commit that was not recorded. Licence: " (licence) "."
            }
        }
        @if !figures.is_empty() { div.pictures { @for figure in figures { (figure) } } }
    })
}

fn figure(Picture { path, caption }: &Picture) -> Result<Markup> {
    let png = BASE64_STANDARD.encode(fs::read(path).map_err(Error::io(path))?);
    Ok(html! {
        figure {
            img alt=(caption) src={ "data:image/png;base64," (png) };
            figcaption { (caption) }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_what_it_does_not_show_where_images_come_from_and_each_row() {
        let row = Row { what: "a < b", target: "3", measured: "2".into(), verdict: Verdict::Met };
        let source = Source { repository: "https://a.org/b", path: Some("c/d"), licence: "MIT" };
        let set =
            Set { title: "Set", source: Some(source), about: "About.".into(), rows: vec![row], pictures: Vec::new() };
        let page = draw(&[set]).unwrap();
        assert!(page.contains(SCOPE) && page.contains("Licence: MIT.") && page.contains("<code>c/d</code>"));
        assert!(page.contains("<td>a &lt; b</td><td>3</td><td>2</td><td class=\"met\">met</td>"));
    }
}

//! A whole page: its head, its contents, its sections. Every page of this crate is made and written here.

use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use tactile_data::file::bounded_file::{self, Kind};
use tactile_infer::safefile::write_whole;

use crate::error::{Error, Result};

/// What names this crate in the head of its pages.
const GENERATOR: &str = "tactile-eval";

/// What a page of this crate contains: the first now, the second before there was a generator tag.
const OURS: [&str; 2] = [r#"<meta name="generator" content="tactile-eval">"#, "<title>Tactile-Filter"];

/// A part of a page with its own entry in the contents.
#[derive(Clone, Debug)]
pub struct Section {
    short: String,
    title: String,
    body: Markup,
}

impl Section {
    /// `short` is the entry in the contents and names the anchor, `title` is the heading; two sections of a page have
    /// different `short`.
    pub fn new(short: impl Into<String>, title: impl Into<String>, body: Markup) -> Self {
        Self { short: short.into(), title: title.into(), body }
    }
}

impl Render for Section {
    fn render(&self) -> Markup {
        html! { section id=(anchor(&self.short)) { h2 { (self.title) } (self.body) } }
    }
}

/// The name of a place in the page that is called `text`: its letters and digits, words joined by hyphens.
pub fn anchor(text: &str) -> String {
    let words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect::<Vec<_>>().join("-")
}

/// A page that needs nothing else: no network, light and dark, a screen of any width or a printer; it reads well
/// without its script.
///
/// `title` is for the window; `top` comes before the contents and has the page's `h1`.
pub fn page(title: &str, top: &Markup, sections: &[Section]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="generator" content=(GENERATOR);
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body {
                (top)
                nav.contents aria-label="Contents" {
                    @for Section { short, .. } in sections { a href={ "#" (anchor(short)) } { (short) } }
                }
                @for section in sections { (section) }
                script { (PreEscaped(include_str!("page.js"))) }
            }
        }
    };
    page.into_string()
}

/// A key figure with what it is.
pub fn tile(figure: impl Render, what: impl Render) -> Markup {
    html! { div.tile { b { (figure) } (what) } }
}

/// A figure of the page, and how to read it.
pub fn figure(content: impl Render, caption: impl Render) -> Markup {
    html! { figure { (content) figcaption { (caption) } } }
}

/// A list of names with what each is.
pub fn definitions(entries: &[(&str, Markup)]) -> Markup {
    html! { dl { @for (name, what) in entries { dt { (name) } dd { (what) } } } }
}

/// Checks that a page may be written at a path: nothing is there, or a page of this crate.
///
/// # Errors
/// Another file, or one that cannot be read.
pub fn check_page(path: &Path) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let there = String::from_utf8_lossy(&bounded_file::read(path, Kind::PAGE)?).into_owned();
    if OURS.iter().any(|ours| there.contains(ours)) {
        return Ok(());
    }
    let expected = "no file, or an earlier page of this program, which is replaced";
    Err(Error::invalid(path.display().to_string(), expected, "another file"))
}

/// Writes a page, whole or not at all, making its folder.
///
/// # Errors
/// As [`check_page`], and a place where nothing can be written.
pub fn write_page(path: &Path, page: &str) -> Result<()> {
    check_page(path)?;
    Ok(write_whole(path, page.as_bytes())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn each_entry_of_the_contents_leads_to_its_section() {
        let sections = ["What’s new?", "A & B", "Time, ms"].map(|short| Section::new(short, "T < U", html! { p {} }));
        let html = page("a < b", &html! { h1 { "H" } }, &sections);
        for anchor in ["what-s-new", "a-b", "time-ms"] {
            assert_eq!(html.matches(&format!("href=\"#{anchor}\"")).count(), 1, "{anchor}");
            assert_eq!(html.matches(&format!("id=\"{anchor}\"")).count(), 1, "{anchor}");
        }
        assert!(html.contains("<title>a &lt; b</title>") && html.contains("<h2>T &lt; U</h2>"));
        assert!(html.contains(">A &amp; B</a>"));
    }

    #[test]
    fn a_page_needs_nothing_else() {
        let html = page("a", &html! {}, &[]);
        for outside in ["http:", "https:", "<script ", "<link", "@import", "import(", "fetch(", "src="] {
            assert!(!html.contains(outside), "{outside}");
        }
        for class in ["episode", "map", "part", "print", "touch", "ring"] {
            assert!(html.contains(&format!(".{class} ")), "the style of episodes is in every page: {class}");
        }
    }

    #[test]
    fn only_a_page_of_ours_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/report.html");
        let html = page("Tactile-Filter: a", &html! {}, &[]);
        write_page(&path, &html).unwrap();
        write_page(&path, &html).unwrap();
        fs::write(&path, "<html>of something else</html>").unwrap();
        let error = write_page(&path, &html).unwrap_err().to_string();
        assert!(error.contains("report.html: expected no file, or an earlier page"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "<html>of something else</html>");
    }
}

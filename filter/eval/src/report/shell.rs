//! A whole page: its head, its contents, its sections. Every page of this crate is made here.

use super::escape;
use super::style::CSS;

/// A part of a page with its own entry in the contents.
pub struct Section {
    short: String,
    title: String,
    body: String,
}

impl Section {
    /// `short` stands in the contents and names the anchor, `title` is the heading; both are text, two sections of
    /// a page have different `short`. `body` is HTML.
    pub fn new(short: impl Into<String>, title: impl Into<String>, body: impl Into<String>) -> Self {
        Self { short: short.into(), title: title.into(), body: body.into() }
    }

    /// The section as HTML: heading and body.
    pub fn html(&self) -> String {
        let Self { short, title, body } = self;
        format!("<section id=\"{}\"><h2>{}</h2>\n{body}</section>\n", anchor(short), escape(title))
    }
}

/// The name of a place in the page that is called `text`: its letters and digits, words joined by hyphens.
pub fn anchor(text: &str) -> String {
    let words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect::<Vec<_>>().join("-")
}

/// A page that needs nothing else: no network, light and dark, a screen of any width or a printer.
///
/// `title` is text, for the window. `style` is CSS after the common one. `top` is HTML before the contents, with the
/// page's `<h1>`. `scripts` are HTML elements, such as [`super::table::SCRIPT`]; the page must read well without them.
pub fn shell(title: &str, style: &str, top: &str, sections: &[Section], scripts: &[&str]) -> String {
    let entry =
        |section: &Section| format!(r##"<a href="#{}">{}</a>"##, anchor(&section.short), escape(&section.short));
    let entries: String = sections.iter().map(entry).collect();
    let bodies: String = sections.iter().map(Section::html).collect();
    format!(
        r#"<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{}</title><style>{CSS}{style}</style></head><body>
{top}<nav class="contents" aria-label="Contents">{entries}</nav>
{bodies}{}</body></html>
"#,
        escape(title),
        scripts.concat()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_entry_of_the_contents_leads_to_its_section() {
        let sections = ["What’s new?", "A & B", "Time, ms"].map(|short| Section::new(short, "T < U", "<p>x</p>"));
        let html = shell("a < b", "", "<h1>H</h1>", &sections, &[]);
        for anchor in ["what-s-new", "a-b", "time-ms"] {
            assert_eq!(html.matches(&format!("href=\"#{anchor}\"")).count(), 1, "{anchor}");
            assert_eq!(html.matches(&format!("id=\"{anchor}\"")).count(), 1, "{anchor}");
        }
        assert!(html.contains("<title>a &lt; b</title>") && html.contains("<h2>T &lt; U</h2>"));
        assert!(html.contains(">A &amp; B</a>"));
    }
}

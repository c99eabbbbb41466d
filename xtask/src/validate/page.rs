//! The report as one HTML page that needs nothing beside it.

use std::fs;

use super::{Picture, Row, SCOPE, Set, Verdict};
use crate::error::{Error, Result};

/// CSS of the page: light and dark, wide and narrow.
const CSS: &str = r#"
:root { color-scheme: light dark; --page: #fff; --ink: #1b1e23; --soft: #5c636e; --faint: #d9dde3; --panel: #f5f6f8;
  --met: #007a5a; --short: #c7362b; }
@media (prefers-color-scheme: dark) { :root { --page: #14171b; --ink: #e8eaee; --soft: #a2a9b4; --faint: #3a404a;
  --panel: #1d2127; --met: #35c296; --short: #ff7b6e; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 28px 20px 60px; max-width: 1120px; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 8px; }
h2 { font-size: 1.3rem; margin: 44px 0 6px; }
p { max-width: 46rem; margin: 6px 0; }
.scope { background: var(--panel); border-radius: 8px; padding: 12px 14px; margin: 16px 0 20px; max-width: none; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .92rem; width: 100%; }
th, td { text-align: left; padding: 6px 14px 6px 0; vertical-align: top; border-bottom: 1px solid var(--faint); }
thead th { border-bottom: 1px solid var(--soft); }
tr.set th { padding-top: 16px; color: var(--soft); font-weight: 600; }
td:last-child { white-space: nowrap; font-weight: 600; padding-right: 0; }
.met { color: var(--met); } .falls-short { color: var(--short); } .not-there { color: var(--soft); }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 340px), 1fr)); gap: 18px; margin: 14px 0; }
figure { margin: 0; }
@media (min-width: 760px) { figure:only-child { grid-column: span 2; } }
figcaption, .note { color: var(--soft); font-size: .88rem; }
img { display: block; width: 100%; height: auto; border-radius: 4px; }
@media print { :root { color-scheme: light; --page: #fff; --ink: #000; --soft: #444; --faint: #ccc; --panel: #f4f4f4;
  --met: #007a5a; --short: #c7362b; } body { max-width: none; padding: 0; } figure, tr { break-inside: avoid; } }
"#;

/// Draws the page, its pictures within.
pub fn draw(sets: &[Set]) -> Result<String> {
    let table: String = sets.iter().map(group).collect();
    let sections = sets.iter().map(section).collect::<Result<String>>()?;
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>The simulated sensor against real images</title>\n<style>{CSS}</style>\n\
         <h1>The simulated sensor against real images</h1>\n<p class=\"scope\"><b>What this shows, and what not.</b> \
         {SCOPE}</p>\n<div class=\"scroll\"><table>\n<thead><tr><th>what<th>target<th>measured<th></tr></thead>\n\
         <tbody>\n{table}</tbody></table></div>\n\
         <p class=\"note\">Pictures of two rows: real, simulated, and how what they change differs; below what the \
         press changed really, what it changes simulated, and white the pixels compared. Changes are amplified on \
         mid-grey. Similarity over whole frames is not reported: a bare background scores 0.94 to 0.96 there. \
         Made by <code>cargo xtask validate</code>, which prints each command that it runs.</p>\n\
         {sections}</html>\n",
        SCOPE = escaped(SCOPE)
    ))
}

/// The rows of a set, under its title.
fn group(set: &Set) -> String {
    let row = |Row { what, target, measured, verdict }: &Row| {
        let class = verdict.words().replace(' ', "-");
        let cells = [what, target, measured.as_str()].map(escaped);
        let words = if *verdict == Verdict::Missing { "" } else { verdict.words() };
        format!("<tr><td>{}<td>{}<td>{}<td class=\"{class}\">{words}</tr>\n", cells[0], cells[1], cells[2])
    };
    let rows: String = set.rows.iter().map(row).collect();
    format!("<tr class=\"set\"><th colspan=\"4\">{}</tr>\n{rows}", escaped(set.title))
}

/// What was done with a set, and its pictures.
fn section(set: &Set) -> Result<String> {
    if set.about.is_empty() {
        return Ok(String::new());
    }
    let pictures = set.pictures.iter().map(figure).collect::<Result<String>>()?;
    let pictures = if pictures.is_empty() { pictures } else { format!("<div class=\"pictures\">\n{pictures}</div>\n") };
    Ok(format!("<h2>{}</h2>\n<p>{}</p>\n{pictures}", escaped(set.title), escaped(&set.about)))
}

fn figure(Picture { path, caption }: &Picture) -> Result<String> {
    let png = fs::read(path).map_err(Error::io(path))?;
    let caption = escaped(caption);
    Ok(format!(
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption></figure>\n",
        base64(&png)
    ))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Bytes in base64 (RFC 4648, Sec. 4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |chunk: &[u8]| {
        let bits = (0..3).fold(0_u32, |bits, i| bits << 8 | u32::from(chunk.get(i).copied().unwrap_or(0)));
        let n_chunk = chunk.len();
        (0..4).map(move |i| if i <= n_chunk { char::from(LETTERS[(bits >> (18 - 6 * i) & 63) as usize]) } else { '=' })
    };
    bytes.chunks(3).flat_map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        // RFC 4648, Sec. 10.
        for (text, expected) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }

    #[test]
    fn the_page_says_what_it_does_not_show_and_gives_each_row() {
        let row = Row { what: "a < b", target: "3", measured: "2".into(), verdict: Verdict::Met };
        let set = Set { title: "Set", about: "About.".into(), rows: vec![row], pictures: Vec::new() };
        let page = draw(&[set]).unwrap();
        assert!(page.contains(SCOPE) && page.contains("<td>a &lt; b<td>3<td>2<td class=\"met\">met"));
    }
}

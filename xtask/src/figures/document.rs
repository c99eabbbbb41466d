//! Tables in documents, between `<!-- figures: NAME -->` and `<!-- end of figures -->`.

use std::fs;

use super::file::Figures;
use crate::error::{Error, Result};
use crate::experiments::Experiments;
use crate::workspace::Workspace;

const END: &str = "<!-- end of figures -->";

/// A marked table.
#[derive(Debug, PartialEq)]
pub struct Marked<'a> {
    /// Its name.
    pub name: &'a str,
    /// The number of its mark's line, from 1 on.
    pub line: usize,
    /// The lines between its marks.
    pub lines: Vec<&'a str>,
}

/// The marked tables of a document, of this path.
pub fn marked<'a>(path: &str, text: &'a str) -> Result<Vec<Marked<'a>>> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        let Some(name) = line.strip_prefix("<!-- figures: ").and_then(|rest| rest.strip_suffix(" -->")) else {
            continue;
        };
        let inside: Vec<&str> = lines[at + 1..].iter().copied().take_while(|line| *line != END).collect();
        if at + 1 + inside.len() == lines.len() || inside.iter().any(|line| line.starts_with("<!--")) {
            return Err(Error::invalid(
                format!("{path}:{}: figures: {name}", at + 1),
                format!("`{END}` below"),
                "none",
            ));
        }
        found.push(Marked { name, line: at + 1, lines: inside });
    }
    Ok(found)
}

/// The document with the lines that `table` gives in its marked tables.
fn filled(path: &str, text: &str, table: &dyn Fn(&str) -> Result<Vec<String>>) -> Result<String> {
    let mut lines: Vec<String> = text.lines().map(String::from).collect();
    for Marked { name, line, lines: inside } in marked(path, text)?.into_iter().rev() {
        lines.splice(line..line + inside.len(), table(name)?);
    }
    Ok(lines.join("\n") + "\n")
}

/// Writes every marked table of the workspace's documents.
pub fn write_all(workspace: &Workspace, experiments: &Experiments, figures: &Figures) -> Result<()> {
    for path in workspace.files()?.iter().filter(|path| path.ends_with(".md")) {
        let full = workspace.root.join(path);
        let text = fs::read_to_string(&full).map_err(Error::io(&full))?;
        let filled = filled(path, &text, &|name| experiments.table(name)?.markdown(figures))?;
        if filled != text && !marked(path, &text)?.is_empty() {
            fs::write(&full, filled).map_err(Error::io(&full))?;
            println!("{path}: its tables have other figures now");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a\n<!-- figures: one -->\n| old |\n| older |\n<!-- end of figures -->\nb\n<!-- figures: two -->\n\
                        <!-- end of figures -->\n";

    #[test]
    fn a_table_is_written_between_its_marks_and_nothing_else_is() {
        let table = |name: &str| Ok(vec![format!("| {name} |"), "| 2 |".into()]);
        let expected = "a\n<!-- figures: one -->\n| one |\n| 2 |\n<!-- end of figures -->\nb\n<!-- figures: two -->\n| two |\n\
                        | 2 |\n<!-- end of figures -->\n";
        assert_eq!(filled("R.md", TEXT, &table).unwrap(), expected);
        assert_eq!(filled("R.md", expected, &table).unwrap(), expected);
    }

    #[test]
    fn a_mark_without_an_end_is_named() {
        for text in [
            "a\n<!-- figures: one -->\n| 1 |\n",
            "a\n<!-- figures: one -->\n<!-- figures: two -->\n<!-- end of figures -->\n",
        ] {
            let error = marked("R.md", text).unwrap_err().to_string();
            assert_eq!(error, "R.md:2: figures: one: expected `<!-- end of figures -->` below, got none");
        }
    }
}

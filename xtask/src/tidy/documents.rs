//! Rules for what people read: links lead somewhere, excerpts are those of a file that compiles, pages are short.

use super::Finding;

/// Most lines of README and ARCHITECTURE, and most characters of each line.
const MAX_LINES: usize = 150;
const MAX_CHARACTERS: usize = 120;

/// Links in a markdown file to files that are not there; `exists` takes a path relative to the root.
pub fn broken_links(path: &str, text: &str, exists: &dyn Fn(&str) -> bool) -> Vec<Finding> {
    let folder = path.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let mut findings = Vec::new();
    let mut in_fence = false;
    for (n, line) in text.lines().enumerate() {
        in_fence ^= line.trim_start().starts_with("```");
        let links = line.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '#']).next());
        let local = links.filter(|link| !in_fence && !link.is_empty() && !link.contains(':'));
        for link in local.filter(|link| !exists(&format!("{folder}{link}"))) {
            findings.push(Finding::new(path, n + 1, format!("link to {link}, which is not there")));
        }
    }
    findings
}

/// Blocks of Rust that are not lines of the file that `<!-- excerpt: FILE -->` names above them, indentation and empty
/// lines aside; `read` takes a path relative to the root.
pub fn excerpts(path: &str, text: &str, read: &dyn Fn(&str) -> Option<String>) -> Vec<Finding> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let code = |lines: &[&str]| -> Vec<String> {
        lines.iter().map(|line| line.trim().to_owned()).filter(|line| !line.is_empty()).collect()
    };
    let check = |at: usize| {
        let named = |above: &usize| lines[*above].strip_prefix("<!-- excerpt: ")?.strip_suffix(" -->");
        let Some(file) = at.checked_sub(1).as_ref().and_then(named) else {
            return Some("no `<!-- excerpt: FILE -->` above this code".into());
        };
        let Some(source) = read(file) else { return Some(format!("excerpt of {file}, which is not there")) };
        let source = code(&source.lines().collect::<Vec<_>>());
        let end = lines[at + 1..].iter().position(|line| *line == "```").map_or(lines.len(), |n| at + 1 + n);
        let excerpt = code(&lines[at + 1..end]);
        let is_there = source.windows(excerpt.len().max(1)).any(|window| window == excerpt);
        (!is_there).then(|| format!("not what {file} says"))
    };
    let blocks = (0..lines.len()).filter(|at| lines[*at].starts_with("```rust"));
    blocks.filter_map(|at| check(at).map(|what| Finding::new(path, at + 1, what))).collect()
}

/// Too many lines, or too long ones.
pub fn too_long(path: &str, text: &str) -> Vec<Finding> {
    let over = |what: &str, n: usize, limit: usize| format!("{n} {what}; the limit is {limit}");
    let long = text.lines().enumerate().map(|(n, line)| (n + 1, line.chars().count()));
    let long = long.filter(|(_, n_characters)| *n_characters > MAX_CHARACTERS);
    let mut findings: Vec<_> =
        long.map(|(line, n)| Finding::new(path, line, over("characters", n, MAX_CHARACTERS))).collect();
    let n_lines = text.lines().count();
    if n_lines > MAX_LINES {
        findings.push(Finding::new(path, n_lines, over("lines", n_lines, MAX_LINES)));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(findings: &[Finding]) -> Vec<String> {
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_link_leads_to_a_file_next_to_its_document() {
        let text = "[a](b.md#part) ![c](d.png \"title\") [e](https://f.org) [g](#part)\n```\n[h](i)\n```\n[j](k)";
        assert_eq!(
            lines(&broken_links("docs/x.md", text, &|path| path == "docs/b.md")),
            ["docs/x.md:1: link to d.png, which is not there", "docs/x.md:5: link to k, which is not there"]
        );
    }

    #[test]
    fn an_excerpt_is_what_its_file_says() {
        let read = |path: &str| (path == "a.rs").then(|| "fn main() {\n    one();\n\n    two();\n}\n".to_owned());
        let text = |file: &str, code: &str| format!("<!-- excerpt: {file} -->\n```rust\n{code}\n```\n");
        assert!(excerpts("R.md", &text("a.rs", "one();\ntwo();"), &read).is_empty());
        for (text, expected) in [
            (text("a.rs", "one();\n}"), "R.md:2: not what a.rs says"),
            (text("a.rs", ""), "R.md:2: not what a.rs says"),
            (text("b.rs", "one();"), "R.md:2: excerpt of b.rs, which is not there"),
            ("```rust\none();\n```\n".into(), "R.md:1: no `<!-- excerpt: FILE -->` above this code"),
        ] {
            assert_eq!(lines(&excerpts("R.md", &text, &read)), [expected]);
        }
    }

    #[test]
    fn a_page_is_short() {
        assert!(too_long("R.md", &"\u{e9}\n".repeat(MAX_LINES)).is_empty());
        assert!(too_long("R.md", &"\u{e9}".repeat(MAX_CHARACTERS)).is_empty());
        let text = format!("{}\n{}", "x".repeat(MAX_CHARACTERS + 1), "x\n".repeat(MAX_LINES));
        let expected = ["R.md:1: 121 characters; the limit is 120", "R.md:151: 151 lines; the limit is 150"];
        assert_eq!(lines(&too_long("R.md", &text)), expected);
    }
}

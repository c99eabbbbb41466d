//! Rules for what people read: links lead somewhere, commands exist.

use super::Finding;

/// The names that a command line may use.
pub struct Known<'a> {
    /// Subcommands of `cargo xtask`.
    pub chores: &'a [String],
    /// Packages of the workspace.
    pub packages: &'a [String],
    /// Programs of the workspace.
    pub programs: &'a [String],
}

/// Links in a markdown file to files that are not there; `exists` takes a path relative to the root.
pub fn broken_links(path: &str, text: &str, exists: &dyn Fn(&str) -> bool) -> Vec<Finding> {
    let folder = path.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let mut findings = Vec::new();
    for (line, language, content) in lines(text) {
        if language.is_some() {
            continue;
        }
        for link in content.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '#']).next()) {
            let local = !link.is_empty() && !link.contains(':');
            if local && !exists(&format!("{folder}{link}")) {
                findings.push(Finding::new(path, line, format!("link to {link}, which is not there")));
            }
        }
    }
    findings
}

/// Command lines in `sh` blocks that begin with cargo or one of our programs and name what is not
/// there.
pub fn unknown_commands(path: &str, text: &str, known: &Known<'_>) -> Vec<Finding> {
    let commands = lines(text).filter(|(_, language, _)| *language == Some("sh"));
    commands
        .filter_map(|(line, _, content)| {
            let words: Vec<_> = content.trim().trim_start_matches("$ ").split_whitespace().collect();
            unknown(&words, known).map(|what| Finding::new(path, line, what))
        })
        .collect()
}

/// What a command line names that is not there.
fn unknown(words: &[&str], known: &Known<'_>) -> Option<String> {
    let has = |names: &[String], name: &str| names.iter().any(|known| known == name);
    let program = words.first()?.rsplit('/').next()?;
    if program.starts_with("tactile-") && !has(known.programs, program) {
        return Some(format!("no program {program}"));
    }
    if program != "cargo" {
        return None;
    }
    if words.get(1) == Some(&"xtask") {
        let chore = words.get(2).copied().unwrap_or_default();
        return (!has(known.chores, chore) && chore != "--help").then(|| format!("cargo xtask has no {chore:?}"));
    }
    let options = words.iter().take_while(|word| **word != "--").flat_map(|word| word.split('='));
    let options: Vec<_> = options.collect();
    options.windows(2).find_map(|pair| match pair {
        ["-p" | "--package", name] if !has(known.packages, name) => Some(format!("no package {name}")),
        ["--bin", name] if !has(known.programs, name) => Some(format!("no program {name}")),
        _ => None,
    })
}

/// Each line of a markdown text with its number and, inside a fence, the language of the fence.
fn lines(text: &str) -> impl Iterator<Item = (usize, Option<&str>, &str)> {
    let mut language = None;
    text.lines().enumerate().filter_map(move |(n, line)| {
        let Some(fence) = line.trim_start().strip_prefix("```") else {
            return Some((n + 1, language, line));
        };
        language = if language.is_some() { None } else { Some(fence.trim()) };
        None
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(ToString::to_string).collect()
    }

    fn commands(text: &str) -> Vec<String> {
        let (chores, packages) = (names(&["demo"]), names(&["tactile-data"]));
        let known = Known { chores: &chores, packages: &packages, programs: &packages };
        unknown_commands("README.md", text, &known).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn commands_that_exist_pass() {
        let text = "```sh\ncargo xtask demo --quick\n$ cargo test --release --workspace\ncargo run -p tactile-data -- --bin x\n\
                    target/release/tactile-data generate\ngit clone x\n# a comment\n```\ncargo xtask dance\n```text\ncargo xtask dance\n```\n";
        assert_eq!(commands(text), Vec::<String>::new());
    }

    #[test]
    fn commands_that_do_not_exist_are_named() {
        let text = "```sh\ncargo xtask dance\ncargo run --package=other\ncargo run --bin other\ntactile-other x\n```\n";
        assert_eq!(
            commands(text),
            [
                "README.md:2: cargo xtask has no \"dance\"",
                "README.md:3: no package other",
                "README.md:4: no program other",
                "README.md:5: no program tactile-other"
            ]
        );
    }

    #[test]
    fn a_link_leads_to_a_file_beside_its_document() {
        let text = "[a](b.md#part) ![c](d.png \"title\") [e](https://f.org) [g](#part)\n```\n[h](i)\n```\n[j](k)";
        let found = broken_links("docs/x.md", text, &|path| path == "docs/b.md");
        let found: Vec<_> = found.iter().map(ToString::to_string).collect();
        assert_eq!(
            found,
            ["docs/x.md:1: link to d.png, which is not there", "docs/x.md:5: link to k, which is not there"]
        );
    }
}

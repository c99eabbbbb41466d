//! The rules that no compiler checks. Each check is a function over text that lists what it found.

mod code;
mod documents;
mod manifests;
mod sources;

use std::fmt;
use std::fs;

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::{Workspace, cargo};

/// Largest file in the repository, bytes: a shipped checkpoint fits, a dataset does not.
const MAX_BYTES: u64 = 4 << 20;

/// One thing to mend.
#[derive(Debug, PartialEq)]
pub struct Finding {
    path: String,
    line: usize,
    what: String,
}

impl Finding {
    fn new(path: &str, line: usize, what: impl Into<String>) -> Self {
        Self { path: path.into(), line, what: what.into() }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.path, self.line, self.what)
    }
}

/// Checks the workspace and prints a line for each finding; `chores` are the names that
/// `cargo xtask` takes.
pub fn tidy(workspace: &Workspace, chores: &[String]) -> Result<()> {
    let tree = ["tree", "--workspace", "--edges", "normal,build", "--prefix", "none", "--format", "{p}"];
    let tree = program::output(&cargo(), &tree, &workspace.root)?;
    let files = workspace.files()?;
    let known = documents::Known { chores, packages: &workspace.packages, programs: &workspace.programs };

    let mut findings = Vec::new();
    let mut texts = Vec::new();
    for path in &files {
        let full = workspace.root.join(path);
        let bytes = fs::read(&full).map_err(Error::io(&full))?;
        findings.extend(size(path, bytes.len() as u64));
        texts.extend(String::from_utf8(bytes).ok().map(|text| (path, text)));
    }
    let rust = texts.iter().filter(|(path, _)| path.ends_with(".rs"));
    let test_modules: Vec<_> = rust.flat_map(|(path, text)| sources::test_modules(path, text)).collect();
    for (path, text) in &texts {
        findings.extend(sources::machine_paths(path, text));
        match path.rsplit_once('.').map(|(_, extension)| extension) {
            Some("rs") => findings.extend(sources::check(path, text, &test_modules)),
            Some("md") => findings.extend(documents::broken_links(path, text, &|to| workspace.root.join(to).exists())),
            _ if *path == "Cargo.lock" => findings.extend(manifests::compiled_c(&tree, text)),
            _ if *path == "Cargo.toml" => findings.extend(manifests::unexplained(text)),
            _ if path.ends_with("/Cargo.toml") => findings.extend(manifests::house(path, text)),
            _ => {}
        }
        if *path == "README.md" {
            findings.extend(documents::unknown_commands(path, text, &known));
        }
    }
    for needed in ["README.md", "ARCHITECTURE.md", "Cargo.lock"] {
        if !files.iter().any(|path| path == needed) {
            findings.push(Finding::new(needed, 1, "missing"));
        }
    }
    for finding in &findings {
        println!("{finding}");
    }
    if findings.is_empty() {
        println!("tidy: {} files, nothing to mend", files.len());
        return Ok(());
    }
    Err(Error::Untidy(findings.len()))
}

/// A file too large for a repository.
fn size(path: &str, bytes: u64) -> Option<Finding> {
    let what = format!("{bytes} bytes; the limit is {MAX_BYTES}");
    (bytes > MAX_BYTES).then(|| Finding::new(path, 1, what))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_itself_is_allowed() {
        assert_eq!(size("model.safetensors", MAX_BYTES), None);
        assert_eq!(
            size("model.safetensors", MAX_BYTES + 1).map(|finding| finding.to_string()),
            Some("model.safetensors:1: 4194305 bytes; the limit is 4194304".into())
        );
    }
}

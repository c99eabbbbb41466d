//! The rules that neither rustfmt nor clippy nor cargo-deny checks. Each check is a function over text or JSON that
//! lists what it found.

mod documents;
mod figures;
mod packages;
mod sources;

use std::fmt;
use std::fs;

use crate::error::{Error, Result};
use crate::workspace::{Workspace, cargo};

/// Largest file in the repository, bytes: a shipped checkpoint fits, a dataset does not.
const MAX_BYTES: u64 = 4 << 20;

/// One thing to correct.
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

/// Checks the workspace and prints a line for each finding.
pub fn tidy(workspace: &Workspace) -> Result<()> {
    let files = workspace.files()?;
    let mut findings = Vec::new();
    for path in &files {
        findings.extend(file(workspace, path)?);
    }
    findings.extend(figures::check(workspace, &files)?);
    findings.extend(packages::layers(&workspace.packages()?));
    let tree = |of: &str| cargo().words(format!("tree {of} --prefix none --format {{p}}")).output(&workspace.root);
    let with_imports = "--workspace --features tactile-data/ros1,tactile-data/lerobot --edges normal,build";
    findings.extend(packages::compiled_c(&tree(with_imports)?));
    let embedded = tree("--package tactile-filter --no-default-features --edges normal")?;
    println!("tactile-filter without default features: {} crates", packages::names(&embedded).len());
    findings.extend(packages::embedded(&embedded));
    for finding in &findings {
        println!("{finding}");
    }
    if findings.is_empty() {
        println!("tidy: {} files, nothing to correct", files.len());
        return Ok(());
    }
    Err(Error::Untidy(findings.len()))
}

/// What is wrong with one file.
fn file(workspace: &Workspace, path: &str) -> Result<Vec<Finding>> {
    let full = workspace.root.join(path);
    let bytes = fs::read(&full).map_err(Error::io(&full))?;
    let mut findings: Vec<Finding> = size(path, bytes.len() as u64).into_iter().collect();
    let Ok(text) = String::from_utf8(bytes) else { return Ok(findings) };
    findings.extend(sources::machine_paths(path, &text));
    if path.ends_with(".rs") {
        findings.extend(sources::words(path, &text));
        findings.extend(sources::nounless(path, &text));
    }
    if path.ends_with(".md") {
        findings.extend(documents::broken_links(path, &text, &|to| workspace.root.join(to).exists()));
        findings.extend(documents::excerpts(path, &text, &|from| fs::read_to_string(workspace.root.join(from)).ok()));
    }
    if ["README.md", "ARCHITECTURE.md"].contains(&path) {
        findings.extend(documents::too_long(path, &text));
    }
    if path == "Cargo.toml" {
        findings.extend(packages::unexplained(&text));
    }
    Ok(findings)
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

//! Rules for manifests and for the dependency tree.

use super::Finding;

/// Crates that a build script uses to compile or to find C and C++.
const C_TOOLS: [&str; 8] = ["autotools", "bindgen", "cc", "cmake", "cxx-build", "nasm-rs", "pkg-config", "vcpkg"];

/// Crates that are called `-sys` and compile nothing: the kernel's constants, generated as Rust.
const PURE_RUST: [&str; 1] = ["linux-raw-sys"];

/// Which crates each manifest must not name: what a layer must not know.
const MUST_NOT_KNOW: [(&str, &[&str]); 5] = [
    ("data/Cargo.toml", &["burn", "tactile-infer", "tactile-filter", "tactile-train"]),
    ("infer/Cargo.toml", &["tactile-filter", "tactile-train"]),
    ("filter/Cargo.toml", &["burn", "tactile-train"]),
    ("train/Cargo.toml", &["tactile-filter"]),
    ("xtask/Cargo.toml", &["burn", "tactile-data", "tactile-infer", "tactile-filter", "tactile-train"]),
];

/// Crates in `cargo tree --prefix none --format {p}` that compile C or C++, at their place in the
/// lockfile.
pub fn compiled_c(tree: &str, lockfile: &str) -> Vec<Finding> {
    let mut names: Vec<_> = tree.lines().filter_map(|line| line.split(' ').next()).collect();
    names.sort_unstable();
    names.dedup();
    let compiles = |name: &&str| (name.ends_with("-sys") && !PURE_RUST.contains(name)) || C_TOOLS.contains(name);
    let at = |name| {
        let entry = format!("name = \"{name}\"");
        lockfile.lines().position(|line| line == entry).map_or(1, |n| n + 1)
    };
    let what = |name| format!("{name} compiles or links C in the default build");
    names.into_iter().filter(compiles).map(|name| Finding::new("Cargo.lock", at(name), what(name))).collect()
}

/// Entries of `[workspace.dependencies]` in the root manifest with no comment above their block; the
/// workspace's own crates need none.
pub fn unexplained(manifest: &str) -> Vec<Finding> {
    let mut findings = Vec::new();
    let (mut inside, mut explained, mut open) = (false, false, 0);
    for (n, line) in manifest.lines().map(str::trim).enumerate() {
        if open == 0 {
            match line.chars().next() {
                Some('[') => inside = line == "[workspace.dependencies]",
                Some('#') => explained = true,
                None => explained = false,
                Some(_) if inside && !explained && !line.contains("path =") => {
                    let name = line.split([' ', '=', '.']).next().unwrap_or(line);
                    findings.push(Finding::new(
                        "Cargo.toml",
                        n + 1,
                        format!("{name} has no comment that gives its reason"),
                    ));
                }
                Some(_) => {}
            }
        }
        // A list of features may run over several lines.
        open += line.matches('[').count();
        open -= line.matches(']').count().min(open);
    }
    findings
}

/// Dependencies of one crate that it must not have, or that are not the root manifest's.
pub fn house(path: &str, manifest: &str) -> Vec<Finding> {
    let forbidden = MUST_NOT_KNOW.iter().find(|(of, _)| *of == path).map_or(&[][..], |(_, names)| names);
    let mut findings = Vec::new();
    for (line, name, rest) in dependencies(manifest) {
        if forbidden.iter().any(|no| name == *no || name.starts_with(&format!("{no}-"))) {
            findings.push(Finding::new(path, line, format!("this crate must not know {name}")));
        }
        if !rest.replace(' ', "").contains("workspace=true") {
            findings.push(Finding::new(path, line, format!("{name} is not taken from the root manifest")));
        }
    }
    findings
}

/// Line, name and definition of each dependency of any kind.
fn dependencies(manifest: &str) -> Vec<(usize, &str, &str)> {
    let mut found = Vec::new();
    let mut inside = false;
    for (n, line) in manifest.lines().map(str::trim).enumerate() {
        if let Some(section) = line.strip_prefix('[') {
            inside = section.trim_end_matches(']').ends_with("dependencies");
            if let Some((_, name)) = section.split_once("dependencies.") {
                found.push((n + 1, name.trim_end_matches(']'), "a section of its own"));
            }
        } else if let Some((name, rest)) = line.split_once(['.', '=', ' ']).filter(|_| inside && !line.starts_with('#'))
        {
            found.push((n + 1, name, rest));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(findings: &[Finding]) -> Vec<String> {
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_crate_that_compiles_c_is_found_at_its_place() {
        let tree = "data v0.1.0 (here)\nzstd-sys v2.1.2\nlinux-raw-sys v0.12.1\nccc v1.0.0\ncc v1.2.0 (*)\nzstd-sys v2.1.2 (*)\n";
        let lockfile = "[[package]]\nname = \"cc\"\n\n[[package]]\nname = \"zstd-sys\"\n";
        assert_eq!(
            lines(&compiled_c(tree, lockfile)),
            [
                "Cargo.lock:2: cc compiles or links C in the default build",
                "Cargo.lock:5: zstd-sys compiles or links C in the default build"
            ]
        );
    }

    #[test]
    fn a_dependency_says_why_or_shares_a_block_that_does() {
        let manifest = "[workspace.dependencies]\ndata = { path = \"data\" }\n\n# Why.\na = \"1\"\nb = { version = \"1\", features = [\n  \"x\",\n\n  \"y\",\n] }\n\nc.version = \"1\"\n[profile.release]\ndebug = false\n";
        assert_eq!(lines(&unexplained(manifest)), ["Cargo.toml:12: c has no comment that gives its reason"]);
    }

    #[test]
    fn a_layer_does_not_know_what_is_above_it() {
        let manifest = "[dependencies]\nburn-tensor = { workspace = true }\ntactile-data.workspace = true\n[dev-dependencies]\ntactile-train.workspace = true\n";
        assert_eq!(
            lines(&house("filter/Cargo.toml", manifest)),
            [
                "filter/Cargo.toml:2: this crate must not know burn-tensor",
                "filter/Cargo.toml:5: this crate must not know tactile-train"
            ]
        );
        assert!(house("tests/Cargo.toml", manifest).is_empty());
    }

    #[test]
    fn versions_are_said_once() {
        let manifest =
            "[features]\nx = []\n[dependencies]\n# why\nrand = \"0.10\"\n[dependencies.clap]\nworkspace = true\n";
        assert_eq!(
            lines(&house("data/Cargo.toml", manifest)),
            [
                "data/Cargo.toml:5: rand is not taken from the root manifest",
                "data/Cargo.toml:6: clap is not taken from the root manifest"
            ]
        );
    }
}

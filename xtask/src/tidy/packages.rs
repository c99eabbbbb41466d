//! Rules for packages: what each may depend on, and why.

use serde_json::Value;

use super::Finding;

/// The packages of the workspace that each package may depend on.
const MAY_KNOW: [(&str, &[&str]); 11] = [
    ("tactile-data", &[]),
    ("tactile-infer", &["tactile-data"]),
    ("tactile-filter", &["tactile-data", "tactile-infer"]),
    ("tactile-eval", &["tactile-data", "tactile-infer", "tactile-filter"]),
    ("tactile-live", &["tactile-data", "tactile-infer", "tactile-filter"]),
    ("tactile-py", &["tactile-data", "tactile-infer", "tactile-filter"]),
    ("tactile-capi", &["tactile-data", "tactile-infer", "tactile-filter"]),
    ("tactile-filter-cli", &["tactile-data", "tactile-infer", "tactile-filter", "tactile-eval", "tactile-live"]),
    ("tactile-train", &["tactile-data", "tactile-infer"]),
    ("tactile-tests", &["tactile-data", "tactile-infer", "tactile-filter", "tactile-eval", "tactile-train"]),
    ("xtask", &[]),
];

/// The packages that may name burn.
const MAY_KNOW_BURN: [&str; 2] = ["tactile-infer", "tactile-train"];

/// Most crates that a controller compiles for `tactile-filter` without default features, itself included.
const MAX_EMBEDDED: usize = 65;

/// Crates that a controller never compiles; burn's own have its name in front.
const NEVER_EMBEDDED: [&str; 6] = ["burn", "usvg", "zip", "ttf-parser", "clap", "image"];

/// Crates that a build script uses to compile or to find C and C++.
const C_TOOLS: [&str; 8] = ["autotools", "bindgen", "cc", "cmake", "cxx-build", "nasm-rs", "pkg-config", "vcpkg"];

/// Crates that are called `-sys` and are Rust: the kernel's constants, generated, and bzip2's library, translated.
const PURE_RUST: [&str; 2] = ["linux-raw-sys", "libbz2-rs-sys"];

/// Dependencies that a package must not have; `packages` are those of `cargo metadata`.
pub fn layers(packages: &[Value]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let is_ours = |name: &str| packages.iter().any(|package| package["name"] == name);
    for package in packages {
        let name = package["name"].as_str().unwrap_or_default();
        let finding = |what: String| Finding::new("Cargo.toml", 1, what);
        let Some((_, allowed)) = MAY_KNOW.iter().find(|(of, _)| *of == name) else {
            findings.push(finding(format!("what may {name} depend on? Add it to {}", file!())));
            continue;
        };
        let dependencies = package["dependencies"].as_array().into_iter().flatten();
        for other in dependencies.filter_map(|dependency| dependency["name"].as_str()) {
            let is_burn = other.split('-').next() == Some("burn");
            if (is_ours(other) && !allowed.contains(&other)) || (is_burn && !MAY_KNOW_BURN.contains(&name)) {
                findings.push(finding(format!("{name} must not depend on {other}")));
            }
        }
    }
    findings
}

/// What a controller must not compile, in the tree of `tactile-filter` without default features.
pub fn embedded(tree: &str) -> Vec<Finding> {
    let names = names(tree);
    let is_unwanted = |name: &&str| NEVER_EMBEDDED.contains(name) || name.starts_with("burn-");
    let finding = |what: String| Finding::new("filter/Cargo.toml", 1, what);
    let unwanted = names.iter().filter(|name| is_unwanted(name));
    let mut findings: Vec<_> = unwanted.map(|name| finding(format!("a controller compiles {name}"))).collect();
    if names.len() > MAX_EMBEDDED {
        findings.push(finding(format!("a controller compiles {} crates; the limit is {MAX_EMBEDDED}", names.len())));
    }
    findings
}

/// Crates in a tree that compile or link C or C++.
pub fn compiled_c(tree: &str) -> Vec<Finding> {
    let compiles = |name: &&str| (name.ends_with("-sys") && !PURE_RUST.contains(name)) || C_TOOLS.contains(name);
    let finding = |name| Finding::new("Cargo.lock", 1, format!("{name} compiles or links C in the default build"));
    names(tree).into_iter().filter(compiles).map(finding).collect()
}

/// The names of the crates in `cargo tree --prefix none --format {p}`, one for each version.
pub fn names(tree: &str) -> Vec<&str> {
    let mut crates: Vec<_> = tree.lines().filter_map(|line| line.trim_end_matches(" (*)").split_once(" v")).collect();
    crates.sort_unstable();
    crates.dedup();
    crates.into_iter().map(|(name, _)| name).collect()
}

/// Entries of `[workspace.dependencies]` in the root manifest with no comment above their block; the workspace's own
/// packages need none.
pub fn unexplained(manifest: &str) -> Vec<Finding> {
    let mut findings = Vec::new();
    let (mut inside, mut explained, mut in_list) = (false, false, false);
    for (n, line) in manifest.lines().map(str::trim).enumerate() {
        match line.chars().next() {
            // A list of features may run over several lines.
            _ if in_list => in_list = !line.contains(']'),
            Some('[') => inside = line == "[workspace.dependencies]",
            Some('#') => explained = true,
            None => explained = false,
            Some(_) => {
                in_list = line.contains('[') && !line.contains(']');
                if inside && !explained && !line.contains("path =") {
                    let name = line.split([' ', '=', '.']).next().unwrap_or(line);
                    let what = format!("{name} has no comment that gives its reason");
                    findings.push(Finding::new("Cargo.toml", n + 1, what));
                }
            }
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn lines(findings: &[Finding]) -> Vec<String> {
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_crate_that_compiles_c_is_found() {
        let tree = "data v0.1.0 (here)\nzstd-sys v2.1.2\nlinux-raw-sys v0.12.1\nccc v1.0.0\ncc v1.2.0 (*)\nzstd-sys v2.1.2 (*)\n";
        assert_eq!(
            lines(&compiled_c(tree)),
            [
                "Cargo.lock:1: cc compiles or links C in the default build",
                "Cargo.lock:1: zstd-sys compiles or links C in the default build"
            ]
        );
    }

    #[test]
    fn a_dependency_says_why_or_shares_a_block_that_does() {
        let manifest = "[workspace.dependencies]\ndata = { path = \"data\" }\n\n# Why.\na = \"1\"\nb = { version = \"1\", features = [\n  \"x\",\n\n  \"y\",\n] }\n\nc.version = \"1\"\n[profile.release]\ndebug = false\n";
        assert_eq!(lines(&unexplained(manifest)), ["Cargo.toml:12: c has no comment that gives its reason"]);
    }

    #[test]
    fn a_package_does_not_know_what_is_above_it() {
        let package = |name: &str, dependencies: &[&str]| {
            let dependencies: Vec<_> = dependencies.iter().map(|name| json!({ "name": name })).collect();
            json!({ "name": name, "dependencies": dependencies })
        };
        let packages = [
            package("tactile-data", &["serde", "tactile-infer"]),
            package("tactile-infer", &["tactile-data", "burn"]),
            package("tactile-filter", &["tactile-infer", "burn-tensor"]),
            package("tactile-new", &[]),
        ];
        let found = lines(&layers(&packages));
        assert_eq!(found[0], "Cargo.toml:1: tactile-data must not depend on tactile-infer");
        assert_eq!(found[1], "Cargo.toml:1: tactile-filter must not depend on burn-tensor");
        assert!(found[2].starts_with("Cargo.toml:1: what may tactile-new depend on?"), "{found:?}");
        assert_eq!(found.len(), 3);
    }

    #[test]
    fn a_controller_compiles_few_crates_and_no_heavy_one() {
        let few: String = (0..MAX_EMBEDDED).map(|n| format!("a{n} v1.0.0\na{n} v1.0.0 (*)\n")).collect();
        assert!(embedded(&few).is_empty());
        assert_eq!(
            lines(&embedded(&format!("{few}burn-flex v0.22.1\nimages v1.0.0\n"))),
            [
                "filter/Cargo.toml:1: a controller compiles burn-flex",
                "filter/Cargo.toml:1: a controller compiles 67 crates; the limit is 65"
            ]
        );
    }
}

//! Rules for source files.

use super::Finding;
use super::code::{code_only, without_tests};

/// Lines a source file may have before its tests, unless it says why it is longer.
const MAX_LINES: usize = 400;

/// How a file says why it is longer, within its first lines.
const LONG: &str = "// long:";

/// Written so that this file does not contain what it looks for.
const MACHINE_PATHS: [&str; 5] = [
    concat!("/", "home/"),
    concat!("/", "root/"),
    concat!("/", "work/"),
    concat!("/", "Users/"),
    concat!("/", "tmp/bash"),
];

/// What ends a program where an error should be returned.
const PANICS: [&str; 6] = [".unwrap()", ".expect(", "panic!", "todo!", "unimplemented!", "dbg!"];

/// How the tensor backends are named.
const BACKENDS: [&str; 6] =
    ["Device::flex", "Device::ndarray", "Device::wgpu", "Device::cuda", "burn::backend", "burn_flex"];

/// The files that name a backend: where one is chosen, and where our own kernels join one.
const DEVICES: [&str; 2] = ["infer/src/device.rs", "infer/src/conv/op.rs"];

/// Every rule for one Rust file; `test_modules` are the paths that [`test_modules`] gives for all files.
pub fn check(path: &str, text: &str, test_modules: &[String]) -> Vec<Finding> {
    let code = code_only(text);
    let mut findings: Vec<_> = found(path, &code, &["#[ignore"]).collect();
    if is_library(path) && !test_modules.iter().any(|module| path.starts_with(module)) {
        findings.extend(found(path, &without_tests(&code), &PANICS));
    }
    if !DEVICES.contains(&path) {
        findings.extend(found(path, &code, &BACKENDS));
    }
    findings.extend(too_long(path, text));
    findings
}

/// Absolute paths of somebody's machine, in any text file.
pub fn machine_paths(path: &str, text: &str) -> Vec<Finding> {
    // Behind a letter, a digit or a dot it is part of a longer path or of an address.
    let stands_alone = |before: &str| !before.ends_with(|c: char| c.is_alphanumeric() || "._-~}/".contains(c));
    let hit = |line: &str| {
        MACHINE_PATHS.into_iter().find(|path| line.match_indices(path).any(|(at, _)| stands_alone(&line[..at])))
    };
    let lines = text.lines().enumerate();
    lines
        .filter_map(|(n, line)| hit(line).map(|found| Finding::new(path, n + 1, format!("machine path {found}"))))
        .collect()
}

/// Where the modules lie that a file declares for tests only, as `#[cfg(test)] mod name;`: the
/// file `name.rs` and the folder `name/`.
pub fn test_modules(path: &str, text: &str) -> Vec<String> {
    let stem = path.strip_suffix(".rs").unwrap_or(path);
    let (folder, name) = stem.rsplit_once('/').unwrap_or(("", stem));
    let folder = if ["lib", "main", "mod"].contains(&name) { folder } else { stem };
    let code = code_only(text);
    let declared = code.split("#[cfg(test)]").skip(1).filter_map(|item| {
        let item = item.trim_start();
        item.strip_prefix("pub(crate) ").unwrap_or(item).strip_prefix("mod ")?.split_once(';')
    });
    let names = declared.map(|(name, _)| name.trim()).filter(|name| !name.contains('{'));
    names.flat_map(|name| [format!("{folder}/{name}.rs"), format!("{folder}/{name}/")]).collect()
}

/// A crate's own sources, but not a program's `main`, this program or the tests.
fn is_library(path: &str) -> bool {
    let library = path.split_once("/src/").is_some_and(|(package, _)| !["xtask", "tests"].contains(&package));
    library && !path.ends_with("/main.rs")
}

/// Each line of code that holds one of the words.
fn found(path: &str, code: &str, words: &[&'static str]) -> impl Iterator<Item = Finding> {
    code.lines().enumerate().flat_map(move |(n, line)| {
        let word = words.iter().find(|word| line.contains(**word));
        word.map(|word| Finding::new(path, n + 1, format!("{word} has no place here")))
    })
}

fn too_long(path: &str, text: &str) -> Option<Finding> {
    let n_lines = text.lines().take_while(|line| line.trim() != "#[cfg(test)]").count();
    let explained = text.lines().take(20).any(|line| line.trim_start().starts_with(LONG));
    let what = format!("{n_lines} lines before the tests; over {MAX_LINES} needs a `{LONG} reason` line near the top");
    (n_lines > MAX_LINES && !explained).then(|| Finding::new(path, n_lines, what))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(path: &str, text: &str) -> Vec<String> {
        check(path, text, &[]).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_library_does_not_panic_outside_its_tests() {
        let text =
            "/// `x.unwrap()`\nfn f() {\n    g().unwrap();\n}\n#[cfg(test)]\nmod tests { fn t() { f().unwrap() } }\n";
        assert_eq!(lines("data/src/a.rs", text), ["data/src/a.rs:3: .unwrap() has no place here"]);
        for path in ["data/src/main.rs", "xtask/src/a.rs", "tests/src/a.rs", "data/tests/a.rs"] {
            assert!(lines(path, text).is_empty(), "{path}");
        }
        assert!(lines("data/src/a.rs", "fn f() { g().unwrap_or(1).expect_err(2) }").is_empty());
    }

    #[test]
    fn a_module_for_tests_may_panic() {
        let lib = "mod a;\n#[cfg(test)]\nmod world;\n#[cfg(test)]\nmod tests {\n    mod b;\n}\n";
        let modules = test_modules("data/src/lib.rs", lib);
        assert_eq!(modules, ["data/src/world.rs", "data/src/world/"]);
        assert_eq!(test_modules("data/src/a.rs", lib), ["data/src/a/world.rs", "data/src/a/world/"]);
        let text = "fn f() { g().unwrap() }";
        assert!(check("data/src/world.rs", text, &modules).is_empty());
        assert_eq!(check("data/src/worlds.rs", text, &modules).len(), 1);
    }

    #[test]
    fn no_test_is_ignored_anywhere() {
        let text = "#[cfg(test)]\nmod tests {\n    #[test]\n    #[ignore = \"slow\"]\n    fn t() {}\n}\n";
        assert_eq!(lines("tests/src/main.rs", text), ["tests/src/main.rs:4: #[ignore has no place here"]);
    }

    #[test]
    fn two_files_name_a_backend() {
        let text = "fn f() -> Device { Device::flex() }\n";
        assert_eq!(lines("train/src/a.rs", text), ["train/src/a.rs:1: Device::flex has no place here"]);
        assert!(DEVICES.iter().all(|path| lines(path, text).is_empty()));
    }

    #[test]
    fn a_long_file_gives_its_reason() {
        let body = "//\n".repeat(MAX_LINES);
        assert!(lines("a/src/a.rs", &body).is_empty());
        assert_eq!(lines("a/src/a.rs", &(body.clone() + "//\n")).len(), 1);
        assert!(lines("a/src/a.rs", &format!("//! Doc.\n{LONG} one table\n{body}")).is_empty());
        assert!(lines("a/src/a.rs", &format!("{body}#[cfg(test)]\n{body}")).is_empty());
    }

    #[test]
    fn a_path_of_one_machine_is_told_from_a_part_of_another_path() {
        for path in MACHINE_PATHS {
            assert_eq!(machine_paths("a.md", &format!("x\nsee {path}me")).len(), 1, "{path}");
            for before in ["https://example.org", "$HOME", "..", "network"] {
                assert!(machine_paths("a.md", &format!("{before}{path}me")).is_empty(), "{before}{path}");
            }
        }
    }
}

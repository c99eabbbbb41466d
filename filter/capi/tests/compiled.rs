//! The examples in C and C++, compiled by the system's compilers against this library, say to the bit what Rust says.
//!
//! Ignored where there is no `cc` or `c++`. The header compiles as C99 and C++17 with every warning an error.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

#[path = "../examples/record.rs"]
mod record;

use std::env::{current_exe, var_os};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::OnceLock;

use libtest_mimic::{Arguments, Failed, Trial};

/// All that a strict compiler says, and none of it passes.
const STRICT: [&str; 5] = ["-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"];

/// What Rust's standard library needs of the system.
const SYSTEM: [&str; 3] = ["-lpthread", "-ldl", "-lm"];

fn main() -> ExitCode {
    let (c, cpp) = (compiler("CC", "cc"), compiler("CXX", "c++"));
    let tests = vec![
        test("c_says_what_rust_says", &c, |cc| says_what_rust_says(cc, "-std=c99", "episode.c", 1)),
        test("cpp_says_what_rust_says", &cpp, |cc| says_what_rust_says(cc, "-std=c++17", "episode.cpp", 2)),
        test("cpp_works_without_exceptions", &cpp, |cc| wrapper_works(cc, &["-std=c++17", "-fno-exceptions"])),
        test("cpp_works_as_20", &cpp, |cc| wrapper_works(cc, &["-std=c++20"])),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

/// The compiler that a variable or a name finds; `None` where there is none.
fn compiler(variable: &str, name: &str) -> Option<OsString> {
    let program = var_os(variable).unwrap_or_else(|| name.into());
    let version = Command::new(&program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    version.is_ok_and(|status| status.success()).then_some(program)
}

/// A test that is ignored without its compiler.
fn test(name: &'static str, compiler: &Option<OsString>, claim: fn(OsString)) -> Trial {
    let program = compiler.clone();
    let run = move || program.map(claim).ok_or_else(|| Failed::from("no compiler"));
    Trial::test(name, run).with_ignored_flag(compiler.is_none())
}

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// The static library: cargo puts it where this test is.
fn library() -> PathBuf {
    let test = current_exe().unwrap();
    let path = test.parent().unwrap().join("libtactile_capi.a");
    assert!(path.exists(), "expected {} to be built before this test", path.display());
    path
}

fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{command:?}: {}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// A folder with what the examples read and what they should say, made once a run.
fn recorded() -> &'static (PathBuf, String) {
    static RECORDED: OnceLock<(PathBuf, String)> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("capi-compiled");
        std::fs::create_dir_all(&folder).unwrap();
        let expected = record::record(&folder, record::small_scene().unwrap()).unwrap();
        assert!(expected.lines().filter(|line| line.starts_with("touch")).count() >= 1, "{expected}");
        (folder, expected)
    })
}

fn says_what_rust_says(compiler: OsString, standard: &str, example: &str, n_episodes: usize) {
    let (folder, expected) = recorded();
    let program = compile(compiler, &[standard], &format!("examples/{example}"));
    let said = run(Command::new(program).arg(folder));
    same(&said, &expected.repeat(n_episodes));
}

/// The C++ wrapper in a mode of its own: a program that ends well only where every wrong call is an error.
fn wrapper_works(compiler: OsString, flags: &[&str]) {
    run(Command::new(compile(compiler, flags, "tests/wrapper.cpp")).arg(&recorded().0));
}

fn compile(compiler: OsString, flags: &[&str], source: &str) -> PathBuf {
    let name = format!("{source}{}", flags.concat()).replace(['/', '.', '+', '='], "-");
    let program = recorded().0.join(name);
    let mut compile = Command::new(compiler);
    compile.args(flags).args(STRICT).arg("-I").arg(folder("include")).arg(folder(source));
    run(compile.arg(library()).args(SYSTEM).arg("-o").arg(&program));
    program
}

/// Compares word by word, numbers by their bits: C writes 17 digits of each, Rust as many as tell it apart.
fn same(said: &str, expected: &str) {
    let same_word = |a: &str, b: &str| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => a.to_bits() == b.to_bits(),
        _ => a == b,
    };
    let same_line = |a: &str, b: &str| {
        let (a, b): (Vec<_>, Vec<_>) = (a.split_whitespace().collect(), b.split_whitespace().collect());
        a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| same_word(a, b))
    };
    let odd = said.lines().zip(expected.lines()).find(|(a, b)| !same_line(a, b));
    let lengths = (said.lines().count(), expected.lines().count());
    assert!(odd.is_none() && lengths.0 == lengths.1, "{odd:?}, {lengths:?} lines");
}

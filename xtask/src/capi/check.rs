//! The examples by every compiler, as users build them, watched by valgrind and sanitizers.

use std::path::{Path, PathBuf};

use super::{Library, figures, install, source};
use crate::error::{Error, Result};
use crate::program::Program;
use crate::workspace::Workspace;

/// What must be there, and the Debian package that brings it.
const TOOLS: [(&str, &str); 7] = [
    ("gcc", "gcc"),
    ("g++", "g++"),
    ("clang", "clang"),
    ("clang++", "clang"),
    ("valgrind", "valgrind"),
    ("cmake", "cmake make"),
    ("pkg-config", "pkg-config"),
];

/// The compilers for C and for C++, and how each is asked for.
const COMPILERS: [(&str, &str, &str); 4] = [
    ("gcc", "c99", "examples/episode.c"),
    ("clang", "c99", "examples/episode.c"),
    ("g++", "c++17", "examples/episode.cpp"),
    ("clang++", "c++17", "examples/episode.cpp"),
];

/// As far as a compiler can be strict; valgrind 3.19 reads no newer debug information.
const STRICT: &str = "-O1 -gdwarf-4 -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror";

/// Reads or writes where it must not, uses what is not initialised, or leaks for certain: exit code 9.
const VALGRIND: &str =
    "--quiet --error-exitcode=9 --leak-check=full --errors-for-leak-kinds=definite,indirect,possible";

/// Where things are.
struct Checks<'w> {
    workspace: &'w Workspace,
    out: PathBuf,
    prefix: PathBuf,
    episode: PathBuf,
}

/// Runs every check, prints what each found, and then the figures.
pub fn check(workspace: &Workspace) -> Result<()> {
    for (tool, packages) in TOOLS {
        let is_there = Program::new(tool).words("--version").answer(&workspace.root).is_ok();
        if !is_there {
            return Err(Error::NotInstalled { what: tool.into(), packages });
        }
    }
    let out = workspace.folder(None, &workspace.target.join("capi"))?;
    let [prefix, episode, letters] =
        ["prefix", "episode", "letters"].map(|name| workspace.folder(None, &out.join(name)));
    let (checks, letters) = (Checks { workspace, prefix: prefix?, episode: episode?, out }, letters?);
    checks.record(&checks.episode, "")?;
    if !letters.join("expected.txt").exists() {
        println!("a bank of 12 letters at 2 mm and 15 degrees is made once: some minutes");
        checks.record(&letters, "--fine")?;
    }
    let library = Library::build(workspace)?;
    install::install(workspace, &library, &checks.prefix)?;
    for (compiler, standard, example) in COMPILERS {
        checks.compiler(compiler, standard, example)?;
    }
    checks.cmake()?;
    checks.pkg_config()?;
    let program = checks.compile("gcc", &["-std=c99 -O2 -Wall -Wextra -Werror"], "tests/figures.c", &SHARED)?;
    let report = checks.installed(&program).arg(letters).output(&checks.out)?;
    figures::report(&report, &library.shared)
}

/// How a program is linked.
struct Linked {
    name: &'static str,
    library: &'static str,
    words: &'static str,
}

const SHARED: Linked = Linked { name: "shared", library: "lib/libtactile_filter.so", words: "" };
const STATIC: Linked = Linked { name: "static", library: "lib/libtactile_filter.a", words: "-lpthread -ldl -lm" };

impl Checks<'_> {
    /// Makes what the examples read.
    fn record(&self, folder: &Path, how: &str) -> Result<()> {
        let example = "run --quiet --release --package tactile-capi --example record --";
        crate::workspace::cargo().words(example).arg(folder).words(how).output(&self.workspace.root).map(|_| ())
    }

    /// Builds a program of the package against the installed library.
    fn compile(&self, compiler: &str, flags: &[&str], file: &str, linked: &Linked) -> Result<PathBuf> {
        let name = file.replace(['/', '.'], "-");
        let program = self.out.join(format!("{name}-{}-{}", compiler.replace('+', "p"), linked.name));
        let compile = flags.iter().fold(Program::new(compiler), |compile, flags| compile.words(flags));
        let compile = compile.arg("-I").arg(self.prefix.join("include")).arg(source(self.workspace, file));
        let compile = compile.arg(self.prefix.join(linked.library)).words(linked.words);
        compile.arg("-o").arg(&program).run(&self.out)?;
        Ok(program)
    }

    /// A program that finds the installed library.
    fn installed(&self, program: &Path) -> Program {
        Program::new(program).variable("LD_LIBRARY_PATH", self.prefix.join("lib"))
    }

    /// Runs an example and compares what it says with what Rust said.
    fn says(&self, what: &str, program: Program) -> Result<()> {
        let said = program.arg(&self.episode).output(&self.out)?;
        let path = self.episode.join("expected.txt");
        let expected = std::fs::read_to_string(&path).map_err(Error::io(&path))?;
        // The C++ example runs the episode twice.
        let n_times = said.lines().count() / expected.lines().count().max(1);
        if n_times == 0 || !same(&said, &expected.repeat(n_times)) {
            return Err(Error::invalid(what, "the numbers that Rust says, to the bit", "others"));
        }
        println!("{what}: {n_times} x the numbers of Rust, to the bit");
        Ok(())
    }

    /// One compiler: strict, shared and static, under valgrind, with sanitizers.
    fn compiler(&self, compiler: &str, standard: &str, example: &str) -> Result<()> {
        let standard_flag = format!("-std={standard}");
        for linked in [&SHARED, &STATIC] {
            let program = self.compile(compiler, &[&standard_flag, STRICT], example, linked)?;
            self.says(&format!("{compiler} {standard} {}", linked.name), self.installed(&program))?;
            let watched = Program::new("valgrind").words(VALGRIND).arg(&program);
            let watched = watched.variable("LD_LIBRARY_PATH", self.prefix.join("lib"));
            self.says(&format!("{compiler} {standard} {} under valgrind", linked.name), watched)?;
        }
        let sanitized = "-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer";
        let program = self.compile(compiler, &[&standard_flag, STRICT, sanitized], example, &STATIC)?;
        let program = self.installed(&program).variable("ASAN_OPTIONS", "detect_leaks=1");
        self.says(&format!("{compiler} {standard} with ASan, UBSan and LSan"), program)?;
        if standard == "c++17" {
            let flags = [&standard_flag, STRICT, "-fno-exceptions", sanitized];
            let program = self.compile(compiler, &flags, "tests/wrapper.cpp", &STATIC)?;
            Program::new(program).arg(&self.episode).run(&self.out)?;
            println!("{compiler} {standard} without exceptions: every wrong call is an error");
        }
        Ok(())
    }

    /// A user's project that says `find_package(TactileFilter)`.
    fn cmake(&self) -> Result<()> {
        let build = self.out.join("consumer");
        crate::workspace::remove(&build)?;
        let configure =
            Program::new("cmake").arg("-S").arg(source(self.workspace, "tests/consumer")).arg("-B").arg(&build);
        let mut prefix = std::ffi::OsString::from("-DCMAKE_PREFIX_PATH=");
        prefix.push(&self.prefix);
        configure.arg(prefix).output(&self.out)?;
        Program::new("cmake").arg("--build").arg(&build).output(&self.out)?;
        for name in ["episode_c", "episode_cpp", "episode_c_static", "episode_cpp_static"] {
            // No path to the library: CMake wrote it into the program.
            self.says(&format!("CMake's {name}"), Program::new(build.join(name)))?;
        }
        Ok(())
    }

    /// A user's command line with pkg-config.
    fn pkg_config(&self) -> Result<()> {
        let ask = Program::new("pkg-config").words("--cflags --libs tactile_filter");
        let flags = ask.variable("PKG_CONFIG_PATH", self.prefix.join("lib/pkgconfig")).output(&self.out)?;
        let program = self.out.join("episode-pkg-config");
        let compile = Program::new("gcc").arg(source(self.workspace, "examples/episode.c")).words(flags);
        compile.arg("-o").arg(&program).run(&self.out)?;
        self.says("pkg-config", self.installed(&program))
    }
}

/// Compares word by word, numbers by their bits: C writes 17 digits of each, Rust as many as tell it apart.
fn same(said: &str, expected: &str) -> bool {
    let same_word = |(a, b): (&str, &str)| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => a.to_bits() == b.to_bits(),
        _ => a == b,
    };
    let n_words = |text: &str| text.split_whitespace().count();
    n_words(said) == n_words(expected) && said.split_whitespace().zip(expected.split_whitespace()).all(same_word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_the_same_to_the_bit_however_they_are_written() {
        assert!(same("a 0.10000000000000001 -0\n", "a 0.1 -0"));
        for other in ["a 0.10000000000000002 -0", "b 0.1 -0", "a 0.1 0", "a 0.1", "a 0.1 -0 1"] {
            assert!(!same("a 0.1 -0", other), "{other}");
        }
    }
}

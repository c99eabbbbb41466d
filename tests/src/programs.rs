//! The programs of this workspace, built once and run as from a shell.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use std::time::Duration;

/// No program run by a test takes this long; one that does hangs.
const TIMEOUT: Duration = Duration::from_secs(300);

/// What a program left behind.
#[derive(Debug)]
pub struct Ran {
    /// The command line, for messages.
    pub command: String,
    /// Exit code; `None` where a signal or the timeout ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Ran {
    /// Standard output of a program that is done.
    ///
    /// # Panics
    /// Where the exit code is not 0.
    pub fn done(&self) -> &str {
        assert_eq!(self.code, Some(0), "{self:#?}");
        &self.stdout
    }

    /// The one line of a program that failed, without `error: `.
    ///
    /// # Panics
    /// Where the exit code is not 1, or standard error holds another line.
    pub fn failed(&self) -> &str {
        assert_eq!(self.code, Some(1), "{self:#?}");
        let [line] = self.stderr.lines().collect::<Vec<_>>()[..] else { panic!("more or less than a line: {self:#?}") };
        line.strip_prefix("error: ").unwrap_or_else(|| panic!("no error: {self:#?}"))
    }

    /// Standard error of a program that was misused.
    ///
    /// # Panics
    /// Where the exit code is not 2, or something went to standard output.
    pub fn misused(&self) -> &str {
        assert_eq!((self.code, self.stdout.as_str()), (Some(2), ""), "{self:#?}");
        &self.stderr
    }
}

/// Runs a program in a folder to its end.
///
/// # Panics
/// Where the program cannot be started.
pub fn run(program: &str, folder: &Path, args: &[&str]) -> Ran {
    let mut command = assert_cmd::Command::new(path(program));
    let output = command.current_dir(folder).args(args).timeout(TIMEOUT).output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Ran {
        command: format!("{program} {}", args.join(" ")),
        code: output.status.code(),
        stdout: text(&output.stdout),
        stderr: text(&output.stderr),
    }
}

/// The file of a program, built in the profile of this test.
pub fn path(program: &str) -> PathBuf {
    PROGRAMS.join(format!("{program}{}", env::consts::EXE_SUFFIX))
}

/// The root of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The folder of the programs.
///
/// `cargo test` builds no program for a package without integration tests of its own, so they are built
/// here, with the selection that leaves every library as `cargo test --workspace` has built it already.
static PROGRAMS: LazyLock<PathBuf> = LazyLock::new(|| {
    // TARGET/PROFILE/deps/THIS
    let this = env::current_exe().expect("this test is a file");
    let folder = this.parent().and_then(Path::parent).expect("a profile's folder above this test");
    let target = folder.parent().expect("a target folder above the profile's");
    let mut build = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--quiet", "--workspace", "--bins", "--tests"]).args(release(folder));
    build.current_dir(workspace()).env("CARGO_TARGET_DIR", target);
    let output = build.output().expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder.to_path_buf()
});

fn release(profile_folder: &Path) -> Option<&'static str> {
    profile_folder.ends_with("release").then_some("--release")
}

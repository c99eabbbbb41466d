//! A program with its arguments, run to its end and measured.

use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::error::{Error, Result};
use crate::json;

/// How often the memory of a running program is read: short compared with any step, and cheap.
const POLL: Duration = Duration::from_millis(20);

/// What a run took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Usage {
    /// Wall time, s.
    pub seconds: f64,
    /// Largest resident memory, MiB; `None` where the system has no `/proc`.
    pub peak_mib: Option<f64>,
}

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} s", self.seconds)?;
        self.peak_mib.map_or(Ok(()), |mib| write!(f, ", at most {mib:.0} MiB of memory"))
    }
}

/// A program and its arguments.
#[derive(Clone, Debug)]
pub struct Program {
    path: PathBuf,
    args: Vec<OsString>,
    variables: Vec<(&'static str, OsString)>,
}

impl Program {
    /// A program at a path, or of that name on the search path, without arguments.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), args: Vec::new(), variables: Vec::new() }
    }

    /// Where the program is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds the arguments of a text, separated by blanks.
    pub fn words(mut self, words: impl AsRef<str>) -> Self {
        self.args.extend(words.as_ref().split_whitespace().map(OsString::from));
        self
    }

    /// Adds one argument, which may contain blanks: a path.
    pub fn arg(mut self, arg: impl Into<OsString>) -> Self {
        self.args.push(arg.into());
        self
    }

    /// Sets an environment variable.
    pub fn variable(mut self, name: &'static str, value: impl Into<OsString>) -> Self {
        self.variables.push((name, value.into()));
        self
    }

    /// Runs it in a folder with its output shown.
    pub fn run(&self, folder: &Path) -> Result<Usage> {
        let start = Instant::now();
        let mut child = self.command(folder).spawn().map_err(Error::io(&self.path))?;
        let mut peak_mib = None;
        let status = wait(&mut child, &mut peak_mib).map_err(Error::io(&self.path))?;
        self.check(status)?;
        Ok(Usage { seconds: start.elapsed().as_secs_f64(), peak_mib })
    }

    /// Runs it in a folder and returns what it printed; errors and progress are shown.
    pub fn output(&self, folder: &Path) -> Result<String> {
        let output = self.finish(self.command(folder).stderr(Stdio::inherit()))?;
        self.check(output.status)?;
        String::from_utf8(output.stdout).map_err(|error| Error::invalid(self.to_string(), "UTF-8", error.to_string()))
    }

    /// Like [`Self::output`], read as JSON.
    pub fn json(&self, folder: &Path) -> Result<Value> {
        json::parse(&self.to_string(), &self.output(folder)?)
    }

    /// What it prints, whether it succeeds or not.
    pub fn answer(&self, folder: &Path) -> Result<String> {
        let output = self.finish(&mut self.command(folder))?;
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// The command to start it in a folder.
    pub fn command(&self, folder: &Path) -> Command {
        let mut command = Command::new(&self.path);
        command.args(&self.args).envs(self.variables.clone()).current_dir(folder).stdin(Stdio::null());
        command
    }

    fn finish(&self, command: &mut Command) -> Result<Output> {
        command.output().map_err(Error::io(&self.path))
    }

    fn check(&self, status: ExitStatus) -> Result<()> {
        if status.success() { Ok(()) } else { Err(Error::Failed { command: self.to_string(), status }) }
    }
}

impl fmt::Display for Program {
    /// The command line as a person would type it, with the program's folder left out.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.file_name().unwrap_or(self.path.as_os_str()).display())?;
        self.args.iter().try_for_each(|arg| write!(f, " {}", arg.display()))
    }
}

/// Waits for a child, keeping the last high-water mark that the system gave for its memory.
fn wait(child: &mut Child, peak_mib: &mut Option<f64>) -> std::io::Result<ExitStatus> {
    let path = format!("/proc/{}/status", child.id());
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        // A child that has just ended has no mark any more; the last one counts.
        *peak_mib = std::fs::read_to_string(&path).ok().as_deref().and_then(high_water_mib).or(*peak_mib);
        sleep(POLL);
    }
}

/// The `VmHWM` line of `/proc/PID/status`, in MiB.
fn high_water_mib(status: &str) -> Option<f64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_high_water_mark_is_read_in_mib() {
        assert_eq!(high_water_mib("VmPeak:\t 9 kB\nVmHWM:\t    2048 kB\nVmRSS:\t 1 kB\n"), Some(2.0));
        assert_eq!(high_water_mib("State:\tZ (zombie)\n"), None);
    }

    #[test]
    fn a_failing_program_is_named_with_its_exit_code() {
        let error = Program::new("false").words("a  b").arg("c d").run(Path::new(".")).unwrap_err();
        assert_eq!(error.to_string(), "false a b c d failed: exit status: 1");
    }
}

//! A program run to its end, timed and weighed.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};

/// How often the memory of a running program is read: short beside any step, and cheap.
const POLL: Duration = Duration::from_millis(20);

/// What a run took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Usage {
    /// Wall time, s.
    pub seconds: f64,
    /// Largest resident memory, MiB; `None` where the system has no `/proc`.
    pub peak_mib: Option<f64>,
}

/// The command line as a person would type it, with the program's folder left out.
pub fn command_line(program: &Path, args: &[&OsStr]) -> String {
    let name = program.file_name().unwrap_or(program.as_os_str());
    let words: Vec<_> = std::iter::once(name).chain(args.iter().copied()).map(|word| word.to_string_lossy()).collect();
    words.join(" ")
}

/// Runs a program in a folder with its output shown; `step` names it in an error.
pub fn run(step: &str, program: &Path, args: &[&OsStr], folder: &Path) -> Result<Usage> {
    let start = Instant::now();
    let mut command = Command::new(program);
    command.args(args).current_dir(folder).stdin(Stdio::null());
    let mut child = command.spawn().map_err(Error::io(program))?;
    let mut peak_mib = None;
    let status = wait(&mut child, &mut peak_mib).map_err(Error::io(program))?;
    if !status.success() {
        return Err(Error::Failed { step: step.into(), status });
    }
    Ok(Usage { seconds: start.elapsed().as_secs_f64(), peak_mib })
}

/// Installs Debian packages, as root.
pub fn install(packages: &[&str], folder: &Path) -> Result<()> {
    let words = ["install", "--yes", "--no-install-recommends"];
    let args: Vec<&OsStr> = words.iter().chain(packages).map(OsStr::new).collect();
    run("apt-get install (as root)", Path::new("apt-get"), &args, folder).map(|_| ())
}

/// Runs a program quietly and returns what it printed.
pub fn output(program: &OsStr, args: &[&str], folder: &Path) -> Result<String> {
    printed(Command::new(program), program, args, folder)
}

/// Like [`output`], with one thread for what the program shares out.
pub fn output_on_one_core(program: &OsStr, args: &[&str], folder: &Path) -> Result<String> {
    let mut command = Command::new(program);
    command.env("RAYON_NUM_THREADS", "1");
    printed(command, program, args, folder)
}

fn printed(mut command: Command, program: &OsStr, args: &[&str], folder: &Path) -> Result<String> {
    command.args(args).current_dir(folder).stdin(Stdio::null()).stderr(Stdio::inherit());
    let output = command.output().map_err(Error::io(program))?;
    let line = || format!("{} {}", program.to_string_lossy(), args.join(" "));
    if !output.status.success() {
        return Err(Error::Failed { step: line(), status: output.status });
    }
    String::from_utf8(output.stdout).map_err(|error| Error::invalid(line(), "UTF-8", error.to_string()))
}

/// Waits for a child, keeping the last high-water mark that the system gave for its memory.
fn wait(child: &mut Child, peak_mib: &mut Option<f64>) -> std::io::Result<ExitStatus> {
    let path = format!("/proc/{}/status", child.id());
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        // A child that has just ended has no mark any more; the last one stands.
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
        let error = run("step 1, nothing", Path::new("false"), &[], Path::new(".")).unwrap_err();
        assert_eq!(error.to_string(), "step 1, nothing failed with exit code 1");
    }
}

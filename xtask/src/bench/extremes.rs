//! `cargo xtask bench extremes`.

use std::ffi::OsStr;
use std::path::{Path, absolute};

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::Workspace;

/// Runs `tactile-filter extremes`, which prints its summary and fails where a case is not as expected.
pub fn extremes(workspace: &Workspace, out: &Path, quick: bool, seed: u64) -> Result<()> {
    let (out, seed) = (absolute(out).map_err(Error::io(out))?, seed.to_string());
    let mut args = ["extremes", "--seed", &seed, "--out"].map(OsStr::new).to_vec();
    args.push(out.as_os_str());
    if quick {
        args.push(OsStr::new("--quick"));
    }
    let program = workspace.program("tactile-filter");
    let usage = program::run("tactile-filter extremes", &program, &args, &workspace.root)?;
    let peak = usage.peak_mib.map_or(String::new(), |mib| format!(", at most {mib:.0} MiB"));
    println!("extremes: {:.1} s{peak}", usage.seconds);
    Ok(())
}

//! `cargo xtask bench sensor`.

use std::ffi::OsStr;

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::Workspace;

/// Times one `tactile-data generate`, with its start, the boards and the writing to disk.
pub fn sensor(workspace: &Workspace, n_pairs: usize, seed: u64) -> Result<()> {
    let out = workspace.target.join(format!("bench-sensor-{}", std::process::id()));
    // The `maze` preset has as many pairs on a board.
    let (pairs, boards) = (n_pairs.to_string(), n_pairs.div_ceil(150).to_string());
    let seed = seed.to_string();
    let args = ["generate", "--scene", "maze", "--frame-px", "320x240", "--pairs", &pairs, "--boards", &boards];
    let args = args.into_iter().chain(["--seed", &seed, "--out"]).map(OsStr::new);
    let args: Vec<&OsStr> = args.chain([out.as_os_str()]).collect();
    let usage = program::run("tactile-data generate", &workspace.program("tactile-data"), &args, &workspace.target);
    if out.exists() {
        std::fs::remove_dir_all(&out).map_err(Error::io(&out))?;
    }
    let usage = usage?;
    let n_images = 2 * n_pairs;
    println!(
        "sensor: {:.0} images/s at 320x240 ({n_images} images, boards: {boards}, {:.2} s, written to disk)",
        n_images as f64 / usage.seconds,
        usage.seconds
    );
    Ok(())
}

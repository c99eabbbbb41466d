//! The graphics card held against the CPU; where there is none, Mesa's llvmpipe plays one.

use std::ffi::OsStr;
use std::path::Path;

use crate::error::Result;
use crate::program;
use crate::workspace::{Workspace, cargo};

/// Where Vulkan's loader looks for drivers on Linux.
const DRIVERS: [&str; 2] = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"];

/// Debian's packages of a Vulkan driver that runs on the CPU, and of the loader.
const PACKAGES: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];

/// Installs a driver where there is none and apt is at hand, builds the programs for graphics cards, and runs the
/// tests that compare card and CPU, their figures shown. The first build takes half an hour on two cores.
pub fn wgpu(workspace: &Workspace) -> Result<()> {
    if cfg!(target_os = "linux") && !has_driver() && Path::new("/usr/bin/apt-get").exists() {
        program::install(&PACKAGES, &workspace.root)?;
    }
    let cargo = cargo();
    let packages = ["--package", "tactile-infer", "--package", "tactile-train", "--package", "tactile-filter"];
    let build =
        [&["build", "--release"], &packages[..], &["--package", "tactile-tests", "--features", "wgpu"]].concat();
    let build: Vec<&OsStr> = build.into_iter().map(OsStr::new).collect();
    program::run("cargo build", Path::new(&cargo), &build, &workspace.root)?;
    let test = [&["test", "--release"], &packages[..], &["--package", "tactile-tests", "--features", "wgpu"]].concat();
    let test = [&test[..], &["--test", "workspace", "wgpu::", "--", "--nocapture", "--test-threads", "1"]].concat();
    let test: Vec<&OsStr> = test.into_iter().map(OsStr::new).collect();
    program::run("the comparison of card and CPU", Path::new(&cargo), &test, &workspace.root).map(|_| ())
}

/// Whether a Vulkan driver is installed.
fn has_driver() -> bool {
    let holds_any = |folder: &&str| std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    DRIVERS.iter().any(holds_any)
}

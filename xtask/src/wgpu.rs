//! The graphics card compared with the CPU; where there is none, Mesa's llvmpipe replaces it.

use crate::error::{Error, Result};
use crate::workspace::Workspace;

/// Where Vulkan's loader looks for drivers on Linux.
const DRIVERS: [&str; 2] = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"];

/// Debian's packages of a Vulkan driver that runs on the CPU, and of the loader.
const PACKAGES: &str = "mesa-vulkan-drivers libvulkan1";

/// Builds the programs for graphics cards and runs the tests that compare card and CPU, their figures shown. The
/// first build takes half an hour on two cores.
pub fn wgpu(workspace: &Workspace) -> Result<()> {
    let holds_any = |folder: &&str| std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if cfg!(target_os = "linux") && !DRIVERS.iter().any(holds_any) {
        return Err(Error::NotInstalled { what: "a Vulkan driver".into(), packages: PACKAGES });
    }
    let with_cards = "--release --workspace --exclude xtask --features tactile-tests/wgpu";
    workspace.cargo(&format!("build {with_cards}"))?;
    workspace.cargo(&format!("test {with_cards} --lib on_a_card"))?;
    let filter = "--test workspace wgpu:: -- --nocapture --test-threads 1";
    workspace.cargo(&format!("test {with_cards} {filter}")).map(|_| ())
}

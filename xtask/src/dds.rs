//! ROS 2's topics and services compared with an independent implementation of DDS.

use clap::Args;

use crate::error::Result;
use crate::program::Program;
use crate::python::environment;
use crate::workspace::Workspace;

/// What `cargo xtask dds` takes.
#[derive(Args)]
pub struct DdsArgs {
    /// How long memory and processor are watched, s.
    #[arg(long, default_value_t = 60)]
    seconds: u32,
    /// One check alone: in, out, services, plain, late, quality, namespaces, malformed, packets, large, restart, clock,
    /// long.
    #[arg(long)]
    only: Option<String>,
}

/// What the script imports: CycloneDDS, compiled, from PyPI.
const REQUIREMENTS: &str = "cyclonedds==11.0.1";

/// Makes a virtual environment in the build folder and runs `tests/python/dds_peer.py` against the transport. All
/// traffic stays on 127.0.0.1. The first run needs Python 3 and PyPI.
pub fn dds(workspace: &Workspace, args: &DdsArgs) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("dds"))?;
    let python = environment(&out, REQUIREMENTS)?;
    workspace.cargo("build --release --package tactile-live --features ros2 --example ros2_peer")?;
    let peer = workspace.target.join("release/examples/ros2_peer").with_extension(std::env::consts::EXE_EXTENSION);
    let mut check = Program::new(&python).arg(workspace.root.join("tests/python/dds_peer.py")).arg(peer);
    check = check.words(format!("--seconds {}", args.seconds));
    if let Some(only) = &args.only {
        check = check.words("--only").arg(only);
    }
    check.run(&out).map(|_| ())
}

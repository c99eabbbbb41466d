//! What goes over the network, checked with independent programs: ROS 2's topics and services, and the live views.

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

/// Runs `tests/python/dds_peer.py` against the transport; all traffic stays on 127.0.0.1. The first run needs Python 3
/// and PyPI.
pub fn dds(workspace: &Workspace, args: &DdsArgs) -> Result<()> {
    let mut peer = Peer { script: "dds_peer.py", requirements: REQUIREMENTS, example: "ros2_peer", feature: "ros2" }
        .program(workspace)?
        .words(format!("--seconds {}", args.seconds));
    if let Some(only) = &args.only {
        peer = peer.words("--only").arg(only);
    }
    peer.run(&workspace.target).map(|_| ())
}

/// Runs `tests/python/foxglove_peer.py`, a viewer, against the live views. The first run needs Python 3 and PyPI.
pub fn views(workspace: &Workspace) -> Result<()> {
    let peer = Peer {
        script: "foxglove_peer.py",
        requirements: "websockets==17.4",
        example: "foxglove_peer",
        feature: "foxglove",
    };
    peer.program(workspace)?.run(&workspace.target).map(|_| ())
}

/// An independent program and the example that it is run against.
struct Peer {
    /// In `tests/python`.
    script: &'static str,
    /// What it imports.
    requirements: &'static str,
    example: &'static str,
    /// Of `tactile-live`.
    feature: &'static str,
}

impl Peer {
    /// Makes a virtual environment in the build folder and builds the example; the script, with the example's path.
    fn program(&self, workspace: &Workspace) -> Result<Program> {
        let out = workspace.folder(None, &workspace.target.join(self.example))?;
        let python = environment(&out, self.requirements)?;
        let Self { script, example, feature, .. } = self;
        workspace.cargo(&format!("build --release --package tactile-live --features {feature} --example {example}"))?;
        let built = workspace.programs().join("examples").join(example);
        let script = workspace.root.join("tests/python").join(script);
        Ok(Program::new(&python).arg(script).arg(built.with_extension(std::env::consts::EXE_EXTENSION)))
    }
}

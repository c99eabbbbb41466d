//! What goes over the network, checked with independent programs: ROS 2's topics and services, and the live views.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::{Args, ValueEnum};

use crate::error::{Error, Result};
use crate::live;
use crate::program::Program;
use crate::python::environment;
use crate::workspace::{Workspace, remove};

/// What `cargo xtask dds` takes.
#[derive(Args)]
pub struct DdsArgs {
    /// How long memory and processor are watched, s.
    #[arg(long, default_value_t = 60)]
    seconds: u32,
    /// Instead of the transport: the live node, with a robot and a camera of another make and all that goes wrong.
    #[arg(long)]
    node: bool,
    /// With --node: what robot and camera speak with.
    #[arg(long, value_enum, requires = "node", default_value_t = Middleware::Cyclonedds)]
    middleware: Middleware,
    /// One check alone: in, out, services, plain, late, quality, namespaces, malformed, packets, large, restart, clock,
    /// long; with --node planner, restart, encodings, trouble, late, graph, two, large, damaged, fuzz, camera, stopped, log,
    /// fresh, run, bare.
    #[arg(long)]
    only: Option<String>,
}

/// The middleware of the robot and the camera.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Middleware {
    /// CycloneDDS, from PyPI.
    Cyclonedds,
    /// Fast DDS, ROS 2's default, over shared memory and UDP; needs g++ and Debian's libfastrtps-dev, or is skipped.
    Fastdds,
    /// The same over UDP alone.
    FastddsUdp,
}

/// What the script imports: CycloneDDS, compiled, from PyPI.
const REQUIREMENTS: &str = "cyclonedds==11.0.1";

/// Runs `tests/python/dds_peer.py` against the transport; all traffic stays on 127.0.0.1. The first run needs Python 3
/// and PyPI.
pub fn dds(workspace: &Workspace, args: &DdsArgs) -> Result<()> {
    if args.node {
        return node(workspace, args);
    }
    let mut peer = Peer { script: "dds_peer.py", requirements: REQUIREMENTS, example: "ros2_peer", feature: "ros2" }
        .program(workspace)?
        .words(format!("--seconds {}", args.seconds));
    if let Some(only) = &args.only {
        peer = peer.words("--only").arg(only);
    }
    peer.run(&workspace.target).map(|_| ())
}

/// What the script of the node imports.
const NODE_REQUIREMENTS: &str = "cyclonedds==11.0.1 mcap numpy>=1.24 pillow";

/// The scene whose holes are touched, on the grid of the bank's places, not turned.
const HOLES: &str =
    "generate --scene alphabet-small --sides hole --xy-step-mm 2 --theta-step-deg 90 --frame-px 320x240 --out holes";

/// Runs `tests/python/live_peer.py` against `tactile-filter live --ros`, with a bank and pictures made once.
fn node(workspace: &Workspace, args: &DdsArgs) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("live_peer"))?;
    let fast_dds = match args.middleware {
        Middleware::Cyclonedds => None,
        Middleware::Fastdds | Middleware::FastddsUdp => Some(fast_dds(workspace, &out)?),
    };
    if fast_dds == Some(None) {
        println!("skipped: Fast DDS 2 or a compiler is not there; on Debian: apt-get install {FAST_DDS_PACKAGES}");
        return Ok(());
    }
    let python = environment(&out, NODE_REQUIREMENTS)?;
    workspace.build_program("tactile-data")?;
    let model = live::prepare(workspace, &out)?;
    if !out.join("pictures").exists() {
        remove(&out.join("holes"))?;
        let data = || workspace.program("tactile-data");
        data().words(HOLES).run(&out)?;
        data().words("export holes --to folder --out pictures").run(&out)?;
    }
    let mut peer = Program::new(&python).arg(workspace.root.join("tests/python/live_peer.py"));
    peer = peer.arg(workspace.program("tactile-filter").path()).words("--model").arg(&model);
    peer = peer.words(format!("--bank pegs.bank --pictures pictures --seconds {}", args.seconds));
    if let Some(only) = &args.only {
        peer = peer.words("--only").arg(only);
    }
    if let Some(program) = fast_dds.flatten() {
        peer = peer.variable("FASTDDS_PEER", program);
    }
    if args.middleware == Middleware::FastddsUdp {
        peer = peer.variable("FASTDDS_TRANSPORT", "udp");
    }
    peer.run(&out).map(|_| ())
}

/// What the program on Fast DDS is compiled with.
const FAST_DDS_PACKAGES: &str = "g++ libfastrtps-dev";

/// Compiles `tests/fastdds/peer.cpp` into a folder, if it has changed; its program. `None`: that cannot be done here.
fn fast_dds(workspace: &Workspace, out: &Path) -> Result<Option<PathBuf>> {
    let gcc = || Program::new("g++");
    // Version 2 of the library has this header.
    let probe = gcc().words("-fsyntax-only -x c++ -include fastrtps/config.h /dev/null").command(out).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        return Ok(None);
    }
    let (source, program) = (workspace.root.join("tests/fastdds/peer.cpp"), out.join("fastdds-peer"));
    let changed = |path: &Path| fs::metadata(path).and_then(|data| data.modified()).map_err(Error::io(path));
    if changed(&program).unwrap_or(SystemTime::UNIX_EPOCH) < changed(&source)? {
        let compile = gcc().words("-std=c++17 -O1 -Wall -Wextra -Werror -o").arg(&program).arg(&source);
        compile.words("-lfastrtps -lfastcdr").run(out)?;
    }
    Ok(Some(program))
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
    /// The feature of `tactile-live` that it needs.
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

//! The live node and a simulated robot as two processes on one network: the demo, the integration test, and the template
//! for a lab's own bridge.

use std::path::Path;
use std::process::Child;
use std::time::Duration;

use crate::error::{Error, Result};
use crate::program::Program;
use crate::workspace::Workspace;

/// The scene whose holes are identified.
const SCENE: &str = "alphabet-small";

/// A bank dense enough for touches anywhere.
const GRID: &str = "--xy-step-mm 2 --theta-step-deg 15";

/// Holes to identify.
const EPISODES: usize = 3;

/// A domain that is not ROS 2's usual one: other nodes on this network are not disturbed.
const DOMAIN: &str = "87";

/// How long the node may take to end its log.
const ENDING: Duration = Duration::from_secs(10);

/// Starts `tactile-filter live --ros` and `tactile-filter robot`, waits for the robot to end, and replays the log.
pub fn live(workspace: &Workspace, out: Option<&Path>, seed: u64) -> Result<()> {
    let out = workspace.folder(out, Path::new("demo-live"))?;
    let log = out.join("live.mcap");
    if log.exists() {
        return Err(Error::invalid(log.display().to_string(), "a new log", "one of an earlier run: remove it"));
    }
    workspace.build_program("tactile-infer")?;
    workspace.cargo("build --release --bin tactile-filter --features tactile-filter-cli/ros2")?;
    let model = workspace.shipped_model();
    if !out.join("pegs.bank").exists() {
        let bank = workspace.program("tactile-infer").words("bank --model").arg(&model);
        bank.words(format!("--scene {SCENE} {GRID} --out pegs.bank")).run(&out)?;
    }
    let on_network = |program: Program| program.variable("ROS_DOMAIN_ID", DOMAIN).variable("ROS_LOCALHOST_ONLY", "1");
    let filter = || workspace.program("tactile-filter");
    let node = on_network(filter().words("live --ros --model").arg(&model).words("--bank pegs.bank --log live.mcap"));
    let robot = format!(
        "robot --scene {SCENE} --episodes {EPISODES} --seed {seed} --jpeg 90 --faults dropped=0.02,frozen=0.01"
    );
    let robot = on_network(filter().words(robot));
    println!("== {node} &\n== {robot}");
    let mut running = node.command(&out).spawn().map_err(Error::io(node.path()))?;
    let done = robot.run(&out);
    let ended = end(&mut running);
    done?;
    ended?;
    let replay = filter().words("replay --model").arg(&model).words("--bank pegs.bank --log live.mcap");
    println!("== {replay}");
    replay.run(&out)?;
    println!("log: {} (Foxglove opens it with filter/live/foxglove-layout.json)", log.display());
    Ok(())
}

/// Asks the node to end, as ctrl-C does, and waits until it has.
fn end(node: &mut Child) -> Result<()> {
    let id = node.id().to_string();
    Program::new("kill").words(format!("-INT {id}")).run(Path::new("."))?;
    let waits = ENDING.as_millis() / 100;
    for _ in 0..waits {
        if node.try_wait().map_err(Error::io("tactile-filter"))?.is_some() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    node.kill().map_err(Error::io("tactile-filter"))?;
    Err(Error::invalid("tactile-filter live", "an end within 10 s of ctrl-C", "none"))
}

//! The live node and a simulated robot as two processes on one network: the demo, the integration test, and the template
//! for a lab's own bridge.

use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

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

/// How often it is seen whether a program has ended.
const POLL: Duration = Duration::from_millis(100);

/// Starts `tactile-filter live --ros` and `tactile-filter robot`, waits for the robot to end, and replays the log.
pub fn live(workspace: &Workspace, out: Option<&Path>, seed: u64) -> Result<()> {
    let out = workspace.folder(out, Path::new("demo-live"))?;
    let log = out.join("live.mcap");
    if log.exists() {
        return Err(Error::invalid(log.display().to_string(), "a new log", "one of an earlier run: remove it"));
    }
    let model = prepare(workspace, &out)?;
    let on_network = |program: Program| program.variable("ROS_DOMAIN_ID", DOMAIN).variable("ROS_LOCALHOST_ONLY", "1");
    let filter = || workspace.program("tactile-filter");
    let node = on_network(filter().words("live --ros --model").arg(&model).words("--bank pegs.bank --log live.mcap"));
    let robot = format!(
        "robot --scene {SCENE} --episodes {EPISODES} --seed {seed} --jpeg 90 --faults dropped=0.02,frozen=0.01"
    );
    let robot = on_network(filter().words(robot));
    println!("== {node} &\n== {robot}");
    let mut running = node.command(&out).spawn().map_err(Error::io(node.path()))?;
    let done = while_it_runs(&mut running, &robot, &out);
    let ended = end(&mut running);
    done?;
    ended?;
    let replay = filter().words("replay --model").arg(&model).words("--bank pegs.bank --log live.mcap");
    println!("== {replay}");
    replay.run(&out)?;
    println!("log: {} (Foxglove opens it with filter/live/foxglove-layout.json)", log.display());
    Ok(())
}

/// Builds the program that knows ROS 2 and makes its bank, `pegs.bank` in the folder `out`, where there is none; the
/// model.
pub fn prepare(workspace: &Workspace, out: &Path) -> Result<PathBuf> {
    workspace.build_program("tactile-infer")?;
    workspace.cargo("build --release --bin tactile-filter --features tactile-filter-cli/ros2")?;
    let model = workspace.shipped_model();
    if !out.join("pegs.bank").exists() {
        let bank = workspace.program("tactile-infer").words("bank --model").arg(&model);
        bank.words(format!("--scene {SCENE} {GRID} --out pegs.bank")).run(out)?;
    }
    Ok(model)
}

/// Runs the robot to its end; it would wait for a node that has ended.
fn while_it_runs(node: &mut Child, robot: &Program, out: &Path) -> Result<()> {
    let mut running = robot.command(out).spawn().map_err(Error::io(robot.path()))?;
    loop {
        if let Some(status) = running.try_wait().map_err(Error::io(robot.path()))? {
            return if status.success() { Ok(()) } else { Err(Error::Failed { command: robot.to_string(), status }) };
        }
        if let Some(status) = node.try_wait().map_err(Error::io("tactile-filter"))? {
            running.kill().and_then(|()| running.wait()).map_err(Error::io(robot.path()))?;
            return Err(Error::Failed { command: "tactile-filter live".to_owned(), status });
        }
        sleep(POLL);
    }
}

/// Asks the node to end, as ctrl-C does, and waits until it has.
fn end(node: &mut Child) -> Result<()> {
    let has_ended = |node: &mut Child| node.try_wait().map_err(Error::io("tactile-filter"));
    if has_ended(node)?.is_some() {
        return Ok(());
    }
    let id = node.id().to_string();
    Program::new("kill").words(format!("-INT {id}")).run(Path::new("."))?;
    let deadline = Instant::now() + ENDING;
    while Instant::now() < deadline {
        if let Some(status) = has_ended(node)? {
            let command = "tactile-filter live".to_owned();
            return if status.success() { Ok(()) } else { Err(Error::Failed { command, status }) };
        }
        sleep(POLL);
    }
    node.kill().and_then(|()| node.wait()).map_err(Error::io("tactile-filter"))?;
    Err(Error::invalid("tactile-filter live", "an end within 10 s of ctrl-C", "none"))
}

//! `tactile-filter robot`.

use clap::Args;

use super::failure::Result;
use super::simulated::SimulatedArgs;

/// A simulated robot with its sensor on a ROS 2 network, to try `live --ros` with (a program built with
/// `--features ros2`).
#[derive(Args)]
#[cfg_attr(not(feature = "ros2"), allow(dead_code, reason = "the flags exist, and say what is missing"))]
#[command(after_help = "Example:\n  tactile-filter robot --scene alphabet-small --episodes 3 --jpeg 90")]
pub struct RobotArgs {
    /// The scene whose holes are under the sensor
    #[arg(long, value_name = "SCENE")]
    scene: String,
    /// Full name of the node that it talks to
    #[arg(long, value_name = "NAME", default_value = "/tactile_filter")]
    node: String,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Words of ROS 2: -r FROM:=TO, -r __ns:=/NAME
    #[arg(long, num_args = 0.., allow_hyphen_values = true, value_terminator = "--", value_name = "WORDS")]
    ros_args: Vec<String>,
}

impl RobotArgs {
    /// Says what is missing.
    #[cfg(not(feature = "ros2"))]
    pub fn run(self) -> Result<()> {
        Err(super::ros::no_ros().into())
    }

    /// Runs the command.
    #[cfg(feature = "ros2")]
    pub fn run(self) -> Result<()> {
        use tactile_data::dataset::touch::Side;
        use tactile_data::scene::Scene;
        use tactile_live::shell::ros_robot::RobotNetwork;

        use tactile_live::shell::speaker::Speaker;

        use super::live::stop_on_signals;
        use super::simulated::summary;

        let robot = self.simulated.robot(Scene::load(&self.scene)?, Side::Hole)?;
        let (bus, inbox) = super::ros::open("tactile_robot", &self.ros_args)?;
        let network = RobotNetwork::join(bus, inbox, &self.node)?;
        let mut speaker = Speaker::new(false);
        let outcomes = network.run(robot, stop_on_signals()?, &mut |spoken| speaker.tell(&spoken))?;
        speaker.print(&summary(&outcomes));
        Ok(())
    }
}

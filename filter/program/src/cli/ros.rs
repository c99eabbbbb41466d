//! The way of every command to a ROS 2 network.

#[cfg(not(feature = "ros2"))]
use tactile_live::Error;
#[cfg(feature = "ros2")]
use tactile_live::Result;
#[cfg(feature = "ros2")]
use tactile_live::parameters::DISTRIBUTION;
#[cfg(feature = "ros2")]
use tactile_live::ros2::{Arguments, Bus, Inbox, Settings, arguments};

/// What is said where the program knows no ROS 2.
#[cfg(not(feature = "ros2"))]
pub fn no_ros() -> Error {
    let how = "cargo build --release -p tactile-filter-cli --features ros2";
    Error::invalid("ROS 2", format!("a program built with it ({how})"), "one without")
}

/// The words behind `--ros-args`, and the settings of a node of this name that they and the environment ask for.
#[cfg(feature = "ros2")]
pub fn settings(node: &str, ros_args: &[String]) -> Result<(Arguments, Settings)> {
    let words = arguments(std::iter::once("--ros-args".to_owned()).chain(ros_args.iter().cloned()))?;
    let settings = Settings::from_words(node, &words, |name| std::env::var(name).ok())?;
    let stated = words.parameters.iter().rfind(|parameter| parameter.name == DISTRIBUTION);
    match stated.map(|parameter| parameter.value.clone()) {
        Some(distribution) => Ok((words, settings.in_distribution(&distribution)?)),
        None => Ok((words, settings)),
    }
}

/// Joins the network as a node of this name.
#[cfg(feature = "ros2")]
pub fn open(node: &str, ros_args: &[String]) -> Result<(Bus, Inbox)> {
    let (_, settings) = settings(node, ros_args)?;
    Ok(Bus::open(settings)?)
}

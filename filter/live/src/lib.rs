//! Live touches: pictures and tool poses in, decisions out.
//!
//! The main type is [`Node`]: a pure step from an event to what is published, which knows no clock, no network and no
//! file. What feeds it (ROS 2, standard input, a folder), its [`log`], its replay and a simulated robot are thin
//! programs around it. The same events, model and bank give the same bytes, so a log can be replayed and compared.
//!
//! This crate must not know how a simulated robot's hole is: the robot is another process, or another value that
//! only messages connect with the node.

#![cfg_attr(test, allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic"))]

pub mod camera;
pub mod decision;
mod error;
pub mod event;
#[cfg(feature = "foxglove")]
pub mod foxglove;
pub mod log;
mod node;
pub mod parameters;
mod published;
pub mod replay;
mod rest;
#[cfg(feature = "robot")]
pub mod robot;
#[cfg(feature = "ros2")]
pub mod ros2;
mod running;
mod seen;
pub mod session;
pub mod shell;
pub mod sources;
pub mod stillness;
pub mod tool;
mod troubles;
#[cfg(feature = "watch")]
pub mod watch;

pub use decision::DecisionReport;
pub use error::{Error, Result};
pub use event::{Event, Given, Input, Output, Request, Topic};
pub use node::Node;
pub use parameters::Parameters;

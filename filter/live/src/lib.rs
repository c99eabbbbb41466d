//! Live touches: frames and poses in, decisions out.

#[cfg(feature = "ros2")]
pub mod ros2;

#[cfg(feature = "foxglove")]
pub mod foxglove;

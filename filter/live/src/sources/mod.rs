//! Events without ROS: a film of JPEGs on standard input, or a folder that pictures are put into.

pub mod commands;
pub mod folder;
pub mod lines;
pub mod mjpeg;

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{CompressedImage, Header, PoseStamped, to_cdr};
use tactile_data::recording::ros::rigid::Rigid;

use crate::event::{Given, Input};

/// The node's clock: the wall clock's time at its start, and then a clock that never goes back.
#[derive(Clone, Copy, Debug)]
pub struct NodeClock {
    start: Instant,
    start_ns: i64,
}

impl NodeClock {
    /// Starts now.
    pub fn start() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { start: Instant::now(), start_ns: i64::try_from(since.as_nanos()).unwrap_or(i64::MAX) }
    }

    /// Nanoseconds now.
    pub fn now_ns(&self) -> i64 {
        self.at_ns(Instant::now())
    }

    /// Nanoseconds at a moment.
    pub fn at_ns(&self, moment: Instant) -> i64 {
        let since = moment.saturating_duration_since(self.start);
        self.start_ns.saturating_add(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
    }
}

/// A JPEG or PNG as a camera's message.
pub fn picture(data: Vec<u8>) -> Input {
    let format = if data.starts_with(b"\x89PNG") { "png" } else { "jpeg" };
    let header = Header { frame_id: "tactile_sensor".into(), ..Header::default() };
    Input::Given(Given::CompressedImage, to_cdr(&CompressedImage { header, format: format.into(), data }))
}

/// The sensor's pose in a plane that does not move, as a tool's message.
pub fn placed(plane_from_sensor: &Se2) -> Input {
    let header = Header { frame_id: "plane".into(), ..Header::default() };
    Input::Given(Given::ToolPose, to_cdr(&PoseStamped { header, pose: Rigid::from_plane(plane_from_sensor).to_pose() }))
}

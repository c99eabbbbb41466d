//! A dataset as a ROS 2 bag in MCAP.

use std::fs::File;
use std::path::Path;

use crate::dataset::export::jpeg;
use crate::dataset::export::partial::Partial;
use crate::dataset::store::Dataset;
use crate::dataset::touch::{Side, Touch};
use crate::error::Result;
use crate::frame::Frame;
use crate::recording::rest::MAX_REST_FRAMES;
use crate::recording::ros::bag_writer::{BagWriter, ChannelId};
use crate::recording::ros::messages::{CompressedImage, Header, Image, PoseStamped, Time, to_cdr};
use crate::recording::ros::rigid::Rigid;

/// The topic of the pictures.
pub const IMAGE_TOPIC: &str = "/gelsight/image";

/// The topic of the sensor's poses on the part.
pub const POSE_TOPIC: &str = "/tool_pose";

/// The frame in which the camera's pictures are.
const CAMERA_FRAME: &str = "gelsight";

/// Between two frames where their times are not known: 25 frames a second, a GelSight Mini's.
const FRAME_NS: i64 = 40_000_000;

/// Between the last frame at rest and the first touch: no pose of the one is taken for the other's.
const PAUSE_NS: i64 = 1_000_000_000;

/// The pictures at rest and the pause after them begin at one second or later: a time of zero means none.
const LEAST_FIRST_TOUCH_NS: i64 = PAUSE_NS + (MAX_REST_FRAMES as i64) * FRAME_NS + 1_000_000_000;

/// Writes a new MCAP file: on [`IMAGE_TOPIC`] the frame at rest, 15 times, then the touches (Image in rgb8, or
/// CompressedImage with a JPEG `quality` of 1 to 100), on [`POSE_TOPIC`] the poses that are known, in a frame called
/// `hole/NAME` or `peg/NAME`. The times are the touches' where all have one and they grow, else 0.04 s apart; all are
/// moved where the first is below 2.6 s. `progress` gets the frames done and all frames.
///
/// # Errors
/// A name in use; a disk that cannot be written.
pub fn export(dataset: &Dataset, out: &Path, quality: Option<u8>, progress: &dyn Fn(usize, usize)) -> Result<()> {
    let times = times_ns(dataset.touches());
    let (partial, file) = Partial::file(out)?;
    let mut bag = TouchBag::create(partial.path(), file, quality)?;
    let first = times.first().copied().unwrap_or(LEAST_FIRST_TOUCH_NS);
    for back in (0..MAX_REST_FRAMES as i64).rev() {
        bag.picture(first - PAUSE_NS - back * FRAME_NS, dataset.no_contact())?;
    }
    for (i, time_ns) in times.iter().enumerate() {
        bag.picture(*time_ns, &dataset.frame(i))?;
        bag.pose(*time_ns, dataset.touch(i))?;
        progress(i + 1, dataset.len());
    }
    bag.bag.finish()?;
    partial.finish()
}

/// A time for every touch, nanoseconds, growing.
fn times_ns(touches: &[Touch]) -> Vec<i64> {
    let known = |touch: &Touch| {
        // A header's seconds have 32 bits.
        let time_s = touch.time_s.filter(|time_s| (0.0..f64::from(i32::MAX) - 10.0).contains(time_s))?;
        Some(time_s.floor() as i64 * 1_000_000_000 + (time_s.fract() * 1e9).round() as i64)
    };
    let known: Option<Vec<i64>> = touches.iter().map(known).collect();
    let known = known.filter(|times| times.windows(2).all(|pair| pair[0] < pair[1]));
    let mut times = known.unwrap_or_else(|| (0..touches.len() as i64).map(|i| i * FRAME_NS).collect());
    let shift = times.first().map_or(0, |first| (LEAST_FIRST_TOUCH_NS - first).max(0));
    times.iter_mut().for_each(|time| *time += shift);
    times
}

/// A bag with two topics.
struct TouchBag {
    bag: BagWriter,
    quality: Option<u8>,
    image_channel: ChannelId,
    pose_channel: ChannelId,
}

impl TouchBag {
    fn create(path: &Path, file: File, quality: Option<u8>) -> Result<Self> {
        let mut bag = BagWriter::new(path, file, concat!("tactile-data ", env!("CARGO_PKG_VERSION")))?;
        let image_channel = match quality {
            Some(_) => bag.channel::<CompressedImage>(IMAGE_TOPIC)?,
            None => bag.channel::<Image>(IMAGE_TOPIC)?,
        };
        let pose_channel = bag.channel::<PoseStamped>(POSE_TOPIC)?;
        Ok(Self { bag, quality, image_channel, pose_channel })
    }

    fn picture(&mut self, time_ns: i64, frame: &Frame) -> Result<()> {
        let header = Header { stamp: Time::of_nanoseconds(time_ns), frame_id: CAMERA_FRAME.to_owned() };
        let cdr = match self.quality {
            Some(quality) => {
                to_cdr(&CompressedImage { header, format: "jpeg".to_owned(), data: jpeg(frame, quality)? })
            }
            None => to_cdr(&Image::of_frame(header, frame)),
        };
        self.bag.write(self.image_channel, time_ns, &cdr)
    }

    /// Writes the touch's pose, where it is known.
    fn pose(&mut self, time_ns: i64, touch: &Touch) -> Result<()> {
        let Some(part_from_sensor) = touch.part_from_sensor else { return Ok(()) };
        let part = touch.part.as_deref().unwrap_or_default();
        let frame_id = match touch.side {
            Some(Side::Hole) => format!("hole/{part}"),
            Some(Side::Peg) => format!("peg/{part}"),
            None => part.to_owned(),
        };
        let header = Header { stamp: Time::of_nanoseconds(time_ns), frame_id };
        let pose = Rigid::from_plane(&part_from_sensor).to_pose();
        self.bag.write(self.pose_channel, time_ns, &to_cdr(&PoseStamped { header, pose }))
    }
}

//! A dataset as a ROS 2 bag in MCAP.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::error::{Error, Result};
use crate::export::jpeg;
use crate::export::partial::Partial;
use crate::frame::Frame;
use crate::recording::rest::MAX_REST_FRAMES;
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{CompressedImage, Header, Image, Message, PoseStamped, Time, to_cdr};
use crate::recording::ros::rigid::Rigid;
use crate::store::Dataset;
use crate::touch::{Side, Touch};

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
    let mut bag = BagWriter::create(partial.path(), file, quality)?;
    let first = times.first().copied().unwrap_or(LEAST_FIRST_TOUCH_NS);
    for back in (0..MAX_REST_FRAMES as i64).rev() {
        bag.picture(first - PAUSE_NS - back * FRAME_NS, dataset.no_contact())?;
    }
    for (i, time_ns) in times.iter().enumerate() {
        bag.picture(*time_ns, &dataset.frame(i))?;
        bag.pose(*time_ns, dataset.touch(i))?;
        progress(i + 1, dataset.len());
    }
    bag.finish()?;
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

fn stamp(time_ns: i64) -> Time {
    let [sec, nanosec] = [time_ns.div_euclid(1_000_000_000), time_ns.rem_euclid(1_000_000_000)];
    Time { sec: sec as i32, nanosec: nanosec as u32 }
}

/// A bag with two topics.
struct BagWriter<'a> {
    path: &'a Path,
    writer: Writer<BufWriter<File>>,
    quality: Option<u8>,
    image_channel: u16,
    pose_channel: u16,
    /// Messages so far of each channel.
    sequence: BTreeMap<u16, u32>,
}

impl<'a> BagWriter<'a> {
    fn create(path: &'a Path, file: File, quality: Option<u8>) -> Result<Self> {
        let options = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library(concat!("tactile-data ", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(BufWriter::new(file)).map_err(failed(path))?;
        let image_channel = match quality {
            Some(_) => channel::<CompressedImage>(&mut writer, IMAGE_TOPIC, definitions::COMPRESSED_IMAGE),
            None => channel::<Image>(&mut writer, IMAGE_TOPIC, definitions::IMAGE),
        }
        .map_err(failed(path))?;
        let pose_channel = channel::<PoseStamped>(&mut writer, POSE_TOPIC, definitions::POSE_STAMPED);
        let pose_channel = pose_channel.map_err(failed(path))?;
        Ok(Self { path, writer, quality, image_channel, pose_channel, sequence: BTreeMap::new() })
    }

    fn picture(&mut self, time_ns: i64, frame: &Frame) -> Result<()> {
        let header = Header { stamp: stamp(time_ns), frame_id: CAMERA_FRAME.to_owned() };
        let cdr = match self.quality {
            Some(quality) => {
                to_cdr(&CompressedImage { header, format: "jpeg".to_owned(), data: jpeg(frame, quality)? })
            }
            None => to_cdr(&Image {
                header,
                height: frame.height_px() as u32,
                width: frame.width_px() as u32,
                encoding: "rgb8".to_owned(),
                is_bigendian: 0,
                step: 3 * frame.width_px() as u32,
                data: frame.rgb().to_vec(),
            }),
        };
        self.write(self.image_channel, time_ns, &cdr)
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
        let header = Header { stamp: stamp(time_ns), frame_id };
        let pose = Rigid::from_plane(&part_from_sensor).to_pose();
        self.write(self.pose_channel, time_ns, &to_cdr(&PoseStamped { header, pose }))
    }

    fn write(&mut self, channel_id: u16, time_ns: i64, cdr: &[u8]) -> Result<()> {
        let sequence = self.sequence.entry(channel_id).or_default();
        let time = time_ns.unsigned_abs();
        let header = MessageHeader { channel_id, sequence: *sequence, log_time: time, publish_time: time };
        *sequence += 1;
        self.writer.write_to_known_channel(&header, cdr).map_err(failed(self.path))
    }

    fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(failed(self.path))?;
        let mut file = self.writer.into_inner();
        file.flush().and_then(|()| file.get_ref().sync_all()).map_err(Error::io(self.path))
    }
}

fn channel<M: Message>(writer: &mut Writer<BufWriter<File>>, topic: &str, definition: &str) -> mcap::McapResult<u16> {
    let schema = writer.add_schema(M::TYPE, "ros2msg", definition.as_bytes())?;
    let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
    writer.add_channel(schema, topic, "cdr", &qos)
}

fn failed(path: &Path) -> impl FnOnce(mcap::McapError) -> Error {
    move |error| match error {
        mcap::McapError::Io(error) => Error::io(path)(error),
        other => Error::invalid(path.display().to_string(), "a bag that can be written", other.to_string()),
    }
}

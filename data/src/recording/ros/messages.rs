//! The ROS 2 messages that a tactile sensor and its robot send, and their bytes.
//!
//! Lengths are metres, rotations unit quaternions, as everywhere in ROS.

use crate::error::Result;
use crate::recording::ros::cdr::{Reader, Writer};

/// A message with a name and a layout.
pub trait Message: Sized {
    /// Its type, such as `sensor_msgs/msg/Image`.
    const TYPE: &str;
    /// Reads the fields.
    ///
    /// # Errors
    /// Bytes that end too early, text that is not UTF-8.
    fn read(cdr: &mut Reader) -> Result<Self>;
    /// Writes the fields.
    fn write(&self, cdr: &mut Writer);
}

/// Reads a message in CDR; `place` names it in errors. Bytes behind it are padding.
///
/// # Errors
/// As [`Reader::new`] and [`Message::read`].
pub fn from_cdr<M: Message>(bytes: &[u8], place: &str) -> Result<M> {
    M::read(&mut Reader::new(bytes, place)?)
}

/// The bytes of a message in CDR.
pub fn to_cdr(message: &impl Message) -> Vec<u8> {
    let mut cdr = Writer::default();
    message.write(&mut cdr);
    cdr.finish()
}

/// A moment on the sender's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds after them.
    pub nanosec: u32,
}

impl Time {
    /// Nanoseconds since the clock's zero.
    pub fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}

/// When and in which frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// When the data was taken; zero where the sender did not fill it in.
    pub stamp: Time,
    /// The frame in which the data is given.
    pub frame_id: String,
}

impl Header {
    /// Reads the fields.
    pub fn read(cdr: &mut Reader) -> Result<Self> {
        let stamp = Time { sec: cdr.i32("header.stamp.sec")?, nanosec: cdr.u32("header.stamp.nanosec")? };
        Ok(Self { stamp, frame_id: cdr.string("header.frame_id")? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.i32(self.stamp.sec);
        cdr.u32(self.stamp.nanosec);
        cdr.string(&self.frame_id);
    }
}

/// `sensor_msgs/msg/Image`: a picture as plain pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// When, and the camera's frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Pixels in a row.
    pub width: u32,
    /// Channels and their order: `rgb8`, `bgr8`, `mono8`.
    pub encoding: String,
    /// Whether numbers of several bytes are big endian.
    pub is_bigendian: u8,
    /// Bytes from the start of a row to the start of the next.
    pub step: u32,
    /// `step * height` bytes, rows from the top.
    pub data: Vec<u8>,
}

impl Message for Image {
    const TYPE: &str = "sensor_msgs/msg/Image";

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self {
            header: Header::read(cdr)?,
            height: cdr.u32("height")?,
            width: cdr.u32("width")?,
            encoding: cdr.string("encoding")?,
            is_bigendian: cdr.u8("is_bigendian")?,
            step: cdr.u32("step")?,
            data: cdr.bytes("data")?.to_vec(),
        })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.u32(self.height);
        cdr.u32(self.width);
        cdr.string(&self.encoding);
        cdr.u8(self.is_bigendian);
        cdr.u32(self.step);
        cdr.bytes(&self.data);
    }
}

/// `sensor_msgs/msg/CompressedImage`: a picture as the bytes of a JPEG or PNG.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CompressedImage {
    /// When, and the camera's frame.
    pub header: Header,
    /// What the sender calls the format.
    pub format: String,
    /// The picture's file.
    pub data: Vec<u8>,
}

impl Message for CompressedImage {
    const TYPE: &str = "sensor_msgs/msg/CompressedImage";

    fn read(cdr: &mut Reader) -> Result<Self> {
        let header = Header::read(cdr)?;
        Ok(Self { header, format: cdr.string("format")?, data: cdr.bytes("data")?.to_vec() })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.string(&self.format);
        cdr.bytes(&self.data);
    }
}

/// A place and a rotation in space: `geometry_msgs/msg/Pose` and `Transform`, which have one layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// x, y and z, metres.
    pub position: [f64; 3],
    /// x, y, z and w of a unit quaternion.
    pub orientation: [f64; 4],
}

impl Pose {
    fn read(cdr: &mut Reader) -> Result<Self> {
        let mut pose = Self { position: [0.0; 3], orientation: [0.0; 4] };
        for value in pose.position.iter_mut().chain(&mut pose.orientation) {
            *value = cdr.f64("a pose")?;
        }
        Ok(pose)
    }

    fn write(&self, cdr: &mut Writer) {
        self.position.iter().chain(&self.orientation).for_each(|value| cdr.f64(*value));
    }
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseStamped {
    /// When, and the frame in which the pose is given.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

impl Message for PoseStamped {
    const TYPE: &str = "geometry_msgs/msg/PoseStamped";

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self { header: Header::read(cdr)?, pose: Pose::read(cdr)? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        self.pose.write(cdr);
    }
}

/// `geometry_msgs/msg/TransformStamped`: the pose of the child's frame in the header's.
#[derive(Clone, Debug, PartialEq)]
pub struct TransformStamped {
    /// When, and the parent's frame.
    pub header: Header,
    /// The frame whose pose it is.
    pub child_frame_id: String,
    /// The pose.
    pub transform: Pose,
}

impl TransformStamped {
    /// What one takes at least: a stamp, two empty names and seven numbers.
    const LEAST_BYTES: usize = 8 + 4 + 4 + 56;
}

impl Message for TransformStamped {
    const TYPE: &str = "geometry_msgs/msg/TransformStamped";

    fn read(cdr: &mut Reader) -> Result<Self> {
        let header = Header::read(cdr)?;
        Ok(Self { header, child_frame_id: cdr.string("child_frame_id")?, transform: Pose::read(cdr)? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.string(&self.child_frame_id);
        self.transform.write(cdr);
    }
}

/// `tf2_msgs/msg/TFMessage`: what `/tf` and `/tf_static` carry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TFMessage {
    /// Any number of transforms.
    pub transforms: Vec<TransformStamped>,
}

impl Message for TFMessage {
    const TYPE: &str = "tf2_msgs/msg/TFMessage";

    fn read(cdr: &mut Reader) -> Result<Self> {
        let count = cdr.count(TransformStamped::LEAST_BYTES, "transforms")?;
        Ok(Self { transforms: (0..count).map(|_| TransformStamped::read(cdr)).collect::<Result<_>>()? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.u32(self.transforms.len() as u32);
        self.transforms.iter().for_each(|transform| transform.write(cdr));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Debug;

    // Written by `rosbags` 0.11.9 (ROS2_HUMBLE), an independent program in Python.
    const IMAGE: &str = "000100000c00000035a49a140400000067656c0001000000020000000500000062677238000000000800\
                         0000080000000102030405060000";
    const COMPRESSED: &str = "000100000c00000035a49a140200000067000000050000006a7065670000000003000000ffd801";
    const POSE: &str = "000100000c00000035a49a1407000000686f6c652f41000000000000fca9f1d24d62703ffca9f1d24d6280bf0000\
                        00000000e03f00000000000000000000000000000000333333333333e33f9a9999999999e93f";
    const TF: &str = "00010000020000000c00000035a49a1405000000626173650000000006000000746f6f6c300000000000000000000000\
                      0000f03f00000000000000400000000000000840000000000000000000000000000000000000000000000000000000\
                      000000f03f0c00000035a49a1406000000746f6f6c300000000700000073656e736f720000000000000000f0bf0000\
                      00000000d03f0000000000000000000000000000f03f000000000000000000000000000000000000000000000000";

    fn bytes(hex: &str) -> Vec<u8> {
        let digits: Vec<u8> = hex.chars().filter_map(|c| c.to_digit(16)).map(|digit| digit as u8).collect();
        digits.chunks(2).map(|pair| 16 * pair[0] + pair[1]).collect()
    }

    fn header(frame_id: &str) -> Header {
        Header { stamp: Time { sec: 12, nanosec: 345_678_901 }, frame_id: frame_id.into() }
    }

    fn transform(parent: &str, child: &str, position: [f64; 3], orientation: [f64; 4]) -> TransformStamped {
        let transform = Pose { position, orientation };
        TransformStamped { header: header(parent), child_frame_id: child.into(), transform }
    }

    fn check<M: Message + PartialEq + Debug>(hex: &str, message: M) {
        let bytes = bytes(hex);
        assert_eq!(from_cdr::<M>(&bytes, "a message").unwrap(), message);
        assert_eq!(to_cdr(&message), bytes);
        for end in 0..bytes.len() {
            let cut = from_cdr::<M>(&bytes[..end], "a message").unwrap_err().to_string();
            assert!(cut.starts_with("a message: expected ") && !cut.contains('\n'), "{cut}");
        }
    }

    #[test]
    fn the_bytes_are_those_of_another_program_and_each_cut_is_named() {
        let (encoding, data) = ("bgr8".to_owned(), vec![1, 2, 3, 4, 5, 6, 0, 0]);
        let image = Image { header: header("gel"), height: 1, width: 2, encoding, is_bigendian: 0, step: 8, data };
        check(IMAGE, image);
        check(COMPRESSED, CompressedImage { header: header("g"), format: "jpeg".into(), data: vec![255, 216, 1] });
        let pose = Pose { position: [0.004, -0.008, 0.5], orientation: [0.0, 0.0, 0.6, 0.8] };
        check(POSE, PoseStamped { header: header("hole/A"), pose });
        let first = transform("base", "tool0", [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
        let second = transform("tool0", "sensor", [-1.0, 0.25, 0.0], [1.0, 0.0, 0.0, 0.0]);
        check(TF, TFMessage { transforms: vec![first, second] });
    }

    #[test]
    fn a_forged_length_is_refused_before_anything_is_allocated() {
        let mut image = bytes(IMAGE);
        let at = image.len() - 12;
        image[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        let message = from_cdr::<Image>(&image, "an image").unwrap_err().to_string();
        assert_eq!(message, "an image: expected 4294967295 bytes of data, got the last 8");
        let mut tf = bytes(TF);
        tf[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        let message = from_cdr::<TFMessage>(&tf, "tf").unwrap_err().to_string();
        assert!(message.contains("4294967295 transforms"), "{message}");
    }

    #[test]
    fn other_layouts_are_refused_by_name() {
        for (header, got) in [([0, 0, 0, 0], "big endian"), ([0, 7, 0, 0], "00 07 00 00")] {
            let message = from_cdr::<TFMessage>(&[&header[..], &[0; 8]].concat(), "tf").unwrap_err().to_string();
            assert!(message.contains(got), "{message}");
        }
    }
}

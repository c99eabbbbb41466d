//! The ROS 2 messages that a tactile sensor and its robot send, and their bytes; the messages of ROS 1 have the same
//! fields, but for the number in a header, which is passed over.
//!
//! Lengths are metres, rotations unit quaternions, as everywhere in ROS.

mod maps;
mod pictures;
mod poses;
mod reports;

pub use maps::{OccupancyGrid, PointCloud2, PointField};
pub use pictures::{CompressedImage, Image};
pub use poses::{Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped, TFMessage, TransformStamped};
pub use reports::{DiagnosticArray, DiagnosticStatus, KeyValue, Level, Text, TriggerRequest, TriggerResponse};

use crate::error::Result;
use crate::recording::ros::cdr::{Field, Layout, Reader, Writer, fields};

/// A message with a name and a layout.
pub trait Message: Field {
    /// Its type, such as `sensor_msgs/msg/Image`.
    const TYPE: &str;
    /// The definition of the message and of each type in it, as MCAP carries them (`ros2msg`).
    const DEFINITION: &str;
}

/// Reads a message in CDR; `place` names it in errors. Bytes behind it are padding.
///
/// # Errors
/// As [`Reader::new`] and [`Field::read`].
pub fn from_cdr<M: Message>(bytes: &[u8], place: &str) -> Result<M> {
    M::read(&mut Reader::new(bytes, place)?, place)
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

    /// The moment so many nanoseconds after the clock's zero; the nearest that a message can hold.
    pub fn of_nanoseconds(time_ns: i64) -> Self {
        let sec = time_ns.div_euclid(1_000_000_000).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        Self { sec: sec as i32, nanosec: time_ns.rem_euclid(1_000_000_000) as u32 }
    }
}

fields! { Time { sec, nanosec } }

/// When and in which frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// When the data was taken; zero where the sender did not fill it in.
    pub stamp: Time,
    /// The frame in which the data is given.
    pub frame_id: String,
}

impl Field for Header {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        if cdr.layout() == Layout::Ros1 {
            u32::read(cdr, "header.seq")?;
        }
        Ok(Self { stamp: Field::read(cdr, name)?, frame_id: Field::read(cdr, "header.frame_id")? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.stamp.write(cdr);
        self.frame_id.write(cdr);
    }
}

#[cfg(test)]
pub(super) mod tests {
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

    const ARRAY: &str = "000100000c00000035a49a1405000000686f6c650000000002000000000000000000f03f000000000000\
                         00400000000000000840000000000000000000000000000000000000000000000000000000000000f03f\
                         000000000000f0bf000000000000d03f0000000000000000000000000000000000000000000000003333\
                         33333333e33f9a9999999999e93f";
    const COV: &str = "000100000c00000035a49a1405000000626173650000000000000000000000000000f03f000000000000\
                         00400000000000000840000000000000000000000000000000000000000000000000000000000000f03f\
                         0000000000000000000000000000d03f000000000000e03f000000000000e83f000000000000f03f0000\
                         00000000f43f000000000000f83f000000000000fc3f0000000000000040000000000000024000000000\
                         00000440000000000000064000000000000008400000000000000a400000000000000c40000000000000\
                         0e4000000000000010400000000000001140000000000000124000000000000013400000000000001440\
                         000000000000154000000000000016400000000000001740000000000000184000000000000019400000\
                         000000001a400000000000001b400000000000001c400000000000001d400000000000001e4000000000\
                         00001f400000000000002040000000000080204000000000000021400000000000802140";
    const GRID: &str = "000100000c00000035a49a1405000000686f6c650000000001000000020000000000803e030000000100\
                         0000000000000000f03f0000000000000040000000000000084000000000000000000000000000000000\
                         0000000000000000000000000000f03f03000000ff0064";
    const CLOUD: &str = "000100000c00000035a49a14020000006800000001000000020000000200000002000000780000000000\
                         000007000000010000000700000077656967687400000400000007000000010000000000000008000000\
                         10000000100000000000803f0000003f000000c00000803e01";
    const TEXT: &str = "00010000070000004f206f72205100";
    const DIAG: &str = "000100000c00000035a49a1401000000000000000100000002000000070000006672616d657300000700\
                         000066726f7a656e0000010000000000000001000000060000006167655f7300000004000000312e3500";

    /// The bytes that hexadecimal digits say; what is between them is passed over.
    pub fn bytes(hex: &str) -> Vec<u8> {
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

    const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

    #[test]
    fn what_the_node_publishes_has_the_bytes_of_another_program() {
        let here = Pose { position: [1.0, 2.0, 3.0], orientation: UPRIGHT };
        let poses = vec![here, Pose { position: [-1.0, 0.25, 0.0], orientation: [0.0, 0.0, 0.6, 0.8] }];
        check(ARRAY, PoseArray { header: header("hole"), poses });
        let covariance = std::array::from_fn(|i| i as f64 / 4.0);
        check(COV, PoseWithCovarianceStamped { header: header("base"), pose: here, covariance });
        let map_load_time = Time { sec: 1, nanosec: 2 };
        let (resolution, width, height, data) = (0.25, 3, 1, vec![-1, 0, 100]);
        let header_of = header;
        let header = header_of("hole");
        check(GRID, OccupancyGrid { header, map_load_time, resolution, width, height, origin: here, data });
        check(CLOUD, PointCloud2::of_floats(header_of("h"), ["x", "weight"], &[[1.0, 0.5], [-2.0, 0.25]]));
        check(TEXT, Text { data: "O or Q".into() });
        let status = DiagnosticStatus {
            level: Level::Error,
            name: "frames".into(),
            message: "frozen".into(),
            hardware_id: String::new(),
            values: vec![KeyValue::new("age_s", 1.5)],
        };
        check(DIAG, DiagnosticArray { header: header_of(""), status: vec![status] });
    }

    #[test]
    fn a_service_has_the_bytes_that_the_standard_computes() {
        // A bool, three bytes up to the string's length, eight bytes of text with the closing zero.
        let answer = TriggerResponse { success: true, message: "touch 3".into() };
        check("00010000 01000000 08000000 746f756368203300", answer);
        check("00010000 00", TriggerRequest);
        assert_eq!(Time::of_nanoseconds(-1), Time { sec: -1, nanosec: 999_999_999 });
        assert_eq!(Time::of_nanoseconds(12_345_678_901).nanoseconds(), 12_345_678_901);
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

//! Pictures of a camera.

use crate::error::Result;
use crate::frame::Frame;
use crate::recording::ros::cdr::{Field, Reader, Writer, fields};
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{Header, Message};

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

impl Image {
    /// A frame as it is, in rgb8.
    pub fn of_frame(header: Header, frame: &Frame) -> Self {
        Self {
            header,
            height: frame.height_px() as u32,
            width: frame.width_px() as u32,
            encoding: "rgb8".to_owned(),
            is_bigendian: 0,
            step: 3 * frame.width_px() as u32,
            data: frame.rgb().to_vec(),
        }
    }
}

fields! { Image { header, height, width, encoding, is_bigendian, step, data } in "sensor_msgs/msg/Image", IMAGE }

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

fields! { CompressedImage { header, format, data } in "sensor_msgs/msg/CompressedImage", COMPRESSED_IMAGE }

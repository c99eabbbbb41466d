//! Pictures of a camera.

use crate::error::Result;
use crate::frame::Frame;
use crate::recording::ros::cdr::{Reader, Writer};
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

impl Message for Image {
    const TYPE: &str = "sensor_msgs/msg/Image";
    const DEFINITION: &str = definitions::IMAGE;

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
    const DEFINITION: &str = definitions::COMPRESSED_IMAGE;

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

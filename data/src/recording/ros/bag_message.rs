//! A message of a bag, as it was recorded.

use std::io::{Cursor, Read};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::recording::ros::cdr::{Field, Layout, Reader};
use crate::recording::ros::record_file::MAX_RECORD_BYTES;
use crate::recording::ros::unpack::{ZSTD_MAGIC, Zstd};

/// A topic with the type of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its name: `/gelsight/image`.
    pub topic: String,
    /// Its type by the name that ROS 2 gives it: `sensor_msgs/msg/Image`.
    pub type_name: String,
}

/// One message as it was recorded.
#[derive(Clone, Debug)]
pub struct Message {
    /// Where it was sent.
    pub channel: Arc<Channel>,
    /// When it was recorded, nanoseconds.
    pub log_time_ns: i64,
    /// The number that its writer gave it; 0 in a ROS 1 bag, which has none.
    pub sequence: u32,
    pub(super) file: Arc<str>,
    pub(super) layout: Layout,
    pub(super) data: Vec<u8>,
}

impl Message {
    /// Where it is, for errors: file, topic and the time at which it was recorded.
    pub fn place(&self) -> String {
        format!("{}, {}, {:.3} s", self.file, self.channel.topic, self.log_time_ns as f64 * 1e-9)
    }

    /// Its bytes as they were written.
    pub fn bytes(&self) -> &[u8] {
        &self.data
    }

    /// What it begins with; bytes behind that are padding.
    ///
    /// # Errors
    /// Bytes that cannot be unpacked, and the errors of [`Field::read`].
    pub fn read<T: Field>(self) -> Result<T> {
        let (place, layout) = (self.place(), self.layout);
        let bytes = self.unpacked()?;
        let mut cdr = match layout {
            Layout::Cdr => Reader::new(&bytes, &place)?,
            Layout::Ros1 => Reader::ros1(&bytes, &place),
        };
        T::read(&mut cdr, "a header")
    }

    /// Its bytes, unpacked where rosbag2 packed each message by itself.
    pub(super) fn unpacked(self) -> Result<Vec<u8>> {
        if self.layout == Layout::Ros1 || !self.data.starts_with(&ZSTD_MAGIC) {
            return Ok(self.data);
        }
        let place = self.place();
        let mut bytes = Vec::new();
        let unpacked = Zstd::new(Cursor::new(self.data)).take(MAX_RECORD_BYTES).read_to_end(&mut bytes);
        unpacked.map_err(|e| Error::invalid(place, "a message packed with zstd", e.to_string()))?;
        Ok(bytes)
    }
}

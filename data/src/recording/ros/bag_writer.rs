//! ROS 2 messages to a bag in MCAP.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::error::{Error, Result};
use crate::recording::ros::messages::Message;

/// A bag that is being written: one file, not packed.
pub struct BagWriter {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Messages so far of each channel.
    sequence: BTreeMap<ChannelId, u32>,
}

/// A topic of a bag with the type of its messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(u16);

impl BagWriter {
    /// Begins a bag in a new file; `path` names it in errors, `library` is the program that writes it.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn new(path: &Path, file: File, library: &str) -> Result<Self> {
        // Without seeking a chunk goes to the file in one piece, with its length: with it, the length stands there only
        // once the chunk is full, and a program that is killed leaves one that no reader can pass.
        let options = WriteOptions::new().compression(None).disable_seeking(true).profile("ros2").library(library);
        let writer = options.create(BufWriter::new(file)).map_err(failed(path))?;
        Ok(Self { path: path.to_path_buf(), writer, sequence: BTreeMap::new() })
    }

    /// Adds a topic with messages of type `M`.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn channel<M: Message>(&mut self, topic: &str) -> Result<ChannelId> {
        self.channel_of(topic, M::TYPE, M::DEFINITION)
    }

    /// Adds a topic with messages of a type and its definition.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn channel_of(&mut self, topic: &str, type_name: &str, definition: &str) -> Result<ChannelId> {
        let schema = self.writer.add_schema(type_name, "ros2msg", definition.as_bytes());
        let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let id = schema.and_then(|schema| self.writer.add_channel(schema, topic, "cdr", &qos));
        id.map(ChannelId).map_err(failed(&self.path))
    }

    /// Writes a message, numbered by its channel.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn write(&mut self, channel: ChannelId, time_ns: i64, cdr: &[u8]) -> Result<()> {
        let sequence = self.sequence.entry(channel).or_default();
        let number = *sequence;
        *sequence = sequence.wrapping_add(1);
        self.write_numbered(channel, time_ns, number, cdr)
    }

    /// Writes a message with a number of the caller's.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn write_numbered(&mut self, channel: ChannelId, time_ns: i64, number: u32, cdr: &[u8]) -> Result<()> {
        let time = time_ns.unsigned_abs();
        let header = MessageHeader { channel_id: channel.0, sequence: number, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, cdr).map_err(failed(&self.path))
    }

    /// Brings all that was written into the file: a program that is killed loses none of it.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.writer.flush().map_err(failed(&self.path))
    }

    /// Ends the bag with its index, on the disk.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(failed(&self.path))?;
        let mut file = self.writer.into_inner();
        file.flush().and_then(|()| file.get_ref().sync_all()).map_err(Error::io(&self.path))
    }
}

fn failed(path: &Path) -> impl FnOnce(mcap::McapError) -> Error {
    move |error| match error {
        mcap::McapError::Io(error) => Error::io(path)(error),
        other => Error::invalid(path.display().to_string(), "a bag that can be written", other.to_string()),
    }
}

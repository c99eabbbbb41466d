//! The messages of one ROS 1 bag, format 2.0 (<http://wiki.ros.org/Bags/Format/2.0>).

mod records;
#[cfg(test)]
mod test_bag;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::recording::ros::bag_message::{Channel, Message};
use crate::recording::ros::cdr::Layout;
use crate::recording::ros::ros1::records::{Ending, Fields, Record, Records, op};

/// A file and what its records have said so far.
pub struct Ros1File {
    name: Arc<str>,
    records: Records,
    connections: HashMap<u32, Arc<Channel>>,
    n_messages: usize,
}

impl Ros1File {
    /// Opens a file and checks that it begins as a ROS 1 bag does.
    ///
    /// # Errors
    /// A file that cannot be read, or another format.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display().to_string().into();
        Ok(Self { name, records: Records::open(path)?, connections: HashMap::new(), n_messages: 0 })
    }

    /// The next message in the order in which they were recorded; `None` at the end of the data, and at a cut.
    ///
    /// # Errors
    /// Damage, with its place.
    pub fn next(&mut self) -> Result<Option<Message>> {
        while let Some(record) = self.records.next()? {
            if record.op == op::MESSAGE {
                let message = self.message(record)?;
                self.n_messages += 1;
                return Ok(Some(message));
            }
            self.connect(&record)?;
        }
        Ok(None)
    }

    /// What is said of the file where it was cut off or not closed, once its messages have been read.
    pub fn cut(&self) -> Option<String> {
        let (name, n) = (&self.name, self.n_messages);
        Some(match self.records.ending()? {
            Ending::Cut(at) => format!("{name} is cut off at byte {at}: the {n} messages before are kept"),
            Ending::NotClosed => format!("{name} was not closed and has no index: its {n} messages are kept"),
        })
    }

    /// Remembers a connection: a topic and the type of its messages.
    fn connect(&mut self, record: &Record) -> Result<()> {
        let fields = Fields::of(&record.header, &record.place)?;
        let about = Fields::of(&record.data, &record.place)?;
        let channel = Channel { topic: fields.text("topic")?, type_name: ros2_name(&about.text("type")?) };
        self.connections.insert(fields.u32("conn")?, Arc::new(channel));
        Ok(())
    }

    fn message(&self, record: Record) -> Result<Message> {
        let fields = Fields::of(&record.header, &record.place)?;
        let number = fields.u32("conn")?;
        let Some(channel) = self.connections.get(&number) else {
            let got = format!("connection {number}");
            return Err(Error::invalid(&*record.place, "a message of a connection that came before it", got));
        };
        Ok(Message {
            channel: Arc::clone(channel),
            log_time_ns: fields.time_ns("time")?,
            sequence: 0,
            file: Arc::clone(&self.name),
            layout: Layout::Ros1,
            data: record.data,
        })
    }
}

/// The name that ROS 2 gives a type of ROS 1: `sensor_msgs/msg/Image` for `sensor_msgs/Image`.
fn ros2_name(ros1: &str) -> String {
    match ros1.split_once('/') {
        // Of the first tf, with the fields of the second's.
        Some(("tf", "tfMessage")) => "tf2_msgs/msg/TFMessage".to_owned(),
        Some((package, name)) => format!("{package}/msg/{name}"),
        None => ros1.to_owned(),
    }
}

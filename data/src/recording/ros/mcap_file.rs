//! The messages of one MCAP file.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use mcap::records::{Record as Parsed, op};

use crate::error::{Error, Result};
use crate::recording::ros::bag_message::{Channel, Message};
use crate::recording::ros::cdr::Layout;
use crate::recording::ros::records::{Record, Records};

/// A file and what its records have said so far.
pub struct McapFile {
    name: Arc<str>,
    records: Records,
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Arc<Channel>>,
    n_messages: usize,
}

impl McapFile {
    /// Opens a file and checks that it begins as MCAP does.
    ///
    /// # Errors
    /// A file that cannot be read, or another format.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self {
            name: path.display().to_string().into(),
            records: Records::open(path)?,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            n_messages: 0,
        })
    }

    /// The next message; `None` at the end of the data, and at a cut.
    ///
    /// # Errors
    /// Damage, with its place.
    pub fn next(&mut self) -> Result<Option<Message>> {
        while let Some(record) = self.records.next()? {
            if record.opcode == op::MESSAGE {
                self.n_messages += 1;
                return self.message(record.body).map(Some);
            }
            self.note(&record)?;
        }
        Ok(None)
    }

    /// What is said of the file where it was cut off, once its messages have been read.
    pub fn cut(&self) -> Option<String> {
        let (name, n_messages) = (&self.name, self.n_messages);
        let cut_at = self.records.cut_at()?;
        Some(format!("{name} is cut off at byte {cut_at}: the {n_messages} messages before are kept"))
    }

    /// Remembers a schema or a channel.
    fn note(&mut self, record: &Record) -> Result<()> {
        let bad = |got: String| Error::invalid(&*self.name, "a schema or channel record", got);
        match mcap::parse_record(record.opcode, &record.body).map_err(|e| bad(e.to_string()))? {
            Parsed::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Parsed::Channel(channel) => {
                let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                self.channels.insert(channel.id, Arc::new(Channel { topic: channel.topic, type_name }));
            }
            _ => {}
        }
        Ok(())
    }

    fn message(&self, mut body: Vec<u8>) -> Result<Message> {
        let parsed = match mcap::parse_record(op::MESSAGE, &body) {
            Ok(Parsed::Message { header, data }) => Some((header, body.len() - data.len())),
            _ => None,
        };
        let Some((header, header_len)) = parsed else {
            return Err(Error::invalid(&*self.name, "a message record", format!("{} bytes", body.len())));
        };
        let Some(channel) = self.channels.get(&header.channel_id) else {
            let got = format!("channel {}", header.channel_id);
            return Err(Error::invalid(&*self.name, "a message of a channel that came before it", got));
        };
        body.drain(..header_len);
        Ok(Message {
            channel: Arc::clone(channel),
            log_time_ns: i64::try_from(header.log_time).unwrap_or(i64::MAX),
            sequence: header.sequence,
            file: Arc::clone(&self.name),
            layout: Layout::Cdr,
            data: body,
        })
    }
}

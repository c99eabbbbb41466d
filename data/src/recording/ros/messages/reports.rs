//! Words: texts, diagnostics, and what a service is asked and answers.

use crate::error::Result;
use crate::recording::ros::cdr::{Reader, Writer};
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{Header, Message};

/// `std_msgs/msg/String`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    /// The text.
    pub data: String,
}

impl Message for Text {
    const TYPE: &str = "std_msgs/msg/String";
    const DEFINITION: &str = definitions::TEXT;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self { data: cdr.string("data")? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.string(&self.data);
    }
}

/// How bad something is: `diagnostic_msgs/msg/DiagnosticStatus`' levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// All is well.
    #[default]
    Ok = 0,
    /// A touch may take longer, or a person should look.
    Warn = 1,
    /// No touch can be made like this.
    Error = 2,
    /// Nothing came for some time.
    Stale = 3,
}

impl Level {
    /// The level of this number; what no level has is an error.
    fn of(level: u8) -> Self {
        match level {
            0 => Self::Ok,
            1 => Self::Warn,
            3 => Self::Stale,
            _ => Self::Error,
        }
    }
}

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KeyValue {
    /// What it is.
    pub key: String,
    /// Its value, with its unit in the key.
    pub value: String,
}

impl KeyValue {
    /// A name and anything that can be shown.
    pub fn new(key: &str, value: impl ToString) -> Self {
        Self { key: key.to_owned(), value: value.to_string() }
    }

    /// What one takes at least: two empty strings.
    const LEAST_BYTES: usize = 4 + 4;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self { key: cdr.string("key")?, value: cdr.string("value")? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.string(&self.key);
        cdr.string(&self.value);
    }
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DiagnosticStatus {
    /// How bad it is.
    pub level: Level,
    /// Which part of which node.
    pub name: String,
    /// A line for a person.
    pub message: String,
    /// Which device.
    pub hardware_id: String,
    /// Numbers and words that belong to it.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// What one takes at least: a level with its padding, three empty strings, no values.
    const LEAST_BYTES: usize = 4 + 4 + 4 + 4 + 4;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let (level, name) = (Level::of(cdr.u8("level")?), cdr.string("name")?);
        let (message, hardware_id) = (cdr.string("message")?, cdr.string("hardware_id")?);
        let count = cdr.count(KeyValue::LEAST_BYTES, "values")?;
        let values = (0..count).map(|_| KeyValue::read(cdr)).collect::<Result<_>>()?;
        Ok(Self { level, name, message, hardware_id, values })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.u8(self.level as u8);
        cdr.string(&self.name);
        cdr.string(&self.message);
        cdr.string(&self.hardware_id);
        cdr.u32(self.values.len() as u32);
        self.values.iter().for_each(|value| value.write(cdr));
    }
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DiagnosticArray {
    /// When.
    pub header: Header,
    /// Any number of statuses.
    pub status: Vec<DiagnosticStatus>,
}

impl Message for DiagnosticArray {
    const TYPE: &str = "diagnostic_msgs/msg/DiagnosticArray";
    const DEFINITION: &str = definitions::DIAGNOSTIC_ARRAY;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let header = Header::read(cdr)?;
        let count = cdr.count(DiagnosticStatus::LEAST_BYTES, "statuses")?;
        Ok(Self { header, status: (0..count).map(|_| DiagnosticStatus::read(cdr)).collect::<Result<_>>()? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.u32(self.status.len() as u32);
        self.status.iter().for_each(|status| status.write(cdr));
    }
}

/// What `std_srvs/srv/Trigger` is asked: nothing, for which ROS 2 sends one byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TriggerRequest;

impl Message for TriggerRequest {
    const TYPE: &str = "std_srvs/srv/Trigger_Request";
    const DEFINITION: &str = definitions::TRIGGER_REQUEST;

    fn read(cdr: &mut Reader) -> Result<Self> {
        cdr.u8("structure_needs_at_least_one_member").map(|_| Self)
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.u8(0);
    }
}

/// What `std_srvs/srv/Trigger` answers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TriggerResponse {
    /// Whether it was done.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
}

impl Message for TriggerResponse {
    const TYPE: &str = "std_srvs/srv/Trigger_Response";
    const DEFINITION: &str = definitions::TRIGGER_RESPONSE;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self { success: cdr.u8("success")? != 0, message: cdr.string("message")? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.u8(u8::from(self.success));
        cdr.string(&self.message);
    }
}

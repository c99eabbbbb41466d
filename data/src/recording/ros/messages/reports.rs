//! Words: texts, diagnostics, and what a service is asked and answers.

use crate::error::Result;
use crate::recording::ros::cdr::{Field, Reader, Writer, fields};
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{Header, Message};

/// `std_msgs/msg/String`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    /// The text.
    pub data: String,
}

fields! { Text { data } in "std_msgs/msg/String", TEXT }

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

impl Field for Level {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        Ok(match u8::read(cdr, name)? {
            0 => Self::Ok,
            1 => Self::Warn,
            3 => Self::Stale,
            // What no level has is an error.
            _ => Self::Error,
        })
    }

    fn write(&self, cdr: &mut Writer) {
        (*self as u8).write(cdr);
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
}

fields! { KeyValue { key, value } }

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

fields! { DiagnosticStatus { level, name, message, hardware_id, values } }

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DiagnosticArray {
    /// When.
    pub header: Header,
    /// Any number of statuses.
    pub status: Vec<DiagnosticStatus>,
}

fields! { DiagnosticArray { header, status } in "diagnostic_msgs/msg/DiagnosticArray", DIAGNOSTIC_ARRAY }

/// What `std_srvs/srv/Trigger` is asked: nothing, for which ROS 2 sends one byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TriggerRequest;

impl Field for TriggerRequest {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        u8::read(cdr, name).map(|_| Self)
    }

    fn write(&self, cdr: &mut Writer) {
        0_u8.write(cdr);
    }
}

impl Message for TriggerRequest {
    const TYPE: &str = "std_srvs/srv/Trigger_Request";
    const DEFINITION: &str = definitions::TRIGGER_REQUEST;
}

/// What `std_srvs/srv/Trigger` answers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TriggerResponse {
    /// Whether it was done.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
}

fields! { TriggerResponse { success, message } in "std_srvs/srv/Trigger_Response", TRIGGER_RESPONSE }

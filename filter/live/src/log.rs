//! The log: everything that the node is given and says, in an MCAP bag that any viewer opens and
//! [`replay`](crate::replay) checks.
//!
//! Every event has the next number, from 0 on, which is the `sequence` of its message and of what the node says to it.
//! The time of a message is the node's own, to the nanosecond.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use serde::{Deserialize, Serialize};
use tactile_data::recording::ros::bag;
use tactile_data::recording::ros::bag_writer::{BagWriter, ChannelId};
use tactile_data::recording::ros::messages::{Message, Text, to_cdr};

use crate::error::{Error, Result};
use crate::event::{Event, Given, Input, Output, Request, Topic};
use crate::parameters::Parameters;

/// Between two flushes, nanoseconds: what a program that is killed loses at most.
const FLUSH_NS: i64 = 500_000_000;

/// The value of [`Setup::version`] that this program writes and reads.
pub const VERSION: u32 = 4;

/// What the events of a log were given to: the first message of a log, on `~/setup`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// [`VERSION`].
    pub version: u32,
    /// The node's full name: `/tactile_filter`.
    pub node: String,
    /// The program that wrote it.
    pub program: String,
    /// SHA-256 of the model's file.
    pub model_sha256: String,
    /// SHA-256 of the networks that drew maps, where any did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maps_sha256: Option<String>,
    /// SHA-256 of the bank.
    pub bank_sha256: String,
    /// The topic of the pictures.
    pub image_topic: String,
    /// The topic of the tool's poses.
    pub tool_topic: String,
    /// The topic of parts that are seen before they are touched.
    pub part_topic: String,
    /// All parameters.
    pub parameters: Parameters,
}

/// Where in a log an input is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Line {
    Setup,
    Given(Given),
    Called,
    Cameras,
    Tick,
    Answer,
    Output(Topic),
}

impl Line {
    /// Its topic.
    pub(crate) fn topic(self, setup: &Setup) -> String {
        let own = |name: &str| match name.strip_prefix("~/") {
            Some(below) => format!("{}/{below}", setup.node),
            None => name.to_owned(),
        };
        match self {
            Self::Setup => own("~/setup"),
            Self::Given(Given::Image) => setup.image_topic.clone(),
            Self::Given(Given::CompressedImage) => format!("{}/compressed", setup.image_topic),
            Self::Given(Given::ToolPose) => setup.tool_topic.clone(),
            Self::Given(Given::PartPose) => setup.part_topic.clone(),
            Self::Called => own("~/called"),
            Self::Cameras => own("~/cameras"),
            Self::Tick => own("~/tick"),
            Self::Answer => own("~/answers"),
            Self::Output(topic) => own(topic.name()),
        }
    }

    /// The type of its messages and their definition.
    pub(crate) fn message(self) -> [&'static str; 2] {
        match self {
            Self::Given(given) => given.message(),
            Self::Output(topic) => topic.message(),
            _ => [Text::TYPE, Text::DEFINITION],
        }
    }

    /// The line that a message of a log is on; `None`: not one of the node's. The setup is the first message alone.
    pub(crate) fn of_message(message: &bag::Message, setup: &Setup) -> Option<Self> {
        let given = Given::ALL.map(Self::Given);
        let others = [Self::Called, Self::Cameras, Self::Tick, Self::Answer];
        let outputs = Topic::ALL.map(Self::Output);
        let is_it =
            |line: &Self| line.topic(setup) == message.channel.topic && line.message()[0] == message.channel.type_name;
        given.into_iter().chain(others).chain(outputs).find(is_it)
    }

    /// The line of an input and its bytes.
    pub(crate) fn of_input(input: &Input) -> (Self, std::borrow::Cow<'_, [u8]>) {
        let text = |data: String| to_cdr(&Text { data }).into();
        match input {
            Input::Given(given, cdr) => (Self::Given(*given), cdr.into()),
            Input::Called { request, id } => (Self::Called, text(format!("{} {id}", request.name()))),
            Input::Cameras(n) => (Self::Cameras, text(n.to_string())),
            Input::Tick => (Self::Tick, text(String::new())),
        }
    }

    /// The line of an output and its bytes.
    pub(crate) fn of_output(output: &Output) -> (Self, std::borrow::Cow<'_, [u8]>) {
        match output {
            Output::Publish { topic, cdr } => (Self::Output(*topic), cdr.into()),
            Output::Answer { id, success, message } => {
                let word = if *success { "done" } else { "refused" };
                (Self::Answer, to_cdr(&Text { data: format!("{id} {word} {message}") }).into())
            }
        }
    }

    /// The input that a message holds; `None` where it holds none.
    pub(crate) fn input(self, cdr: Vec<u8>) -> Option<Input> {
        let text = |cdr: &[u8]| tactile_data::recording::ros::messages::from_cdr::<Text>(cdr, "log").ok();
        match self {
            Self::Given(given) => Some(Input::Given(given, cdr)),
            Self::Tick => Some(Input::Tick),
            Self::Cameras => text(&cdr)?.data.parse().ok().map(Input::Cameras),
            Self::Called => {
                let text = text(&cdr)?.data;
                let (name, id) = text.split_once(' ')?;
                let request = Request::ALL.into_iter().find(|request| request.name() == name)?;
                Some(Input::Called { request, id: id.parse().ok()? })
            }
            Self::Setup | Self::Answer | Self::Output(_) => None,
        }
    }
}

/// A log that is being written.
pub struct LogWriter {
    bag: BagWriter,
    setup: Setup,
    channels: BTreeMap<Line, ChannelId>,
    flushed_ns: Option<i64>,
}

impl LogWriter {
    /// Begins a log in a new file.
    ///
    /// # Errors
    /// A file that exists, a disk that cannot be written.
    pub fn create(path: &Path, setup: &Setup) -> Result<Self> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        }
        let file = File::create_new(path).map_err(Error::io(path))?;
        let mut bag = BagWriter::new(path, file, &setup.program)?;
        // A full disk is an error here, before anything is touched.
        bag.flush()?;
        Ok(Self { bag, setup: setup.clone(), channels: BTreeMap::new(), flushed_ns: None })
    }

    /// Writes the setup where nothing was written yet. Its time is the first event's: that clock may be a simulated one.
    fn begin(&mut self, time_ns: i64) -> Result<()> {
        if self.channels.is_empty() {
            let json = serde_json::to_string(&self.setup)
                .map_err(|error| Error::invalid("setup", "what JSON can hold", error.to_string()))?;
            self.write(Line::Setup, time_ns, 0, &to_cdr(&Text { data: json }))?;
        }
        Ok(())
    }

    /// Writes an event of a number.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn event(&mut self, number: u32, event: &Event) -> Result<()> {
        self.begin(event.time_ns)?;
        let (line, cdr) = Line::of_input(&event.input);
        self.write(line, event.time_ns, number, &cdr)
    }

    /// Writes what the node said to the event of a number.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn outputs(&mut self, number: u32, time_ns: i64, outputs: &[Output]) -> Result<()> {
        for output in outputs {
            let (line, cdr) = Line::of_output(output);
            self.write(line, time_ns, number, &cdr)?;
        }
        if self.flushed_ns.is_none_or(|flushed_ns| time_ns - flushed_ns >= FLUSH_NS) {
            self.flushed_ns = Some(time_ns);
            self.bag.flush()?;
        }
        Ok(())
    }

    fn write(&mut self, line: Line, time_ns: i64, number: u32, cdr: &[u8]) -> Result<()> {
        let channel = match self.channels.get(&line) {
            Some(channel) => *channel,
            None => {
                let [type_name, definition] = line.message();
                let channel = self.bag.channel_of(&line.topic(&self.setup), type_name, definition)?;
                self.channels.insert(line, channel);
                channel
            }
        };
        Ok(self.bag.write_numbered(channel, time_ns, number, cdr)?)
    }

    /// Ends the log with its index.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn finish(mut self) -> Result<()> {
        self.begin(0)?;
        Ok(self.bag.finish()?)
    }
}

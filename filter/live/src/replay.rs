//! A log given to a node again: the same events must give the same bytes.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;
use tactile_data::recording::ros::bag::{Bag, Message};
use tactile_data::recording::ros::messages::{Text, from_cdr};
use tactile_infer::{Bank, Model};

use crate::decision::DecisionReport;
use crate::error::{Error, Result};
use crate::event::{Event, Output, Topic};
use crate::log::{Line, Setup, VERSION};
use crate::node::Node;

/// What a replay found.
#[derive(Clone, Debug, Default)]
pub struct Replayed {
    /// Events that were given to the node.
    pub n_events: u32,
    /// The decisions, in order.
    pub decisions: Vec<DecisionReport>,
    /// Where the log is cut off, where it is: its writer was killed.
    pub cut: Option<String>,
}

/// What a log begins with.
///
/// # Errors
/// A file that is no log of this version.
pub fn setup(log: &Path) -> Result<Setup> {
    let bag = Bag::open(log)?;
    let first = bag.messages().next().transpose()?;
    first.map_or_else(|| Err(no_setup(log, "an empty bag")), |message| read_setup(log, &message))
}

fn no_setup(log: &Path, got: &str) -> Error {
    Error::invalid(log.display().to_string(), "a log of a live node, with its setup as its first message", got)
}

fn read_setup(log: &Path, message: &Message) -> Result<Setup> {
    let topic = &message.channel.topic;
    let text: Option<Text> = from_cdr(message.bytes(), "setup").ok().filter(|_| topic.ends_with("/setup"));
    let Some(text) = text else { return Err(no_setup(log, &format!("a message on {topic}"))) };
    let setup: Value = serde_json::from_str(&text.data).map_err(|error| no_setup(log, &error.to_string()))?;
    // The version first: what else a setup of another one holds is not known.
    if setup["version"] != VERSION {
        let expected = format!("a log of version {VERSION}");
        let got =
            format!("version {}; replay it with the program that wrote it, {}", setup["version"], setup["program"]);
        return Err(Error::invalid(log.display().to_string(), expected, got));
    }
    serde_json::from_value(setup).map_err(|error| no_setup(log, &error.to_string()))
}

/// Gives the events of a log to a new node with the log's own parameters, and compares all that it says, byte for byte.
///
/// # Errors
/// A model or bank of another checksum, a missing event, an answer that differs: by the number of its event. A log that
/// is cut off at its end is no error.
pub fn replay(log: &Path, model: Arc<Model>, bank: Arc<Bank>) -> Result<Replayed> {
    let bag = Bag::open(log)?;
    let mut messages = bag.messages();
    let first = messages.next().transpose()?.ok_or_else(|| no_setup(log, "an empty bag"))?;
    let setup = read_setup(log, &first)?;
    let bank_sha256 = bank.sha256().map_err(tactile_filter::Error::from)?;
    let [expected, got] = [setup.maps_sha256.as_deref(), model.maps().map(|maps| &**maps.sha256())];
    let checks = [
        ("model", &*setup.model_sha256, &**model.sha256()),
        ("maps", expected.unwrap_or("none"), got.unwrap_or("none")),
        ("bank", &setup.bank_sha256, &bank_sha256),
    ];
    if let Some((what, expected, got)) = checks.into_iter().find(|(_, expected, got)| expected != got) {
        let place = format!("{what} of log {}", log.display());
        return Err(Error::invalid(place, format!("SHA-256 {expected:.12}"), format!("{got:.12}")));
    }
    let node = Node::new(setup.parameters.clone(), model, bank)?;
    let mut replay =
        Replay { log: log.display().to_string(), setup, node, said: VecDeque::new(), number: 0, time_ns: 0 };
    let mut replayed = Replayed::default();
    for message in &mut messages {
        let message = message?;
        match Line::of_message(&message, &replay.setup) {
            Some(line) if is_input(line) => {
                replay.expect_silence()?;
                replay.input(line, &message, &mut replayed)?;
            }
            Some(line) => replay.output(line, &message)?,
            None => return Err(replay.differs("a topic of the node", message.channel.topic.clone())),
        }
    }
    replayed.cut = messages.cuts().first().cloned();
    if replayed.cut.is_none() {
        replay.expect_silence()?;
    }
    Ok(replayed)
}

fn is_input(line: Line) -> bool {
    !matches!(line, Line::Setup | Line::Answer | Line::Output(_))
}

/// A replay on its way.
struct Replay {
    log: String,
    setup: Setup,
    node: Node,
    /// What the node said to the latest event, and the log did not yet.
    said: VecDeque<Output>,
    /// Number of the next event.
    number: u32,
    time_ns: i64,
}

impl Replay {
    fn input(&mut self, line: Line, message: &Message, replayed: &mut Replayed) -> Result<()> {
        if message.sequence != self.number {
            let got = format!("event {}: what came between is missing", message.sequence);
            return Err(self.differs(format!("event {}", self.number), got));
        }
        let Some(input) = line.input(message.bytes().to_vec()) else {
            return Err(self.differs("an event", format!("{:?}", message.channel.topic)));
        };
        self.time_ns = message.log_time_ns;
        self.said = self.node.step(&Event { time_ns: self.time_ns, input }).into();
        self.number = self.number.wrapping_add(1);
        replayed.n_events += 1;
        for output in &self.said {
            if let Output::Publish { topic: Topic::Decision, cdr } = output {
                let text: Text = from_cdr(cdr, "decision")?;
                let report = serde_json::from_str(&text.data)
                    .map_err(|error| Error::invalid("decision", "a report", error.to_string()))?;
                replayed.decisions.push(report);
            }
        }
        Ok(())
    }

    fn output(&mut self, line: Line, message: &Message) -> Result<()> {
        let Some(said) = self.said.pop_front() else {
            return Err(self.differs(format!("a message on {}", message.channel.topic), "nothing more".into()));
        };
        let (said_line, cdr) = Line::of_output(&said);
        let is_same = said_line == line
            && *cdr == *message.bytes()
            && message.sequence.wrapping_add(1) == self.number
            && message.log_time_ns == self.time_ns;
        if is_same {
            return Ok(());
        }
        let got = if said_line == line { "other bytes".to_owned() } else { said_line.topic(&self.setup) };
        Err(self.differs(format!("the message on {}", message.channel.topic), got))
    }

    /// Refuses to go on while the node said what the log does not hold.
    fn expect_silence(&self) -> Result<()> {
        match self.said.front() {
            Some(said) => {
                let topic = Line::of_output(said).0.topic(&self.setup);
                Err(self.differs("nothing more", format!("a message on {topic}")))
            }
            None => Ok(()),
        }
    }

    fn differs(&self, expected: impl Into<String>, got: String) -> Error {
        let event = self.number.saturating_sub(1);
        Error::Replay { log: self.log.clone(), event, expected: expected.into(), got }
    }
}

//! A node with its log: what every source of events feeds.

use std::path::Path;

use tactile_infer::{Bank, Model};

use crate::error::Result;
use crate::event::{Event, Output, Topic};
use crate::log::{LogWriter, Setup, VERSION};
use crate::node::Node;
use crate::parameters::Parameters;

/// Something that looks on: each event with what the node says to it. It must not wait.
pub type Onlooker = Box<dyn FnMut(&Event, &[Output]) + Send>;

/// A node with its log.
pub struct Session {
    node: Node,
    log: Option<LogWriter>,
    onlookers: Vec<Onlooker>,
    n_events: u32,
}

/// The names under which a node is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names {
    /// The node's full name.
    pub node: String,
    /// The topic of the pictures.
    pub image_topic: String,
    /// The topic of the tool's poses.
    pub tool_topic: String,
    /// The topic of parts that are seen before they are touched.
    pub part_topic: String,
}

impl Default for Names {
    fn default() -> Self {
        Self {
            node: "/tactile_filter".into(),
            image_topic: "/tactile_filter/image".into(),
            tool_topic: "/tactile_filter/tool_pose".into(),
            part_topic: "/tactile_filter/part_pose".into(),
        }
    }
}

impl Names {
    /// What a log begins with.
    ///
    /// # Errors
    /// A bank whose checksum cannot be built.
    pub fn setup(&self, parameters: &Parameters, model: &Model, bank: &Bank) -> Result<Setup> {
        Ok(Setup {
            version: VERSION,
            node: self.node.clone(),
            program: concat!("tactile-live ", env!("CARGO_PKG_VERSION")).to_owned(),
            model_sha256: model.sha256().to_string(),
            maps_sha256: model.maps().map(|maps| maps.sha256().to_string()),
            bank_sha256: bank.sha256().map_err(tactile_filter::Error::from)?,
            image_topic: self.image_topic.clone(),
            tool_topic: self.tool_topic.clone(),
            part_topic: self.part_topic.clone(),
            parameters: parameters.clone(),
        })
    }
}

impl Session {
    /// A node that keeps no log.
    pub fn new(node: Node) -> Self {
        Self { node, log: None, onlookers: Vec::new(), n_events: 0 }
    }

    /// The same with a log in a new file.
    ///
    /// # Errors
    /// A file that exists, a disk that cannot be written.
    pub fn with_log(self, path: &Path, setup: &Setup) -> Result<Self> {
        Ok(Self { log: Some(LogWriter::create(path, setup)?), ..self })
    }

    /// The same with one more that looks on.
    pub fn with_onlooker(mut self, onlooker: Onlooker) -> Self {
        self.onlookers.push(onlooker);
        self
    }

    /// Gives the node an event. A log that can no longer be written ends, and that is said; the node goes on.
    pub fn handle(&mut self, event: &Event) -> Vec<Output> {
        let number = self.n_events;
        self.n_events = self.n_events.wrapping_add(1);
        let logged = self.log.as_mut().map_or(Ok(()), |log| log.event(number, event));
        let mut outputs = self.node.step(event);
        let logged =
            logged.and_then(|()| self.log.as_mut().map_or(Ok(()), |log| log.outputs(number, event.time_ns, &outputs)));
        if let Err(error) = logged {
            self.log = None;
            let data = format!("the log ends here, the node goes on: {error}");
            let text = tactile_data::recording::ros::messages::Text { data };
            let cdr = tactile_data::recording::ros::messages::to_cdr(&text);
            outputs.push(Output::Publish { topic: Topic::Events, cdr });
        }
        self.onlookers.iter_mut().for_each(|onlooker| onlooker(event, &outputs));
        outputs
    }

    /// The node.
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// Ends the log with its index.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn finish(self) -> Result<()> {
        self.log.map_or(Ok(()), LogWriter::finish)
    }
}

//! The thin programs around a session: each feeds it events from one source and passes on what the node says.

mod failures;
pub mod film;
pub mod folder;
#[cfg(feature = "robot")]
pub mod pair;
#[cfg(feature = "ros2")]
pub mod ros;
#[cfg(all(feature = "ros2", feature = "robot"))]
pub mod ros_robot;
#[cfg(feature = "robot")]
pub mod simulated;
pub mod speaker;
#[cfg(any(feature = "foxglove", feature = "watch"))]
pub mod views;
#[cfg(feature = "watch")]
pub mod watch;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tactile_data::recording::ros::messages::{Text, from_cdr};

use crate::decision::DecisionReport;
use crate::event::{Output, Topic};

/// Between two ticks.
pub(crate) const TICK: Duration = Duration::from_millis(50);

/// What a person should see of the node's outputs.
#[derive(Clone, Debug, PartialEq)]
pub enum Spoken {
    /// A line.
    Line(String),
    /// A touch and what follows.
    Decision(Box<DecisionReport>),
}

/// What a person should see of some outputs, in order.
pub fn spoken(outputs: &[Output]) -> Vec<Spoken> {
    let text = |cdr: &[u8]| from_cdr::<Text>(cdr, "text").ok().map(|text| text.data);
    let one = |output: &Output| match output {
        Output::Publish { topic: Topic::Events, cdr } => text(cdr).map(Spoken::Line),
        Output::Publish { topic: Topic::Decision, cdr } => {
            serde_json::from_str(&text(cdr)?).ok().map(|report| Spoken::Decision(Box::new(report)))
        }
        _ => None,
    };
    outputs.iter().filter_map(one).collect()
}

/// Whether a stop was asked for.
pub(crate) fn is_asked(stop: &AtomicBool) -> bool {
    stop.load(Ordering::Relaxed)
}

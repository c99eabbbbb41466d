//! What a session is given and says, to whoever looks at it: Foxglove, or the terminal view.

#[cfg(feature = "watch")]
use std::sync::mpsc::SyncSender;

#[cfg(feature = "foxglove")]
use crate::error::Result;
#[cfg(feature = "foxglove")]
use crate::event::Given;
#[cfg(feature = "watch")]
use crate::event::{Input, Output, Topic};
#[cfg(feature = "foxglove")]
use crate::log::{Line, Setup};
use crate::session::Onlooker;

/// Shows pictures, poses and all that the node says in Foxglove, at an address such as `127.0.0.1:8765`.
///
/// # Errors
/// An address that is none, or that is taken.
#[cfg(feature = "foxglove")]
pub fn foxglove(address: &str, setup: Setup) -> Result<Onlooker> {
    let views = crate::foxglove::Views::open(address)?;
    let mut channels = std::collections::BTreeMap::new();
    let mut show = move |line: Line, time_ns: i64, cdr: &[u8]| {
        let channel = match channels.get(&line) {
            Some(channel) => Some(*channel),
            None => {
                let [type_name, definition] = line.message();
                // A topic that the server refuses is not shown.
                let channel = views.channel(&line.topic(&setup), type_name, definition).ok();
                channels.extend(channel.map(|channel| (line, channel)));
                channel
            }
        };
        if let Some(channel) = channel {
            views.send(channel, time_ns.unsigned_abs(), cdr);
        }
    };
    Ok(Box::new(move |event, outputs| {
        let (line, cdr) = Line::of_input(&event.input);
        if matches!(line, Line::Given(given) if given != Given::PartPose) {
            show(line, event.time_ns, &cdr);
        }
        for output in outputs {
            let (line, cdr) = Line::of_output(output);
            show(line, event.time_ns, &cdr);
        }
    }))
}

/// A message for the terminal view or the page.
#[cfg(feature = "watch")]
#[derive(Clone, Debug)]
pub struct Shown {
    /// When it was said, ns.
    pub time_ns: i64,
    /// What it is of.
    pub topic: Topic,
    /// The message.
    pub cdr: Vec<u8>,
    /// With the decision of a log: the last picture before it.
    pub picture: Option<Input>,
}

#[cfg(feature = "watch")]
impl Shown {
    /// A message without a picture.
    pub fn new(time_ns: i64, topic: Topic, cdr: Vec<u8>) -> Self {
        Self { time_ns, topic, cdr, picture: None }
    }
}

/// Sends what the terminal view shows; what does not fit is left out.
#[cfg(feature = "watch")]
pub fn terminal(sender: SyncSender<Shown>) -> Onlooker {
    Box::new(move |event, outputs| {
        for output in outputs {
            if let Output::Publish { topic, cdr } = output
                && is_shown(*topic)
            {
                // A view that is late shows the next one.
                drop(sender.try_send(Shown::new(event.time_ns, *topic, cdr.clone())));
            }
        }
    })
}

/// Whether the views of a running node show a topic: the terminal, or the page, which alone shows what was felt.
#[cfg(feature = "watch")]
pub fn is_shown(topic: Topic) -> bool {
    matches!(topic, Topic::Decision | Topic::Belief | Topic::Felt | Topic::Diagnostics | Topic::Events)
}

//! The node on a ROS 2 network.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use tactile_data::recording::ros::messages::{Message, PoseStamped, PoseWithCovarianceStamped};

use crate::error::{Error, Result};
use crate::event::{Event, Given, Input, Output, Request, Topic};
use crate::ros2::{
    Bus, Delivery, Endpoint, Inbox, Incoming, Level, Publication, RequestId, Service, Subscription, Trouble,
};
use crate::session::{Names, Session};
use crate::shell::failures::Failures;
use crate::shell::{Spoken, TICK, is_asked, spoken};
use crate::sources::NodeClock;

/// The node's topics and services on a network.
pub struct Network {
    bus: Bus,
    inbox: Inbox,
    given: BTreeMap<Subscription, Given>,
    services: [Service; 3],
    publications: BTreeMap<Topic, Publication>,
    /// Publishers of pictures, by subscription.
    cameras: BTreeMap<Subscription, usize>,
    /// Calls that wait for their answers.
    calls: BTreeMap<u64, (Service, RequestId)>,
    n_calls: u64,
    failures: Failures,
}

impl Network {
    /// Joins a network that was opened.
    ///
    /// # Errors
    /// Names that ROS 2 does not allow, a network that does not take them.
    pub fn join(bus: Bus, inbox: Inbox) -> Result<Self> {
        let subscribe = |given: Given| {
            // A part may come once.
            let delivery = if given == Given::PartPose { Delivery::Reliable } else { Delivery::Newest };
            Ok((bus.subscribe(given.name(), given.message()[0], delivery)?, given))
        };
        let given = Given::ALL.into_iter().map(subscribe).collect::<Result<_>>()?;
        let [observe, reset, calibrate] = Request::ALL.map(|request| bus.serve(request.name()));
        let mut publications = BTreeMap::new();
        for topic in Topic::ALL {
            let delivery = if topic.is_latched() { Delivery::Latched } else { Delivery::Reliable };
            publications.insert(topic, bus.advertise(topic.name(), topic.message()[0], delivery)?);
        }
        Ok(Self {
            services: [observe?, reset?, calibrate?],
            given,
            publications,
            cameras: BTreeMap::new(),
            calls: BTreeMap::new(),
            n_calls: 0,
            failures: Failures::default(),
            bus,
            inbox,
        })
    }

    /// The names of the node and its topics on the network.
    ///
    /// # Errors
    /// Names that ROS 2 does not allow.
    pub fn names(&self, node: &str) -> Result<Names> {
        Ok(Names {
            node: node.to_owned(),
            image_topic: self.bus.resolve(Given::Image.name())?,
            tool_topic: self.bus.resolve(Given::ToolPose.name())?,
            part_topic: self.bus.resolve(Given::PartPose.name())?,
        })
    }

    /// Runs until a stop is asked for. `tell` gets what a person should see. What cannot be sent, because a subscriber has
    /// stopped or the network is being made anew, is said and left out.
    ///
    /// # Errors
    /// A network that was closed for good, a log that cannot be ended.
    pub fn run(mut self, mut session: Session, stop: &AtomicBool, tell: &mut dyn FnMut(Spoken)) -> Result<()> {
        let clock = NodeClock::start();
        let mut last_tick = Instant::now();
        while !is_asked(stop) {
            match self.inbox.recv_timeout(TICK.saturating_sub(last_tick.elapsed()).max(Duration::from_millis(1))) {
                Ok(incoming) => {
                    if let Some((moment, input)) = self.input(incoming, tell) {
                        let outputs = session.handle(&Event { time_ns: clock.at_ns(moment), input });
                        self.pass_on(outputs, tell);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(Error::invalid("network", "an open one", "none")),
            }
            if last_tick.elapsed() >= TICK {
                last_tick = Instant::now();
                let outputs = session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick });
                self.pass_on(outputs, tell);
            }
        }
        session.finish()
    }

    fn input(&mut self, incoming: Incoming, tell: &mut dyn FnMut(Spoken)) -> Option<(Instant, Input)> {
        match incoming {
            Incoming::Message { subscription, cdr, received, .. } => {
                self.given.get(&subscription).map(|given| (received, Input::Given(*given, cdr)))
            }
            Incoming::Request { service, id, received } => {
                let at = self.services.iter().position(|known| *known == service)?;
                self.n_calls += 1;
                self.calls.insert(self.n_calls, (service, id));
                Some((received, Input::Called { request: Request::ALL[at], id: self.n_calls }))
            }
            Incoming::Matched { endpoint: Endpoint::Subscription(subscription), n_peers } => {
                self.given.get(&subscription).filter(|given| given.is_picture())?;
                self.cameras.insert(subscription, n_peers);
                let n_cameras = u32::try_from(self.n_cameras()).unwrap_or(u32::MAX);
                Some((Instant::now(), Input::Cameras(n_cameras)))
            }
            // Its pictures come on the other of the two topics; a part need not be seen.
            Incoming::Trouble(Trouble::NoPublisher { message_type, .. })
                if self.n_cameras() > 0 && message_type != PoseStamped::TYPE
                    || message_type == PoseWithCovarianceStamped::TYPE =>
            {
                None
            }
            Incoming::Trouble(trouble) => {
                let line = trouble.to_string();
                self.bus.log(Level::Warn, &line);
                tell(Spoken::Line(line));
                None
            }
            _ => None,
        }
    }

    /// Publishers of pictures. A driver may send each of its pictures raw and compressed.
    fn n_cameras(&self) -> usize {
        self.cameras.values().copied().max().unwrap_or_default()
    }

    fn pass_on(&mut self, outputs: Vec<Output>, tell: &mut dyn FnMut(Spoken)) {
        for spoken in spoken(&outputs) {
            if let Spoken::Line(line) = &spoken {
                self.bus.log(Level::Info, line);
            }
            tell(spoken);
        }
        for output in outputs {
            let sent = match output {
                Output::Publish { topic, cdr } => match self.publications.get(&topic) {
                    Some(publication) => self.bus.publish(*publication, &cdr),
                    None => Ok(()),
                },
                Output::Answer { id, success, message } => match self.calls.remove(&id) {
                    Some((service, id)) => self.bus.reply(service, &id, success, &message),
                    None => Ok(()),
                },
            };
            if let Some(line) = sent.err().and_then(|error| self.failures.line(&error.to_string(), Instant::now())) {
                self.bus.log(Level::Warn, &line);
                tell(Spoken::Line(line));
            }
        }
    }
}

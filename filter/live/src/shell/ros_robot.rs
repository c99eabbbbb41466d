//! The simulated robot on a ROS 2 network: a process of its own that only messages connect with the node.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use tactile_data::recording::ros::messages::{Message, Text};

use crate::error::{Error, Result};
use crate::event::{Given, Request, Topic};
use crate::robot::{Heard, Outcome, Robot, Sent};
use crate::ros2::{Bus, Call, Client, Delivery, Endpoint, Inbox, Incoming, Publication, Subscription};
use crate::shell::failures::Failures;
use crate::shell::{Spoken, is_asked};
use crate::sources::NodeClock;

/// Between two ticks: poses are sent 50 times a second.
const TICK: Duration = Duration::from_millis(10);

/// The robot's topics and services on a network.
pub struct RobotNetwork {
    bus: Bus,
    inbox: Inbox,
    given: BTreeMap<Given, Publication>,
    next_pose: Subscription,
    decision: Subscription,
    clients: [Client; 3],
    /// Services that answer.
    is_there: [bool; 3],
    /// The latest call: an answer to an earlier one comes too late.
    call: Option<Call>,
    failures: Failures,
}

impl RobotNetwork {
    /// Joins a network that was opened, as the robot of a node of this full name.
    ///
    /// # Errors
    /// Names that ROS 2 does not allow, a network that does not take them.
    pub fn join(bus: Bus, inbox: Inbox, node: &str) -> Result<Self> {
        let name = |of_node: &str| of_node.replacen('~', node, 1);
        let advertise =
            |given: Given| Ok((given, bus.advertise(&name(given.name()), given.message()[0], Delivery::Reliable)?));
        let subscribe = |topic: Topic| bus.subscribe(&name(topic.name()), topic.message()[0], Delivery::Reliable);
        let [observe, reset, calibrate] = Request::ALL.map(|request| bus.client(&name(request.name())));
        debug_assert_eq!(Topic::Decision.message()[0], Text::TYPE);
        Ok(Self {
            given: Given::ALL.into_iter().map(advertise).collect::<Result<_>>()?,
            next_pose: subscribe(Topic::NextPose)?,
            decision: subscribe(Topic::Decision)?,
            clients: [observe?, reset?, calibrate?],
            is_there: [false; 3],
            call: None,
            failures: Failures::default(),
            bus,
            inbox,
        })
    }

    /// Runs until the robot's holes are done or a stop is asked for. `tell` gets what a person should see.
    ///
    /// # Errors
    /// A network that is gone, a hole that cannot be touched.
    pub fn run(mut self, mut robot: Robot, stop: &AtomicBool, tell: &mut dyn FnMut(Spoken)) -> Result<Vec<Outcome>> {
        let clock = NodeClock::start();
        let mut last_tick = Instant::now();
        tell(Spoken::Line("waiting for the node's services".to_owned()));
        while !is_asked(stop) && !robot.is_finished() {
            let wait = TICK.saturating_sub(last_tick.elapsed()).max(Duration::from_millis(1));
            let mut heard = match self.inbox.recv_timeout(wait) {
                Ok(incoming) => self.heard(incoming),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return Err(Error::invalid("network", "an open one", "none")),
            };
            let is_ready = self.is_there.iter().all(|there| *there);
            if heard.is_none() && is_ready && last_tick.elapsed() >= TICK {
                last_tick = Instant::now();
                heard = Some(Heard::Tick);
            }
            let Some(heard) = heard else { continue };
            for sent in robot.step(clock.now_ns(), &heard)? {
                self.send(sent, tell);
            }
        }
        Ok(robot.outcomes().to_vec())
    }

    fn heard(&mut self, incoming: Incoming) -> Option<Heard> {
        match incoming {
            Incoming::Message { subscription, cdr, .. } if subscription == self.next_pose => Some(Heard::NextPose(cdr)),
            Incoming::Message { subscription, cdr, .. } if subscription == self.decision => Some(Heard::Decision(cdr)),
            Incoming::Response { call, success, message, .. } if self.call == Some(call) => {
                Some(Heard::Answer { success, message })
            }
            Incoming::Matched { endpoint: Endpoint::Client(client), n_peers } => {
                if let Some(at) = self.clients.iter().position(|known| *known == client) {
                    self.is_there[at] = n_peers > 0;
                }
                None
            }
            _ => None,
        }
    }

    /// What cannot be sent is said and left out; a call without an answer is made again.
    fn send(&mut self, sent: Sent, tell: &mut dyn FnMut(Spoken)) {
        let done = match sent {
            Sent::Given(given, cdr) => match self.given.get(&given) {
                Some(publication) => self.bus.publish(*publication, &cdr),
                None => Ok(()),
            },
            Sent::Call(request) => {
                let at = Request::ALL.iter().position(|known| *known == request).unwrap_or_default();
                self.bus.call(self.clients[at]).map(|call| self.call = Some(call))
            }
            Sent::Say(line) => return tell(Spoken::Line(line)),
        };
        if let Some(line) = done.err().and_then(|error| self.failures.line(&error.to_string(), Instant::now())) {
            tell(Spoken::Line(line));
        }
    }
}

//! ROS 2 topics and services over DDS, in pure Rust; no ROS is installed. Feature `ros2`.
//!
//! The main type is [`Bus`]: a node on the network. It carries whole messages in CDR, as bytes, because the same bytes go
//! to a log and to a viewer, and because a malformed message must be refused by whoever reads it and end no thread.
//! What arrives comes out of an [`Inbox`]; its memory is bounded. It must not know what the messages mean.
//!
//! ```no_run
//! use std::time::Duration;
//! use tactile_live::ros2::{Bus, Delivery, Incoming, Settings, arguments};
//!
//! # fn main() -> tactile_live::ros2::Result<()> {
//! let words = arguments(std::env::args().skip(1))?;
//! let settings = Settings::from_words("tactile_filter", &words, |name| std::env::var(name).ok())?;
//! let (bus, inbox) = Bus::open(settings)?;
//! let image = bus.subscribe("~/image", "sensor_msgs/msg/Image", Delivery::Newest)?;
//! let label = bus.advertise("~/label", "std_msgs/msg/String", Delivery::Latched)?;
//! while let Ok(incoming) = inbox.recv_timeout(Duration::from_secs(1)) {
//!     if let Incoming::Message { subscription, cdr, .. } = incoming
//!         && subscription == image
//!     {
//!         println!("{} bytes of picture", cdr.len());
//!         bus.publish(label, &[0, 1, 0, 0, 2, 0, 0, 0, b'A', 0])?;
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! The middleware is RustDDS, tried against CycloneDDS (`cargo xtask dds`). What it cannot do, and what follows:
//!
//! - Everybody in the network's domain is trusted, as everywhere in ROS 2 without SROS. Noise is left out, and so is most
//!   of what a known program sends with bytes changed. But who forges packets in a known publisher's name can take all
//!   memory: RustDDS 0.15.1 lists each number that a heartbeat claims, and makes room for the size that a piece of a
//!   message claims. A robot's network is to be separate from others.
//! - Frames of many megabytes come in hundreds of packets, of which the socket loses some. [`Delivery::Reliable`] brings
//!   them all where their publisher is reliable; [`Delivery::Newest`] may bring none of 24 MB.
//! - The time of sending is not known of messages in more than one packet: a picture's own header has it.
//! - A subscriber that has stopped, but not left, holds up its reliable topic after 64 messages, until its lease ends (10
//!   to 20 s).
//! - A service's request that is sent before its server has found the client is lost, as in all of ROS 2;
//!   [`Incoming::Matched`] of a client comes late enough.

mod bus;
mod calls;
mod error;
mod graph;
mod inbox;
mod latch;
mod names;
mod raw;
mod readers;
mod settings;
mod state;
mod trigger;
mod trouble;
mod wire;
mod writers;

pub use bus::Bus;
pub use error::{Error, Result};
pub use graph::{Identifiers, Level};
pub use inbox::{Inbox, Incoming};
pub use names::{NodeName, Remap};
pub use settings::{Arguments, Parameter, Settings, arguments};
pub use trouble::Trouble;

/// How messages are passed on: DDS's quality of service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// Best effort: the newest messages, and a lost one is not sent again. For pictures. A subscriber gets them of every
    /// publisher; a reliable subscriber gets nothing of a best-effort publisher.
    Newest,
    /// Reliable: a lost message is sent again.
    Reliable,
    /// Reliable, and who comes later gets the newest message and no other (transient local). A subscriber gets nothing of
    /// a publisher that is not latched.
    Latched,
}

/// A topic that is listened to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Subscription(usize);

/// A topic that is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Publication(usize);

/// A service that is offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Service(usize);

/// A service that is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Client(usize);

/// One call of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Call(u64);

/// Something of a bus that is connected with others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Connected with publishers.
    Subscription(Subscription),
    /// Connected with subscribers.
    Publication(Publication),
    /// Connected with clients.
    Service(Service),
    /// Connected with servers.
    Client(Client),
}

/// Who asked, and how the answer finds its way back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestId {
    /// The request, as the answer names it.
    request: rustdds::rpc::SampleIdentity,
    /// The program that asked, for its answer waits until that program listens.
    program: [u8; 12],
    form: trigger::Form,
}

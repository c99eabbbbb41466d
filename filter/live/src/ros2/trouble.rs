//! What goes wrong on the network, as cases.

/// Something to report; each is said once, or once in ten seconds with a count.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Trouble {
    /// For 5 s nobody published what a subscription listens to.
    #[error("{topic}: nobody publishes {message_type}")]
    NoPublisher {
        /// The topic, in full.
        topic: String,
        /// The type that is listened to.
        message_type: String,
    },
    /// A publisher of the topic is left out, because its messages are of another type.
    #[error("{topic}: expected {expected}, but somebody publishes {got}; those messages are left out")]
    OtherType {
        /// The topic, in full.
        topic: String,
        /// The type that is listened to.
        expected: String,
        /// The type that is published, as it is called on the wire.
        got: String,
    },
    /// A publisher or subscriber of the topic is left out, because it offers less than is asked for.
    #[error("{topic}: one side asks for {asked}, the other offers {offered}; no message will pass")]
    Incompatible {
        /// The topic, in full.
        topic: String,
        /// What the subscriber asks for.
        asked: String,
        /// What the publisher offers.
        offered: String,
    },
    /// Messages that could not be read were left out.
    #[error("{name}: {n_messages} messages left out: {reason}")]
    Refused {
        /// The topic or service, in full.
        name: String,
        /// How many since the last report.
        n_messages: u64,
        /// What is wrong with the last of them.
        reason: String,
    },
    /// The clock was set: connections were made anew.
    #[error("the clock was set by {seconds:+.1} s; the connections are made anew")]
    ClockSet {
        /// Forward is positive, s.
        seconds: f64,
    },
    /// The network could not be opened again; it is tried each second.
    #[error("the network is gone: {reason}")]
    NoNetwork {
        /// The middleware's reason.
        reason: String,
    },
    /// More requests and reports wait than are kept.
    #[error("more than {limit} requests and reports wait; some were left out")]
    Flooded {
        /// How many are kept.
        limit: usize,
    },
}

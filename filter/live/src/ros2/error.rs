//! What can go wrong with ROS 2, in one line.

/// The result of this module's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of the transport. What goes wrong later, on the network, arrives as [`Trouble`](super::Trouble).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A word, a name or a variable that does not make sense.
    #[error("{what}: expected {expected}, got {got:?}")]
    Invalid {
        /// The argument, variable or name.
        what: String,
        /// What would have been right.
        expected: &'static str,
        /// What came.
        got: String,
    },
    /// The middleware refused to make something.
    #[error("{what}: {reason}")]
    Network {
        /// What was to be made or sent.
        what: String,
        /// The middleware's reason.
        reason: String,
    },
    /// Readers do not keep up: a message was not sent.
    #[error("{topic}: a subscriber does not keep up; the message was not sent")]
    Congested {
        /// The topic, in full.
        topic: String,
    },
    /// A message to send that is not plain CDR, little endian.
    #[error("{topic}: expected a message that begins with 00 01 00 00, got {got}")]
    NotCdr {
        /// The topic, in full.
        topic: String,
        /// How it begins.
        got: String,
    },
    /// A service that nobody offers.
    #[error("{service}: nobody offers this service yet")]
    NoServer {
        /// The service's name, in full.
        service: String,
    },
    /// A handle of another bus.
    #[error("{0} is of another bus")]
    Unknown(String),
}

impl Error {
    pub(super) fn invalid(what: impl Into<String>, expected: &'static str, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected, got: got.into() }
    }

    /// `.map_err(Error::network(what))`.
    pub(super) fn network<E: std::fmt::Display>(what: impl Into<String>) -> impl FnOnce(E) -> Self {
        let what = what.into();
        move |reason| Self::Network { what, reason: reason.to_string() }
    }
}

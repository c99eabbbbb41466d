//! What can go wrong around the node. What the node itself refuses it reports and goes on.

use std::path::Path;

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this crate, one line for a person.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A log that does not give the same decisions again, or lacks an event.
    #[error("{log}, event {event}: expected {expected}, got {got}")]
    Replay {
        /// The log.
        log: String,
        /// Number of the event.
        event: u32,
        /// What the log holds.
        expected: String,
        /// What came of it now.
        got: String,
    },
    /// An error of the filter.
    #[error(transparent)]
    Filter(#[from] tactile_filter::Error),
    /// An error of the network.
    #[cfg(feature = "ros2")]
    #[error(transparent)]
    Ros2(#[from] crate::ros2::Error),
    /// An error of the live views.
    #[cfg(feature = "foxglove")]
    #[error(transparent)]
    Foxglove(#[from] crate::foxglove::Error),
    /// A value that makes no sense, a file, or an error of the data.
    #[error(transparent)]
    Data(#[from] tactile_data::Error),
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Data(tactile_data::Error::invalid(what, expected, got))
    }

    /// An error of the operating system with a file or folder.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let with_path = tactile_data::Error::io(path);
        move |source| Self::Data(with_path(source))
    }
}

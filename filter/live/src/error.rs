//! What can go wrong around the node. What the node itself refuses it reports and goes on.

use std::path::{Path, PathBuf};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this crate, one line for a person.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value that came from outside does not make sense.
    #[error("{what}: expected {expected}, got {got}")]
    Invalid {
        /// The parameter, file or message.
        what: String,
        /// What would have been right.
        expected: String,
        /// What came.
        got: String,
    },
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
    /// The operating system refused to read or write.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
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
    /// An error of the data.
    #[error(transparent)]
    Data(#[from] tactile_data::Error),
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected: expected.into(), got: got.into() }
    }

    /// An error of the operating system with a file or folder.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.as_ref().to_path_buf(), source }
    }
}

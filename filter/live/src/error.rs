//! What can go wrong around the node. What the node itself refuses it reports and goes on.

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

tactile_data::wraps_data_error!(Error);

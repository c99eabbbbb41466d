//! What can go wrong between a frame and its embedding.

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this crate, one line for a person.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value, frame or file that cannot be used.
    #[error(transparent)]
    Data(#[from] tactile_data::Error),
    /// A bank that belongs to one model was used with another.
    #[error("{what}: expected a bank made by model {:.12}, got one made by {:.12}", expected, got)]
    WrongModel {
        /// The bank, sensor or file.
        what: String,
        /// SHA-256 of the model in use.
        expected: String,
        /// SHA-256 of the model that made it.
        got: String,
    },
}

tactile_data::wraps_data_error!(Error);

impl Error {
    /// The same error with the file in front of what is wrong.
    pub fn within(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Data(error) => Self::Data(error.within(place)),
            other => other,
        }
    }
}

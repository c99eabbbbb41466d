//! What can go wrong between a frame and its embedding.

use std::path::Path;

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

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Data(tactile_data::Error::invalid(what, expected, got))
    }

    /// The same error with the file in front of what is wrong.
    pub fn within(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Data(error) => Self::Data(error.within(place)),
            other => other,
        }
    }

    /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let with_path = tactile_data::Error::io(path);
        move |source| Self::Data(with_path(source))
    }
}

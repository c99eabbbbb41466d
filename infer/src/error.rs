//! What can go wrong between a frame and its embedding.

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
        /// The field, tensor or file.
        what: String,
        /// What would have been right.
        expected: String,
        /// What came.
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
    /// A frame or dataset is not usable.
    #[error(transparent)]
    Data(#[from] tactile_data::Error),
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected: expected.into(), got: got.into() }
    }

    /// The same error with the file that it lies in before what is wrong.
    pub fn within(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Invalid { what, expected, got } => Self::Invalid { what: format!("{place}: {what}"), expected, got },
            Self::Data(error) => Self::Data(error.within(place)),
            other => other,
        }
    }

    /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, source }
    }
}

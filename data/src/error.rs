//! What can go wrong with data: what was expected, what came, and where.

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
        /// The field, row or file.
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
    /// A picture could not be read or written.
    #[cfg(feature = "datasets")]
    #[error("{}: {source}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// The decoder's reason.
        source: image::ImageError,
    },
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected: expected.into(), got: got.into() }
    }

    /// The same error with the file or field that it lies in before what is wrong.
    pub fn within(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Invalid { what, expected, got } => Self::Invalid { what: format!("{place}: {what}"), expected, got },
            other => Self::invalid(place.to_string(), "a file that can be read", other.to_string()),
        }
    }

    /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, source }
    }

    /// Attaches the path to a decoding error.
    #[cfg(feature = "datasets")]
    pub fn picture(path: impl AsRef<Path>) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Picture { path, source }
    }
}

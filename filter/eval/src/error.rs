//! What can go wrong in an evaluation.

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
    /// A model or bank that cannot be used.
    #[error(transparent)]
    Infer(#[from] tactile_infer::Error),
    /// A touch or a setting that the filter refuses.
    #[error(transparent)]
    Filter(#[from] tactile_filter::Error),
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Data(tactile_data::Error::invalid(what, expected, got))
    }

    /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let with_path = tactile_data::Error::io(path);
        move |source| Self::Data(with_path(source))
    }
}

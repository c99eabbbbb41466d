//! What can go wrong in an evaluation.

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

tactile_data::wraps_data_error!(Error);

//! What can go wrong in training.

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this crate, one line for a person.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The run diverged and was stopped before it overwrote its last good checkpoint.
    #[error("stopped at step {step}: {seen}; {}. Try {advice}", kept_text(*kept))]
    Diverged {
        /// Step at which it was seen.
        step: usize,
        /// What was seen.
        seen: String,
        /// What to try.
        advice: &'static str,
        /// Step of the checkpoint that is kept; `None` where none was written.
        kept: Option<usize>,
    },
    /// A result could not be written.
    #[error("{source}; step {step} is not saved, {}; continue with --resume once that is solved", kept_text(*kept))]
    NotSaved {
        /// Step that should have been saved.
        step: usize,
        /// Step of the checkpoint that is kept; `None` where none was written.
        kept: Option<usize>,
        /// Why.
        source: Box<Error>,
    },
    /// A value that makes no sense, a file, or a dataset that is not usable.
    #[error(transparent)]
    Data(#[from] tactile_data::Error),
    /// The network or its checkpoint is not usable.
    #[error(transparent)]
    Infer(#[from] tactile_infer::Error),
}

tactile_data::wraps_data_error!(Error);

fn kept_text(kept: Option<usize>) -> String {
    match kept {
        Some(step) => format!("model.safetensors of step {step} is kept"),
        None => "no checkpoint was written before".into(),
    }
}

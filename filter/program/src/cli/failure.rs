//! What ends a command.

/// The result of a command.
pub type Result<T> = std::result::Result<T, Failure>;

/// An error of one of the libraries, one line for a person.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// An evaluation failed.
    #[error(transparent)]
    Eval(#[from] tactile_eval::Error),
    /// A live node failed.
    #[error(transparent)]
    Live(#[from] tactile_live::Error),
}

/// Errors of the libraries below go as those of an evaluation.
macro_rules! through {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Eval(error.into())
            }
        })*
    };
}
through!(tactile_data::Error, tactile_infer::Error, tactile_filter::Error);

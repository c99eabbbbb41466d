//! Exceptions: one for each case of [`tactile_filter::Error`], all of them a `tactile_filter.Error`.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::prelude::*;
use tactile_data::FrameFault;

use crate::guard::catch;

create_exception!(tactile_filter, Error, PyException, "An error of this module; the episode is as before the call.");
create_exception!(tactile_filter, FrameError, Error, "The frame is dark, saturated, uniform or of another size.");
create_exception!(tactile_filter, FrozenFrameError, Error, "The same picture after a motion: the camera has stopped.");
create_exception!(tactile_filter, MotionError, Error, "The motion is not finite, or no robot's.");
create_exception!(tactile_filter, WrongModelError, Error, "The observation or bank is of another model.");
create_exception!(tactile_filter, WrongSideError, Error, "A touch of a peg among touches of holes, or the other way.");
create_exception!(tactile_filter, WrongBankError, Error, "The saved episode is of another bank or version.");
create_exception!(tactile_filter, EmptyReachError, Error, "No motion was offered that could be made.");
create_exception!(tactile_filter, ObservationError, Error, "An observation that no sensor makes.");
create_exception!(tactile_filter, ConfigError, Error, "A setting outside its range, or of an unknown name.");
create_exception!(tactile_filter, FileError, Error, "A file that the system refuses to read or write.");
create_exception!(tactile_filter, InvalidError, Error, "A file or value that makes no sense.");
create_exception!(tactile_filter, InternalError, Error, "A mistake in this library: please report it.");

/// Adds all of them to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Error", py.get_type::<Error>())?;
    module.add("FrameError", py.get_type::<FrameError>())?;
    module.add("FrozenFrameError", py.get_type::<FrozenFrameError>())?;
    module.add("MotionError", py.get_type::<MotionError>())?;
    module.add("WrongModelError", py.get_type::<WrongModelError>())?;
    module.add("WrongSideError", py.get_type::<WrongSideError>())?;
    module.add("WrongBankError", py.get_type::<WrongBankError>())?;
    module.add("EmptyReachError", py.get_type::<EmptyReachError>())?;
    module.add("ObservationError", py.get_type::<ObservationError>())?;
    module.add("ConfigError", py.get_type::<ConfigError>())?;
    module.add("FileError", py.get_type::<FileError>())?;
    module.add("InvalidError", py.get_type::<InvalidError>())?;
    module.add("InternalError", py.get_type::<InternalError>())
}

/// Why a computation gave no value.
pub enum Failure {
    /// An error of a library.
    Library(tactile_filter::Error),
    /// A panic, or what an earlier one broke.
    Internal(String),
}

impl<E: Into<tactile_filter::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(error.into())
    }
}

/// Runs `work` without Python's lock; other Python threads go on. A panic becomes an `InternalError`.
pub fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, Failure> + Send) -> PyResult<T> {
    let done = py.detach(|| catch(work).unwrap_or_else(|panic| Err(Failure::Internal(panic))));
    done.map_err(|failure| match failure {
        Failure::Library(error) => exception(py, error),
        Failure::Internal(what) => InternalError::new_err(format!("a mistake in tactile_filter: {what}")),
    })
}

/// The exception of an error.
pub fn exception(py: Python<'_>, error: tactile_filter::Error) -> PyErr {
    use tactile_data::Error as DataError;
    use tactile_filter::Error as FilterError;
    use tactile_infer::Error as InferError;

    let text = error.to_string();
    match error {
        FilterError::Frame { fault, .. } => frame_error(py, text, &fault),
        FilterError::FrozenFrame { .. } => FrozenFrameError::new_err(text),
        FilterError::Motion { .. } => MotionError::new_err(text),
        FilterError::WrongModel { .. } | FilterError::Infer(InferError::WrongModel { .. }) => {
            WrongModelError::new_err(text)
        }
        FilterError::WrongSide { .. } => WrongSideError::new_err(text),
        FilterError::WrongBank { .. } => WrongBankError::new_err(text),
        FilterError::EmptyReach { .. } => EmptyReachError::new_err(text),
        FilterError::Observation { .. } => ObservationError::new_err(text),
        FilterError::Config { .. } => ConfigError::new_err(text),
        FilterError::Infer(InferError::Data(DataError::Io { .. })) => FileError::new_err(text),
        FilterError::Infer(_) => InvalidError::new_err(text),
        _ => Error::new_err(text),
    }
}

/// A `FrameError` whose attribute `fault` says which.
fn frame_error(py: Python<'_>, text: String, fault: &FrameFault) -> PyErr {
    let name = match fault {
        FrameFault::Dark { .. } => "dark",
        FrameFault::Saturated { .. } => "saturated",
        FrameFault::Uniform { .. } => "uniform",
        FrameFault::WrongSize { .. } => "wrong-size",
        _ => "other",
    };
    let error = FrameError::new_err(text);
    match error.value(py).setattr("fault", name) {
        Ok(()) => error,
        Err(failed) => failed,
    }
}

/// What is passed is not what is asked for: a mistake in the program that calls, not in the touch.
pub fn type_error(what: &str, expected: &str, got: &str) -> PyErr {
    PyTypeError::new_err(format!("{what}: expected {expected}, got {got}"))
}

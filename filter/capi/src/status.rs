//! What every function answers, the message of the last error, and the version.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::TryLockError;

use tactile_data::FrameFault;
use tactile_data::text::number::short_numbers;
use tactile_filter::Error;
use tactile_filter::runner::{Fault, SubmitError};

/// Version of this interface: changed whenever a program must be compiled again. Compare it with tf_abi_version().
pub const TF_ABI_VERSION: u32 = 1;

/// What every function answers. After any of them but TF_STATUS_OK nothing was changed, unless it says so.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum tf_status {
    /// Done.
    Ok = 0,
    /// A pointer that must not be null is null, or is not aligned for what it points to.
    NullPointer = 1,
    /// A size, length, index or text that makes no sense; tf_last_error() says which.
    Argument = 2,
    /// The buffer is shorter than what there is to write; the required length was written, nothing else.
    BufferTooSmall = 3,
    /// Another thread is using this handle in a way that excludes this call; try again later.
    Busy = 4,
    /// This library is at fault. The process goes on; free the handle that was used.
    Panic = 5,
    /// The lamps are off: the frame is dark.
    FrameDark = 10,
    /// The camera is blinded or exposes too long.
    FrameSaturated = 11,
    /// The frame is uniform: no picture of a sensor.
    FrameUniform = 12,
    /// The frame has another size than the frame at rest.
    FrameWrongSize = 13,
    /// Something else is wrong with the frame.
    FrameOther = 14,
    /// The same picture, byte for byte, after a real motion: the camera has stopped.
    FrozenFrame = 15,
    /// The motion is not finite, or no robot's.
    Motion = 16,
    /// The observation, sensor or bank is of another model.
    WrongModel = 17,
    /// The saved episode is of another bank or version.
    WrongBank = 18,
    /// No motion was offered that could be made.
    EmptyReach = 19,
    /// Numbers that no sensor makes.
    Observation = 20,
    /// A setting outside its range.
    Config = 21,
    /// A file that cannot be read.
    File = 22,
    /// A model, bank or frame at rest that cannot be used: the file is damaged or of another kind, the frame too small.
    Unusable = 23,
    /// A touch of a peg in an episode of holes, or the other way.
    WrongSide = 24,
    /// The runner has as many jobs without a polled outcome as it may have.
    QueueFull = 30,
    /// The runner's thread has ended.
    Stopped = 31,
    /// There is no touch to estimate from.
    NoEpisode = 32,
    /// An error that this version has no number for; tf_last_error() says what.
    Other = 99,
}

/// Why a call was refused.
pub(crate) struct Failure {
    pub status: tf_status,
    pub message: String,
}

impl Failure {
    pub fn new(status: tf_status, message: impl Into<String>) -> Self {
        Self { status, message: short_numbers(&message.into()) }
    }

    /// A size, length, index or text that makes no sense.
    pub fn argument(what: &str, expected: impl std::fmt::Display, got: impl std::fmt::Display) -> Self {
        Self::new(tf_status::Argument, format!("{what}: expected {expected}, got {got}"))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::new(of_error(&error), error.to_string())
    }
}

impl From<tactile_infer::Error> for Failure {
    fn from(error: tactile_infer::Error) -> Self {
        Error::from(error).into()
    }
}

impl From<tactile_data::Error> for Failure {
    fn from(error: tactile_data::Error) -> Self {
        Error::from(error).into()
    }
}

impl<T> From<TryLockError<T>> for Failure {
    fn from(error: TryLockError<T>) -> Self {
        match error {
            TryLockError::WouldBlock => {
                Self::new(tf_status::Busy, "handle: expected no other user, got another thread")
            }
            TryLockError::Poisoned(_) => {
                Self::new(tf_status::Panic, "handle: expected one to go on with, got one after a panic; free it")
            }
        }
    }
}

impl From<SubmitError> for Failure {
    fn from(error: SubmitError) -> Self {
        let status = match &error {
            SubmitError::Full { .. } => tf_status::QueueFull,
            SubmitError::Stopped { .. } => tf_status::Stopped,
        };
        Self::new(status, error.to_string())
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        let status = match &fault {
            Fault::Filter(error) => of_error(error),
            Fault::NoEpisode { .. } => tf_status::NoEpisode,
            Fault::Panic { .. } => tf_status::Panic,
            _ => tf_status::Other,
        };
        Self::new(status, fault.to_string())
    }
}

fn of_error(error: &Error) -> tf_status {
    match error {
        Error::Frame { fault, .. } => match fault {
            FrameFault::Dark { .. } => tf_status::FrameDark,
            FrameFault::Saturated { .. } => tf_status::FrameSaturated,
            FrameFault::Uniform { .. } => tf_status::FrameUniform,
            FrameFault::WrongSize { .. } => tf_status::FrameWrongSize,
            _ => tf_status::FrameOther,
        },
        Error::FrozenFrame { .. } => tf_status::FrozenFrame,
        Error::Motion { .. } => tf_status::Motion,
        Error::WrongModel { .. } | Error::Infer(tactile_infer::Error::WrongModel { .. }) => tf_status::WrongModel,
        Error::WrongSide { .. } => tf_status::WrongSide,
        Error::WrongBank { .. } => tf_status::WrongBank,
        Error::EmptyReach { .. } => tf_status::EmptyReach,
        Error::Observation { .. } => tf_status::Observation,
        Error::Config { .. } => tf_status::Config,
        Error::Infer(tactile_infer::Error::Data(tactile_data::Error::Io { .. })) => tf_status::File,
        Error::Infer(_) => tf_status::Unusable,
        _ => tf_status::Other,
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Keeps a message for [`tf_last_error`].
pub(crate) fn remember(message: String) {
    let mut bytes = message.into_bytes();
    bytes.retain(|byte| *byte != 0);
    // Without a zero inside it is a C string.
    LAST_ERROR.set(CString::new(bytes).unwrap_or_default());
}

/// The body of every function: errors and panics become a status, and their message is kept.
pub(crate) fn call(work: impl FnOnce() -> Result<(), Failure>) -> tf_status {
    // Handles are locked while they are changed, and a lock that saw a panic refuses the next call.
    let failure = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return tf_status::Ok,
        Ok(Err(failure)) => failure,
        Err(payload) => Failure::new(tf_status::Panic, format!("panic: {}", message(payload.as_ref()))),
    };
    remember(failure.message);
    failure.status
}

/// What a panic said.
fn message(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message")
}

/// The message of the last call on this thread that did not answer TF_STATUS_OK, one line in English, UTF-8; "" before the
/// first. Belongs to the library, and is valid until the next call on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn tf_last_error() -> *const c_char {
    LAST_ERROR.with(|message| message.try_borrow().map_or(c"".as_ptr(), |message| message.as_ptr()))
}

/// The TF_ABI_VERSION that the library was built with. Where the header's differs, compile again.
#[unsafe(no_mangle)]
pub extern "C" fn tf_abi_version() -> u32 {
    TF_ABI_VERSION
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    #[test]
    fn a_panic_is_a_status_with_its_message() {
        assert_eq!(call(|| panic!("number {}", 7)), tf_status::Panic);
        let message = unsafe { CStr::from_ptr(tf_last_error()) };
        assert_eq!(message.to_str().unwrap(), "panic: number 7");
        // Of this thread alone, and kept after a call that succeeds.
        assert_eq!(call(|| Ok(())), tf_status::Ok);
        let other = std::thread::spawn(|| unsafe { CStr::from_ptr(tf_last_error()) }.to_bytes().len());
        assert_eq!(other.join().unwrap(), 0);
        assert_eq!(unsafe { CStr::from_ptr(tf_last_error()) }.to_bytes(), b"panic: number 7");
    }

    #[test]
    fn a_message_may_hold_a_zero() {
        remember("a\0b".into());
        assert_eq!(unsafe { CStr::from_ptr(tf_last_error()) }, c"ab");
    }
}

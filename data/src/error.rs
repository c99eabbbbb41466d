//! What can go wrong with data: what was expected, what came, and where.

use std::path::{Path, PathBuf};

use crate::text::number::short_numbers;

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
    /// A frame of the sensor cannot be used.
    #[error("{what}: {fault}")]
    Frame {
        /// Which frame.
        what: String,
        /// What is wrong with it.
        fault: FrameFault,
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

/// `invalid` and `io` of an error that holds this crate's as its variant `Data`.
#[macro_export]
macro_rules! wraps_data_error {
    ($error:ident) => {
        impl $error {
            /// A value of `what` that does not make sense.
            pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
                Self::Data($crate::Error::invalid(what, expected, got))
            }

            /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
            pub fn io(path: impl AsRef<std::path::Path>) -> impl FnOnce(std::io::Error) -> Self {
                let with_path = $crate::Error::io(path);
                move |source| Self::Data(with_path(source))
            }
        }
    };
}

/// What is wrong with a frame of the sensor. Counts are 0 to 255, over all channels.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameFault {
    /// The lamps are off: hardly any light, or far less than in the frame at rest.
    #[error("expected a lit picture, got a dark one with a mean of {mean_counts:.1} counts of 255")]
    Dark {
        /// Mean of the frame, counts.
        mean_counts: f32,
    },
    /// The camera is blinded, or exposes for too long.
    #[error("expected a lit picture, got a saturated one with a mean of {mean_counts:.1} counts of 255")]
    Saturated {
        /// Mean of the frame, counts.
        mean_counts: f32,
    },
    /// All values are nearly the same, which no picture of a sensor is.
    #[error("expected a picture with some contrast, got a uniform one of {lowest} to {highest} counts")]
    Uniform {
        /// Lowest value, counts.
        lowest: u8,
        /// Highest value, counts.
        highest: u8,
    },
    /// The frame has another size than the sensor's frame at rest.
    #[error("expected {}x{} pixels, got {}x{}", expected[0], expected[1], got[0], got[1])]
    WrongSize {
        /// Width and height of the frame at rest, pixels.
        expected: [usize; 2],
        /// Width and height of this frame, pixels.
        got: [usize; 2],
    },
}

impl Error {
    /// A value of `what` that does not make sense. Long numbers in it are written short ([`short_numbers`]).
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected: short_numbers(&expected.into()), got: short_numbers(&got.into()) }
    }

    /// The same error, with the file or field where it happened in front.
    pub fn within(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Invalid { what, expected, got } => Self::Invalid { what: format!("{place}: {what}"), expected, got },
            Self::Frame { what, fault } => Self::Frame { what: format!("{place}: {what}"), fault },
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

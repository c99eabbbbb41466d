//! What can go wrong between a touch and a belief: cases that a controller can match on.

use tactile_data::FrameFault;
use tactile_data::dataset::touch::Side;
use tactile_data::text::number::{short, short_numbers};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this crate, one line for a person. After any of them an episode is as it was before the call.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The frame is dark, saturated, uniform or of another size.
    #[error("{what}: {fault}")]
    Frame {
        /// Which frame.
        what: String,
        /// What is wrong with it.
        fault: FrameFault,
    },
    /// The picture is the same, byte for byte, as at the touch before, though the sensor moved: the camera has stopped.
    #[error("frame: expected a new picture after a motion of {mm:.1} mm and {deg:.1} degrees, got the one before")]
    FrozenFrame {
        /// Distance moved, mm.
        mm: f64,
        /// Angle turned, degrees.
        deg: f64,
    },
    /// The motion is not finite, or no robot's.
    #[error(
        "motion: expected at most 1 km and 1,000 rad, got x {} mm, y {} mm, theta {} rad",
        short(*x_mm), short(*y_mm), short(*theta_rad)
    )]
    Motion {
        /// Along x, mm.
        x_mm: f64,
        /// Along y, mm.
        y_mm: f64,
        /// Turn, rad.
        theta_rad: f64,
    },
    /// The observation or sensor is of another model than the bank.
    #[error("{what}: expected one of model {expected:.12}, got one of model {got:.12}")]
    WrongModel {
        /// What is of another model.
        what: &'static str,
        /// SHA-256 of the bank's model.
        expected: String,
        /// SHA-256 of the other.
        got: String,
    },
    /// The touch is of the other side than those before: an episode is of holes or of pegs.
    #[error("touch: expected one of a {expected} as before, got one of a {got}")]
    WrongSide {
        /// The side of the episode's first touch.
        expected: Side,
        /// The side of this one.
        got: Side,
    },
    /// A saved episode belongs to another bank, or to another version of this program.
    #[error("saved episode: expected {expected}, got {got}")]
    WrongBank {
        /// The bank or version in use.
        expected: String,
        /// The one that the episode names.
        got: String,
    },
    /// No motion was offered that could be made.
    #[error("reach: expected at least one motion of finite numbers, got {n_motions} motions, none of them finite")]
    EmptyReach {
        /// Motions offered.
        n_motions: usize,
    },
    /// An observation that no sensor makes: another length, or numbers that are not finite.
    #[error("touch: expected {expected}, got {got}")]
    Observation {
        /// What would have been right.
        expected: String,
        /// What came.
        got: String,
    },
    /// A setting outside its range.
    #[error("{setting}: expected {expected}, got {got}")]
    Config {
        /// The setting.
        setting: String,
        /// Its range.
        expected: String,
        /// What came.
        got: String,
    },
    /// A model or bank that cannot be used, or another error below.
    #[error(transparent)]
    Infer(tactile_infer::Error),
}

impl Error {
    /// A setting outside its range.
    pub(crate) fn config(setting: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Config { setting: setting.into(), expected: expected.into(), got: short_numbers(&got.into()) }
    }

    /// An observation that no sensor makes.
    pub(crate) fn observation(expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Observation { expected: expected.into(), got: short_numbers(&got.into()) }
    }
}

impl From<tactile_data::Error> for Error {
    fn from(error: tactile_data::Error) -> Self {
        match error {
            tactile_data::Error::Frame { what, fault } => Self::Frame { what, fault },
            other => Self::Infer(other.into()),
        }
    }
}

impl From<tactile_infer::Error> for Error {
    fn from(error: tactile_infer::Error) -> Self {
        match error {
            tactile_infer::Error::Data(error) => error.into(),
            other => Self::Infer(other),
        }
    }
}

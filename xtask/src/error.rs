//! What can go wrong with a chore, in one line.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;

/// The result of this program's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of this program.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A program ran and failed.
    #[error("{command} failed: {status}")]
    Failed {
        /// Its command line.
        command: String,
        /// How it ended.
        status: ExitStatus,
    },
    /// The operating system refused to read, write or start something.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file, folder or program.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file or an answer that does not make sense.
    #[error("{what}: expected {expected}, got {got}")]
    Invalid {
        /// The file, field or program.
        what: String,
        /// What would have been right.
        expected: String,
        /// What came.
        got: String,
    },
    /// Something of the system that a chore needs is not installed.
    #[error("{what} is not installed; on Debian or Ubuntu: apt-get install {packages}")]
    NotInstalled {
        /// The program or driver.
        what: String,
        /// Debian's packages that bring it.
        packages: &'static str,
    },
    /// `tidy` found this many things, each printed already.
    #[error("tidy found {0} things to correct")]
    Untidy(usize),
}

impl Error {
    /// A value of `what` that does not make sense.
    pub fn invalid(what: impl Into<String>, expected: impl Into<String>, got: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), expected: expected.into(), got: got.into() }
    }

    /// Says in which file or folder a value does not make sense.
    pub fn within(self, path: impl AsRef<Path>) -> Self {
        match self {
            Self::Invalid { what, expected, got } => {
                Self::Invalid { what: format!("{}: {what}", path.as_ref().display()), expected, got }
            }
            other => other,
        }
    }

    /// Attaches the path to an I/O error: `.map_err(Error::io(path))`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, source }
    }
}

//! Evaluations of the filter: episodes against simulated or recorded holes, figures, assembly, trade-off, and the pages.
//!
//! [`evaluate`] runs episodes through the same calls as a robot; true poses stay on its side of them. This crate must
//! not know devices, ROS or command lines.

pub mod assembly;
pub mod banks;
pub mod baselines;
pub mod by_hand;
pub mod certify;
mod earlier_holes;
pub mod episodes;
pub mod error;
pub mod evaluate;
pub mod fits;
pub mod hole;
pub mod holes;
pub mod narrative;
pub mod origins;
pub mod page;
mod protocol;
pub mod recorded_steps;
pub mod replay;
pub mod report;
pub mod reproduction;
pub mod result;
pub mod statistics;
pub mod summary;
pub mod sweep;

pub use error::{Error, Result};

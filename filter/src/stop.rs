//! Why an episode ends.

use serde::{Deserialize, Serialize};

/// Why an episode is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// A part is more probable than `stop_probability` and explains the touches.
    Confident,
    /// No part explains the touches: this one is not in the bank.
    NoneOfThese,
    /// `max_touches` touches were made.
    TouchLimit,
    /// No candidate leads anywhere that was not touched.
    NothingToLearn,
}

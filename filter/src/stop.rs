//! When and why an episode ends.

use serde::{Deserialize, Serialize};

/// How the likeliest part stands when it is asked whether to stop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Standing {
    /// Its probability, 0..=1.
    pub probability: f64,
    /// How well it explains the touches ([`crate::Estimate::fit`]).
    pub fit: Option<f64>,
    /// Touches that this is of ([`crate::Estimate::n_fitted`]).
    pub n_fitted: usize,
    /// Touches made.
    pub n_touches: usize,
}

/// Why an episode is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// A part is more probable than `stop_probability`, and explains the touches.
    Confident,
    /// No part explains the touches: this one is not in the bank.
    NoneOfThese,
    /// `max_touches` touches were made.
    TouchLimit,
    /// No candidate leads anywhere that was not touched.
    NothingToLearn,
}

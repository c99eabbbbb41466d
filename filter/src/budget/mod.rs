//! Settings for a budget of time, memory and touches, chosen from a measured trade-off (`tactile-filter tradeoff`).
//!
//! A [`Tradeoff`] holds points that were measured on one machine with one bank. [`Pace`] measures how fast this
//! machine and this bank are with the same settings; [`Tradeoff::choose`] takes the most accurate point that a
//! [`Budget`] allows.

mod pace;
mod settings;
mod tradeoff;

pub use pace::Pace;
pub use settings::{Knob, Settings};
pub use tradeoff::{Budget, Choice, Cost, Point, SCHEMA, Tradeoff};

#[cfg(test)]
pub(crate) use settings::tests::settings as settings_for_tests;

//! The pages of an evaluation and of a trade-off.

pub(crate) mod comparison;
mod cover;
mod evaluation;
pub mod knobs;
mod paper;
mod parts;
mod reliability;
mod risk;
pub(crate) mod series;
mod steps;
mod stopping;
mod strangers;
pub mod tradeoff;

pub use evaluation::{html, write_report};
pub use paper::{PaperNumbers, PaperRow};

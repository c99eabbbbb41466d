//! Setup for a budget of time, memory and touches, chosen from a measured trade-off (`tactile-filter tradeoff`).
//!
//! A [`Tradeoff`] holds points that were measured on one machine with one bank. [`Pace`] measures how fast this
//! machine and this bank are with the same settings; of the points that a [`Budget`] allows, [`Tradeoff::choose`] takes the
//! one with which most episodes end sure and right. It asks half of the episodes measured; the other half says what to
//! expect ([`Halves`]).
//!
//! ```no_run
//! # use tactile_data::frame::Frame;
//! # use tactile_data::pose::grid::PoseGrid;
//! # use tactile_filter::budget::{Budget, Cost, Half, Pace, Speeds, Tradeoff};
//! # use tactile_filter::{EpisodeConfig, Sensor};
//! # use tactile_infer::{Bank, Model};
//! # fn choose(
//! #     measured: &str, model: &Model, bank: &std::sync::Arc<Bank>, sensor: &Sensor, rest: &Frame, reach: &PoseGrid,
//! # ) -> tactile_filter::Result<EpisodeConfig> {
//! let tradeoff = Tradeoff::from_json("maze-small.frontier.json", measured)?;
//! let pace = Pace { sensor, frame: rest, bank, reach };
//! let (begun, base) = (std::time::Instant::now(), EpisodeConfig::of(model));
//! let mut here = |settings: &_, n_touches| {
//!     if !tradeoff.settings_of(model, bank.grid(), base.settings.false_accept).contains(&settings) {
//!         return Ok(None);
//!     }
//!     let pace_ms = pace.decision_ms(&settings.applied_to(&base), 0.1, &mut || begun.elapsed().as_secs_f64())?;
//!     Ok(Some(Cost { pace_ms, memory_mb: settings.memory_mb(model, bank, n_touches)? }))
//! };
//! let budget = Budget { decision_ms: Some(4.0), max_touches: Some(4), ..Budget::default() };
//! let choice = tradeoff.choose(&budget, &Speeds::default(), &mut here)?;
//! let Half { n_decided_and_right, n_episodes, .. } = choice.point.halves.promising;
//! println!("{n_decided_and_right} of {n_episodes} other episodes ended sure and right");
//! // The bank's rows belong in the format `choice.point.settings.rows`: `Bank::with_precision`.
//! let config = choice.point.settings.applied_to(&base);
//! # Ok(config)
//! # }
//! ```

mod halves;
mod pace;
mod setup;
mod speeds;
mod tradeoff;

pub use halves::{Half, Halves};
pub use pace::Pace;
pub use setup::{Knob, Setup};
pub use speeds::Speeds;
pub use tradeoff::{Budget, Choice, Cost, Point, SCHEMA, Strangers, Tradeoff};

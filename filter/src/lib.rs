//! Which peg fits this hole, and where the hole is: observation, belief, the next touch, the stop, the budget.
//!
//! The main type is [`Episode`]: a robot makes an [`Observation`] of its first touch with a [`Sensor`], begins an episode
//! with it, asks where to touch next, reports the motion it actually made with the next observation, and learns when to
//! stop. The robot owns the loop, the clock and the driver: this crate starts no thread, prints nothing, and knows no
//! gradients, no simulator and no files but a model's and a bank's. A real-time caller turns on the feature `runner`,
//! off by default, and gets `runner::Runner`: an episode on a thread of its own, with calls that never wait.
//!
//! ```
//! use std::sync::Arc;
//! use tactile_data::pose::grid::PoseGrid;
//! use tactile_data::pose::se2::Se2;
//! use tactile_filter::{Decision, Episode, EpisodeConfig, Observation};
//! use tactile_infer::Bank;
//! use tactile_infer::bank::rows::Rows;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Two pegs, three recorded views of each; they differ in the last one only.
//! let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
//! let rows = [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, -1.0]].concat();
//! let bank = Bank::from_rows(vec!["A".into(), "B".into()], grid, Rows::new(2, rows)?, vec![0.2; 6], "")?;
//!
//! let touch = |x, y| Observation::new(vec![x, y], 0.2);
//! let mut episode = Episode::begin(EpisodeConfig::default(), Arc::new(bank), &touch(0.98, 0.02))?;
//! let reach = [Se2::from_degrees(0.0, 0.0, 30.0), Se2::from_degrees(0.0, 0.0, 60.0)];
//! while let Decision::Touch(action) = episode.decide(&reach)? {
//!     // The robot moves and touches here.
//!     episode.observe(action.sensor_from_next, &touch(0.03, 0.97))?;
//! }
//! assert_eq!(episode.estimate().part, "A");
//! # Ok(())
//! # }
//! ```

pub mod belief;
pub mod budget;
#[cfg(test)]
mod checks;
pub mod choice;
mod config;
mod decision;
mod episode;
mod error;
pub mod insertion;
pub mod likelihood;
mod matrix;
mod number;
mod record;
#[cfg(feature = "runner")]
pub mod runner;
mod settings;
mod simd;
mod touch;
mod touch_model;

pub use belief::KnownStart;
pub use choice::Action;
pub use config::{EpisodeConfig, Method};
pub use decision::{Estimate, FeltMap, RunnerUp, SensorMatch, Standing, StopReason, Unfelt, VerifierOffset, Warning};
pub use episode::{Decision, Episode};
pub use error::{Error, Result};
pub use number::{Kind, Number, Range};
pub use record::{EpisodeRecord, VERSION};
pub use settings::Settings;
pub use tactile_data::FrameFault;
pub use tactile_infer::calibration::presence::{Presence, Verified};
pub use touch::{Observation, Sensor};
pub use touch_model::TouchModel;

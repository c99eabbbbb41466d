//! Which peg fits this hole, and where the hole is: hypotheses, updates, the next touch, termination.
//!
//! The main type is [`episode::Episode`]: a robot begins one with its first touch, asks it where to touch
//! next, reports the motion it actually made with the frame that it saw, and is told when to stop. The
//! robot owns the loop, the clock and the driver; this crate reads no file, starts no thread and prints
//! nothing. It must not know gradients, tensors or how frames are made.
//!
//! ```
//! use tactile_data::{grid::PoseGrid, se2::Se2};
//! use tactile_filter::episode::{Decision, Episode, EpisodeConfig};
//! use tactile_filter::likelihood::Observation;
//! use tactile_infer::bank::Bank;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Two pegs, three recorded views of each; they differ in the last one only.
//! let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
//! let rows = [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, -1.0]].concat();
//! let bank = Bank::from_rows(vec!["A".into(), "B".into()], grid, 2, rows, vec![0.2; 6], String::new())?;
//!
//! let touch = |x, y| Observation { query: vec![x, y], edge_share: 0.2 };
//! let config = EpisodeConfig::default();
//! let mut episode = Episode::begin_with(&config, &bank, &touch(0.98, 0.02))?;
//! let reach = [Se2::from_degrees(0.0, 0.0, 30.0), Se2::from_degrees(0.0, 0.0, 60.0)];
//! while let Decision::Touch(action) = episode.decide(&reach) {
//!     // The robot moves and touches here.
//!     episode.observe_with(action.sensor_from_next, &touch(0.03, 0.97))?;
//! }
//! assert_eq!(episode.estimate().part, "A");
//! # Ok(())
//! # }
//! ```

pub mod action;
pub mod belief;
pub mod budget;
pub mod config;
pub mod episode;
pub mod error;
pub mod exact;
#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod invariants;
mod lanes;
pub mod likelihood;
pub mod lookup;
pub mod modes;
#[cfg(feature = "cli")]
pub mod offline;
pub mod particle;
pub mod refine;
pub mod resample;
mod softplus;
#[cfg(test)]
mod synthetic;
pub mod touched;

pub use error::{Error, Result};

//! Which part it is, where, how sure, and whether to stop.
//!
//! In: the settings, the bank and the belief. Out: one verdict, and the [`Estimate`] that users read. It must not know
//! how touches are weighed or chosen.

mod by_maps;
mod candidates;
mod estimate;
mod felt_map;
mod sensor_match;
mod unfelt;
mod verdict;
mod verifier_offset;

pub(crate) use candidates::Candidates;
pub use estimate::Estimate;
pub use felt_map::FeltMap;
pub(crate) use sensor_match::Scores;
pub use sensor_match::SensorMatch;
pub use unfelt::Unfelt;
pub(crate) use verdict::{Asked, Placed};
pub use verdict::{RunnerUp, Standing, StopReason, Warning};
pub use verifier_offset::VerifierOffset;

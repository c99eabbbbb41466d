//! How a robot puts the named peg into its hole, and what a try in vain tells.
//!
//! In: the place of the hole and of the held peg, with their covariances, and the play. Out: where to slide the peg, and how much of what
//! is believed that covers. It must not know touches; force is not modelled.

mod search;
mod tried;

pub use search::{HeldPeg, Search};
pub use tried::Tried;
pub(crate) use tried::TriedStates;

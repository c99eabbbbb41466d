//! Where to touch next.
//!
//! In: the belief, the bank and the motions that the robot can make. Out: one of these motions, with what each was worth
//! and what it is expected to tell. It must not know when to stop, nor how the belief was inferred.

mod choose;
mod inputs;
mod pairing;
mod rule;
mod scorer;

pub use choose::{Action, Choice, Scored, choose, explain};
pub use inputs::ChoiceInputs;
pub use rule::ActionRule;
pub use scorer::Expected;

//! What must hold of the whole filter, in worlds made up for tests.

mod fuzz;
mod invariants;
pub mod synthetic;

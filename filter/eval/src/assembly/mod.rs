//! The paper's last experiment in simulation: a robot finds out by touch which of its pegs fits each hole of a
//! scene and where the hole is, and puts the peg in.

mod attempt;
mod in_hand;
mod page;
mod result;
pub mod trial;
mod workcell;

pub use attempt::{Attempt, Insertion, Task};
pub use page::{group_cells, group_table, html};
#[cfg(test)]
pub(crate) use result::tests::example;
pub use result::{Assembly, Failure, Group, Run, SCHEMA, Share};
pub use workcell::{Moment, Watch, Workcell};

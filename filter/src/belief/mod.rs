//! What is believed of part and pose.
//!
//! In: the likelihood of each touch and the motions between them. Out: the [`Posterior`](posterior::Posterior) over all
//! hypotheses after each touch, exact or by particles, and poses, fits, covariances and modes from it. It must not know
//! how a touch becomes a likelihood, what is touched next, or when to stop.

mod bayes;
mod blocks;
mod engine;
pub(crate) mod exact;
mod hypothesis;
mod known_start;
pub mod modes;
mod of_part;
pub mod particle;
pub mod posterior;
pub(crate) mod refine;
pub mod resample;
mod spread;

pub use bayes::{ALLOWED_ERROR, Belief};
pub use engine::EngineConfig;
pub(crate) use engine::Start;
pub use hypothesis::Hypothesis;
#[cfg(test)]
pub(crate) use hypothesis::Layout;
pub(crate) use hypothesis::states_between;
pub use known_start::KnownStart;
pub(crate) use known_start::StartBelief;
pub(crate) use spread::Hill;

//! The part-mating network, its checkpoint, and the bank of peg embeddings: f_HP and f_PP.
//!
//! [`Model`] turns frames into unit-length rows of `f32`; [`bank::Bank`] holds the rows of the pegs; no
//! tensor crosses this crate's embedding API. This crate must not know gradients, optimisers, beliefs
//! or robots.

pub mod bank;
pub mod checkpoint;
pub mod device;
pub mod encoder;
pub mod error;
pub mod matching;
pub mod safefile;
pub mod similarity;

pub use checkpoint::{Checkpoint, Model};
pub use device::DeviceKind;
pub use error::{Error, Result};

//! MoCo-v3 on pairs of hole and peg images: trains the part-mating model and writes checkpoints.
//!
//! [`run::train`] is the whole of it; [`moco`] is the method on one page. This crate must not know
//! beliefs, actions or evaluation boards.

pub mod augment;
pub mod batch;
pub mod error;
pub mod info_nce;
pub mod moco;
pub mod run;
pub mod schedule;
pub mod validate;

pub use error::{Error, Result};

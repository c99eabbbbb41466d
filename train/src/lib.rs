//! MoCo-v3 on pairs of hole and peg images: trains the part-mating model and writes checkpoints.
//!
//! [`run::train`] is the whole of it; [`moco`] is the method on one page. This crate must not know
//! beliefs, actions or evaluation boards.
//!
//! ```no_run
//! use std::path::Path;
//! use tactile_data::store::Dataset;
//! use tactile_infer::DeviceKind;
//! use tactile_train::run::{Event, TrainConfig, train};
//!
//! # fn main() -> tactile_train::Result<()> {
//! let dataset = Dataset::open(Path::new("maze"))?;
//! let outcome = train(
//!     &dataset,
//!     Path::new("model"),
//!     &TrainConfig::tiny(),
//!     DeviceKind::Flex,
//!     false,     // a fresh run, not a resumed one
//!     &|| false, // never asked to stop
//!     &mut |event| {
//!         if let Event::Saved { step, validation } = event {
//!             println!("step {step}: {:.1} % retrieved", 100.0 * validation.retrieval_1);
//!         }
//!     },
//! )?;
//! println!("{} has checksum {}", outcome.model.display(), outcome.sha256);
//! # Ok(())
//! # }
//! ```

pub mod augment;
pub mod batch;
pub mod error;
pub mod info_nce;
pub mod moco;
pub mod run;
pub mod schedule;
pub mod validate;

pub use error::{Error, Result};

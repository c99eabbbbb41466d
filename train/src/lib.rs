//! MoCo-v3 on pairs of hole and peg images: trains the part-mating model and writes checkpoints.
//!
//! [`run::train`] is the whole of it; [`moco`] is the method on one page; [`health`] says when to stop; [`page`]
//! draws the curves. This crate must not know
//! beliefs, actions or evaluation boards.
//!
//! ```no_run
//! use std::path::Path;
//! use tactile_data::store::Dataset;
//! use tactile_infer::DeviceKind;
//! use tactile_train::config::TrainConfig;
//! use tactile_train::run::{Event, Run, train};
//!
//! # fn main() -> tactile_train::Result<()> {
//! let dataset = Dataset::open(Path::new("maze"))?;
//! let run = Run {
//!     dataset: &dataset,
//!     letters: None, // no parts to tune on
//!     out: Path::new("model"),
//!     config: &TrainConfig::tiny(),
//!     device: DeviceKind::Flex,
//!     resume: false,
//! };
//! let never = || false; // never asked to stop
//! let outcome = train(&run, &never, &mut |event| {
//!     if let Event::Saved { step, validation } = event {
//!         println!("step {step}: {:.1} % retrieved", 100.0 * validation.retrieval_1);
//!     }
//! })?;
//! println!("{} has checksum {}", outcome.model.display(), outcome.sha256);
//! # Ok(())
//! # }
//! ```

pub mod augment;
pub mod batch;
pub mod config;
pub mod error;
pub mod gradient;
pub mod health;
pub mod history;
pub mod info_nce;
pub mod letters;
pub mod moco;
pub mod pace;
pub mod page;
pub mod pairs;
pub mod relight;
pub mod run;
pub mod schedule;
pub mod settings;
pub mod state;
pub mod validate;

pub use error::{Error, Result};

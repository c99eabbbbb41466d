//! MoCo-v3 on pairs of hole and peg images: trains the part-mating model and writes checkpoints.
//!
//! [`run::train`] is the whole of it: the loop, its checkpoints and its curves. This crate must not know beliefs,
//! actions or evaluation boards.
//!
//! ```no_run
//! use std::path::Path;
//! use tactile_data::dataset::store::Dataset;
//! use tactile_infer::DeviceKind;
//! use tactile_train::config::TrainConfig;
//! use tactile_train::output_folder::OutputFolder;
//! use tactile_train::run::{Event, Run, train};
//!
//! # fn main() -> tactile_train::Result<()> {
//! let data = Path::new("maze");
//! let out = OutputFolder::claim(Path::new("model"), &[data])?;
//! let run = Run {
//!     dataset: &Dataset::open(data)?,
//!     tuning: None, // no parts to tune on
//!     out: &out,
//!     config: &TrainConfig::tiny(),
//!     device: DeviceKind::Flex,
//!     resume: false,
//!     from: None, // random weights
//! };
//! let never = || false; // nobody asks it to stop
//! let outcome = train(&run, &never, &mut |event| {
//!     if let Event::Saved { step, validation } = event {
//!         println!("step {step}: {:.1} % retrieved", 100.0 * validation.retrieval_1);
//!     }
//! })?;
//! println!("{} has checksum {}", outcome.model.display(), outcome.sha256);
//! # Ok(())
//! # }
//! ```

mod augmentation;
mod batch;
#[cfg(feature = "wgpu")]
mod card_frames;
pub mod config;
mod curve_page;
mod divergence;
pub mod error;
mod feed;
mod gradient;
mod history;
mod info_nce;
mod laid;
#[cfg(feature = "wgpu")]
mod lamb;
#[cfg(feature = "wgpu")]
pub mod launches;
mod look_alikes;
pub mod maps;
pub mod mating;
mod moco;
mod other_light;
pub mod output_folder;
pub mod pairs;
mod relighting;
pub mod run;
mod schedule;
pub mod settings;
mod smooth_field;
mod state;
mod timing;
pub mod training;
pub mod tuning;
pub mod validation;
pub mod verifier;

pub use error::{Error, Result};

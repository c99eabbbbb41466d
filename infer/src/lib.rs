//! The part-mating network, its checkpoint, and the bank of peg embeddings: f_HP and f_PP.
//!
//! [`Model`] turns frames into unit-length rows of `f32`; [`bank::Bank`] holds the rows of the pegs; no
//! tensor crosses this crate's embedding API. This crate must not know gradients, optimisers, beliefs
//! or robots.
//!
//! ```
//! # #[cfg(feature = "burn")]
//! # fn main() -> tactile_infer::Result<()> {
//! use tactile_data::frame::{Frame, Preprocessing};
//! use tactile_infer::architecture::NetworkConfig;
//! use tactile_infer::{Checkpoint, DeviceKind, Model};
//!
//! // A network that has learnt nothing yet; `Model::load` takes a trained one from its file.
//! let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
//! let network = config.init(1, &DeviceKind::Flex.tensor_device());
//! let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Default::default());
//! let model = Model::new(checkpoint, "none yet".into(), DeviceKind::Flex)?;
//!
//! // From the camera: the sensor at rest once, then each touch (`tactile_data::picture::read` reads them from files).
//! let camera = |touched: u8| {
//!     let rgb = (0..32 * 24).flat_map(|i| [100 + if i % 32 > 15 { touched } else { 0 }, 110, 120 + (i % 9) as u8]);
//!     Frame::new(32, 24, rgb.collect())
//! };
//! let background = model.background(&camera(0)?)?;
//! let image = background.tactile_image(&camera(40)?)?; // what the network sees
//! let rows = model.embed_holes(&[image])?; // [1, dim], of unit length
//! assert!((rows.iter().map(|value| value * value).sum::<f32>() - 1.0).abs() < 1e-5);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "burn"))]
//! # fn main() {}
//! ```

#![cfg_attr(test, allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic"))]

pub mod architecture;
pub mod bank;
pub mod between;
#[cfg(feature = "datasets")]
pub mod calibrate;
pub mod calibration;
#[cfg(feature = "wgpu")]
pub mod card;
pub mod checkpoint;
// Gradients are for training alone.
#[cfg_attr(not(feature = "autodiff"), allow(dead_code))]
mod conv;
pub mod device;
pub mod encoder;
pub mod error;
#[cfg(feature = "datasets")]
pub mod fit;
#[cfg(all(test, feature = "burn"))]
mod forged;
#[cfg(all(test, feature = "burn"))]
mod fuzz;
pub mod learn_from;
pub mod maps;
pub mod match_odds;
pub mod matches;
#[cfg(feature = "datasets")]
pub mod matching;
pub mod metric;
#[cfg(feature = "datasets")]
pub mod minimum;
pub mod model;
#[cfg(feature = "datasets")]
mod nearest_touches;
pub mod neighbours;
#[cfg(feature = "burn")]
pub mod network;
#[cfg(feature = "datasets")]
pub mod offset;
pub mod precision;
pub mod presence;
#[cfg(feature = "datasets")]
pub mod recorded;
#[cfg(feature = "datasets")]
mod resampling;
pub mod rows;
pub mod safefile;
pub mod similarity;
#[cfg(feature = "sim")]
pub mod simulated;
mod symmetry;
pub mod threads;
pub mod touches_of_bank;
pub mod views;

pub use bank::Bank;
pub use checkpoint::Checkpoint;
pub use device::DeviceKind;
pub use error::{Error, Result};
pub use model::Model;
pub use precision::Precision;
pub use views::Views;

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
//! use tactile_infer::embedding::architecture::NetworkConfig;
//! use tactile_infer::{Checkpoint, DeviceKind, Model};
//!
//! // A network that has learnt nothing yet; `Model::load` takes a trained one from its file.
//! let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
//! let network = config.init(1, &DeviceKind::Flex.tensor_device());
//! let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Default::default());
//! let model = Model::new(checkpoint, "none yet".into(), DeviceKind::Flex)?;
//!
//! // From the camera: the sensor at rest once, then each touch (`tactile_data::frame::picture::read` reads them from files).
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

pub mod bank;
pub mod calibration;
pub mod embedding;
pub mod error;
#[cfg(all(test, feature = "burn"))]
mod forged;
#[cfg(all(test, feature = "burn"))]
mod fuzz;
pub mod maps;
pub mod safefile;

pub use bank::Bank;
pub use bank::views::Views;
pub use embedding::checkpoint::Checkpoint;
pub use embedding::device::DeviceKind;
pub use embedding::model::Model;
pub use embedding::precision::Precision;
pub use error::{Error, Result};

//! Poses, grids, frames, touches, scenes, the simulated tactile sensor, datasets on disk and
//! recordings in and out.
//!
//! The main types are [`frame::Frame`] (what a camera saw), [`frame::TactileImage`] (what a network
//! sees), [`scene::Scene`] (what is simulated) and [`store::Dataset`] (what is on disk). This crate
//! must not know networks, embeddings or beliefs.
//!
//! ```
//! use tactile_data::frame::{Background, Preprocessing};
//! use tactile_data::simulator::{Simulator, frame_rng};
//! use tactile_data::{scene::Scene, se2::Se2, touch::Side};
//!
//! # fn main() -> tactile_data::Result<()> {
//! // The hole of an A, 12 mm high, touched in its middle.
//! let simulator = Simulator::new(Scene::load("alphabet-small")?, 1)?;
//! let frame = simulator.touch(0, Side::Hole, &Se2::IDENTITY, &mut frame_rng(7, 0))?;
//!
//! // What a network would see of it, in counts.
//! let background = Background::new(&simulator.no_contact(7), &Preprocessing::counts([40, 30]))?;
//! let image = background.tactile_image(&frame)?;
//! assert!(image.edge_share > 0.2, "an A is mostly edges");
//! # Ok(())
//! # }
//! ```

pub mod calibrate;
#[cfg(feature = "cli")]
pub mod closed_output;
pub mod compare;
pub mod contact;
pub mod contact_sheet;
pub mod error;
pub mod fragment;
pub mod frame;
pub mod generate;
pub mod grid;
pub mod npy;
pub mod picture;
pub mod recording;
pub mod render;
pub mod scene;
pub mod se2;
pub mod sensor;
pub mod shape;
pub mod shard;
pub mod simulator;
pub mod store;
pub mod touch;

pub use error::{Error, Result};

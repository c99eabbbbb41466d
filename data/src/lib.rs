//! Poses, grids, frames, touches, scenes, the simulated tactile sensor, datasets on disk and
//! recordings in and out.
//!
//! The main types are [`frame::Frame`] (what a camera saw), [`frame::TactileImage`] (what a network
//! sees), [`scene::Scene`] (what is simulated) and [`dataset::store::Dataset`] (what is on disk). This crate
//! must not know networks, embeddings or beliefs.
//!
//! ```
//! use tactile_data::frame::{Background, Preprocessing};
//! use tactile_data::sensor::simulator::{Simulator, frame_rng};
//! use tactile_data::scene::Scene;
//! use tactile_data::pose::se2::Se2;
//! use tactile_data::dataset::touch::Side;
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

pub mod dataset;
pub mod error;
pub mod file;
pub mod frame;
pub mod light;
pub mod pose;
#[cfg(feature = "cli")]
pub mod program;
#[cfg(feature = "datasets")]
pub mod recording;
#[cfg(feature = "sim")]
pub mod scene;
#[cfg(feature = "sim")]
pub mod sensor;
pub mod text;

pub use error::{Error, FrameFault, Result};

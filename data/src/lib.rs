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

pub mod bounded_file;
#[cfg(feature = "sim")]
pub mod calibrate;
#[cfg(feature = "cli")]
pub mod closed_output;
#[cfg(feature = "sim")]
pub mod compare;
#[cfg(feature = "datasets")]
pub mod contact;
#[cfg(feature = "sim")]
pub mod contact_sheet;
#[cfg(feature = "datasets")]
pub mod dataset_merge;
pub mod error;
#[cfg(feature = "datasets")]
pub mod export;
pub mod frame;
#[cfg(feature = "sim")]
pub mod generate;
pub mod grid;
pub mod grid_fit;
#[cfg(feature = "datasets")]
pub mod inspection;
#[cfg(feature = "sim")]
pub mod lab;
pub mod lamps;
#[cfg(feature = "lerobot")]
pub mod lerobot;
#[cfg(feature = "datasets")]
pub mod moved_view;
#[cfg(feature = "sim")]
pub mod needs;
#[cfg(feature = "sim")]
pub mod npy;
pub mod number;
pub mod origin;
#[cfg(feature = "datasets")]
pub mod output;
pub mod output_lock;
#[cfg(feature = "datasets")]
pub mod picture;
pub mod printable;
#[cfg(feature = "cli")]
pub mod program;
#[cfg(feature = "cli")]
pub mod progress;
#[cfg(feature = "sim")]
mod random;
#[cfg(feature = "datasets")]
pub mod recording;
#[cfg(feature = "sim")]
pub mod render;
#[cfg(feature = "sim")]
pub mod scene;
pub mod se2;
#[cfg(feature = "sim")]
pub mod sensor;
#[cfg(feature = "sim")]
pub mod shape;
#[cfg(feature = "datasets")]
pub mod shard;
#[cfg(feature = "sim")]
mod sheet;
#[cfg(feature = "sim")]
pub mod simulator;
#[cfg(feature = "datasets")]
pub mod store;
#[cfg(feature = "datasets")]
pub mod suggest;
pub mod symmetry;
pub mod touch;
pub mod touch_light;
#[cfg(feature = "sim")]
pub mod touch_map;
pub mod whole_file;

pub use error::{Error, FrameFault, Result};

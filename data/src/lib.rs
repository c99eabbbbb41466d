//! Poses, grids, frames, touches, scenes, the simulated tactile sensor, datasets on disk and
//! recordings in and out.
//!
//! The main types are [`frame::Frame`] (what a camera saw), [`frame::TactileImage`] (what a network
//! sees), [`scene::Scene`] (what is simulated) and [`store::Dataset`] (what is on disk). This crate
//! must not know networks, embeddings or beliefs.

pub mod contact;
pub mod contact_sheet;
pub mod error;
pub mod frame;
pub mod generate;
pub mod grid;
pub mod picture;
pub mod recording;
pub mod scene;
pub mod se2;
pub mod sensor;
pub mod shape;
pub mod simulator;
pub mod store;
pub mod touch;

pub use error::{Error, Result};

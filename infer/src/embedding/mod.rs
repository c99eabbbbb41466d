//! A picture of a touch becomes a row: the network, the file it is kept in, and what it runs on.
//!
//! In: tactile images. Out: [`Model`](model::Model) and its rows, `[n, dim]`, of unit length. It must not know banks.

pub mod architecture;
#[cfg(feature = "wgpu")]
pub mod card;
pub mod checkpoint;
// Gradients are for training alone.
#[cfg_attr(not(feature = "autodiff"), allow(dead_code))]
pub(crate) mod conv;
pub mod device;
pub mod encoder;
pub mod model;
#[cfg(feature = "burn")]
pub mod network;
pub mod precision;
pub mod threads;

//! The crates together: each module is a part of what a user does, each test a claim about it.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

mod assembly;
mod bad_input;
mod chain;
mod divergence;
mod filter;
mod infer;
mod live;
mod maps;
mod pages;
mod readme;
mod recordings;
mod train;
mod verifier;
#[cfg(feature = "wgpu")]
mod wgpu;
mod your_sensor;

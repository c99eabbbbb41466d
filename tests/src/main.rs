//! The crates together: each module is a part of what a user does, each test a claim about it.

mod assembly;
mod bad_input;
mod chain;
mod filter;
mod infer;
mod readme;
mod sick;
mod train;
#[cfg(feature = "wgpu")]
mod wgpu;

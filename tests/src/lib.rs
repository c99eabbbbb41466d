//! Programs run as a user runs them, and small samples for them to work on: what the tests of the
//! crates together share.
//!
//! [`programs::run`] runs a program of this workspace; [`samples::Sample`] is a tiny chain of dataset,
//! model and bank; [`served::Served`] is a program that serves a page. This crate must not be used outside tests: it panics where something is wrong.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

pub mod programs;
pub mod samples;
pub mod served;

//! The filter as a C library, with a C++17 wrapper: which peg fits this hole, and where the hole is, for a controller
//! that is not written in Rust. README.md is the page for its users; `include/tactile_filter.h` is made of this source.
//!
//! Every function returns a [`tf_status`](status::tf_status), checks what it is given, and catches panics. Handles are
//! opaque; values are plain structs. This crate knows no simulator, no burn and no ROS: it puts a C face on
//! [`tactile_filter`], and computes nothing.
//!
//! ```
//! use std::ptr::{null, null_mut};
//! use tactile_capi::model::tf_model_load;
//! use tactile_capi::status::{tf_abi_version, tf_status};
//!
//! assert_eq!(tf_abi_version(), tactile_capi::status::TF_ABI_VERSION);
//! let mut model = null_mut();
//! let status = unsafe { tf_model_load(null(), &mut model) };
//! assert_eq!((status, model), (tf_status::NullPointer, null_mut()));
//! ```

#![expect(unsafe_code, reason = "a C interface takes pointers: pointer.rs checks all of them that can be checked")]
#![allow(non_camel_case_types, reason = "types have the names that C sees")]
#![expect(clippy::missing_safety_doc, reason = "the header gives the rules for pointers once, at its top")]
#![cfg_attr(test, allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic"))]

pub mod config;
pub mod episode;
pub mod insertion;
pub mod light;
pub mod model;
mod pointer;
pub mod runner;
pub mod sensor;
pub mod status;
pub mod value;

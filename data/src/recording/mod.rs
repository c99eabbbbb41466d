//! Recordings of real sensors, brought into the native format of [`crate::store`].

pub mod folder;
pub mod pipeline;
pub mod rest;
pub mod ros;

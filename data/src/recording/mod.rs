//! Recordings of real sensors, brought into the native format of [`crate::dataset::store`].

pub mod contact;
pub mod contradiction;
pub mod folder;
pub mod geometry;
pub mod index;
pub mod lerobot;
pub mod listing;
pub mod parquet;
pub mod pipeline;
pub mod rest;
pub mod ros;
pub mod spreadsheet;

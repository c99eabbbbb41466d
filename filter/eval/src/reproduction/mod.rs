//! The paper's tables and figures with ours next to them, as one page: what `cargo xtask reproduce` left in a folder.
//!
//! [`Reproduction::load`] reads the folder, [`html`] makes the page, [`summary`] gives a line for each table. What is
//! missing from the folder is shown as not run.

mod assembly;
mod cell;
mod classes;
mod experiments;
mod folder;
mod hard;
mod informed;
mod list;
mod page;
mod picture;
mod section;
mod sensors;
mod speed;
mod steps;
mod tables;
mod way;

pub use folder::{Reproduction, Step};
pub use page::{html, summary};
pub use picture::picture;
pub use sensors::{SensorTable, table as sensor_table};

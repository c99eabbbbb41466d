//! A dataset on disk: touches of one sensor, with its frame at rest.
//!
//! A folder of four files. `frames.npy` holds the frames, u8 `[n, height, width, 3]`, memory-mapped
//! when read; `index.jsonl` one [`Touch`](crate::dataset::touch::Touch) a line in the same order; `no_contact.png` the sensor at
//! rest; `meta.json` a [`Meta`] with the schema, the number of frames and the checksums of the other
//! two. `numpy.load` reads the frames as they are.

mod dataset;
mod files;
mod frames;
pub(crate) mod meta;
pub mod provenance;
#[cfg(test)]
mod tests;
mod writer;

pub use dataset::Dataset;
pub(crate) use dataset::read_no_contact;
pub use files::{FILES, SCHEMA};
pub(crate) use meta::read_meta;
pub use meta::{Meta, set_peg_from_hole};
pub use provenance::{Channels, Mirror, Recording};
pub use writer::DatasetWriter;

//! Files that are whole or not there: read within bounds, written under another name and renamed, never over an input.

pub mod bounded_file;
#[cfg(feature = "datasets")]
pub mod output;
pub mod output_lock;
pub mod whole_file;

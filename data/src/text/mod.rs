//! Text that people write and read: numbers in it, what they may have meant, what a terminal may print.

pub mod number;
pub mod printable;
#[cfg(feature = "datasets")]
pub mod suggest;

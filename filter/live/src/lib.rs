//! Live touches: frames and poses in, decisions out.

#[cfg(feature = "watch")]
pub mod watch;

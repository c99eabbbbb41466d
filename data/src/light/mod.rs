//! The light of a sensor: its lamps, how they answer slopes, and how both are found from touches.

#[cfg(feature = "sim")]
pub mod calibrate;
pub mod lamps;
pub mod touch_light;

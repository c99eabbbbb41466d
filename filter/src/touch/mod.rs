//! A frame of the camera becomes an observation.
//!
//! In: a frame, and the sensor that took it. Out: what the filter takes in, [`Observation`]: the embedding, and the share
//! of edge pixels. It must not know banks, parts or beliefs.

mod observation;
mod sensor;

pub use observation::Observation;
pub(crate) use observation::check_motion;
pub use sensor::Sensor;

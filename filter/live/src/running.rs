//! An episode where it is in space.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::rigid::Rigid;
use tactile_filter::{Decision, Episode, Observation};

use crate::error::{Error, Result};

/// An episode, and where its sensor was and is.
#[derive(Clone, Debug)]
pub struct Running {
    /// The episode.
    pub episode: Episode,
    /// The sensor at the first touch.
    pub base_from_first: Rigid,
    /// The sensor at the latest.
    pub base_from_sensor: Rigid,
}

impl Running {
    /// Takes in a touch with the sensor there; the motion since the touch before. After an error all is as before.
    ///
    /// # Errors
    /// A sensor tilted by more than `max_tilt_deg` against the touch before, and those of the filter.
    pub fn observe(&mut self, base_from_sensor: Rigid, max_tilt_deg: f64, observation: &Observation) -> Result<Se2> {
        let moved = in_plane(&self.base_from_sensor, &base_from_sensor, max_tilt_deg).map_err(|tilt_deg| {
            let expected = format!("touches tilted by at most {max_tilt_deg} degrees against each other");
            Error::invalid("tool pose", expected, format!("{tilt_deg:.1} degrees"))
        })?;
        self.episode.observe(moved, observation)?;
        self.base_from_sensor = base_from_sensor;
        Ok(moved)
    }

    /// What to do next within a reach around the first touch.
    ///
    /// # Errors
    /// The decision of the filter.
    pub fn decide(&self, reach: &PoseGrid) -> Result<Decision> {
        let sensor_from_first = self.episode.belief().first_from_sensor().inverse();
        let reach: Vec<Se2> = (0..reach.len()).map(|cell| sensor_from_first * reach.pose(cell)).collect();
        Ok(self.episode.decide(&reach)?)
    }
}

/// A pose in the plane of another.
///
/// # Errors
/// By how many degrees it is tilted, where that is more than `max_tilt_deg`.
pub(crate) fn in_plane(base_from_a: &Rigid, base_from_b: &Rigid, max_tilt_deg: f64) -> std::result::Result<Se2, f64> {
    let found = (base_from_a.inverse() * *base_from_b).project();
    if found.is_turned {
        return Err(180.0 - found.tilt_deg);
    }
    if found.tilt_deg > max_tilt_deg { Err(found.tilt_deg) } else { Ok(found.pose) }
}

//! A part that was seen before it is touched: by a camera over the board, in a drawing of the cell.

use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{PoseWithCovarianceStamped, from_cdr};
use tactile_data::recording::ros::rigid::Rigid;
use tactile_filter::KnownStart;

use crate::error::{Error, Result};
use crate::published::MM_PER_M;
use crate::running::in_plane;
use crate::tool::Placed;

/// Where the next hole is known to be.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenPart {
    /// The robot's base frame, as its messages name it.
    frame_id: String,
    /// The part in it: its z axis points as the sensor's at a touch, into the board.
    base_from_part: Rigid,
    /// Row by row, x, y and z in metres, then rotations about the base's axes in radians.
    covariance: [f64; 36],
}

impl SeenPart {
    /// From a message.
    ///
    /// # Errors
    /// Bytes that are no pose, a covariance that is not finite or has no width.
    pub fn of(cdr: &[u8]) -> Result<Self> {
        let message: PoseWithCovarianceStamped = from_cdr(cdr, "part pose")?;
        let PoseWithCovarianceStamped { header, pose, covariance } = message;
        let base_from_part = Rigid::from_pose(&pose, "part pose")?;
        let is_covariance = covariance.iter().all(|value| value.is_finite()) && covariance.iter().any(|v| *v > 0.0);
        if !is_covariance {
            // Many publishers leave zeros where they do not know.
            let got = if covariance.iter().all(|value| *value == 0.0) { "zeros" } else { "other numbers" };
            return Err(Error::invalid("part pose", "a covariance: finite, not all zero", got));
        }
        Ok(Self { frame_id: header.frame_id, base_from_part, covariance })
    }

    /// What is known of the first touch with the sensor there.
    ///
    /// # Errors
    /// Another frame than the tool's, a sensor tilted by more than `max_tilt_deg` against the part.
    pub fn start(&self, placed: &Placed, max_tilt_deg: f64) -> Result<KnownStart> {
        if self.frame_id != placed.frame_id {
            let expected = format!("frame {:?} of the tool", placed.frame_id);
            return Err(Error::invalid("part pose", expected, format!("{:?}", self.frame_id)));
        }
        let there = in_plane(&placed.base_from_sensor, &self.base_from_part, max_tilt_deg).map_err(|tilt_deg| {
            let expected =
                format!("a z axis as the sensor's, into the board, tilted by at most {max_tilt_deg} degrees");
            Error::invalid("part pose", expected, format!("{tilt_deg:.1} degrees"))
        })?;
        Ok(KnownStart::of_part(there, self.in_frame_of(&placed.base_from_sensor), Se2::IDENTITY))
    }

    /// The covariance over x, y (mm) and theta (rad) of the part in the sensor's frame.
    fn in_frame_of(&self, base_from_sensor: &Rigid) -> [[f64; 3]; 3] {
        let axes = base_from_sensor.matrix();
        // What each of the six numbers moves along the sensor's x and y, and turns about its z.
        let by = |row: usize, at: usize| match (row, at) {
            (0..2, 0..3) => MM_PER_M * axes[at][row],
            (2, 3..6) => axes[at - 3][2],
            _ => 0.0,
        };
        let sum = |row: usize, column: usize| -> f64 {
            (0..36).map(|at| by(row, at / 6) * self.covariance[at] * by(column, at % 6)).sum()
        };
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| sum(row, column)))
    }
}

#[cfg(test)]
mod tests {
    use tactile_data::recording::ros::messages::{Header, to_cdr};

    use super::*;
    use crate::published::covariance;

    fn message(frame_id: &str, base_from_part: &Rigid, covariance: [f64; 36]) -> Vec<u8> {
        let header = Header { frame_id: frame_id.into(), ..Header::default() };
        to_cdr(&PoseWithCovarianceStamped { header, pose: base_from_part.to_pose(), covariance })
    }

    fn placed() -> Placed {
        let base_from_sensor = Rigid::from_xyz_rpy([0.3, -0.2, 0.5], [3.0, 0.2, 0.7], "here").unwrap();
        Placed { frame_id: "base".into(), base_from_sensor, still_since_ns: 0 }
    }

    /// What the node publishes of a hole begins an episode with what the node knew.
    #[test]
    fn a_pose_that_was_published_comes_back() {
        let (placed, part_from_first) = (placed(), Se2::new(3.0, -5.0, 0.8));
        let known = [[2.0, 0.3, 0.02], [0.3, 1.0, -0.01], [0.02, -0.01, 0.03]];
        let base_from_part = placed.base_from_sensor * Rigid::from_plane(&part_from_first.inverse());
        let published = covariance(&placed.base_from_sensor, &part_from_first, &known);
        let seen = SeenPart::of(&message("base", &base_from_part, published)).unwrap();
        let start = seen.start(&placed, 5.0).unwrap();
        assert!(start.part_from_first.distance_mm(&part_from_first) < 1e-6);
        assert!((start.part_from_first.theta_rad - part_from_first.theta_rad).abs() < 1e-9);
        for (found, expected) in start.covariance.as_flattened().iter().zip(known.as_flattened()) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let (placed, mut wide) = (placed(), [0.0; 36]);
        wide[0] = 1e-6;
        let of = |frame: &str, from_part: &Rigid, covariance| SeenPart::of(&message(frame, from_part, covariance));
        let there = placed.base_from_sensor;
        assert!(of("base", &there, [0.0; 36]).unwrap_err().to_string().contains("got zeros"));
        assert!(of("base", &there, [f64::NAN; 36]).unwrap_err().to_string().contains("expected a covariance"));
        assert!(SeenPart::of(&[1, 2, 3]).unwrap_err().to_string().contains("part pose"));
        let error = |seen: Result<SeenPart>| seen.unwrap().start(&placed, 5.0).unwrap_err().to_string();
        assert!(error(of("camera", &there, wide)).contains("frame \"base\" of the tool, got \"camera\""));
        // Its z axis out of the board.
        let turned = there * Rigid::from_xyz_rpy([0.0; 3], [std::f64::consts::PI, 0.0, 0.0], "turn").unwrap();
        assert!(error(of("base", &turned, wide)).contains("a z axis as the sensor's"));
    }
}

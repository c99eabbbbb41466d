//! From the poses of a bag to the sensor's poses on the part.

use crate::pose::se2::Se2;
use crate::recording::ros::pose_track::FoundPose;
use crate::recording::ros::rigid::Rigid;

/// A sensor tilted by more than this does not touch a plate with its whole gel, degrees.
const MOST_TILT_DEG: f64 = 5.0;

/// The heights of touches of one plate differ by less than this, mm: a gel gives way by 1 to 2 mm.
const MOST_Z_SPAN_MM: f64 = 10.0;

/// Fixed offsets around the bag's pose.
#[derive(Clone, Copy, Debug, Default)]
pub struct Placer {
    /// Pose of the sensor in the frame whose pose the bag has.
    pub tool_from_sensor: Option<Se2>,
    /// Pose of the part in the frame in which the bag's poses are.
    pub board: Option<Se2>,
}

/// What is noticed of the touches' poses.
#[derive(Clone, Debug, Default)]
pub struct Placement {
    gaps_ns: Vec<i64>,
    n_tilted: usize,
    most_tilt_deg: f64,
    /// Lowest and highest, mm.
    z_mm: Option<[f64; 2]>,
    n_turned: usize,
}

impl Placement {
    /// The sensor's pose on the part, `part_from_sensor = board^-1 * pose * tool_from_sensor`, in its plane.
    pub fn note(&mut self, placer: &Placer, found: &FoundPose) -> Se2 {
        let part_from_frame = placer.board.map_or(Rigid::IDENTITY, |board| Rigid::from_plane(&board).inverse());
        let tool_from_sensor = placer.tool_from_sensor.map_or(Rigid::IDENTITY, |tool| Rigid::from_plane(&tool));
        let projected = (part_from_frame * found.pose * tool_from_sensor).project();
        self.gaps_ns.push(found.gap_ns);
        self.n_tilted += usize::from(projected.tilt_deg > MOST_TILT_DEG);
        self.most_tilt_deg = self.most_tilt_deg.max(projected.tilt_deg);
        self.n_turned += usize::from(projected.is_turned);
        let [low, high] = self.z_mm.unwrap_or([projected.z_mm; 2]);
        self.z_mm = Some([low.min(projected.z_mm), high.max(projected.z_mm)]);
        projected.pose
    }

    /// How far in time poses and frames are from each other; `None` without poses.
    pub fn note_on_time(&self) -> Option<String> {
        let mut gaps = self.gaps_ns.clone();
        gaps.sort_unstable();
        let [median, most] = [gaps.get(gaps.len() / 2)?, gaps.last()?].map(|ns| *ns as f64 * 1e-6);
        Some(format!("in time    a pose and its frame are {median:.1} ms apart in the median, {most:.1} ms at most"))
    }

    /// What a person should look at, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let n = self.gaps_ns.len();
        let mut warnings = Vec::new();
        if self.n_tilted > 0 {
            warnings.push(format!(
                "{} of {n} poses are tilted by more than {MOST_TILT_DEG} degrees from the part's plane, the worst by {:.1}",
                self.n_tilted, self.most_tilt_deg
            ));
        }
        if let Some([low, high]) = self.z_mm
            && high - low > MOST_Z_SPAN_MM
        {
            warnings.push(format!(
                "the touches are {low:.1} to {high:.1} mm high over the part's plane: are all of them touches of it?"
            ));
        }
        if self.n_turned > 0 {
            warnings.push(format!(
                "{} of {n} poses have their z axis against the part's: y and angles are counted the other way round, as \
                 the sensor sees them",
                self.n_turned
            ));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::ros::messages::Pose;

    fn found(position: [f64; 3], orientation: [f64; 4], gap_ns: i64) -> FoundPose {
        let pose = Rigid::from_pose(&Pose { position, orientation }, "here").unwrap();
        FoundPose { pose, frame_id: "a".into(), gap_ns }
    }

    #[test]
    fn the_offsets_compose_as_in_the_plane() {
        let [board, tool, pose] =
            [[100.0, -20.0, 30.0], [1.0, 2.0, -90.0], [104.0, -12.0, 75.0]].map(|[x, y, t]| Se2::from_degrees(x, y, t));
        let placer = Placer { tool_from_sensor: Some(tool), board: Some(board) };
        let (sin, cos) = (pose.theta_rad / 2.0).sin_cos();
        let found = found([0.104, -0.012, 0.0], [0.0, 0.0, sin, cos], 0);
        let got = Placement::default().note(&placer, &found);
        let expected = board.inverse() * pose * tool;
        assert!(got.distance_mm(&expected) < 1e-9 && (got.theta_rad - expected.theta_rad).abs() < 1e-9);
    }

    #[test]
    fn gaps_tilts_heights_and_turned_axes_are_said() {
        let mut placement = Placement::default();
        assert!(placement.note_on_time().is_none() && placement.warnings().is_empty());
        let (sin, cos) = (6.0_f64.to_radians() / 2.0).sin_cos();
        for (position, orientation, gap_ms) in [
            ([0.0, 0.0, 0.001], [0.0, 0.0, 0.0, 1.0], 1),
            ([0.0, 0.0, 0.02], [0.0, sin, 0.0, cos], 9),
            ([0.0; 3], [0.0, 1.0, 0.0, 0.0], 2),
        ] {
            placement.note(&Placer::default(), &found(position, orientation, gap_ms * 1_000_000));
        }
        assert!(placement.note_on_time().unwrap().contains("2.0 ms apart in the median, 9.0 ms at most"));
        let warnings = placement.warnings();
        assert!(warnings[0].contains("1 of 3 poses are tilted") && warnings[0].contains("by 6.0"), "{warnings:?}");
        assert!(warnings[1].contains("0.0 to 20.0 mm") && warnings[2].starts_with("1 of 3"), "{warnings:?}");
    }
}

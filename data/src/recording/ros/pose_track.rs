//! The sensor's pose over time, from a topic of poses or a chain of transforms.

use std::sync::Arc;

use crate::recording::ros::rigid::Rigid;
use crate::recording::ros::survey::TimedPose;
use crate::recording::ros::transform_tree::Chain;

/// Where poses come from.
#[derive(Clone, Debug)]
pub enum PoseTrack {
    /// Nowhere: poses are not known.
    None,
    /// Messages of one topic, in order of their times.
    Topic(Vec<TimedPose>),
    /// Transforms; the base's name.
    Chain(Chain, Arc<str>),
}

/// The pose found for a time.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundPose {
    /// Pose of the sensor (or the tool) in the frame.
    pub pose: Rigid,
    /// Name of the frame.
    pub frame_id: Arc<str>,
    /// How far in time the nearest message is, nanoseconds.
    pub gap_ns: i64,
}

impl PoseTrack {
    /// From the messages of one topic, in any order.
    pub fn of_topic(mut poses: Vec<TimedPose>) -> Self {
        poses.sort_by_key(|pose| pose.time_ns);
        Self::Topic(poses)
    }

    /// Times of the messages, nanoseconds, in order.
    pub fn times_ns(&self) -> Vec<i64> {
        match self {
            Self::None => Vec::new(),
            Self::Topic(poses) => poses.iter().map(|pose| pose.time_ns).collect(),
            Self::Chain(chain, _) => chain.times_ns(),
        }
    }

    /// The pose at a time: of a topic, between the messages around it, which must be of one frame and both within
    /// `max_gap_ns`; of transforms, the newest before, within `max_gap_ns`. `None` where there is no such pose.
    pub fn at(&self, time_ns: i64, max_gap_ns: i64) -> Option<FoundPose> {
        let found = match self {
            Self::None => None,
            Self::Topic(poses) => between(poses, time_ns, max_gap_ns),
            Self::Chain(chain, base) => chain.at(time_ns).map(|(pose, gap_ns)| {
                let frame_id = Arc::clone(base);
                FoundPose { pose, frame_id, gap_ns }
            }),
        };
        found.filter(|found| found.gap_ns <= max_gap_ns)
    }
}

fn between(poses: &[TimedPose], time_ns: i64, max_gap_ns: i64) -> Option<FoundPose> {
    let n_before = poses.partition_point(|pose| pose.time_ns <= time_ns);
    let before = poses.get(n_before.checked_sub(1)?)?;
    let found = |pose, gap_ns| FoundPose { pose, frame_id: Arc::clone(&before.frame_id), gap_ns };
    let since = time_ns.checked_sub(before.time_ns)?;
    if since == 0 {
        return Some(found(before.pose, 0));
    }
    let after = poses.get(n_before).filter(|after| after.frame_id == before.frame_id)?;
    let until = after.time_ns.checked_sub(time_ns)?;
    if since > max_gap_ns || until > max_gap_ns {
        return None;
    }
    let pose = before.pose.towards(&after.pose, since as f64 / (since as f64 + until as f64));
    Some(found(pose, since.min(until)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::se2::Se2;

    fn track(poses: &[(i64, f64, &str)]) -> PoseTrack {
        let pose = |(time_ns, x_mm, frame): &(i64, f64, &str)| TimedPose {
            time_ns: *time_ns,
            pose: Rigid::from_plane(&Se2::new(*x_mm, 0.0, 0.0)),
            frame_id: (*frame).into(),
        };
        PoseTrack::of_topic(poses.iter().map(pose).collect())
    }

    #[test]
    fn a_pose_lies_between_its_neighbours_where_both_are_near_and_of_one_frame() {
        let track = track(&[(100, 1.0, "a"), (0, 0.0, "a"), (400, 4.0, "a"), (420, 9.0, "b")]);
        let x_mm = |time_ns| track.at(time_ns, 100).map(|found| (found.pose.project().pose.x_mm, found.gap_ns));
        for (time_ns, expected) in [
            (0, Some((0.0, 0))),
            (25, Some((0.25, 25))),
            (99, Some((0.99, 1))),
            (400, Some((4.0, 0))),
            (420, Some((9.0, 0))),
            // Before the first, behind the last, in a gap, between two frames.
            (-1, None),
            (421, None),
            (250, None),
            (410, None),
        ] {
            match (x_mm(time_ns), expected) {
                (Some((x, gap)), Some((expected, expected_gap))) => {
                    assert!((x - expected).abs() < 1e-9 && gap == expected_gap, "{time_ns}: {x}, {gap}");
                }
                (found, expected) => assert_eq!(found, expected, "{time_ns}"),
            }
        }
        assert!(PoseTrack::None.at(0, i64::MAX).is_none());
    }
}

//! Which frames of a film are touches, and where the sensor was.

use crate::error::Result;
use crate::recording::contact::{FrameContact, contact_runs};
use crate::recording::ros::pose_track::{FoundPose, PoseTrack};

/// The first frames of a contact, in which the gel still gives way and the camera's exposure still follows.
const N_UNSETTLED: usize = 3;

/// Poses are of touches, not of a film, where there are this many times as many frames.
const FRAMES_PER_POSE: usize = 3;

/// Which frames of a film are touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touches {
    /// Every frame.
    Each,
    /// One for each run of frames that show contact: the frame with most edges, not one of the first three.
    Contact,
    /// One for each pose: the frame nearest in time.
    Poses,
}

impl Touches {
    /// All of them with their names.
    pub const NAMES: [(&str, Self); 3] = [("each", Self::Each), ("contact", Self::Contact), ("poses", Self::Poses)];

    /// Its name: `each`, `contact`, `poses`.
    pub fn name(self) -> &'static str {
        Self::NAMES.into_iter().find(|(_, touches)| *touches == self).map_or("", |(name, _)| name)
    }
}

/// A frame that is a touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Pick {
    /// Number of the frame in the film.
    pub frame: usize,
    /// Where the sensor was, where poses are known.
    pub pose: Option<FoundPose>,
}

/// The frames that are touches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picked {
    /// In order of the film.
    pub picks: Vec<Pick>,
    /// Touches left out: no pose, or no frame, was near enough in time.
    pub n_left_out: usize,
}

/// Whether there are so few poses that each is a touch.
pub fn poses_are_touches(n_poses: usize, n_frames: usize) -> bool {
    n_poses > 0 && FRAMES_PER_POSE * n_poses <= n_frames
}

/// One frame for each run of contact, the one with the largest share of edges; never one of the first three of a
/// longer run.
pub fn settled(frames: &[Result<FrameContact>]) -> Vec<usize> {
    let share = |frame: &usize| frames[*frame].as_ref().map_or(0.0, |frame| frame.edge_share);
    let best = |run: std::ops::RangeInclusive<usize>| {
        let skipped = if run.clone().count() > N_UNSETTLED { N_UNSETTLED } else { 0 };
        // The first of equals.
        run.skip(skipped).reduce(|best, frame| if share(&frame) > share(&best) { frame } else { best })
    };
    contact_runs(frames).into_iter().filter_map(best).collect()
}

/// The frames with the poses at their times (nanoseconds). Where poses are known at all, a frame without one is left
/// out.
pub fn with_poses(frames: impl Iterator<Item = usize>, times_ns: &[i64], track: &PoseTrack, max_gap_ns: i64) -> Picked {
    let mut picked = Picked::default();
    for frame in frames {
        match (track, track.at(times_ns[frame], max_gap_ns)) {
            (PoseTrack::None, _) => picked.picks.push(Pick { frame, pose: None }),
            (_, Some(pose)) => picked.picks.push(Pick { frame, pose: Some(pose) }),
            (_, None) => picked.n_left_out += 1,
        }
    }
    picked
}

/// For each pose the frame nearest in time (nanoseconds).
pub fn nearest_to_poses(times_ns: &[i64], track: &PoseTrack, max_gap_ns: i64) -> Picked {
    let mut by_time: Vec<(i64, usize)> = times_ns.iter().copied().zip(0..).collect();
    by_time.sort_unstable();
    let mut picked = Picked::default();
    for time_ns in track.times_ns() {
        let n_before = by_time.partition_point(|(time, _)| *time < time_ns);
        let around = [n_before.checked_sub(1), Some(n_before)].into_iter().flatten();
        let near = around.filter_map(|at| by_time.get(at)).map(|(time, frame)| (time.abs_diff(time_ns), *frame));
        let near = near.min().filter(|(gap, _)| *gap <= max_gap_ns.unsigned_abs());
        match (near, track.at(time_ns, max_gap_ns)) {
            (Some((gap, frame)), Some(pose)) => {
                let gap_ns = pose.gap_ns.max(i64::try_from(gap).unwrap_or(i64::MAX));
                picked.picks.push(Pick { frame, pose: Some(FoundPose { gap_ns, ..pose }) });
            }
            _ => picked.n_left_out += 1,
        }
    }
    picked.picks.sort_by_key(|pick| pick.frame);
    picked
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::ros::rigid::Rigid;
    use crate::recording::ros::survey::TimedPose;

    fn contact(shares: &[f32]) -> Vec<Result<FrameContact>> {
        shares.iter().map(|share| Ok(FrameContact { edge_share: *share, difference_rms: 0.0 })).collect()
    }

    fn track(times_ns: &[i64]) -> PoseTrack {
        let pose = |time_ns: &i64| TimedPose { time_ns: *time_ns, pose: Rigid::IDENTITY, frame_id: "a".into() };
        PoseTrack::of_topic(times_ns.iter().map(pose).collect())
    }

    fn frames(picked: &Picked) -> Vec<usize> {
        picked.picks.iter().map(|pick| pick.frame).collect()
    }

    #[test]
    fn the_settled_frame_of_a_run_is_taken_and_not_its_first_three() {
        let shares = [0.0, 0.9, 0.8, 0.7, 0.3, 0.5, 0.5, 0.4, 0.0, 0.2, 0.6, 0.1, 0.0, 0.3];
        assert_eq!(settled(&contact(&shares)), [5, 10, 13]);
        assert!(settled(&contact(&[0.0, 0.0])).is_empty());
    }

    #[test]
    fn each_pose_takes_the_frame_nearest_in_time() {
        // Frames out of order, as two threads of a driver may send them.
        let times = [0, 40, 120, 80, 160];
        let picked = nearest_to_poses(&times, &track(&[-5, 61, 79, 300, 100]), 30);
        assert_eq!((frames(&picked), picked.n_left_out), (vec![0, 2, 3, 3], 1));
        let gaps: Vec<i64> = picked.picks.iter().map(|pick| pick.pose.as_ref().unwrap().gap_ns).collect();
        assert_eq!(gaps, [5, 20, 19, 1]);
        assert!(poses_are_touches(2, 6) && !poses_are_touches(2, 5) && !poses_are_touches(0, 9));
    }

    #[test]
    fn frames_without_a_pose_are_left_out_and_counted_where_there_are_poses() {
        let times = [0, 40, 80, 120];
        let picked = with_poses([0, 2, 3].into_iter(), &times, &track(&[30, 90]), 60);
        assert_eq!((frames(&picked), picked.n_left_out), (vec![2], 2));
        let picked = with_poses(0..4, &times, &PoseTrack::None, 60);
        assert_eq!((frames(&picked), picked.n_left_out), (vec![0, 1, 2, 3], 0));
    }
}

//! Where the robot's tool is, and since when it is still.

use tactile_data::recording::ros::messages::{PoseStamped, from_cdr};
use tactile_data::recording::ros::rigid::Rigid;

use crate::error::{Error, Result};
use crate::parameters::ToolParameters;

/// A pose is stale where none came for this many times the usual interval.
const STALE_INTERVALS: f64 = 20.0;

/// No pose is stale before this, nanoseconds.
const LEAST_STALE_NS: f64 = 1e9;

/// The share of the latest interval in the usual one.
const INTERVAL_SHARE: f64 = 0.1;

/// The tool as its poses say.
#[derive(Clone, Debug)]
pub struct Tool {
    parameters: ToolParameters,
    tool_from_sensor: Rigid,
    latest: Option<Latest>,
    /// Why the latest message was no pose, where it was none.
    refused: Option<String>,
    /// The base frame of the touches so far, which other poses must be in.
    base: Option<String>,
    /// A motion was asked for, and no pose came since.
    is_asked: bool,
    n_poses: u64,
    n_malformed: u64,
}

#[derive(Clone, Debug)]
struct Latest {
    time_ns: i64,
    frame_id: String,
    base_from_tool: Rigid,
    /// Where it is still, to the tolerance, and since when.
    anchor: Rigid,
    still_since_ns: i64,
    interval_ns: Option<f64>,
}

/// The sensor, standing still.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The robot's base frame, as its messages name it.
    pub frame_id: String,
    /// The sensor's pose in it.
    pub base_from_sensor: Rigid,
    /// Since when, nanoseconds.
    pub still_since_ns: i64,
}

impl Tool {
    /// Nothing is known yet.
    ///
    /// # Errors
    /// A pose of the sensor in the tool's frame that is none.
    pub fn new(parameters: &ToolParameters) -> Result<Self> {
        let tool_from_sensor = parameters.tool_from_sensor()?;
        Ok(Self {
            parameters: parameters.clone(),
            tool_from_sensor,
            latest: None,
            refused: None,
            base: None,
            is_asked: false,
            n_poses: 0,
            n_malformed: 0,
        })
    }

    /// Takes in a pose.
    ///
    /// # Errors
    /// Bytes that are no pose, or one in another frame than the touches so far. Where the tool is now is not known then:
    /// the pose before is forgotten.
    pub fn moved(&mut self, time_ns: i64, cdr: &[u8]) -> Result<()> {
        let taken = self.take(time_ns, cdr);
        match &taken {
            Ok(()) => {
                self.n_poses += 1;
                (self.refused, self.is_asked) = (None, false);
            }
            Err(error) => {
                self.n_malformed += 1;
                (self.latest, self.refused) = (None, Some(error.to_string()));
            }
        }
        taken
    }

    /// A touch was taken in with poses in this frame; `is_asked`: another motion was asked for. Until a pose comes the tool
    /// is nowhere then.
    pub fn touched(&mut self, frame_id: &str, is_asked: bool) {
        (self.base, self.is_asked) = (Some(frame_id.to_owned()), is_asked);
    }

    /// The next touch is the first of another hole, whose poses may be in another frame.
    pub fn reset(&mut self) {
        self.base = None;
    }

    fn take(&mut self, time_ns: i64, cdr: &[u8]) -> Result<()> {
        let message: PoseStamped = from_cdr(cdr, "tool pose")?;
        let base_from_tool = Rigid::from_pose(&message.pose, "tool pose")?;
        let got = &message.header.frame_id;
        if let Some(base) = self.base.as_ref().filter(|base| *base != got) {
            return Err(Error::invalid(
                "tool pose",
                format!("frame {base:?} of the touches before"),
                format!("{got:?}"),
            ));
        }
        let before = self.latest.take();
        let interval_ns = before.as_ref().map(|before| {
            let interval = (time_ns - before.time_ns) as f64;
            before.interval_ns.map_or(interval, |usual| usual + INTERVAL_SHARE * (interval - usual))
        });
        let still = before.filter(|before| self.is_still(&before.anchor, &base_from_tool));
        let (anchor, still_since_ns) =
            still.map_or((base_from_tool, time_ns), |before| (before.anchor, before.still_since_ns));
        let frame_id = message.header.frame_id;
        self.latest = Some(Latest { time_ns, frame_id, base_from_tool, anchor, still_since_ns, interval_ns });
        Ok(())
    }

    fn is_still(&self, anchor: &Rigid, now: &Rigid) -> bool {
        let moved = anchor.inverse() * *now;
        moved.length_mm() <= self.parameters.still_mm && moved.angle_deg() <= self.parameters.still_deg
    }

    /// The sensor's pose where it is still.
    ///
    /// # Errors
    /// No pose, one that was refused, none since a motion was asked for, or a stale one.
    pub fn placed(&self, now_ns: i64) -> Result<Placed> {
        let Some(latest) = &self.latest else {
            let Some(reason) = &self.refused else {
                return Err(Error::invalid("tool pose", "at least one message", "none"));
            };
            let expected = "a new one after one that was refused";
            return Err(Error::invalid("tool pose", expected, format!("none ({reason})")));
        };
        if self.is_asked {
            return Err(Error::invalid("tool pose", "a new one after the motion that was asked for", "none"));
        }
        let age_ns = (now_ns - latest.time_ns) as f64;
        let most_ns = latest.interval_ns.map_or(f64::INFINITY, |ns| (STALE_INTERVALS * ns).max(LEAST_STALE_NS));
        let most_ns = self.parameters.max_age_s.map_or(most_ns, |s| s * 1e9);
        if age_ns > most_ns {
            let expected = format!("one at most {:.1} s old", most_ns * 1e-9);
            return Err(Error::invalid("tool pose", expected, format!("one {:.1} s old", age_ns * 1e-9)));
        }
        Ok(Placed {
            frame_id: latest.frame_id.clone(),
            base_from_sensor: latest.base_from_tool * self.tool_from_sensor,
            still_since_ns: latest.still_since_ns,
        })
    }

    /// The tool's pose for a pose of the sensor, both in the base frame.
    pub fn base_from_tool(&self, base_from_sensor: &Rigid) -> Rigid {
        *base_from_sensor * self.tool_from_sensor.inverse()
    }

    /// Poses taken in, and messages that were none.
    pub fn counts(&self) -> [u64; 2] {
        [self.n_poses, self.n_malformed]
    }

    /// Seconds since the latest pose.
    pub fn age_s(&self, now_ns: i64) -> Option<f64> {
        self.latest.as_ref().map(|latest| (now_ns - latest.time_ns) as f64 * 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::pose::se2::Se2;
    use tactile_data::recording::ros::messages::{Header, Pose, to_cdr};

    fn pose(x_mm: f64) -> Vec<u8> {
        let pose = Rigid::from_plane(&Se2::new(x_mm, 0.0, 0.0)).to_pose();
        to_cdr(&PoseStamped { header: Header::default(), pose })
    }

    #[test]
    fn it_stands_still_since_it_came_there_and_creeping_is_no_standing() {
        let mut tool = Tool::new(&ToolParameters::default()).unwrap();
        assert!(tool.placed(0).unwrap_err().to_string().contains("got none"));
        for (time, x_mm, since) in [(0, 0.0, 0), (1, 5.0, 1), (2, 5.04, 1), (3, 4.97, 1), (4, 5.06, 4), (5, 5.1, 4)] {
            tool.moved(time, &pose(x_mm)).unwrap();
            assert_eq!(tool.placed(time).unwrap().still_since_ns, since, "{time}");
        }
        assert_eq!(tool.counts(), [6, 0]);
    }

    #[test]
    fn after_a_pose_that_was_refused_the_tool_is_nowhere() {
        let said = |tool: &Tool| tool.placed(2).unwrap_err().to_string();
        let header = || Header { frame_id: "base".into(), ..Header::default() };
        let at = |x_m: f64, header: Header| {
            let pose = Pose { position: [x_m, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };
            to_cdr(&PoseStamped { header, pose })
        };
        let flat = PoseStamped { header: header(), pose: Pose { position: [0.0; 3], orientation: [0.0; 4] } };
        let other = Header { frame_id: "tool0".into(), ..Header::default() };
        let refused = [
            (at(f64::NAN, header()), "a position within 10 m"),
            (at(4.0e3, header()), "a position within 10 m"),
            (to_cdr(&flat), "a quaternion of length 1"),
            (at(0.0, header())[..30].to_vec(), "bytes of"),
            (at(0.0, other.clone()), "frame \"base\" of the touches before, got \"tool0\""),
        ];
        for (pose, reason) in refused {
            let mut tool = Tool::new(&ToolParameters::default()).unwrap();
            tool.moved(0, &at(0.1, header())).unwrap();
            tool.touched("base", false);
            assert!(tool.placed(1).is_ok());
            assert!(tool.moved(1, &pose).is_err());
            assert!(
                said(&tool).contains("after one that was refused") && said(&tool).contains(reason),
                "{}",
                said(&tool)
            );
            tool.moved(2, &at(0.1, header())).unwrap();
            assert!(tool.placed(2).is_ok());
            // Another hole may be in another frame.
            tool.reset();
            assert!(tool.moved(2, &at(0.0, other.clone())).is_ok());
        }
    }

    #[test]
    fn a_motion_that_was_asked_for_needs_a_pose_and_a_touch_without_one_does_not() {
        let mut tool = Tool::new(&ToolParameters::default()).unwrap();
        tool.moved(0, &pose(0.0)).unwrap();
        tool.touched("", false);
        assert!(tool.placed(1).is_ok());
        tool.touched("", true);
        let said = tool.placed(1).unwrap_err().to_string();
        assert_eq!(said, "tool pose: expected a new one after the motion that was asked for, got none");
        tool.moved(2, &pose(0.0)).unwrap();
        assert!(tool.placed(2).is_ok());
    }

    #[test]
    fn a_stream_that_ends_goes_stale_and_a_pose_for_each_touch_does_not() {
        let second = 1_000_000_000;
        let mut stream = Tool::new(&ToolParameters::default()).unwrap();
        (0..100).for_each(|i| stream.moved(i * second / 50, &pose(0.0)).unwrap());
        assert!(stream.placed(2 * second).is_ok());
        assert!(stream.placed(4 * second).unwrap_err().to_string().contains("at most 1.0 s old"));
        let mut rare = Tool::new(&ToolParameters::default()).unwrap();
        (0..4).for_each(|i| rare.moved(i * 5 * second, &pose(0.0)).unwrap());
        assert!(rare.placed(60 * second).is_ok());
    }

    #[test]
    fn the_sensor_is_where_it_is_mounted() {
        let parameters =
            ToolParameters { sensor_xyz_m: [0.1, 0.0, 0.0], sensor_rpy_rad: [0.0, 0.0, 0.5], ..Default::default() };
        let mut tool = Tool::new(&parameters).unwrap();
        tool.moved(0, &pose(7.0)).unwrap();
        let placed = tool.placed(0).unwrap().base_from_sensor;
        let seen = placed.project().pose;
        assert!((seen.x_mm - 107.0).abs() < 1e-9 && (seen.theta_rad - 0.5).abs() < 1e-12, "{seen:?}");
        let back: Pose = tool.base_from_tool(&placed).to_pose();
        assert!((back.position[0] - 0.007).abs() < 1e-12 && back.orientation[2].abs() < 1e-12);
        let malformed = tool.moved(1, &pose(0.0)[..20]).unwrap_err().to_string();
        assert!(malformed.starts_with("tool pose: expected"), "{malformed}");
        assert_eq!(tool.counts(), [1, 1]);
    }
}

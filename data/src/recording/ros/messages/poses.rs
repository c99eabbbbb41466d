//! Poses, and transforms between frames.

use crate::error::Result;
use crate::recording::ros::cdr::{Reader, Writer};
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{Header, Message};

/// A place and a rotation in space: `geometry_msgs/msg/Pose` and `Transform`, which have one layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// x, y and z, metres.
    pub position: [f64; 3],
    /// x, y, z and w of a unit quaternion.
    pub orientation: [f64; 4],
}

impl Pose {
    /// Seven numbers.
    const BYTES: usize = 56;

    pub(super) fn read(cdr: &mut Reader) -> Result<Self> {
        let mut pose = Self { position: [0.0; 3], orientation: [0.0; 4] };
        for value in pose.position.iter_mut().chain(&mut pose.orientation) {
            *value = cdr.f64("a pose")?;
        }
        Ok(pose)
    }

    pub(super) fn write(&self, cdr: &mut Writer) {
        self.position.iter().chain(&self.orientation).for_each(|value| cdr.f64(*value));
    }
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseStamped {
    /// When, and the frame in which the pose is given.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

impl Message for PoseStamped {
    const TYPE: &str = "geometry_msgs/msg/PoseStamped";
    const DEFINITION: &str = definitions::POSE_STAMPED;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self { header: Header::read(cdr)?, pose: Pose::read(cdr)? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        self.pose.write(cdr);
    }
}

/// `geometry_msgs/msg/TransformStamped`: the pose of the child's frame in the header's.
#[derive(Clone, Debug, PartialEq)]
pub struct TransformStamped {
    /// When, and the parent's frame.
    pub header: Header,
    /// The frame whose pose it is.
    pub child_frame_id: String,
    /// The pose.
    pub transform: Pose,
}

impl TransformStamped {
    /// What one takes at least: a stamp, two empty names and seven numbers.
    const LEAST_BYTES: usize = 8 + 4 + 4 + Pose::BYTES;
}

impl Message for TransformStamped {
    const TYPE: &str = "geometry_msgs/msg/TransformStamped";
    const DEFINITION: &str = definitions::TRANSFORM_STAMPED;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let header = Header::read(cdr)?;
        Ok(Self { header, child_frame_id: cdr.string("child_frame_id")?, transform: Pose::read(cdr)? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.string(&self.child_frame_id);
        self.transform.write(cdr);
    }
}

/// `tf2_msgs/msg/TFMessage`: what `/tf` and `/tf_static` carry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TFMessage {
    /// Any number of transforms.
    pub transforms: Vec<TransformStamped>,
}

impl Message for TFMessage {
    const TYPE: &str = "tf2_msgs/msg/TFMessage";
    const DEFINITION: &str = definitions::TF_MESSAGE;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let count = cdr.count(TransformStamped::LEAST_BYTES, "transforms")?;
        Ok(Self { transforms: (0..count).map(|_| TransformStamped::read(cdr)).collect::<Result<_>>()? })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.u32(self.transforms.len() as u32);
        self.transforms.iter().for_each(|transform| transform.write(cdr));
    }
}

/// `geometry_msgs/msg/PoseArray`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseArray {
    /// When, and the frame in which the poses are given.
    pub header: Header,
    /// Any number of poses.
    pub poses: Vec<Pose>,
}

impl Message for PoseArray {
    const TYPE: &str = "geometry_msgs/msg/PoseArray";
    const DEFINITION: &str = definitions::POSE_ARRAY;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let header = Header::read(cdr)?;
        let count = cdr.count(Pose::BYTES, "poses")?;
        Ok(Self { header, poses: (0..count).map(|_| Pose::read(cdr)).collect::<Result<_>>()? })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.u32(self.poses.len() as u32);
        self.poses.iter().for_each(|pose| pose.write(cdr));
    }
}

/// `geometry_msgs/msg/PoseWithCovarianceStamped`.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseWithCovarianceStamped {
    /// When, and the frame in which the pose is given.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
    /// Row by row, of x, y, z (metres) and the rotations about x, y and z (radians).
    pub covariance: [f64; 36],
}

impl Message for PoseWithCovarianceStamped {
    const TYPE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
    const DEFINITION: &str = definitions::POSE_WITH_COVARIANCE_STAMPED;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let mut message = Self { header: Header::read(cdr)?, pose: Pose::read(cdr)?, covariance: [0.0; 36] };
        for value in &mut message.covariance {
            *value = cdr.f64("covariance")?;
        }
        Ok(message)
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        self.pose.write(cdr);
        self.covariance.iter().for_each(|value| cdr.f64(*value));
    }
}

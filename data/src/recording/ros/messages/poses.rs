//! Poses, and transforms between frames.

use crate::error::Result;
use crate::recording::ros::cdr::{Field, Reader, Writer, fields};
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

fields! { Pose { position, orientation } }

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseStamped {
    /// When, and the frame in which the pose is given.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

fields! { PoseStamped { header, pose } in "geometry_msgs/msg/PoseStamped", POSE_STAMPED }

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

fields! { TransformStamped { header, child_frame_id, transform } in "geometry_msgs/msg/TransformStamped", TRANSFORM_STAMPED }

/// `tf2_msgs/msg/TFMessage`: what `/tf` and `/tf_static` carry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TFMessage {
    /// Any number of transforms.
    pub transforms: Vec<TransformStamped>,
}

fields! { TFMessage { transforms } in "tf2_msgs/msg/TFMessage", TF_MESSAGE }

/// `geometry_msgs/msg/PoseArray`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseArray {
    /// When, and the frame in which the poses are given.
    pub header: Header,
    /// Any number of poses.
    pub poses: Vec<Pose>,
}

fields! { PoseArray { header, poses } in "geometry_msgs/msg/PoseArray", POSE_ARRAY }

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

fields! { PoseWithCovarianceStamped { header, pose, covariance } in "geometry_msgs/msg/PoseWithCovarianceStamped", POSE_WITH_COVARIANCE_STAMPED }

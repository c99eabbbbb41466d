//! The definitions of messages, as ROS 2 has them (common_interfaces) and MCAP carries them (`ros2msg`): the message,
//! then each type in it behind a line of 80 equals signs.

/// A line between two types.
macro_rules! next {
    ($name:literal) => {
        concat!(
            "================================================================================\n",
            "MSG: ",
            $name,
            "\n"
        )
    };
}

macro_rules! header {
    () => {
        concat!(
            next!("std_msgs/Header"),
            "builtin_interfaces/Time stamp\nstring frame_id\n",
            next!("builtin_interfaces/Time"),
            "int32 sec\nuint32 nanosec\n",
        )
    };
}

/// `sensor_msgs/msg/Image`.
pub const IMAGE: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n",
    "uint8[] data\n",
    header!(),
);

/// `sensor_msgs/msg/CompressedImage`.
pub const COMPRESSED_IMAGE: &str = concat!("std_msgs/Header header\nstring format\nuint8[] data\n", header!());

/// `geometry_msgs/msg/PoseStamped`.
pub const POSE_STAMPED: &str = concat!(
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    header!(),
    next!("geometry_msgs/Pose"),
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    next!("geometry_msgs/Point"),
    "float64 x\nfloat64 y\nfloat64 z\n",
    next!("geometry_msgs/Quaternion"),
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
);

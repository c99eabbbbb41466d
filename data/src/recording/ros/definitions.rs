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

macro_rules! pose {
    () => {
        concat!(
            next!("geometry_msgs/Pose"),
            "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
            next!("geometry_msgs/Point"),
            "float64 x\nfloat64 y\nfloat64 z\n",
            quaternion!(),
        )
    };
}

macro_rules! quaternion {
    () => {
        concat!(next!("geometry_msgs/Quaternion"), "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")
    };
}

macro_rules! transform {
    () => {
        concat!(
            next!("geometry_msgs/Transform"),
            "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
            next!("geometry_msgs/Vector3"),
            "float64 x\nfloat64 y\nfloat64 z\n",
            quaternion!(),
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
pub const POSE_STAMPED: &str = concat!("std_msgs/Header header\ngeometry_msgs/Pose pose\n", header!(), pose!());

/// `geometry_msgs/msg/PoseArray`.
pub const POSE_ARRAY: &str = concat!("std_msgs/Header header\ngeometry_msgs/Pose[] poses\n", header!(), pose!());

/// `geometry_msgs/msg/PoseWithCovarianceStamped`.
pub const POSE_WITH_COVARIANCE_STAMPED: &str = concat!(
    "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    header!(),
    next!("geometry_msgs/PoseWithCovariance"),
    "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    pose!(),
);

/// `geometry_msgs/msg/TransformStamped`.
pub const TRANSFORM_STAMPED: &str = concat!(
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    header!(),
    transform!(),
);

/// `tf2_msgs/msg/TFMessage`.
pub const TF_MESSAGE: &str = concat!(
    "geometry_msgs/TransformStamped[] transforms\n",
    next!("geometry_msgs/TransformStamped"),
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    header!(),
    transform!(),
);

/// `nav_msgs/msg/OccupancyGrid`.
pub const OCCUPANCY_GRID: &str = concat!(
    "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n",
    header!(),
    next!("nav_msgs/MapMetaData"),
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n",
    "geometry_msgs/Pose origin\n",
    pose!(),
);

/// `sensor_msgs/msg/PointCloud2`.
pub const POINT_CLOUD2: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n",
    "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
    header!(),
    next!("sensor_msgs/PointField"),
    "string name\nuint32 offset\nuint8 datatype\nuint32 count\n",
);

/// `std_msgs/msg/String`.
pub const TEXT: &str = "string data\n";

/// `diagnostic_msgs/msg/DiagnosticArray`.
pub const DIAGNOSTIC_ARRAY: &str = concat!(
    "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    header!(),
    next!("diagnostic_msgs/DiagnosticStatus"),
    "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
    next!("diagnostic_msgs/KeyValue"),
    "string key\nstring value\n",
);

/// What `std_srvs/srv/Trigger` is asked.
pub const TRIGGER_REQUEST: &str = "uint8 structure_needs_at_least_one_member\n";

/// What `std_srvs/srv/Trigger` answers.
pub const TRIGGER_RESPONSE: &str = "bool success\nstring message\n";

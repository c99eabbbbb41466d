//! What comes in, and what goes out: bytes of ROS 2 messages, so that the network, the log and a viewer get the same.

use tactile_data::recording::ros::messages::{
    CompressedImage, DiagnosticArray, Image, Message, OccupancyGrid, PointCloud2, PoseArray, PoseStamped,
    PoseWithCovarianceStamped, TFMessage, Text, TransformStamped,
};

/// Something that happened, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Nanoseconds on the node's clock, which starts at the wall clock's time and never goes back.
    pub time_ns: i64,
    /// What happened.
    pub input: Input,
}

/// What happened. Messages are their bytes in CDR, as they came: what is wrong with them is for the node to say.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// A message came.
    Given(Given, Vec<u8>),
    /// A service was called.
    Called {
        /// Which one.
        request: Request,
        /// By which the answer is known; 0 asks for none.
        id: u64,
    },
    /// How many publishers of pictures there are now.
    Cameras(u32),
    /// Time went by.
    Tick,
}

/// The messages that the node is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Given {
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    CompressedImage,
    /// `geometry_msgs/msg/PoseStamped`: the tool in the robot's base frame.
    ToolPose,
    /// `geometry_msgs/msg/PoseWithCovarianceStamped`: the part of the next hole in the robot's base frame, as it was seen before it is
    /// touched.
    PartPose,
}

impl Given {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Image, Self::CompressedImage, Self::ToolPose, Self::PartPose];

    /// Its name below the node's.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "~/image",
            // As image_transport names it.
            Self::CompressedImage => "~/image/compressed",
            Self::ToolPose => "~/tool_pose",
            Self::PartPose => "~/part_pose",
        }
    }

    /// The type of its messages and their definition.
    pub fn message(self) -> [&'static str; 2] {
        match self {
            Self::Image => of::<Image>(),
            Self::CompressedImage => of::<CompressedImage>(),
            Self::ToolPose => of::<PoseStamped>(),
            Self::PartPose => of::<PoseWithCovarianceStamped>(),
        }
    }

    /// Whether it is a picture.
    pub fn is_picture(self) -> bool {
        matches!(self, Self::Image | Self::CompressedImage)
    }
}

/// The type of a message and its definition.
fn of<M: Message>() -> [&'static str; 2] {
    [M::TYPE, M::DEFINITION]
}

/// The services, each a `std_srvs/srv/Trigger`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// `~/observe`: the contact has settled, take the newest picture.
    Observe,
    /// `~/reset`: the next touch is the first one of another hole.
    Reset,
    /// `~/calibrate_no_contact`: the sensor touches nothing, take pictures of it at rest.
    Calibrate,
}

impl Request {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Observe, Self::Reset, Self::Calibrate];

    /// Its name below the node's.
    pub fn name(self) -> &'static str {
        match self {
            Self::Observe => "~/observe",
            Self::Reset => "~/reset",
            Self::Calibrate => "~/calibrate_no_contact",
        }
    }
}

/// What the node says.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// A message.
    Publish {
        /// Where.
        topic: Topic,
        /// Its bytes in CDR.
        cdr: Vec<u8>,
    },
    /// The answer to a service.
    Answer {
        /// [`Input::Called`]'s.
        id: u64,
        /// Whether it was done.
        success: bool,
        /// What was done, or why not.
        message: String,
    },
}

/// What the node publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// The likeliest part's pose in the robot's base frame (`PoseWithCovarianceStamped`).
    Pose,
    /// The same pose as a frame, so that a viewer can draw what is in the part's frame (`TFMessage`).
    Frame,
    /// Poses of the part in the robot's base frame, the likeliest first (`PoseArray`).
    Particles,
    /// The same as points with their weights and parts (`PointCloud2`).
    ParticleCloud,
    /// Where on the likeliest part the sensor is (`OccupancyGrid`).
    Belief,
    /// What the touches so far show of what they were made on, where the model draws maps: the probability that a place is inside it, in
    /// the part's frame (`OccupancyGrid`).
    Felt,
    /// The part's name (`std_msgs/String`).
    Label,
    /// The next motion in the sensor's frame (`TransformStamped`).
    NextAction,
    /// The tool's pose after that motion, in the robot's base frame (`PoseStamped`).
    NextPose,
    /// Everything of a touch in JSON (`std_msgs/String`): [`crate::DecisionReport`].
    Decision,
    /// The state of camera, tool and episode, once a second and at changes (`DiagnosticArray`).
    Diagnostics,
    /// What a person should know, a line each (`std_msgs/String`).
    Events,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Pose,
        Self::Frame,
        Self::Particles,
        Self::ParticleCloud,
        Self::Belief,
        Self::Felt,
        Self::Label,
        Self::NextAction,
        Self::NextPose,
        Self::Decision,
        Self::Diagnostics,
        Self::Events,
    ];

    /// Its name: below the node's, or the one that ROS 2 gives it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pose => "~/pose",
            Self::Frame => "/tf_static",
            Self::Particles => "~/particles",
            Self::ParticleCloud => "~/particle_cloud",
            Self::Belief => "~/belief",
            Self::Felt => "~/felt",
            Self::Label => "~/label",
            Self::NextAction => "~/next_action",
            Self::NextPose => "~/next_pose",
            Self::Decision => "~/decision",
            Self::Diagnostics => "~/diagnostics",
            Self::Events => "~/events",
        }
    }

    /// The type of its messages and their definition.
    pub fn message(self) -> [&'static str; 2] {
        match self {
            Self::Pose => of::<PoseWithCovarianceStamped>(),
            Self::Frame => of::<TFMessage>(),
            Self::Particles => of::<PoseArray>(),
            Self::ParticleCloud => of::<PointCloud2>(),
            Self::Belief | Self::Felt => of::<OccupancyGrid>(),
            Self::Label | Self::Decision | Self::Events => of::<Text>(),
            Self::NextAction => of::<TransformStamped>(),
            Self::NextPose => of::<PoseStamped>(),
            Self::Diagnostics => of::<DiagnosticArray>(),
        }
    }

    /// Whether who comes late gets the latest message.
    pub fn is_latched(self) -> bool {
        !matches!(self, Self::Diagnostics | Self::Events)
    }
}

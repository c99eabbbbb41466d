//! What a bag holds: its topics, when its pictures were taken, and its poses.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::error::Result;
use crate::recording::ros::bag::{Bag, Message};
use crate::recording::ros::messages::{
    CompressedImage, Header, Image, Message as _, Pose, PoseStamped, TFMessage, TransformStamped,
};
use crate::recording::ros::rigid::Rigid;
use crate::recording::ros::transform_tree::TransformTree;

/// Where transforms are sent that hold for all time.
const STATIC_TRANSFORMS: &str = "tf_static";

/// A pose at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedPose {
    /// Nanoseconds on the recording's clock.
    pub time_ns: i64,
    /// Pose of the sensor (or the tool) in the frame.
    pub pose: Rigid,
    /// Name of the frame.
    pub frame_id: Arc<str>,
}

/// A topic of any type.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topic {
    /// Type of its messages.
    pub type_name: String,
    /// Number of messages.
    pub n_messages: usize,
    /// Messages whose header has no time.
    pub n_without_time: usize,
}

/// What a bag holds. Pictures are counted, not kept.
#[derive(Debug, Default)]
pub struct Survey {
    /// All topics by name.
    pub topics: BTreeMap<String, Topic>,
    /// When each picture of a topic was taken, nanoseconds, in order of the messages.
    pub pictures: BTreeMap<String, Vec<i64>>,
    /// The poses of each topic of poses.
    pub poses: BTreeMap<String, Vec<TimedPose>>,
    /// The transforms between frames.
    pub transforms: TransformTree,
    /// Files that were cut off, a line each.
    pub cuts: Vec<String>,
    /// Names of frames, each kept once.
    frame_ids: BTreeMap<String, Arc<str>>,
}

/// Whether a type's messages hold a picture.
pub fn is_picture(type_name: &str) -> bool {
    matches!(type_name, Image::TYPE | CompressedImage::TYPE)
}

/// Whether a type's messages are each a pose.
pub fn is_pose(type_name: &str) -> bool {
    matches!(type_name, PoseStamped::TYPE | TransformStamped::TYPE)
}

impl Survey {
    /// Reads a bag through once; transforms between frames are kept where `with_transforms`.
    ///
    /// # Errors
    /// A file or a message that cannot be read.
    pub fn of(bag: &Bag, with_transforms: bool) -> Result<Self> {
        let mut survey = Self::default();
        let mut messages = bag.messages();
        for message in &mut messages {
            survey.note(message?, with_transforms)?;
        }
        survey.cuts = messages.cuts().to_vec();
        Ok(survey)
    }

    fn note(&mut self, message: Message, with_transforms: bool) -> Result<()> {
        let channel = Arc::clone(&message.channel);
        let topic = self.topics.entry(channel.topic.clone()).or_default();
        if topic.n_messages == 0 {
            topic.type_name.clone_from(&channel.type_name);
        }
        topic.n_messages += 1;
        let (log_time_ns, place) = (message.log_time_ns, message.place());
        match channel.type_name.as_str() {
            type_name if is_picture(type_name) => {
                let header: Header = message.read()?;
                let time_ns = self.time_ns(&channel.topic, &header, log_time_ns);
                self.pictures.entry(channel.topic.clone()).or_default().push(time_ns);
            }
            PoseStamped::TYPE => {
                let PoseStamped { header, pose } = message.read()?;
                self.note_pose(&channel.topic, &header, &pose, (log_time_ns, &place))?;
            }
            TransformStamped::TYPE => {
                let TransformStamped { header, transform, .. } = message.read()?;
                self.note_pose(&channel.topic, &header, &transform, (log_time_ns, &place))?;
            }
            TFMessage::TYPE if with_transforms => {
                let is_static = channel.topic.ends_with(STATIC_TRANSFORMS);
                for TransformStamped { header, child_frame_id, transform } in message.read::<TFMessage>()?.transforms {
                    let pose = Rigid::from_pose(&transform, &place)?;
                    let time_ns = self.time_ns(&channel.topic, &header, log_time_ns);
                    self.transforms.insert([&header.frame_id, &child_frame_id], (!is_static).then_some(time_ns), pose);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn note_pose(
        &mut self,
        topic: &str,
        header: &Header,
        pose: &Pose,
        (log_time_ns, place): (i64, &str),
    ) -> Result<()> {
        let time_ns = self.time_ns(topic, header, log_time_ns);
        let frame_id = match self.frame_ids.get(&header.frame_id) {
            Some(known) => Arc::clone(known),
            None => {
                let name: Arc<str> = header.frame_id.as_str().into();
                self.frame_ids.insert(header.frame_id.clone(), Arc::clone(&name));
                name
            }
        };
        let pose = Rigid::from_pose(pose, place)?;
        self.poses.entry(topic.to_owned()).or_default().push(TimedPose { time_ns, pose, frame_id });
        Ok(())
    }

    /// The header's time; the time of recording where it has none.
    fn time_ns(&mut self, topic: &str, header: &Header, log_time_ns: i64) -> i64 {
        let stamp_ns = header.stamp.nanoseconds();
        if stamp_ns != 0 {
            return stamp_ns;
        }
        if let Some(topic) = self.topics.get_mut(topic) {
            topic.n_without_time += 1;
        }
        log_time_ns
    }
}

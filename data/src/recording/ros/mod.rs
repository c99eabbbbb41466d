//! ROS 2: its messages, and recordings of them in MCAP (rosbag2); recordings of ROS 1.

pub mod cdr;
pub mod definitions;
pub mod messages;
pub mod picture;

#[cfg(feature = "mcap")]
pub mod bag;
#[cfg(feature = "mcap")]
mod bag_message;
#[cfg(feature = "mcap")]
pub mod bag_writer;
#[cfg(feature = "mcap")]
mod choice;
#[cfg(feature = "mcap")]
pub mod import;
#[cfg(feature = "mcap")]
mod mcap_file;
#[cfg(feature = "mcap")]
mod placement;
#[cfg(feature = "mcap")]
mod pose_track;
#[cfg(feature = "mcap")]
mod record_file;
#[cfg(feature = "mcap")]
mod records;
#[cfg(feature = "mcap")]
pub mod rigid;
#[cfg(feature = "ros1")]
mod ros1;
#[cfg(feature = "mcap")]
mod survey;
#[cfg(feature = "mcap")]
#[cfg(test)]
mod test_bag;
#[cfg(feature = "mcap")]
pub mod touches;
#[cfg(feature = "mcap")]
mod transform_tree;
#[cfg(feature = "mcap")]
mod unpack;

//! How a node is seen by `ros2 node list` and `ros2 node info`, and its lines in `/rosout`.

use tactile_data::recording::ros::cdr::Writer;

use super::names::NodeName;

/// A participant's nodes: the topic, which has no `rt/` before it, and its type.
pub(super) const TOPIC: &str = "ros_discovery_info";
pub(super) const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// Lines for people.
pub(super) const LOG_TOPIC: &str = "rt/rosout";
pub(super) const LOG_TYPE: &str = "rcl_interfaces::msg::dds_::Log_";

/// An endpoint's or participant's identifier.
pub(super) type Guid = [u8; 16];

/// How grave a line in `/rosout` is (rcl_interfaces/msg/Log).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Level {
    /// What goes on.
    Info = 20,
    /// Something to look at.
    Warn = 30,
    /// Something that failed.
    Error = 40,
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo` of a participant with one node; identifiers have 24 bytes if `long`
/// (ROS 2 up to Humble), 16 otherwise.
pub(super) fn participant(node: &NodeName, guid: Guid, readers: &[Guid], writers: &[Guid], long: bool) -> Vec<u8> {
    let mut message = Writer::default();
    let identifier = |message: &mut Writer, guid: &Guid| {
        let filling = if long { 8 } else { 0 };
        guid.iter().chain(&[0; 8][..filling]).for_each(|byte| message.u8(*byte));
    };
    identifier(&mut message, &guid);
    message.u32(1);
    message.string(node.namespace());
    message.string(node.name());
    for endpoints in [readers, writers] {
        message.u32(endpoints.len() as u32);
        endpoints.iter().for_each(|guid| identifier(&mut message, guid));
    }
    message.finish()
}

/// `rcl_interfaces/msg/Log`, at `time_ns` since 1970.
pub(super) fn log(time_ns: i64, level: Level, node: &NodeName, text: &str) -> Vec<u8> {
    const SECOND: i64 = 1_000_000_000;
    let mut message = Writer::default();
    message.i32(i32::try_from(time_ns.div_euclid(SECOND)).unwrap_or(i32::MAX));
    message.u32(time_ns.rem_euclid(SECOND) as u32);
    message.u8(level as u8);
    // ROS 2 writes a logger's name with dots.
    message.string(&node.full()[1..].replace('/', "."));
    message.string(text);
    message.string("");
    message.string("");
    message.u32(0);
    message.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_and_its_endpoints_have_the_bytes_computed_by_hand() {
        let node = NodeName::new("/a", "n").unwrap();
        let guids: [Guid; 3] = [[1; 16], [2; 16], [3; 16]];
        let got = participant(&node, guids[0], &guids[1..2], &guids[1..], false);
        let mut expected = vec![0, 1, 0, 0];
        expected.extend([1; 16]);
        expected.extend([1, 0, 0, 0]);
        // "/a" has three bytes with its zero, and one follows up to the next length.
        expected.extend([3, 0, 0, 0, b'/', b'a', 0, 0]);
        expected.extend([2, 0, 0, 0, b'n', 0, 0, 0]);
        expected.extend([1, 0, 0, 0]);
        expected.extend([2; 16]);
        expected.extend([2, 0, 0, 0]);
        expected.extend([2; 16]);
        expected.extend([3; 16]);
        assert_eq!(got, expected);
        let long = participant(&node, guids[0], &guids[1..2], &guids[1..], true);
        assert_eq!(long.len(), expected.len() + 4 * 8);
        assert_eq!(&long[..28], &[&expected[..20], &[0; 8]].concat()[..]);
    }

    #[test]
    fn a_line_of_the_log_has_the_bytes_computed_by_hand() {
        let node = NodeName::new("/a", "n").unwrap();
        let got = log(-1, Level::Warn, &node, "x");
        let mut expected = vec![0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff];
        expected.extend(999_999_999u32.to_le_bytes());
        expected.extend([30, 0, 0, 0]);
        expected.extend([4, 0, 0, 0, b'a', b'.', b'n', 0]);
        expected.extend([2, 0, 0, 0, b'x', 0, 0, 0]);
        expected.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        expected.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        expected.extend([0, 0, 0, 0]);
        assert_eq!(got, expected);
    }
}

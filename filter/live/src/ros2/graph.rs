//! How a node is seen by `ros2 node list` and `ros2 node info`, and its lines in `/rosout`.

use tactile_data::recording::ros::cdr::{Field, Reader, Writer};

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

/// How long the identifiers in the graph's messages are. A program that expects 24 bytes and gets 16 takes names for
/// lengths, and asks for gigabytes of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identifiers {
    /// 16 bytes: ROS 2 from Iron on.
    Short,
    /// 24 bytes: ROS 2 up to Humble.
    Long,
}

impl Identifiers {
    /// The identifiers of a distribution of ROS 2; `None` where it is not known.
    pub(super) fn of_distribution(name: &str) -> Option<Self> {
        match name {
            "dashing" | "eloquent" | "foxy" | "galactic" | "humble" => Some(Self::Long),
            "iron" | "jazzy" | "kilted" | "lyrical" | "rolling" => Some(Self::Short),
            _ => None,
        }
    }

    /// The identifiers of a graph's message; `None` where it fits neither, or both.
    pub(super) fn of_message(cdr: &[u8]) -> Option<Self> {
        let fits = |identifiers: Self| identifiers.fit(cdr).unwrap_or(false);
        match (fits(Self::Short), fits(Self::Long)) {
            (true, false) => Some(Self::Short),
            (false, true) => Some(Self::Long),
            _ => None,
        }
    }

    fn n_bytes(self) -> usize {
        match self {
            Self::Short => 16,
            Self::Long => 24,
        }
    }

    /// Whether a message is a whole one with such identifiers.
    fn fit(self, cdr: &[u8]) -> tactile_data::error::Result<bool> {
        let mut reader = Reader::new(cdr, TOPIC)?;
        let identifier =
            |reader: &mut Reader| (0..self.n_bytes()).try_for_each(|_| reader.read::<u8>("gid").map(|_| ()));
        identifier(&mut reader)?;
        for _ in 0..reader.count("nodes")? {
            if !reader.read::<String>("namespace")?.starts_with('/') || reader.read::<String>("name")?.is_empty() {
                return Ok(false);
            }
            for field in ["readers", "writers"] {
                for _ in 0..reader.count(field)? {
                    identifier(&mut reader)?;
                }
            }
        }
        // Up to three bytes may fill the end.
        Ok((0..4).take_while(|_| reader.read::<u8>("end").is_ok()).count() < 4)
    }
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo` of a participant with one node.
pub(super) fn participant(
    node: &NodeName,
    guid: Guid,
    readers: &[Guid],
    writers: &[Guid],
    identifiers: Identifiers,
) -> Vec<u8> {
    let mut message = Writer::default();
    let identifier = |message: &mut Writer, guid: &Guid| {
        guid.iter().chain(&[0; 8]).take(identifiers.n_bytes()).for_each(|byte| byte.write(message));
    };
    identifier(&mut message, &guid);
    1_u32.write(&mut message);
    node.namespace().to_owned().write(&mut message);
    node.name().to_owned().write(&mut message);
    for endpoints in [readers, writers] {
        (endpoints.len() as u32).write(&mut message);
        endpoints.iter().for_each(|guid| identifier(&mut message, guid));
    }
    message.finish()
}

/// `rcl_interfaces/msg/Log`, at `time_ns` since 1970.
pub(super) fn log(time_ns: i64, level: Level, node: &NodeName, text: &str) -> Vec<u8> {
    const SECOND: i64 = 1_000_000_000;
    let mut message = Writer::default();
    i32::try_from(time_ns.div_euclid(SECOND)).unwrap_or(i32::MAX).write(&mut message);
    (time_ns.rem_euclid(SECOND) as u32).write(&mut message);
    (level as u8).write(&mut message);
    // ROS 2 writes a logger's name with dots.
    let texts = [node.full()[1..].replace('/', "."), text.to_owned(), String::new(), String::new()];
    texts.iter().for_each(|text| text.write(&mut message));
    0_u32.write(&mut message);
    message.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_and_its_endpoints_have_the_bytes_computed_by_hand() {
        let node = NodeName::new("/a", "n").unwrap();
        let guids: [Guid; 3] = [[1; 16], [2; 16], [3; 16]];
        let got = participant(&node, guids[0], &guids[1..2], &guids[1..], Identifiers::Short);
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
        // The same with eight zeros behind each identifier.
        let long = participant(&node, guids[0], &guids[1..2], &guids[1..], Identifiers::Long);
        let n = expected.len();
        let mut by_hand: Vec<u8> = Vec::new();
        for (from, to, is_identifier) in [
            (0, 20, true),
            (20, n - 52, false),
            (n - 52, n - 36, true),
            (n - 36, n - 32, false),
            (n - 32, n - 16, true),
        ]
        .into_iter()
        .chain([(n - 16, n, true)])
        {
            by_hand.extend(&expected[from..to]);
            by_hand.extend(&[0; 8][..if is_identifier { 8 } else { 0 }]);
        }
        assert_eq!(long, by_hand);
    }

    /// What a program that expects identifiers of `n_bytes` makes of a message: the lengths that it finds.
    fn lengths(cdr: &[u8], n_bytes: usize) -> Vec<u32> {
        let body = &cdr[4..];
        let number = |at: usize| body.get(at..at + 4).map(|bytes| u32::from_le_bytes(bytes.try_into().unwrap()));
        let (mut at, mut found) = (n_bytes, Vec::new());
        let mut next = |at: &mut usize| {
            *at = at.next_multiple_of(4);
            let length = number(*at).unwrap_or(0);
            *at += 4;
            found.push(length);
            length as usize
        };
        for _ in 0..next(&mut at).min(3) {
            for item_bytes in [1, 1, n_bytes, n_bytes] {
                let length = next(&mut at);
                at += item_bytes * length;
            }
        }
        found
    }

    #[test]
    fn the_layout_of_a_message_is_found_and_the_wrong_one_would_cost_gigabytes() {
        let node = NodeName::new("/", "tactile_filter").unwrap();
        let guids: Vec<Guid> = (0..30).map(|i| [i; 16]).collect();
        for (identifiers, n_bytes) in [(Identifiers::Short, 16), (Identifiers::Long, 24)] {
            for n in [0, 1, 30] {
                let cdr = participant(&node, [9; 16], &guids[..n], &guids, identifiers);
                assert_eq!(Identifiers::of_message(&cdr), Some(identifiers), "{n}");
                assert_eq!(lengths(&cdr, n_bytes), [1, 2, 15, n as u32, 30]);
                for cut in [1, 5, 17] {
                    assert_eq!(Identifiers::of_message(&cdr[..cdr.len() - cut]), None, "{n}, {cut}");
                }
            }
        }
        let short = participant(&node, [9; 16], &guids, &guids, Identifiers::Short);
        assert!(lengths(&short, 24).iter().any(|length| *length > 1 << 20), "{:?}", lengths(&short, 24));
        // A participant without nodes, as rmw sends it first, in both layouts.
        let none = |n_bytes: usize| [&[0, 1, 0, 0][..], &[7; 16], &vec![0; n_bytes - 16], &[0; 4]].concat();
        assert_eq!(Identifiers::of_message(&none(16)), Some(Identifiers::Short));
        assert_eq!(Identifiers::of_message(&none(24)), Some(Identifiers::Long));
        assert_eq!(Identifiers::of_message(&[]), None);
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

//! Tests of [`super`]: whole bags, bags that end early, damage, and the bytes of messages.

use std::fmt::Debug;
use std::fs;
use std::path::{Path, PathBuf};

use super::test_bag::{End, PACKINGS, bag, image, pose, transform};
use super::*;
use crate::dataset::store::Dataset;
use crate::pose::se2::Se2;
use crate::recording::ros::bag::Bag;
use crate::recording::ros::cdr::Reader;
use crate::recording::ros::import::tests::how;
use crate::recording::ros::import::{Import, Imported, PoseSource, import};
use crate::recording::ros::messages::tests::bytes;
use crate::recording::ros::messages::{
    self, CompressedImage, Header, Image, Message as _, PoseStamped, TFMessage, Time, TransformStamped, to_cdr,
};
use crate::recording::ros::test_bag::{self, Packing, Received, Sent, expected, in_plane};

fn sent() -> Vec<Sent> {
    let message = |i| match i % 3 {
        0 => pose("/pose", i, "hole/A", [1.0, 2.0, f64::from(i)]),
        _ => image("/gel", i, 40),
    };
    (1..=8).map(message).collect()
}

struct Written(tempfile::TempDir);

impl Written {
    fn new(bytes: &[u8]) -> Self {
        let written = Self(tempfile::tempdir().unwrap());
        fs::write(written.path(), bytes).unwrap();
        written
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("touches.bag")
    }

    fn read(&self) -> (Received, String) {
        test_bag::read(&self.path())
    }
}

#[test]
fn every_packing_gives_the_same_messages_with_the_types_of_ros_2() {
    for packing in PACKINGS {
        let written = Written::new(&bag(packing, &sent(), End::Closed));
        assert_eq!(written.read(), (expected(&sent()), String::new()), "{packing}");
        let bag = Bag::open(&written.path()).unwrap();
        let types: Vec<String> = bag.messages().map(|m| m.unwrap().channel.type_name.clone()).collect();
        assert_eq!([&types[0], &types[2]], [Image::TYPE, PoseStamped::TYPE]);
    }
    assert_eq!([ros2_name("tf/tfMessage"), ros2_name("tf2_msgs/TFMessage")], [TFMessage::TYPE; 2]);
}

#[test]
fn a_bag_cut_anywhere_gives_what_is_before_the_cut() {
    for packing in PACKINGS {
        let bytes = bag(packing, &sent(), End::Closed);
        let expected = expected(&sent());
        let index_at = u64::from_le_bytes(bytes[MAGIC_AND_NAME..MAGIC_AND_NAME + 8].try_into().unwrap()) as usize;
        let mut n_before = 0;
        for end in (4109..bytes.len()).step_by(31) {
            let (read, said) = Written::new(&bytes[..end]).read();
            assert_eq!(read, expected[..read.len()], "{packing} {end}");
            assert!(read.len() >= n_before, "{packing} {end}");
            n_before = read.len();
            if end < index_at {
                let cut = format!("cut off at byte {end}: the {n_before} messages before are kept");
                assert!(said.contains(&cut), "{packing}: {said}");
            }
        }
        assert_eq!(n_before, 8, "{packing}");
    }
}

/// Where the number `index_pos` begins: behind the first line, two lengths and the name.
const MAGIC_AND_NAME: usize = 13 + 4 + 4 + 10;

#[test]
fn a_message_that_is_whole_before_the_cut_is_kept() {
    let bytes = bag("none", &sent(), End::Closed);
    let ends = expected(&sent()).into_iter().map(|(_, _, data)| {
        let at = bytes.windows(data.len()).position(|window| window == data).unwrap();
        at + data.len()
    });
    // Pictures differ by their time only, so each message is found once.
    for (n_before, end) in ends.enumerate() {
        assert_eq!(Written::new(&bytes[..end]).read().0.len(), n_before + 1);
        assert_eq!(Written::new(&bytes[..end - 1]).read().0.len(), n_before);
    }
}

#[test]
fn a_bag_that_was_not_closed_is_read_and_said_to_be_so() {
    for (packing, end, n_kept, said) in [
        ("none", End::BehindChunk, 8, "has no index: its 8 messages are kept"),
        ("lz4", End::BehindChunk, 8, "has no index: its 8 messages are kept"),
        ("none", End::InChunk, 8, "has no index: its 8 messages are kept"),
        ("lz4", End::InChunk, 8, "the 8 messages before are kept"),
        ("bz2", End::InChunk, 8, "the 8 messages before are kept"),
    ] {
        let bytes = bag(packing, &sent(), end);
        let got = Written::new(&bytes).read();
        assert!(got.0 == expected(&sent())[..n_kept] && got.1.contains(said), "{packing} {end:?}: {}", got.1);
        let (read, said) = Written::new(&bytes[..bytes.len() - 50]).read();
        assert_eq!(read, expected(&sent())[..read.len()]);
        assert!((6..8).contains(&read.len()) && said.contains("cut off at byte"), "{packing} {end:?}: {said}");
    }
}

#[test]
fn forged_lengths_and_damage_are_errors_of_one_line() {
    let short: Vec<Sent> = (1..=4).map(|i| pose("/pose", i, "hole/A", [1.0, 2.0, 3.0])).collect();
    for packing in PACKINGS {
        let bytes = bag(packing, &short, End::Closed);
        let written = Written::new(&bytes);
        // What fills up the first record is left out.
        for at in (MAGIC_AND_NAME - 18..120).chain(4100..bytes.len() - 4) {
            for forged in [u32::MAX, 1 << 28, 0] {
                let mut damaged = bytes.clone();
                damaged[at..at + 4].copy_from_slice(&forged.to_le_bytes());
                fs::write(written.path(), damaged).unwrap();
                let (read, said) = written.read();
                assert!(read.len() <= 4 && !said.contains('\n'), "{packing} {at}: {said}");
                assert!(said.is_empty() || said.contains("touches.bag"), "{packing} {at}: {said}");
            }
        }
    }
}

#[test]
fn damage_is_named_with_its_place() {
    let start = 13 + 4096;
    for packing in ["bz2", "lz4"] {
        let mut bytes = bag(packing, &sent(), End::Closed);
        // The index's first field is behind two lengths and the chunk, which ends with a checksum.
        let end = bytes.windows(4).position(|name| name == b"ver=").unwrap() - 8;
        bytes[end - 3] ^= 4;
        let (read, said) = Written::new(&bytes).read();
        assert!(read.len() >= 2 && read == expected(&sent())[..read.len()], "{packing}: {}", read.len());
        assert!(said.contains("chunk at byte 4109: expected bytes that can be unpacked"), "{said}");
    }
    let unknown = bag("zstd", &sent(), End::Closed);
    assert!(Written::new(&unknown).read().1.contains("a chunk in none, bz2 or lz4, got zstd"));
    let mut long = bag("none", &sent(), End::Closed);
    long[start..start + 4].copy_from_slice(&70_000_u32.to_le_bytes());
    let (_, said) = Written::new(&long).read();
    assert!(said.contains("record at byte 4109: expected a header of at most 65536 bytes"), "{said}");
    for (bytes, got) in [(&b"#ROSBAG V1.2\nold"[..], "got format V1.2"), (b"pictures", "8 bytes that begin otherwise")]
    {
        let (_, said) = Written::new(bytes).read();
        assert!(said.contains("a ROS 1 bag of format V2.0") && said.ends_with(got), "{said}");
    }
}

#[test]
fn a_recording_that_was_split_and_one_that_is_open_are_bags() {
    let folder = tempfile::tempdir().unwrap();
    for (i, sent) in (9..).zip(sent().chunks(4)) {
        fs::write(folder.path().join(format!("run_{i}.bag")), bag("lz4", sent, End::Closed)).unwrap();
    }
    let opened = Bag::open(folder.path()).unwrap();
    let times: Vec<i64> = opened.messages().map(|message| message.unwrap().log_time_ns).collect();
    assert_eq!(times, (1..=8).map(|i| i * 1_000_000).collect::<Vec<_>>());
    let open = folder.path().join("run_11.bag.active");
    fs::write(&open, bag("none", &sent(), End::InChunk)).unwrap();
    assert_eq!(Bag::open(&open).unwrap().messages().count(), 8);
}

fn imported(path: &Path, how: &Import) -> (Dataset, Imported) {
    let out = tempfile::tempdir().unwrap();
    let imported = import(path, how, &out.path().join("out"), &|_, _| {}).unwrap();
    (Dataset::open(&out.path().join("out")).unwrap(), imported)
}

/// What a film with poses and transforms becomes, from a ROS 1 bag and from a ROS 2 bag.
#[test]
fn a_bag_of_ros_1_becomes_the_dataset_that_a_bag_of_ros_2_becomes() {
    let press = [0, 0, 0, 20, 60, 60, 30, 50, 40, 0, 0, 30, 40, 0];
    let (mut old, mut new) = (Vec::new(), Vec::new());
    for (i, press) in (0..).zip(press) {
        let (time, at) = (1000 + 40 * i, [f64::from(i), -2.0, 10.0]);
        old.push(image("/gel", time, press));
        new.push(test_bag::image("/gel", time, press));
        old.push(pose("/tool", time + 3, "hole/A", at));
        new.push(test_bag::pose("/tool", time + 3, "hole/A", at));
        old.push(transform("/tf", time + 5, ["base", "gelsight"], at));
        let (header, child_frame_id) = (test_bag::header(time + 5, "base"), "gelsight".to_owned());
        let transform = TransformStamped { header, child_frame_id, transform: in_plane(at) };
        let cdr = to_cdr(&TFMessage { transforms: vec![transform] });
        new.push(("/tf", TFMessage::TYPE, (time + 5) as u64 * 1_000_000, cdr));
    }
    let written = Written::new(&bag("bz2", &old, End::Closed));
    let mcap = written.0.path().join("touches.mcap");
    let frames = PoseSource::Frames(["base", "gelsight"].map(str::to_owned));
    fs::write(&mcap, test_bag::bag(Packing::NoChunks, &new)).unwrap();
    let guessed = Import { board: Some(Se2::from_degrees(1.0, 2.0, 90.0)), ..how() };
    for how in [guessed.clone(), Import { poses: frames, ..guessed }] {
        let ((old, from_old), (new, from_new)) = (imported(&written.path(), &how), imported(&mcap, &how));
        assert_eq!((old.frames_sha256(), old.touches()), (new.frames_sha256(), new.touches()));
        assert_eq!((from_old.notes, from_old.warnings), (from_new.notes, from_new.warnings));
        assert!(!old.is_empty() && old.touches().iter().all(|touch| touch.part_from_sensor.is_some()));
        let sha256 = Bag::open(&written.path()).unwrap().sha256().unwrap();
        assert_eq!(old.meta().recording.as_ref().unwrap().source_sha256, sha256);
    }
}

// Written by `rosbags` 0.11.9 (ROS1_NOETIC), an independent program in Python.
const IMAGE: &str = "070000000c00000035a49a140300000067656c0100000002000000040000006267723800080000000800000001020304\
                     05060000";
const COMPRESSED: &str = "070000000c00000035a49a140100000067040000006a70656703000000ffd801";
const POSE: &str = "070000000c00000035a49a1406000000686f6c652f41fca9f1d24d62703ffca9f1d24d6280bf000000000000e03f000000\
                    00000000000000000000000000333333333333e33f9a9999999999e93f";
const TF: &str = "02000000070000000c00000035a49a14040000006261736505000000746f6f6c30000000000000f03f000000000000004000\
                  00000000000840000000000000000000000000000000000000000000000000000000000000f03f070000000c00000035a49a\
                  1405000000746f6f6c300600000073656e736f72000000000000f0bf000000000000d03f0000000000000000000000000000\
                  f03f000000000000000000000000000000000000000000000000";

fn check<M: messages::Message + PartialEq + Debug>(hex: &str, message: &M) {
    let bytes = bytes(hex);
    assert_eq!(&M::read(&mut Reader::ros1(&bytes, "a message"), "").unwrap(), message);
    for end in 0..bytes.len() {
        let cut = M::read(&mut Reader::ros1(&bytes[..end], "a message"), "").unwrap_err().to_string();
        assert!(cut.starts_with("a message: expected ") && !cut.contains('\n'), "{cut}");
    }
}

#[test]
fn the_bytes_of_another_program_are_read_and_each_cut_is_named() {
    let header = |frame_id: &str| Header { stamp: Time { sec: 12, nanosec: 345_678_901 }, frame_id: frame_id.into() };
    let (encoding, data) = ("bgr8".to_owned(), vec![1, 2, 3, 4, 5, 6, 0, 0]);
    check(IMAGE, &Image { header: header("gel"), height: 1, width: 2, encoding, is_bigendian: 0, step: 8, data });
    check(COMPRESSED, &CompressedImage { header: header("g"), format: "jpeg".into(), data: vec![255, 216, 1] });
    let pose = messages::Pose { position: [0.004, -0.008, 0.5], orientation: [0.0, 0.0, 0.6, 0.8] };
    check(POSE, &PoseStamped { header: header("hole/A"), pose });
    let transform = |parent, child: &str, position, orientation| TransformStamped {
        header: header(parent),
        child_frame_id: child.into(),
        transform: messages::Pose { position, orientation },
    };
    let first = transform("base", "tool0", [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    let second = transform("tool0", "sensor", [-1.0, 0.25, 0.0], [1.0, 0.0, 0.0, 0.0]);
    check(TF, &TFMessage { transforms: vec![first, second] });
}

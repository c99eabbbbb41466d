//! Tests of [`super`]: files of MCAP, whole, cut and damaged.

use sha2::{Digest, Sha256};

use super::*;
use crate::recording::ros::test_bag::{self, PACKINGS, Packing, Received, Sent, expected, image, pose};

fn sent() -> Vec<Sent> {
    (1..=8)
        .map(|i| if i % 3 == 0 { pose("/pose", i, "hole/A", [1.0, 2.0, f64::from(i)]) } else { image("/gel", i, 40) })
        .collect()
}

struct Written {
    folder: tempfile::TempDir,
}

impl Written {
    fn new(bytes: &[u8]) -> Self {
        let written = Self { folder: tempfile::tempdir().unwrap() };
        fs::write(written.path(), bytes).unwrap();
        written
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("bag.mcap")
    }

    fn read(&self) -> (Received, String) {
        test_bag::read(&self.path())
    }
}

#[test]
fn every_packing_gives_the_same_messages() {
    for packing in PACKINGS {
        let (read, end) = Written::new(&test_bag::bag(packing, &sent())).read();
        assert_eq!((read, end.as_str()), (expected(&sent()), ""), "{packing:?}");
    }
}

#[test]
fn a_bag_cut_anywhere_gives_what_is_before_the_cut() {
    for packing in PACKINGS {
        let bytes = test_bag::bag(packing, &sent());
        let expected = expected(&sent());
        let mut n_before = 0;
        for end in (9..bytes.len()).step_by(50) {
            let (read, said) = Written::new(&bytes[..end]).read();
            assert_eq!(read, expected[..read.len()], "{packing:?} {end}");
            assert!(read.len() >= n_before, "{packing:?} {end}");
            n_before = read.len();
            // The end of the data and the summary behind it are 13 + 29 + 8 bytes.
            if end < bytes.len() - 50 {
                let cut = format!("cut off at byte {end}: the {n_before} messages before are kept");
                assert!(said.contains(&cut), "{said}");
            }
        }
        assert!(n_before >= 6, "{packing:?}: only {n_before}");
    }
}

#[test]
fn a_message_that_is_whole_before_the_cut_is_kept() {
    for packing in [Packing::NoChunks, Packing::Chunks("")] {
        let bytes = test_bag::bag(packing, &sent());
        let ends = expected(&sent()).into_iter().map(|(_, _, data)| {
            let at = bytes.windows(data.len()).position(|window| window == data).unwrap();
            at + data.len()
        });
        // Pictures differ by their time only, so each message is found once.
        for (n_before, end) in ends.enumerate() {
            assert_eq!(Written::new(&bytes[..end]).read().0.len(), n_before + 1, "{packing:?}");
            assert_eq!(Written::new(&bytes[..end - 1]).read().0.len(), n_before, "{packing:?}");
        }
    }
}

/// Nothing but zeros follows what a crash cut off: they are not read, one record of no length after the other.
#[test]
fn a_hole_at_the_end_of_a_file_is_a_cut() {
    let bytes = test_bag::bag(Packing::NoChunks, &sent());
    let written = Written::new(&bytes[..bytes.len() - 50]);
    let file = fs::OpenOptions::new().write(true).open(written.path()).unwrap();
    file.set_len(6 << 30).unwrap();
    let (read, said) = written.read();
    assert_eq!(read, expected(&sent()));
    assert!(said.contains("cut off at byte 6442450944"), "{said}");
}

#[test]
fn forged_lengths_and_damage_are_errors_of_one_line() {
    let short: Vec<Sent> = (1..=4).map(|i| pose("/pose", i, "hole/A", [1.0, 2.0, 3.0])).collect();
    for packing in PACKINGS {
        let bytes = test_bag::bag(packing, &short);
        let written = Written::new(&bytes);
        for at in 8..bytes.len() - 8 {
            for forged in [u64::MAX - 9, 1 << 40] {
                let mut damaged = bytes.clone();
                damaged[at..at + 8].copy_from_slice(&forged.to_le_bytes());
                fs::write(written.path(), damaged).unwrap();
                let (read, said) = written.read();
                assert!(read.len() <= 4 && !said.contains('\n'), "{packing:?} {at}: {said}");
            }
        }
    }
}

#[test]
fn a_changed_bit_in_a_chunk_is_found() {
    let bytes = test_bag::bag(Packing::Chunks(""), &sent());
    let data = &sent()[0].3;
    let at = bytes.windows(data.len()).position(|window| window == *data).unwrap();
    let mut damaged = bytes.clone();
    damaged[at + data.len() / 2] ^= 4;
    let (_, said) = Written::new(&damaged).read();
    assert!(said.contains("chunk at byte") && said.contains("CRC"), "{said}");
    let unknown = test_bag::bag(Packing::Chunks("brotli"), &sent());
    assert!(Written::new(&unknown).read().1.contains("zstd or lz4, got \"brotli\""));
}

#[test]
fn a_split_recording_is_read_in_the_order_of_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    for (i, sent) in sent().into_iter().enumerate() {
        let bytes = test_bag::bag(Packing::Chunks("zstd"), &[sent]);
        fs::write(folder.path().join(format!("bag_{}.mcap", i + 5)), bytes).unwrap();
    }
    fs::write(folder.path().join("metadata.yaml"), "").unwrap();
    assert!(is_bag(folder.path()));
    let bag = Bag::open(folder.path()).unwrap();
    let times: Vec<i64> = bag.messages().map(|message| message.unwrap().log_time_ns).collect();
    assert_eq!(times, (1..=8).map(|i| i * 1_000_000).collect::<Vec<_>>());
    let whole: Vec<u8> = (5..13).flat_map(|i| fs::read(folder.path().join(format!("bag_{i}.mcap"))).unwrap()).collect();
    assert_eq!(bag.sha256().unwrap(), format!("{:x}", Sha256::digest(&whole)));
}

#[cfg(not(feature = "ros1"))]
#[test]
fn a_ros_1_bag_is_refused_with_the_build_that_reads_it_and_the_command_that_converts_it() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.bag"), "something").unwrap();
    for source in [folder.path(), &folder.path().join("a.bag")] {
        let message = Bag::open(source).unwrap_err().to_string();
        let convert = format!("rosbags-convert --src {} --dst out --dst-storage mcap", source.display());
        assert!(message.contains("--features ros1") && message.ends_with(&convert), "{message}");
    }
}

#[test]
fn other_formats_are_refused_with_the_command_that_converts_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, reason) in [("a.db3", "a.db3 --dst out --dst-storage mcap"), ("a.mcap.zstd", "zstd -d ")] {
        fs::write(at(name), "something").unwrap();
        assert!(is_bag(&at(name)));
        let message = Bag::open(&at(name)).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
    fs::remove_file(at("a.mcap.zstd")).unwrap();
    assert!(is_bag(folder.path()));
    assert!(Bag::open(folder.path()).unwrap_err().to_string().contains("rosbags-convert"));
    fs::write(at("b.mcap"), "not MCAP").unwrap();
    let message = Bag::open(folder.path()).unwrap().messages().next().unwrap().unwrap_err().to_string();
    assert!(message.contains("b.mcap: expected an MCAP file"), "{message}");
    assert!(!is_bag(&at("a.png")));
}

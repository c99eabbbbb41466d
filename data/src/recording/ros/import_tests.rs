//! Tests of [`super`]: whole bags to datasets.

use std::fs;
use std::path::PathBuf;

use super::*;
use crate::dataset::store::Dataset;
use crate::recording::geometry::Geometry;
use crate::recording::ros::messages::{CompressedImage, TFMessage, TransformStamped, to_cdr};
use crate::recording::ros::test_bag::{self, PACKINGS, Packing, Sent, header, image, in_plane, pose, rgb};

/// Everything guessed, the first frame at rest.
pub fn how() -> Import {
    Import {
        image_topic: None,
        poses: PoseSource::Guess,
        touches: None,
        max_gap_ms: 100.0,
        part: None,
        side: None,
        tool_from_sensor: None,
        board: None,
        no_contact: NoContact::First(1),
        geometry: Geometry::default(),
    }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn of(packing: Packing, sent: &[Sent]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        fs::write(folder.bag(), test_bag::bag(packing, sent)).unwrap();
        folder
    }

    fn bag(&self) -> PathBuf {
        self.0.path().join("bag.mcap")
    }

    fn import(&self, how: &Import) -> Result<(Dataset, Imported)> {
        let out = self.0.path().join("out");
        let imported = import(&self.bag(), how, &out, &|_, _| {})?;
        let dataset = Dataset::open(&out)?;
        fs::remove_dir_all(&out).unwrap();
        Ok((dataset, imported))
    }

    fn refusal(&self, how: &Import) -> String {
        let message = self.import(how).unwrap_err().to_string();
        assert!(!message.contains('\n') && !self.0.path().join("out").exists(), "{message}");
        message
    }
}

/// A film with 25 frames a second: at rest, then pressed twice.
fn film(topic: &'static str) -> Vec<Sent> {
    let press = [0, 0, 0, 20, 60, 60, 30, 50, 40, 0, 0, 30, 40, 0];
    (0..).zip(press).map(|(i, press)| image(topic, 1000 + 40 * i, press)).collect()
}

fn pressed(dataset: &Dataset) -> Vec<u8> {
    let middle = 3 * (5 * 16 + 6);
    (0..dataset.len()).map(|i| dataset.frame_bytes(i)[middle] - rgb(0)[middle]).collect()
}

#[test]
fn every_encoding_padding_and_packing_gives_the_same_frames() {
    let rgb = rgb(30);
    let png = {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture = image::RgbImage::from_raw(16, 12, rgb.clone()).unwrap();
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let pixels = |order: &[usize], padding: usize| -> Vec<u8> {
        let row = |row: &[u8]| -> Vec<u8> {
            let (pixels, _) = row.as_chunks::<3>();
            let values = pixels.iter().flat_map(|pixel| order.iter().map(|&c| *pixel.get(c).unwrap_or(&9)));
            values.chain(std::iter::repeat_n(7, padding)).collect()
        };
        rgb.chunks(48).flat_map(row).collect()
    };
    for packing in PACKINGS {
        for (encoding, order) in [
            ("rgb8", &[0, 1, 2][..]),
            ("bgr8", &[2, 1, 0]),
            ("rgba8", &[0, 1, 2, 3]),
            ("bgra8", &[2, 1, 0, 3]),
            ("", &[]),
        ] {
            for padding in [0, 5] {
                let (step, data) = match order {
                    [] => (48, png.clone()),
                    order => ((16 * order.len() + padding) as u32, pixels(order, padding)),
                };
                let encoding = encoding.to_owned();
                let message =
                    Image { header: header(40, ""), height: 12, width: 16, encoding, is_bigendian: 0, step, data };
                let folder = Folder::of(packing, &[("/gel", Image::TYPE, 40, to_cdr(&message))]);
                let (dataset, _) = folder.import(&how()).unwrap();
                assert_eq!((dataset.len(), dataset.frame_bytes(0)), (1, &rgb[..]), "{packing:?} {message:?}");
            }
        }
        let message = CompressedImage { header: header(40, ""), format: "bgr8; png".into(), data: png.clone() };
        let folder = Folder::of(packing, &[("/gel", CompressedImage::TYPE, 40, to_cdr(&message))]);
        assert_eq!(folder.import(&how()).unwrap().0.frame_bytes(0), rgb);
    }
}

#[test]
fn without_poses_each_press_is_a_touch_and_each_frame_where_asked() {
    let folder = Folder::of(Packing::Chunks("lz4"), &film("/gel"));
    let (dataset, imported) = folder.import(&how()).unwrap();
    // Of the first press, frames 3 to 8, the first three are left; of the second all may be.
    assert_eq!(pressed(&dataset), [30, 30]);
    assert_eq!(dataset.touch(0).time_s, Some(1.24));
    assert!(imported.notes.iter().any(|note| note.contains("contact: 2 taken, 0 left out")), "{:?}", imported.notes);
    assert!(imported.warnings.iter().any(|warning| warning.contains("--part and --side")));
    let each = Import { touches: Some(Touches::Each), part: Some("A".into()), side: Some(Side::Peg), ..how() };
    let (dataset, imported) = folder.import(&each).unwrap();
    assert_eq!(
        (dataset.len(), dataset.touch(3).part.as_deref(), dataset.touch(3).side),
        (14, Some("A"), Some(Side::Peg))
    );
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let recording = dataset.meta().recording.clone().unwrap();
    assert_eq!((recording.source_px, recording.crop_px), ([16, 12], [0, 0, 16, 12]));
    assert_eq!(recording.source_sha256, Bag::open(&folder.bag()).unwrap().sha256().unwrap());
    let message = folder.refusal(&Import { touches: Some(Touches::Poses), ..how() });
    assert!(message.starts_with("--touches poses"), "{message}");
}

#[test]
fn few_poses_are_touches_and_many_are_the_sensors_way() {
    let few = [("hole/A", 1130, [4.0, -8.0, 30.0]), ("peg/B", 1450, [0.0, 1.0, 0.0]), ("peg/B", 9000, [0.0; 3])];
    let poses = few.map(|(frame, time, at)| pose("/tool", time, frame, at));
    let folder = Folder::of(Packing::NoChunks, &[film("/gel"), poses.to_vec()].concat());
    let (dataset, imported) = folder.import(&how()).unwrap();
    // 1130 ms is nearest to the frame at 1120 ms, 1450 to 1440.
    assert_eq!(dataset.touches().iter().map(|touch| touch.time_s).collect::<Vec<_>>(), [Some(1.12), Some(1.44)]);
    let first = dataset.touch(0);
    assert_eq!((first.part.as_deref(), first.side), (Some("A"), Some(Side::Hole)));
    let found = first.part_from_sensor.unwrap();
    assert!(found.distance_mm(&Se2::new(4.0, -8.0, 0.0)) < 1e-9 && (found.theta_deg() - 30.0).abs() < 1e-9);
    let said = imported.notes.join("\n");
    assert!(said.contains("poses: 2 taken, 1 left out") && said.contains("10.0 ms apart in the median"), "{said}");

    // A pose every 40 ms, between the frames, until 1340 ms.
    let way = (0..9).map(|i| pose("/tool", 1020 + 40 * i, "hole/A", [f64::from(i), 0.0, 0.0]));
    let folder = Folder::of(Packing::NoChunks, &[film("/gel"), way.collect()].concat());
    let (dataset, imported) = folder.import(&how()).unwrap();
    assert_eq!(pressed(&dataset), [30], "{:?}", imported.notes);
    // 1240 ms lies between 1220 ms (5 mm) and 1260 ms (6 mm); the second press has no pose behind it.
    assert!((dataset.touch(0).part_from_sensor.unwrap().x_mm - 5.5).abs() < 1e-9);
    assert!(imported.notes.iter().any(|note| note.contains("contact: 1 taken, 1 left out")), "{:?}", imported.notes);
}

#[test]
fn transforms_give_poses_and_offsets_compose() {
    let transform = |topic, time_ms: i32, parent: &str, child: &str, at| {
        let transform = TransformStamped {
            header: header(time_ms, parent),
            child_frame_id: child.to_owned(),
            transform: in_plane(at),
        };
        let message = TFMessage { transforms: vec![transform] };
        (topic, TFMessage::TYPE, time_ms as u64 * 1_000_000, to_cdr(&message)) as Sent
    };
    let mut sent = film("/gel");
    sent.insert(0, transform("/tf_static", 0, "tool0", "gelsight", [0.0, 5.0, 0.0]));
    for i in 0..14 {
        sent.push(transform("/tf", 995 + 40 * i, "base", "tool0", [f64::from(i), 0.0, 90.0]));
    }
    let folder = Folder::of(Packing::Chunks("zstd"), &sent);
    let (board, tool) = (Se2::from_degrees(1.0, 2.0, 90.0), Se2::from_degrees(0.0, 0.0, 45.0));
    let frames = ["base", "gelsight"].map(str::to_owned);
    let how = Import {
        poses: PoseSource::Frames(frames),
        touches: Some(Touches::Each),
        board: Some(board),
        tool_from_sensor: Some(tool),
        ..how()
    };
    let (dataset, imported) = folder.import(&how).unwrap();
    assert_eq!(dataset.len(), 14);
    for (i, touch) in dataset.touches().iter().enumerate() {
        let chain = Se2::from_degrees(i as f64, 0.0, 90.0) * Se2::new(0.0, 5.0, 0.0);
        let expected = board.inverse() * chain * tool;
        let found = touch.part_from_sensor.unwrap();
        assert!(found.distance_mm(&expected) < 1e-9 && (found.theta_deg() - 45.0).abs() < 1e-9, "{found:?}");
    }
    assert!(imported.notes.join("\n").contains("5.0 ms apart in the median, 5.0 ms at most"), "{:?}", imported.notes);
}

#[test]
fn topics_are_named_where_they_are_not_clear() {
    let folder = Folder::of(Packing::NoChunks, &[film("/left"), film("/right")].concat());
    let message = folder.refusal(&how());
    assert!(
        message.contains("--image-topic") && message.contains("/left (sensor_msgs/msg/Image) with 14"),
        "{message}"
    );
    let named = |topic: &str| Import { image_topic: Some(topic.to_owned()), ..how() };
    assert_eq!(folder.import(&named("/right")).unwrap().0.len(), 2);
    assert!(folder.refusal(&named("/rigth")).contains("did you mean /right?"));
    let poses = ["/a", "/b"].map(|topic| pose(topic, 1000, "hole/A", [0.0; 3]));
    let folder = Folder::of(Packing::NoChunks, &[film("/gel"), poses.to_vec()].concat());
    assert!(folder.refusal(&how()).contains("--pose-topic with one of its topics"));
    let named = Import { poses: PoseSource::Topic("/b".into()), ..how() };
    assert!(folder.import(&named).unwrap().1.notes[1].contains("/b: 1 messages"));
    let folder = Folder::of(Packing::NoChunks, &poses);
    let message = folder.refusal(&how());
    assert!(message.contains("CompressedImage, got /a (geometry_msgs/msg/PoseStamped), /b"), "{message}");
}

#[test]
fn a_cut_bag_is_imported_with_a_warning_and_empty_headers_take_the_time_of_recording() {
    let folder = Folder::of(Packing::Chunks(""), &film("/gel"));
    let bytes = fs::read(folder.bag()).unwrap();
    fs::write(folder.bag(), &bytes[..bytes.len() * 3 / 4]).unwrap();
    let (dataset, imported) = folder.import(&Import { touches: Some(Touches::Each), ..how() }).unwrap();
    assert!(
        (9..12).contains(&dataset.len()) && imported.warnings[0].contains("cut off at byte"),
        "{:?}",
        imported.warnings
    );

    let empty = film("/gel").into_iter().map(|(topic, kind, time, mut cdr)| {
        cdr[4..12].fill(0);
        (topic, kind, time, cdr)
    });
    let folder = Folder::of(Packing::NoChunks, &empty.collect::<Vec<_>>());
    let (dataset, imported) = folder.import(&how()).unwrap();
    assert_eq!(dataset.touch(0).time_s, Some(1.24));
    assert!(imported.warnings[0].contains("/gel: 14 of 14 headers have no time"), "{:?}", imported.warnings);
}

#[test]
fn times_are_the_nearest_numbers() {
    // Python: 1700000001923456789 / 1e9 with exact integers.
    assert_eq!(seconds(1_700_000_001_923_456_789), 1_700_000_001.923_457);
    assert_eq!((seconds(-1_500_000_000), seconds(5)), (-1.5, 5e-9));
}

//! Tests of [`super`]: what is exported comes back.

use std::fs;
use std::path::{Path, PathBuf};

use super::*;
use crate::dataset::store::{Dataset, DatasetWriter, Meta};
use crate::dataset::touch::{Side, Touch};
use crate::pose::se2::Se2;
use crate::recording::folder::{self as recorded, NoContact};
use crate::recording::geometry::{FIELD_OF_VIEW_MM, Geometry};

pub(crate) const PX: [usize; 2] = [16, 12];

pub(crate) fn frame(value: u8) -> Frame {
    let rgb = (0..16 * 12 * 3).map(|i| (i / 3 % 16 * 5) as u8 + value).collect();
    Frame::new(PX[0], PX[1], rgb).unwrap()
}

fn touches() -> Vec<Touch> {
    let pose = |i: f64| Se2::from_degrees(0.1 + i, -7.3 / (i + 1.0), 33.3 * i - 90.0);
    let touch = |i: usize| Touch {
        part: Some(format!("\"{}\", a part", i / 2)),
        side: Some(if i.is_multiple_of(2) { Side::Hole } else { Side::Peg }),
        part_from_sensor: Some(pose(i as f64)),
        moved: (i > 0).then(|| Se2::from_degrees(1.0 / 3.0, 1e-7, -0.1)),
        ..Touch::default()
    };
    (0..6).map(touch).chain([Touch::default()]).collect()
}

fn dataset(folder: &Path, touches: &[Touch]) -> Dataset {
    let meta = Meta::new("few", "a test", PX, [FIELD_OF_VIEW_MM[0] / 16.0, FIELD_OF_VIEW_MM[1] / 12.0]);
    dataset_of(folder, meta, touches)
}

/// Frames of those touches, the first the darkest, and what holds for all.
pub(crate) fn dataset_of(folder: &Path, meta: Meta, touches: &[Touch]) -> Dataset {
    let path = folder.join("dataset");
    let mut writer = DatasetWriter::create(&path, meta, &frame(60)).unwrap();
    for (i, touch) in touches.iter().enumerate() {
        writer.push(&frame(80 + 10 * i as u8), touch).unwrap();
    }
    writer.finish().unwrap();
    Dataset::open(&path).unwrap()
}

pub(crate) fn quiet(_: usize, _: usize) {}

fn import_folder(pictures: &Path, out: PathBuf) -> Dataset {
    let how = recorded::Import {
        index: None,
        no_contact: NoContact::File(pictures.join(folder::NO_CONTACT)),
        geometry: Geometry::default(),
    };
    recorded::import(pictures, &how, &out, &quiet).unwrap();
    Dataset::open(&out).unwrap()
}

#[test]
fn a_folder_of_pictures_comes_back_to_the_last_bit() {
    let scratch = tempfile::tempdir().unwrap();
    let dataset = dataset(scratch.path(), &touches());
    let pictures = scratch.path().join("pictures");
    folder::export(&dataset, &pictures, None, &quiet).unwrap();
    let back = import_folder(&pictures, scratch.path().join("back"));
    assert_eq!(back.touches(), dataset.touches());
    assert_eq!((back.frames_sha256(), back.no_contact()), (dataset.frames_sha256(), dataset.no_contact()));
    assert_eq!(back.meta().mm_per_px, dataset.meta().mm_per_px);
    assert!(folder::export(&dataset, &pictures, None, &quiet).unwrap_err().to_string().contains("not in use"));
}

#[test]
fn names_that_a_spreadsheet_would_run_are_text_in_the_index_and_come_back() {
    let scratch = tempfile::tempdir().unwrap();
    let names = ["=HYPERLINK(\"x\",\"y\")", "+1", "-2", "@SUM(A1)", "'=1", "''", "5-pin"];
    let pose = Some(Se2::from_degrees(-1.5, -2.5, -30.0));
    let touch = |name: &&str| {
        let name = Some((*name).to_owned());
        Touch { part: name.clone(), pair: name.clone(), episode: name, part_from_sensor: pose, ..Touch::default() }
    };
    let dataset = dataset(scratch.path(), &names.iter().map(touch).collect::<Vec<_>>());
    let pictures = scratch.path().join("pictures");
    folder::export(&dataset, &pictures, None, &quiet).unwrap();
    let mut rows = csv::Reader::from_path(pictures.join("index.csv")).unwrap();
    let rows: Vec<csv::StringRecord> = rows.records().map(|row| row.unwrap()).collect();
    for row in &rows {
        let is_run = |cell: &str| cell.starts_with(['=', '+', '-', '@']) && cell.parse::<f64>().is_err();
        assert!(row.iter().all(|cell| !is_run(cell)), "{row:?}");
        // Poses stay numbers; a name that looks like one is text.
        assert_eq!((&row[3], &row[4]), ("-1.5", "-2.5"));
        assert!(!row[1].starts_with(['+', '-']), "{row:?}");
    }
    assert_eq!(import_folder(&pictures, scratch.path().join("back")).touches(), dataset.touches());
}

#[test]
fn jpeg_frames_come_back_nearly() {
    let scratch = tempfile::tempdir().unwrap();
    let dataset = dataset(scratch.path(), &touches());
    let pictures = scratch.path().join("pictures");
    folder::export(&dataset, &pictures, Some(95), &quiet).unwrap();
    assert!(pictures.join("000006.jpg").exists());
    let back = import_folder(&pictures, scratch.path().join("back"));
    for i in 0..dataset.len() {
        let worst = dataset.frame_bytes(i).iter().zip(back.frame_bytes(i)).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst.unwrap() <= 6, "{worst:?}");
    }
    let bad = folder::export(&dataset, &scratch.path().join("bad"), Some(0), &quiet).unwrap_err().to_string();
    assert!(bad.contains("a quality of 1 to 100") && !scratch.path().join("bad.partial").exists(), "{bad}");
}

#[test]
fn arrays_have_the_layout_of_numpy() {
    let scratch = tempfile::tempdir().unwrap();
    let dataset = dataset(scratch.path(), &touches());
    let out = scratch.path().join("arrays");
    arrays::export(&dataset, &out, &quiet).unwrap();
    let values = |name: &str, shape: &str| {
        let bytes = fs::read(out.join(name)).unwrap();
        let header_len = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        assert!(header_len.is_multiple_of(64) && bytes.starts_with(b"\x93NUMPY\x01\x00"));
        let header = String::from_utf8_lossy(&bytes[10..header_len]).into_owned();
        assert!(header.contains(shape) && header.ends_with('\n'), "{header}");
        bytes[header_len..].to_vec()
    };
    let frames: Vec<u8> = (0..7).flat_map(|i| dataset.frame_bytes(i).to_vec()).collect();
    assert_eq!(values("frames.npy", "'|u1', 'fortran_order': False, 'shape': (7, 12, 16, 3,)"), frames);
    assert_eq!(values("no_contact.npy", "(12, 16, 3,)"), dataset.no_contact().rgb());
    let bytes = values("poses.npy", "'<f8', 'fortran_order': False, 'shape': (7, 3,)");
    let poses: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let expected = dataset.touch(4).part_from_sensor.unwrap();
    assert_eq!(poses[12..15], [expected.x_mm, expected.y_mm, expected.theta_rad]);
    assert!(poses[18..].iter().all(|value| value.is_nan()));
    let json: serde_json::Value = serde_json::from_slice(&fs::read(out.join("touches.json")).unwrap()).unwrap();
    assert_eq!((&json["sides"][1], &json["sides"][6]), (&"peg".into(), &serde_json::Value::Null));
}

#[cfg(feature = "mcap")]
mod bags {
    use super::*;
    use crate::recording::ros::import::{self as bags, PoseSource};
    use crate::recording::ros::touches::Touches;

    fn import(bag: &Path, touches: Touches) -> Dataset {
        let how = bags::Import {
            image_topic: None,
            poses: PoseSource::Guess,
            touches: Some(touches),
            max_gap_ms: 100.0,
            part: None,
            side: None,
            tool_from_sensor: None,
            board: None,
            no_contact: NoContact::Guess,
            geometry: Geometry::default(),
        };
        let out = bag.with_extension("back");
        bags::import(bag, &how, &out, &quiet).unwrap();
        Dataset::open(&out).unwrap()
    }

    #[test]
    fn a_bag_comes_back_with_its_parts_poses_and_times() {
        for times in [[3.25, 3.5, 1000.125], [0.5, 0.75, 0.875], [1.7e9, 1.7e9 + 0.1, 1.7e9 + 7.0], [5.0, 4.0, 6.0]] {
            let scratch = tempfile::tempdir().unwrap();
            let touches: Vec<Touch> = (touches().into_iter().zip(times))
                .map(|(touch, time_s)| Touch { time_s: Some(time_s), moved: None, ..touch })
                .collect();
            let dataset = dataset(scratch.path(), &touches);
            let out = scratch.path().join("out.mcap");
            bag::export(&dataset, &out, None, &quiet).unwrap();
            let back = import(&out, Touches::Poses);
            assert_eq!((back.frames_sha256(), back.no_contact()), (dataset.frames_sha256(), dataset.no_contact()));
            for (touch, found) in touches.iter().zip(back.touches()) {
                assert_eq!((&touch.part, touch.side), (&found.part, found.side));
                let [pose, found] = [touch, found].map(|touch| touch.part_from_sensor.unwrap());
                assert!(pose.distance_mm(&found) < 1e-12 && (pose.theta_rad - found.theta_rad).abs() < 1e-14);
            }
            let found: Vec<f64> = back.touches().iter().map(|touch| touch.time_s.unwrap()).collect();
            match times {
                // As they were; moved to leave room for the frames at rest; made anew where they go back.
                [first, ..] if first > 3.0 && first != 5.0 => assert_eq!(found, times),
                [0.5, ..] => assert_eq!(found, [2.6, 2.85, 2.975]),
                _ => assert_eq!(found, [2.6, 2.64, 2.68]),
            }
        }
    }

    #[test]
    fn touches_without_poses_are_frames_behind_those_at_rest() {
        let scratch = tempfile::tempdir().unwrap();
        let dataset = dataset(scratch.path(), &[Touch::default(), Touch::default()]);
        let out = scratch.path().join("out.mcap");
        bag::export(&dataset, &out, Some(95), &quiet).unwrap();
        let back = import(&out, Touches::Each);
        assert_eq!(back.len(), 17);
        let worst = dataset.frame_bytes(1).iter().zip(back.frame_bytes(16)).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst.unwrap() <= 6);
        let refused = bag::export(&dataset, &out, None, &quiet).unwrap_err().to_string();
        assert!(refused.contains("a name not in use"), "{refused}");
    }
}

//! Tests of [`super`]: what was exported comes back, and what others wrote comes in.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::*;
use crate::dataset::export;
use crate::dataset::export::tests::{PX, dataset_of, frame, quiet};
use crate::dataset::store::{Dataset, Meta};
use crate::dataset::touch::Touch;
use crate::error::Result;
use crate::frame::picture;
use crate::light::lamps::Lamps;
use crate::recording::folder::{Imported, NoContact};
use crate::recording::lerobot::format::columns::{Column, Table, Values};
use crate::recording::lerobot::format::{INFO, PICTURES, data_file};

/// Touches of which everything is known, some of it, and nothing.
fn touches() -> Vec<Touch> {
    let pose = |i: f64| Se2::from_degrees(0.1 + i, -7.3 / (i + 1.0), 33.3 * i - 90.0);
    let touch = |i: usize| Touch {
        part: Some(format!("\"{}\", a part", i / 2)),
        side: Some(if i.is_multiple_of(2) { Side::Hole } else { Side::Peg }),
        part_from_sensor: Some(pose(i as f64)),
        moved: (i == 3).then(|| Se2::from_degrees(1.0 / 3.0, 1e-7, -0.1)),
        pair: (i < 2).then(|| "p".into()),
        episode: (i == 2).then(|| "=run".into()),
        time_s: (i > 3).then_some(1_700_000_000.125 + i as f64),
    };
    (0..6).map(touch).chain([Touch::default()]).collect()
}

fn dataset(folder: &Path, touches: &[Touch]) -> Dataset {
    let lamps = Lamps::towards([65.0, 45.0, 47.0], [178.0, 62.0, -54.0]);
    let meta = Meta { lamps: Some(lamps), ..Meta::new("few", "a test", PX, [1.25, 1.125]) };
    dataset_of(folder, meta, touches)
}

/// A LeRobot dataset as others write it: three frames, poses in metres and radians in the robot's frame, no frame at rest.
struct Foreign(tempfile::TempDir);

impl Foreign {
    fn new() -> Self {
        let foreign = Self(tempfile::tempdir().unwrap());
        fs::create_dir_all(foreign.at("meta")).unwrap();
        fs::create_dir_all(foreign.at("data/chunk-000")).unwrap();
        foreign.tell(|_| ());
        let pictures = (0..3).map(|i| picture::png(&frame(80 + 10 * i)).unwrap()).collect();
        let state = [0.5, 0.25, 0.1, 0.0, 0.501, 0.25, 0.1, std::f32::consts::FRAC_PI_2, 0.5, 0.252, 0.1, 0.0];
        let columns = vec![
            Column::new("observation.images.tactile_left", Values::Pictures(pictures, vec![String::new(); 3])),
            Column::new("observation.state", Values::Lists(4, state.to_vec())),
            Column::new("action", Values::Lists(4, state.to_vec())),
            Column::new("timestamp", Values::Floats(vec![0.0, 0.5, 0.0])),
            Column::new("frame_index", Values::Longs(vec![0, 1, 0])),
            Column::new("episode_index", Values::Longs(vec![0, 0, 1])),
            Column::new("index", Values::Longs(vec![0, 1, 2])),
            Column::new("task_index", Values::Longs(vec![0, 0, 0])),
        ];
        Table::write(&foreign.at(data_file(0)), columns, &[]).unwrap();
        foreign
    }

    fn at(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes `meta/info.json` with a change.
    fn tell(&self, change: impl Fn(&mut Value)) {
        let mut info = json!({
            "codebase_version": "v3.0", "robot_type": "arm", "total_episodes": 2, "total_frames": 3, "total_tasks": 1,
            "chunks_size": 1000, "fps": 2, "splits": {"train": "0:2"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "features": {
                "observation.images.tactile_left":
                    {"dtype": "image", "shape": [12, 16, 3], "names": ["height", "width", "channels"]},
                "observation.state": {"dtype": "float32", "shape": [4], "names": ["x", "y", "z", "yaw"]},
                "action": {"dtype": "float32", "shape": [4], "names": ["x", "y", "z", "yaw"]},
            },
        });
        change(&mut info);
        fs::write(self.at(INFO), info.to_string()).unwrap();
    }

    fn import(&self, how: &LeRobot) -> Result<(Dataset, Imported)> {
        let out = self.at("out");
        let imported = import(self.0.path(), how, &out, &quiet)?;
        Ok((Dataset::open(&out)?, imported))
    }

    fn refusal(&self, how: &LeRobot) -> String {
        let message = self.import(how).unwrap_err().to_string();
        assert!(!message.contains('\n') && !self.at("out").exists(), "{message}");
        message
    }
}

fn first_frame() -> LeRobot {
    LeRobot { frames: Import { no_contact: NoContact::First(1), ..Import::default() }, ..LeRobot::default() }
}

#[test]
fn what_was_exported_comes_back_to_the_last_bit() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let dataset = dataset(scratch.path(), &touches());
    export::lerobot::export(&dataset, &at("set"), &quiet).unwrap();
    assert!(is_lerobot(&at("set")) && !at("set.partial").exists());
    let imported = import(&at("set"), &LeRobot::default(), &at("back"), &quiet).unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let back = Dataset::open(&at("back")).unwrap();
    assert_eq!(back.touches(), dataset.touches());
    assert_eq!((back.frames_sha256(), back.no_contact()), (dataset.frames_sha256(), dataset.no_contact()));
    assert_eq!((&back.meta().mm_per_px, &back.meta().lamps), (&dataset.meta().mm_per_px, &dataset.meta().lamps));
    // What is turned is another view: its scale must be given.
    let mut turned = LeRobot::default();
    turned.frames.geometry.quarter_turns = 1;
    let imported = import(&at("set"), &turned, &at("turned"), &quiet).unwrap();
    assert!(imported.warnings[0].contains("the scale and the lamps that came with them are left out"));
    let refused = export::lerobot::export(&dataset, &at("set"), &quiet).unwrap_err().to_string();
    assert!(refused.contains("a name not in use"), "{refused}");
}

#[test]
fn what_no_touch_has_is_no_feature_and_episodes_are_runs_of_one_side_of_one_part() {
    let scratch = tempfile::tempdir().unwrap();
    let set = scratch.path().join("set");
    let side = |part: &str, side| Touch { part: Some(part.into()), side: Some(side), ..Touch::default() };
    let touches = [
        side("A", Side::Hole),
        side("A", Side::Hole),
        side("A", Side::Peg),
        side("B", Side::Peg),
        side("A", Side::Peg),
    ];
    let dataset = dataset(scratch.path(), &touches);
    export::lerobot::export(&dataset, &set, &quiet).unwrap();
    let info: Value = serde_json::from_str(&fs::read_to_string(set.join(INFO)).unwrap()).unwrap();
    let names: Vec<&String> = info["features"].as_object().unwrap().keys().collect();
    let mut expected =
        vec!["episode_index", "frame_index", "index", PICTURES, "part", "side", "task_index", "timestamp"];
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert_eq!(
        (&info["total_episodes"], &info["total_frames"], &info["total_tasks"]),
        (&json!(4), &json!(5), &json!(3))
    );
    assert_eq!(info["features"][PICTURES]["shape"], json!([12, 16, 3]));
    let empty = Dataset::open(&scratch.path().join("dataset")).unwrap();
    import(&set, &LeRobot::default(), &scratch.path().join("back"), &quiet).unwrap();
    assert_eq!(Dataset::open(&scratch.path().join("back")).unwrap().touches(), empty.touches());
}

#[test]
fn a_set_of_others_comes_in_with_poses_by_name() {
    let foreign = Foreign::new();
    let how = LeRobot {
        state: Some("x:m,y:m,yaw:rad".into()),
        part: Some("A".into()),
        side: Some(Side::Hole),
        board: Some(Se2::new(500.0, 250.0, 0.0)),
        tool_from_sensor: Some(Se2::new(1.0, 0.0, 0.0)),
        ..first_frame()
    };
    let (dataset, imported) = foreign.import(&how).unwrap();
    assert_eq!(imported.warnings, ["column action is left out"]);
    let of = |touch: &Touch| (touch.episode.clone().unwrap(), touch.time_s.unwrap(), touch.part.clone().unwrap());
    let found: Vec<_> = dataset.touches().iter().map(of).collect();
    assert_eq!(found, [("0", 0.0, "A"), ("0", 0.5, "A"), ("1", 0.0, "A")].map(|(e, t, p)| (e.into(), t, p.into())));
    // 1 mm of the tool, turned with it; f32 holds half a metre to 0.03 micrometres.
    for (touch, (x, y, deg)) in dataset.touches().iter().zip([(1.0, 0.0, 0.0), (1.0, 1.0, 90.0), (1.0, 2.0, 0.0)]) {
        let pose = touch.part_from_sensor.unwrap();
        assert!((pose.x_mm - x).abs() < 1e-4 && (pose.y_mm - y).abs() < 1e-4, "{pose:?}");
        assert!((pose.theta_rad.to_degrees() - deg).abs() < 1e-4, "{pose:?}");
    }
    assert_eq!(dataset.frame_bytes(2), frame(100).rgb());
    fs::remove_dir_all(foreign.at("out")).unwrap();
    let (dataset, imported) = foreign.import(&first_frame()).unwrap();
    assert!(dataset.touches().iter().all(|touch| touch.part_from_sensor.is_none()));
    assert!(imported.warnings.iter().any(|warning| warning.contains("observation.state")), "{:?}", imported.warnings);
}

#[test]
fn what_is_wrong_is_named_and_leaves_nothing() {
    let foreign = Foreign::new();
    let default = LeRobot::default();
    foreign.tell(|info| info["codebase_version"] = "v2.1".into());
    assert!(foreign.refusal(&default).contains("convert_dataset_v21_to_v30"));
    foreign.tell(|info| info["total_frames"] = 4.into());
    assert!(foreign.refusal(&default).contains("expected 4 frames as"));
    foreign.tell(|info| info["features"]["observation.images.tactile_left"]["dtype"] = "video".into());
    assert!(foreign.refusal(&default).contains("of dtype video"));
    foreign.tell(|info| info["features"]["observation.state"]["names"] = json!(["x", "y", "yaw"]));
    let state = LeRobot { state: Some("x:m,y:m,yaw:rad".into()), ..first_frame() };
    assert!(foreign.refusal(&state).contains("a list of 3 numbers in each row, got 12 in all"));
    foreign.tell(|info| info["features"] = json!({"observation.images.tactile": {"dtype": "image"}}));
    assert!(foreign.refusal(&default).contains("expected a column observation.images.tactile with the fields"));
    fs::write(foreign.at(INFO), "{").unwrap();
    assert!(foreign.refusal(&default).contains("meta/info.json"));
    foreign.tell(|_| ());
    fs::write(foreign.at(data_file(0)), "PAR1").unwrap();
    assert!(foreign.refusal(&default).contains("expected a Parquet file"));
    fs::remove_file(foreign.at(data_file(0))).unwrap();
    assert!(foreign.refusal(&default).contains("files of frames, chunk-000/file-000.parquet, got none"));
}

/// A bag, the set made of it, and the bag made of that: the same pictures, poses and names.
#[cfg(feature = "mcap")]
#[test]
fn a_bag_comes_back_by_way_of_a_set() {
    use crate::recording::geometry::Geometry;
    use crate::recording::ros::import as bag;
    use crate::recording::ros::touches::Touches;
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let pose = |i: i32| Se2::from_degrees(f64::from(i), 0.5, f64::from(10 * i));
    let touch = |i| Touch {
        part: Some("A".into()),
        side: Some(Side::Hole),
        part_from_sensor: Some(pose(i)),
        ..Touch::default()
    };
    let dataset = dataset(scratch.path(), &(0..4).map(touch).collect::<Vec<_>>());
    let of_bag = |from: &Path, to: &Path| {
        let how = bag::Import {
            image_topic: None,
            poses: bag::PoseSource::Guess,
            touches: Some(Touches::Poses),
            max_gap_ms: 100.0,
            part: None,
            side: None,
            tool_from_sensor: None,
            board: None,
            no_contact: NoContact::Guess,
            geometry: Geometry::default(),
        };
        bag::import(from, &how, to, &quiet).unwrap();
        Dataset::open(to).unwrap()
    };
    export::bag::export(&dataset, &at("a.mcap"), None, &quiet).unwrap();
    let first = of_bag(&at("a.mcap"), &at("first"));
    export::lerobot::export(&first, &at("set"), &quiet).unwrap();
    import(&at("set"), &LeRobot::default(), &at("second"), &quiet).unwrap();
    let second = Dataset::open(&at("second")).unwrap();
    assert_eq!((second.touches(), second.frames_sha256()), (first.touches(), first.frames_sha256()));
    export::bag::export(&second, &at("b.mcap"), None, &quiet).unwrap();
    let third = of_bag(&at("b.mcap"), &at("third"));
    let placed = |of: &Dataset| {
        of.touches().iter().map(|touch| (touch.part.clone(), touch.side, touch.part_from_sensor)).collect::<Vec<_>>()
    };
    assert_eq!((placed(&third), third.frames_sha256()), (placed(&first), first.frames_sha256()));
    assert_eq!(first.len(), 4);
}

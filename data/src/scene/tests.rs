use std::path::{Path, PathBuf};

use super::*;
use crate::pose::se2::Se2;
use crate::sensor::light::{self, LightRig};
use crate::sensor::simulator::{Simulator, frame_rng};

/// A folder with a scene file of these lines before `[reach]`, and with files next to it.
struct Written {
    folder: tempfile::TempDir,
}

impl Written {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn load(&self, text: &str) -> Result<Scene> {
        let reach = "[reach]\nxy_half_mm = 4.0\nxy_step_mm = 4.0\ntheta_half_deg = 0.0\ntheta_step_deg = 30.0\n";
        std::fs::write(self.at("scene.toml"), format!("name = \"mine\"\n{text}\n{reach}")).unwrap();
        Scene::load(self.at("scene.toml").to_str().unwrap())
    }

    /// Loads a scene that must be refused in one line with its file and `named`.
    fn refused(&self, text: &str, named: &[&str]) {
        let error = self.load(text).unwrap_err().to_string();
        let fits = error.contains("scene.toml") && named.iter().all(|named| error.contains(named));
        assert!(fits && !error.contains('\n'), "{named:?}: {error}");
    }
}

const LETTERS: &str = "[parts.letters]\nletters = \"AB\"\nheight_mm = 12.0\nmax_width_mm = 16.0";

#[test]
fn every_preset_is_valid_and_survives_a_file() {
    for name in Scene::PRESETS {
        let scene = Scene::preset(name).unwrap();
        scene.validate().unwrap();
        let back: Scene = toml::from_str(&toml::to_string(&scene).unwrap()).unwrap();
        assert_eq!(back, scene);
        // Datasets that are there describe their sensor without what came later.
        assert!(
            !toml::to_string(&scene).unwrap().contains("exposure")
                && !toml::to_string(&scene).unwrap().contains("font")
        );
        let stored: Scene = serde_json::from_value(serde_json::to_value(&scene).unwrap()).unwrap();
        assert_eq!(stored, scene);
    }
}

#[test]
fn evaluation_letters_are_not_tuning_letters() {
    let letters = |name: &str| Scene::preset(name).unwrap().part_names();
    for size in ["small", "large"] {
        let (held_out, dev) = (letters(&format!("alphabet-{size}")), letters(&format!("alphabet-{size}-dev")));
        assert!(held_out.len() == 12 && dev.len() == 12 && held_out.iter().all(|l| !dev.contains(l)));
    }
}

#[test]
fn a_robustness_scene_is_the_small_alphabet_but_for_what_it_is_named_after() {
    let plain = Scene::preset("alphabet-small").unwrap();
    let spec = &plain.sensor;
    let light = crate::sensor::light::LightRig::named("cmu").unwrap();
    let noise_counts = spec.noise_counts.map(|counts| 3.0 * counts);
    let expected = [
        ("cmu-light", SensorSpec { light, ..spec.clone() }),
        ("soft-gel", SensorSpec { gel_length_mm: 2.0, ..spec.clone() }),
        ("noisy-camera", SensorSpec { noise_counts, jpeg_quality: [25, 45], ..spec.clone() }),
        ("shallow-press", SensorSpec { depth_mm: 0.2, ..spec.clone() }),
        ("crowded-board", spec.clone()),
        ("attachment", spec.clone()),
    ];
    for (name, sensor) in expected {
        let mut scene = robust(name);
        for axis in 0..3 {
            assert!((scene.sensor.noise_counts[axis] - sensor.noise_counts[axis]).abs() < 1e-9, "{name}");
        }
        scene.sensor.noise_counts = sensor.noise_counts;
        assert_eq!(
            (&scene.sensor, scene.reach, scene.clearance_mm),
            (&sensor, plain.reach, plain.clearance_mm),
            "{name}"
        );
        assert_eq!(
            (scene.part_names(), scene.board.is_some()),
            (plain.part_names(), name == "crowded-board"),
            "{name}"
        );
    }
}

/// A scene of the robustness rows.
fn robust(name: &str) -> Scene {
    let file = format!("{}/scenes/robust/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Scene::load(&file).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn on_the_crowded_board_most_views_show_a_neighbour() {
    let geometry = |scene: Scene| {
        let sensor = SensorSpec { frame_px: [40, 30], place_jitter_mm: 0.0, ..scene.sensor };
        Simulator::new(Scene { sensor, fidelity: Fidelity::Geometry, ..scene }, 1).unwrap()
    };
    let (alone, crowded) = (geometry(Scene::preset("alphabet-small").unwrap()), geometry(robust("crowded-board")));
    let reach = alone.scene().reach.unwrap();
    let views = || (0..alone.parts().len()).flat_map(|part| (0..reach.len()).step_by(9).map(move |cell| (part, cell)));
    let shows = |&(part, cell): &(usize, usize)| {
        let touch = |of: &Simulator| of.touch(part, Side::Peg, &reach.pose(cell), &mut frame_rng(1, 0)).unwrap();
        touch(&alone) != touch(&crowded)
    };
    let share = views().filter(shows).count() as f64 / views().count() as f64;
    // 0.71 by the letters' boxes in the frame, computed apart.
    assert!((0.55..0.75).contains(&share), "{share}");
}

#[test]
fn a_dowel_is_felt_beside_a_peg_and_not_beside_its_hole() {
    let plain = Scene::preset("alphabet-small").unwrap();
    let geometry = |scene: Scene| {
        let sensor = SensorSpec { place_jitter_mm: 0.0, ..scene.sensor };
        Simulator::new(Scene { sensor, fidelity: Fidelity::Geometry, ..scene }, 1).unwrap()
    };
    let (plain, with_dowels) = (geometry(plain), geometry(robust("attachment")));
    for part in 0..plain.parts().len() {
        let touched = |simulator: &Simulator, side| {
            let frame = simulator.touch(part, side, &Se2::IDENTITY, &mut frame_rng(1, 0)).unwrap();
            frame.rgb().iter().filter(|value| **value > 120).count() as f64 / frame.rgb().len() as f64
        };
        let more = |side| touched(&with_dowels, side) - touched(&plain, side);
        // Two discs of 2.5 mm in a view of 18.6 x 14.3 mm, less what a wide letter pushes over its side.
        let dowels = 2.0 * std::f64::consts::PI * 1.25 * 1.25 / (18.6 * 14.3);
        let letter = &plain.parts()[part];
        assert!((0.4 * dowels..1.1 * dowels).contains(&more(Side::Peg)), "{letter}: {}", more(Side::Peg));
        assert!(more(Side::Hole).abs() < 0.005, "{letter}: {}", more(Side::Hole));
    }
}

#[test]
fn parts_of_a_stored_scene_are_read() {
    let letters = r#"{"letters": {"letters": "AB", "height_mm": 12.0, "max_width_mm": 16.0}}"#;
    let parts: Parts = serde_json::from_str(letters).unwrap();
    assert_eq!(parts, Parts::Kit(Kit::of_letters("AB", 12.0, 16.0)));
    let maze = r#"{"maze": {"n_boards": 2, "n_held_out": 1, "n_pairs": 4, "gel_length_mm": [0.9, 1.6]}}"#;
    assert!(matches!(serde_json::from_str(maze).unwrap(), Parts::Maze(MazeBoards { n_boards: 2, .. })));
}

#[test]
fn a_wrong_scene_names_file_and_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let good = toml::to_string(&Scene::preset("alphabet-small").unwrap()).unwrap();
    for (from, to, named) in [
        ("letters = \"ABC", "letters = \"A\u{2603}C\u{e000}", "letter"),
        ("letters = \"ABC", "letters = \"ABA", "'A' twice"),
        ("height_mm = 12.0", "height_mm = -1.0", "height_mm"),
        ("max_width_mm = 16.0", "max_width_mm = 0.0", "max_width_mm"),
        ("xy_step_mm = 4.0", "xy_step_mm = 3.0", "reach.xy"),
        ("\ndepth_mm = 0.6", "\ndepth_cm = 0.6", "depth_cm"),
        ("\ndepth_mm = 0.6", "\ndepth_mm = 0.0", "depth_mm"),
        ("fidelity = \"camera\"", "fidelity = \"perfect\"", "perfect"),
        ("clearance_mm = 0.15", "clearance_mm = -0.15", "clearance_mm"),
    ] {
        assert!(good.contains(from), "{from}\n{good}");
        std::fs::write(&path, good.replace(from, to)).unwrap();
        let error = Scene::load(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(error.contains(named) && error.contains("scene.toml") && !error.contains('\n'), "{error}");
    }
    std::fs::write(&path, "name = \"mine\"\n\n[parts]\ngears = 3\n").unwrap();
    let error = Scene::load(path.to_str().unwrap()).unwrap_err().to_string();
    assert!(error.contains("scene.toml, line 4") && error.contains("gears"), "{error}");
    assert!(Scene::load("alphabet-smal").unwrap_err().to_string().contains("alphabet-small"));
}

#[test]
fn the_field_of_view_is_told_in_any_way_and_only_one() {
    let written = Written::new();
    let view = |sensor: &str| {
        written.load(&format!("{LETTERS}\n[sensor]\nframe_px = [320, 240]\n{sensor}")).unwrap().sensor.field_of_view_mm
    };
    assert_eq!(view("preset = \"gelsight-mini-sdk\""), [20.3, 15.2]);
    assert_eq!(view("mm_per_px = [0.05, 0.06]"), [16.0, 0.06 * 240.0]);
    assert_eq!(view("field_of_view_mm = [18.6, 14.3]\nmm_per_px = [0.0581, 0.0596]"), [18.6, 14.3]);
    assert_eq!(
        view("preset = \"gelsight-mini-taxim\"\nmm_per_px = [0.0590, 0.0590]"),
        [0.0590 * 320.0, 0.0590 * 240.0]
    );
    let refused = |sensor: &str, named: &[&str]| {
        written.refused(&format!("{LETTERS}\n[sensor]\nframe_px = [320, 240]\n{sensor}"), named);
    };
    refused("field_of_view_mm = [18.6, 14.3]\nmm_per_px = [0.0581, 0.0634]", &["sensor.mm_per_px", "15.22 mm"]);
    refused("preset = \"gelsight-mini\"\nfield_of_view_mm = [20.3, 15.2]", &["sensor.preset"]);
    refused("preset = \"gelsight-max\"", &["sensor.preset", "gelsight-mini-taxim", "gelsight-max"]);
    refused("field_of_view_mm = [18.6, 0.0]", &["sensor.field_of_view_mm", "positive"]);
    refused("mm_per_px = [-0.05, 0.05]", &["sensor.mm_per_px", "positive"]);
    refused("gel_length_mm = 0.0", &["sensor.gel_length_mm"]);
    refused("exposure = 0.0", &["sensor.exposure", "0.1 to 4"]);
    refused("gel_length_cm = 0.1", &["gel_length_cm"]);
}

#[test]
fn a_calibration_gives_its_light_to_every_view_within_it() {
    let written = Written::new();
    let light = LightRig::named("cmu").unwrap();
    let calibration = Calibration {
        schema: crate::light::calibrate::SCHEMA.into(),
        frame_px: [320, 240],
        field_of_view_mm: [18.6, 14.3],
        source: "by hand".into(),
        gel_length_mm: Some(1.5),
        contact_share: None,
        leave_one_out: None,
        light: light.clone(),
    };
    calibration.save(written.at("mine.toml")).unwrap();
    let with = |sensor: &str| format!("{LETTERS}\n[sensor]\ncalibration = \"mine.toml\"\n{sensor}");
    let sensor = written.load(&with("frame_px = [80, 60]")).unwrap().sensor;
    assert_eq!((sensor.light, sensor.gel_length_mm, sensor.frame_px), (light, 1.5, [80, 60]));
    assert_eq!(sensor.calibration, None);
    let sdk = written.load(&with("preset = \"gelsight-mini-sdk\"")).unwrap().sensor;
    assert_eq!(
        sdk,
        calibration.light_for(SensorSpec { field_of_view_mm: [20.3, 15.2], ..SensorSpec::default() }).unwrap()
    );
    written.refused(&with("field_of_view_mm = [26.0, 20.0]"), &["sensor.calibration", "26.0 x 20.0"]);
    let crop =
        written.load(&with("field_of_view_mm = [9.3, 14.3]\ncalibration_centre_mm = [-4.65, 0.0]")).unwrap().sensor;
    // The left half: its right border is the middle of the whole.
    let along = |rig: &LightRig, x| light::value(&rig.along_x[0], x, 0.5);
    assert!((along(&crop.light, 1.0) - along(&calibration.light, 0.0)).abs() < 1e-4);
    written.refused(&format!("{LETTERS}\n[sensor]\ncalibration_centre_mm = [1.0, 0.0]"), &["calibration_centre_mm"]);
    written.refused(&with("light = \"mini\""), &["light or calibration"]);
    written.refused(&with("").replace("mine", "yours"), &["sensor.calibration", "yours.toml"]);
}

#[test]
fn a_preset_under_a_calibrated_sensor_shows_what_that_sensor_shows() {
    let mine = Calibration {
        schema: crate::light::calibrate::SCHEMA.into(),
        frame_px: [320, 240],
        field_of_view_mm: [20.3, 15.2],
        source: "by hand".into(),
        gel_length_mm: Some(1.8),
        contact_share: None,
        leave_one_out: None,
        light: LightRig::named("cmu").unwrap(),
    };
    let maze = Scene::preset("maze").unwrap();
    let own = maze.clone().under(&mine).unwrap();
    let expected = SensorSpec {
        field_of_view_mm: [20.3, 15.2],
        light: mine.light.clone(),
        gel_length_mm: 1.8,
        ..maze.sensor.clone()
    };
    assert_eq!(own.sensor, expected);
    let lengths = |scene: &Scene| match &scene.parts {
        Parts::Maze(boards) => boards.gel_length_mm,
        Parts::Kit(_) => panic!("a kit"),
    };
    // Half as long again as the default of 1.2 mm.
    let [shortest, longest] = lengths(&own);
    assert_eq!([0.9, 1.6], lengths(&maze));
    assert!((shortest - 1.35).abs() < 1e-9 && (longest - 2.4).abs() < 1e-9, "{shortest} {longest}");
    let plain = maze.under(&Calibration { gel_length_mm: None, ..mine }).unwrap();
    assert_eq!(lengths(&plain), [0.9, 1.6]);
}

#[test]
fn maze_boards_stand_alone() {
    let maze = "[parts.maze]\nn_boards = 2\nn_held_out = 1\nn_pairs = 4\ngel_length_mm = [0.9, 1.6]";
    let written = Written::new();
    written.refused(&format!("{LETTERS}\n{maze}"), &["parts", "either maze or"]);
    written.refused(&format!("{maze}\n[board]\nsize_mm = [90.0, 90.0]\nspacing_mm = [9.0, 9.0]"), &["board"]);
    written.refused("[parts]", &["parts", "at least one"]);
}

#[test]
fn parts_on_a_board_must_fit_and_not_overlap() {
    let written = Written::new();
    let board = |text: &str| format!("clearance_mm = 0.15\n{LETTERS}\n[board]\n{text}");
    let good = written.load(&board("size_mm = [40.0, 20.0]\nat_mm = [[-9.0, 0.0], [9.0, 0.0]]")).unwrap();
    assert_eq!(good.reliefs(0, Side::Peg, 1).unwrap().len(), 2);
    assert!(written.load(&board("size_mm = [40.0, 20.0]\nspacing_mm = [18.0, 18.0]")).is_ok());
    for (text, named) in [
        ("size_mm = [9.0, 40.0]\nspacing_mm = [18.0, 18.0]", ["board.size_mm", "room for A"].as_slice()),
        ("size_mm = [40.0, 20.0]\nat_mm = [[-15.0, 0.0], [9.0, 0.0]]", &["board", "A on the board"]),
        ("size_mm = [40.0, 20.0]\nat_mm = [[-9.0, 0.0], [-2.0, 0.0]]", &["board", "A on B"]),
        ("size_mm = [40.0, 20.0]\nat_mm = [[-9.0, 0.0]]", &["board.at_mm", "2 parts"]),
        ("size_mm = [40.0, 20.0]\nat_mm = [[nan, 0.0], [9.0, 0.0]]", &["board", "A on the board"]),
        ("size_mm = [40.0, 20.0]", &["board", "at_mm or spacing_mm"]),
        ("size_mm = [40.0, 20.0]\nspacing_mm = [0.0, 18.0]", &["board.spacing_mm"]),
        ("size_mm = [40.0, -20.0]\nspacing_mm = [18.0, 18.0]", &["board.size_mm", "0 to 1000"]),
    ] {
        written.refused(&board(text), named);
    }
}

#[test]
fn a_part_may_lie_in_the_counter_of_another_but_not_across_its_stroke() {
    let written = Written::new();
    let svg = |body: &str| {
        format!("<svg xmlns='http://www.w3.org/2000/svg' width='40mm' height='40mm' viewBox='0 0 40 40'>{body}</svg>")
    };
    let frame = "<path fill-rule='evenodd' d='M0 0H20V20H0Z M2 2H18V18H2Z'/>";
    std::fs::write(written.at("frame.svg"), svg(frame)).unwrap();
    std::fs::write(written.at("disc.svg"), svg("<circle cx='9' cy='9' r='4'/>")).unwrap();
    let file = |name: &str| format!("[[parts.files]]\nname = \"{name}\"\npeg = \"{name}.svg\"\n");
    let scene = |x: f64| {
        let at = format!("at_mm = [[0.0, 0.0], [{x}, 0.0]]");
        format!("{}{}[board]\nsize_mm = [50.0, 50.0]\n{at}", file("frame"), file("disc"))
    };
    assert_eq!(written.load(&scene(3.0)).unwrap().part_names(), ["frame", "disc"]);
    // The disc, the frame's stroke and 0.15 mm of clearance round both: free up to 8 - 4 - 0.3.
    assert!(written.load(&scene(3.65)).is_ok());
    written.refused(&scene(3.75), &["board", "frame on disc"]);
}

#[test]
fn on_a_board_neighbours_and_the_edge_are_felt() {
    let written = Written::new();
    let letters = LETTERS.replace("AB", "IO");
    let text = |board: &str| format!("fidelity = \"geometry\"\n{letters}\n[sensor]\nplace_jitter_mm = 0.0\n{board}");
    let alone = Simulator::new(written.load(&text("")).unwrap(), 1).unwrap();
    let board = "[board]\nsize_mm = [24.0, 18.0]\nat_mm = [[-8.0, 0.0], [4.0, 0.0]]";
    let together = Simulator::new(written.load(&text(board)).unwrap(), 1).unwrap();
    let touched = |simulator: &Simulator, part, side, x_mm| {
        let pose = Se2::from_degrees(x_mm, 0.0, 0.0);
        let frame = simulator.touch(part, side, &pose, &mut frame_rng(1, 0)).unwrap();
        frame.rgb().iter().filter(|value| **value > 120).count() as f64 / frame.rgb().len() as f64
    };
    let close = |got: f64, expected: f64| assert!((got - expected).abs() < 0.01, "{got}, not {expected}");
    // On top of the O, 12 mm to the right of the I.
    close(touched(&alone, 0, Side::Peg, 12.0), 0.0);
    close(touched(&together, 0, Side::Peg, 12.0), touched(&alone, 1, Side::Peg, 0.0));
    // The board ends 4 mm to the left of the I's middle: the rest of a view of 18.6 mm is open, and so is what
    // one sees of the O's hole.
    let beyond = (9.3 - 4.0) / 18.6;
    let [plate_and_i, plate_and_o] = [(0, 0.0), (1, -12.0)].map(|(part, x)| touched(&alone, part, Side::Hole, x));
    assert!(plate_and_o < 0.99, "the O is in view");
    close(touched(&together, 0, Side::Hole, 0.0), plate_and_i + plate_and_o - 1.0 - beyond);
}

#[test]
fn connectors_on_a_board_stand_together_on_both_sides() {
    let written = Written::new();
    let text = |parts: &str| {
        format!(
            "[parts.connectors]\nnames = [\"usb-c\", \"hdmi\"]\n{parts}[board]\nsize_mm = [60.0, 20.0]\nspacing_mm = [20.0, 20.0]"
        )
    };
    let scene = written.load(&text("")).unwrap();
    assert_eq!(scene.reliefs(0, Side::Peg, 1).unwrap().len(), 2);
    let receptacles = scene.reliefs(0, Side::Hole, 1).unwrap();
    // Two shells and two tongues.
    assert_eq!((receptacles.len(), receptacles[0].layers.len()), (1, 4));
    written.refused(&text(&format!("{LETTERS}\n")), &["board", "either connectors"]);
    written.refused("[parts.connectors]\nnames = [\"usb-d\"]", &["usb-d", "usb-a"]);
    written.refused("[parts.connectors]\nnames = [\"usb-a\", \"usb-a\"]", &["parts", "'usb-a' twice"]);
}

#[test]
fn simple_bodies_are_parts_by_their_names() {
    let written = Written::new();
    let solids = |names: &str| format!("fidelity = \"geometry\"\n[parts.solids]\nnames = [{names}]");
    let scene = written.load(&solids("\"cylinder:6\", \"ring:8:5.0\", \"cuboid:10x4\", \"ball:4.70\"")).unwrap();
    assert_eq!(scene.part_names(), ["cylinder:6", "ring:8:5", "cuboid:10x4", "ball:4.7"]);
    let back: Scene = toml::from_str(&toml::to_string(&scene).unwrap()).unwrap();
    assert_eq!(back, scene);
    let simulator = Simulator::new(scene, 1).unwrap();
    let touched = |part, side| {
        let frame = simulator.touch(part, side, &Se2::IDENTITY, &mut frame_rng(1, 0)).unwrap();
        frame.rgb().iter().filter(|value| **value > 120).count() as f64 / frame.rgb().len() as f64
    };
    // Of a view of 18.6 x 14.3 mm; a pixel of 0.12 mm on either side of an outline is undecided.
    let view = 18.6 * 14.3;
    let areas = [std::f64::consts::PI * 9.0, std::f64::consts::PI * (16.0 - 6.25), 40.0];
    for (part, area) in areas.into_iter().enumerate() {
        assert!((touched(part, Side::Peg) * view / area - 1.0).abs() < 0.06, "{part}");
        assert!(touched(part, Side::Hole) < 1.0 - area / view, "{part}");
    }
    let round = (5.0 * 0.5_f64).powi(2) * std::f64::consts::PI / view;
    assert!((1.0 - touched(3, Side::Hole) - round).abs() < 0.06 * round, "the ball's opening, 0.15 mm wider all round");
    written.refused(&solids("\"cylinder:6\", \"cone:2\""), &["cone", "cylinder:6"]);
    written.refused(&solids("\"ball:4.7\", \"ball:4.70\""), &["'ball:4.7' twice"]);
}

#[test]
fn letters_of_another_font_digits_and_outlines_are_parts() {
    let written = Written::new();
    let letters = "[parts.letters]\nletters = \"A7\"\nfont = \"serif\"\nheight_mm = 12.0\nmax_width_mm = 16.0";
    let outlines = |text: &str| format!("{letters}\n[parts.outlines]\n{text}");
    let scene = written.load(&outlines("n = 3\nseed = 5\nsize_mm = [8.0, 14.0]")).unwrap();
    assert_eq!(scene.part_names(), ["A", "7", "blob-0", "polygon-1", "star-2"]);
    let sans = written.load(&letters.replace("font = \"serif\"", "")).unwrap();
    assert_ne!(sans.shape(0, 1).unwrap(), scene.shape(0, 1).unwrap());
    assert_eq!(scene.shape(3, 1).unwrap(), crate::scene::shape::outline::outline(5, 1, [8.0, 14.0]));
    written.refused(&outlines("n = 0\nseed = 5\nsize_mm = [8.0, 14.0]"), &["parts.outlines.n", "1 to 10000"]);
    written.refused(&outlines("n = 3\nseed = 5\nsize_mm = [14.0, 8.0]"), &["parts.outlines.size_mm", "in order"]);
    written.refused(&letters.replace("serif", "comic"), &["comic", "serif"]);
}

#[test]
fn maze_parts_that_cannot_be_are_named_with_their_field() {
    let written = Written::new();
    let parts = |text: &str| format!("[parts.maze_parts]\nseed = 5\n{text}");
    let good = "n = 12\nfirst = 24\nsize_mm = [8.0, 14.0]\nplay_mm = [0.1, 0.4]";
    let scene = written.load(&format!("{LETTERS}\n{}", parts(good))).unwrap();
    assert_eq!(scene.part_names()[1..4], ["B", "polygon-24", "star-25"]);
    let scene = written.load(&parts(good)).unwrap();
    assert!((0.1..=0.4).contains(&scene.opening(3).unwrap().1) && scene.clearance_mm == 0.15);
    for (from, to, named) in [
        ("n = 12", "n = 0", ["parts.maze_parts.n", "1 to 10000", "got 0"]),
        ("first = 24", "first = 1000001", ["parts.maze_parts.first", "0 to 1000000", "1000001"]),
        ("[8.0, 14.0]", "[14.0, 8.0]", ["parts.maze_parts.size_mm", "5 to 200 mm, in order", "14 to 8"]),
        ("[8.0, 14.0]", "[nan, 14.0]", ["parts.maze_parts.size_mm", "in order", "NaN to 14"]),
        (
            "n = 12",
            "n = 12\ncut_share = [0.2, 0.5]\nstretch_mm = [1.0, 2.0]",
            ["parts.maze_parts", "one of cut_share, bar_mm and stretch_mm", "2 of them"],
        ),
        (
            "n = 12",
            "n = 12\nstretch_mm = [2.0, 1.0]",
            ["parts.maze_parts.stretch_mm", "lengths of 0 to 20 mm, in order", "2 to 1"],
        ),
        (
            "n = 12",
            "n = 12\ncut_share = [0.2, 0.95]",
            ["parts.maze_parts.cut_share", "shares of the area", "0.2 to 0.95"],
        ),
        ("[0.1, 0.4]", "[-0.1, 0.4]", ["parts.maze_parts.play_mm", "0 to 5 mm, in order", "-0.1 to 0.4"]),
    ] {
        written.refused(&parts(&good.replace(from, to)), &named);
    }
    let taken = |range: &str| Scene::load(&format!("{}{range}", written.at("scene.toml").display()));
    written.load(&parts(good)).unwrap();
    assert_eq!(taken("#2+1").unwrap().part_names(), ["gear-26"]);
    for (range, named) in [
        ("#0+13", "scene.toml#0+13: parts.maze_parts: expected N at least 1, FIRST + N at most 12, got 0+13"),
        ("#12+1", "got 12+1"),
        ("#3+0", "got 3+0"),
        ("#3", "scene.toml#3: parts: expected #FIRST+N, such as #24+12, got #3"),
        ("#a+b", "got #a+b"),
        ("#-1+2", "got #-1+2"),
        ("#18446744073709551615+2", "FIRST + N at most 12"),
    ] {
        let error = taken(range).unwrap_err().to_string();
        assert!(error.contains(named) && !error.contains('\n'), "{error}");
    }
    let error = Scene::load("maze#0+12").unwrap_err().to_string();
    assert_eq!(error, "maze#0+12: parts: expected maze_parts to take some from, got none");
}

#[test]
fn a_file_whose_name_has_a_number_sign_is_read_as_it_is() {
    let written = Written::new();
    written.load(LETTERS).unwrap();
    std::fs::rename(written.at("scene.toml"), written.at("scene#1+2")).unwrap();
    assert_eq!(Scene::load(written.at("scene#1+2").to_str().unwrap()).unwrap().part_names(), ["A", "B"]);
}

#[test]
fn a_wrong_file_of_a_part_is_named_with_its_field() {
    let written = Written::new();
    let svg = "<svg xmlns='http://www.w3.org/2000/svg' width='9mm' height='9mm' viewBox='0 0 9 9'>";
    std::fs::write(written.at("open.svg"), format!("{svg}<path d='M0 0H9V9'/></svg>")).unwrap();
    std::fs::write(written.at("tie.svg"), format!("{svg}<path d='M0 0L9 9V0L0 9Z'/></svg>")).unwrap();
    std::fs::write(written.at("good.svg"), format!("{svg}<rect width='9' height='9'/></svg>")).unwrap();
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 9 0 0\nvertex 0 9 0\nendloop\nendfacet";
    let back = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 9 0\nvertex 9 0 0\nendloop\nendfacet";
    std::fs::write(written.at("hole.stl"), format!("solid a\n{facet}\nendsolid a\n")).unwrap();
    std::fs::write(written.at("flat.stl"), format!("solid a\n{facet}\n{back}\nendsolid a\n")).unwrap();
    image::GrayImage::new(4, 4).save(written.at("map.png")).unwrap();
    for (fields, named) in [
        ("peg = \"open.svg\"", ["parts.files[0].peg", "open.svg, element 1", "closed"].as_slice()),
        ("peg = \"tie.svg\"", &["parts.files[0].peg", "tie.svg", "cross"]),
        ("peg = \"good.svg\"\nhole = \"tie.svg\"", &["parts.files[0].hole", "tie.svg"]),
        ("peg = \"hole.stl\"", &["parts.files[0].peg", "hole.stl", "without holes"]),
        ("peg = \"flat.stl\"", &["parts.files[0].peg", "flat.stl", "height"]),
        ("peg = \"none.svg\"", &["parts.files[0].peg", "none.svg"]),
        ("peg = \"map.png\"\nmm_per_px = [0.1, 0.1]", &["map.png: full_scale_mm"]),
        ("peg = \"map.png\"\nmm_per_px = [0.1, 0.0]\nfull_scale_mm = 1.0", &["map.png", "size of a pixel"]),
        ("peg = \"map.png\"\nmm_per_level = 1.0\nfull_scale_mm = 1.0", &["parts.files[0]", "both"]),
        ("peg = \"good.svg\"\nmm_per_px = [0.1, 0.1]", &["parts.files[0].mm_per_px"]),
        ("peg = \"good.svg\"\nscale = 2.0", &["scale"]),
    ] {
        written.refused(&format!("[[parts.files]]\nname = \"mine\"\n{fields}"), named);
    }
    let twice = "[[parts.files]]\nname = \"A\"\npeg = \"good.svg\"";
    written.refused(&format!("{LETTERS}\n{twice}"), &["parts", "'A' twice"]);
}

#[test]
fn every_example_scene_loads_and_can_be_touched() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut n_scenes = 0;
    let files = [&folder, &folder.join("robust")].map(|folder| std::fs::read_dir(folder).unwrap());
    for entry in files.into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let mut scene = Scene::load(path.to_str().unwrap()).unwrap_or_else(|error| panic!("{error}"));
        scene.sensor.frame_px = [40, 30];
        let simulator = Simulator::new(scene, 1).unwrap();
        for side in [Side::Peg, Side::Hole] {
            let last = simulator.parts().len() - 1;
            simulator.touch(last, side, &Se2::IDENTITY, &mut frame_rng(1, 0)).unwrap();
        }
        n_scenes += 1;
    }
    assert!(n_scenes >= 15);
}

#[test]
fn far_too_many_parts_are_refused_with_what_they_would_take() {
    let written = Written::new();
    let solids = |n: usize| {
        let names: Vec<String> = (0..n).map(|i| format!("\"cylinder:{}\"", 4.0 + i as f64 * 1e-3)).collect();
        format!("[parts.solids]\nnames = [{}]", names.join(", "))
    };
    assert_eq!(written.load(&solids(1_000)).unwrap().part_names().len(), 1_000);
    let words = ["parts: expected at most 10000 parts, got 30000 parts and 540000 touches, which take", "GB of memory"];
    written.refused(&solids(30_000), &words);
}

#[test]
fn names_that_a_terminal_would_obey_are_refused() {
    let written = Written::new();
    let file = |name: &str| format!("[[parts.files]]\nname = \"{name}\"\npeg = \"a.svg\"");
    for name in ["a\\u001b[2J", "a\\u009b", "a\\u202eb", "a\\nb"] {
        written.refused(&file(name), &["a name for each part"]);
    }
    let scene = Scene { name: "a\u{7}".into(), ..Scene::preset("alphabet-small").unwrap() };
    assert!(scene.validate().unwrap_err().to_string().starts_with("name: expected a name without control characters"));
}

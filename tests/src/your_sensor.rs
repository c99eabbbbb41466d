//! The page `data/your-sensor`: from presses of a ball to a report, as a user pastes it.

use std::fs;

use serde_json::Value;
use tactile_data::light::calibrate::Calibration;
use tactile_data::pose::se2::wrap_angle;
use tactile_data::sensor::light::value;
use tactile_infer::Checkpoint;
use tactile_tests::programs::{run, workspace};

use crate::readme::commands;

/// What the test shortens of the page's commands: boards, pairs, steps of training, and episodes.
const SHORTER: [(&str, &str); 4] = [("12000", "48"), ("80", "3"), ("1500", "3"), ("100", "20")];

#[cfg(unix)]
#[test]
fn the_page_runs_from_presses_of_a_ball_to_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for name in ["data", "infer"] {
        std::os::unix::fs::symlink(workspace().join(name).canonicalize().unwrap(), at.join(name)).unwrap();
    }
    fs::create_dir_all(at.join("out/yours")).unwrap();
    let page = fs::read_to_string(workspace().join("data/your-sensor/README.md")).unwrap();
    let commands = commands(&page);
    assert_eq!(commands.len(), 20);
    for (long, _) in SHORTER {
        assert!(commands.iter().any(|(_, words)| words.iter().any(|word| word == long)), "{long}");
    }
    let mut said = String::new();
    for (program, words) in &commands {
        let shorter =
            |word: &str| SHORTER.iter().find(|(long, _)| *long == word).map_or(word.to_owned(), |(_, s)| (*s).into());
        let mut words: Vec<String> = words.iter().map(|word| shorter(word)).collect();
        if program == "tactile-train" {
            words.extend(["--batch", "32"].map(String::from));
        }
        let ran = run(program, at, &words.iter().map(String::as_str).collect::<Vec<_>>());
        said += ran.done();
        said += &ran.stderr;
    }
    the_light_is_the_stand_in_s(&at.join("out/yours/sensor.toml"));
    the_lamps_are_where_the_stand_in_s_are(&at.join("out/yours/sensor-by-touches.toml"));
    let by_parts = at.join("out/yours/sensor-by-parts.toml");
    the_lamps_are_where_the_stand_in_s_are(&by_parts);
    // The stand-in's gel, to a tenth or so.
    let gel = Calibration::load(&by_parts).unwrap().gel_length_mm.unwrap();
    assert!((gel / 1.4).ln().abs() < 0.15, "{gel}");
    // What counts is said.
    assert!(said.contains("touches with an edge, and as much as 2 from before"), "{said}");
    let shipped = Checkpoint::load(&workspace().join("infer/models/maze-small.safetensors")).unwrap().0;
    let mine = Checkpoint::load(&at.join("out/yours/model.safetensors")).unwrap().0;
    let (before, after) = (shipped.calibration.unwrap(), mine.calibration.unwrap());
    assert_eq!(after.prior.unwrap(), before.as_prior(2.0));
    assert!((5..=12).contains(&after.n_holes) && after.matched != before.matched, "{after:?}");
    let evaluation: Value =
        serde_json::from_slice(&fs::read(at.join("out/yours/worth/evaluation.json")).unwrap()).unwrap();
    assert_eq!(evaluation["recorded"], Value::from(true));
    // Of four parts, under lamps that the model does not know, by ten touches.
    let rows = evaluation["rows"].as_array().unwrap();
    let last = rows.iter().rfind(|row| row["method"] == "filter").unwrap();
    assert!(last["accuracy"].as_f64().unwrap() >= 0.9, "{last}");
}

/// The lamps found from touches shine from where the stand-in's do, all of them elsewhere than a Mini's.
fn the_lamps_are_where_the_stand_in_s_are(path: &std::path::Path) {
    let stand_in = workspace().join("data/your-sensor/stand-in.toml");
    let [found, truth] = [path.to_owned(), stand_in].map(|path| Calibration::load(path).unwrap().light);
    for channel in 0..3 {
        let [found, truth] = [&found, &truth].map(|of| {
            let [x, y] = [&of.along_x, &of.along_y].map(|part| f64::from(part[channel][0]));
            y.atan2(x)
        });
        let apart = wrap_angle(found - truth).to_degrees();
        assert!(apart.abs() < 15.0, "{channel}: {found} {truth}");
    }
}

/// The light that was fitted is the one that made the presses, which the page never reads again.
fn the_light_is_the_stand_in_s(path: &std::path::Path) {
    let stand_in = workspace().join("data/your-sensor/stand-in.toml");
    let [found, truth] = [path.to_owned(), stand_in].map(|path| Calibration::load(path).unwrap());
    for channel in 0..3 {
        let lamp = |of: &Calibration| {
            [&of.light.along_x, &of.light.along_y].map(|part| f64::from(value(&part[channel], 0.0, 0.0)))
        };
        let ([x, y], [x_found, y_found]) = (lamp(&truth), lamp(&found));
        assert!((x - x_found).hypot(y - y_found) < 0.1 * x.hypot(y), "{channel}: {x} {y}, {x_found} {y_found}");
    }
    assert!(found.leave_one_out.unwrap().correlation > 0.95);
}

//! Holes filled by the programs alone.

use std::fs;

use serde_json::Value;
use tactile_tests::programs::{Ran, run, workspace};
use tactile_tests::samples::{SCENE, Sample, text};

/// Runs the command with the sample's model.
fn assemble(sample: &Sample, bank: &str, scene: &str, out: &str, more: &[&str]) -> Ran {
    let with = ["assemble", "--model", "model/model.safetensors", "--bank", bank, "--scene", scene, "--out", out];
    run("tactile-filter", sample.folder(), &[&with[..], more].concat())
}

#[test]
fn an_assembly_counts_each_hole_and_comes_out_the_same_again() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first", "second"].map(|name| {
        let out = text(folder.path().join(name));
        let ran = assemble(&sample, "pegs.bank", "two.toml", &out, &["--trials", "4", "--seeds", "5,6", "--json"]);
        let printed: Value = serde_json::from_str(ran.done()).unwrap();
        let written = fs::read(folder.path().join(name).join("assembly.json")).unwrap();
        assert_eq!(printed, serde_json::from_slice::<Value>(&written).unwrap());
        printed
    });
    for key in ["all_inserted", "holes", "parts", "stops", "pegs_left", "failures", "model"] {
        assert_eq!(first[key], second[key], "{key}");
    }
    assert_eq!((&first["schema"], &first["n_trials"]), (&"tactile-filter/assembly/2".into(), &4.into()));
    assert_eq!(first["model"]["sha256"], sample.model_sha256.as_str());
    let count = |group: &Value, key: &str| group["inserted"][key].as_u64().unwrap();
    for key in ["parts", "stops", "pegs_left"] {
        let groups = first[key].as_array().unwrap();
        let sum = |of: &str| groups.iter().map(|group| count(group, of)).sum::<u64>();
        assert_eq!((sum("n"), sum("of")), (count(&first["holes"], "n"), 8), "{key}");
    }
    assert_eq!(first["failures"].as_array().unwrap().len() as u64, 8 - count(&first["holes"], "n"));
    let page = fs::read_to_string(folder.path().join("first/report.html")).unwrap();
    assert_eq!(page.matches("in hand<span").count(), 2, "a story for each hole of one trial");
}

#[test]
fn a_task_that_cannot_be_done_is_refused_before_it_begins() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("out"));
    let other = fs::read_to_string(sample.folder().join("two.toml")).unwrap().replace("\"TX\"", "\"TL\"");
    let other_scene = text(folder.path().join("other.toml"));
    fs::write(&other_scene, other).unwrap();
    for (scene, more, word) in [
        ("maze", &[][..], "expected parts whose pegs go into a hole: letters or files, got maze boards"),
        ("connectors", &[], "got the connector"),
        (&other_scene, &[], "bank: expected the scene's parts T L, got T X"),
        ("two.toml", &["--trials", "0"], "expected trials and seeds, got 0 trials"),
        ("two.toml", &["--grasp-error", "0.5", "-1"], "grasp-error, degrees: expected 0 to 180, got -1"),
        (
            "two.toml",
            &["--tries", "0"],
            "insertion: expected tries and poses, at least one, and a speed above zero, got 0 of 200",
        ),
        ("two.toml", &["--touch-s", "-1"], "--touch-s, --mm-s: expected seconds of a touch and a speed above zero"),
    ] {
        let ran = assemble(&sample, "pegs.bank", scene, &out, more);
        assert!(ran.failed().contains(word), "{ran:#?}");
    }
    assert!(!folder.path().join("out").exists());
}

/// Held 1 mm and 4 degrees off, pegs with a play of 0.3 mm go in where they are felt in the hand and slid along the plate, and rarely where
/// one of the two is left out.
#[test]
fn a_peg_that_is_felt_in_the_hand_and_slid_goes_in_tightly() {
    let folder = tempfile::tempdir().unwrap();
    let scene = SCENE
        .replace("\"TX\"", "\"LT\"\nheight_mm = 12.0\nmax_width_mm = 16.0")
        .replace("height_mm = 12.0\nmax_width_mm = 16.0\n\n", "\n")
        .replace("xy_step_mm = 4.0", "xy_step_mm = 2.0")
        .replace("theta_step_deg = 30.0", "theta_step_deg = 15.0");
    let scene = scene.split("[sensor]").next().unwrap();
    fs::write(folder.path().join("tight.toml"), format!("clearance_mm = 0.3\n{scene}")).unwrap();
    let model = text(workspace().join("infer/models/maze-small.safetensors"));
    let at = |program: &str, args: &[&str]| run(program, folder.path(), args);
    at("tactile-infer", &["bank", "--model", &model, "--scene", "tight.toml", "--out", "tight.bank"]).done();
    let inserted = |name: &str, more: &[&str]| -> u64 {
        let with = ["assemble", "--model", &model, "--bank", "tight.bank", "--scene", "tight.toml", "--out", name];
        let held = ["--trials", "8", "--seeds", "1", "--grasp-error", "1", "4", "--json"];
        let ran = at("tactile-filter", &[&with[..], &held, more].concat());
        let printed: Value = serde_json::from_str(ran.done()).unwrap();
        assert_eq!(printed["holes"]["wrong_part_went_in"], 0);
        printed["holes"]["inserted"]["n"].as_u64().unwrap()
    };
    let [both, unfelt, straight] = [
        inserted("both", &[]),
        inserted("unfelt", &["--peg-touches", "0"]),
        inserted("straight", &["--search", "1", "--tries", "1"]),
    ];
    assert!(both >= 15 && unfelt < both && straight < both, "{both} {unfelt} {straight} of 16");
    // A tilted plate, too.
    assert!(inserted("tilted", &["--tilt", "2"]) >= 14);
}

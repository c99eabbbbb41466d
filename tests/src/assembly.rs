//! Holes filled by the programs alone.

use std::fs;

use serde_json::Value;
use tactile_tests::programs::{Ran, run};
use tactile_tests::samples::{Sample, text};

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
    assert_eq!((&first["schema"], &first["n_trials"]), (&"tactile-filter/assembly/1".into(), &4.into()));
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
    ] {
        let ran = assemble(&sample, "pegs.bank", scene, &out, more);
        assert!(ran.failed().contains(word), "{ran:#?}");
    }
    assert!(!folder.path().join("out").exists());
}

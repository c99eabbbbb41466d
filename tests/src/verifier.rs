//! Maps of whole parts and the network that judges by them, from pegs to a picture and a file.

use std::fs;

use serde_json::Value;
use tactile_data::picture;
use tactile_infer::maps::MapFile;
use tactile_infer::maps::verifier::{Verifier, VerifierConfig};
use tactile_infer::{Bank, Model};
use tactile_tests::programs::run;
use tactile_tests::samples::Sample;

/// Five groups of twelve parts, the fewest of which one is held out.
const SCENE: &str = r#"
name = "sixty"

[parts.maze_parts]
n = 60
seed = 5
size_mm = [8.0, 16.0]

[reach]
xy_half_mm = 2.0
xy_step_mm = 2.0
theta_half_deg = 30.0
theta_step_deg = 30.0

[sensor]
frame_px = [80, 60]
"#;

#[test]
fn parts_have_maps_and_a_network_learns_to_judge_by_them() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (at, maze, model) = (folder.path(), sample.at("maze"), sample.at("model/model.safetensors"));
    fs::write(at.join("sixty.toml"), SCENE).unwrap();
    let draw = ["--data", &maze, "--maps", &model, "--out", "maps", "--steps", "3", "--batch", "4", "--set", "width=2"];
    run("tactile-train", at, &draw).done();
    let maps = "maps/maps.safetensors";

    // Of recorded pegs.
    let pegs = sample.at("pegs");
    let of_pegs = ["bank", "--model", &model, "--data", &pegs, "--maps", maps, "--out", "two.bank"];
    assert!(run("tactile-infer", at, &of_pegs).done().contains("a map of each part, "));
    let loaded = Model::load(model.as_ref()).unwrap();
    let bank = Bank::load(&at.join("two.bank"), &loaded).unwrap();
    let mosaics = bank.mosaics().unwrap();
    // 4 mm, and half the diagonal of 18.6 x 14.3 mm, either way.
    assert_eq!(mosaics.shape(), [2, 105, 105, 5]);
    assert_eq!(bank.with_parts(&[1]).unwrap().mosaics().unwrap().values(), &mosaics.values()[105 * 105 * 5..]);
    let picture = |more: &[&str]| {
        let given = ["mosaics", "--model", &model, "--bank", "two.bank", "--out", "two.png"];
        run("tactile-infer", at, &[&given, more].concat())
    };
    assert!(picture(&[]).done().contains("are inside the outline"));
    let drawn = picture::read(&at.join("two.png")).unwrap();
    assert_eq!([drawn.width_px(), drawn.height_px()], [4 * 105, 4 * 105]);
    assert!(picture(&["--part", "Q"]).failed().contains("one of T X"));
    let mut content = fs::read(at.join("two.bank")).unwrap();
    let last = content.len() - 1 - bank.n_rows() * bank.dim();
    content[last] ^= 1;
    fs::write(at.join("spoilt.bank"), content).unwrap();
    let said = Bank::load(&at.join("spoilt.bank"), &loaded).unwrap_err().to_string();
    assert!(said.contains("checksum") || said.contains("mosaics"), "{said}");

    let bank = |name: &str, more: &[&str]| {
        let given = ["bank", "--model", &model, "--scene", "sixty.toml", "--views", "pegs", "--learn-from", "nothing"];
        run("tactile-infer", at, &[&given, &["--out", name][..], more].concat()).done().to_owned()
    };
    bank("plain.bank", &[]);
    assert!(bank("sixty.bank", &["--maps", maps]).contains("a map of each part, "));
    let holes = ["generate", "--scene", "sixty.toml", "--sides", "hole", "--anywhere", "2", "--out", "holes"];
    run("tactile-data", at, &holes).done();
    let train = |touches: &str, more: &[&str]| {
        let given = ["--verifier", maps, "--model", &model, "--touches", touches, "--out", "judge"];
        run("tactile-train", at, &[&given, more].concat())
    };
    assert!(train("plain.bank=holes", &[]).failed().contains("tactile-infer bank --maps"));
    assert!(train("sixty.bank=holes", &["--set", "input_px=[40,30]"]).failed().contains("width, learning_rate"));
    assert!(train("sixty.bank", &[]).stderr.contains("parts.bank=holes"));
    assert!(!at.join("judge").exists());
    let few = ["--steps", "3", "--batch", "4", "--set", "width=2", "--json"];
    let outcome: Value = serde_json::from_str(train("sixty.bank=holes", &few).done()).unwrap();
    assert_eq!(outcome["step"], 3);
    let right = outcome["judgement"]["right"].as_f64().unwrap();
    assert!((0.0..=1.0).contains(&right), "{outcome}");
    assert!(train("sixty.bank=holes", &few).failed().contains("the maps of an earlier run"));
    let [before, after] = [maps, "judge/maps.safetensors"].map(|file| MapFile::load(&at.join(file)).unwrap());
    assert_eq!((before.verifier, after.verifier.map(|of| of.width)), (None, Some(2)));
    assert!(after.tensors.len() > before.tensors.len() && before.tensors.iter().all(|of| after.tensors.contains(of)));
    let verifier = Verifier::new(&after).unwrap().unwrap();
    assert_eq!(verifier.config(), &VerifierConfig { width: 2, bound: 8.0 });
}

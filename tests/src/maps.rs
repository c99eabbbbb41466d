//! The network that draws maps, from boards to a picture.

use std::cell::{Cell, RefCell};
use std::fs;

use serde_json::Value;
use tactile_data::dataset::store::Dataset;
use tactile_data::frame::picture;
use tactile_infer::maps::{MapConfig, MapFile};
use tactile_infer::{Checkpoint, DeviceKind};
use tactile_tests::programs::run;
use tactile_tests::samples::Sample;
use tactile_train::maps::{MapOutcome, MapRun, MapTraining, train_maps};
use tactile_train::output_folder::OutputFolder;

#[test]
fn maps_are_trained_and_drawn() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (at, maze, model) = (folder.path(), sample.at("maze"), sample.at("model/model.safetensors"));
    let train = |more: &str| {
        let given = ["--data", &maze, "--maps", &model, "--out", "maps"];
        run("tactile-train", at, &given.into_iter().chain(more.split_whitespace()).collect::<Vec<_>>())
    };
    let refused = |more: &str| train(more).failed().to_owned();
    assert!(refused("--set dim=8").contains("steps, batch, seed, width, input_px, learning_rate and save_every alone"));
    assert!(refused("--batch 1").contains("2 to 4096 touches"));
    assert!(!at.join("maps").exists());
    let trained = train("--steps 3 --batch 4 --set width=2 --set save_every=2 --json");
    let outcome: Value = serde_json::from_str(trained.done()).unwrap();
    assert_eq!(outcome["step"], 3);
    assert!(outcome["judgement"]["distance_mm"].as_f64().unwrap() > 0.0, "{outcome}");
    assert!(refused("--steps 1").contains("the maps of an earlier run"));
    let file = at.join("maps/maps.safetensors");
    let kept = MapFile::load(&file).unwrap();
    assert_eq!((kept.config, kept.provenance.steps), (MapConfig { input_px: [40, 30], width: 2 }, 3));

    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    picture::write_png(&at.join("touch.png"), &dataset.frame(0)).unwrap();
    let rest = sample.at("maze/no_contact.png");
    let map = |more: &str| {
        let given = ["map", "touch.png", "--maps", "maps/maps.safetensors", "--no-contact", &rest];
        run("tactile-infer", at, &given.into_iter().chain(more.split_whitespace()).collect::<Vec<_>>())
    };
    let drawn: Value = serde_json::from_str(map("--json --side peg").done()).unwrap();
    for values in ["distance_mm", "error_mm", "inside", "contact"] {
        assert_eq!(drawn[values].as_array().map(Vec::len), Some(40 * 30), "{values}");
    }
    assert!(map("--out map.png").done().contains("inside the peg's outline"));
    let picture = picture::read(&at.join("map.png")).unwrap();
    assert_eq!([picture.width_px(), picture.height_px()], [3 * 8 * 40, 8 * 30]);
    // Nothing that is read is written over.
    assert!(map("--out touch.png").failed().contains("touch.png"));
    assert!(map("").failed().contains("--out FILE.png, --json"));
    let other = run("tactile-infer", at, &["map", "touch.png", "--maps", &model, "--no-contact", &rest, "--json"]);
    assert!(other.failed().contains("tactile-filter/maps/1"), "{}", other.stderr);
}

#[test]
fn a_run_learns_stops_and_says_what_it_cannot_train_on() {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let (model, _) = Checkpoint::load(&sample.folder().join("model/model.safetensors")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let network = MapConfig { input_px: [24, 18], width: 4 };
    let training = MapTraining { network, n_steps: 60, batch: 8, save_every: 1_000, ..MapTraining::default() };
    let train = |name: &str, dataset: &Dataset, stop_after: usize| {
        let out = OutputFolder::claim(&folder.path().join(name), &[]).unwrap();
        let run = MapRun { dataset, model: &model, training: &training, device: DeviceKind::Flex, out: &out };
        let (made, losses) = (Cell::new(0), RefCell::new(Vec::new()));
        let outcome = train_maps(&run, &|| made.get() >= stop_after, &mut |step, loss, _| {
            made.set(step);
            losses.borrow_mut().push(loss);
        });
        outcome.map(|outcome| (outcome, losses.into_inner()))
    };
    let (MapOutcome { step, judgement, .. }, losses) = train("whole", &dataset, usize::MAX).unwrap();
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    assert_eq!((step, losses.len()), (60, 60));
    assert!(mean(&losses[50..]) < 0.8 * mean(&losses[..10]), "{losses:?}");
    assert!(judgement.inside > 0.0 && judgement.inside <= 1.0 && judgement.nats.is_finite(), "{judgement:?}");
    // As far as both went, the same.
    let (stopped, of_stopped) = train("stopped", &dataset, 4).unwrap();
    assert_eq!((stopped.step, &of_stopped[..]), (4, &losses[..4]));
    assert_eq!(MapFile::load(&stopped.file).unwrap().provenance.steps, 4);
    // Pegs that were touched on a grid hold no board out; what was recorded has no scene.
    let pegs = Dataset::open(&sample.folder().join("pegs")).unwrap();
    assert!(train("pegs", &pegs, 9).unwrap_err().to_string().contains("boards held out"));
    let copy = sample.copy("maze", folder.path());
    let about = fs::read_to_string(copy.join("meta.json")).unwrap();
    let mut about: Value = serde_json::from_str(&about).unwrap();
    about["scene"] = Value::Null;
    fs::write(copy.join("meta.json"), about.to_string()).unwrap();
    let recorded = Dataset::open(&copy).unwrap();
    assert!(train("recorded", &recorded, 9).unwrap_err().to_string().contains("a simulated dataset"));
}

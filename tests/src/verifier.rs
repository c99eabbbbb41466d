//! Maps of whole parts and the network that judges by them, from pegs to a picture and a file.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::picture;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::{Kit, Parts, Scene};
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_data::sensor::touch_map::{TouchMap, TouchMaps};
use tactile_filter::{
    Episode, EpisodeConfig, Estimate, Observation, Sensor, SensorMatch, Settings, StopReason, TouchModel, Warning,
};
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::simulated::mosaics::with_maps_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::calibration::presence::{Felt, Verified};
use tactile_infer::maps::mosaic::{Mosaics, Stitcher};
use tactile_infer::maps::verifier::{Verifier, VerifierConfig};
use tactile_infer::maps::{DrawnMap, MapFile, Maps};
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

/// Maps of a network that has hardly learnt, of the sample's boards, in a folder: its file.
const MAPS: &str = "maps/maps.safetensors";

fn train_maps(sample: &Sample, at: &Path) {
    let (maze, model) = (sample.at("maze"), sample.at("model/model.safetensors"));
    let draw = ["--data", &maze, "--maps", &model, "--out", "maps", "--steps", "3", "--batch", "4", "--set", "width=2"];
    run("tactile-train", at, &draw).done();
}

/// A file of the shipped networks.
fn shipped(name: &str) -> String {
    format!("{}/../infer/models/{name}.safetensors", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn recorded_parts_have_maps() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (at, model) = (folder.path(), sample.at("model/model.safetensors"));
    train_maps(&sample, at);
    let pegs = sample.at("pegs");
    let of_pegs = ["bank", "--model", &model, "--data", &pegs, "--maps", MAPS, "--out", "two.bank"];
    assert!(run("tactile-infer", at, &of_pegs).done().contains("a map of each part, "));
    let loaded = Model::load(model.as_ref()).unwrap();
    let bank = Bank::load(&at.join("two.bank"), &loaded).unwrap();
    let mosaics = bank.mosaics().unwrap();
    // 4 mm, and half the diagonal of 18.6 x 14.3 mm, either way.
    assert_eq!(mosaics.shape(), [1, 2, 105, 105, 5]);
    assert_eq!(bank.with_parts(&[1]).unwrap().mosaics().unwrap().values(), &mosaics.values()[105 * 105 * 5..]);
    let picture = |more: &[&str]| {
        let given = ["mosaics", "--model", &model, "--bank", "two.bank", "--out", "two.png"];
        run("tactile-infer", at, &[&given, more].concat())
    };
    assert!(picture(&[]).done().contains("are inside the outline"));
    let drawn = picture::read(&at.join("two.png")).unwrap();
    assert_eq!([drawn.width_px(), drawn.height_px()], [4 * 105, 4 * 105]);
    assert!(picture(&["--part", "Q"]).failed().contains("one of T X"));
    // An evaluation draws its touches, too; a bank without maps is of no use to it.
    let evaluate = |bank: &str| {
        let two = sample.at("two.toml");
        let given = ["evaluate", "--model", &model, "--bank", bank, "--scene", &two, "--maps", MAPS, "--episodes", "2"];
        let more =
            ["--touches", "2", "--engines", "exact", "--actions", "random", "--stories", "0", "--out", "evaluation"];
        run("tactile-filter", at, &[&given[..], &more].concat())
    };
    evaluate("two.bank").done();
    assert!(evaluate(&sample.at("pegs.bank")).failed().contains("a bank with a map of each part"));
    recorded_touches_show_what_was_felt(at, &sample);
    let mut content = fs::read(at.join("two.bank")).unwrap();
    let last = content.len() - 1 - bank.n_rows() * bank.dim();
    content[last] ^= 1;
    fs::write(at.join("spoilt.bank"), content).unwrap();
    let said = Bank::load(&at.join("spoilt.bank"), &loaded).unwrap_err().to_string();
    assert!(said.contains("checksum") || said.contains("mosaics"), "{said}");
}

/// Replayed and live, touches are drawn, stitched and held against the named part.
fn recorded_touches_show_what_was_felt(at: &Path, sample: &Sample) {
    let (model, holes) = (sample.at("model/model.safetensors"), sample.at("holes"));
    let filter = |given: &[&str]| run("tactile-filter", at, given);
    let replay = |bank: &str, more: &[&str]| {
        let given = ["replay", "--model", &model, "--bank", bank, "--data", &holes, "--set", "false_accept=none"];
        filter(&[&given[..], &["--limit", "2"], more].concat())
    };
    let felt = replay("two.bank", &["--maps", MAPS, "--felt", "felt"]);
    assert!(felt.done().contains(" mm2 felt, "), "{felt:?}");
    for episode in ["felt/episode-0.png", "felt/episode-1.png"] {
        let drawn = picture::read(&at.join(episode)).unwrap();
        // 18.6 x 14.3 mm and more, three pixels to 0.3 mm.
        assert!(drawn.width_px() > 186 && drawn.width_px() == drawn.height_px(), "{}", drawn.width_px());
    }
    let line = replay("two.bank", &["--maps", MAPS, "--json"]);
    let said: Value = serde_json::from_str(line.done().lines().next().unwrap()).unwrap();
    assert!(said["difference"]["seen_mm2"].as_f64().unwrap() > 100.0, "{said}");
    assert!(replay(&sample.at("pegs.bank"), &["--maps", MAPS]).failed().contains("a bank with a map of each part"));
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../infer/models/maze-small.maps.safetensors");
    assert!(
        replay("two.bank", &["--maps", shipped]).failed().contains("maps: expected pictures as the model sees them")
    );
    assert!(replay("two.bank", &["--felt", "felt"]).stderr.contains("--maps"));
    assert!(!replay("two.bank", &[]).done().contains("mm2"));

    // A log is of the networks that drew.
    let (two, with) = (sample.at("two.toml"), ["--maps", MAPS]);
    let inputs = ["--model", &model, "--bank", "two.bank"];
    let live = ["--simulate", &two, "--fast", "--episodes", "1", "--log", "maps.mcap"];
    filter(&[&["live"], &inputs[..], &with, &live].concat()).done();
    let log = |more: &[&str]| filter(&[&["replay"], &inputs[..], more, &["--log", "maps.mcap"]].concat());
    assert!(log(&with).done().contains("touch"));
    assert!(log(&[]).failed().contains("maps of log maps.mcap"));
}

#[test]
fn a_network_learns_to_judge_by_maps() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (at, model) = (folder.path(), sample.at("model/model.safetensors"));
    fs::write(at.join("sixty.toml"), SCENE).unwrap();
    train_maps(&sample, at);
    let bank = |name: &str, more: &[&str]| {
        let given = ["bank", "--model", &model, "--scene", "sixty.toml", "--views", "pegs", "--learn-from", "nothing"];
        run("tactile-infer", at, &[&given, &["--out", name][..], more].concat()).done().to_owned()
    };
    bank("plain.bank", &[]);
    assert!(bank("sixty.bank", &["--maps", MAPS]).contains("a map of each part, "));
    let holes = ["generate", "--scene", "sixty.toml", "--sides", "hole", "--anywhere", "2", "--out", "holes"];
    run("tactile-data", at, &holes).done();
    let train = |touches: &str, more: &[&str]| {
        let given = ["--verifier", MAPS, "--model", &model, "--touches", touches, "--out", "judge"];
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
    let [before, after] = [MAPS, "judge/maps.safetensors"].map(|file| MapFile::load(&at.join(file)).unwrap());
    assert_eq!((before.verifier, after.verifier.map(|of| of.width)), (None, Some(2)));
    assert!(after.tensors.len() > before.tensors.len() && before.tensors.iter().all(|of| after.tensors.contains(of)));
    let verifier = Verifier::new(&after).unwrap().unwrap();
    assert_eq!(verifier.config(), &VerifierConfig { width: 2, bound: 8.0 });
    strangers_are_told_from_parts(at, &model);
}

/// From episodes with strangers and without to a verifier that says how sure a name is.
fn strangers_are_told_from_parts(at: &Path, model: &str) {
    const JUDGE: &str = "judge/maps.safetensors";
    let three = "sixty.toml#0+3";
    let bank = ["bank", "--model", model, "--scene", three, "--learn-from", "nothing", "--maps", JUDGE, "--out"];
    run("tactile-infer", at, &[&bank[..], &["three.bank"]].concat()).done();
    let bank = Bank::load(&at.join("three.bank"), &Model::load(model.as_ref()).unwrap()).unwrap();
    let expected = bank.expected().unwrap();
    let mosaics = bank.mosaics().unwrap();
    assert_eq!(mosaics.sides(), [Side::Peg, Side::Hole]);
    assert_eq!([Side::Peg, Side::Hole].map(|side| mosaics.of(2, side).side()), [Side::Peg, Side::Hole]);
    assert_ne!(mosaics.of(2, Side::Peg).at([0.3, 0.6]), mosaics.of(2, Side::Hole).at([0.3, 0.6]));
    assert_eq!(
        bank.with_parts(&[2]).unwrap().mosaics().unwrap().of(0, Side::Hole).at([0.3, 0.6]),
        mosaics.of(2, Side::Hole).at([0.3, 0.6])
    );
    assert!(expected.holes.iter().chain(&expected.pegs).all(Option::is_some), "{expected:?}");
    assert_eq!(expected.of(1, Side::Peg), expected.pegs[1]);
    let evaluate = |maps: &str, out: &str, more: &[&str]| {
        let given = ["evaluate", "--model", model, "--bank", "three.bank", "--scene", three, "--maps", maps];
        let ways = ["--poses", "off-grid", "--engines", "exact", "--actions", "random", "--touches", "3"];
        let to = ["--set", "stop_probability=0.4", "--shard", "1/1", "--out", out];
        run("tactile-filter", at, &[&given[..], &ways, &to, more].concat())
    };
    let no_fit = "holes are touched, for which these maps have no fit";
    let there = evaluate(JUDGE, "there", &["--episodes", "120"]);
    assert!(there.done().contains("episodes 0..120") && there.stderr.contains(no_fit), "{there:?}");
    evaluate(JUDGE, "strangers", &["--episodes", "120", "--absent", "--drawn-sensor", "3", "--drawn-light", "3"])
        .done();
    let certify = |more: &[&str]| run("tactile-filter", at, &[&["certify", "there"], more].concat());
    assert!(
        certify(&["--maps", JUDGE]).failed().contains("100 or more with strangers (--absent), and as many without")
    );
    assert!(certify(&["strangers", "--maps", MAPS]).failed().contains("the episodes' verifier: expected no verifier"));
    assert!(certify(&["strangers"]).stderr.contains("--model"));
    let said = certify(&["strangers", "--maps", JUDGE, "--out", "certified.safetensors"]);
    assert!(said.done().contains("120 episodes with strangers, 120 with parts that are there"));
    assert!(
        said.stderr.contains("3 strangers of sixty, the hardest kind, certify no rate below 25.00 %"),
        "{}",
        said.stderr
    );
    let odds = MapFile::load(&at.join("certified.safetensors")).unwrap().presence[2].unwrap();
    assert!(odds.by_verifier != 0.0 && odds.n_parts == 2.0 && odds.n_strangers == 120, "{odds:?}");
    let of_model = ["strangers", "--model", model, "--out", "certified-model.safetensors"];
    certify(&of_model).done();
    let stored = Model::load(&at.join("certified-model.safetensors")).unwrap();
    let stored = stored.presence(Side::Hole).unwrap();
    assert!(stored.by_verifier == 0.0 && stored.by_touch != odds.by_touch, "{stored:?}");
    // What is stored decides: the same episodes with other odds of a part that is there.
    let again = evaluate("certified.safetensors", "again", &["--episodes", "12"]);
    assert!(again.done().contains("episodes 0..12") && !again.stderr.contains(no_fit), "{again:?}");
    let presence = |folder: &str| {
        let text = fs::read_to_string(at.join(folder).join("shard-1-of-1.json")).unwrap();
        let shard: Value = serde_json::from_str(&text).unwrap();
        shard["runs"][0]["outcomes"][0]["scored"][2]["presence"].clone()
    };
    assert_ne!(presence("again"), presence("there"));
    assert!(evaluate(MAPS, "other", &["--episodes", "2"]).done().contains("episodes 0..2"));
    let others = ["bank", "--model", model, "--scene", three, "--maps", MAPS, "--out", "plain.bank"];
    run("tactile-infer", at, &others).done();
}

/// The maps that a perfect network would draw.
fn perfect(maps: &TouchMaps<'_>, side: Side, pose: &Se2, view_mm: [f64; 2]) -> DrawnMap {
    let TouchMap { size_px, distance_mm, contact } = maps.of(1, side, pose, [40, 30]).unwrap();
    let inside = distance_mm.iter().map(|mm| if *mm < 0.0 { 1.0 } else { 0.0 }).collect();
    DrawnMap { size_px, view_mm, error_mm: vec![0.1; distance_mm.len()], inside, contact, distance_mm }
}

#[test]
fn a_place_is_found_by_the_maps_of_touches_and_part() {
    let model = Arc::new(
        Model::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../infer/models/maze-small.safetensors").as_ref()).unwrap(),
    );
    let reach = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };
    let mut scene = Scene { reach: Some(reach), ..Scene::load("alphabet-small").unwrap() };
    scene.parts = Parts::Kit(Kit::of_letters("TF", 12.0, 16.0));
    let bank = bank_of_scene(&model, &scene, Views::Both, 1, &|_, _| ()).unwrap();
    let simulator = Simulator::new(scene, 1).unwrap();
    let sensor = Sensor::new(model.clone(), &simulator.no_contact(7)).unwrap();
    let view_mm = simulator.scene().sensor.field_of_view_mm;
    let maps = TouchMaps::new(&simulator);
    let mut stitchers = vec![Stitcher::new(16.0), Stitcher::new(16.0)];
    for pose in (0..reach.len()).step_by(3).map(|cell| reach.pose(cell)) {
        stitchers.iter_mut().for_each(|of| of.add(&perfect(&maps, Side::Peg, &pose, view_mm), &pose));
    }
    let bank = Arc::new(bank.with_mosaics(Mosaics::stitched(&stitchers, None).unwrap()).unwrap());
    let (truth, moved) = (Se2::from_degrees(1.1, -0.7, 8.0), Se2::from_degrees(-1.5, 2.0, 10.0));
    let play = |has_maps: bool| {
        let touch = |pose: Se2, n: u64| {
            let frame = simulator.touch(1, Side::Hole, &pose, &mut frame_rng(5, n)).unwrap();
            let map = has_maps.then(|| Box::new(perfect(&maps, Side::Hole, &pose, view_mm)));
            Observation { map, ..sensor.observe(&frame).unwrap() }
        };
        let mut episode = Episode::begin(EpisodeConfig::of(&model), bank.clone(), &touch(truth, 1)).unwrap();
        episode.observe(moved, &touch(truth * moved, 2)).unwrap();
        episode
    };
    let [by_belief, by_maps] = [false, true].map(|has_maps| play(has_maps).estimate());
    let off = |found: &Estimate| found.part_from_first.distance_mm(&truth);
    assert_eq!([&by_belief.part, &by_maps.part], ["F"; 2]);
    assert!(off(&by_maps) < 0.06 && off(&by_maps) < off(&by_belief), "{} {}", off(&by_maps), off(&by_belief));
    let [sd, before] = [&by_maps, &by_belief].map(|of| of.covariance[0][0].sqrt());
    assert!(sd < before && off(&by_maps) < 4.0 * sd, "{sd} {before}");
    let last = by_maps.part_from_first * moved;
    assert!(by_maps.part_from_sensor.distance_mm(&last) < 1e-9);
    // All else is as it was.
    let (part_from_first, part_from_sensor) = (by_belief.part_from_first, by_belief.part_from_sensor);
    let covariance = by_belief.covariance;
    assert_eq!(Estimate { part_from_first, part_from_sensor, covariance, ..by_maps.clone() }, by_belief);

    // Saved and restored, it says the same; a spoilt map is refused.
    let record = serde_json::to_string(&play(true).record().unwrap()).unwrap();
    let restored = Episode::restore(&serde_json::from_str(&record).unwrap(), bank.clone()).unwrap();
    assert_eq!(restored.estimate(), by_maps);
    let mut spoilt: Value = serde_json::from_str(&record).unwrap();
    spoilt["touches"][0][1]["map"]["error_mm"][3] = 0.0.into();
    let record = serde_json::from_value(spoilt).unwrap();
    assert!(Episode::restore(&record, bank).unwrap_err().to_string().contains("each error above 0"));
}

/// A bank of two letters with maps, and touches of the first one's hole.
fn two_letters(maps: &Maps, side: Side) -> (EpisodeConfig, Arc<Bank>, impl Fn(Se2, u64) -> Observation + use<>) {
    let model = Model::load(shipped("maze-small").as_ref()).unwrap().with_maps(maps.clone()).unwrap();
    let model = Arc::new(model);
    let reach = PoseGrid { xy_half_mm: 12.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 45.0 };
    let mut scene = Scene { reach: Some(reach), ..Scene::load("alphabet-small").unwrap() };
    scene.parts = Parts::Kit(Kit::of_letters("TF", 6.0, 6.0));
    let bank = bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ()).unwrap();
    let bank = with_maps_of_scene(bank, maps, (&scene, Views::Pegs), 1, &|_, _| ()).unwrap();
    let simulator = Simulator::new(scene, 1).unwrap();
    let sensor = Sensor::new(model.clone(), &simulator.no_contact(7)).unwrap().of_side(side);
    let touch = move |pose: Se2, n: u64| {
        sensor.observe(&simulator.touch(0, side, &pose, &mut frame_rng(5, n)).unwrap()).unwrap()
    };
    (EpisodeConfig::of_side(&model, side), Arc::new(bank), touch)
}

#[test]
fn a_verifier_says_nothing_of_a_touch_without_an_edge() {
    let (config, bank, touch) = two_letters(&Maps::load(shipped("maze-small.maps").as_ref()).unwrap(), Side::Hole);
    // Two touches next to the letter, then one on it.
    let (aside, moved) = (Se2::new(12.0, 12.0, 0.0), Se2::new(-24.0, 0.0, 0.0));
    let mut episode = Episode::begin(config, bank, &touch(aside, 1)).unwrap();
    episode.observe(moved, &touch(aside * moved, 2)).unwrap();
    let blank = episode.estimate();
    let verified = blank.verified.unwrap();
    assert_eq!((verified.log_odds, verified.n_new, blank.presence), (0.0, 0.0, None));
    let on_it = Se2::new(12.0, -12.0, 0.0);
    episode.observe(on_it, &touch(aside * moved * on_it, 3)).unwrap();
    let found = episode.estimate();
    let verified = found.verified.unwrap();
    assert!(verified.n_new > 0.5 && verified.n_new <= 1.0 && verified.log_odds.abs() <= 8.0, "{verified:?}");
    assert!(found.presence.is_some() && found.part == "T", "{}", found.part);
}

#[test]
fn a_run_learns_what_its_sensor_shows() {
    let maps = Maps::load(shipped("maze-small.maps").as_ref()).unwrap();
    let (config, bank, touch) = two_letters(&maps, Side::Peg);
    // What is said of it: one touch next to a quarter of one.
    let mut eager = config;
    eager.settings = Settings { stop_probability: 0.3, false_accept: None, ..Settings::default() };
    let first = Episode::begin(eager, bank.clone(), &touch(Se2::IDENTITY, 4)).unwrap();
    let found = first.estimate();
    let verified = found.verified.unwrap();
    let part = bank.parts().iter().position(|part| *part == found.part).unwrap();
    let odds = *maps.verifier().unwrap().presence(Side::Peg, Side::Peg).unwrap();
    let expected = bank.expected().unwrap().of(part, Side::Peg).map_or(odds.usual, |expected| expected.mean);
    let known = first.learn();
    assert_eq!((known.n_holes, verified.n_new), (1, 1.0));
    assert!((known.verifier.nats - (verified.log_odds - expected) / 1.25).abs() < 1e-9, "{known:?} {verified:?}");
    // How much larger the part seems is as likely the sensor's, where that is 0.02 and the touch as unsure.
    let seems = verified.strain.unwrap();
    let ([x, y, _], [[xx, xy, _], [_, yy, _], _]) = (seems.mean, seems.covariance);
    let informed = 4.0 / (xx + 2.0 * xy + yy);
    let shared = 0.5 * (x + y) * informed / (informed + 0.02_f64.powi(-2));
    let learnt = known.strain;
    assert!((learnt.mean - shared).abs() < 1e-12 && (learnt.information - informed).abs() < 1e-6, "{known:?}");
    // It is taken off, and half of what is said; what is felt stays, but for how far off it is.
    let sensor = SensorMatch { n_holes: 1, offset: 0.0, weight: 0.0, squares: 0.0, ..known };
    let [none, learnt] = [SensorMatch { n_holes: 1, ..SensorMatch::default() }, sensor].map(|sensor| {
        let found =
            Episode::begin(eager.with_sensor(sensor), bank.clone(), &touch(Se2::IDENTITY, 4)).unwrap().estimate();
        assert_eq!(found.verified.map(|felt| Verified { misfit: verified.misfit, ..felt }), Some(verified));
        let felt = Felt { fit: found.fit.unwrap(), n_fitted: found.n_fitted, verified: found.verified };
        (felt, found.presence.unwrap().log_odds)
    });
    assert!((odds.log_odds(&none.0) - none.1).abs() < 1e-9);
    let felt = learnt.0.verified.unwrap();
    assert!(none.0.verified == Some(verified) && felt.misfit < verified.misfit, "{felt:?} {verified:?}");
    let less = Verified {
        log_odds: verified.log_odds - 0.5 * known.verifier.nats,
        strain: Some(seems.without(known.strain.mean)),
        ..felt
    };
    assert!((odds.log_odds(&Felt { verified: Some(less), ..learnt.0 }) - learnt.1).abs() < 1e-9);
}

#[test]
fn networks_with_a_fit_for_raised_parts_alone_leave_holes_to_the_cosines() {
    let fits = [(Side::Peg, Side::Peg), (Side::Hole, Side::Peg), (Side::Hole, Side::Hole)];
    let fitted = |maps: &Maps| fits.map(|(touched, on)| maps.verifier().unwrap().presence(touched, on).copied());
    let file = MapFile::load(shipped("maze-small.maps").as_ref()).unwrap();
    let [raised, on_pegs, on_holes] = fitted(&Maps::new(&file).unwrap());
    assert!(raised.is_some() && on_pegs.is_some() && on_holes.is_some());
    let bare = MapFile { presence: [None; 3], ..file };
    let maps = Maps::new(&bare.with_presence((Side::Peg, Side::Peg), raised.unwrap())).unwrap();
    assert_eq!(fitted(&maps), [raised, None, None]);
    let (config, bank, touch) = two_letters(&maps, Side::Hole);
    let found = Episode::begin(config, bank, &touch(Se2::IDENTITY, 4)).unwrap().estimate();
    let model = Model::load(shipped("maze-small").as_ref()).unwrap();
    let felt = Felt { fit: found.fit.unwrap(), n_fitted: found.n_fitted, verified: None };
    let by_cosines = model.presence(Side::Hole).unwrap().log_odds(&felt);
    assert!(found.verified.is_some() && (found.presence.unwrap().log_odds - by_cosines).abs() < 1e-9, "{found:?}");
}

#[test]
fn another_size_is_told_with_how_much_it_is() {
    let maps = Maps::load(shipped("maze-small.maps").as_ref()).unwrap();
    let model = Model::load(shipped("maze-small").as_ref()).unwrap().with_maps(maps.clone()).unwrap();
    let model = Arc::new(model);
    let near = "[reach]\nxy_half_mm = 4.0\nxy_step_mm = 2.0\ntheta_half_deg = 15.0\ntheta_step_deg = 15.0\n";
    let folder = tempfile::tempdir().unwrap();
    let scene = |lengths_mm: &[usize]| {
        let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/scenes");
        let bar =
            |mm: &usize| format!("[[parts.files]]\nname = \"bar-{mm}x4\"\npeg = \"{scenes}/sizes/bar-{mm}x4.svg\"\n");
        let bars: String = lengths_mm.iter().map(bar).collect();
        let file = folder.path().join("bars.toml");
        fs::write(&file, format!("name = \"bars\"\n{bars}{near}")).unwrap();
        Scene::load(file.to_str().unwrap()).unwrap()
    };
    // Bars 11 and 12 mm long are known; 12 and 14 mm ones are touched at their ends and in between.
    let known = scene(&[11, 12]);
    let bank = bank_of_scene(&model, &known, Views::Pegs, 1, &|_, _| ()).unwrap();
    let bank = Arc::new(with_maps_of_scene(bank, &maps, (&known, Views::Pegs), 1, &|_, _| ()).unwrap());
    let found = |length_mm: usize| {
        let simulator = Simulator::new(scene(&[length_mm]), 1).unwrap();
        let sensor = Sensor::new(model.clone(), &simulator.no_contact(7)).unwrap().of_side(Side::Peg);
        let touch = |pose: Se2, n: u64| {
            sensor.observe(&simulator.touch(0, Side::Peg, &pose, &mut frame_rng(5, n)).unwrap()).unwrap()
        };
        let poses = [[1.0, 0.5, 4.0], [-3.0, 1.0, -8.0], [3.0, -1.0, 10.0], [0.0, -2.0, 0.0]];
        let poses = poses.map(|[x, y, deg]| Se2::from_degrees(x, y, deg));
        let config = EpisodeConfig::of_side(&model, Side::Peg);
        let mut episode = Episode::begin(config, bank.clone(), &touch(poses[0], 1)).unwrap();
        for (n, pair) in (2..).zip(poses.windows(2)) {
            episode.observe(pair[0].inverse() * pair[1], &touch(pair[1], n)).unwrap();
        }
        episode.estimate()
    };
    let size = |of: &Estimate| of.warnings.iter().find(|warning| matches!(warning, Warning::OtherSize { .. })).cloned();
    let there = found(12);
    assert_eq!((there.part.as_str(), there.stop, size(&there)), ("bar-12x4", Some(StopReason::Confident), None));
    let stranger = found(14);
    let Some(Warning::OtherSize { longer: [along_x, along_y], sd }) = size(&stranger) else { panic!("{stranger:?}") };
    // Within 0.6 mm: a drawn pixel is 0.47 mm wide.
    assert!((along_x - 2.0 / 12.0).abs() < 0.6 / 12.0 && along_y.abs() < 0.08, "{along_x} {along_y}");
    assert!((0.002..0.04).contains(&sd[0]) && along_x > 4.0 * sd[0], "{sd:?}");
    let said = size(&stranger).unwrap().to_string();
    assert!(said.starts_with("what was felt is not of that part's size: +1"), "{said}");
}

#[test]
fn maps_are_in_millimetres_under_any_view() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // The Mini's view, one that is a fifth smaller, the SDK's.
    for (width, height) in [(18.6, 14.3), (14.9, 11.4), (20.3, 15.2)] {
        let scene = format!(
            "name = \"bar\"\n\n[parts.solids]\nnames = [\"cuboid:10x6\"]\n\n[reach]\nxy_half_mm = 4.0\nxy_step_mm = 4.0\n\
             theta_half_deg = 0.0\ntheta_step_deg = 45.0\n\n[sensor]\nfield_of_view_mm = [{width}, {height}]\n"
        );
        fs::write(at.join("bar.toml"), scene).unwrap();
        let (model, maps) = (shipped("maze-small"), shipped("maze-small.maps"));
        let given = ["bank", "--model", &model, "--maps", &maps, "--scene", "bar.toml", "--views", "pegs"];
        run("tactile-infer", at, &[&given[..], &["--learn-from", "nothing", "--out", "bar.bank"]].concat()).done();
        let bank = Bank::load(&at.join("bar.bank"), &Model::load(model.as_ref()).unwrap()).unwrap();
        let outline = bank.mosaics().unwrap().of(0, Side::Peg).outline_mm();
        // How far each place is from a rectangle of 10 x 6 mm.
        let off = outline.iter().map(|[x, y]| {
            let [x, y] = [x.abs() - 5.0, y.abs() - 3.0];
            x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
        });
        let mean = off.sum::<f64>() / outline.len() as f64;
        assert!(outline.len() > 60 && mean.abs() < 0.2, "{width} mm: {mean} mm off, {} places", outline.len());
        fs::remove_file(at.join("bar.bank")).unwrap();
    }
}

/// Letters that a robot knows, and one that it does not, touched near their middle.
const REACH: &str = r"
height_mm = 12.0
max_width_mm = 16.0

[reach]
xy_half_mm = 8.0
xy_step_mm = 4.0
theta_half_deg = 45.0
theta_step_deg = 15.0

[sensor]
frame_px = [160, 120]
";

#[test]
fn a_stranger_that_is_refused_is_known_once_it_is_learnt() {
    let (model, maps) = (shipped("maze-small"), shipped("maze-small.maps"));
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (name, letters) in [("known", "TLX"), ("stranger", "D")] {
        let scene = format!("name = \"{name}\"\n\n[parts.letters]\nletters = \"{letters}\"{REACH}");
        fs::write(at.join(format!("{name}.toml")), scene).unwrap();
    }
    let bank = |scene: &str, out: &str| {
        let steps = ["--xy-step-mm", "2", "--learn-from", "nothing"];
        let given = ["bank", "--model", &model, "--maps", &maps, "--scene", scene, "--out", out];
        run("tactile-infer", at, &[&given[..], &steps].concat()).done().to_owned()
    };
    assert!(bank("known.toml", "known.bank").contains("a map of each peg and of each hole"));
    let touch = |seed: &str, out: &str| {
        let given = ["generate", "--scene", "stranger.toml", "--sides", "hole", "--anywhere", "8", "--seed", seed];
        run("tactile-data", at, &[&given[..], &["--out", out]].concat()).done();
    };
    touch("1", "today");
    touch("2", "tomorrow");
    let replay = |bank: &str, data: &str, more: &[&str]| {
        let given = ["replay", "--model", &model, "--bank", bank, "--maps", &maps, "--data", data, "--json"];
        let ran = run("tactile-filter", at, &[&given[..], more].concat());
        let line = ran.done().lines().find(|line| line.starts_with('{')).unwrap().to_owned();
        (serde_json::from_str::<Value>(&line).unwrap(), ran)
    };
    let learn = ["--learn", "learnt", "--scene", "known.toml"];
    let (today, said) = replay("known.bank", "today", &learn);
    assert_eq!(today["stop"], "none-of-these", "{said:?}");
    assert!(said.done().contains("learnt-1, "), "{said:?}");
    let scene = Scene::load(at.join("learnt/scene.toml").to_str().unwrap()).unwrap();
    assert_eq!(scene.part_names(), ["T", "L", "X", "learnt-1"]);
    let given = ["replay", "--model", &model, "--bank", "known.bank", "--maps", &maps, "--data", "today"];
    assert!(
        run("tactile-filter", at, &[&given[..], &learn].concat()).failed().contains("learnt: expected a new folder")
    );
    bank("learnt/scene.toml", "learnt.bank");
    let (tomorrow, said) = replay("learnt.bank", "tomorrow", &[]);
    assert_eq!((&tomorrow["part"], &tomorrow["confident"]), (&"learnt-1".into(), &true.into()), "{said:?}");
}

#[test]
fn known_touches_tell_what_a_verifier_says_of_a_sensor() {
    let (model, maps) = (shipped("maze-small"), shipped("maze-small.maps"));
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let scene = |depth_mm: f64| {
        format!(
            "name = \"two\"\n[parts.letters]\nletters = \"TF\"\nheight_mm = 12.0\nmax_width_mm = 16.0\n[reach]\n\
             xy_half_mm = 4.0\nxy_step_mm = 2.0\ntheta_half_deg = 15.0\ntheta_step_deg = 15.0\n[sensor]\ndepth_mm = {depth_mm}\n"
        )
    };
    fs::write(at.join("two.toml"), scene(0.9)).unwrap();
    fs::write(at.join("deep.toml"), scene(4.0)).unwrap();
    let given = ["bank", "--model", &model, "--scene", "two.toml", "--views", "pegs", "--learn-from", "nothing"];
    run("tactile-infer", at, &[&given[..], &["--out", "plain.bank"]].concat()).done();
    run("tactile-infer", at, &[&given[..], &["--maps", &maps, "--out", "two.bank"]].concat()).done();
    for (scene, out) in [("two.toml", "usual"), ("deep.toml", "other")] {
        let given = ["generate", "--scene", scene, "--sides", "peg", "--anywhere", "12", "--seed", "5", "--out", out];
        run("tactile-data", at, &given).done();
    }
    let calibrate = |bank: &str, holes: &str, more: &[&str]| {
        let given = ["calibrate", "--model", &model, "--bank", bank, "--holes", holes, "--side", "peg", "--json"];
        run("tactile-infer", at, &[&given[..], more].concat())
    };
    let measured = |holes: &str| {
        let said = calibrate("two.bank", holes, &["--maps", &maps, "--out", "own.safetensors"]);
        let said: Value = serde_json::from_str(said.done()).unwrap();
        let of = |name: &str| said["verifier"][name].as_f64().unwrap();
        [of("nats"), of("n_touches"), of("strain"), of("misfit")]
    };
    // What was expected of this sensor by 64 other touches: within three standard errors, where one varies by 2 nats. Two parts, of which
    // each is off by 0.4 nats more or less than usual.
    let [nats, n, strain, misfit] = measured("usual");
    assert!(n >= 16.0 && nats.abs() < 3.0 * 2.0 * (1.0 / n + 1.0 / 64.0_f64).sqrt(), "{nats} of {n}");
    assert!(strain.abs() < 0.02 && misfit.abs() < 3.0 * 0.4 / 2.0_f64.sqrt(), "{strain} {misfit}");
    let usual = misfit;
    // Pressed deeper than the bank's pegs and than the networks learnt from: outlines seem farther out.
    let [nats, n, strain, misfit] = measured("other");
    assert!(nats < -3.0 && strain > 0.01 && misfit - usual > 0.6, "{nats} of {n}, {strain} {misfit} {usual}");
    // It counts where the same networks judge, and nowhere else.
    let own = || Model::load(&at.join("own.safetensors")).unwrap();
    let with_maps = own().with_maps(Maps::load(maps.as_ref()).unwrap()).unwrap();
    let [plain, judged] = [own(), with_maps].map(|model| TouchModel::of_side(&model, Side::Peg));
    assert_eq!((plain.verifier_offset, plain.verifier_touches), (0.0, 0.25));
    assert!((judged.verifier_offset - nats * n / (n + 0.25)).abs() < 1e-9, "{judged:?}");
    assert!((judged.verifier_touches - 1.0 / (1.0 / (n + 0.25) + 0.5)).abs() < 1e-9);
    assert_eq!((plain.sensor_strain, judged.sensor_strain), (0.0, strain));
    assert_eq!((plain.sensor_misfit, judged.sensor_misfit), (0.0, misfit));
    let unjudged = TouchModel { sensor_strain: 0.0, sensor_misfit: 0.0, ..judged };
    assert_eq!(TouchModel { verifier_offset: 0.0, verifier_touches: 0.25, ..unjudged }, plain);
    // Several sensors tell what is for any: no offset.
    let two = calibrate("two.bank", "usual", &["--holes", "other", "--maps", &maps, "--out", "two.safetensors"]);
    assert_eq!(serde_json::from_str::<Value>(two.done()).unwrap()["verifier"], Value::Null);
    let refused = calibrate("plain.bank", "usual", &["--maps", &maps, "--out", "never.safetensors"]);
    assert!(refused.failed().contains("plain.bank: expected a bank with a map of each part"), "{}", refused.stderr);
    let unfitted = MapFile { presence: [None; 3], ..MapFile::load(maps.as_ref()).unwrap() };
    unfitted.save(&at.join("unfitted.safetensors")).unwrap();
    let refused = calibrate("two.bank", "usual", &["--maps", "unfitted.safetensors", "--out", "never.safetensors"]);
    assert!(refused.failed().contains("unfitted.safetensors: expected a verifier"), "{}", refused.stderr);
    assert!(!at.join("never.safetensors").exists());
}

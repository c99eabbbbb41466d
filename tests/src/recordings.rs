//! From a lab's pictures and bags to a report: the example of `data/recording-template`, and what may be wrong with it.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tactile_tests::programs::{run, workspace};
use tactile_tests::samples::{SCENE, Sample};

use crate::readme::commands;

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Runs a program with words in a folder; its standard output.
fn done(program: &str, folder: &Path, words: &str) -> String {
    run(program, folder, &words.split_whitespace().collect::<Vec<_>>()).done().to_owned()
}

#[cfg(unix)]
#[test]
fn the_template_s_example_runs_from_pictures_to_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for name in ["data", "infer"] {
        std::os::unix::fs::symlink(workspace().join(name).canonicalize().unwrap(), at.join(name)).unwrap();
    }
    fs::create_dir_all(at.join("out/lab")).unwrap();
    let page = fs::read_to_string(workspace().join("data/recording-template/README.md")).unwrap();
    let commands = commands(&page);
    assert_eq!(commands.len(), 16);
    let mut said = String::new();
    for (program, words) in &commands {
        let ran = run(program, at, &words.iter().map(String::as_str).collect::<Vec<_>>());
        said += ran.done();
        said += &ran.stderr;
    }
    assert!(said.contains("holes mate with the peg nearest to them"), "{said}");
    assert!(said.contains("in a region of each board are held out"), "{said}");
    assert!(said.contains("poses not recorded; unknown"), "{said}");
    // The truth is 0.4 mm, -0.3 mm and 1 degree.
    let offset = &read_json(&at.join("out/lab/pegs/meta.json"))["peg_from_hole"];
    let number = |field: &str| offset[field].as_f64().unwrap();
    assert!((number("x_mm") - 0.4).hypot(number("y_mm") + 0.3) < 0.1, "{offset}");
    assert!((number("theta_rad").to_degrees() - 1.0).abs() < 0.3, "{offset}");
    let evaluation = read_json(&at.join("out/lab/evaluation/evaluation.json"));
    assert_eq!((&evaluation["recorded"], &evaluation["scene"]), (&true.into(), &"hole-pictures".into()));
    let rows = evaluation["rows"].as_array().unwrap();
    let is_it = |row: &&Value| row["method"] == "filter" && row["action"] == "information" && row["n_touches"] == 5;
    let accuracy = rows.iter().find(is_it).unwrap()["accuracy"].as_f64().unwrap();
    assert!(accuracy > 0.9, "{accuracy}");
    let report = fs::read_to_string(at.join("out/lab/evaluation/report.html")).unwrap();
    assert!(report.contains("The touches are recorded:") && !report.contains("All of it is simulated"));
    assert!(said.contains("the pegs were recorded every 4 mm and 30 degrees: finer steps are left out"));
    let tradeoff = read_json(&at.join("out/lab/tradeoff/tradeoff.json"));
    assert_eq!((&tradeoff["recorded"], &tradeoff["n_classes"]), (&true.into(), &3.into()));
}

#[test]
fn a_bag_brings_back_every_byte_and_an_evaluation_of_it_says_the_same() {
    let sample = Sample::make();
    let at = sample.folder();
    for data in ["pegs", "holes"] {
        done("tactile-data", at, &format!("export {data} --to mcap --out {data}.mcap"));
        done("tactile-data", at, &format!("import {data}.mcap --touches poses --out {data}-again"));
        let [a, b] = [data.to_owned(), format!("{data}-again")].map(|name| fs::read(at.join(name).join("frames.npy")));
        assert!(a.unwrap() == b.unwrap(), "{data}");
    }
    let bank = |data: &str, out: &str| {
        done("tactile-infer", at, &format!("bank --model model/model.safetensors --data {data} --out {out}"))
    };
    bank("pegs", "a.bank");
    bank("pegs-again", "b.bank");
    let evaluate = |bank: &str, holes: &str, out: &str| {
        let words = format!(
            "evaluate --model model/model.safetensors --bank {bank} --holes {holes} --out {out} --episodes 8 --seeds 1,2 \
             --touches 3 --engines exact --actions information,random --stories 2"
        );
        done("tactile-filter", at, &words);
        read_json(&at.join(out).join("evaluation.json"))
    };
    let [direct, from_bag] = [evaluate("a.bank", "holes", "x"), evaluate("b.bank", "holes-again", "y")];
    // Poses of a bag are in metres and quaternions: equal but for the last bits. After a turn a view may be half way between two
    // recorded ones, and these bits say which is the nearest; so the first touch alone is compared.
    let accuracies = |of: &Value| {
        let of_first = of["rows"].as_array().unwrap().iter().filter(|row| row["n_touches"] == 1);
        of_first.map(|row| row["accuracy"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(accuracies(&direct), accuracies(&from_bag));
    assert!(accuracies(&direct).len() == 3 && direct["rows"].as_array().unwrap().len() == 1 + 2 * 3);
}

/// The steps of the banks of a trade-off, mm and degrees, without those that are there already.
fn steps(tradeoff: &Value) -> Vec<[f64; 2]> {
    let number = |value: &Value| value.as_f64().unwrap();
    let of = |point: &Value| [number(&point["settings"]["xy_step_mm"]), number(&point["settings"]["theta_step_deg"])];
    let mut steps: Vec<[f64; 2]> = tradeoff["points"].as_array().unwrap().iter().map(of).collect();
    steps.dedup();
    steps
}

#[test]
fn a_trade_off_over_recordings_is_continued_but_not_with_another_recording() {
    let sample = Sample::make();
    let at = sample.folder();
    let measured = |holes: &str, more: &str| {
        let words = format!(
            "tradeoff --model model/model.safetensors --pegs pegs --holes {holes} --settings 2 --episodes 4 --seeds 1,2 \
             --out out {more}"
        );
        let ran = run("tactile-filter", at, &words.split_whitespace().collect::<Vec<_>>());
        ran.done();
        (ran.stderr.matches(" settings: ").count(), ran.stderr)
    };
    let (n_of_shard, said) = measured("holes", "--shard 1/2");
    assert!(said.contains("the pegs were recorded every 4 mm and 30 degrees: finer steps are left out"), "{said}");
    assert_eq!((n_of_shard, at.join("out/tradeoff.json").exists()), (1, false));
    assert_eq!(measured("holes", "").0, 1);
    let tradeoff = read_json(&at.join("out/tradeoff.json"));
    assert_eq!((&tradeoff["recorded"], &tradeoff["scene"]), (&true.into(), &"two-letters".into()));
    assert_eq!((&tradeoff["n_classes"], steps(&tradeoff)), (&2.into(), vec![[4.0, 30.0]]));
    assert_eq!(read_json(&at.join("out/frontier.json"))["recorded"], true);
    let page = fs::read_to_string(at.join("out/tradeoff.html")).unwrap();
    assert!(page.contains("The touches are recorded:") && !page.contains("simulated holes"));
    assert_eq!(measured("holes", "").0, 0);
    // Of the same name, parts and poses.
    done("tactile-data", at, "generate --scene two.toml --sides hole --seed 3 --out other-holes");
    assert_eq!(measured("other-holes", "").0, 2);
    assert_eq!(measured("holes", "").0, 2);
}

/// Three of five episodes choose and two promise.
#[test]
fn a_budget_promises_what_episodes_that_did_not_choose_came_to() {
    let sample = Sample::make();
    let at = sample.folder();
    let of_model = "--model model/model.safetensors";
    let words =
        format!("tradeoff {of_model} --pegs pegs --holes holes --settings 1 --episodes 5 --seeds 1,2 --out out");
    done("tactile-filter", at, &words);
    let frontier = read_json(&at.join("out/frontier.json"));
    let points = frontier["points"].as_array().unwrap();
    let count = |point: &Value, half: &str, of: &str| point["halves"][half][of].as_u64().unwrap();
    for point in points {
        // Four of one part, and one of the other.
        assert_eq!([count(point, "choosing", "n_episodes"), count(point, "promising", "n_episodes")], [4, 1]);
        let right = count(point, "choosing", "n_right") + count(point, "promising", "n_right");
        assert!((point["accuracy"].as_f64().unwrap() - right as f64 / 5.0).abs() < 1e-12);
    }
    done("tactile-infer", at, &format!("bank {of_model} --data pegs --out a.bank"));
    let words = format!(
        "evaluate {of_model} --bank a.bank --holes holes --out chosen --episodes 4 --seeds 3 --touches 10 --stories 0 \
         --budget mb=1000,touches=3 --frontier out/frontier.json"
    );
    let said = done("tactile-filter", at, &words);
    let promise = &read_json(&at.join("chosen/evaluation.json"))["promise"];
    let worth = |point: &&Value| count(point, "choosing", "n_decided_and_right");
    let within = || points.iter().filter(|point| point["n_touches"].as_u64().unwrap() <= 3);
    let most = within().map(|point| worth(&point)).max().unwrap();
    let of_best = |point: &Value| count(point, "promising", "n_decided_and_right") as f64;
    let promised = promise["decided_and_right"]["share"].as_f64().unwrap();
    assert!(within().any(|point| worth(&point) == most && of_best(point) == promised), "{promise} {points:?}");
    assert_eq!(promise["decided_and_right"]["n_episodes"], 1);
    let seconds = |point: &Value| {
        let half = &point["halves"]["promising"];
        3.0 * half["touches"].as_f64().unwrap() + half["travel_mm"].as_f64().unwrap() / 50.0
    };
    let promised = promise["robot_s"].as_f64().unwrap();
    assert!(points.iter().any(|point| (seconds(point) - promised).abs() < 1e-9), "{promise} {points:?}");
    assert!(points.iter().all(|point| point["strangers"]["n_episodes"] == 5), "{points:?}");
    assert!(said.contains("touches sure and right: ") && said.contains("touches right, sure or not: "), "{said}");
}

#[test]
fn a_trade_off_resamples_finer_recordings() {
    let sample = Sample::make();
    let at = sample.folder();
    let fine = SCENE.replace("xy_step_mm = 4.0", "xy_step_mm = 2.0").replace("deg = 30.0", "deg = 15.0");
    fs::write(at.join("fine.toml"), fine).unwrap();
    done("tactile-data", at, "generate --scene fine.toml --sides peg --lab missing=0.05 --out fine-pegs");
    let words = "tradeoff --model model/model.safetensors --pegs fine-pegs --holes holes --settings 4 --episodes 4 \
                 --seeds 1,2 --out out";
    let ran = run("tactile-filter", at, &words.split_whitespace().collect::<Vec<_>>());
    ran.done();
    assert!(ran.stderr.contains("the pegs were recorded every 2 mm and 15 degrees"), "{}", ran.stderr);
    assert_eq!(ran.stderr.matches("note: bank of 2 mm, 15°: part T: ").count(), 1, "{}", ran.stderr);
    let steps = steps(&read_json(&at.join("out/tradeoff.json")));
    assert!(steps.contains(&[2.0, 15.0]) && steps.contains(&[4.0, 15.0]), "{steps:?}");
}

#[test]
fn a_trade_off_is_over_a_scene_or_over_pegs_and_holes() {
    let sample = Sample::shared();
    let with = "tradeoff --model model/model.safetensors --out never";
    for (words, named) in [
        ("--scene two.toml --pegs pegs --holes holes", "--scene"),
        ("--pegs pegs", "--holes"),
        ("--holes holes", "--pegs"),
        ("--bank-seed 2 --pegs pegs --holes holes", "--bank-seed"),
        ("--other-sensor", "--pegs"),
    ] {
        let line = format!("{with} {words}");
        let ran = run("tactile-filter", sample.folder(), &line.split_whitespace().collect::<Vec<_>>());
        assert!(ran.misused().contains(named), "{ran:?}");
    }
    assert!(!sample.folder().join("never").exists());
    // A dataset's file is no place for a page.
    let line = "tradeoff --model model/model.safetensors --pegs pegs --holes holes --out holes/meta.json";
    let ran = run("tactile-filter", sample.folder(), &line.split_whitespace().collect::<Vec<_>>());
    assert!(ran.failed().contains("meta.json"), "{ran:?}");
}

#[test]
fn recordings_that_do_not_fit_are_refused_with_what_differs() {
    let sample = Sample::make();
    let at = sample.folder();
    let failed = |program: &str, words: &str| {
        run(program, at, &words.split_whitespace().collect::<Vec<_>>()).failed().to_owned()
    };
    done("tactile-data", at, "export holes --to folder --out pictures");
    done(
        "tactile-data",
        at,
        "import pictures --no-contact pictures/no_contact.png --field-of-view-mm 22 17 --out wide",
    );
    let evaluate =
        "evaluate --model model/model.safetensors --bank pegs.bank --episodes 2 --touches 2 --out out --holes";
    let scale = failed("tactile-filter", &format!("{evaluate} wide"));
    assert!(scale.contains("field of view: expected 22 x 17 mm as in pictures"), "{scale}");
    let pegs = failed("tactile-filter", &format!("{evaluate} pegs"));
    assert!(pegs.contains("expected touches of holes") && pegs.contains("touches of pegs (--side peg"), "{pegs}");
    let words = "tradeoff --model model/model.safetensors --pegs pegs --holes wide --settings 1 --episodes 2 --out out";
    let tradeoff = run("tactile-filter", at, &words.split_whitespace().collect::<Vec<_>>());
    assert!(tradeoff.code == Some(1) && tradeoff.stderr.contains("expected 22 x 17 mm as in pictures"), "{tradeoff:?}");
    let prints = failed("tactile-filter", &format!("{evaluate} holes --prints 2"));
    assert!(prints.contains("prints: expected 1: recorded holes have one print, got 2"), "{prints}");
    let both = run("tactile-filter", at, &["evaluate", "--scene", "two.toml", "--holes", "holes"]);
    assert!(both.misused().contains("--holes"));
    // Scattered touches are on no grid; the flags that help are named.
    done("tactile-data", at, "generate --scene two.toml --sides peg --anywhere 40 --lab missing=0.01 --out scattered");
    let grid = failed("tactile-infer", "bank --model model/model.safetensors --data scattered --out s.bank");
    assert!(grid.contains("they can be resampled to a step"), "{grid}");
    let resample =
        "bank --model model/model.safetensors --data scattered --xy-step-mm 4 --theta-step-deg 30 --out s.bank";
    assert!(done("tactile-infer", at, resample).contains("2 parts x 27 poses"));
    // A recording of one side trains nothing, and says why.
    let alone = failed("tactile-train", "--data pegs --out never");
    assert!(alone.contains("0 pairs; 54 touches mate with none: their part was touched on one side only"), "{alone}");
    assert!(alone.contains("none is of a hole (tactile-data generate --sides both"), "{alone}");
    let align = failed("tactile-infer", "align --model model/model.safetensors --data pegs");
    assert!(align.contains("20 or more holes with a peg of their part"), "{align}");
}

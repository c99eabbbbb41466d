//! From boards to a report, by the programs alone.

use std::fs;

use serde_json::Value;
use tactile_tests::programs::run;
use tactile_tests::samples::Sample;

/// Runs the evaluation of a sample into its folder `evaluation`; what it wrote.
fn evaluate(sample: &Sample) -> Value {
    let args = "evaluate --model model/model.safetensors --bank pegs.bank --scene two.toml --pegs pegs --out evaluation \
                --episodes 6 --seeds 1,2 --touches 3 --stories 2 --engines exact,particle,paper --actions information,random";
    run("tactile-filter", sample.folder(), &args.split_whitespace().collect::<Vec<_>>()).done();
    let json = fs::read(sample.folder().join("evaluation/evaluation.json")).unwrap();
    serde_json::from_slice(&json).unwrap()
}

#[test]
fn the_same_seeds_give_the_same_model_and_the_same_evaluation() {
    let [(first, of_first), (second, of_second)] = [0; 2].map(|_| {
        let sample = Sample::make();
        let evaluation = evaluate(&sample);
        (sample, evaluation)
    });
    assert_eq!(first.model_sha256, second.model_sha256);
    for file in ["maze/frames.npy", "pegs/frames.npy", "holes/frames.npy"] {
        let [a, b] = [&first, &second].map(|sample| fs::read(sample.folder().join(file)).unwrap());
        assert!(a == b, "{file}");
    }
    for key in ["rows", "stopping", "model"] {
        assert_eq!(of_first[key], of_second[key], "{key}");
    }
}

#[test]
fn shards_of_several_prints_come_to_what_one_run_comes_to() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name).display().to_string();
    let evaluate = |out: String, more: &str| {
        let args = format!(
            "evaluate --model model/model.safetensors --bank pegs.bank --scene two.toml --episodes 9 --seeds 1,2 --touches 2 \
             --stories 0 --engines exact --actions information --out {out} {more}"
        );
        run("tactile-filter", sample.folder(), &args.split_whitespace().collect::<Vec<_>>()).done();
    };
    evaluate(out("single"), "--prints 3");
    evaluate(out("one"), "");
    for shard in ["2/2", "1/2"] {
        evaluate(out("shards"), &format!("--prints 3 --shard {shard}"));
    }
    run("tactile-filter", sample.folder(), &["merge", &out("shards"), "--out", &out("merged")]).done();
    let [single, merged, one]: [Value; 3] = ["single", "merged", "one"].map(|name| {
        let json = fs::read(folder.path().join(name).join("evaluation.json")).unwrap();
        serde_json::from_slice(&json).unwrap()
    });
    assert_eq!((&single["checksum"], &single["rows"]), (&merged["checksum"], &merged["rows"]));
    assert_eq!((&merged["n_prints"], one["n_prints"].is_null()), (&3.into(), true));
    assert_ne!(single["checksum"], one["checksum"]);
    assert!(single["distinct_first_views"].as_u64().is_some_and(|n| (1..=9).contains(&n)));
}

#[test]
fn an_evaluation_has_the_promised_keys_and_a_report() {
    let sample = Sample::make();
    let evaluation = evaluate(&sample);
    let text = |key: &str| evaluation[key].as_str().unwrap_or_default();
    assert_eq!((text("schema"), text("scene"), text("device")), ("tactile-filter/evaluation/1", "two-letters", "flex"));
    assert_eq!((&evaluation["n_classes"], &evaluation["n_episodes"]), (&2.into(), &6.into()));
    assert_eq!(evaluation["seeds"], serde_json::json!([1, 2]));
    assert_eq!(evaluation["model"]["sha256"], sample.model_sha256.as_str());
    assert_eq!(evaluation["model"]["input_px"], serde_json::json!([40, 30]));
    for pointer in ["/n_threads", "/model/parameters", "/stopping/mean_touches", "/stopping/confident_and_wrong"] {
        assert!(evaluation.pointer(pointer).is_some_and(Value::is_number), "{pointer}");
    }
    for (stage, share) in ["encode", "update", "select"].into_iter().flat_map(|s| [(s, "p50"), (s, "p99")]) {
        assert!(evaluation["latency_ms"][stage][share].is_number(), "{stage} {share}");
    }
    let rows = evaluation["rows"].as_array().unwrap();
    // Pixel and MoCo after one touch; exact and particle by two rules and Alg. 1 by its own, after each of three.
    assert_eq!(rows.len(), 2 + (2 * 2 + 1) * 3);
    for row in rows {
        for (key, known) in [
            ("method", &["pixel", "moco", "filter"][..]),
            ("inference", &["exact", "particle", "none"]),
            ("action", &["paper", "information", "random", "random-edge", "none"]),
            ("poses", &["on-grid", "off-grid"]),
        ] {
            assert!(row[key].as_str().is_some_and(|value| known.contains(&value)), "{key} of {row}");
        }
        for key in ["accuracy", "exact_cell", "brier"] {
            assert!(row[key].as_f64().is_some_and(|share| (0.0..=2.0).contains(&share)), "{key} of {row}");
        }
        for key in ["n_touches", "xy_mm_mean", "theta_deg_mean"] {
            assert!(row[key].is_number() || row[key].is_null() && row["accuracy"] == 0.0, "{key} of {row}");
        }
        let accuracy = row["accuracy"].as_f64().unwrap();
        let [low, high] = [0, 1].map(|side| row["accuracy_ci95"][side].as_f64().unwrap());
        assert!(0.0 <= low && low <= accuracy && accuracy <= high && high <= 1.0, "{row}");
    }
    let report = fs::read_to_string(sample.folder().join("evaluation/report.html")).unwrap();
    assert!(report.starts_with("<!DOCTYPE html>") && report.contains("two-letters"));
    assert!(!report.contains("src=\"http"), "the report is one file");
}

#[test]
fn a_bank_that_learnt_learns_again_without_the_absent_part() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name).display().to_string();
    let ran = |program: &str, args: String| run(program, sample.folder(), &args.split_whitespace().collect::<Vec<_>>());
    let bank = |more: &str, file: &str| {
        let args = format!("bank --model model/model.safetensors --scene two.toml {more} --out {}", out(file));
        ran("tactile-infer", args).done();
    };
    bank("", "learnt.bank");
    bank("--learn-from nothing", "plain.bank");
    let evaluate = |bank: &str, more: &str| {
        let args = format!(
            "evaluate --model model/model.safetensors --bank {} --scene two.toml --absent --episodes 6 --touches 2 --engines exact \
             --actions information,random-edge --out {} {more}",
            out(bank),
            out("absent")
        );
        ran("tactile-filter", args)
    };
    for (bank, again) in [("learnt.bank", true), ("plain.bank", false)] {
        let ran = evaluate(bank, "");
        ran.done();
        assert_eq!(ran.stderr.contains("touches of the bank"), again, "{}", ran.stderr);
        let json = fs::read(folder.path().join("absent/evaluation.json")).unwrap();
        let evaluation: Value = serde_json::from_slice(&json).unwrap();
        let rows = evaluation["rows"].as_array().unwrap();
        assert_eq!(evaluation["absent"], true);
        assert!(rows.iter().all(|row| row["accuracy"] == 0.0), "its own part is not there to be named");
        assert!(rows.iter().any(|row| row["action"] == "random-edge"));
    }
    let refused = evaluate("learnt.bank", "--bank-scene alphabet-small");
    assert!(refused.failed().contains("the parts of scene alphabet-small"), "{refused:?}");
}

#[test]
fn pegs_are_named_among_pegs_and_refused_where_holes_are_asked_for() {
    let sample = Sample::shared();
    let inputs =
        ["--model", "model/model.safetensors", "--bank", "pegs.bank", "--data", "pegs", "--set", "max_touches=1"];
    let play = |side: &[&str]| {
        let args = [&["replay", "--json"], &inputs[..], side].concat();
        run("tactile-filter", sample.folder(), &args)
    };
    let refused = play(&[]);
    assert!(refused.failed().contains("touches of pegs (--side peg plays them)"), "{refused:?}");
    let replayed = play(&["--side", "peg"]);
    let lines = replayed.done().lines().filter(|line| line.starts_with('{'));
    let played: Vec<Value> = lines.map(|line| serde_json::from_str(line).unwrap()).collect();
    // The bank was made of these very pictures: a key finds itself, and one touch may match well enough to be sure.
    assert_eq!(played.len(), 2);
    for line in played {
        assert_eq!(line["part"], line["truth"], "{line}");
        assert!(line["stop"] == "confident" || line["stop"] == "touch-limit", "{line}");
    }
}

#[test]
fn recorded_holes_are_played_one_episode_a_part() {
    let sample = Sample::shared();
    let args = ["replay", "--model", "model/model.safetensors", "--bank", "pegs.bank", "--data", "holes"];
    let replayed = run("tactile-filter", sample.folder(), &[&args[..], &["--json"]].concat());
    let lines: Vec<Value> = replayed.done().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let truths: Vec<_> = lines.iter().map(|line| line["truth"].as_str().unwrap_or_default()).collect();
    assert_eq!(truths, ["T", "X"]);
    for line in &lines {
        let n_touches = line["frames"].as_array().unwrap().len();
        assert!((1..=10).contains(&n_touches), "{line}");
        assert!(["T", "X"].contains(&line["part"].as_str().unwrap()), "{line}");
        assert!((0.0..=1.0).contains(&line["probability"].as_f64().unwrap()), "{line}");
    }
    // The same for a person: how sure it is comes before the name.
    let printed = run("tactile-filter", sample.folder(), &args);
    let printed: Vec<&str> = printed.done().lines().filter(|line| line.starts_with("episode")).collect();
    assert_eq!(printed.len(), lines.len());
    for (line, said) in lines.iter().zip(printed) {
        let confident = line["confident"] == true;
        let refused = line["stop"] == "none-of-these";
        assert_eq!([said.contains(" surely "), said.contains(" none of these, ")], [confident, refused], "{said}");
        // The default rate.
        assert!(!confident || line["stranger_rate"].as_f64().unwrap() <= 0.01, "{line}");
    }
}

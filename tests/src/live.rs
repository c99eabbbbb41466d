//! `tactile-filter live` as a user runs it, without a network.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;
use tactile_tests::programs::{self, run, workspace};

const SCENE: &str = r#"
name = "three"
[parts.letters]
letters = "ABC"
height_mm = 12.0
max_width_mm = 16.0
[reach]
xy_half_mm = 4.0
xy_step_mm = 2.0
theta_half_deg = 30.0
theta_step_deg = 15.0
"#;

/// A folder with a scene of three letters and their bank; the model's path.
fn prepare(folder: &Path) -> String {
    fs::write(folder.join("three.toml"), SCENE).unwrap();
    let model = workspace().join("infer/models/maze-small.safetensors").display().to_string();
    run("tactile-infer", folder, &["bank", "--model", &model, "--scene", "three.toml", "--out", "three.bank"]).done();
    model
}

#[test]
fn a_simulated_robots_holes_are_named_and_the_log_is_replayed() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    let inputs = ["--model", &model, "--bank", "three.bank"];
    let simulate = ["--simulate", "three.toml", "--fast", "--episodes", "3", "--faults", "dropped=0.02,frozen=0.01"];
    let live = |more: &[&str]| run("tactile-filter", folder, &[&["live"], &inputs[..], more].concat());
    let ran = live(&[&simulate[..], &["--log", "live.mcap"]].concat());
    assert!(ran.done().contains("3 of 3 holes named right"), "{ran:#?}");
    // A log is never written over, and no other file is.
    let again = live(&[&simulate[..], &["--log", "live.mcap"]].concat());
    assert!(again.failed().contains("a log is never written over"), "{again:#?}");
    let over = live(&[&simulate[..], &["--log", "three.bank"]].concat());
    assert!(over.failed().contains("three.bank"), "{over:#?}");

    // Outlines of another bank would be drawn wrongly.
    fs::write(folder.join("two.toml"), SCENE.replacen("height_mm = 12.0", "height_mm = 13.0", 1)).unwrap();
    let other = ["bank", "--model", &model, "--scene", "two.toml", "--out", "other.bank"];
    run("tactile-infer", folder, &other).done();
    let page = ["watch", "--log", "live.mcap", "--page", "127.0.0.1:0", "--model", &model, "--bank", "other.bank"];
    let ran = run("tactile-filter", folder, &page);
    assert!(ran.failed().contains("other.bank: expected the bank that the log is of"), "{ran:#?}");

    let replay = run("tactile-filter", folder, &[&["replay"], &inputs[..], &["--log", "live.mcap", "--json"]].concat());
    let decisions: Vec<Value> = replay.done().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(decisions.iter().filter(|decision| decision["stop"] == "confident").count(), 3, "{replay:#?}");
    assert!(replay.stderr.contains("give the same"), "{replay:#?}");
}

#[test]
fn what_is_wrong_is_one_line() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    let live = |more: &[&str]| {
        run("tactile-filter", folder, &[&["live", "--model", &model, "--bank", "three.bank"], more].concat())
    };
    assert!(live(&[]).misused().contains("--simulate"));
    assert!(live(&["--watch", "here", "--stdin-mjpeg"]).misused().contains("cannot be used with"));
    for (more, said) in [
        (&["--watch", "nowhere"][..], "nowhere: expected a folder"),
        (&["--simulate", "three.toml", "-p", "camera.crob:=1"], "unknown field `crob`"),
        (&["--simulate", "three.toml", "-p", "camera.crop"], "-p: expected NAME:=VALUE"),
        (&["--simulate", "three.toml", "--params-file", "no.yaml"], "no.yaml"),
        (&["--ros"], "a program built with it"),
        (&["--stdin-mjpeg", "--commands", "."], "expected a file, a FIFO or a terminal, got a folder"),
        (&["--stdin-mjpeg", "--commands", "nowhere"], "nowhere"),
    ] {
        let ran = live(more);
        assert!(ran.failed().contains(said), "{ran:#?}");
    }
    let usage = run(
        "tactile-filter",
        folder,
        &["live", "--model", &model, "--bank", "three.bank", "--simulate", "three.toml", "--faults", "lost=1"],
    );
    assert!(usage.misused().contains("lost=1"), "{usage:#?}");
}

#[test]
fn a_folder_that_pictures_are_put_into_gets_its_answers() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    let touches = folder.join("touches");
    fs::create_dir(&touches).unwrap();
    for (i, pose) in ["1,0,10", "-2,1,10", "3,-1,0"].into_iter().enumerate() {
        let (out, pose_arg) = (format!("touches/touch-{i}.png"), format!("--pose={pose}"));
        let (scene, seed) = ("letter:B:12", format!("{}", i + 1));
        let render = ["render", scene, &pose_arg, "--as-hole", "--frame-px", "160x120", "--seed", &seed, "--out", &out];
        run("tactile-data", folder, &[&render[..], &["--at-rest-out", "touches/rest.png"]].concat()).done();
        let numbers: Vec<f64> = pose.split(',').map(|number| number.parse().unwrap()).collect();
        let place = serde_json::json!({"x_mm": numbers[0], "y_mm": numbers[1], "theta_deg": numbers[2]});
        fs::write(touches.join(format!("touch-{i}.json")), place.to_string()).unwrap();
    }
    let watch =
        ["live", "--model", &model, "--bank", "three.bank", "--watch", "touches", "--once", "--log", "watch.mcap"];
    let ran = run("tactile-filter", folder, &watch);
    assert!(ran.done().contains("touch 3"), "{ran:#?}");
    let answer = fs::read_to_string(touches.join("touch-2.decision.json")).unwrap();
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&answer["touch"], &answer["estimate"]["part"]), (&3.into(), &"B".into()), "{answer}");
    // The same pictures again give the same answers, and the log says so.
    let replay = ["replay", "--model", &model, "--bank", "three.bank", "--log", "watch.mcap"];
    run("tactile-filter", folder, &replay).done();
}

#[test]
fn a_film_on_standard_input_and_lines_of_commands() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    // The sensor at rest, then a touch of B: 80 pictures of each with a little noise, at 50 a second.
    let render = ["render", "letter:B:12", "--pose=1,0,10", "--as-hole", "--frame-px", "160x120"];
    run("tactile-data", folder, &[&render[..], &["--out", "touch.png", "--at-rest-out", "rest.png"]].concat()).done();
    fs::write(folder.join("commands"), "rest\n").unwrap();
    let mut command = Command::new(programs::path("tactile-filter"));
    command.current_dir(folder).args(["live", "--model", &model, "--bank", "three.bank", "--stdin-mjpeg"]);
    let fifo = folder.join("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    command.args(["--commands", "fifo", "--json"]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut film = child.stdin.take().unwrap();
    for (name, line) in [("rest.png", "rest\n"), ("touch.png", "touch 1 0 10\n")] {
        let picture = tactile_data::frame::picture::read(&folder.join(name)).unwrap();
        for i in 0..60_usize {
            if i == 5 {
                // A writer of its own for each, and one that writes no text.
                fs::write(&fifo, b"\xff\xfe\n").unwrap();
                fs::write(&fifo, line).unwrap();
            }
            let mut rgb = picture.rgb().to_vec();
            rgb.iter_mut().skip(i).step_by(61).for_each(|value| *value ^= 1);
            let frame = tactile_data::frame::Frame::new(picture.width_px(), picture.height_px(), rgb).unwrap();
            film.write_all(&tactile_data::dataset::export::jpeg(&frame, 98).unwrap()).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
    drop(film);
    let output = child.wait_with_output().unwrap();
    let (stdout, stderr) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{stderr}");
    assert_eq!(stderr.matches("at rest: 160x120 pixels").count(), 1, "{stderr}");
    assert_eq!(stderr.matches("bytes that are no text").count(), 2, "{stderr}");
    let decision: Value = serde_json::from_str(stdout.lines().next().unwrap_or_else(|| panic!("{stderr}"))).unwrap();
    assert_eq!((&decision["touch"], &decision["estimate"]["part"]), (&1.into(), &"B".into()), "{stdout}");
}

/// Starts a node that watches an empty folder and waits until its log is there.
fn watching(folder: &Path, model: &str, log: &str, stdout: Stdio) -> std::process::Child {
    fs::create_dir_all(folder.join("touches")).unwrap();
    let mut command = Command::new(programs::path("tactile-filter"));
    command.current_dir(folder).args(["live", "--model", model, "--bank", "three.bank", "--watch", "touches"]);
    let child = command.args(["--json", "--log", log]).stdout(stdout).stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&folder.join(log));
    child
}

fn wait_for(path: &Path) {
    for _ in 0..600 {
        if path.exists() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    panic!("no {}", path.display());
}

fn signal(child: &std::process::Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_node_that_is_asked_to_end_by_any_signal_ends_its_log() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    for name in ["-INT", "-TERM", "-HUP"] {
        let log = format!("log{name}.mcap");
        let child = watching(folder, &model, &log, Stdio::null());
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{name}: {output:?}");
        let replay =
            run("tactile-filter", folder, &["replay", "--model", &model, "--bank", "three.bank", "--log", &log]);
        replay.done();
        assert!(!replay.stderr.contains("cut off"), "{name}: {replay:#?}");
    }
}

#[test]
fn a_node_goes_on_where_nobody_reads_its_decisions() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let model = prepare(folder);
    let mut child = watching(folder, &model, "pipe.mcap", Stdio::piped());
    drop(child.stdout.take());
    let render = ["render", "letter:B:12", "--pose=1,0,10", "--as-hole", "--frame-px", "160x120"];
    let touches = folder.join("touches");
    run("tactile-data", folder, &[&render[..], &["--out", "t.png", "--at-rest-out", "rest.png"]].concat()).done();
    // Each file is moved to its place whole, its picture last.
    fs::rename(folder.join("rest.png"), touches.join("rest.png")).unwrap();
    for (name, x_mm) in [("t1", 1), ("t2", 2)] {
        let place = serde_json::json!({"x_mm": x_mm, "y_mm": 0, "theta_deg": 10}).to_string();
        fs::write(touches.join(format!("{name}.json")), place).unwrap();
        fs::copy(folder.join("t.png"), folder.join("moving")).unwrap();
        fs::rename(folder.join("moving"), touches.join(format!("{name}.png"))).unwrap();
        wait_for(&touches.join(format!("{name}.decision.json")));
    }
    signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("standard output: decisions cannot be written").count(), 1, "{said}");
}

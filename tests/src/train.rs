//! Training that stops, continues, and fails.

use std::cell::{Cell, RefCell};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tactile_data::dataset::store::Dataset;
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::{Checkpoint, DeviceKind};
use tactile_tests::programs::{self, run};
use tactile_tests::samples::{Sample, text};
use tactile_train::config::{Flips, Optimizer, TrainConfig};
use tactile_train::output_folder::OutputFolder;
use tactile_train::run::{Event, Outcome, Run, train};

/// The smallest network that there is a use for, so that a step takes milliseconds.
const SMALL: NetworkConfig = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };

/// Six steps, saved after four.
fn six_steps() -> TrainConfig {
    TrainConfig { network: SMALL, n_steps: 6, n_pairs: 8, n_warmup: 1, save_every: 4, ..TrainConfig::tiny() }
}

/// Trains all steps, or to `stop_after` of them; returns how it ended and the losses on the way.
fn train_to(
    dataset: &Dataset,
    out: &Path,
    config: &TrainConfig,
    stop_after: usize,
    resume: bool,
) -> (Outcome, Vec<f64>) {
    let claimed = OutputFolder::claim(out, &[]).unwrap();
    let run = Run { dataset, tuning: None, out: &claimed, config, device: DeviceKind::Flex, resume, from: None };
    let (made, losses) = (Cell::new(0), RefCell::new(Vec::new()));
    let mut count = |event: Event<'_>| {
        if let Event::Step { step, loss, .. } = event {
            made.set(step);
            losses.borrow_mut().push(loss);
        }
    };
    let outcome = train(&run, &|| made.get() >= stop_after, &mut count).unwrap();
    (outcome, losses.into_inner())
}

/// Steps and losses of the curve in a folder.
fn curve(out: &Path) -> Vec<String> {
    let text = fs::read_to_string(out.join("curve.csv")).unwrap();
    text.lines().map(|line| line.split(',').take(2).collect::<Vec<_>>().join(",")).collect()
}

/// Stops after each of `stops`, continues to the end, and compares the result with a run without a stop.
fn stops_change_nothing(config: &TrainConfig, stops: &[usize]) {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let (expected, expected_losses) = train_to(&dataset, &whole, config, usize::MAX, false);
    let mut losses = Vec::new();
    let mut outcome = None;
    for (stop, resume) in stops.iter().zip([false].into_iter().chain([true; 9])) {
        let (stopped, made) = train_to(&dataset, &parts, config, *stop, resume);
        assert_eq!((stopped.step, stopped.finished), (*stop, *stop == config.n_steps));
        losses.extend(made);
        outcome = Some(stopped);
    }
    let resumed = outcome.unwrap();
    assert_eq!(losses, expected_losses);
    assert_eq!(resumed.sha256, expected.sha256);
    assert!(Checkpoint::load(&resumed.model).unwrap() == Checkpoint::load(&expected.model).unwrap());
    assert_eq!(curve(&parts), curve(&whole));
}

#[test]
fn a_run_that_stopped_goes_on_as_if_it_had_not() {
    stops_change_nothing(&TrainConfig { network: NetworkConfig::TINY, ..six_steps() }, &[3, 6]);
}

#[test]
fn a_run_may_stop_after_every_step() {
    stops_change_nothing(&six_steps(), &[1, 2, 3, 4, 5, 6]);
}

#[test]
fn every_part_of_the_recipe_goes_on_exactly() {
    let config = TrainConfig {
        optimizer: Optimizer::Lamb,
        flips: Flips::Relit,
        n_micro_batches: 4,
        max_blank: 0.25,
        ..six_steps()
    };
    stops_change_nothing(&config, &[1, 5, 6]);
}

#[cfg(feature = "ndarray")]
#[test]
fn training_on_ndarray_begins_with_the_same_loss() {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let first_loss = |device: DeviceKind| {
        let config = TrainConfig { n_steps: 1, n_pairs: 8, n_warmup: 1, ..TrainConfig::tiny() };
        let out = OutputFolder::claim(&folder.path().join(device.to_string()), &[]).unwrap();
        let run =
            Run { dataset: &dataset, tuning: None, out: &out, config: &config, device, resume: false, from: None };
        let mut first = f64::NAN;
        let mut note = |event: Event<'_>| {
            if let Event::Step { loss, .. } = event {
                first = loss;
            }
        };
        train(&run, &|| false, &mut note).unwrap();
        first
    };
    let (flex, ndarray) = (first_loss(DeviceKind::Flex), first_loss(DeviceKind::Ndarray));
    // The backends sum in another order: some 1e-6 of each activation, through a dozen layers.
    assert!((flex - ndarray).abs() < 1e-3 * flex, "{flex} {ndarray}");
}

#[test]
fn settings_are_kept_next_to_the_model_and_used_again_by_resume() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (text(folder.path().join("model")), text(folder.path().join("my.toml")));
    fs::write(&file, "steps = 4\nbatch = 99\nsave_every = 2\ninput_px = [16, 12]\nwidth = 4\nflips = \"relit\"")
        .unwrap();
    let first = ["--data", "maze", "--out", &out, "--config", &file, "--batch", "8"];
    run("tactile-train", sample.folder(), &first).done();
    let kept = fs::read_to_string(folder.path().join("model/train.toml")).unwrap();
    for line in ["batch = 8", "steps = 4", "flips = \"relit\"", "width = 4", "preset = \"tiny\"", "temperature = 0.1"] {
        assert!(kept.lines().any(|kept| kept == line), "no {line} in {kept}");
    }
    run("tactile-train", sample.folder(), &["--data", "maze", "--out", &out, "--resume"]).done();
    let other = ["--data", "maze", "--out", &out, "--resume", "--set", "temperature=0.2"];
    let other = run("tactile-train", sample.folder(), &other);
    assert!(
        other.failed().ends_with("the settings it began with, temperature = 0.1, got temperature = 0.2"),
        "{other:?}"
    );
    fs::write(&file, "batchsize = 99").unwrap();
    let wrong = run("tactile-train", sample.folder(), &first);
    assert!(wrong.failed().contains("my.toml line 1") && wrong.stderr.contains("batchsize"), "{wrong:?}");
    let page = fs::read_to_string(folder.path().join("model/curve.html")).unwrap();
    assert!(page.contains("All 4 steps are made") && page.contains("<svg") && !page.contains("NaN"));
}

#[test]
fn tuning_accuracy_is_that_of_matching() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("model"));
    let small = ["--data", "maze", "--out", &out, "--steps", "2", "--batch", "8", "--json"];
    let tune = |pegs: &str, holes: &str| {
        run("tactile-train", sample.folder(), &[&small[..], &["--tune", pegs, holes]].concat())
    };
    let wrong = tune("holes", "holes");
    assert!(wrong.failed().contains("touches of pegs"), "{wrong:?}");
    let wrong = tune("pegs", "maze");
    assert!(wrong.failed().contains("--tune: holes maze"), "{wrong:?}");
    let outcome: Value = serde_json::from_str(tune("pegs", "holes").done()).unwrap();
    let model = text(folder.path().join("model/model.safetensors"));
    let matched = ["match", "--model", &model, "--pegs", "pegs", "--holes", "holes", "--json"];
    let matched: Value = serde_json::from_str(run("tactile-infer", sample.folder(), &matched).done()).unwrap();
    assert_eq!(outcome["validation"]["tuning_accuracy"], matched["moco"]["accuracy"], "{outcome} {matched}");
}

#[test]
fn fine_tuning_begins_with_a_model() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("model"));
    let alone = run("tactile-train", sample.folder(), &["--data", "maze", "--out", &out, "--preset", "fine"]);
    assert_eq!(alone.failed(), "--preset fine: expected a trained model to begin with, --from MODEL, got none");
    let args = ["--data", "maze", "--out", &out, "--from", "model/model.safetensors", "--steps", "2", "--batch", "8"];
    run("tactile-train", sample.folder(), &args).done();
    let settings = fs::read_to_string(Path::new(&out).join("train.toml")).unwrap();
    assert!(settings.contains("preset = \"fine\"") && settings.contains("learning_rate = 0.002\n"), "{settings}");
}

#[test]
fn a_second_run_never_overwrites_the_first() {
    let sample = Sample::shared();
    let [model, state] = ["model/model.safetensors", "model/state.safetensors"].map(|file| sample.folder().join(file));
    let before = [&model, &state].map(|file| fs::read(file).unwrap());
    let args = ["--data", "maze", "--out", "model", "--steps", "4", "--batch", "8", "--set", "save_every=2"];
    let again = run("tactile-train", sample.folder(), &args);
    assert!(again.failed().contains("state.safetensors") && again.stderr.contains("--resume"), "{again:?}");
    let other = run("tactile-train", sample.folder(), &[&args[..], &["--seed", "2", "--resume"]].concat());
    assert!(other.failed().contains("the settings it began with"), "{other:?}");
    assert!(before == [&model, &state].map(|file| fs::read(file).unwrap()));
}

#[test]
fn what_cannot_be_trained_is_refused_before_the_data_are_read() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("model"));
    let file = text(folder.path().join("file"));
    fs::write(&file, "preset = \"paper\"").unwrap();
    let below_a_file = format!("{file}/model");
    for (flags, words) in [
        (["--set", "temperature=nan"], ["temperature: ", "got NaN"]),
        (["--set", "weight_decay=inf"], ["weight_decay: ", "got inf"]),
        (["--set", "epochs=nan"], ["epochs: ", "got NaN"]),
        (["--set", "epochs=1e300"], ["steps: expected 1 to 4294967296", "got 9223372036854775807"]),
        (["--steps", "999999999999999999"], ["steps: expected 1 to 4294967296", "got 999999999999999999"]),
        (["--batch", "999999999999"], ["batch: ", "got 999999999999"]),
        (["--seed", "18446744073709551615"], ["settings: ", "2^63"]),
        (["--out", &below_a_file], [&below_a_file, "Not a directory"]),
        (["--out", "maze"], ["--out: expected a folder of its own", "got maze, which is an input"]),
    ] {
        let out = if flags[0] == "--out" { &[][..] } else { &["--out", &out][..] };
        let data = if flags[1] == "maze" { "maze" } else { "nowhere" };
        let ran = run("tactile-train", sample.folder(), &[&["--data", data], out, &flags].concat());
        assert!(words.iter().all(|word| ran.failed().contains(word)), "{ran:?}");
    }
    let huge = ["--data", "maze", "--out", &out, "--set", "width=4096", "--set", "hidden=4096"];
    let huge = run("tactile-train", sample.folder(), &huge);
    assert!(huge.failed().contains("which take 158.4 GB to train"), "{huge:?}");
    let misspelt = run("tactile-train", sample.folder(), &["--data", "maze", "--out", &out, "--preset", "smal"]);
    assert!(misspelt.misused().contains("'small'"), "{misspelt:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_folder_is_written_by_one_run_at_a_time() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    let claimed = OutputFolder::claim(&path, &[]).unwrap();
    let out = text(path.clone());
    let args = ["--data", "maze", "--out", &out, "--steps", "1", "--batch", "8"];
    let second = run("tactile-train", sample.folder(), &args);
    assert!(
        second.failed().contains("model.safetensors: expected an output that no other run is writing"),
        "{second:?}"
    );
    drop(claimed);
    run("tactile-train", sample.folder(), &args).done();
    // Without its state it is the only copy of a model.
    fs::remove_file(path.join("state.safetensors")).unwrap();
    let third = run("tactile-train", sample.folder(), &args);
    assert!(third.failed().contains("model.safetensors: expected an empty --out"), "{third:?}");
}

#[test]
fn no_pairs_is_an_error_and_leaves_nothing() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("model"));
    let line = run("tactile-train", sample.folder(), &["--data", "pegs", "--out", &out]);
    assert!(line.failed().contains("two-letters") && line.stderr.contains("0 pairs"), "{line:?}");
    let none = ["generate", "--scene", "maze", "--pairs", "0", "--out", &out];
    assert!(run("tactile-data", sample.folder(), &none).failed().contains("at least one pair"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Waits until `done` holds.
#[cfg(unix)]
fn wait(what: &str, mut done: impl FnMut() -> bool) {
    let started = Instant::now();
    while !done() {
        assert!(started.elapsed() < Duration::from_secs(120), "waited too long for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_saves_where_it_stands() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("model"));
    let model = folder.path().join("model/model.safetensors");
    let mut training = Command::new(programs::path("tactile-train"))
        .args(["--data", &sample.at("maze"), "--out", &out])
        .args(["--steps", "1000000", "--batch", "8", "--set", "save_every=3"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait("the first checkpoint", || model.exists() || training.try_wait().unwrap().is_some());
    let killed = Command::new("kill").args(["-INT", &training.id().to_string()]).status().unwrap();
    assert!(killed.success());
    wait("the end", || training.try_wait().unwrap().is_some());
    let output = training.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let last = stderr.lines().last().unwrap();
    let step = last.strip_prefix("stopped after step ").and_then(|rest| rest.strip_suffix("; continue with --resume"));
    let (checkpoint, _) = Checkpoint::load(&model).unwrap();
    assert_eq!(step.and_then(|step| step.parse().ok()), Some(checkpoint.provenance.steps), "{stderr}");
}

/// A small disk in memory, gone when dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None` where this user may not mount one.
    fn mount(at: PathBuf, n_bytes: u64) -> Option<Self> {
        fs::create_dir(&at).unwrap();
        let size = format!("size={n_bytes}");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(&at).output();
        mounted.is_ok_and(|output| output.status.success()).then_some(Self(at))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(&self.0).status();
        if !unmounted.is_ok_and(|status| status.success()) {
            println!("{} is still mounted", self.0.display());
        }
    }
}

#[test]
fn a_full_disk_leaves_the_checkpoint_before_it() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let size = |file: &str| fs::metadata(sample.folder().join("model").join(file)).unwrap().len();
    // One checkpoint and its state fit; the next checkpoint, written next to it, does not.
    let model = size("model.safetensors");
    let Some(disk) = SmallDisk::mount(folder.path().join("disk"), model + size("state.safetensors") + model / 2) else {
        println!("skipped: this user cannot mount a small disk");
        return;
    };
    let out = text(disk.0.join("model"));
    let args = ["--data", "maze", "--out", &out, "--steps", "4", "--batch", "8", "--set", "save_every=2"];
    let full = run("tactile-train", sample.folder(), &args);
    assert_eq!(full.code, Some(1), "{full:?}");
    let last = full.stderr.lines().last().unwrap();
    assert!(last.starts_with("error: ") && last.contains("model.safetensors") && last.contains("space"), "{full:?}");
    assert!(last.contains("step 4 is not saved, model.safetensors of step 2 is kept"), "{full:?}");
    let (checkpoint, _) = Checkpoint::load(&disk.0.join("model/model.safetensors")).unwrap();
    assert_eq!(checkpoint.provenance.steps, 2);
    let mut left: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["curve.csv", "curve.html", "model.safetensors", "state.safetensors", "train.toml"]);
}

/// The small network on the command line.
#[cfg(unix)]
const SMALL_ARGS: [&str; 8] = ["--set", "input_px=[16,12]", "--set", "width=4", "--set", "hidden=8", "--set", "dim=6"];

#[cfg(unix)]
#[test]
fn a_file_that_may_not_grow_leaves_the_checkpoint_before_it_and_goes_on_later() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| text(folder.path().join(name));
    let args = |out: &str| {
        let run = ["--data", "maze", "--out", out, "--steps", "4", "--batch", "8", "--set", "save_every=2"];
        [&run[..], &SMALL_ARGS].concat().join(" ")
    };
    let program = text(programs::path("tactile-train"));
    let shell = |line: String| {
        let output = Command::new("bash").args(["-c", &line]).current_dir(sample.folder()).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (whole, limited) = (out("whole"), out("limited"));
    assert_eq!(shell(format!("{program} {}", args(&whole))).0, Some(0));
    // Files of 4 KiB at most: settings and curve fit, the model does not. The signal that would end the program
    // is ignored, so that writing fails as on a full disk.
    let limit = "trap '' XFSZ; ulimit -f 4;";
    let (code, stderr) = shell(format!("{limit} {program} {}", args(&limited)));
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("model.safetensors: ") && stderr.contains("no checkpoint was written before"), "{stderr}");
    // From the state after step 2, it fails at step 4.
    fs::create_dir_all(&limited).unwrap();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let config = TrainConfig { n_steps: 4, n_warmup: 0, save_every: 2, ..six_steps() };
    train_to(&dataset, Path::new(&limited), &config, 2, false);
    let before = fs::read(folder.path().join("limited/model.safetensors")).unwrap();
    let (code, stderr) = shell(format!("{limit} {program} {} --resume", args(&limited)));
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("step 4 is not saved, model.safetensors of step 2 is kept"), "{stderr}");
    assert!(fs::read(folder.path().join("limited/model.safetensors")).unwrap() == before);
    assert_eq!(shell(format!("{program} {} --resume", args(&limited))).0, Some(0));
    let [a, b] = [&whole, &limited].map(|out| Checkpoint::load(&Path::new(out).join("model.safetensors")).unwrap());
    assert!(a == b);
    assert_eq!(curve(Path::new(&limited)), curve(Path::new(&whole)));
}

#[cfg(unix)]
#[test]
fn killed_at_any_moment_a_run_ends_in_the_same_bits() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| text(folder.path().join(name));
    let start = |out: &str, resume: bool| {
        let mut training = Command::new(programs::path("tactile-train"));
        training.args(["--data", &sample.at("maze"), "--out", out, "--steps", "200", "--batch", "8"]);
        training.args(["--set", "save_every=7"]).args(SMALL_ARGS).args(resume.then_some("--resume"));
        training.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let (whole, killed) = (out("whole"), out("killed"));
    let started = Instant::now();
    assert!(start(&whole, false).wait().unwrap().success());
    let usual = started.elapsed();
    let state = Path::new(&killed).join("state.safetensors");
    let mut n_killed = 0;
    // Moments spread over a third of a run by the golden ratio; each run continues from the one before.
    for i in 1..=6 {
        if !state.exists() {
            // Killed between its first model and its first state, it leaves a model that no run overwrites.
            drop(fs::remove_file(state.with_file_name("model.safetensors")));
        }
        let mut training = start(&killed, state.exists());
        std::thread::sleep(usual.mul_f64(0.3 * (f64::from(i) * 0.618_034).fract()));
        training.kill().unwrap();
        n_killed += usize::from(!training.wait().unwrap().success());
    }
    assert!(n_killed > 2, "{n_killed} of 6 were still running");
    assert!(start(&killed, state.exists()).wait().unwrap().success());
    println!("{n_killed} kills, a run takes {usual:?}");
    let [a, b] = [&whole, &killed].map(|out| Checkpoint::load(&Path::new(out).join("model.safetensors")).unwrap());
    assert!(a == b);
    assert_eq!(curve(Path::new(&killed)), curve(Path::new(&whole)));
}

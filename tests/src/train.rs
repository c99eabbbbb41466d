//! Training that stops, goes on, and fails.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tactile_data::store::Dataset;
use tactile_infer::{Checkpoint, DeviceKind};
use tactile_tests::programs::{self, run};
use tactile_tests::samples::{Sample, text};
use tactile_train::run::{Event, Outcome, TrainConfig, train};

/// Trains six steps, or to `stop_after` of them.
fn six_steps(dataset: &Dataset, out: &Path, stop_after: usize, resume: bool) -> Outcome {
    let config = TrainConfig { n_steps: 6, n_pairs: 8, n_warmup: 1, save_every: 4, ..TrainConfig::tiny() };
    let made = Cell::new(0);
    let mut count = |event: Event<'_>| {
        if let Event::Step { step, .. } = event {
            made.set(step);
        }
    };
    train(dataset, out, &config, DeviceKind::Flex, resume, &|| made.get() >= stop_after, &mut count).unwrap()
}

#[test]
fn a_run_that_stopped_goes_on_as_if_it_had_not() {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let expected = six_steps(&dataset, &whole, 6, false);
    let stopped = six_steps(&dataset, &parts, 3, false);
    assert_eq!((stopped.step, stopped.finished), (3, false));
    let resumed = six_steps(&dataset, &parts, 6, true);
    assert_eq!((resumed.step, resumed.finished), (6, true));
    assert_eq!(resumed.sha256, expected.sha256);
    let [a, b] = [&expected, &resumed].map(|outcome| Checkpoint::load(&outcome.model).unwrap());
    assert!(a == b);
    let losses = |out: &Path| {
        let curve = fs::read_to_string(out.join("curve.csv")).unwrap();
        curve.lines().map(|line| line.split(',').take(2).collect::<Vec<_>>().join(",")).collect::<Vec<_>>()
    };
    assert_eq!(losses(&parts), losses(&whole));
}

#[test]
fn both_devices_begin_with_the_same_loss() {
    let sample = Sample::shared();
    let dataset = Dataset::open(&sample.folder().join("maze")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let first_loss = |device: DeviceKind| {
        let config = TrainConfig { n_steps: 1, n_pairs: 8, n_warmup: 1, ..TrainConfig::tiny() };
        let mut first = f64::NAN;
        let mut note = |event: Event<'_>| {
            if let Event::Step { loss, .. } = event {
                first = loss;
            }
        };
        train(&dataset, &folder.path().join(device.to_string()), &config, device, false, &|| false, &mut note).unwrap();
        first
    };
    let (flex, ndarray) = (first_loss(DeviceKind::Flex), first_loss(DeviceKind::Ndarray));
    // The backends sum in another order: some 1e-6 of each activation, through a dozen layers.
    assert!((flex - ndarray).abs() < 1e-3 * flex, "{flex} {ndarray}");
}

#[test]
fn a_second_run_never_overwrites_the_first() {
    let sample = Sample::shared();
    let [model, state] = ["model/model.safetensors", "model/state.safetensors"].map(|file| sample.folder().join(file));
    let before = [&model, &state].map(|file| fs::read(file).unwrap());
    let args = ["--data", "maze", "--out", "model", "--steps", "4", "--batch", "8", "--save-every", "2"];
    let again = run("tactile-train", sample.folder(), &args);
    assert!(again.failed().contains("state.safetensors") && again.stderr.contains("--resume"), "{again:?}");
    let other = run("tactile-train", sample.folder(), &[&args[..], &["--seed", "2", "--resume"]].concat());
    assert!(other.failed().contains("the settings it began with"), "{other:?}");
    assert!(before == [&model, &state].map(|file| fs::read(file).unwrap()));
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
        .args(["--steps", "1000000", "--batch", "8", "--save-every", "3"])
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
    let step = last.strip_prefix("stopped after step ").and_then(|rest| rest.strip_suffix("; go on with --resume"));
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
    // One checkpoint and its state fit; the next checkpoint, written beside, does not.
    let model = size("model.safetensors");
    let Some(disk) = SmallDisk::mount(folder.path().join("disk"), model + size("state.safetensors") + model / 2) else {
        println!("skipped: this user cannot mount a small disk");
        return;
    };
    let out = text(disk.0.join("model"));
    let args = ["--data", "maze", "--out", &out, "--steps", "4", "--batch", "8", "--save-every", "2"];
    let full = run("tactile-train", sample.folder(), &args);
    assert_eq!(full.code, Some(1), "{full:?}");
    let last = full.stderr.lines().last().unwrap();
    assert!(last.starts_with("error: ") && last.contains("model.safetensors") && last.contains("space"), "{full:?}");
    let (checkpoint, _) = Checkpoint::load(&disk.0.join("model/model.safetensors")).unwrap();
    assert_eq!(checkpoint.provenance.steps, 2);
    let mut left: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["curve.csv", "model.safetensors", "state.safetensors"]);
}

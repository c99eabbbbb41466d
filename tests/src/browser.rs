//! The pages as a headless Chromium shows them.
//!
//! Debian has it (package chromium). On a machine without one these tests count as ignored; `TACTILE_CHROMIUM` names another file.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use libtest_mimic::{Arguments, Trial};
use serde_json::{Value, json};
use tactile_tests::programs::run;
use tactile_tests::samples::Sample;
use tactile_tests::served::Served;

fn main() -> ExitCode {
    let tests = vec![
        test("a_touch_is_drawn", a_touch_is_drawn),
        test("the_name_of_a_part_is_text", the_name_of_a_part_is_text),
        test("a_log_is_drawn", a_log_is_drawn),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

/// A test that is ignored where there is no browser.
fn test(name: &'static str, claim: fn()) -> Trial {
    let run = move || {
        claim();
        Ok(())
    };
    Trial::test(name, run).with_ignored_flag(browser().is_none())
}

fn browser() -> Option<PathBuf> {
    if let Some(named) = env::var_os("TACTILE_CHROMIUM") {
        return Some(named.into());
    }
    let folders = env::var_os("PATH")?;
    env::split_paths(&folders).map(|folder| folder.join("chromium")).find(|file| file.exists())
}

/// What a page is once its scripts have run.
fn shown(served: &Served) -> String {
    let profile = tempfile::tempdir().unwrap();
    let mut command = Command::new(browser().unwrap());
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]);
    command.args(["--disable-background-networking", "--disable-component-update", "--virtual-time-budget=3000"]);
    command.arg(format!("--user-data-dir={}", profile.path().display()));
    command.args(["--dump-dom", &format!("http://{}/", served.address)]).stderr(Stdio::null());
    String::from_utf8(command.output().unwrap().stdout).unwrap()
}

fn a_touch_is_drawn() {
    let sample = Sample::shared();
    let served = Served::of_sample(&sample);
    let before = shown(&served);
    assert!(before.contains("Begin within the dashed square") && before.contains("class=\"reach\""), "{before}");
    assert!(!before.contains("class=\"sensor last\""));
    let (_, text) = served.post("touch", &json!({ "x_mm": 0.5, "y_mm": -0.5, "theta_deg": 10.0 }));
    let state: Value = serde_json::from_str(&text).unwrap();
    let page = shown(&served);
    for drawn in ["class=\"sensor last\"", "class=\"named\"", "class=\"next\"", "1 touch."] {
        assert!(page.contains(drawn), "{drawn}: {page}");
    }
    assert!(
        !page.contains("class=\"reach\"")
            && page.matches("class=\"bar\"").count() == state["parts"].as_array().unwrap().len()
    );
}

/// A part whose name would be a picture that runs a script, were it no text.
fn the_name_of_a_part_is_text() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let square = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10" width="10mm" height="10mm"><path d="M0 0H10V10H0Z"/></svg>"#;
    fs::write(folder.path().join("square.svg"), square).unwrap();
    let scene = fs::read_to_string(sample.folder().join("two.toml")).unwrap();
    let name = "<img src=x onerror=document.title=1>";
    let part = format!("[[parts.files]]\nname = \"{name}\"\npeg = \"square.svg\"\n\n[reach]");
    let hostile = folder.path().join("hostile.toml");
    fs::write(&hostile, scene.replace("[reach]", &part)).unwrap();
    let model = sample.folder().join("model/model.safetensors");
    let text = |path: &Path| path.display().to_string();
    let served = Served::start(
        folder.path(),
        &["try", "--scene", &text(&hostile), "--model", &text(&model), "--page", "127.0.0.1:0"],
    );
    let page = shown(&served);
    assert!(page.contains("&lt;img src=x onerror=document.title=1&gt;"), "{page}");
    assert!(!page.contains("<img src=\"x\"") && page.contains("<title>Tactile-Filter: touch a hole by hand</title>"));
}

fn a_log_is_drawn() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap").display().to_string();
    let live = ["live", "--simulate", "two.toml", "--episodes", "1", "--fast", "--log", &log];
    let model = ["--model", "model/model.safetensors", "--bank", "pegs.bank"];
    run("tactile-filter", sample.folder(), &[&live[..], &model].concat()).done();
    let served = Served::start(folder.path(), &["watch", "--log", &log, "--page", "127.0.0.1:0"]);
    // Messages come one after the other; the page asks until they are there.
    let ended = (0..100).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        served.read("view")["view"]["stop"].is_string()
    });
    assert!(ended);
    let picture = |at: &str| served.read(&format!("view{at}"))["picture"].clone();
    assert!(picture("").as_str().unwrap().starts_with("data:image/jpeg;base64,"), "{}", picture(""));
    assert!(picture("?at=0").is_null() && picture("?at=1e9") == picture(""));
    let page = shown(&served);
    assert!(page.contains("Stopped: ") && page.contains("Where the sensor is on ") && page.contains(" of "), "{page}");
    assert_eq!(page.matches("class=\"bar\"").count(), 2);
}

//! The pages of `tactile-filter try` and `watch --page` as a browser meets them, and as another site's page does.

use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use serde_json::{Value, json};
use tactile_tests::programs::run;
use tactile_tests::samples::Sample;
use tactile_tests::served::Served;

#[test]
fn a_hole_is_touched_shown_and_followed_by_another() {
    let sample = Sample::shared();
    let served = Served::of_sample(&sample);
    let (status, page) = served.ask("GET /", &[], "");
    assert!(status == 200 && page.contains("page.js") && page.contains("Touch a hole by hand"));
    // Nothing comes from elsewhere.
    for outside in ["http:", "https:", "//cdn"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let fresh = served.state();
    assert_eq!((&fresh["named"], &fresh["next"], &fresh["truth"]), (&Value::Null, &Value::Null, &Value::Null));
    assert_eq!(
        fresh["parts"].as_array().unwrap().iter().map(|part| part["name"].as_str()).collect::<Vec<_>>(),
        [Some("T"), Some("X")]
    );
    let press = |x: f64, y: f64, deg: f64| json!({ "x_mm": x, "y_mm": y, "theta_deg": deg });
    // The filter looks for the hole within 4 mm and 30 degrees of the first touch; half of it is the hole's.
    for far in [press(2.5, 0.0, 0.0), press(0.0, 0.0, 16.0), press(9.0, 0.0, 0.0)] {
        let (status, why) = served.post("touch", &far);
        assert!(status == 400 && why.starts_with("touch: expected a "), "{why}");
    }
    assert_eq!(served.state(), fresh);
    let (status, text) = served.post("touch", &press(0.5, -0.5, 10.0));
    let state: Value = serde_json::from_str(&text).unwrap();
    assert!(status == 200 && state == served.state() && state["touches"].as_array().unwrap().len() == 1);
    let sum: f64 = state["parts"].as_array().unwrap().iter().map(|part| part["probability"].as_f64().unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-9 && state["picture"] != fresh["picture"] && state["changed"].is_string());
    assert!(state["named"]["stop"].is_null() && state["next"].is_object());
    let (status, text) = served.post("touch", &state["next"]);
    assert!(status == 200 && serde_json::from_str::<Value>(&text).unwrap()["touches"].as_array().unwrap().len() == 2);
    let (_, text) = served.post("show", &json!({}));
    assert!(serde_json::from_str::<Value>(&text).unwrap()["truth"].is_array());
    let (_, text) = served.post("renew", &json!({}));
    let renewed: Value = serde_json::from_str(&text).unwrap();
    assert!(renewed["touches"] == json!([]) && renewed["named"].is_null() && renewed["truth"].is_null());
}

#[test]
fn pages_of_other_sites_and_slow_clients_change_nothing() {
    let sample = Sample::shared();
    let served = Served::of_sample(&sample);
    let fresh = served.state();
    let json = ("Content-Type", "application/json");
    let press = r#"{"x_mm":0,"y_mm":0,"theta_deg":0}"#;
    // Half of a request, many times: the others are answered.
    let slow: Vec<TcpStream> = (0..200)
        .map(|_| {
            let mut stream = served.connect();
            stream.write_all(b"POST /touch HTTP/1.1\r\nHost: ").unwrap();
            stream
        })
        .collect();
    let port = served.address.rsplit(':').next().unwrap();
    for (headers, body) in [
        // A name of another site that leads here.
        (vec![("Host", "evil.example"), json], press),
        (vec![json, ("Origin", "http://evil.example")], press),
        (vec![json, ("Origin", "null")], press),
        // What a form of another site can send.
        (vec![("Content-Type", "text/plain")], press),
        (vec![], press),
        (vec![json], "{}"),
        (vec![json], "[[[["),
        (vec![json], r#"{"x_mm":1e999,"y_mm":0,"theta_deg":0}"#),
        (vec![json], r#"{"x_mm":0,"y_mm":0,"theta_deg":0,"more":1}"#),
        (vec![json], &"x".repeat(5000)),
    ] {
        let (status, why) = served.ask("POST /touch", &headers, body);
        assert!(status == 400 && !why.is_empty() && why.len() < 300, "{status} {why}");
    }
    for line in ["GET /../Cargo.toml", "GET /page.html", "GET /touch", "POST /state", "GET /%2e%2e/x"] {
        let headers = if line.starts_with("POST") { vec![json] } else { vec![] };
        assert_eq!(served.ask(line, &headers, "").0, 404, "{line}");
    }
    assert_eq!(served.ask("DELETE /state", &[], "").0, 400);
    assert_eq!(served.state(), fresh);
    // By this machine's own name it is the same page.
    let local = format!("localhost:{port}");
    assert_eq!(
        served.ask("POST /touch", &[("Host", &local), json, ("Origin", &format!("http://{local}"))], press).0,
        200
    );
    drop(slow);
    let taken = [
        "try",
        "--page",
        &served.address,
        "--model",
        "model/model.safetensors",
        "--bank",
        "pegs.bank",
        "--scene",
        "two.toml",
    ];
    let ran = run("tactile-filter", sample.folder(), &taken);
    assert!(ran.failed().contains("--page: expected an address such as 127.0.0.1:8765 that is free"), "{ran:#?}");
}

#[test]
fn a_log_is_shown_in_a_page() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap").display().to_string();
    let model = ["--model", "model/model.safetensors", "--bank", "pegs.bank"];
    let live = ["live", "--simulate", "two.toml", "--episodes", "1", "--fast", "--log", &log, "--page", "127.0.0.1:0"];
    let ran = run("tactile-filter", sample.folder(), &[&live[..], &model].concat());
    assert!(ran.done().contains("touch 1") && ran.stderr.contains("http://127.0.0.1:"), "{ran:#?}");
    let served = Served::start(folder.path(), &["watch", "--log", &log, "--page", "127.0.0.1:0"]);
    let (status, page) = served.ask("GET /", &[], "");
    assert!(status == 200 && page.contains("live.js"));
    assert_eq!([served.ask("GET /live.js", &[], "").0, served.ask("GET /state", &[], "").0], [200, 404]);
    assert_eq!(served.ask("GET /view", &[("Host", "evil.example")], "").0, 400);
    // The messages arrive one after the other.
    let shown = (0..100).map(|_| {
        std::thread::sleep(Duration::from_millis(100));
        served.read("view")
    });
    let shown = shown.into_iter().find(|shown| shown["view"]["stop"].is_string()).expect("the episode's end");
    let view = &shown["view"];
    let names: Vec<&str> =
        view["parts"].as_array().unwrap().iter().map(|part| part["name"].as_str().unwrap()).collect();
    assert!(names.len() == 2 && names.contains(&"T") && names.contains(&"X"));
    assert_eq!(view["touches"].as_array().unwrap().len(), shown["touched"].as_array().unwrap().len());
    // The slider: before the first touch nothing is known, after it one touch.
    let (start, end) = (served.read("view?at=0"), shown["end_s"].as_f64().unwrap());
    assert!(start["view"]["place"].is_null() && end > 0.0);
    let moments = (0..=200).map(|n| served.read(&format!("view?at={}", end * f64::from(n) / 200.0)));
    let counts: Vec<usize> = moments.map(|at| at["view"]["touches"].as_array().unwrap().len()).collect();
    assert!(counts.is_sorted() && counts.last() == Some(&view["touches"].as_array().unwrap().len()), "{counts:?}");
    for wrong in ["view?at=", "view?at=nan", "view?at=1e999", "view?at=x"] {
        assert_eq!(served.ask(&format!("GET /{wrong}"), &[], "").0, 400, "{wrong}");
    }
    assert!(view["place"]["probability"].is_number() && view["camera"]["is_good"].is_boolean());
}

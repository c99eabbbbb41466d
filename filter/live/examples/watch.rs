//! The terminal view with an episode that is made up: a belief that narrows over ten touches, with a fault in between.
//!
//!     cargo run --release -p tactile-live --features watch --example watch

use std::time::{Duration, Instant};

use tactile_data::pose::se2::Se2;
use tactile_live::watch::{Camera, Feed, Level, Message, Part, Place, PlaceMap, Pressed, View, run};

/// A touch every so many seconds, and a fault instead of the third.
const STEP_S: f64 = 1.5;
const N_TOUCHES: usize = 8;
const FAULT: usize = 3;

fn main() -> std::io::Result<()> {
    let start = Instant::now();
    run(|wait: Duration| {
        std::thread::sleep(wait);
        Feed::View(Box::new(made_up(start.elapsed().as_secs_f64())))
    })
}

/// The view after so many seconds.
fn made_up(time_s: f64) -> View {
    let n = ((time_s / STEP_S) as usize).min(N_TOUCHES);
    let sureness = n as f64 / N_TOUCHES as f64;
    let pose = (0..=n).fold(Se2::from_degrees(-3.0, 2.0, 30.0), |pose, touch| pose * motion(touch));
    let is_faulty = (FAULT as f64..FAULT as f64 + 0.7).contains(&(time_s / STEP_S));
    let probabilities = probabilities(sureness);
    let part = |(name, probability): (char, f64)| Part {
        name: name.into(),
        probability,
        map: Some(map(&pose, probability, sureness, name)),
    };
    let parts: Vec<Part> = ('A'..='L').zip(probabilities).map(part).collect();
    let mut view = View {
        time_s,
        status: if n == N_TOUCHES { "done" } else { "waiting for contact" }.into(),
        parts,
        sensor_from_next: (n < N_TOUCHES).then(|| motion(n + 1)),
        touches: (0..=n).map(touch).collect(),
        entropy_nats: Some(6.5 * (1.0 - sureness)),
        camera: Camera { frames_per_s: Some(25.0), age_s: Some(time_s % 0.04), is_good: !is_faulty },
        messages: messages(n, time_s),
        stop: (n == N_TOUCHES).then(|| "confident".into()),
        ..View::default()
    };
    view.sort();
    let likeliest = &view.parts[0];
    view.place = Some(Place {
        part: likeliest.name.clone(),
        probability: likeliest.probability,
        other: (n < N_TOUCHES).then(|| view.parts[1].name.clone()),
        part_from_sensor: pose,
        sd_mm: [3.0 * (1.0 - sureness) + 0.1; 2],
        sd_deg: 20.0 * (1.0 - sureness) + 0.8,
    });
    view
}

/// From all alike to nearly sure of G.
fn probabilities(sureness: f64) -> [f64; 12] {
    let weight = |part: usize| (8.0 * sureness * if part == 6 { 1.0 } else { 0.3 * (part as f64 * 2.1).sin() }).exp();
    let sum: f64 = (0..12).map(weight).sum();
    std::array::from_fn(|part| weight(part) / sum)
}

/// A hill around the pose that narrows, and a lower one on the other side.
fn map(pose: &Se2, probability: f64, sureness: f64, name: char) -> PlaceMap {
    let (n_xy, half_mm) = (17, 8.0);
    let width = 6.0 * (1.0 - sureness) + 0.7;
    let shift = if name == 'G' { 0.0 } else { f64::from(name as u32 % 5) - 2.0 };
    let hill =
        |x: f64, y: f64, at: [f64; 2]| (-((x - at[0]).powi(2) + (y - at[1]).powi(2)) / (2.0 * width * width)).exp();
    let value = |cell: usize| {
        let mm = |index: usize| index as f64 - half_mm;
        let (x, y) = (mm(cell / n_xy), mm(cell % n_xy));
        let at = [pose.x_mm + shift, pose.y_mm - shift];
        hill(x, y, at) + 0.5 * (1.0 - sureness) * hill(x, y, [-at[0], -at[1]])
    };
    let values: Vec<f64> = (0..n_xy * n_xy).map(value).collect();
    let sum: f64 = values.iter().sum();
    PlaceMap { n_xy, half_mm, values: values.iter().map(|value| value / sum * probability).collect() }
}

fn motion(touch: usize) -> Se2 {
    let turn = touch as f64 * 2.4;
    if touch == 0 || touch == FAULT { Se2::IDENTITY } else { Se2::new(4.0 * turn.cos(), 4.0 * turn.sin(), 0.1) }
}

fn touch(n: usize) -> Pressed {
    let refused = (n == FAULT).then(|| "frame: saturated, mean 243 of 255".into());
    Pressed { moved: motion(n), edge_share: refused.is_none().then_some(0.08 + 0.02 * n as f32), refused }
}

fn messages(n: usize, time_s: f64) -> Vec<Message> {
    let message = |time_s, level, text: &str| Message { time_s, level, text: text.into() };
    let mut messages = vec![message(0.0, Level::Info, "model a8f8e6c56406, bank of 12 parts, seed 1")];
    if n >= FAULT {
        let at = FAULT as f64 * STEP_S;
        messages.push(message(at, Level::Warning, "camera: saturated frames, mean 243 of 255; touch again"));
        if time_s > at + 1.0 {
            messages.push(message(at + 1.0, Level::Info, "camera: frames are good again"));
        }
    }
    if n == N_TOUCHES {
        messages.push(message(N_TOUCHES as f64 * STEP_S, Level::Info, "confident: part G"));
    }
    messages
}

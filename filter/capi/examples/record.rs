//! Makes what the C and C++ examples read, with a simulated sensor over a simulated hole: model, bank, the frame at rest,
//! the frames of one whole episode, and what the episode says in Rust.
//!
//!     cargo run --release --package tactile-capi --example record -- FOLDER [--fine]
//!
//! Three letters turned by at most 30 degrees, made in seconds; or 12 letters turned by up to 90 degrees, a bank as a robot
//! uses, made in a minute or two.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::{Kit, Parts, Scene};
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::{Decision, Episode, EpisodeConfig, Estimate, RunnerUp, Sensor, Settings, StopReason};
use tactile_infer::Model;
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The model that comes with the project.
const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../infer/models/maze-small.safetensors");

#[allow(dead_code, reason = "a test uses the rest of this file")]
fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let Some(folder) = args.next() else { return Err("which folder? record FOLDER [--fine]".into()) };
    let scene = match args.next().as_deref() {
        None => small_scene()?,
        Some("--fine") => fine_scene()?,
        Some(other) => return Err(format!("expected --fine, got {other}").into()),
    };
    std::fs::create_dir_all(&folder)?;
    print!("{}", record(folder.as_ref(), scene)?);
    Ok(())
}

/// Three letters, turned by at most 30 degrees.
pub fn small_scene() -> Result<Scene> {
    let mut scene = Scene::load("alphabet-small")?;
    scene.parts = Parts::Kit(Kit::of_letters("KLT", 12.0, 16.0));
    scene.reach = Some(PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 });
    Ok(scene)
}

/// Twelve letters every 2 mm and 15 degrees.
fn fine_scene() -> Result<Scene> {
    let mut scene = Scene::load("alphabet-small")?;
    scene.reach = scene.reach.map(|reach| PoseGrid { xy_step_mm: 2.0, theta_step_deg: 15.0, ..reach });
    Ok(scene)
}

/// Writes everything into a folder, and returns what the examples will print.
pub fn record(folder: &Path, scene: Scene) -> Result<String> {
    std::fs::copy(MODEL, folder.join("model.safetensors"))?;
    let model = Arc::new(Model::load(MODEL.as_ref())?);
    let bank = Arc::new(bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ())?);
    bank.save(&folder.join("parts.bank"))?;
    let simulator = Simulator::new(scene, 1)?;
    let at_rest = simulator.no_contact(7);
    write_ppm(&folder.join("rest.ppm"), &at_rest)?;
    let touch = |n: u64, part_from_sensor: &Se2| -> Result<Frame> {
        let frame = simulator.touch(1, Side::Hole, part_from_sensor, &mut frame_rng(7, n))?;
        write_ppm(&folder.join(format!("touch-{n}.ppm")), &frame)?;
        Ok(frame)
    };

    let mut part_from_sensor = Se2::from_degrees(2.0, -1.0, 20.0);
    let sensor = Sensor::new(model.clone(), &at_rest)?;
    let first = sensor.observe(&touch(1, &part_from_sensor)?)?;
    let mut config = EpisodeConfig::of(&model);
    config.settings = Settings { stop_place_mm: Some(0.3), n_finalists: None, ..config.settings };
    let mut episode = Episode::begin(config, bank.clone(), &first)?;
    // Motions of up to 8 mm along x and y.
    let reach: Vec<Se2> =
        (0..81).map(|i| Se2::new(2.0 * f64::from(i % 9 - 4), 2.0 * f64::from(i / 9 - 4), 0.0)).collect();
    let mut lines = String::new();
    for n in 2.. {
        match episode.decide(&reach)? {
            Decision::Touch(action) => {
                let Se2 { x_mm, y_mm, theta_rad } = action.sensor_from_next;
                writeln!(lines, "touch {n} after a motion of {x_mm} {y_mm} {theta_rad}")?;
                part_from_sensor = part_from_sensor * action.sensor_from_next;
                episode.observe(action.sensor_from_next, &sensor.observe(&touch(n, &part_from_sensor)?)?)?;
            }
            Decision::Done(estimate, reason) => {
                conclusion(&mut lines, &estimate, reason, bank.parts())?;
                break;
            }
        }
    }
    std::fs::write(folder.join("expected.txt"), &lines)?;
    Ok(lines)
}

fn conclusion(lines: &mut String, estimate: &Estimate, reason: StopReason, parts: &[String]) -> Result<()> {
    let reason = match reason {
        StopReason::Confident => "confident",
        StopReason::NoneOfThese => "none of these",
        StopReason::TouchLimit => "touch limit",
        StopReason::NothingToLearn => "nothing to learn",
    };
    writeln!(lines, "stop: {reason} after {} touches", estimate.n_touches)?;
    writeln!(lines, "part {} probability {}", estimate.part, estimate.probability)?;
    for pose in [estimate.part_from_sensor, estimate.part_from_first] {
        writeln!(lines, "pose {} {} {}", pose.x_mm, pose.y_mm, pose.theta_rad)?;
    }
    let covariance = estimate.covariance.as_flattened().iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    writeln!(lines, "covariance {covariance}")?;
    writeln!(lines, "fit {} entropy {}", estimate.fit.unwrap_or_default(), estimate.entropy_nats)?;
    match &estimate.runner_up {
        Some(RunnerUp { part, probability }) => writeln!(lines, "runner-up {part} probability {probability}")?,
        None => writeln!(lines, "no runner-up")?,
    }
    for (part, probability) in parts.iter().zip(&estimate.class_posterior) {
        writeln!(lines, "posterior {part} {probability}")?;
    }
    for mode in &estimate.modes {
        let pose = mode.part_from_sensor;
        writeln!(lines, "mode {} {} at {} {} {}", parts[mode.part], mode.mass, pose.x_mm, pose.y_mm, pose.theta_rad)?;
    }
    Ok(())
}

/// The simplest picture file: a line of text, then the bytes.
fn write_ppm(path: &Path, frame: &Frame) -> Result<()> {
    let mut bytes = format!("P6 {} {} 255\n", frame.width_px(), frame.height_px()).into_bytes();
    bytes.extend_from_slice(frame.rgb());
    Ok(std::fs::write(path, bytes)?)
}

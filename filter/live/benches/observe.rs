//! From the call of `~/observe` to the next action, and what a picture between touches costs: the node alone, on one core,
//! over touches anywhere on the small board. The network's time comes on top (`cargo xtask dds`).
//!
//!     cargo bench -p tactile-live --features robot

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_infer::Model;
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;
use tactile_live::robot::{Heard, Robot, RobotSettings, Sent};
use tactile_live::{Event, Input, Node, Output, Parameters, Request, Topic};

/// Holes that are identified.
const N_EPISODES: usize = 40;

/// Between two ticks, nanoseconds.
const TICK_NS: i64 = 20_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // `cargo test --benches` only asks whether it builds.
    if std::env::args().any(|word| word == "--test") {
        return Ok(());
    }
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../../infer/models/maze-small.safetensors");
    let model = Arc::new(Model::load(Path::new(model))?);
    let mut scene = Scene::load("alphabet-small")?;
    if let Some(reach) = &mut scene.reach {
        (reach.xy_step_mm, reach.theta_step_deg) = (2.0, 15.0);
    }
    let bank = Arc::new(bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ())?);
    for (name, jpeg) in [("pixels", None), ("JPEG", Some(90))] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        let settings = RobotSettings { n_episodes: N_EPISODES, jpeg, ..RobotSettings::default() };
        let robot = Robot::new(settings, Simulator::new(scene.clone(), 1)?)?;
        let node = Node::new(Parameters::default(), Arc::clone(&model), Arc::clone(&bank))?;
        let [mut observed, mut pictures] = pool.install(|| run(node, robot))?;
        for (what, times_ms) in [("observe to next action", &mut observed), ("picture", &mut pictures)] {
            times_ms.sort_by(f64::total_cmp);
            let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
            println!("{name}: {what}: p50 {:.2} ms, p99 {:.2} ms, {} of them", at(0.5), at(0.99), times_ms.len());
        }
    }
    Ok(())
}

/// Milliseconds of each call that led to a next action at once, and of each picture that led to nothing.
fn run(mut node: Node, mut robot: Robot) -> Result<[Vec<f64>; 2], tactile_live::Error> {
    let (mut observed, mut pictures) = (Vec::new(), Vec::new());
    let mut time_ns = 1_700_000_000_000_000_000;
    let mut n_calls = 0;
    while !robot.is_finished() {
        time_ns += TICK_NS;
        node.step(&Event { time_ns, input: Input::Tick });
        let mut heard = vec![Heard::Tick];
        while let Some(next) = heard.pop() {
            for sent in robot.step(time_ns, &next)? {
                let input = match sent {
                    Sent::Given(given, cdr) => Input::Given(given, cdr),
                    Sent::Call(request) => {
                        n_calls += 1;
                        Input::Called { request, id: n_calls }
                    }
                    Sent::Say(_) => continue,
                };
                let is_observe = matches!(input, Input::Called { request: Request::Observe, .. });
                let is_picture = matches!(&input, Input::Given(given, _) if given.is_picture());
                let event = Event { time_ns, input };
                let start = Instant::now();
                let outputs = node.step(&event);
                let ms = start.elapsed().as_secs_f64() * 1e3;
                let is_next = |output: &Output| matches!(output, Output::Publish { topic: Topic::NextAction, .. });
                if is_observe && outputs.iter().any(is_next) {
                    observed.push(ms);
                } else if is_picture && outputs.is_empty() {
                    pictures.push(ms);
                }
                heard.extend(outputs.into_iter().filter_map(heard_of));
            }
        }
    }
    Ok([observed, pictures])
}

fn heard_of(output: Output) -> Option<Heard> {
    match output {
        Output::Publish { topic: Topic::NextPose, cdr } => Some(Heard::NextPose(cdr)),
        Output::Publish { topic: Topic::Decision, cdr } => Some(Heard::Decision(cdr)),
        Output::Answer { success, message, .. } => Some(Heard::Answer { success, message }),
        Output::Publish { .. } => None,
    }
}

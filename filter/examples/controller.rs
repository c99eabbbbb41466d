//! A robot controller that finds by touch which peg fits a hole, and where the hole is. Robot and camera are simulated.
//!
//!     cargo run --release --example controller

use std::error::Error;
use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::{Decision, Episode, EpisodeConfig, Error as FilterError, Sensor};
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::{Bank, Model};

fn main() -> Result<(), Box<dyn Error>> {
    let model_path = concat!(env!("CARGO_MANIFEST_DIR"), "/../infer/models/maze-small.safetensors");
    let bank_path = std::env::temp_dir().join(format!("controller-{}.bank", std::process::id()));
    let reach = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };
    let scene = Scene { reach: Some(reach), ..Scene::load("alphabet-small")? };
    let desk = Model::load(model_path.as_ref())?;
    bank_of_scene(&desk, &scene, Views::Both, 1, &|_, _| ())?.save(&bank_path)?; // once, at the desk
    let truth = Se2::from_degrees(3.0, -2.0, 20.0);
    let mut robot = Robot { simulator: Simulator::new(scene, 1)?, part: 6, part_from_sensor: truth, n_touches: 0 };

    let model = Arc::new(Model::load(model_path.as_ref())?);
    let bank = Bank::load(&bank_path, &model)?;
    let sensor = Sensor::new(model.clone(), &robot.frame_at_rest())?;
    let first = sensor.observe(&robot.touch()?)?;
    let mut episode = Episode::begin(EpisodeConfig::of(&model), Arc::new(bank), &first)?;
    let mut moved = Se2::IDENTITY; // since the last touch that was taken in
    let (estimate, reason) = loop {
        match episode.decide(&robot.reach())? {
            Decision::Done(estimate, reason) => break (estimate, reason),
            Decision::Touch(action) => {
                moved = moved * robot.go(action.sensor_from_next); // the motion really made
                match sensor.observe(&robot.touch()?).and_then(|touch| episode.observe(moved, &touch)) {
                    Ok(()) => moved = Se2::IDENTITY,
                    Err(error @ (FilterError::Frame { .. } | FilterError::FrozenFrame { .. })) => eprintln!("{error}"),
                    Err(error) => return Err(error.into()),
                }
            }
        }
    };
    println!("{reason:?} after {} touches, {:.1} % sure", estimate.n_touches, 100.0 * estimate.probability);
    let names = [estimate.part.as_str(), robot.simulator.parts()[robot.part].as_str()];
    for (name, pose) in names.into_iter().zip([estimate.part_from_sensor, robot.part_from_sensor]) {
        println!("part {name} at {:.2} mm, {:.2} mm, {:.1} degrees", pose.x_mm, pose.y_mm, pose.theta_deg());
    }
    Ok(std::fs::remove_file(bank_path)?)
}

/// A simulated robot with its sensor over a hole. Yours moves an arm and reads a camera.
struct Robot {
    simulator: Simulator,
    part: usize,
    part_from_sensor: Se2,
    n_touches: u64,
}

impl Robot {
    fn frame_at_rest(&self) -> Frame {
        self.simulator.no_contact(7)
    }
    fn touch(&mut self) -> Result<Frame, tactile_data::Error> {
        self.n_touches += 1;
        self.simulator.touch(self.part, Side::Hole, &self.part_from_sensor, &mut frame_rng(7, self.n_touches))
    }
    fn go(&mut self, sensor_from_next: Se2) -> Se2 {
        self.part_from_sensor = self.part_from_sensor * sensor_from_next;
        sensor_from_next
    }
    /// Motions of up to 8 mm along x and y, in the sensor's frame.
    fn reach(&self) -> Vec<Se2> {
        (0..81).map(|i| Se2::from_degrees(2.0 * f64::from(i % 9 - 4), 2.0 * f64::from(i / 9 - 4), 0.0)).collect()
    }
}

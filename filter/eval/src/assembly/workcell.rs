//! A simulated robot that touches holes and puts pegs in.
//!
//! The simulated robot's side knows where the sensor is, the episodes do not. A peg is in where its outline,
//! brought to the pose that was estimated, goes into the hole's opening ([`Shape::fits_in`]): geometry decides, so
//! that twins of a symmetric part are as good as each other, and a wrong peg that is small enough goes in too.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rand::RngExt;
use rand::seq::SliceRandom;
use tactile_data::frame::Frame;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_data::shape::Shape;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::symmetry::Symmetry;
use tactile_data::touch::Side;
use tactile_filter::{Decision, Episode, EpisodeConfig, Estimate, Sensor, StopReason};
use tactile_infer::Bank;
use tactile_infer::threads;

use super::attempt::{Attempt, Task};
use crate::error::{Error, Result};
use crate::hole::{Hole, observe};
use crate::holes::Holes;
use crate::result::Poses;

/// What a watcher is shown after each touch.
pub struct Moment<'m> {
    /// The hole, with the truth.
    pub hole: &'m Hole<'m>,
    /// What the camera saw.
    pub frame: &'m Frame,
    /// What is believed.
    pub episode: &'m Episode,
    /// The pegs that the robot still has.
    pub bank: &'m Bank,
}

/// Who watches a trial.
pub type Watch<'w> = &'w mut dyn FnMut(&Moment<'_>) -> Result<()>;

/// A simulated robot before a scene, its pegs in hand.
#[derive(Debug)]
pub struct Workcell<'a> {
    simulator: &'a Simulator,
    sensor: &'a Sensor,
    bank: &'a Arc<Bank>,
    config: &'a EpisodeConfig,
    task: &'a Task,
    reach: PoseGrid,
    pegs: Vec<Shape>,
    openings: Vec<(Shape, f64)>,
}

impl<'a> Workcell<'a> {
    /// Prepares the task.
    ///
    /// # Errors
    /// A task without trials or seeds, a grasp error that is none, a bank of other parts than the scene's, a
    /// scene whose pegs go into no holes.
    pub fn new(
        simulator: &'a Simulator,
        sensor: &'a Sensor,
        bank: &'a Arc<Bank>,
        config: &'a EpisodeConfig,
        task: &'a Task,
    ) -> Result<Self> {
        if task.n_trials == 0 || task.seeds.is_empty() {
            let got = format!("{} trials of {} seeds", task.n_trials, task.seeds.len());
            return Err(Error::invalid("assembly", "trials and seeds", got));
        }
        for (field, value, most) in
            [("grasp-error, mm", task.grasp_error_mm, 100.0), ("grasp-error, degrees", task.grasp_error_deg, 180.0)]
        {
            if !(0.0..=most).contains(&value) {
                return Err(Error::invalid(field, format!("0 to {most}"), value.to_string()));
            }
        }
        config.validate()?;
        let (scene, parts) = (simulator.scene(), simulator.parts());
        let openings = (0..parts.len()).map(|part| scene.opening(part)).collect::<std::result::Result<_, _>>()?;
        let pegs = (0..parts.len()).map(|part| scene.shape(part, 0)).collect::<std::result::Result<_, _>>()?;
        if parts != bank.parts() {
            let expected = format!("the scene's parts {}", parts.join(" "));
            return Err(Error::invalid("bank", expected, bank.parts().join(" ")));
        }
        let reach = scene.reach.unwrap_or(*bank.start());
        Ok(Self { simulator, sensor, bank, config, task, reach, pegs, openings })
    }

    /// The scene.
    pub fn simulator(&self) -> &Simulator {
        self.simulator
    }

    /// How the filter infers, chooses and stops.
    pub fn config(&self) -> &EpisodeConfig {
        self.config
    }

    /// Runs all trials, as many at a time as the pool has threads; trials in order, in each the holes in the order they
    /// were tried. The same task gives the same attempts, but for their times. `progress` is called with trials done and trials in all.
    ///
    /// # Errors
    /// A hole that cannot be touched, a frame that cannot be seen.
    pub fn run(&self, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Vec<Vec<Attempt>>> {
        let done = AtomicUsize::new(0);
        let run_one = |index| {
            let attempts = self.trial(index, &mut |_| Ok(()));
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, self.task.n_trials);
            attempts
        };
        threads::each(0..self.task.n_trials, run_one)
    }

    /// Runs one trial: each hole once, in an order drawn from the seed. A peg that is in, be it the right one or
    /// not, is no longer there for later holes; one that does not go in stays with the robot.
    ///
    /// # Errors
    /// As [`Self::run`], and what the watcher returns.
    pub fn trial(&self, index: usize, watch: Watch<'_>) -> Result<Vec<Attempt>> {
        let n_parts = self.pegs.len();
        let seed = self.task.seeds[index % self.task.seeds.len()];
        let mut rng = frame_rng(seed ^ 0x6772_6173, index as u64);
        let mut order: Vec<usize> = (0..n_parts).collect();
        order.shuffle(&mut rng);
        let mut in_hand = InHand { bank: self.bank.clone(), held_from_peg: Se2::IDENTITY };
        let mut attempts = Vec::with_capacity(n_parts);
        for (turn, part) in order.into_iter().enumerate() {
            let mut up_to = |most: f64| most * (2.0 * rng.random::<f64>() - 1.0);
            let (mm, deg) = (self.task.grasp_error_mm, self.task.grasp_error_deg);
            in_hand.held_from_peg = Se2::from_degrees(up_to(mm), up_to(mm), up_to(deg));
            let number = index * n_parts + turn;
            let hole = Hole::of_part(Holes::Simulated(self.simulator, Side::Hole), part, &self.reach, seed, number);
            let config = self.config.changed(|settings, _, _| settings.seed = seed.wrapping_add(number as u64));
            let attempt = self.attempt(hole, &in_hand, config, watch)?;
            let bank = &in_hand.bank;
            let gone = bank.parts().iter().position(|name| *name == self.simulator.parts()[attempt.named]);
            if let Some(gone) = gone.filter(|_| attempt.went_in && bank.parts().len() > 1) {
                in_hand.bank = Arc::new(bank.without(gone)?);
            }
            attempts.push(attempt);
        }
        Ok(attempts)
    }

    /// Touches a hole until the episode's own rule ends it, then tries the peg that was named.
    fn attempt(
        &self,
        mut hole: Hole<'_>,
        in_hand: &InHand,
        config: EpisodeConfig,
        watch: Watch<'_>,
    ) -> Result<Attempt> {
        let InHand { bank, held_from_peg } = in_hand;
        let mut decision_ms = Vec::new();
        let mut frame = hole.touch()?;
        let mut started = Instant::now();
        let mut episode = Episode::begin(config, bank.clone(), &observe(self.sensor, &frame)?)?;
        loop {
            let decision = episode.decide(&hole.reach(bank.start(), Poses::OffGrid))?;
            decision_ms.push(started.elapsed().as_secs_f64() * 1e3);
            watch(&Moment { hole: &hole, frame: &frame, episode: &episode, bank })?;
            let action = match decision {
                Decision::Touch(action) => action,
                Decision::Done(estimate, stop) => {
                    let tried = self.insert(&hole, &estimate, held_from_peg)?;
                    let n_pegs = bank.parts().len();
                    return Ok(Attempt { n_pegs, stop, decision_ms, ..tried });
                }
            };
            let moved = hole.go(&action);
            frame = hole.touch()?;
            started = Instant::now();
            episode.observe(moved, &observe(self.sensor, &frame)?)?;
        }
    }

    /// Brings the named peg to where its hole is believed to be, as the robot holds it.
    fn insert(&self, hole: &Hole<'_>, estimate: &Estimate, held_from_peg: &Se2) -> Result<Attempt> {
        let part = hole.part_index();
        let named = self
            .simulator
            .parts()
            .iter()
            .position(|name| *name == estimate.part)
            .ok_or_else(|| Error::invalid("estimate", "a part of the scene", estimate.part.clone()))?;
        let hole_from_peg = brought(&hole.part_from_sensor(), &estimate.part_from_sensor, held_from_peg);
        let (opening, clearance_mm) = &self.openings[part];
        let (xy_mm, theta_deg) = error(&hole_from_peg, &self.simulator.symmetry(part));
        Ok(Attempt {
            part,
            named,
            n_pegs: 0,
            stop: StopReason::TouchLimit,
            n_touches: estimate.n_touches,
            probability: estimate.probability,
            fit: estimate.fit,
            went_in: self.pegs[named].fits_in(opening, *clearance_mm, &hole_from_peg),
            xy_mm,
            theta_deg,
            decision_ms: Vec::new(),
        })
    }
}

/// The pegs that the robot still has, and how it holds the one that it tries.
struct InHand {
    bank: Arc<Bank>,
    held_from_peg: Se2,
}

/// Where a peg is in the frame of its hole: the robot knows where its sensor is and puts the peg's frame
/// where it believes the hole's to be.
fn brought(part_from_sensor: &Se2, believed_from_sensor: &Se2, held_from_peg: &Se2) -> Se2 {
    *part_from_sensor * believed_from_sensor.inverse() * *held_from_peg
}

/// How far a peg is off its hole, mm and degrees, to the nearest of its twins.
fn error(hole_from_peg: &Se2, symmetry: &Symmetry) -> (f64, f64) {
    let twin = symmetry.nearest_twin(&Se2::IDENTITY, hole_from_peg);
    (hole_from_peg.distance_mm(&twin), wrap_angle(hole_from_peg.theta_rad - twin.theta_rad).to_degrees().abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;
    use tactile_data::scene::{Kit, Parts, Scene};
    use tactile_data::sensor::Fidelity;
    use tactile_infer::architecture::NetworkConfig;
    use tactile_infer::checkpoint::{Checkpoint, Provenance};
    use tactile_infer::rows::Rows;
    use tactile_infer::{DeviceKind, Model};

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    fn scene(letters: &str) -> Scene {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters(letters, 12.0, 16.0));
        (scene.reach, scene.clearance_mm, scene.fidelity) = (Some(GRID), 1.0, Fidelity::Geometry);
        scene.sensor.frame_px = [80, 60];
        scene
    }

    /// A network that was not trained.
    fn model() -> Arc<Model> {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let preprocessing = tactile_data::frame::Preprocessing::counts([16, 12]);
        let checkpoint = Checkpoint::of(&network, config, preprocessing, Provenance::default());
        Arc::new(Model::new(checkpoint, "mine".into(), DeviceKind::Flex).unwrap())
    }

    fn bank(letters: &str) -> Arc<Bank> {
        let n_rows = letters.len() * GRID.len();
        let rows = (0..n_rows * 6).map(|i| (i as f32 * 0.7).sin() / 3.0).collect();
        let names = letters.chars().map(String::from).collect();
        let rows = Rows::new(6, rows).unwrap();
        Arc::new(Bank::from_rows(names, GRID, rows, vec![0.2; n_rows], "mine").unwrap())
    }

    fn task() -> Task {
        Task { n_trials: 3, seeds: vec![1, 2], grasp_error_mm: 0.5, grasp_error_deg: 1.0 }
    }

    /// What a workcell of a scene, a bank and a task gives.
    fn with<T>(scene: Scene, bank: &Arc<Bank>, task: &Task, then: impl FnOnce(&Workcell<'_>) -> T) -> Result<T> {
        let simulator = Simulator::new(scene, 1)?;
        let model = model();
        let sensor = Sensor::new(model, &simulator.no_contact(1))?;
        let config = EpisodeConfig::default().changed(|settings, _, _| settings.max_touches = 4);
        Workcell::new(&simulator, &sensor, bank, &config, task).map(|workcell| then(&workcell))
    }

    #[test]
    fn a_right_estimate_brings_the_peg_over_its_hole_wherever_the_sensor_is() {
        let truth = Se2::from_degrees(7.0, -3.0, 40.0);
        let held = Se2::from_degrees(0.3, -0.4, 0.5);
        let off = brought(&truth, &truth, &held);
        assert!(off.distance_mm(&held) < 1e-12 && (off.theta_rad - held.theta_rad).abs() < 1e-12);
        // A sensor at the hole's edge, believed 2 mm too far to the right: the peg is brought 2 mm to the left.
        let believed = Se2::new(9.0, -3.0, truth.theta_rad);
        let off = brought(&truth, &believed, &Se2::IDENTITY);
        assert!((off.x_mm + 2.0).abs() < 1e-12 && off.y_mm.abs() < 1e-12);
        // Turned about the sensor by 10 degrees, the part's centre moves on an arc: 2 r sin(5 degrees).
        let believed = truth * Se2::from_degrees(0.0, 0.0, 10.0);
        let (mm, deg) = error(&brought(&truth, &believed, &Se2::IDENTITY), &Symmetry::NONE);
        let arc = 2.0 * 58_f64.sqrt() * 5_f64.to_radians().sin();
        assert!((mm - arc).abs() < 1e-12 && (deg - 10.0).abs() < 1e-9);
    }

    #[test]
    fn an_error_is_to_the_nearer_twin() {
        let of = |order| Symmetry { order, ..Symmetry::NONE };
        let off = |deg: f64, order| error(&Se2::from_degrees(0.3, 0.4, deg), &of(order)).1;
        assert!((off(-178.0, Some(2)) - 2.0).abs() < 1e-9 && (off(-178.0, Some(1)) - 178.0).abs() < 1e-9);
        assert!((off(3.0, Some(2)) - 3.0).abs() < 1e-9 && (off(74.0, Some(5)) - 2.0).abs() < 1e-9);
        assert!(off(74.0, None) < 1e-9);
        assert!((error(&Se2::new(0.3, 0.4, PI), &of(Some(2))).0 - 0.5).abs() < 1e-12);
    }

    #[test]
    fn each_hole_is_tried_once_with_the_pegs_that_are_left_and_again_the_same() {
        let run = || with(scene("ITL"), &bank("ITL"), &task(), |cell| cell.run(&|_, _| ()).unwrap()).unwrap();
        let trials = run();
        assert_eq!(trials.len(), 3);
        for attempts in &trials {
            let mut holes: Vec<usize> = attempts.iter().map(|attempt| attempt.part).collect();
            holes.sort_unstable();
            assert_eq!(holes, [0, 1, 2]);
            let mut gone: Vec<usize> = Vec::new();
            for attempt in attempts {
                assert_eq!(attempt.n_pegs, 3 - gone.len());
                assert!(!gone.contains(&attempt.named));
                assert_eq!(attempt.decision_ms.len(), attempt.n_touches);
                gone.extend(attempt.went_in.then_some(attempt.named));
            }
        }
        let timeless = |trials: Vec<Vec<Attempt>>| -> Vec<Attempt> {
            trials.into_iter().flatten().map(|attempt| Attempt { decision_ms: Vec::new(), ..attempt }).collect()
        };
        assert_eq!(timeless(run()), timeless(trials));
    }

    #[test]
    fn a_task_that_is_none_is_refused() {
        let refused = |scene, bank: &Arc<Bank>, task| with(scene, bank, &task, |_| ()).unwrap_err().to_string();
        let (whole, held) = (bank("ITL"), |mm| Task { grasp_error_mm: mm, ..task() });
        for (task, expected) in [
            (Task { n_trials: 0, ..task() }, "assembly: expected trials and seeds, got 0 trials of 2 seeds"),
            (Task { seeds: vec![], ..task() }, "assembly: expected trials and seeds, got 3 trials of 0 seeds"),
            (held(-0.1), "grasp-error, mm: expected 0 to 100, got -0.1"),
            (held(f64::NAN), "grasp-error, mm: expected 0 to 100, got NaN"),
        ] {
            assert_eq!(refused(scene("ITL"), &whole, task), expected);
        }
        let other = refused(scene("ITX"), &whole, task());
        assert_eq!(other, "bank: expected the scene's parts I T X, got I T L");
        assert!(
            refused(Scene::preset("maze").unwrap(), &whole, task())
                .contains("pegs go into a hole: letters or files, got maze boards")
        );
        let connectors = Scene::preset("connectors").unwrap();
        assert!(refused(connectors, &whole, task()).contains("got the connector"));
    }
}

//! A simulated robot that touches holes and puts pegs in.
//!
//! The simulated robot's side knows where the sensor is, the episodes do not. A peg is in where its outline,
//! brought to the pose that was estimated, goes into the hole's opening ([`Shape::fits_in`]): geometry decides, so
//! that twins of a symmetric part are as good as each other, and a wrong peg that is small enough goes in too.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_data::pose::symmetry::Symmetry;
use tactile_data::scene::shape::Shape;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::insertion::{HeldPeg, Tried};
use tactile_filter::{Decision, Episode, EpisodeConfig, Estimate, Sensor};
use tactile_infer::Bank;
use tactile_infer::embedding::threads;

use super::attempt::{Attempt, Insertion, Task};
use super::in_hand::{Held, Peg};
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

/// The second sensor, on which held pegs are pressed, and how the filter infers from its touches.
#[derive(Debug)]
pub(super) struct PegSense {
    pub sensor: Sensor,
    pub config: EpisodeConfig,
}

/// A simulated robot before a scene, its pegs in hand.
#[derive(Debug)]
pub struct Workcell<'a> {
    simulator: &'a Simulator,
    sensor: &'a Sensor,
    bank: &'a Arc<Bank>,
    config: &'a EpisodeConfig,
    of_pegs: PegSense,
    task: &'a Task,
    reach: PoseGrid,
    pegs: Vec<Shape>,
    /// How far each peg's farthest point is from its middle, mm.
    radii_mm: Vec<f64>,
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
        for (field, value, most) in [
            ("grasp-error, mm", task.grasp_error_mm, 100.0),
            ("grasp-error, degrees", task.grasp_error_deg, 180.0),
            ("tilt, degrees", task.tilt_deg, 10.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(Error::invalid(field, format!("0 to {most}"), value.to_string()));
            }
        }
        let Insertion { search_poses, tries, slide_mm_s, .. } = task.insertion;
        if tries == 0 || search_poses == 0 || !(slide_mm_s > 0.0 && slide_mm_s.is_finite()) {
            let got = format!("{tries} of {search_poses} at {slide_mm_s} mm a second");
            return Err(Error::invalid("insertion", "tries and poses, at least one, and a speed above zero", got));
        }
        task.speeds.validate()?;
        config.validate()?;
        let (scene, parts) = (simulator.scene(), simulator.parts());
        let openings = (0..parts.len()).map(|part| scene.opening(part)).collect::<std::result::Result<_, _>>()?;
        let pegs: Vec<Shape> =
            (0..parts.len()).map(|part| scene.shape(part, 0)).collect::<std::result::Result<_, _>>()?;
        if parts != bank.parts() {
            let expected = format!("the scene's parts {}", parts.join(" "));
            return Err(Error::invalid("bank", expected, bank.parts().join(" ")));
        }
        let reach = scene.reach.unwrap_or(*bank.start());
        let of_pegs = PegSense {
            sensor: sensor.clone().of_side(Side::Peg),
            config: EpisodeConfig::of_side(sensor.model(), Side::Peg),
        };
        let radius = |peg: &Shape| peg.outline_points().map(|[x, y]| x.hypot(y)).fold(0.0, f64::max);
        let radii_mm = pegs.iter().map(radius).collect();
        Ok(Self { simulator, sensor, of_pegs, bank, config, task, reach, pegs, radii_mm, openings })
    }

    /// The pegs on the table.
    pub(super) fn bank(&self) -> &Arc<Bank> {
        self.bank
    }

    /// What is to be done.
    pub(super) fn task(&self) -> &Task {
        self.task
    }

    /// What feels held pegs.
    pub(super) fn of_pegs(&self) -> &PegSense {
        &self.of_pegs
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
        let mut bank = self.bank.clone();
        let mut attempts = Vec::with_capacity(n_parts);
        for (turn, part) in order.into_iter().enumerate() {
            let held_from_peg = self.grasped(&mut rng);
            let number = index * n_parts + turn;
            // Of what is drawn for this hole beyond its touches.
            let mut of_hole = frame_rng(seed ^ 0x7472_6965, number as u64);
            let slopes = self.slopes(&mut of_hole);
            let hole = Hole::of_part(Holes::Simulated(self.simulator, Side::Hole), part, &self.reach, seed, number);
            let config = self.config.changed(|settings, _, _| settings.seed = seed.wrapping_add(number as u64));
            let robot = Robot { bank: &bank, next_grasp: Some(held_from_peg), in_hand: None, rng: of_hole };
            let attempt = self.attempt(hole.tilted(slopes), robot, config, watch)?;
            let gone = bank.parts().iter().position(|name| *name == self.simulator.parts()[attempt.named]);
            if let Some(gone) = gone.filter(|_| attempt.went_in && bank.parts().len() > 1) {
                bank = Arc::new(bank.without(gone)?);
            }
            attempts.push(attempt);
        }
        Ok(attempts)
    }

    /// How a peg is held that was picked up.
    fn grasped(&self, rng: &mut ChaCha8Rng) -> Se2 {
        let mut up_to = |most: f64| most * (2.0 * rng.random::<f64>() - 1.0);
        let (mm, deg) = (self.task.grasp_error_mm, self.task.grasp_error_deg);
        Se2::from_degrees(up_to(mm), up_to(mm), up_to(deg))
    }

    /// How a hole's plate rises against the tool: by the task's tilt, towards any side.
    fn slopes(&self, rng: &mut ChaCha8Rng) -> [f64; 2] {
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        [cos, sin].map(|share| share * self.task.tilt_deg.to_radians().tan())
    }

    /// Touches a hole until the episode's own rule ends it, then tries the peg that was named. Where that does not go in, the episode
    /// learns from it, and the hole is touched again before the next try.
    fn attempt(
        &self,
        mut hole: Hole<'_>,
        mut robot: Robot<'_>,
        config: EpisodeConfig,
        watch: Watch<'_>,
    ) -> Result<Attempt> {
        let bank = robot.bank;
        let mut made = Attempt::begun(hole.part_index(), bank.parts().len());
        let mut frame = hole.touch()?;
        let mut started = Instant::now();
        let mut episode = Episode::begin(config, bank.clone(), &observe(self.sensor, &frame)?)?;
        loop {
            let reach = hole.reach(bank.start(), Poses::OffGrid);
            let decision = episode.decide(&reach)?;
            made.decision_ms.push(started.elapsed().as_secs_f64() * 1e3);
            watch(&Moment { hole: &hole, frame: &frame, episode: &episode, bank })?;
            let action = match decision {
                Decision::Touch(action) => action,
                Decision::Done(estimate, stop) => {
                    let tried = self.insert(&hole, &estimate, &mut robot, &mut made)?;
                    let is_last = made.went_in || made.n_tries >= self.task.insertion.tries;
                    let next = match (is_last, tried) {
                        (false, Some(tried)) if estimate.n_touches < config.settings.max_touches => {
                            episode.did_not_fit(&tried)?;
                            episode.next_touch(&reach, &mut || true)
                        }
                        _ => None,
                    };
                    let Some(action) = next else {
                        let Estimate { n_touches, probability, fit, .. } = *estimate;
                        return Ok(Attempt { stop, n_touches, probability, fit, ..made });
                    };
                    action
                }
            };
            made.travel_mm += action.sensor_from_next.x_mm.hypot(action.sensor_from_next.y_mm);
            let moved = hole.go(&action);
            frame = hole.touch()?;
            started = Instant::now();
            episode.observe(moved, &observe(self.sensor, &frame)?)?;
        }
    }

    /// Brings the named peg to where its hole is believed to be and slides it until it goes in. Returns what is learnt where it does not; nothing
    /// where no place is known that could be searched.
    fn insert(
        &self,
        hole: &Hole<'_>,
        estimate: &Estimate,
        robot: &mut Robot<'_>,
        made: &mut Attempt,
    ) -> Result<Option<Tried>> {
        let named = self.index_of(&estimate.part)?;
        let InHand { held_from_peg, felt, .. } = match robot.in_hand {
            Some(held) if held.part == named => held,
            _ => self.pick_up(named, robot, made)?,
        };
        let (opening, clearance_mm) = &self.openings[hole.part_index()];
        let radius_mm = self.radii_mm[named];
        let peg = HeldPeg { play_mm: self.simulator.scene().clearance_mm, radius_mm, covariance: felt.covariance };
        let search = estimate.search(&peg, self.task.insertion.search_poses).ok();
        let straight_down = [Se2::IDENTITY];
        let offsets = search.as_ref().map_or(&straight_down[..], |search| &search.offsets);
        let left_mm = clearance_mm - narrower_mm(self.task.tilt_deg, radius_mm);
        let in_hand = felt.held_from_peg.inverse() * held_from_peg;
        let brought =
            |offset: &Se2| brought(&hole.part_from_sensor(), &estimate.part_from_sensor, &(*offset * in_hand));
        let goes_in = |offset: &Se2| left_mm >= 0.0 && self.pegs[named].fits_in(opening, left_mm, &brought(offset));
        let found = offsets.iter().position(goes_in);
        let last = found.unwrap_or(offsets.len() - 1);
        (made.named, made.went_in) = (named, found.is_some());
        made.n_tries += 1;
        made.slide_mm += search.as_ref().map_or(0.0, |search| search.slide_mm(last));
        (made.xy_mm, made.theta_deg) = error(&brought(&offsets[0]), &self.simulator.symmetry(hole.part_index()));
        Ok(search.filter(|_| found.is_none()).map(|search| search.in_vain))
    }

    /// Takes a peg, and feels where it is in the hand.
    fn pick_up(&self, part: usize, robot: &mut Robot<'_>, made: &mut Attempt) -> Result<InHand> {
        let held_from_peg = match robot.next_grasp.take() {
            Some(drawn) => drawn,
            None => self.grasped(&mut robot.rng),
        };
        let peg = Peg { part, outline: &self.pegs[part], held_from_peg, seed: robot.rng.random() };
        let felt = Held::felt(self, &peg)?;
        made.n_peg_touches += felt.n_touches;
        made.travel_mm += felt.travel_mm;
        let in_hand = InHand { part, held_from_peg, felt };
        robot.in_hand = Some(in_hand);
        Ok(in_hand)
    }

    fn index_of(&self, name: &str) -> Result<usize> {
        let found = self.simulator.parts().iter().position(|part| part == name);
        found.ok_or_else(|| Error::invalid("estimate", "a part of the scene", name.to_owned()))
    }
}

/// The robot at one hole: its pegs, the one in its hand, and what is still to be drawn.
struct Robot<'r> {
    bank: &'r Arc<Bank>,
    /// How the first peg will be held.
    next_grasp: Option<Se2>,
    in_hand: Option<InHand>,
    rng: ChaCha8Rng,
}

/// A peg in the hand: where it is, and where the robot believes it to be.
#[derive(Clone, Copy)]
struct InHand {
    part: usize,
    held_from_peg: Se2,
    felt: Held,
}

/// The peg is guided by the hole once it is in by so much; until then a tilted tool needs more room, mm.
const ENTRY_MM: f64 = 2.0;

/// By how much a hole is narrower on each side for a tool that is tilted: the peg goes aside on its way in, and the opening looks
/// smaller along the tool.
fn narrower_mm(tilt_deg: f64, radius_mm: f64) -> f64 {
    let tilt = tilt_deg.to_radians();
    0.5 * ENTRY_MM * tilt.tan() + radius_mm * (1.0 - tilt.cos())
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
    use tactile_filter::budget::Speeds;
    use tactile_infer::bank::rows::Rows;
    use tactile_infer::embedding::architecture::NetworkConfig;
    use tactile_infer::embedding::checkpoint::{Checkpoint, Provenance};
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
        Task {
            n_trials: 3,
            seeds: vec![1, 2],
            grasp_error_mm: 0.5,
            grasp_error_deg: 1.0,
            tilt_deg: 1.0,
            insertion: Insertion::default(),
            speeds: Speeds::default(),
        }
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
                assert!(
                    (1..=3).contains(&attempt.n_tries)
                        && (attempt.went_in || attempt.n_tries == 3 || attempt.n_touches == 4)
                );
                // Each peg that was picked up was felt twice.
                assert!(attempt.n_peg_touches >= 2 && attempt.n_peg_touches <= 2 * attempt.n_tries);
                gone.extend(attempt.went_in.then_some(attempt.named));
            }
        }
        let timeless = |trials: Vec<Vec<Attempt>>| -> Vec<Attempt> {
            trials.into_iter().flatten().map(|attempt| Attempt { decision_ms: Vec::new(), ..attempt }).collect()
        };
        assert_eq!(timeless(run()), timeless(trials));
    }

    /// A peg as high as it is deep in, turned about its middle: by corners of the rectangle that it sweeps.
    #[test]
    fn a_tilted_tool_needs_more_room() {
        assert_eq!(narrower_mm(0.0, 14.0), 0.0);
        let (tilt, radius) = (2.0_f64.to_radians(), 14.0);
        // Going in by 2 mm along the tool the peg goes aside by 2 tan(tilt), half of it to each side of the best place.
        let aside = 2.0 * tilt.tan() / 2.0;
        // Of the opening's half width of 14 mm the tool sees the cosine.
        let seen = radius * tilt.cos();
        assert!((narrower_mm(2.0, radius) - aside - (radius - seen)).abs() < 1e-12);
        assert!(narrower_mm(2.0, radius) < 0.05 && narrower_mm(3.0, radius) > narrower_mm(2.0, radius));
    }

    #[test]
    fn a_task_that_is_none_is_refused() {
        let refused = |scene, bank: &Arc<Bank>, task| with(scene, bank, &task, |_| ()).unwrap_err().to_string();
        let (whole, held) = (bank("ITL"), |mm| Task { grasp_error_mm: mm, ..task() });
        let insertion = |search_poses, tries| Task {
            insertion: Insertion { search_poses, tries, ..Insertion::default() },
            ..task()
        };
        for (task, expected) in [
            (Task { n_trials: 0, ..task() }, "assembly: expected trials and seeds, got 0 trials of 2 seeds"),
            (Task { seeds: vec![], ..task() }, "assembly: expected trials and seeds, got 3 trials of 0 seeds"),
            (held(-0.1), "grasp-error, mm: expected 0 to 100, got -0.1"),
            (held(f64::NAN), "grasp-error, mm: expected 0 to 100, got NaN"),
            (Task { tilt_deg: 11.0, ..task() }, "tilt, degrees: expected 0 to 10, got 11"),
            (
                insertion(0, 3),
                "insertion: expected tries and poses, at least one, and a speed above zero, got 3 of 0 at 10 mm a second",
            ),
            (
                insertion(9, 0),
                "insertion: expected tries and poses, at least one, and a speed above zero, got 0 of 9 at 10 mm a second",
            ),
            (
                Task { speeds: Speeds { mm_s: 0.0, ..Speeds::default() }, ..task() },
                "--touch-s, --mm-s: expected seconds of a touch and a speed above zero, got 3 s, 0 mm a second",
            ),
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

//! The runner against the same episode driven by hand.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use tactile_data::FrameFault;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::{Kit, Parts, Scene};
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::runner::{Answer, Fault, Job, MAX_CAPACITY, Outcome, Runner, SubmitError};
use tactile_filter::{Decision, Episode, EpisodeConfig, Error, Sensor, Settings};
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::{Bank, Model};

/// A config with other settings.
fn with(mut config: EpisodeConfig, change: impl FnOnce(&mut Settings)) -> EpisodeConfig {
    change(&mut config.settings);
    config
}

/// Three letters, a sensor over the second one, and a bank that is coarse and so quickly made.
struct World {
    simulator: Simulator,
    model: Arc<Model>,
    bank: Arc<Bank>,
}

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("KLT", 12.0, 16.0));
        scene.reach = Some(PoseGrid { xy_half_mm: 8.0, xy_step_mm: 4.0, theta_half_deg: 45.0, theta_step_deg: 45.0 });
        let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../infer/models/maze-small.safetensors");
        let model = Arc::new(Model::load(model.as_ref()).unwrap());
        let bank = Arc::new(bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ()).unwrap());
        World { simulator: Simulator::new(scene, 1).unwrap(), model, bank }
    })
}

impl World {
    fn rest(&self) -> Frame {
        self.simulator.no_contact(7)
    }
    fn sensor(&self) -> Sensor {
        Sensor::new(self.model.clone(), &self.rest()).unwrap()
    }
    fn touch(&self, pose: &Se2, n: u64) -> Frame {
        self.simulator.touch(1, Side::Hole, pose, &mut frame_rng(7, n)).unwrap()
    }
    /// Never confident, so that every episode has as many touches as it may.
    fn config(&self) -> EpisodeConfig {
        with(EpisodeConfig::of(&self.model), |settings| {
            (settings.stop_probability, settings.false_accept, settings.max_touches) = (1.0, None, 4);
        })
    }
    fn runner(&self, capacity: usize) -> Runner {
        Runner::start(self.sensor(), self.bank.clone(), self.config(), capacity).unwrap()
    }
}

fn reach() -> Vec<Se2> {
    (0..25).map(|i| Se2::from_degrees(4.0 * f64::from(i % 5 - 2), 4.0 * f64::from(i / 5 - 2), 0.0)).collect()
}

fn dark() -> Frame {
    let (width, height) = (world().rest().width_px(), world().rest().height_px());
    Frame::new(width, height, vec![3; 3 * width * height]).unwrap()
}

fn wait(runner: &mut Runner) -> Outcome {
    loop {
        match runner.poll() {
            Some(outcome) => return outcome,
            None => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

fn decision(runner: &mut Runner, frame: Frame, moved: Se2) -> Result<Decision, Fault> {
    let ticket = runner.submit(Job::Touch { frame, moved, reach: reach() }).unwrap();
    let outcome = wait(runner);
    assert_eq!(outcome.ticket, ticket);
    outcome.answer.map(|answer| match answer {
        Answer::Decision(decision) => decision,
        other => panic!("{other:?}"),
    })
}

#[test]
fn the_numbers_are_those_of_an_episode_driven_by_hand() {
    let world = world();
    let mut runner = world.runner(2);
    // Twice: an episode that follows another is like the first.
    for _ in 0..2 {
        let mut pose = Se2::from_degrees(2.0, -1.0, 20.0);
        let first = world.sensor().observe(&world.touch(&pose, 0)).unwrap();
        let mut episode = Episode::begin(world.config(), world.bank.clone(), &first).unwrap();
        let mut got = decision(&mut runner, world.touch(&pose, 0), Se2::IDENTITY).unwrap();
        let mut n_touches = 1;
        loop {
            let expected = episode.decide(&reach()).unwrap();
            assert_eq!(got, expected);
            runner.submit(Job::Estimate).unwrap();
            let estimate = wait(&mut runner).answer.unwrap();
            assert_eq!(estimate, Answer::Estimate(Box::new(episode.estimate())));
            let Decision::Touch(action) = expected else { break };
            let moved = action.sensor_from_next * Se2::from_degrees(0.1, -0.05, 0.5);
            pose = pose * moved;
            let frame = world.touch(&pose, n_touches);
            episode.observe(moved, &world.sensor().observe(&frame).unwrap()).unwrap();
            got = decision(&mut runner, frame, moved).unwrap();
            n_touches += 1;
        }
        assert_eq!(n_touches, 4);
        runner.submit(Job::NewEpisode(None)).unwrap();
        assert_eq!(wait(&mut runner).answer.unwrap(), Answer::NewEpisode);
    }
}

#[test]
fn a_refused_touch_changes_nothing_and_its_motion_counts_towards_the_next() {
    let world = world();
    let mut runner = world.runner(1);
    let start = Se2::from_degrees(2.0, -1.0, 20.0);
    let legs =
        [Se2::from_degrees(4.0, 0.0, 10.0), Se2::from_degrees(0.0, -4.0, 0.0), Se2::from_degrees(-2.0, 1.0, -5.0)];
    // Before the first touch no motion counts.
    assert!(matches!(decision(&mut runner, dark(), legs[0]), Err(Fault::Filter(Error::Frame { .. }))));
    decision(&mut runner, world.touch(&start, 0), legs[0]).unwrap();
    let refused = decision(&mut runner, dark(), legs[0]).unwrap_err();
    assert!(matches!(refused, Fault::Filter(Error::Frame { fault: FrameFault::Dark { .. }, .. })), "{refused}");
    let frozen = decision(&mut runner, world.touch(&start, 0), legs[1]).unwrap_err();
    assert!(matches!(frozen, Fault::Filter(Error::FrozenFrame { .. })), "{frozen}");
    let nowhere = Se2 { x_mm: f64::NAN, ..legs[0] };
    let lost = decision(&mut runner, world.touch(&start, 9), nowhere).unwrap_err();
    assert!(matches!(lost, Fault::Filter(Error::Motion { .. })), "{lost}");
    let last = world.touch(&(start * legs[0] * legs[1] * legs[2]), 1);
    runner.submit(Job::Touch { frame: last.clone(), moved: Se2::IDENTITY, reach: Vec::new() }).unwrap();
    let empty = wait(&mut runner).answer.unwrap_err();
    assert!(matches!(empty, Fault::Filter(Error::EmptyReach { n_motions: 0 })), "{empty}");
    let got = decision(&mut runner, last.clone(), legs[2]).unwrap();

    let sensor = world.sensor();
    let first = sensor.observe(&world.touch(&start, 0)).unwrap();
    let mut episode = Episode::begin(world.config(), world.bank.clone(), &first).unwrap();
    let moved = legs[0] * legs[1] * Se2::IDENTITY * legs[2];
    episode.observe(moved, &sensor.observe(&last).unwrap()).unwrap();
    assert_eq!(got, episode.decide(&reach()).unwrap());
}

#[test]
fn a_full_runner_refuses_at_once_and_loses_nothing() {
    let world = world();
    let mut runner = world.runner(3);
    let touch = |n: u64| Job::Touch {
        frame: world.touch(&Se2::from_degrees(n as f64, 0.0, 0.0), n),
        moved: Se2::from_degrees(1.0, 0.0, 0.0),
        reach: reach(),
    };
    assert_eq!([0, 1, 2].map(|n| runner.submit(touch(n)).unwrap()), [0, 1, 2]);
    let Err(SubmitError::Full { job, capacity: 3 }) = runner.submit(touch(3)) else { panic!("a fourth was accepted") };
    assert_eq!((job, runner.n_pending()), (touch(3), 3));
    assert_eq!([0, 1, 2].map(|_| wait(&mut runner).ticket), [0, 1, 2]);
    assert_eq!(runner.submit(touch(3)).unwrap(), 3);
    let outcome = wait(&mut runner);
    assert!(outcome.ticket == 3 && outcome.answer.is_ok(), "{outcome:?}");
}

#[test]
fn a_new_frame_at_rest_and_new_settings_count_from_then_on() {
    let world = world();
    let mut runner = world.runner(4);
    runner.submit(Job::Estimate).unwrap();
    assert!(matches!(wait(&mut runner).answer, Err(Fault::NoEpisode { .. })));
    let rest = world.simulator.no_contact(8);
    let config = with(world.config(), |settings| settings.max_touches = 1);
    let wrong = with(world.config(), |settings| settings.max_touches = 0);
    for job in [Job::Rest(dark()), Job::Rest(rest.clone()), Job::NewEpisode(Some(Box::new(wrong)))] {
        runner.submit(job).unwrap();
    }
    runner.submit(Job::NewEpisode(Some(Box::new(config)))).unwrap();
    let is_done = [0; 4].map(|_| wait(&mut runner).answer.is_ok());
    assert_eq!(is_done, [false, true, false, true]);
    let frame = world.touch(&Se2::IDENTITY, 0);
    let first = Sensor::new(world.model.clone(), &rest).unwrap().observe(&frame).unwrap();
    let expected = Episode::begin(config, world.bank.clone(), &first).unwrap().decide(&reach()).unwrap();
    assert!(matches!(expected, Decision::Done(..)));
    assert_eq!(decision(&mut runner, frame, Se2::IDENTITY).unwrap(), expected);
}

#[test]
fn dropping_a_busy_runner_ends_it() {
    let world = world();
    let mut runner = world.runner(8);
    for n in 0..8 {
        let frame = world.touch(&Se2::from_degrees(n as f64, 0.0, 0.0), n);
        runner.submit(Job::Touch { frame, moved: Se2::IDENTITY, reach: reach() }).unwrap();
    }
    drop(runner);
    // The thread held the bank; now it is joined.
    let bank = Arc::new((*world.bank).clone());
    let runner = Runner::start(world.sensor(), bank.clone(), world.config(), 1).unwrap();
    drop(runner);
    assert_eq!(Arc::strong_count(&bank), 1);
}

#[test]
fn what_cannot_run_is_refused_at_the_start() {
    let world = world();
    let start =
        |bank: &Arc<Bank>, config, capacity| Runner::start(world.sensor(), bank.clone(), config, capacity).map(drop);
    for capacity in [0, MAX_CAPACITY + 1, usize::MAX] {
        assert!(matches!(start(&world.bank, world.config(), capacity), Err(Error::Config { .. })));
    }
    let wrong = with(world.config(), |settings| settings.stop_probability = 2.0);
    assert!(matches!(start(&world.bank, wrong, 1), Err(Error::Config { .. })));
    let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };
    let rows = Rows::new(2, vec![1.0, 0.0]).unwrap();
    let other = Arc::new(Bank::from_rows(vec!["A".into()], grid, rows, vec![0.2], "another").unwrap());
    assert!(matches!(start(&other, world.config(), 1), Err(Error::WrongModel { .. })));
}

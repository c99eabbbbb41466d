//! The filter on a bank of embedded pegs, as a robot uses it.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::belief::EngineConfig;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::{Decision, Episode, EpisodeConfig, Error, Estimate, FrameFault, Sensor, StopReason};
use tactile_infer::{Bank, Model};
use tactile_tests::samples::Sample;

/// A model, its bank and a simulated hole.
struct Bench {
    simulator: Simulator,
    model: Arc<Model>,
    bank: Arc<Bank>,
}

impl Bench {
    fn new(sample: &Sample) -> Self {
        let model = Model::load(&sample.folder().join("model/model.safetensors")).unwrap();
        let bank = Bank::load(&sample.folder().join("pegs.bank"), &model).unwrap();
        let simulator = Simulator::new(Scene::load(&sample.at("two.toml")).unwrap(), 1).unwrap();
        Self { simulator, model: Arc::new(model), bank: Arc::new(bank) }
    }

    fn sensor(&self) -> Sensor {
        Sensor::new(self.model.clone(), &self.simulator.no_contact(9)).unwrap()
    }

    fn touch(&self, part_from_sensor: &Se2, number: u64) -> Frame {
        self.simulator.touch(0, Side::Hole, part_from_sensor, &mut frame_rng(9, number)).unwrap()
    }

    /// Motions from a pose to every recorded one.
    fn reach(&self, part_from_sensor: &Se2) -> Vec<Se2> {
        let grid: &PoseGrid = self.bank.grid();
        (0..grid.len()).map(|cell| part_from_sensor.inverse() * grid.pose(cell)).collect()
    }

    /// Three touches along a fixed path; what is known then.
    fn along_a_path(&self, config: &EpisodeConfig) -> Estimate {
        let sensor = self.sensor();
        let mut pose = self.bank.grid().pose(4);
        let begun = Episode::begin(*config, self.bank.clone(), &sensor.observe(&self.touch(&pose, 1)).unwrap());
        let mut episode = begun.unwrap();
        for (number, moved) in [(2, Se2::from_degrees(4.0, 0.0, 0.0)), (3, Se2::from_degrees(0.0, -4.0, 30.0))] {
            pose = pose * moved;
            episode.observe(moved, &sensor.observe(&self.touch(&pose, number)).unwrap()).unwrap();
        }
        episode.estimate()
    }
}

fn particles(n_particles: usize, seed: u64) -> EpisodeConfig {
    let engine = EngineConfig::Particle(ParticleConfig { n_particles, ..ParticleConfig::default() });
    EpisodeConfig::default().changed(|settings, _, method| {
        settings.seed = seed;
        method.engine = engine;
    })
}

#[test]
fn particles_agree_with_the_exact_posterior_to_sampling_error() {
    let sample = Sample::shared();
    let bench = Bench::new(&sample);
    let exact = bench.along_a_path(&EpisodeConfig::default());
    assert!(exact.probability < 0.99, "a posterior that leaves something to disagree about: {exact:?}");
    let n_particles = 20_000;
    let sampled = bench.along_a_path(&particles(n_particles, 5));
    // A share p of K draws has a standard error of at most 1 / (2 sqrt K); three touches redraw at most
    // three times. Five standard errors.
    let tolerance = 5.0 * (3.0 / n_particles as f64).sqrt() / 2.0;
    for (p, q) in exact.class_posterior.iter().zip(&sampled.class_posterior) {
        assert!((p - q).abs() < tolerance, "{exact:?}\n{sampled:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_estimate() {
    let sample = Sample::shared();
    let bench = Bench::new(&sample);
    let first = bench.along_a_path(&particles(100, 3));
    assert_eq!(first, bench.along_a_path(&particles(100, 3)));
    assert_ne!(first.class_posterior, bench.along_a_path(&particles(100, 4)).class_posterior);
}

#[test]
fn a_robot_is_led_from_touch_to_touch_until_the_limit() {
    let sample = Sample::shared();
    let bench = Bench::new(&sample);
    let sensor = bench.sensor();
    let config = EpisodeConfig::default().changed(|settings, model, _| {
        settings.stop_probability = 1.0;
        settings.false_accept = None;
        settings.max_touches = 4;
        // The sample's reach is smaller than the distance kept by default.
        model.min_separation_mm = 3.0;
    });
    let first = bench.bank.grid().pose(13);
    let mut pose = first;
    let begun = Episode::begin(config, bench.bank.clone(), &sensor.observe(&bench.touch(&pose, 1)).unwrap());
    let mut episode = begun.unwrap();
    let mut n_touches = 1;
    let (estimate, reason) = loop {
        let action = match episode.decide(&bench.reach(&pose)).unwrap() {
            Decision::Touch(action) => action,
            Decision::Done(estimate, reason) => break (estimate, reason),
        };
        let again = episode.decide(&bench.reach(&pose)).unwrap();
        assert_eq!(again, Decision::Touch(action), "deciding changes nothing");
        pose = pose * action.sensor_from_next;
        n_touches += 1;
        let observation = sensor.observe(&bench.touch(&pose, n_touches)).unwrap();
        episode.observe(action.sensor_from_next, &observation).unwrap();
    };
    assert_eq!((reason, estimate.n_touches, n_touches), (StopReason::TouchLimit, 4, 4));
    assert!((estimate.class_posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    // What the episode believes of now and of the first touch differs by the motions made in between.
    let moved = first.inverse() * pose;
    let expected = estimate.part_from_first * moved;
    assert!(expected.distance_mm(&estimate.part_from_sensor) < 1e-9, "{estimate:?}");
}

#[test]
fn a_frame_that_shows_nothing_leaves_the_episode_as_it_was() {
    let sample = Sample::shared();
    let bench = Bench::new(&sample);
    let sensor = bench.sensor();
    let observation = sensor.observe(&bench.touch(&Se2::IDENTITY, 1)).unwrap();
    let mut episode = Episode::begin(EpisodeConfig::default(), bench.bank.clone(), &observation).unwrap();
    let before = episode.estimate();
    let black = Frame::new(80, 60, (0..3 * 80 * 60).map(|i| (i * 7 % 17) as u8).collect()).unwrap();
    let small = Frame::new(40, 30, (0..3 * 40 * 30).map(|i| i as u8).collect()).unwrap();
    let fault = |frame: &Frame| match sensor.observe(frame) {
        Err(Error::Frame { fault, .. }) => fault,
        other => panic!("{other:?}"),
    };
    assert!(matches!(fault(&black), FrameFault::Dark { .. }));
    assert_eq!(fault(&small), FrameFault::WrongSize { expected: [80, 60], got: [40, 30] });
    let nowhere = Se2::from_degrees(f64::NAN, 0.0, 0.0);
    assert!(matches!(episode.observe(nowhere, &observation), Err(Error::Motion { .. })));
    assert_eq!(episode.estimate(), before);
}

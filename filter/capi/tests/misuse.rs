//! Whatever C gives that can be seen to be wrong is refused with the right status, and changes nothing.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]
#![expect(unsafe_code, reason = "calls the library as C does")]

#[path = "../examples/record.rs"]
mod record;

use std::ffi::{CStr, CString, c_char};
use std::mem::zeroed;
use std::path::{Path, PathBuf};
use std::ptr::{null, null_mut};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use proptest::prelude::*;
use tactile_capi::config::*;
use tactile_capi::episode::*;
use tactile_capi::insertion::*;
use tactile_capi::light::*;
use tactile_capi::model::*;
use tactile_capi::runner::*;
use tactile_capi::sensor::*;
use tactile_capi::status::{tf_last_error, tf_status};
use tactile_capi::value::*;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::insertion::HeldPeg;
use tactile_filter::{Episode, EpisodeConfig, EpisodeRecord, KnownStart, Settings};
use tactile_infer::{Bank, Model};

const STILL: tf_pose = tf_pose { x_mm: 0.0, y_mm: 0.0, theta_rad: 0.0 };
const REACH: [tf_pose; 2] = [tf_pose { x_mm: 4.0, ..STILL }, tf_pose { x_mm: -4.0, ..STILL }];

/// Everything up to a first touch, made once; none of it changes.
struct World {
    folder: PathBuf,
    model: *mut tf_model,
    bank: *mut tf_bank,
    sensor: *mut tf_sensor,
    touches: [*mut tf_observation; 2],
    config: *mut tf_config,
}

// SAFETY: what these handles point to may be used by any number of threads at once.
unsafe impl Send for World {}
// SAFETY: as above.
unsafe impl Sync for World {}

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("capi-misuse");
        std::fs::create_dir_all(&folder).unwrap();
        record::record(&folder, record::small_scene().unwrap()).unwrap();
        let path = |name: &str| CString::new(folder.join(name).to_str().unwrap()).unwrap();
        let (mut model, mut bank, mut sensor) = (null_mut(), null_mut(), null_mut());
        let mut touches = [null_mut(); 2];
        unsafe {
            ok(tf_model_load(path("model.safetensors").as_ptr(), &mut model));
            ok(tf_bank_load(model, path("parts.bank").as_ptr(), &mut bank));
            let rest = Picture::of(folder.join("rest.ppm"));
            ok(tf_sensor_new(model, &rest.frame(), &mut sensor));
            for (n, touch) in (1..).zip(&mut touches) {
                let picture = Picture::of(folder.join(format!("touch-{n}.ppm")));
                ok(tf_sensor_observe(sensor, &picture.frame(), touch));
            }
            let mut config = null_mut();
            ok(tf_config_new(model, tf_side::Hole as u32, &mut config));
            World { folder, model, bank, sensor, touches, config }
        }
    })
}

impl World {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
    fn touch(&self) -> Picture {
        Picture::of(self.path("touch-1.ppm"))
    }
    fn episode(&self) -> *mut tf_episode {
        let mut episode = null_mut();
        ok(unsafe { tf_episode_begin(self.config, self.bank, self.touches[0], &mut episode) });
        episode
    }
    fn runner(&self, capacity: usize) -> *mut tf_runner {
        let mut runner = null_mut();
        ok(unsafe { tf_runner_start(self.sensor, self.bank, self.config, capacity, &mut runner) });
        runner
    }
}

struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Picture {
    fn of(path: PathBuf) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let end = bytes.iter().position(|byte| *byte == b'\n').unwrap();
        let words = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let sizes: Vec<usize> = words.split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        Self { width: sizes[0], height: sizes[1], pixels: bytes[end + 1..].to_vec() }
    }
    fn frame(&self) -> tf_frame {
        let (width_px, height_px, stride_bytes) = (self.width, self.height, 3 * self.width);
        tf_frame { pixels: self.pixels.as_ptr(), width_px, height_px, stride_bytes, format: 0 }
    }
}

fn said() -> String {
    unsafe { CStr::from_ptr(tf_last_error()) }.to_str().unwrap().to_owned()
}

#[track_caller]
fn ok(status: tf_status) {
    assert_eq!(status, tf_status::Ok, "{}", said());
}

fn wait(runner: *mut tf_runner) -> tf_outcome {
    loop {
        let mut outcome = tf_outcome::default();
        ok(unsafe { tf_runner_poll(runner, &mut outcome) });
        if outcome.kind != tf_outcome_kind::None {
            return outcome;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// What an episode says after its touches, to compare.
fn estimate(episode: *const tf_episode) -> (tf_estimate, tf_stop) {
    let (mut estimate, mut stop) = (tf_estimate::default(), tf_stop::None);
    ok(unsafe { tf_episode_estimate(episode, &mut estimate, &mut stop) });
    // Texts are compared by what they say.
    assert!(!unsafe { CStr::from_ptr(estimate.part_name) }.is_empty());
    estimate.part_name = null();
    (estimate, stop)
}

#[test]
fn null_may_be_freed() {
    unsafe {
        tf_model_free(null_mut());
        tf_config_free(null_mut());
        tf_bank_free(null_mut());
        tf_sensor_free(null_mut());
        tf_observation_free(null_mut());
        tf_episode_free(null_mut());
        tf_runner_free(null_mut());
    }
}

#[test]
fn null_is_refused_of_a_config() {
    let world = world();
    let (config, model) = (world.config, world.model);
    let (n, seed) = (&mut 0_usize as *mut usize, c"seed".as_ptr());
    let statuses = unsafe {
        [
            tf_config_new(null(), 0, &mut null_mut()),
            tf_config_new(model, 0, null_mut()),
            tf_config_set(null_mut(), seed, c"1".as_ptr()),
            tf_config_set(config, null(), c"1".as_ptr()),
            tf_config_set(config, seed, null()),
            tf_config_set_number(null_mut(), seed, 1.0),
            tf_config_set_number(config, null(), 1.0),
            tf_config_get(null(), seed, null_mut(), 0, n),
            tf_config_get(config, null(), null_mut(), 0, n),
            tf_config_get(config, seed, null_mut(), 0, null_mut()),
            tf_config_get(config, seed, null_mut(), 9, n),
        ]
    };
    assert!(statuses.iter().all(|status| *status == tf_status::NullPointer), "{statuses:?}");
}

#[test]
fn null_is_refused_everywhere_else() {
    let world = world();
    let (episode, runner, frame) = (world.episode(), world.runner(1), world.touch().frame());
    let (config, model, bank, sensor) = (world.config, world.model, world.bank, world.sensor);
    let (n, touch, reach) = (&mut 0_usize as *mut usize, world.touches[0], REACH.as_ptr());
    let mut made = 0x10 as *mut tf_episode;
    let statuses = unsafe {
        [
            tf_model_load(null(), &mut null_mut()),
            tf_model_load(c"x".as_ptr(), null_mut()),
            tf_bank_load(null(), c"x".as_ptr(), &mut null_mut()),
            tf_bank_load(model, null(), &mut null_mut()),
            tf_bank_n_parts(null(), n),
            tf_bank_n_parts(bank, null_mut()),
            tf_bank_part_name(null(), 0, &mut null()),
            tf_bank_part_name(bank, 0, null_mut()),
            tf_bank_sha256(bank, null_mut(), 64, n),
            tf_bank_sha256(bank, null_mut(), 0, null_mut()),
            tf_sensor_new(model, null(), &mut null_mut()),
            tf_sensor_new(null(), &frame, &mut null_mut()),
            tf_sensor_observe(sensor, null(), &mut null_mut()),
            tf_sensor_observe(sensor, &tf_frame { pixels: null(), ..frame }, &mut null_mut()),
            tf_observation_edge_share(null(), &mut 0.0),
            tf_observation_edge_share(touch, null_mut()),
            tf_episode_begin(null(), bank, touch, &mut null_mut()),
            tf_episode_begin(config, null(), touch, &mut null_mut()),
            tf_episode_begin(config, bank, null(), &mut made),
            tf_episode_observe(null_mut(), STILL, touch),
            tf_episode_observe(episode, STILL, null()),
            tf_episode_decide(null(), reach, 2, &mut zeroed()),
            tf_episode_decide(episode, null(), 2, &mut zeroed()),
            tf_episode_decide_within(episode, reach, 2, 1, null_mut()),
            tf_episode_estimate(episode, null_mut(), null_mut()),
            tf_episode_runner_up(null(), &mut zeroed()),
            tf_episode_runner_up(episode, null_mut()),
            tf_episode_class_posterior(episode, null_mut(), 3, n),
            tf_episode_belief(null(), 0, null_mut(), 0, n),
            tf_episode_modes(null(), null_mut(), 0, n),
            tf_episode_record(episode, null_mut(), 0, null_mut()),
            tf_episode_restore(null(), c"{}".as_ptr().cast(), 2, &mut null_mut()),
            tf_episode_restore(bank, null(), 2, &mut null_mut()),
            tf_runner_start(null(), bank, config, 1, &mut null_mut()),
            tf_runner_start(sensor, bank, null(), 1, &mut null_mut()),
            tf_runner_submit_touch(null_mut(), &frame, STILL, reach, 2, null_mut()),
            tf_runner_submit_touch(runner, null(), STILL, reach, 2, null_mut()),
            tf_runner_submit_rest(runner, null(), null_mut()),
            tf_runner_poll(runner, null_mut()),
            tf_runner_runner_up(null(), &mut zeroed()),
            tf_runner_runner_up(runner, null_mut()),
            tf_estimate_twins(null(), null_mut(), 0, n),
        ]
    };
    for (at, status) in statuses.into_iter().enumerate() {
        assert_eq!(status, tf_status::NullPointer, "call {at}");
    }
    assert!(made.is_null() && said().contains("null"), "{}", said());
    unsafe {
        tf_episode_free(episode);
        tf_runner_free(runner);
    }
}

#[test]
fn a_frame_that_cannot_be_is_refused_and_strides_and_bgr_are_understood() {
    let world = world();
    let picture = world.touch();
    let (good, width) = (picture.frame(), picture.width);
    let observe = |frame: tf_frame| {
        let mut observation = null_mut();
        let status = unsafe { tf_sensor_observe(world.sensor, &frame, &mut observation) };
        assert_eq!(observation.is_null(), status != tf_status::Ok);
        unsafe { tf_observation_free(observation) };
        status
    };
    for (frame, expected) in [
        (tf_frame { width_px: 0, ..good }, tf_status::Argument),
        (tf_frame { height_px: usize::MAX, ..good }, tf_status::Argument),
        (tf_frame { stride_bytes: 3 * width - 1, ..good }, tf_status::Argument),
        (tf_frame { stride_bytes: usize::MAX / 2, ..good }, tf_status::Argument),
        (tf_frame { format: 2, ..good }, tf_status::Argument),
        (tf_frame { height_px: picture.height - 1, ..good }, tf_status::FrameWrongSize),
    ] {
        assert_eq!(observe(frame), expected, "{}", said());
    }
    let constant = |value: u8| Picture { pixels: vec![value; picture.pixels.len()], width, height: picture.height };
    let faults = [(3, tf_status::FrameDark), (255, tf_status::FrameSaturated), (90, tf_status::FrameUniform)];
    for (value, expected) in faults {
        assert_eq!(observe(constant(value).frame()), expected);
    }
    // The same picture with rows apart, the last of them not padded, and blue first.
    let stride = 3 * width + 5;
    let mut padded = vec![77; stride * (picture.height - 1) + 3 * width];
    for (row, to) in picture.pixels.chunks(3 * width).zip(padded.chunks_mut(stride)) {
        to[..3 * width].copy_from_slice(row);
        to[..3 * width].chunks_mut(3).for_each(|pixel| pixel.swap(0, 2));
    }
    let frame = tf_frame { pixels: padded.as_ptr(), stride_bytes: stride, format: 1, ..good };
    let mut same = null_mut();
    ok(unsafe { tf_sensor_observe(world.sensor, &frame, &mut same) });
    let mut episode = null_mut();
    ok(unsafe { tf_episode_begin(world.config, world.bank, same, &mut episode) });
    let expected = world.episode();
    assert_eq!(estimate(episode), estimate(expected));
    unsafe {
        tf_observation_free(same);
        [episode, expected].into_iter().for_each(|episode| tf_episode_free(episode));
    }
}

#[test]
fn an_error_leaves_the_episode_as_it_was() {
    let world = world();
    let episode = world.episode();
    let before = estimate(episode);
    let observe = |moved, touch| unsafe { tf_episode_observe(episode, moved, touch) };
    let far = tf_pose { x_mm: 1e9, ..STILL };
    for moved in [tf_pose { x_mm: f64::NAN, ..STILL }, tf_pose { theta_rad: f64::INFINITY, ..STILL }, far] {
        assert_eq!(observe(moved, world.touches[1]), tf_status::Motion);
    }
    assert_eq!(observe(REACH[0], world.touches[0]), tf_status::FrozenFrame);
    let decide = |reach: &[tf_pose]| unsafe { tf_episode_decide(episode, reach.as_ptr(), reach.len(), &mut zeroed()) };
    let nowhere = tf_pose { y_mm: f64::NAN, ..STILL };
    assert_eq!([decide(&[]), decide(&[nowhere; 3])], [tf_status::EmptyReach; 2]);
    let too_long = unsafe { tf_episode_decide(episode, REACH.as_ptr(), usize::MAX, &mut zeroed()) };
    assert_eq!(too_long, tf_status::Argument);
    assert_eq!(estimate(episode), before);
    // A buffer that is too short is not written to.
    let (mut posterior, mut n) = ([-1.0; 3], 0);
    let short = unsafe { tf_episode_class_posterior(episode, posterior.as_mut_ptr(), 2, &mut n) };
    assert_eq!((short, posterior, n), (tf_status::BufferTooSmall, [-1.0; 3], 3));
    unsafe { tf_episode_free(episode) };
}

#[test]
fn a_touch_of_the_other_side_is_refused() {
    let world = world();
    let rest = Picture::of(world.path("rest.ppm"));
    let picture = Picture::of(world.path("touch-2.ppm"));
    let (mut sensor, mut peg, episode) = (null_mut(), null_mut(), world.episode());
    unsafe {
        let nothing = tf_sensor_new_of_side(world.model, &rest.frame(), 2, &mut sensor);
        assert!(nothing == tf_status::Argument && sensor.is_null());
        ok(tf_sensor_new_of_side(world.model, &rest.frame(), tf_side::Peg as u32, &mut sensor));
        ok(tf_sensor_observe(sensor, &picture.frame(), &mut peg));
        assert_eq!(tf_episode_observe(episode, REACH[0], peg), tf_status::WrongSide);
        ok(tf_episode_observe(episode, REACH[0], world.touches[1]));
        tf_observation_free(peg);
        tf_sensor_free(sensor);
        tf_episode_free(episode);
    }
}

#[test]
fn known_lamps_make_another_sensor_and_lamps_in_one_line_none() {
    let world = world();
    let rest = Picture::of(world.path("rest.ppm"));
    let (mut sensor, mut lit, mut none) = (null_mut(), null_mut(), null_mut());
    let lamp = |towards: f32| [40.0 * towards, 0.0, 0.0, 0.0, 0.0, 0.0];
    // Red from the left, green from above, blue from below.
    let lamps = tf_lamps { along_x: [lamp(1.0), lamp(0.0), lamp(0.0)], along_y: [lamp(0.0), lamp(1.0), lamp(-1.0)] };
    let line = tf_lamps { along_x: [lamp(1.0), lamp(-1.0), lamp(1.0)], along_y: [lamp(0.0); 3] };
    unsafe {
        ok(tf_sensor_new(world.model, &rest.frame(), &mut sensor));
        ok(tf_sensor_lit_by(sensor, &lamps, &mut lit));
        assert_ne!(tf_sensor_lit_by(sensor, &line, &mut none), tf_status::Ok);
        assert_eq!(tf_sensor_lit_by(sensor, std::ptr::null(), &mut none), tf_status::NullPointer);
        assert!(none.is_null());
        let picture = Picture::of(world.path("touch-2.ppm"));
        let (mut plain, mut other) = (null_mut(), null_mut());
        ok(tf_sensor_observe(sensor, &picture.frame(), &mut plain));
        ok(tf_sensor_observe(lit, &picture.frame(), &mut other));
        let share = |observation| {
            let mut share = 0.0;
            ok(tf_observation_edge_share(observation, &mut share));
            share
        };
        assert_ne!(share(plain), share(other));
        [plain, other].into_iter().for_each(|observation| tf_observation_free(observation));
        [sensor, lit].into_iter().for_each(|sensor| tf_sensor_free(sensor));
    }
}

#[test]
fn lamps_are_learnt_from_twenty_touches_and_not_before() {
    let scene = Scene::preset("alphabet-small").unwrap();
    let view = scene.sensor.field_of_view_mm;
    let simulator = Simulator::new(scene, 1).unwrap();
    let picture =
        |frame: Frame| Picture { width: frame.width_px(), height: frame.height_px(), pixels: frame.rgb().to_vec() };
    let touch = |number: u64| {
        let part = number as usize % 12;
        picture(simulator.touch(part, Side::Hole, &Se2::IDENTITY, &mut frame_rng(5, number)).unwrap())
    };
    let rest = picture(simulator.no_contact(3));
    let mut light = null_mut();
    let mut lamps = tf_lamps { along_x: [[0.0; 6]; 3], along_y: [[0.0; 6]; 3] };
    let mut is_new = 7;
    unsafe {
        assert_eq!(tf_light_new(&rest.frame(), -1.0, 14.3, &mut light), tf_status::Unusable);
        assert!(light.is_null());
        ok(tf_light_new(&rest.frame(), view[0], view[1], &mut light));
        let small = Picture { width: 40, height: 30, pixels: vec![90; 3 * 40 * 30] };
        assert_eq!(tf_light_add(light, &small.frame()), tf_status::FrameWrongSize);
        for number in 0..19 {
            ok(tf_light_add(light, &touch(number).frame()));
        }
        ok(tf_light_learn(light, &mut is_new, &mut lamps));
        assert_eq!((is_new, lamps.along_y[0]), (0, [0.0; 6]));
        ok(tf_light_add(light, &touch(19).frame()));
        assert_eq!(tf_light_learn(light, &mut is_new, null_mut()), tf_status::NullPointer);
        ok(tf_light_learn(light, &mut is_new, &mut lamps));
        // A Mini's red lamp shines along y.
        assert!(is_new == 1 && lamps.along_y[0][0] > 80.0 && lamps.along_x[0][0].abs() < 30.0, "{:?}", lamps.along_y);
        ok(tf_light_learn(light, &mut is_new, &mut lamps));
        assert_eq!(is_new, 0);
        tf_light_free(light);
        tf_light_free(null_mut());
    }
}

#[test]
fn a_known_start_is_rusts_and_one_far_away_is_refused_where_an_episode_begins() {
    let (world, config) = (world(), config_with(tf_side::Hole, &[]));
    let covariance = [4.0, 0.5, 0.0, 0.5, 2.0, 0.0, 0.0, 0.0, 0.1];
    let [base_from_part, base_from_first] =
        [[310.0, -82.0, 0.4], [309.0, -80.5, 0.5]].map(|[x_mm, y_mm, theta_rad]| tf_pose { x_mm, y_mm, theta_rad });
    let begin = |config| {
        let mut episode = null_mut();
        (unsafe { tf_episode_begin(config, world.bank, world.touches[0], &mut episode) }, episode)
    };
    unsafe {
        assert_eq!(tf_config_know_start(config, STILL, null()), tf_status::NullPointer);
        assert_eq!(tf_config_know_start(null_mut(), STILL, covariance.as_ptr()), tf_status::NullPointer);
        ok(tf_config_know_part(config, base_from_part, covariance.as_ptr(), base_from_first));
        let (status, episode) = begin(config);
        ok(status);
        let expected = KnownStart::of_part(
            base_from_part.into(),
            [[4.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 0.1]],
            base_from_first.into(),
        );
        assert_eq!(runs_with(episode).start, Some(expected));
        assert_ne!(estimate(episode).0.part_from_first, estimate(world.episode()).0.part_from_first);
        tf_episode_free(episode);
        // Metres instead of millimetres, in the part's frame.
        ok(tf_config_know_start(config, tf_pose { x_mm: 3100.0, ..STILL }, covariance.as_ptr()));
        assert_eq!(begin(config).0, tf_status::Config);
        assert!(said().starts_with("start: expected a pose within"), "{}", said());
        ok(tf_config_know_start(config, STILL, [-1.0; 9].as_ptr()));
        assert_eq!(begin(config).0, tf_status::Config);
        assert_eq!(tf_config_forget_start(null_mut()), tf_status::NullPointer);
        ok(tf_config_forget_start(config));
        let (status, episode) = begin(config);
        ok(status);
        assert_eq!(runs_with(episode).start, None);
        tf_episode_free(episode);
        tf_config_free(config);
    }
}

#[test]
fn the_belief_over_the_parts_adds_up_to_their_posterior() {
    let world = world();
    let episode = world.episode();
    let (mut posterior, mut n) = ([0.0; 3], 0);
    ok(unsafe { tf_episode_class_posterior(episode, posterior.as_mut_ptr(), 3, &mut n) });
    for (part, expected) in posterior.iter().enumerate() {
        let mut n_states = 0;
        ok(unsafe { tf_episode_belief(episode, part, null_mut(), 0, &mut n_states) });
        let mut states = vec![tf_state { part_from_sensor: STILL, probability: -1.0 }; n_states];
        ok(unsafe { tf_episode_belief(episode, part, states.as_mut_ptr(), n_states, &mut n_states) });
        let sum: f64 = states.iter().map(|state| state.probability).sum();
        // Sums in another order.
        assert!((sum - expected).abs() < 1e-12, "{sum} {expected}");
        // 9 x 9 x 5 recorded poses, and one between each two.
        assert_eq!(states.len(), 17 * 17 * 9);
    }
    assert_eq!(unsafe { tf_episode_belief(episode, 3, null_mut(), 0, &mut n) }, tf_status::Argument);
    unsafe { tf_episode_free(episode) };
}

#[test]
fn the_runner_up_is_that_of_rust_and_a_part_that_is_alone_has_none() {
    let world = world();
    let model = Model::load(&world.path("model.safetensors")).unwrap();
    let bank = Arc::new(Bank::load(&world.path("parts.bank"), &model).unwrap());
    let record: EpisodeRecord = serde_json::from_slice(&saved()).unwrap();
    let expected = Episode::restore(&record, bank.clone()).unwrap().estimate().runner_up.unwrap();
    let (episode, mut other) = (world.episode(), tf_runner_up::default());
    ok(unsafe { tf_episode_runner_up(episode, &mut other) });
    let name = unsafe { CStr::from_ptr(other.part_name) }.to_str().unwrap();
    assert_eq!((other.has_part, name, &bank.parts()[other.part]), (1, expected.part.as_str(), &expected.part));
    assert_eq!(other.probability, expected.probability);
    let (mut posterior, mut n) = ([0.0; 3], 0);
    ok(unsafe { tf_episode_class_posterior(episode, posterior.as_mut_ptr(), 3, &mut n) });
    posterior.sort_by(f64::total_cmp);
    assert_eq!((posterior[1], estimate(episode).0.probability), (other.probability, posterior[2]));

    // Only K is left.
    let alone = bank.without(2).unwrap().without(1).unwrap();
    alone.save(&world.path("alone.bank")).unwrap();
    let path = CString::new(world.path("alone.bank").to_str().unwrap()).unwrap();
    let (mut bank, mut lonely) = (null_mut(), null_mut());
    ok(unsafe { tf_bank_load(world.model, path.as_ptr(), &mut bank) });
    ok(unsafe { tf_episode_begin(world.config, bank, world.touches[0], &mut lonely) });
    ok(unsafe { tf_episode_runner_up(lonely, &mut other) });
    assert_eq!((other.has_part, other.part, other.probability), (0, 0, 0.0));
    assert!(unsafe { CStr::from_ptr(other.part_name) }.is_empty());
    unsafe {
        [episode, lonely].into_iter().for_each(|episode| tf_episode_free(episode));
        tf_bank_free(bank);
    }
}

#[test]
fn files_that_are_not_what_they_should_be_have_their_status() {
    let world = world();
    let load = |name: &str| {
        let path = CString::new(world.path(name).to_str().unwrap()).unwrap();
        let (mut model, mut bank) = (null_mut(), null_mut());
        let statuses =
            unsafe { [tf_model_load(path.as_ptr(), &mut model), tf_bank_load(world.model, path.as_ptr(), &mut bank)] };
        unsafe {
            tf_model_free(model);
            tf_bank_free(bank);
        }
        statuses
    };
    assert_eq!(load("absent"), [tf_status::File; 2]);
    assert_eq!(load("rest.ppm"), [tf_status::Unusable; 2]);
    assert_eq!(load("parts.bank"), [tf_status::Unusable, tf_status::Ok]);
    assert_eq!(load("model.safetensors"), [tf_status::Ok, tf_status::Unusable]);
    let model = CString::new(world.path("model.safetensors").to_str().unwrap()).unwrap();
    let with_maps = |maps: &CStr| {
        let mut made = null_mut();
        let status = unsafe { tf_model_load_with_maps(model.as_ptr(), maps.as_ptr(), &mut made) };
        unsafe { tf_model_free(made) };
        status
    };
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../../infer/models/maze-small.maps.safetensors");
    assert_eq!(with_maps(&CString::new(shipped).unwrap()), tf_status::Ok);
    assert_eq!([with_maps(&model), with_maps(c"absent")], [tf_status::Unusable, tf_status::File]);
    let [no_model, no_maps] = [(null(), model.as_ptr()), (model.as_ptr(), null())]
        .map(|(model, maps)| unsafe { tf_model_load_with_maps(model, maps, &mut null_mut()) });
    assert_eq!([no_model, no_maps], [tf_status::NullPointer; 2]);
    let empty = unsafe { tf_model_load(c"".as_ptr(), &mut null_mut()) };
    assert_eq!(empty, tf_status::Argument);
    // Names by index, and no other.
    let mut name: *const c_char = null();
    ok(unsafe { tf_bank_part_name(world.bank, 2, &mut name) });
    assert_eq!(unsafe { CStr::from_ptr(name) }, c"T");
    assert_eq!(unsafe { tf_bank_part_name(world.bank, 3, &mut name) }, tf_status::Argument);
}

#[test]
fn handles_may_be_freed_in_any_order() {
    let world = world();
    let path = CString::new(world.path("model.safetensors").to_str().unwrap()).unwrap();
    let bank_path = CString::new(world.path("parts.bank").to_str().unwrap()).unwrap();
    let (mut model, mut bank, mut sensor, mut touch) = (null_mut(), null_mut(), null_mut(), null_mut());
    let (mut config, mut episode, mut runner) = (null_mut(), null_mut(), null_mut());
    let rest = Picture::of(world.path("rest.ppm"));
    unsafe {
        ok(tf_model_load(path.as_ptr(), &mut model));
        ok(tf_bank_load(model, bank_path.as_ptr(), &mut bank));
        ok(tf_sensor_new(model, &rest.frame(), &mut sensor));
        ok(tf_config_new(model, 0, &mut config));
        tf_model_free(model);
        ok(tf_sensor_observe(sensor, &world.touch().frame(), &mut touch));
        ok(tf_episode_begin(config, bank, touch, &mut episode));
        ok(tf_runner_start(sensor, bank, config, 1, &mut runner));
        tf_config_free(config);
        tf_bank_free(bank);
        tf_sensor_free(sensor);
        tf_observation_free(touch);
        ok(tf_runner_submit_touch(runner, &world.touch().frame(), STILL, REACH.as_ptr(), 2, null_mut()));
    }
    // The names too.
    let expected = world.episode();
    assert_eq!(estimate(episode), estimate(expected));
    assert_eq!(wait(runner).kind, tf_outcome_kind::Decision);
    unsafe {
        [episode, expected].into_iter().for_each(|episode| tf_episode_free(episode));
        tf_runner_free(runner);
    }
}

#[test]
fn a_runner_answers_each_job_once_with_its_status() {
    let world = world();
    let runner = world.runner(2);
    let (touch, mut ticket) = (world.touch(), u64::MAX);
    let dark = Picture { pixels: vec![3; touch.pixels.len()], ..world.touch() };
    let mut submit = |picture: &Picture| {
        let status = unsafe { tf_runner_submit_touch(runner, &picture.frame(), STILL, REACH.as_ptr(), 2, &mut ticket) };
        (status, ticket)
    };
    assert_eq!([submit(&dark), submit(&touch)], [(tf_status::Ok, 0), (tf_status::Ok, 1)]);
    assert_eq!(submit(&touch), (tf_status::QueueFull, 1));
    let refused = wait(runner);
    assert_eq!((refused.kind, refused.status, refused.ticket), (tf_outcome_kind::Error, tf_status::FrameDark, 0));
    assert!(said().contains("dark"), "{}", said());
    let taken_in = wait(runner);
    assert_eq!((taken_in.kind, taken_in.status, taken_in.ticket), (tf_outcome_kind::Decision, tf_status::Ok, 1));
    ok(unsafe { tf_runner_submit_estimate(runner, &mut ticket) });
    let mut known = wait(runner).decision.estimate;
    known.part_name = null();
    let episode = world.episode();
    assert_eq!(known, estimate(episode).0);
    // A name belongs to its handle.
    let nameless = |other: tf_runner_up| tf_runner_up { part_name: null(), ..other };
    let of_runner = || {
        let mut other = tf_runner_up::default();
        ok(unsafe { tf_runner_runner_up(runner, &mut other) });
        nameless(other)
    };
    let mut other = tf_runner_up::default();
    ok(unsafe { tf_episode_runner_up(episode, &mut other) });
    assert_eq!((of_runner(), other.has_part), (nameless(other), 1));
    ok(unsafe { tf_runner_submit_new_episode(runner, null(), null_mut()) });
    ok(unsafe { tf_runner_submit_estimate(runner, &mut ticket) });
    let new = wait(runner);
    assert_eq!(of_runner(), nameless(tf_runner_up::default()));
    let none = wait(runner);
    assert_eq!((new.kind, none.status, none.ticket), (tf_outcome_kind::NewEpisode, tf_status::NoEpisode, 4));
    unsafe {
        tf_runner_free(runner);
        tf_episode_free(episode);
    }
    for capacity in [0, usize::MAX] {
        let mut runner = null_mut();
        let status = unsafe { tf_runner_start(world.sensor, world.bank, world.config, capacity, &mut runner) };
        assert_eq!((status, runner), (tf_status::Config, null_mut()));
    }
}

#[test]
fn threads_that_share_an_episode_get_an_answer_or_busy() {
    let world = world();
    let episode = world.episode();
    let address = episode as usize;
    std::thread::scope(|scope| {
        for thread in 0..4 {
            scope.spawn(move || {
                let episode = address as *mut tf_episode;
                for _ in 0..50 {
                    let (mut known, touch) = (tf_estimate::default(), world.touches[thread % 2]);
                    let status = match thread {
                        0 => unsafe { tf_episode_observe(episode, STILL, touch) },
                        _ => unsafe { tf_episode_estimate(episode, &mut known, null_mut()) },
                    };
                    assert!([tf_status::Ok, tf_status::Busy].contains(&status), "{}", said());
                }
            });
        }
    });
    assert!(estimate(episode).0.n_touches >= 1);
    unsafe { tf_episode_free(episode) };
}

/// An episode's record.
fn recorded(episode: *const tf_episode) -> Vec<u8> {
    let mut n = 0;
    ok(unsafe { tf_episode_record(episode, null_mut(), 0, &mut n) });
    let mut json = vec![0; n];
    ok(unsafe { tf_episode_record(episode, json.as_mut_ptr(), n, &mut n) });
    json
}

/// A saved episode's text.
fn saved() -> Vec<u8> {
    let episode = world().episode();
    let json = recorded(episode);
    unsafe { tf_episode_free(episode) };
    json
}

fn restore(json: &[u8]) -> tf_status {
    let mut episode = null_mut();
    let status = unsafe { tf_episode_restore(world().bank, json.as_ptr(), json.len(), &mut episode) };
    assert_eq!(episode.is_null(), status != tf_status::Ok);
    unsafe { tf_episode_free(episode) };
    status
}

#[test]
fn a_saved_episode_that_asks_for_all_memory_is_refused() {
    let text = String::from_utf8(saved()).unwrap();
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{from} in {text:.600}");
        restore(text.replacen(from, to, 1).as_bytes())
    };
    assert_eq!(restore(text.as_bytes()), tf_status::Ok);
    assert_eq!(with("\"n_draws\":160", "\"n_draws\":99999999999999"), tf_status::Config);
    let particles = r#""engine":{"particle":{"n_particles":99999999999999}}"#;
    assert_eq!(with(r#""engine":"exact""#, particles), tf_status::Config);
    assert_eq!(with("\"version\":", "\"version\":1"), tf_status::WrongBank);
    assert_eq!(restore(b""), tf_status::Argument);
}

/// A config of a side in which some settings are set, to be freed.
fn config_with(side: tf_side, settings: &[(&CStr, &CStr)]) -> *mut tf_config {
    let mut config = null_mut();
    ok(unsafe { tf_config_new(world().model, side as u32, &mut config) });
    settings.iter().for_each(|(name, value)| ok(unsafe { tf_config_set(config, name.as_ptr(), value.as_ptr()) }));
    config
}

/// What an episode runs with, as its record says.
fn runs_with(episode: *mut tf_episode) -> EpisodeConfig {
    serde_json::from_slice::<EpisodeRecord>(&recorded(episode)).unwrap().config
}

#[test]
fn an_episode_runs_with_what_was_measured_of_its_side_and_what_was_set() {
    let world = world();
    let model = Model::load(&world.path("model.safetensors")).unwrap();
    let expected = |side| {
        let mut config = EpisodeConfig::of_side(&model, side);
        config.settings = Settings { stop_place_mm: Some(0.5), n_finalists: None, seed: 7, ..config.settings };
        config
    };
    let set = [(c"stop_place_mm", c"0.5"), (c"n_finalists", c"none"), (c"seed", c"7")];
    for (side, in_rust) in [(tf_side::Hole, Side::Hole), (tf_side::Peg, Side::Peg)] {
        let (config, mut episode) = (config_with(side, &set), null_mut());
        ok(unsafe { tf_episode_begin(config, world.bank, world.touches[0], &mut episode) });
        // What is set later is of later episodes.
        ok(unsafe { tf_config_set(config, c"seed".as_ptr(), c"8".as_ptr()) });
        assert_eq!(runs_with(episode), expected(in_rust));
        unsafe {
            tf_episode_free(episode);
            tf_config_free(config);
        }
    }
    // The shipped model was calibrated on either side.
    assert_ne!(expected(Side::Hole), expected(Side::Peg));
}

#[test]
fn settings_that_together_take_all_time_are_refused_where_an_episode_begins() {
    let world = world();
    let config = config_with(tf_side::Hole, &[(c"n_draws", c"100000"), (c"n_suppositions", c"1000")]);
    let (mut episode, mut started, runner) = (null_mut(), null_mut(), world.runner(1));
    let statuses = unsafe {
        [
            tf_episode_begin(config, world.bank, world.touches[0], &mut episode),
            tf_runner_start(world.sensor, world.bank, config, 1, &mut started),
            tf_runner_submit_new_episode(runner, config, null_mut()),
        ]
    };
    assert_eq!((statuses, episode.is_null(), started.is_null()), ([tf_status::Config; 3], true, true));
    let expected = "episode.n_draws, n_suppositions, n_finalists: expected at most 1e8 pairs";
    assert!(said().starts_with(expected), "{}", said());
    // The config is still there to be mended.
    ok(unsafe { tf_config_set_number(config, c"n_draws".as_ptr(), 160.0) });
    ok(unsafe { tf_runner_submit_new_episode(runner, config, null_mut()) });
    assert_eq!(wait(runner).kind, tf_outcome_kind::NewEpisode);
    unsafe {
        tf_runner_free(runner);
        tf_config_free(config);
    }
}

#[test]
fn an_endless_motion_is_refused_in_a_short_line() {
    let episode = world().episode();
    let far = tf_pose { x_mm: 1e300, y_mm: -1e-300, theta_rad: 0.0 };
    assert_eq!(unsafe { tf_episode_observe(episode, far, world().touches[0]) }, tf_status::Motion);
    assert!(said().ends_with("got x 1e300 mm, y -1e-300 mm, theta 0 rad"), "{}", said());
    unsafe { tf_episode_free(episode) };
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_damaged_record_is_an_error_or_an_episode(at in 0.0..1.0_f64, byte: u8, cut: bool) {
        static SAVED: OnceLock<Vec<u8>> = OnceLock::new();
        let mut json = SAVED.get_or_init(saved).clone();
        let at = (at * json.len() as f64) as usize;
        if cut { json.truncate(at) } else { json[at] = byte }
        prop_assert!(restore(&json) != tf_status::Panic);
    }

    #[test]
    fn any_settings_are_an_error_or_an_episode(
        at in 0..Settings::numbers().len(),
        other in 0..Settings::numbers().len(),
        values in prop::array::uniform2(prop_oneof![any::<f64>(), 0.0..1.0_f64, (0..2000_u32).prop_map(f64::from)]),
    ) {
        let (world, config, mut episode) = (world(), config_with(tf_side::Hole, &[]), null_mut());
        for (at, value) in [at, other].into_iter().zip(values) {
            let name = CString::new(Settings::numbers()[at].name).unwrap();
            let status = unsafe { tf_config_set_number(config, name.as_ptr(), value) };
            prop_assert!([tf_status::Ok, tf_status::Config].contains(&status), "{:?}", status);
        }
        let status = unsafe { tf_episode_begin(config, world.bank, world.touches[0], &mut episode) };
        prop_assert!([tf_status::Ok, tf_status::Config].contains(&status), "{:?}", status);
        unsafe {
            tf_episode_free(episode);
            tf_config_free(config);
        }
    }
}

#[test]
fn a_search_is_rusts_and_a_try_in_vain_is_taken_in() {
    let world = world();
    let episode = world.episode();
    let peg = tf_held_peg { play_mm: 0.5, radius_mm: 8.0, covariance: [0.0; 9], most_poses: 50 };
    let (mut covered, mut n, mut offsets) = (0.0, 0, [STILL; 50]);
    unsafe {
        ok(tf_episode_search(episode, &peg, &mut covered, null_mut(), 0, &mut n));
        let known = estimate(episode).0;
        let record = || serde_json::from_slice::<EpisodeRecord>(&recorded(episode)).unwrap();
        let bank =
            Bank::load(&world.path("parts.bank"), &Model::load(&world.path("model.safetensors")).unwrap()).unwrap();
        let rust = Episode::restore(&record(), Arc::new(bank)).unwrap().estimate();
        let found = rust.search(&HeldPeg { play_mm: 0.5, radius_mm: 8.0, covariance: [[0.0; 3]; 3] }, 50).unwrap();
        assert_eq!((found.offsets.len(), found.in_vain.covered), (n, covered));
        ok(tf_episode_search(episode, &peg, null_mut(), offsets.as_mut_ptr(), n, &mut n));
        assert_eq!(offsets[..n].iter().map(|offset| (*offset).into()).collect::<Vec<Se2>>(), found.offsets);
        let mut covariance = [0.0; 9];
        ok(tf_episode_offset_covariance(episode, covariance.as_mut_ptr()));
        assert_eq!(covariance, rust.offset_covariance().as_flattened());
        assert_eq!(tf_episode_search(episode, &peg, null_mut(), null_mut(), 1, &mut n), tf_status::NullPointer);
        assert_eq!(tf_episode_search(episode, null(), null_mut(), null_mut(), 0, &mut n), tf_status::NullPointer);
        assert_eq!(tf_episode_offset_covariance(episode, null_mut()), tf_status::NullPointer);
        for wrong in [tf_held_peg { play_mm: 0.0, ..peg }, tf_held_peg { radius_mm: f64::NAN, ..peg }] {
            assert_eq!(tf_episode_did_not_fit(episode, &wrong), tf_status::Config);
            assert!(said().contains("expected a number above zero"), "{}", said());
        }
        assert_eq!(estimate(episode).0, known);
        ok(tf_episode_did_not_fit(episode, &peg));
        assert!(estimate(episode).0.log_evidence < known.log_evidence);
        assert_eq!(record().tried, vec![(1, found.in_vain)]);
        tf_episode_free(episode);
    }
}

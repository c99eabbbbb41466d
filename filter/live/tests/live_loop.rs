//! The whole loop in one process: a simulated robot that only messages connect with the node.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::frame::picture::write_png;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::bag::Bag;
use tactile_data::recording::ros::bag_writer::BagWriter;
use tactile_data::recording::ros::messages::{
    Header, Image, Message, OccupancyGrid, Pose, PoseStamped, PoseWithCovarianceStamped, TFMessage, Text,
    TransformStamped, from_cdr, to_cdr,
};
use tactile_data::scene::{Kit, Parts, Scene};
use tactile_data::sensor::light::LightRig;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::StopReason;
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::{Bank, Model};
use tactile_live::robot::{Faults, Outcome, Robot, RobotSettings};
use tactile_live::session::{Names, Session};
use tactile_live::shell::{Spoken, folder, pair, spoken};
use tactile_live::sources::commands::{Command, Place};
use tactile_live::sources::folder::Folder;
use tactile_live::sources::placed;
use tactile_live::{DecisionReport, Event, Given, Input, Node, Output, Parameters, Request, replay};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../infer/models/maze-small.safetensors");

/// The shipped model and the bank of twelve letters, made once.
fn model_and_bank() -> (Arc<Model>, Arc<Bank>) {
    static MADE: OnceLock<(Arc<Model>, Arc<Bank>)> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let model = Model::load(Path::new(MODEL)).unwrap();
        let bank = bank_of_scene(&model, &scene(), Views::Pegs, 1, &|_, _| ()).unwrap();
        (Arc::new(model), Arc::new(bank))
    });
    made.clone()
}

/// Six letters, recorded densely enough for touches between the recorded poses.
fn scene() -> Scene {
    let reach = PoseGrid { xy_half_mm: 6.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };
    let parts = Parts::Kit(Kit::of_letters("ABCEGK", 12.0, 16.0));
    Scene { reach: Some(reach), parts, ..Scene::load("alphabet-small").unwrap() }
}

fn node() -> Node {
    let (model, bank) = model_and_bank();
    Node::new(Parameters::default(), model, bank).unwrap()
}

/// Runs a robot against a node; what became of the holes and what was said.
fn run(settings: RobotSettings, session: &mut Session) -> (Vec<Outcome>, Vec<String>) {
    run_in(scene(), settings, session)
}

/// The same in a scene.
fn run_in(scene: Scene, settings: RobotSettings, session: &mut Session) -> (Vec<Outcome>, Vec<String>) {
    let mut robot = Robot::new(settings, Simulator::new(scene, 1).unwrap()).unwrap();
    let mut lines = Vec::new();
    pair::run(session, &mut robot, 600.0, &mut |_| true, &mut |spoken| {
        lines.extend(match spoken {
            Spoken::Line(line) => Some(line),
            Spoken::Decision(_) => None,
        });
    })
    .unwrap();
    (robot.outcomes().to_vec(), lines)
}

fn is_right(outcome: &Outcome) -> bool {
    outcome.stop == Some(StopReason::Confident) && outcome.named.last() == Some(&outcome.part) && outcome.off_mm < 1.5
}

/// A session that logs to `log`.
fn logged(log: &Path) -> Session {
    let (model, bank) = model_and_bank();
    let setup = Names::default().setup(&Parameters::default(), &model, &bank).unwrap();
    Session::new(node()).with_log(log, &setup).unwrap()
}

#[test]
fn holes_are_named_and_the_log_gives_the_same_decisions() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap");
    let mut session = logged(&log);
    let settings = RobotSettings { n_episodes: 12, ..RobotSettings::default() };
    let (outcomes, lines) = run(settings, &mut session);
    session.finish().unwrap();
    // A print of a hole may be so unlike its peg that no touch makes sure of it.
    assert!(outcomes.iter().filter(|outcome| is_right(outcome)).count() >= 10, "{outcomes:?}");
    assert!(outcomes.iter().all(|outcome| outcome.n_refused == 0), "{lines:?}");

    let (model, bank) = model_and_bank();
    let replayed = replay::replay(&log, model.clone(), bank.clone()).unwrap();
    let named: Vec<_> = outcomes.iter().flat_map(|outcome| outcome.named.clone()).collect();
    assert_eq!(replayed.decisions.iter().map(|d| d.estimate.part.clone()).collect::<Vec<_>>(), named);
    assert_eq!(replayed.cut, None);
    let with_other = |decision: &DecisionReport| decision.estimate.runner_up.is_some();
    assert!(replayed.decisions.iter().any(with_other));
    for decision in &replayed.decisions {
        let Some(other) = &decision.estimate.runner_up else { continue };
        let of_other = decision.posterior.iter().find(|(part, _)| *part == other.part);
        assert_eq!(of_other.map(|(_, probability)| *probability), Some(other.probability), "{decision:?}");
    }

    // Cut off where a program was killed: what is there is replayed.
    let bytes = std::fs::read(&log).unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let half = replay::replay(&cut, model.clone(), bank.clone()).unwrap();
    assert!(half.cut.is_some() && half.n_events < replayed.n_events && half.n_events > replayed.n_events / 3);

    // A log is never written over.
    let setup = replay::setup(&log).unwrap();
    assert!(Session::new(node()).with_log(&log, &setup).is_err());
    // Another model or bank is refused, as is a log that lacks an event, or holds other bytes.
    let other = Arc::new(bank.with_parts(&[0, 1]).unwrap());
    assert!(replay::replay(&log, model.clone(), other).unwrap_err().to_string().contains("bank of log"));
    for (drop_one, said) in [(true, "is missing"), (false, "other bytes")] {
        let changed = folder.path().join(format!("changed-{drop_one}.mcap"));
        copy_changed(&log, &changed, drop_one);
        let error = replay::replay(&changed, model.clone(), bank.clone()).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn a_camera_that_sees_the_part_saves_touches_and_is_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap");
    let touches = |part_seen_to, session: &mut Session| {
        let settings = RobotSettings { n_episodes: 12, part_seen_to, ..RobotSettings::default() };
        let (outcomes, lines) = run(settings, session);
        assert!(outcomes.iter().filter(|outcome| is_right(outcome)).count() >= 10, "{outcomes:?}");
        assert!(outcomes.iter().all(|outcome| outcome.n_refused == 0), "{lines:?}");
        outcomes.iter().map(|outcome| outcome.named.len()).sum::<usize>()
    };
    let mut session = logged(&log);
    let seen = touches(Some([0.5, 2.0]), &mut session);
    session.finish().unwrap();
    let unseen = touches(None, &mut Session::new(node()));
    assert!(seen < unseen, "{seen} touches instead of {unseen}");
    let (model, bank) = model_and_bank();
    assert_eq!(replay::replay(&log, model, bank).unwrap().decisions.len(), seen);
}

#[test]
fn under_lamps_that_nobody_knows_holes_are_named_once_their_touches_have_told_them() {
    let (model, bank) = model_and_bank();
    let mut parameters = Parameters::default();
    parameters.camera.learn_light = true;
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap");
    let setup = Names::default().setup(&parameters, &model, &bank).unwrap();
    let node = Node::new(parameters.clone(), model.clone(), bank.clone()).unwrap();
    let mut session = Session::new(node).with_log(&log, &setup).unwrap();
    let mut other = scene();
    other.sensor.light = LightRig::named("cmu").unwrap();
    let settings = RobotSettings { n_episodes: 12, ..RobotSettings::default() };
    let (outcomes, lines) = run_in(other, settings, &mut session);
    session.finish().unwrap();
    assert!(lines.iter().any(|line| line.contains("light: red") && line.contains("turned by")), "{lines:?}");
    // The first twenty touches come from the first three holes or so.
    let n_right = |outcomes: &[Outcome]| outcomes.iter().filter(|outcome| is_right(outcome)).count();
    assert!(n_right(&outcomes[..2]) == 0 && n_right(&outcomes[6..]) >= 4, "{outcomes:?}");
    let replayed = replay::replay(&log, model.clone(), bank.clone()).unwrap();
    assert_eq!(replayed.decisions.len(), outcomes.iter().map(|outcome| outcome.named.len()).sum::<usize>());
    // A calibration says it better.
    parameters.camera.calibration = Some("mine.toml".to_owned());
    let error = Node::new(parameters, model, bank).unwrap_err().to_string();
    assert!(error.starts_with("camera.learn_light: expected false where camera.calibration is given"), "{error}");
}

#[test]
fn strangers_hole_after_hole_are_said_once() {
    let strangers = Scene { parts: Parts::Kit(Kit::of_letters("MNPRSX", 12.0, 16.0)), ..scene() };
    let settings = RobotSettings { n_episodes: 8, ..RobotSettings::default() };
    let (outcomes, lines) = run_in(strangers, settings, &mut Session::new(node()));
    let n_said = lines.iter().filter(|line| line.starts_with("3 holes in a row are none of these parts")).count();
    let is_refused = |outcome: &Outcome| outcome.stop == Some(StopReason::NoneOfThese);
    // After the last hole nobody asks for another.
    let over = &outcomes[..7];
    let n_in_row = over.split(|outcome| !is_refused(outcome)).filter(|refused| refused.len() >= 3).count();
    assert!(n_in_row > 0 && n_said == n_in_row, "{n_said} {outcomes:?}");
}

#[test]
fn the_frame_in_which_the_belief_is_drawn_is_where_the_part_is() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("live.mcap");
    let mut session = logged(&log);
    run(RobotSettings { n_episodes: 2, ..RobotSettings::default() }, &mut session);
    session.finish().unwrap();
    let messages: Vec<_> = Bag::open(&log).unwrap().messages().map(|message| message.unwrap()).collect();
    let of = |topic: &'static str| messages.iter().filter(move |message| message.channel.topic == topic);
    // On one clock, so that a viewer's slider spans what happened.
    let times = messages.iter().map(|message| message.log_time_ns);
    assert!(times.clone().max().unwrap() - times.min().unwrap() < 60_000_000_000);
    let n_frames = of("/tf_static").count();
    let counts = ["/tactile_filter/pose", "/tactile_filter/belief"].map(|topic| of(topic).count());
    assert!(n_frames >= 2 && counts == [n_frames; 2], "{n_frames} {counts:?}");
    let others = of("/tactile_filter/pose").zip(of("/tactile_filter/belief"));
    for (frame, (pose, belief)) in of("/tf_static").zip(others) {
        assert_eq!([frame.sequence; 2], [pose.sequence, belief.sequence]);
        let frame: TFMessage = from_cdr(frame.bytes(), "frame").unwrap();
        let pose: PoseWithCovarianceStamped = from_cdr(pose.bytes(), "pose").unwrap();
        let belief: OccupancyGrid = from_cdr(belief.bytes(), "belief").unwrap();
        let child_frame_id = belief.header.frame_id;
        assert_eq!(frame.transforms, [TransformStamped { header: pose.header, child_frame_id, transform: pose.pose }]);
    }
}

/// Copies a log without its 200th picture, or with another byte in it.
fn copy_changed(log: &Path, out: &Path, drop_one: bool) {
    let mut writer = BagWriter::new(out, std::fs::File::create_new(out).unwrap(), "test").unwrap();
    let mut channels = std::collections::BTreeMap::new();
    let mut n_pictures = 0;
    for message in Bag::open(log).unwrap().messages() {
        let message = message.unwrap();
        let (topic, type_name) = (&message.channel.topic, &message.channel.type_name);
        let channel = *channels
            .entry((topic.clone(), type_name.clone()))
            .or_insert_with(|| writer.channel_of(topic, type_name, "").unwrap());
        let mut bytes = message.bytes().to_vec();
        n_pictures += usize::from(topic.ends_with("/image"));
        if topic.ends_with("/decision") && !drop_one {
            *bytes.last_mut().unwrap() ^= 1;
        }
        if drop_one && topic.ends_with("/image") && n_pictures == 200 {
            continue;
        }
        writer.write_numbered(channel, message.log_time_ns, message.sequence, &bytes).unwrap();
    }
    writer.finish().unwrap();
}

/// Runs a robot for some seconds, after which it is gone.
fn run_for(seconds: f64, session: &mut Session) -> usize {
    let settings = RobotSettings { n_episodes: 40, ..RobotSettings::default() };
    let mut robot = Robot::new(settings, Simulator::new(scene(), 1).unwrap()).unwrap();
    let mut n_decisions = 0;
    let count = &mut |spoken| n_decisions += usize::from(matches!(spoken, Spoken::Decision(_)));
    assert!(pair::run(session, &mut robot, seconds, &mut |_| true, count).is_err(), "it ended before");
    n_decisions
}

#[test]
fn the_log_of_a_node_that_was_killed_holds_all_but_the_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("killed.mcap");
    let mut session = logged(&log);
    let n_decisions = run_for(12.0, &mut session);
    // Nothing that it still held comes into the file.
    std::mem::forget(session);
    let (model, bank) = model_and_bank();
    let replayed = replay::replay(&log, model, bank).unwrap();
    assert!(replayed.cut.unwrap().contains("is cut off at byte"));
    // 50 poses, 25 pictures and 50 ticks a second.
    assert!(replayed.n_events >= 11 * 125, "{} events", replayed.n_events);
    let n_lost = n_decisions - replayed.decisions.len();
    assert!(n_decisions >= 8 && n_lost <= 1, "{n_lost} of {n_decisions} lost");
}

#[test]
fn a_robot_that_comes_after_one_that_was_killed_begins_a_hole_of_its_own() {
    let mut session = Session::new(node());
    let n_decisions = run_for(1.6, &mut session);
    assert!(n_decisions >= 1 && session.node().episode().is_some(), "{n_decisions}");
    let (outcomes, lines) = run(RobotSettings { n_episodes: 2, seed: 6, ..RobotSettings::default() }, &mut session);
    assert!(outcomes.iter().all(is_right), "{outcomes:?} {lines:?}");
    assert_eq!(session.node().episode().unwrap().belief().touches().len(), outcomes[1].named.len());
}

#[test]
fn dropped_and_frozen_pictures_cost_nothing_but_time() {
    let settings = RobotSettings { n_episodes: 6, ..RobotSettings::default() };
    let (whole, _) = run(settings.clone(), &mut Session::new(node()));
    let faults = Faults { dropped: 0.02, frozen: 0.01, ..Faults::default() };
    let (lossy, _) = run(RobotSettings { faults, ..settings }, &mut Session::new(node()));
    // The pictures differ by the camera's flicker alone.
    let right = |outcomes: &[Outcome]| outcomes.iter().filter(|outcome| is_right(outcome)).count();
    assert!(right(&lossy) + 1 >= right(&whole), "{whole:?} {lossy:?}");
}

#[test]
fn nothing_wrong_is_believed_of_a_bad_camera_and_each_trouble_is_said_once() {
    let faults = Faults { dropped: 0.1, frozen: 0.2, torn: 0.2, dark: 0.2, malformed: 0.1, gone_s: 5.0 };
    let settings = RobotSettings { n_episodes: 6, seed: 3, faults, ..RobotSettings::default() };
    let (outcomes, lines) = run(settings, &mut Session::new(node()));
    // A torn picture matches badly, so that a hole may stay unsure after ten touches.
    assert!(outcomes.iter().filter(|outcome| is_right(outcome)).count() >= 4, "{outcomes:?}");
    let wrong = |outcome: &&Outcome| outcome.stop == Some(StopReason::Confident) && !is_right(outcome);
    assert_eq!(outcomes.iter().filter(wrong).count(), 0, "{outcomes:?}");
    let n_said = |what: &str| lines.iter().filter(|line| line.contains(what)).count();
    for once in ["camera: no new picture for", "a new frame at rest is needed", "; first ~/calibrate_no_contact"] {
        assert_eq!(n_said(once), 1, "{once}: {lines:?}");
    }
    // A tenth of the hundreds of pictures is cut off: a line in ten seconds at most.
    assert!((1..=6).contains(&n_said("got the last")), "{lines:?}");
}

#[test]
fn a_contact_that_settles_is_a_trigger() {
    let (model, bank) = model_and_bank();
    let mut parameters = Parameters::default();
    parameters.trigger = tactile_live::parameters::Trigger::Contact;
    let mut session = Session::new(Node::new(parameters, model, bank).unwrap());
    let settings = RobotSettings { settle_s: 0.6, ..RobotSettings::default() };
    let (outcomes, _) = run(settings, &mut session);
    assert_eq!(outcomes.len(), 1);
}

/// A node whose touches are made by hand, of letter B, a picture each.
struct ByHand {
    session: Session,
    simulator: Simulator,
    n_pictures: u64,
    time_ns: i64,
}

impl ByHand {
    /// After its frame at rest.
    fn new(mut parameters: Parameters) -> Self {
        (parameters.camera.stills, parameters.camera.n_rest) = (true, 1);
        let (model, bank) = model_and_bank();
        let session = Session::new(Node::new(parameters, model, bank).unwrap());
        let simulator = Simulator::new(scene(), 1).unwrap();
        let mut hand = Self { session, simulator, n_pictures: 0, time_ns: 1_700_000_000_000_000_000 };
        hand.give(Input::Called { request: Request::Calibrate, id: 1 });
        let rest = hand.simulator.no_contact(1);
        hand.give(shown(&rest));
        hand
    }

    fn give(&mut self, input: Input) -> Vec<Output> {
        self.time_ns += 10_000_000;
        self.session.handle(&Event { time_ns: self.time_ns, input })
    }

    fn frame(&mut self) -> Frame {
        self.n_pictures += 1;
        let mut rng = frame_rng(7, self.n_pictures);
        self.simulator.touch(1, Side::Hole, &Se2::new(1.0, 0.0, 0.1), &mut rng).unwrap()
    }

    /// Gives what comes with a touch, its picture and the call, in the order of each source; the answer.
    fn touch(&mut self, inputs: impl IntoIterator<Item = Input>) -> Result<String, String> {
        let frame = self.frame();
        let mut outputs: Vec<Output> = inputs.into_iter().flat_map(|input| self.give(input)).collect();
        outputs.extend(self.give(shown(&frame)));
        outputs.extend(self.give(Input::Called { request: Request::Observe, id: 9 }));
        for _ in 0..200 {
            let answer = outputs.drain(..).find_map(|output| match output {
                Output::Answer { success, message, .. } => Some(if success { Ok(message) } else { Err(message) }),
                Output::Publish { .. } => None,
            });
            if let Some(answer) = answer {
                return answer;
            }
            outputs = self.give(Input::Tick);
        }
        panic!("no answer")
    }

    fn n_touches(&self) -> usize {
        self.session.node().episode().unwrap().belief().touches().len()
    }
}

fn shown(frame: &Frame) -> Input {
    Input::Given(Given::Image, to_cdr(&Image::of_frame(Header::default(), frame)))
}

#[test]
fn a_touch_is_refused_where_its_pose_was_refused_or_never_came() {
    let mut hand = ByHand::new(Parameters::default());
    assert!(hand.touch([]).unwrap_err().contains("got none"));
    hand.touch([placed(&Se2::IDENTITY)]).unwrap();
    // The node has asked for a motion.
    let said = hand.touch([]).unwrap_err();
    assert!(said.contains("a new one after the motion that was asked for"), "{said}");
    let pose = |x_m: f64, frame_id: &str| {
        let header = Header { frame_id: frame_id.into(), ..Header::default() };
        let pose = Pose { position: [x_m, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };
        Input::Given(Given::ToolPose, to_cdr(&PoseStamped { header, pose }))
    };
    for bad in [
        pose(f64::NAN, "plane"),
        pose(4e3, "plane"),
        pose(0.004, "tool0"),
        Input::Given(Given::ToolPose, vec![0, 1, 0, 0]),
    ] {
        // The motion was made and its pose was good, until a bad one came.
        for inputs in [vec![placed(&Se2::IDENTITY), bad], vec![]] {
            let said = hand.touch(inputs).unwrap_err();
            assert!(said.contains("a new one after one that was refused"), "{said}");
        }
        assert_eq!(hand.n_touches(), 1);
    }
    hand.touch([placed(&Se2::new(0.5, 0.0, 0.0))]).unwrap();
    assert_eq!(hand.n_touches(), 2);
    // Lines of commands, of which the first names no place that there is.
    let mut place = Place::default();
    for (line, is_good) in [("touch 1e300 0 0", false), ("touch", false), ("touch 1 0 0", true)] {
        let inputs = place.events(line.parse::<Command>().unwrap(), 5);
        let pose = inputs.into_iter().filter(|input| matches!(input, Input::Given(Given::ToolPose, _)));
        assert_eq!(hand.touch(pose).is_ok(), is_good, "{line}");
    }
    assert_eq!(hand.n_touches(), 3);
}

#[test]
fn a_touch_is_repeated_where_it_was_and_no_motion_was_asked_for() {
    let mut read = serde_json::Map::new();
    Parameters::set(&mut read, "episode.max_touches", "1").unwrap();
    let parameters = Parameters::of(read).unwrap();
    let mut hand = ByHand::new(parameters);
    hand.touch([placed(&Se2::IDENTITY)]).unwrap();
    for n in 2..4 {
        hand.touch([]).unwrap();
        assert_eq!(hand.n_touches(), n);
    }
}

#[test]
fn a_frame_at_rest_is_said_once_and_answered_each_time() {
    let mut hand = ByHand::new(Parameters::default());
    let mut outputs = Vec::new();
    for seed in 2..5 {
        hand.give(Input::Called { request: Request::Calibrate, id: seed });
        let rest = hand.simulator.no_contact(seed);
        outputs.extend(hand.give(shown(&rest)));
    }
    let n_answers = outputs.iter().filter(|output| matches!(output, Output::Answer { success: true, .. })).count();
    assert_eq!((n_answers, lines(&outputs)), (3, Vec::<String>::new()));
    // After a loss it is news.
    hand.give(Input::Cameras(1));
    let lost = hand.give(Input::Cameras(0));
    assert!(lines(&lost)[0].contains("a new frame at rest is needed"), "{lost:?}");
    hand.give(Input::Called { request: Request::Calibrate, id: 9 });
    let rest = hand.simulator.no_contact(9);
    let said = hand.give(shown(&rest));
    assert!(lines(&said)[0].starts_with("at rest: "), "{said:?}");
}

/// The lines for a person among some outputs.
fn lines(outputs: &[Output]) -> Vec<String> {
    let line = |spoken| match spoken {
        Spoken::Line(line) => Some(line),
        Spoken::Decision(_) => None,
    };
    spoken(outputs).into_iter().filter_map(line).collect()
}

#[test]
fn a_contact_without_a_pose_is_said_once_and_taken_in_when_its_pose_comes() {
    let parameters = Parameters { trigger: tactile_live::parameters::Trigger::Contact, ..Parameters::default() };
    let mut hand = ByHand::new(parameters);
    let press = |hand: &mut ByHand, n: usize| {
        let shown: Vec<_> = (0..n).flat_map(|_| [shown(&hand.frame()), Input::Tick]).collect();
        let outputs: Vec<_> = shown.into_iter().flat_map(|input| hand.give(input)).collect();
        lines(&outputs)
    };
    let said = press(&mut hand, 8);
    assert_eq!(said.iter().filter(|line| line.contains("no touch yet: tool pose")).count(), 1, "{said:?}");
    hand.give(placed(&Se2::IDENTITY));
    press(&mut hand, 2);
    assert_eq!(hand.n_touches(), 1);
}

#[test]
fn a_folder_that_is_gone_is_said_once() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = Folder::open(scratch.path()).unwrap();
    drop(scratch);
    let stop = AtomicBool::new(false);
    let mut said = Vec::new();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(700));
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        });
        folder::run(Session::new(node()), folder, false, &stop, &mut |spoken| said.push(spoken)).unwrap();
    });
    assert_eq!(said.len(), 1, "{said:?}");
}

#[test]
fn a_refused_touch_of_a_folder_gets_its_answer_and_what_cannot_be_written_costs_no_other() {
    let scratch = tempfile::tempdir().unwrap();
    let path = |name: &str| scratch.path().join(name);
    let parameters = Parameters { observe_timeout_s: Some(0.2), ..Parameters::default() };
    let mut hand = ByHand::new(parameters);
    write_png(&path("rest.png"), &hand.simulator.no_contact(1)).unwrap();
    let places = [
        ("ta", r#"{"x_mm": 0, "y_mm": 0, "theta_deg": 0}"#),
        ("tb", r#"{"x_mm": 4e8, "y_mm": 0, "theta_deg": 0}"#),
        ("tc", r#"{"x_mm": 0}"#),
        ("td", r#"{"x_mm": 0.5, "y_mm": 0, "theta_deg": 0}"#),
        ("te", r#"{"x_mm": 1.0, "y_mm": 0, "theta_deg": 0}"#),
    ];
    for (name, place) in places {
        write_png(&path(&format!("{name}.png")), &hand.frame()).unwrap();
        std::fs::write(path(&format!("{name}.json")), place).unwrap();
    }
    // In the place of the fourth answer something else is.
    std::fs::create_dir_all(path("td.decision.json.partial/in/the/way")).unwrap();
    let mut said = Vec::new();
    let folder = Folder::open(scratch.path()).unwrap();
    folder::run(hand.session, folder, true, &AtomicBool::new(false), &mut |spoken| said.push(spoken)).unwrap();
    let lines: Vec<_> = said.iter().map(|spoken| format!("{spoken:?}")).collect();
    let answer = |name: &str| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(path(&format!("{name}.decision.json"))).unwrap()).unwrap()
    };
    assert_eq!((&answer("ta")["touch"], &answer("te")["touch"]), (&1.into(), &3.into()), "{lines:?}");
    for (name, reason) in [("tb", "a position within 10 m"), ("tc", "tc.json")] {
        let answer = answer(name);
        assert!(answer["error"].as_str().unwrap().contains(reason), "{answer}");
    }
    assert!(!path("td.decision.json").exists());
    for name in ["td.decision.json", "tc.json"] {
        assert_eq!(lines.iter().filter(|line| line.contains(name)).count(), 1, "{lines:?}");
    }
}

#[test]
fn a_log_of_another_version_is_refused_before_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("old.mcap");
    let mut writer = BagWriter::new(&log, std::fs::File::create_new(&log).unwrap(), "test").unwrap();
    let channel = writer.channel_of("/tactile_filter/setup", Text::TYPE, "").unwrap();
    let data = r#"{"version": 1, "program": "tactile-live 0.0.9", "parameters": {"of_old": 1}}"#.to_owned();
    writer.write_numbered(channel, 1, 0, &to_cdr(&Text { data })).unwrap();
    writer.finish().unwrap();
    let said = replay::setup(&log).unwrap_err().to_string();
    assert!(said.contains("old.mcap: expected a log of version 4, got version 1"), "{said}");
    assert!(said.contains("tactile-live 0.0.9"), "{said}");
}

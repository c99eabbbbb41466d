//! The node: a pure step from an event to what is published.

mod diagnostics;

use std::sync::Arc;

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{Level, Text, Time, to_cdr};
use tactile_filter::{Episode, Observation, SensorMatch, StopReason};
use tactile_infer::{Bank, Model};

use crate::camera::{Arrival, Camera, ClockFault, Kind};
use crate::decision::{DecisionReport, Touched};
use crate::error::{Error, Result};
use crate::event::{Event, Given, Input, Output, Request, Topic};
use crate::parameters::{Parameters, Trigger};
use crate::published::Scene;
use crate::rest::{Calibrated, Collecting};
use crate::running::Running;
use crate::seen::SeenPart;
use crate::tool::{Placed, Tool};
use crate::troubles::{Trouble, Troubles};

/// Between two diagnostics, nanoseconds.
const DIAGNOSTICS_NS: i64 = 1_000_000_000;

/// A touch may take so long to be observed, seconds.
const OBSERVE_TIMEOUT_S: f64 = 1.0;

/// Pictures at rest may take so long, seconds.
const REST_TIMEOUT_S: f64 = 10.0;

/// So many holes in a row that are none of the parts are reported: one that is there is refused once in fifty at most.
const MANY_STRANGERS: u32 = 3;

/// Fewer pictures than this share of the expected rate are reported.
const LEAST_RATE: f64 = 0.75;

/// The node's state. [`Node::step`] is all that changes it; it asks no clock and draws no random number but the filter's,
/// whose seed is a parameter.
#[derive(Clone, Debug)]
pub struct Node {
    parameters: Parameters,
    model: Arc<Model>,
    bank: Arc<Bank>,
    reach: PoseGrid,
    now_ns: i64,
    camera: Camera,
    tool: Tool,
    calibrated: Option<Box<Calibrated>>,
    /// Why the frame at rest is of no use any more.
    rest_needed: Option<String>,
    collecting: Option<Collecting>,
    pending: Option<Pending>,
    running: Option<Running>,
    /// Where the hole that is touched next was seen.
    seen: Option<SeenPart>,
    n_episodes: u64,
    /// What the holes before have told of the sensor.
    sensor: SensorMatch,
    /// Entropy (nats) and probability of the likeliest part after the latest touch.
    latest: Option<[f64; 2]>,
    n_refused: u64,
    /// Holes in a row that were none of these parts.
    n_strangers: u32,
    n_cameras: Option<u32>,
    troubles: Troubles,
    diagnosed_ns: Option<i64>,
    outputs: Vec<Output>,
}

/// A touch that was asked for.
#[derive(Clone, Debug)]
struct Pending {
    id: u64,
    since_ns: i64,
    /// Why it was not taken in yet.
    reason: String,
}

impl Node {
    /// A node that has seen nothing yet.
    ///
    /// # Errors
    /// Parameters out of range, a bank of another model.
    pub fn new(parameters: Parameters, model: Arc<Model>, bank: Arc<Bank>) -> Result<Self> {
        parameters.validate()?;
        parameters.episode_config(&model, 0)?.validate()?;
        if bank.model_sha256() != model.sha256() {
            let [expected, got] =
                [model.sha256(), bank.model_sha256()].map(|sha256| format!("one of model {sha256:.12}"));
            return Err(Error::invalid("bank", expected, got));
        }
        let collecting = parameters.rest_at_start.then(|| Collecting::new(0, i64::MAX));
        Ok(Self {
            reach: parameters.reach(bank.start())?,
            now_ns: i64::MIN,
            camera: Camera::new(&parameters.camera),
            tool: Tool::new(&parameters.tool)?,
            calibrated: None,
            rest_needed: Some("no frame at rest was taken yet".to_owned()),
            collecting,
            pending: None,
            running: None,
            seen: None,
            n_episodes: 0,
            sensor: SensorMatch::default(),
            latest: None,
            n_refused: 0,
            n_strangers: 0,
            n_cameras: None,
            troubles: Troubles::default(),
            diagnosed_ns: None,
            outputs: Vec::new(),
            parameters,
            model,
            bank,
        })
    }

    /// Takes in an event; what is to be published and answered, in order. Nothing that comes is an error: what is of no
    /// use is reported.
    pub fn step(&mut self, event: &Event) -> Vec<Output> {
        self.now_ns = self.now_ns.max(event.time_ns);
        match &event.input {
            Input::Given(Given::Image, cdr) => self.on_picture(|camera, now_ns| camera.image(now_ns, cdr)),
            Input::Given(Given::CompressedImage, cdr) => {
                self.on_picture(|camera, now_ns| camera.compressed(now_ns, cdr));
            }
            Input::Given(Given::ToolPose, cdr) => self.on_pose(cdr),
            Input::Given(Given::PartPose, cdr) => self.on_part(cdr),
            Input::Called { request, id } => self.on_request(*request, *id),
            Input::Cameras(n) => self.on_cameras(*n),
            Input::Tick => self.on_tick(),
        }
        std::mem::take(&mut self.outputs)
    }

    /// The running episode.
    pub fn episode(&self) -> Option<&Episode> {
        self.running.as_ref().map(|running| &running.episode)
    }

    fn n_touches(&self) -> usize {
        self.episode().map_or(0, |episode| episode.belief().touches().len())
    }

    fn publish(&mut self, topic: Topic, cdr: Vec<u8>) {
        self.outputs.push(Output::Publish { topic, cdr });
    }

    fn answer(&mut self, id: u64, success: bool, message: impl Into<String>) {
        // Nobody waits for the answer to what the node did by itself.
        if id != 0 {
            self.outputs.push(Output::Answer { id, success, message: message.into() });
        }
    }

    fn say(&mut self, text: impl Into<String>) {
        self.publish(Topic::Events, to_cdr(&Text { data: text.into() }));
    }

    fn raise(&mut self, trouble: Trouble, level: Level, text: String) {
        if let Some(line) = self.troubles.raise(self.now_ns, trouble, level, text) {
            self.say(line);
        }
    }

    fn clear(&mut self, trouble: Trouble) {
        self.troubles.clear(trouble);
    }

    fn on_picture(&mut self, take: impl FnOnce(&mut Camera, i64) -> Result<(Kind, Option<ClockFault>)>) {
        let gap_s = self.camera.age_s(self.now_ns);
        match take(&mut self.camera, self.now_ns) {
            Err(error) => self.raise(Trouble::MalformedPicture, Level::Error, error.to_string()),
            Ok((Kind::Repeated(n), _)) => {
                let age_s = gap_s.unwrap_or(0.0);
                if age_s > self.parameters.camera.max_age_s {
                    let text = format!("camera: one picture for {age_s:.1} s, {} times: it has stopped", n + 1);
                    self.raise(Trouble::Frozen, Level::Error, text);
                }
            }
            Ok((Kind::New, fault)) => self.on_new_picture(gap_s, fault),
        }
    }

    fn on_new_picture(&mut self, gap_s: Option<f64>, fault: Option<ClockFault>) {
        for trouble in [Trouble::MalformedPicture, Trouble::Frozen, Trouble::NoPictures] {
            self.clear(trouble);
        }
        if let Some(gap_s) = gap_s.filter(|gap_s| *gap_s > self.parameters.camera.reconnect_s) {
            self.lose_rest(format!("the camera was gone for {gap_s:.1} s"));
        }
        match fault {
            Some(ClockFault::WentBack(s)) => {
                let text = format!("camera: its clock went back by {s:.3} s; pictures are dated by their arrival");
                self.raise(Trouble::Clock, Level::Warn, text);
            }
            Some(ClockFault::Differs(s)) => {
                let text = format!(
                    "camera: its clock is {s:.1} s behind this machine's, or its pictures are that old; where both \
                     clocks are set alike, camera.clock: shared refuses old ones"
                );
                self.raise(Trouble::Clock, Level::Warn, text);
            }
            None => self.clear(Trouble::Clock),
        }
        let newest = self.camera.newest();
        match newest.and_then(|newest| newest.guess.clone()) {
            Some(guess) => self.raise(Trouble::Encoding, Level::Warn, guess),
            None => self.clear(Trouble::Encoding),
        }
        if self.collecting.is_some() {
            self.collect();
        }
        if self.parameters.trigger == Trigger::Contact && self.pending.is_none() {
            self.watch_contact();
        }
        self.try_pending();
    }

    /// The frame at rest is of no use any more.
    fn lose_rest(&mut self, reason: String) {
        if self.calibrated.is_some() && self.rest_needed.is_none() {
            self.say(format!("{reason}: a new frame at rest is needed ({})", Request::Calibrate.name()));
        }
        if self.calibrated.is_some() || self.rest_needed.is_none() {
            self.rest_needed = Some(reason);
        }
    }

    /// Adds the newest picture to those at rest.
    fn collect(&mut self) {
        let Some(decoded) = self.camera.newest().map(Arrival::decode) else { return };
        let Some(collecting) = &mut self.collecting else { return };
        let n_rest = self.parameters.camera.n_rest;
        let pictures = match decoded {
            Ok(picture) => collecting.push(picture, n_rest),
            Err(error) => {
                collecting.setback = Some(error.to_string());
                None
            }
        };
        let (Some(pictures), id) = (pictures, collecting.id) else { return };
        self.collecting = None;
        let mut warnings = Vec::new();
        let made = Calibrated::new(&pictures, &self.parameters.camera, &self.model, &self.bank, &mut warnings);
        match made.and_then(|made| made.after(self.calibrated.as_deref())) {
            Ok(calibrated) => {
                let [width, height] = calibrated.frame_px();
                self.calibrated = Some(Box::new(calibrated.of_side(self.parameters.side)));
                let line = format!("at rest: {width}x{height} pixels, the median of {n_rest} pictures");
                warnings.into_iter().for_each(|warning| self.say(warning));
                // Who asks again is answered again; a person reads it once.
                if self.rest_needed.take().is_some() {
                    self.say(line.clone());
                }
                self.answer(id, true, line);
            }
            Err(error) => {
                let line = format!("no frame at rest: {error}");
                self.say(line.clone());
                self.answer(id, false, line);
            }
        }
    }

    /// Looks for a settled contact in the newest picture.
    fn watch_contact(&mut self) {
        if self.rest_needed.is_some() {
            return;
        }
        let Some(mut calibrated) = self.calibrated.take() else { return };
        let frames = self.two_frames(&calibrated, i64::MIN);
        let settles = frames.and_then(|[before, newest]| calibrated.settles([&before, &newest]));
        // What is wrong with a picture is said where a touch needs it.
        if settles.unwrap_or(false) {
            match self.tool.placed(self.now_ns) {
                Ok(_) => {
                    calibrated.watch.observed();
                    self.pending = Some(Pending { id: 0, since_ns: self.now_ns, reason: String::new() });
                }
                Err(error) => {
                    let text = format!("a contact has settled that is no touch yet: {error}");
                    self.raise(Trouble::NoPose, Level::Warn, text);
                }
            }
        }
        self.calibrated = Some(calibrated);
    }

    fn on_pose(&mut self, cdr: &[u8]) {
        match self.tool.moved(self.now_ns, cdr) {
            Ok(()) => [Trouble::MalformedPose, Trouble::NoPose].into_iter().for_each(|trouble| self.clear(trouble)),
            Err(error) => self.raise(Trouble::MalformedPose, Level::Error, error.to_string()),
        }
    }

    fn on_part(&mut self, cdr: &[u8]) {
        match SeenPart::of(cdr) {
            Ok(seen) => {
                self.seen = Some(seen);
                self.clear(Trouble::PartPose);
            }
            Err(error) => {
                self.seen = None;
                self.raise(Trouble::PartPose, Level::Error, error.to_string());
            }
        }
    }

    fn on_cameras(&mut self, n: u32) {
        let before = self.n_cameras.replace(n);
        match (before, n) {
            (Some(1..), 0) => {
                self.camera.forget();
                self.lose_rest("the camera's publisher went away".to_owned());
            }
            (Some(0 | 1) | None, 2..) => {
                self.say(format!("{n} publishers send pictures on one topic: remap it for each sensor"));
            }
            _ => {}
        }
    }

    fn on_request(&mut self, request: Request, id: u64) {
        match request {
            Request::Reset => {
                let n_touches = self.n_touches();
                if let Some(Running { episode, .. }) = self.running.take() {
                    if self.parameters.learn_sensor {
                        self.sensor = episode.learn();
                    }
                    self.count_strangers(episode.stop_reason());
                }
                (self.latest, self.seen) = (None, None);
                self.learn_light();
                self.tool.reset();
                if let Some(pending) = self.pending.take() {
                    self.answer(pending.id, false, "reset");
                }
                self.answer(id, true, format!("the next touch is the first of another hole; this one had {n_touches}"));
            }
            Request::Calibrate => {
                if let Some(before) = self.collecting.replace(Collecting::new(id, self.now_ns)) {
                    self.answer(before.id, false, "asked again");
                }
            }
            Request::Observe => {
                if self.pending.as_ref().is_some_and(|pending| pending.id != 0) {
                    return self.answer(id, false, "a touch is being observed");
                }
                self.pending = Some(Pending { id, since_ns: self.now_ns, reason: "no picture came since".to_owned() });
                self.try_pending();
            }
        }
    }

    /// Says where hole after hole is none of these parts: a sensor that nobody simulated looks so.
    fn count_strangers(&mut self, stop: Option<StopReason>) {
        self.n_strangers = if stop == Some(StopReason::NoneOfThese) { self.n_strangers.saturating_add(1) } else { 0 };
        if self.n_strangers < MANY_STRANGERS {
            return self.clear(Trouble::Refused);
        }
        let text = format!(
            "{MANY_STRANGERS} holes in a row are none of these parts: if that is wrong, measure the sensor's lamps, or \
             calibrate by touches of known parts"
        );
        self.raise(Trouble::Refused, Level::Warn, text);
    }

    /// Learns the sensor's lamps of the touches so far, where there are enough.
    fn learn_light(&mut self) {
        match self.calibrated.as_mut().map_or(Ok(None), |calibrated| calibrated.learn_light()) {
            Ok(Some(found)) => {
                // Its touches will match otherwise.
                self.sensor = SensorMatch::default();
                self.say(format!("light: {}", found.line()));
            }
            Ok(None) => {}
            Err(error) => self.say(format!("light: {error}")),
        }
    }

    fn on_tick(&mut self) {
        let timeout_s = self.parameters.observe_timeout_s.unwrap_or(OBSERVE_TIMEOUT_S);
        let now_ns = self.now_ns;
        let is_over = |since_ns: i64, s: f64| now_ns.saturating_sub(since_ns) as f64 * 1e-9 > s;
        if let Some(pending) = self.pending.take_if(|pending| is_over(pending.since_ns, timeout_s)) {
            self.n_refused += 1;
            let line = format!("no touch was observed: {}", pending.reason);
            self.say(line.clone());
            self.answer(pending.id, false, line);
        }
        let rest_is_late = |collecting: &mut Collecting| is_over(collecting.since_ns, REST_TIMEOUT_S);
        if let Some(collecting) = self.collecting.take_if(rest_is_late) {
            let reason = collecting.setback.unwrap_or_else(|| "too few pictures came".to_owned());
            self.answer(collecting.id, false, format!("no frame at rest: {reason}"));
        }
        self.check_camera();
        if self.diagnosed_ns.is_none_or(|diagnosed_ns| self.now_ns - diagnosed_ns >= DIAGNOSTICS_NS) {
            self.diagnosed_ns = Some(self.now_ns);
            self.publish(Topic::Diagnostics, to_cdr(&self.diagnostics()));
        }
    }

    fn check_camera(&mut self) {
        let camera = &self.parameters.camera;
        let (max_age_s, asked) = (camera.max_age_s, camera.rate_hz);
        let counts = self.camera.counts();
        if let Some(age_s) = self.camera.age_s(self.now_ns).filter(|age_s| *age_s > max_age_s.max(1.0)) {
            self.raise(Trouble::NoPictures, Level::Error, format!("camera: no new picture for {age_s:.1} s"));
        }
        match (asked, self.camera.rate_hz()) {
            (Some(asked), Some(rate)) if rate < LEAST_RATE * asked && counts.new > 20 => {
                let text = format!("camera: {rate:.1} pictures a second, expected {asked}");
                self.raise(Trouble::Rate, Level::Warn, text);
            }
            _ => self.clear(Trouble::Rate),
        }
    }

    /// Takes in the touch that was asked for, where that can be done now.
    fn try_pending(&mut self) {
        let Some(Pending { id, .. }) = self.pending else { return };
        // Waiting brings no frame at rest.
        if let (Some(reason), None) = (&self.rest_needed, &self.collecting) {
            let line = format!("no touch was observed: {reason}; first {}", Request::Calibrate.name());
            self.pending = None;
            self.n_refused += 1;
            self.say(line.clone());
            return self.answer(id, false, line);
        }
        match self.touch() {
            Ok(line) => {
                self.pending = None;
                self.answer(id, true, line);
            }
            Err(error) => {
                if let Some(pending) = &mut self.pending {
                    pending.reason = error.to_string();
                }
            }
        }
    }

    /// The newest two pictures taken after a time, as the sensor sees them.
    fn two_frames(&self, calibrated: &Calibrated, since_ns: i64) -> Result<[tactile_data::frame::Frame; 2]> {
        let [before, newest] = self.camera.pair_since(since_ns, self.now_ns)?;
        Ok([calibrated.frame(&before.decode()?)?, calibrated.frame(&newest.decode()?)?])
    }

    /// Observes, updates and decides; after an error everything is as before.
    fn touch(&mut self) -> Result<String> {
        if let Some(reason) = &self.rest_needed {
            let expected = format!("a frame at rest ({})", Request::Calibrate.name());
            return Err(Error::invalid("sensor", expected, reason.clone()));
        }
        let Some(calibrated) = &self.calibrated else {
            return Err(Error::invalid("sensor", "a frame at rest", "none"));
        };
        let placed = self.tool.placed(self.now_ns)?;
        let [before, newest] = self.two_frames(calibrated, placed.still_since_ns)?;
        let observation = calibrated.observe([&before, &newest])?;
        let moved = self.take_in(&placed, &observation)?;
        if let Some(calibrated) = &mut self.calibrated {
            calibrated.felt(&newest)?;
        }
        let report = self.decide(moved, observation.edge_share, &placed)?;
        Ok(report.line())
    }

    /// Updates the episode, or begins one; the motion since the touch before.
    fn take_in(&mut self, placed: &Placed, observation: &Observation) -> Result<Option<Se2>> {
        let base_from_sensor = placed.base_from_sensor;
        if let Some(running) = &mut self.running {
            return running.observe(base_from_sensor, self.parameters.tool.max_tilt_deg, observation).map(Some);
        }
        let config = self.parameters.episode_config(&self.model, self.n_episodes)?.with_sensor(self.sensor);
        let max_tilt_deg = self.parameters.tool.max_tilt_deg;
        let start = self.seen.as_ref().map(|seen| seen.start(placed, max_tilt_deg)).transpose()?;
        let config = start.map_or(config, |start| config.with_start(start));
        let episode = Episode::begin(config, Arc::clone(&self.bank), observation)?;
        self.seen = None;
        self.n_episodes += 1;
        self.running = Some(Running { episode, base_from_first: base_from_sensor, base_from_sensor });
        Ok(None)
    }

    fn decide(&mut self, moved: Option<Se2>, edge_share: f32, placed: &Placed) -> Result<DecisionReport> {
        let Some(running) = &self.running else { return Err(Error::invalid("episode", "a touch", "none")) };
        let episode = &running.episode;
        let decision = running.decide(&self.reach)?;
        let touched = Touched { episode: self.n_episodes, moved, edge_share };
        let report = DecisionReport::new(&touched, &self.bank, episode, &decision);
        let scene = Scene {
            time: Time::of_nanoseconds(self.now_ns),
            base: &placed.frame_id,
            frames: &self.parameters.frames,
            base_from_first: running.base_from_first,
            base_from_sensor: running.base_from_sensor,
            base_from_tool: &|goal| self.tool.base_from_tool(goal),
            episode,
            report: &report,
        };
        let outputs = scene.outputs()?;
        self.latest = Some([report.estimate.entropy_nats, report.estimate.probability]);
        self.outputs.extend(outputs);
        self.tool.touched(&placed.frame_id, report.next.is_some());
        Ok(report)
    }
}

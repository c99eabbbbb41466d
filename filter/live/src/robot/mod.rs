//! A simulated robot with its sensor over a hole, to try the node with: another process on the same topics, or another
//! value in the node's process. It knows the truth and says it to nobody but its owner.
//!
//! Like the node it is a pure step: what it receives, at what time, to what it sends.

mod camera;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::StandardNormal;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{Header, PoseStamped, PoseWithCovarianceStamped, Time, from_cdr, to_cdr};
use tactile_data::recording::ros::rigid::Rigid;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::StopReason;

pub use camera::Faults;
use camera::{Camera, Shows};

use crate::decision::DecisionReport;
use crate::error::Result;
use crate::event::{Given, Request};

/// Where the part is in the robot's base frame: metres, and roll, pitch and yaw in radians. The sensor looks down.
const BASE_FROM_PART: [[f64; 3]; 2] = [[0.42, -0.13, 0.08], [std::f64::consts::PI, 0.0, 0.4]];

/// How far the sensor is lifted between touches, metres.
const LIFT_M: f64 = 0.01;

/// Marks the errors of the camera that sees parts among what is drawn of a seed.
const CAMERA: u64 = 0x6361_6d65_7261;

/// Between two poses of the tool, nanoseconds: 50 a second.
const POSE_NS: i64 = 20_000_000;

/// A service that does not answer is called again after this, nanoseconds.
const PATIENCE_NS: i64 = 15_000_000_000;

/// How the robot moves and what goes wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSettings {
    /// Seed of holes, poses and pictures: those of `tactile-filter evaluate` of this seed.
    pub seed: u64,
    /// Holes to identify, one after the other.
    pub n_episodes: usize,
    /// Which side it touches: with `Peg` the holes are pegs.
    pub side: Side,
    /// Pictures a second.
    pub rate_hz: f64,
    /// JPEG quality of the pictures, 1 to 100; `None` sends pixels.
    pub jpeg: Option<u8>,
    /// A motion misses its goal by up to this along x and y, mm.
    pub motion_error_mm: f64,
    /// The same for the angle, degrees.
    pub motion_error_deg: f64,
    /// A camera sees each part before it is touched, off by a normal error of these standard deviations: mm along x and along y, and
    /// degrees; `None`: no camera does.
    pub part_seen_to: Option<[f64; 2]>,
    /// Seconds of a motion.
    pub travel_s: f64,
    /// Seconds until a contact has settled.
    pub settle_s: f64,
    /// What goes wrong with the pictures.
    pub faults: Faults,
}

impl Default for RobotSettings {
    fn default() -> Self {
        Self {
            seed: 1,
            n_episodes: 1,
            side: Side::Hole,
            rate_hz: 25.0,
            jpeg: None,
            motion_error_mm: 0.1,
            motion_error_deg: 0.3,
            part_seen_to: None,
            travel_s: 0.4,
            settle_s: 0.24,
            faults: Faults::default(),
        }
    }
}

/// What the robot receives.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A message on `~/next_pose`, in CDR.
    NextPose(Vec<u8>),
    /// A message on `~/decision`, in CDR.
    Decision(Vec<u8>),
    /// The answer to a call.
    Answer {
        /// Whether it was done.
        success: bool,
        /// What was done, or why not.
        message: String,
    },
    /// Time went by.
    Tick,
}

/// What the robot sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Sent {
    /// A message to the node.
    Given(Given, Vec<u8>),
    /// A service is called.
    Call(Request),
    /// A line for a person.
    Say(String),
}

/// What became of a hole.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The hole's part.
    pub part: String,
    /// The part that was named likeliest after each touch.
    pub named: Vec<String>,
    /// Why it ended.
    pub stop: Option<StopReason>,
    /// Distance of the sensor's true place at the end from the estimated one, mm.
    pub off_mm: f64,
    /// Calls of `~/observe` that were refused.
    pub n_refused: usize,
}

/// The robot.
pub struct Robot {
    settings: RobotSettings,
    simulator: Simulator,
    base_from_part: Rigid,
    reach: tactile_data::pose::grid::PoseGrid,
    camera: Camera,
    hole: Hole,
    phase: Phase,
    posed_ns: Option<i64>,
    base_from_tool: Rigid,
    goal: Option<Rigid>,
    decision: Option<DecisionReport>,
    outcomes: Vec<Outcome>,
}

/// The hole under the sensor.
struct Hole {
    part: usize,
    part_from_sensor: Se2,
    stream: u64,
    rng: ChaCha8Rng,
    named: Vec<String>,
    n_refused: usize,
}

/// What the robot does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Stands over the board, lifted, until then.
    Begin { until_ns: i64 },
    /// Waits for an answer, until then.
    Waits { request: Request, until_ns: i64 },
    /// Moves above the board, until then.
    Travels { until_ns: i64 },
    /// Presses, until the contact has settled.
    Settles { until_ns: i64 },
    /// Has been answered, and waits for the decision.
    AwaitsDecision { until_ns: i64 },
    /// All holes are done.
    Ends,
}

impl Robot {
    /// A robot over the holes of a scene; `board_seed` draws what of the scene is drawn.
    ///
    /// # Errors
    /// A scene that cannot be touched, or has no reach.
    pub fn new(settings: RobotSettings, simulator: Simulator) -> Result<Self> {
        let [xyz_m, rpy_rad] = BASE_FROM_PART;
        let scene = simulator.scene();
        let Some(reach) = scene.reach else {
            let expected = "a reach: the poses at which each peg is touched";
            return Err(crate::Error::invalid(scene.name.clone(), expected, "none"));
        };
        let rest = simulator.no_contact(settings.seed ^ 0x686f_6c65);
        let mut robot = Self {
            base_from_part: Rigid::from_xyz_rpy(xyz_m, rpy_rad, "part")?,
            reach,
            camera: Camera::new(rest, &settings),
            hole: Hole::draw(&simulator, &reach, settings.seed, 0),
            phase: Phase::Begin { until_ns: i64::MIN },
            posed_ns: None,
            base_from_tool: Rigid::IDENTITY,
            goal: None,
            decision: None,
            outcomes: Vec::new(),
            simulator,
            settings,
        };
        robot.base_from_tool = robot.tool_over(&robot.hole.part_from_sensor, LIFT_M);
        Ok(robot)
    }

    /// Takes in what is heard; what is sent, in order.
    ///
    /// # Errors
    /// A hole that cannot be touched.
    pub fn step(&mut self, time_ns: i64, heard: &Heard) -> Result<Vec<Sent>> {
        let mut sent = Vec::new();
        match heard {
            Heard::NextPose(cdr) => {
                self.goal = from_cdr::<PoseStamped>(cdr, "next pose")
                    .and_then(|message| Rigid::from_pose(&message.pose, "next pose"))
                    .ok();
            }
            Heard::Decision(cdr) => self.decision = read_decision(cdr),
            Heard::Answer { success, message } => self.answered(time_ns, *success, message, &mut sent)?,
            Heard::Tick => self.tick(time_ns, &mut sent)?,
        }
        if matches!(self.phase, Phase::AwaitsDecision { .. }) {
            self.decided(time_ns, &mut sent)?;
        }
        Ok(sent)
    }

    /// Whether all holes are done.
    pub fn is_finished(&self) -> bool {
        self.phase == Phase::Ends
    }

    /// Holes to identify.
    pub fn n_episodes(&self) -> usize {
        self.settings.n_episodes
    }

    /// What became of the holes so far.
    pub fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    /// Where the sensor truly is on the part, for whoever draws the scene.
    pub fn part_from_sensor(&self) -> Se2 {
        self.hole.part_from_sensor
    }

    fn tool_over(&self, part_from_sensor: &Se2, lift_m: f64) -> Rigid {
        self.base_from_part * Rigid::from_shift([0.0, 0.0, -lift_m]) * Rigid::from_plane(part_from_sensor)
    }

    fn tick(&mut self, time_ns: i64, sent: &mut Vec<Sent>) -> Result<()> {
        match self.phase {
            Phase::Begin { until_ns: i64::MIN } => self.phase = Phase::Begin { until_ns: time_ns + 500_000_000 },
            Phase::Begin { until_ns } if time_ns >= until_ns => self.call(Request::Calibrate, time_ns, sent),
            Phase::Waits { request, until_ns } if time_ns >= until_ns => {
                sent.push(Sent::Say(format!("no answer to {}: called again", request.name())));
                self.call(request, time_ns, sent);
            }
            Phase::AwaitsDecision { until_ns } if time_ns >= until_ns => {
                sent.push(Sent::Say("no decision came: observed again".to_owned()));
                self.call(Request::Observe, time_ns, sent);
            }
            Phase::Travels { until_ns } if time_ns >= until_ns => self.press(time_ns)?,
            Phase::Settles { until_ns } if time_ns >= until_ns => {
                self.camera.settles(1.0);
                self.call(Request::Observe, time_ns, sent);
            }
            Phase::Settles { until_ns } => {
                // In the first half the gel gives way; in the second nothing changes any more, and the robot is sure.
                let left = (until_ns - time_ns) as f64 * 1e-9 / self.settings.settle_s;
                self.camera.settles(2.0 * (1.0 - left));
            }
            _ => {}
        }
        if self.posed_ns.is_none_or(|posed_ns| time_ns - posed_ns >= POSE_NS) {
            self.posed_ns = Some(time_ns);
            let header = Header { stamp: Time::of_nanoseconds(time_ns), frame_id: "base_link".into() };
            sent.push(Sent::Given(
                Given::ToolPose,
                to_cdr(&PoseStamped { header, pose: self.base_from_tool.to_pose() }),
            ));
        }
        sent.extend(self.camera.picture(time_ns)?);
        Ok(())
    }

    fn call(&mut self, request: Request, time_ns: i64, sent: &mut Vec<Sent>) {
        self.phase = Phase::Waits { request, until_ns: time_ns + PATIENCE_NS };
        if request == Request::Observe {
            (self.goal, self.decision) = (None, None);
        }
        sent.push(Sent::Call(request));
    }

    fn answered(&mut self, time_ns: i64, success: bool, message: &str, sent: &mut Vec<Sent>) -> Result<()> {
        let Phase::Waits { request, .. } = self.phase else { return Ok(()) };
        match (request, success) {
            // The node may still be at a hole of a robot that was here before.
            (Request::Calibrate, true) if self.hole.named.is_empty() => self.call(Request::Reset, time_ns, sent),
            (Request::Calibrate | Request::Reset, true) => {
                sent.extend(self.seen(time_ns));
                self.travel(time_ns);
            }
            (Request::Calibrate | Request::Reset, false) => {
                sent.push(Sent::Say(format!("{}: {message}", request.name())));
                self.lift(time_ns);
            }
            (Request::Observe, true) => self.phase = Phase::AwaitsDecision { until_ns: time_ns + PATIENCE_NS },
            (Request::Observe, false) => {
                self.hole.n_refused += 1;
                if message.contains(Request::Calibrate.name()) {
                    self.lift(time_ns);
                } else {
                    self.call(Request::Observe, time_ns, sent);
                }
            }
        }
        Ok(())
    }

    /// What a camera sees of a hole that was not touched yet: the part's pose, off by a normal error.
    fn seen(&self, time_ns: i64) -> Option<Sent> {
        let [mm, deg] = self.settings.part_seen_to.filter(|_| self.hole.named.is_empty())?;
        let mut rng = frame_rng(self.settings.seed ^ CAMERA, self.hole.stream);
        let mut off = |sd: f64| -> f64 { sd * rng.sample::<f64, _>(StandardNormal) };
        let part_from_seen = Se2::from_degrees(off(mm), off(mm), off(deg));
        let mut covariance = [0.0; 36];
        // Along the base's x and y, and about its z: it is level with the board.
        [(0, mm * 1e-3), (1, mm * 1e-3), (5, deg.to_radians())]
            .into_iter()
            .for_each(|(at, sd)| covariance[7 * at] = sd * sd);
        let header = Header { stamp: Time::of_nanoseconds(time_ns), frame_id: "base_link".into() };
        let pose = (self.base_from_part * Rigid::from_plane(&part_from_seen)).to_pose();
        Some(Sent::Given(Given::PartPose, to_cdr(&PoseWithCovarianceStamped { header, pose, covariance })))
    }

    /// Lifts the sensor, to take pictures of it at rest.
    fn lift(&mut self, time_ns: i64) {
        self.camera.show(Shows::Rest);
        self.base_from_tool = self.tool_over(&self.hole.part_from_sensor, LIFT_M);
        self.phase = Phase::Begin { until_ns: time_ns + 500_000_000 };
    }

    /// Moves above the place that is to be touched.
    fn travel(&mut self, time_ns: i64) {
        self.camera.show(Shows::Rest);
        self.base_from_tool = self.tool_over(&self.hole.part_from_sensor, LIFT_M);
        self.phase = Phase::Travels { until_ns: time_ns + (self.settings.travel_s * 1e9) as i64 };
    }

    fn press(&mut self, time_ns: i64) -> Result<()> {
        self.base_from_tool = self.tool_over(&self.hole.part_from_sensor, 0.0);
        let frame = self.hole.touch(&self.simulator, &self.settings)?;
        self.camera.show(Shows::Touch(frame));
        self.phase = Phase::Settles { until_ns: time_ns + (self.settings.settle_s * 1e9) as i64 };
        Ok(())
    }

    /// Goes on as the node decided, once all of it was heard.
    fn decided(&mut self, time_ns: i64, sent: &mut Vec<Sent>) -> Result<()> {
        let Some(decision) = &self.decision else { return Ok(()) };
        if decision.next.is_some() {
            let Some(goal) = self.goal.take() else { return Ok(()) };
            self.hole.named.push(decision.estimate.part.clone());
            self.decision = None;
            let part_from_goal = (self.base_from_part.inverse() * goal).project().pose;
            self.hole.part_from_sensor = part_from_goal * self.hole.slip(&self.settings);
            self.travel(time_ns);
            return Ok(());
        }
        self.finish_hole(time_ns, sent);
        Ok(())
    }

    fn finish_hole(&mut self, time_ns: i64, sent: &mut Vec<Sent>) {
        let Some(decision) = self.decision.take() else { return };
        self.hole.named.push(decision.estimate.part.clone());
        let outcome = Outcome {
            part: self.simulator.parts()[self.hole.part].clone(),
            named: std::mem::take(&mut self.hole.named),
            stop: decision.stop,
            off_mm: decision.estimate.part_from_sensor.distance_mm(&self.hole.part_from_sensor),
            n_refused: self.hole.n_refused,
        };
        let Outcome { part, off_mm, .. } = &outcome;
        sent.push(Sent::Say(format!("the robot says: it was {part}, and its place was {off_mm:.2} mm off")));
        self.outcomes.push(outcome);
        if self.outcomes.len() >= self.settings.n_episodes {
            self.phase = Phase::Ends;
            return;
        }
        self.hole = Hole::draw(&self.simulator, &self.reach, self.settings.seed, self.outcomes.len());
        self.camera.show(Shows::Rest);
        self.base_from_tool = self.tool_over(&self.hole.part_from_sensor, LIFT_M);
        self.call(Request::Reset, time_ns, sent);
    }
}

fn read_decision(cdr: &[u8]) -> Option<DecisionReport> {
    let text: tactile_data::recording::ros::messages::Text = from_cdr(cdr, "decision").ok()?;
    serde_json::from_str(&text.data).ok()
}

impl Hole {
    /// The hole of an episode as an evaluation of this seed draws it: part and pose anywhere in the recorded range.
    fn draw(simulator: &Simulator, reach: &tactile_data::pose::grid::PoseGrid, seed: u64, episode: usize) -> Self {
        let stream = (episode as u64 + 1) << 20;
        let mut rng = frame_rng(seed ^ HOLES, stream);
        let part = rng.random_range(0..simulator.parts().len());
        let part_from_sensor = reach.draw(&mut rng);
        // The robot's own draws are no evaluation's.
        let rng = frame_rng(seed ^ SLIPS, stream);
        Self { part, part_from_sensor, stream, rng, named: Vec::new(), n_refused: 0 }
    }

    fn touch(&mut self, simulator: &Simulator, settings: &RobotSettings) -> Result<Frame> {
        self.stream += 1;
        let mut rng = frame_rng(settings.seed ^ HOLES, self.stream);
        Ok(simulator.touch(self.part, settings.side, &self.part_from_sensor, &mut rng)?)
    }

    /// By how much a motion misses its goal.
    fn slip(&mut self, settings: &RobotSettings) -> Se2 {
        let mut around = |half: f64| half * (2.0 * self.rng.random::<f64>() - 1.0);
        let (mm, deg) = (settings.motion_error_mm, settings.motion_error_deg);
        Se2::from_degrees(around(mm), around(mm), around(deg))
    }
}

/// What sets an evaluation's holes apart from a dataset's of the same seed.
const HOLES: u64 = 0x686f_6c65;

/// What sets the robot's own draws apart.
const SLIPS: u64 = 0x736c_6970;

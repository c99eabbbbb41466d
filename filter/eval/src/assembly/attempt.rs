//! What a robot is to do in an assembly, and what happened at one hole.

use tactile_filter::StopReason;

/// How often the task is done, and how well the robot holds its pegs.
#[derive(Clone, Debug)]
pub struct Task {
    /// Trials in all, shared out over the seeds; in each all holes of the scene are tried in turn.
    pub n_trials: usize,
    /// Seeds of the holes' order, of first touches, frames and grasps.
    pub seeds: Vec<u64>,
    /// A held peg is off by up to this in x and in y, each place equally likely, mm.
    pub grasp_error_mm: f64,
    /// A held peg is turned by up to this, each angle equally likely, degrees.
    pub grasp_error_deg: f64,
}

/// What became of one hole. Parts are indices into the scene's.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt {
    /// The hole's own part.
    pub part: usize,
    /// The part that was named, and whose peg was tried.
    pub named: usize,
    /// Pegs that the robot still had: those it chose from.
    pub n_pegs: usize,
    /// Why the touching ended. Whatever it was, the robot tries its best estimate.
    pub stop: StopReason,
    /// Touches, the first included.
    pub n_touches: usize,
    /// Probability of the part that was named, 0..=1.
    pub probability: f64,
    /// How well it explains what was felt (`Estimate::fit`).
    pub fit: Option<f64>,
    /// Whether the peg went in.
    pub went_in: bool,
    /// How far from the hole's centre the peg was brought, mm, the grasp error included.
    pub xy_mm: f64,
    /// How far it was turned against the hole, degrees, modulo the part's symmetry.
    pub theta_deg: f64,
    /// Milliseconds of each touch from its frame to the decision what to do next, `[n_touches]`.
    pub decision_ms: Vec<f64>,
}

impl Attempt {
    /// Why the touching ended, in words.
    pub fn stop_name(&self) -> &'static str {
        stop_name(self.stop)
    }

    /// Whether the hole has its own peg.
    pub fn is_done(&self) -> bool {
        self.went_in && self.named == self.part
    }
}

/// The reasons to stop, in words.
pub(super) const STOPS: [(StopReason, &str); 4] = [
    (StopReason::Confident, "confident"),
    (StopReason::NoneOfThese, "none of these"),
    (StopReason::TouchLimit, "touch limit"),
    (StopReason::NothingToLearn, "nothing to learn"),
];

/// Why the touching ended, in words.
pub(super) fn stop_name(stop: StopReason) -> &'static str {
    STOPS.iter().find(|(known, _)| *known == stop).map_or("", |(_, name)| name)
}

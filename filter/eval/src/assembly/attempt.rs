//! What a robot is to do in an assembly, and what happened at one hole.

use serde::{Deserialize, Serialize};
use tactile_filter::StopReason;

use tactile_filter::budget::Speeds;

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
    /// A hole's plate is tilted against the tool by this, towards any side, degrees.
    pub tilt_deg: f64,
    /// How pegs are put in.
    pub insertion: Insertion,
    /// How long touches, tries and ways take; a try takes as long as a touch.
    pub speeds: Speeds,
}

/// How a peg is put in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Insertion {
    /// So often a held peg is pressed on a second sensor before it is tried, so that its place in the hand is known; 0: it is not.
    pub peg_touches: usize,
    /// At so many poses at most a try looks for the hole, at least one; 1: straight down.
    pub search_poses: usize,
    /// So often a peg is tried at a hole, at least once; a try in vain is evidence of where the hole is, and of which part.
    pub tries: usize,
    /// How fast a peg slides along the plate, mm a second.
    pub slide_mm_s: f64,
}

impl Default for Insertion {
    fn default() -> Self {
        Self { peg_touches: 2, search_poses: 200, tries: 3, slide_mm_s: 10.0 }
    }
}

/// What became of one hole. Parts are indices into the scene's.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt {
    /// The hole's own part.
    pub part: usize,
    /// The part that was named last, and whose peg was tried.
    pub named: usize,
    /// Pegs that the robot still had: those it chose from.
    pub n_pegs: usize,
    /// Why the touching ended. Whatever it was, the robot tries its best estimate.
    pub stop: StopReason,
    /// Touches of the hole, the first included.
    pub n_touches: usize,
    /// Touches of the pegs that were tried.
    pub n_peg_touches: usize,
    /// Pegs tried.
    pub n_tries: usize,
    /// How far the sensor went from touch to touch, mm.
    pub travel_mm: f64,
    /// How far pegs slid along the plate, mm.
    pub slide_mm: f64,
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
    /// A hole at which nothing was done yet, with so many pegs to choose from.
    pub(super) fn begun(part: usize, n_pegs: usize) -> Self {
        Self {
            part,
            named: part,
            n_pegs,
            stop: StopReason::TouchLimit,
            n_touches: 0,
            n_peg_touches: 0,
            n_tries: 0,
            travel_mm: 0.0,
            slide_mm: 0.0,
            probability: 0.0,
            fit: None,
            went_in: false,
            xy_mm: 0.0,
            theta_deg: 0.0,
            decision_ms: Vec::new(),
        }
    }

    /// Seconds that the hole took.
    pub fn seconds(&self, speeds: &Speeds, slide_mm_s: f64) -> f64 {
        let Self { n_touches, n_peg_touches, n_tries, travel_mm, slide_mm, .. } = self;
        speeds.seconds(n_touches + n_peg_touches + n_tries, *travel_mm) + slide_mm / slide_mm_s
    }

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

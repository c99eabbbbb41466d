//! A touch and what followed from it, in JSON: for programs, the terminal view and the comparison of replays.

use serde::{Deserialize, Serialize};
use tactile_data::se2::Se2;
use tactile_filter::{Decision, Episode, StopReason};
use tactile_infer::Bank;

/// One touch that was taken in. Numbers are written so that they read back to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DecisionReport {
    /// Number of the episode, from 1 on.
    pub episode: u64,
    /// Number of the touch in it, from 1 on.
    pub touch: usize,
    /// The motion since the touch before, mm and radians; none for the first.
    pub moved: Option<Motion>,
    /// Share of the picture that shows an edge, 0..=1.
    pub edge_share: f32,
    /// Where to touch next, in the sensor's frame; `None` once it is over.
    pub next: Option<Motion>,
    /// Why it is over.
    pub stop: Option<StopReason>,
    /// What is known.
    pub estimate: EstimateReport,
    /// Probability of each part of the bank.
    pub posterior: Vec<(String, f64)>,
}

/// A motion or pose in the plane: x, y in mm and theta in radians.
pub type Motion = Se2;

/// The estimate after a touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// The likeliest part.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// The sensor's pose on it, now.
    pub part_from_sensor: Motion,
    /// Covariance of its pose at the first touch: x mm, y mm, theta rad.
    pub covariance: [[f64; 3]; 3],
    /// How well it explains the touches, at most 0.
    pub fit: Option<f64>,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// Reasons to doubt.
    pub warnings: Vec<String>,
}

/// What is known of a touch besides its episode.
#[derive(Clone, Copy, Debug)]
pub struct Touched {
    /// Number of the episode, from 1 on.
    pub episode: u64,
    /// The motion since the touch before.
    pub moved: Option<Se2>,
    /// Share of the picture that shows an edge.
    pub edge_share: f32,
}

impl DecisionReport {
    /// The report of an episode's latest touch.
    pub fn new(touched: &Touched, bank: &Bank, episode: &Episode, decision: &Decision) -> Self {
        let Touched { episode: number, moved, edge_share } = *touched;
        let (next, stop, estimate) = match decision {
            Decision::Touch(action) => (Some(action.sensor_from_next), None, Box::new(episode.estimate())),
            Decision::Done(estimate, reason) => (None, Some(*reason), estimate.clone()),
        };
        Self {
            episode: number,
            touch: estimate.n_touches,
            moved,
            edge_share,
            next,
            stop,
            estimate: EstimateReport {
                part: estimate.part.clone(),
                probability: estimate.probability,
                part_from_sensor: estimate.part_from_sensor,
                covariance: estimate.covariance,
                fit: estimate.fit,
                entropy_nats: estimate.entropy_nats,
                warnings: estimate.warnings.iter().map(ToString::to_string).collect(),
            },
            posterior: bank.parts().iter().cloned().zip(estimate.class_posterior.iter().copied()).collect(),
        }
    }

    /// A line for a person.
    pub fn line(&self) -> String {
        let EstimateReport { part, probability, .. } = &self.estimate;
        let percent = 100.0 * probability;
        let n = self.touch;
        match (self.stop, self.next) {
            (Some(StopReason::Confident), _) => format!("touch {n}: it is {part}, {percent:.1} % sure"),
            (Some(StopReason::NoneOfThese), _) => format!("touch {n}: none of these parts ({part} is the nearest)"),
            (Some(StopReason::TouchLimit), _) => format!("touch {n}: no more touches; perhaps {part}, {percent:.1} %"),
            (Some(StopReason::NothingToLearn), _) => {
                format!("touch {n}: nothing left to touch; perhaps {part}, {percent:.1} %")
            }
            (None, Some(next)) => format!(
                "touch {n}: perhaps {part}, {percent:.1} %; next {:.1} mm, {:.1} mm, {:.1} degrees",
                next.x_mm,
                next.y_mm,
                next.theta_deg()
            ),
            (None, None) => format!("touch {n}: perhaps {part}, {percent:.1} %"),
        }
    }

    /// What stands on `~/label`: the part, or what is known instead.
    pub fn label(&self) -> String {
        match self.stop {
            Some(StopReason::Confident) => self.estimate.part.clone(),
            Some(StopReason::NoneOfThese) => "none of these".to_owned(),
            _ => format!("{}?", self.estimate.part),
        }
    }
}

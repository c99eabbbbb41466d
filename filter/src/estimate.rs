//! What is known of a hole after the touches so far.

use tactile_data::se2::Se2;
use tactile_data::symmetry::Symmetry;
#[cfg(doc)]
use tactile_infer::Bank;

use crate::modes::Mode;
use crate::stop::{Standing, StopReason};

/// A reason to doubt an estimate, however probable it is: the filter only weighs the parts of its bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// No edged touch looks like any recorded view: perhaps none of these parts.
    LowSimilarity {
        /// The largest cosine of any edged touch with any recorded view.
        best: f32,
        /// What [`crate::EpisodeConfig::low_similarity`] asks for.
        floor: f32,
    },
    /// Every touch was blank: no edge was ever seen.
    NothingSeen,
    /// The bank is made for the other side than the one that is touched.
    OtherSide {
        /// What is touched, what the bank is made for, and how to make one that suits ([`Bank::other_side`]).
        why: &'static str,
    },
}

impl Warning {
    /// Whether it is about these touches; else it is about the bank alone.
    pub fn is_of_touches(&self) -> bool {
        !matches!(self, Self::OtherSide { .. })
    }
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::LowSimilarity { best, floor } => {
                write!(f, "no touch looks like any recorded view (best cosine {best:.2}, expected {floor:.2} or more)")
            }
            Self::NothingSeen => write!(f, "no touch showed an edge"),
            Self::OtherSide { why } => f.write_str(why),
        }
    }
}

/// The second most probable part.
#[derive(Clone, Debug, PartialEq)]
pub struct RunnerUp {
    /// Its name; the first of equals.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
}

impl RunnerUp {
    /// Whether a second part is named next to the first: the answer is neither that one part nor none of these, and the second
    /// is more probable than 5 %.
    pub fn is_named(stop: Option<StopReason>, probability: f64) -> bool {
        !matches!(stop, Some(StopReason::Confident | StopReason::NoneOfThese)) && probability > 0.05
    }
}

/// What is known after the touches so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Name of the most probable part; the first of equals.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// The next likeliest; `None` where no other part is left.
    pub runner_up: Option<RunnerUp>,
    /// Pose of the sensor now, around the likeliest state of that part.
    pub part_from_sensor: Se2,
    /// Pose of the sensor at its first touch: the mean around that state, or its recorded pose where
    /// [`crate::EpisodeConfig::between_poses`] is off.
    pub part_from_first: Se2,
    /// The turns after which that part feels the same. Touch cannot tell the poses of
    /// `symmetry.twins(&part_from_sensor)` apart; insert at any of them.
    pub symmetry: Symmetry,
    /// Covariance of that pose, (x mm, y mm, theta rad), over all that is believed of where this part is: other hills count
    /// as far as they are away and as often as they are believed ([`Self::modes`] has each on its own); zeros for a recorded
    /// pose.
    pub covariance: [[f64; 3]; 3],
    /// How well that part explains what was felt ([`Belief::fit`](crate::belief::Belief::fit)): how many standard deviations
    /// the edged touches look more like its views than the touches of a part that is there do on average; `None` where no
    /// edge was felt.
    pub fit: Option<f64>,
    /// Touches that this is of: with an edge, and made within the recorded area if that part is there.
    pub n_fitted: usize,
    /// Probability of each part of the bank, `[n_parts]`.
    pub class_posterior: Vec<f64>,
    /// Where else it may be: the belief's modes, the heaviest first.
    pub modes: Vec<Mode>,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// [`crate::belief::Belief::log_evidence`] of all touches, nats.
    pub log_evidence: f64,
    /// Touches made.
    pub n_touches: usize,
    /// Reasons to doubt all this.
    pub warnings: Vec<Warning>,
}

impl Estimate {
    /// What is asked of it before it is believed.
    pub fn standing(&self) -> Standing {
        Standing { probability: self.probability, fit: self.fit, n_fitted: self.n_fitted, n_touches: self.n_touches }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_part_is_named_only_while_it_may_be_that_one() {
        let of = |stop| [0.06, 0.05].map(|probability| RunnerUp::is_named(stop, probability));
        for stop in [None, Some(StopReason::TouchLimit), Some(StopReason::NothingToLearn)] {
            assert_eq!(of(stop), [true, false], "{stop:?}");
        }
        for stop in [StopReason::Confident, StopReason::NoneOfThese] {
            assert_eq!(of(Some(stop)), [false; 2], "{stop:?}");
        }
    }
}

//! What is known of a hole after the touches so far.

use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;
use tactile_infer::calibration::presence::{Presence, Verified};

use crate::belief::modes::{Mode, modes};
use crate::decision::verdict::{Asked, RunnerUp, Standing, StopReason, Verdict, Warning, place_mm2};

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
    /// [`crate::Method::between_poses`] is off.
    pub part_from_first: Se2,
    /// The turns after which that part feels the same. Touch cannot tell the poses of
    /// `symmetry.twins(&part_from_sensor)` apart; insert at any of them.
    pub symmetry: Symmetry,
    /// Covariance of that pose, (x mm, y mm, theta rad), over all that is believed of where this part is: other hills count
    /// as far as they are away and as often as they are believed ([`Self::modes`] has each on its own); zeros for a recorded
    /// pose.
    pub covariance: [[f64; 3]; 3],
    /// How well that part explains what was felt ([`crate::SensorMatch`]): how many standard deviations the edged touches
    /// look more like its views than the touches of a part that is there do on average; `None` where no
    /// edge was felt.
    pub fit: Option<f64>,
    /// Touches that this is of: with an edge, and made within the recorded area if that part is there.
    pub n_fitted: usize,
    /// What a verifier says of the touches where that part would be; `None` where none judges them.
    pub verified: Option<Verified>,
    /// Whether that part is there at all, or a stranger that the bank does not hold; `None` where no edge was felt.
    pub presence: Option<Presence>,
    /// Probability of each part of the bank, `[n_parts]`; of the likeliest ones as a verifier judges them, where there is one
    /// ([`crate::Settings::verify`]).
    pub class_posterior: Vec<f64>,
    /// Where else it may be: the belief's modes, the heaviest first, each as probable as its part.
    pub modes: Vec<Mode>,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// [`crate::belief::Belief::log_evidence`] of all touches, nats.
    pub log_evidence: f64,
    /// Touches made.
    pub n_touches: usize,
    /// Why to stop now, however much could still be touched; `None` to go on.
    pub stop: Option<StopReason>,
    /// Reasons to doubt all this.
    pub warnings: Vec<Warning>,
}

impl Asked<'_> {
    /// What is known now.
    pub(crate) fn estimate(self) -> Estimate {
        let Self { bank, belief, .. } = self;
        let Verdict { part, probability, runner_up, placed, presence, covariance, stop, warnings } = self.verdict();
        let (posterior, first_from_sensor) = (belief.posterior(), belief.first_from_sensor());
        let class_posterior = self.candidates().by_part.clone();
        let mut modes = modes(posterior, &first_from_sensor, &|part| bank.symmetry(part));
        if class_posterior != posterior.by_part() {
            let of_part = |part: usize| class_posterior[part] / posterior.by_part()[part].max(f64::MIN_POSITIVE);
            modes.iter_mut().for_each(|mode| mode.mass = (mode.mass * of_part(mode.part)).min(1.0));
            modes.sort_by(|a, b| b.mass.total_cmp(&a.mass));
        }
        Estimate {
            part: bank.parts()[part].clone(),
            probability: probability.min(1.0),
            runner_up,
            part_from_sensor: placed.part_from_first * first_from_sensor,
            part_from_first: placed.part_from_first,
            symmetry: bank.symmetry(part),
            covariance,
            fit: placed.fit,
            n_fitted: placed.n_fitted(),
            verified: placed.verified,
            presence,
            class_posterior,
            modes,
            entropy_nats: posterior.entropy_nats(),
            log_evidence: belief.log_evidence(),
            n_touches: belief.touches().len(),
            stop,
            warnings,
        }
    }
}

impl Estimate {
    /// What is asked of it before it is believed ([`crate::EpisodeConfig::stop`], with other settings, too).
    pub fn standing(&self) -> Standing {
        let Self { probability, presence, n_touches, .. } = *self;
        Standing { probability, presence, place_mm2: Some(place_mm2(&self.covariance)), n_touches }
    }

    /// The second part that it may be as well, where [`RunnerUp::is_named`] says so.
    pub fn second(&self) -> Option<&RunnerUp> {
        self.runner_up.as_ref().filter(|other| RunnerUp::is_named(self.stop, other.probability))
    }
}

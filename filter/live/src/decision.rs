//! A touch and what followed from it, in JSON: for programs, the terminal view and the comparison of replays.

use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::Se2;
use tactile_filter::{Decision, Episode, RunnerUp, StopReason};
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
    /// The next likeliest; `None` where no other part is left, and in recordings from before it was written.
    #[serde(default)]
    pub runner_up: Option<RunnerUpReport>,
    /// The sensor's pose on it, now.
    pub part_from_sensor: Motion,
    /// Covariance of its pose at the first touch: x mm, y mm, theta rad.
    pub covariance: [[f64; 3]; 3],
    /// How well it explains the touches, standard deviations; `None` where no edge was felt.
    pub fit: Option<f64>,
    /// Probability that it is none of the bank's parts, 0..=1; `None` where no edge was felt, and in recordings from before it was
    /// written.
    #[serde(default)]
    pub none_probability: Option<f64>,
    /// How often a part that is not in the bank comes to so good a match, 0..=1; as above.
    #[serde(default)]
    pub stranger_rate: Option<f64>,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// Reasons to doubt.
    pub warnings: Vec<String>,
}

/// The second most probable part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunnerUpReport {
    /// Its name.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
}

impl RunnerUpReport {
    fn new(runner_up: &RunnerUp) -> Self {
        let RunnerUp { part, probability } = runner_up;
        Self { part: part.clone(), probability: *probability }
    }
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
    /// The report of the latest touch of an episode.
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
                runner_up: estimate.runner_up.as_ref().map(RunnerUpReport::new),
                part_from_sensor: estimate.part_from_sensor,
                covariance: estimate.covariance,
                fit: estimate.fit,
                none_probability: estimate.presence.map(|presence| presence.none()),
                stranger_rate: estimate.presence.map(|presence| presence.stranger_rate),
                entropy_nats: estimate.entropy_nats,
                warnings: estimate.warnings.iter().map(ToString::to_string).collect(),
            },
            posterior: bank.parts().iter().cloned().zip(estimate.class_posterior.iter().copied()).collect(),
        }
    }

    /// The second part that it may be as well, where [`RunnerUp::is_named`] says so.
    pub fn other(&self) -> Option<&RunnerUpReport> {
        let other = self.estimate.runner_up.as_ref();
        other.filter(|other| RunnerUp::is_named(self.stop, other.probability))
    }

    /// A line for a person.
    pub fn line(&self) -> String {
        let n = self.touch;
        let part = &self.estimate.part;
        let percent = |probability: f64| format!("{:.1} %", 100.0 * probability);
        let sure = percent(self.estimate.probability);
        let perhaps = match self.other() {
            Some(other) => format!("{part}, {sure}, or {}, {}", other.part, percent(other.probability)),
            None => format!("perhaps {part}, {sure}"),
        };
        match (self.stop, self.next) {
            (Some(StopReason::Confident), _) => format!("touch {n}: it is {part}, {sure} sure"),
            (Some(StopReason::NoneOfThese), _) => {
                let why: String = self.estimate.warnings.iter().map(|warning| format!("; {warning}")).collect();
                format!("touch {n}: none of these parts ({part} is the nearest{why})")
            }
            (Some(StopReason::TouchLimit), _) => format!("touch {n}: no more touches; {perhaps}"),
            (Some(StopReason::NothingToLearn), _) => format!("touch {n}: nothing left to touch; {perhaps}"),
            (None, Some(next)) => format!(
                "touch {n}: {perhaps}; next {:.1} mm, {:.1} mm, {:.1} degrees",
                next.x_mm,
                next.y_mm,
                next.theta_deg()
            ),
            (None, None) => format!("touch {n}: {perhaps}"),
        }
    }

    /// The text of `~/label`: the part, or what is known instead.
    pub fn label(&self) -> String {
        match self.stop {
            Some(StopReason::Confident) => self.estimate.part.clone(),
            Some(StopReason::NoneOfThese) => "none of these".to_owned(),
            _ => format!("{}?", self.estimate.part),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After ten touches of O, or of Q.
    fn report(stop: Option<StopReason>, runner_up: Option<RunnerUpReport>) -> DecisionReport {
        let estimate = EstimateReport {
            part: "O".into(),
            probability: 0.601,
            runner_up,
            part_from_sensor: Motion::IDENTITY,
            covariance: [[0.0; 3]; 3],
            fit: Some(-0.5),
            none_probability: Some(0.25),
            stranger_rate: Some(0.125),
            entropy_nats: 1.0,
            warnings: Vec::new(),
        };
        let next = stop.is_none().then(|| Motion::new(4.0, 0.0, 0.0));
        let posterior = [("O".into(), 0.601), ("Q".into(), 0.389), ("T".into(), 0.01)].to_vec();
        DecisionReport { episode: 1, touch: 10, moved: None, edge_share: 0.2, next, stop, estimate, posterior }
    }

    fn other(probability: f64) -> RunnerUpReport {
        RunnerUpReport::new(&RunnerUp { part: "Q".into(), probability })
    }

    #[test]
    fn both_parts_are_named_where_it_may_be_either() {
        let of = |stop, other: &RunnerUpReport| report(stop, Some(other.clone())).line();
        let likely = other(0.389);
        let both = "O, 60.1 %, or Q, 38.9 %";
        let limit = Some(StopReason::TouchLimit);
        assert_eq!(of(limit, &likely), format!("touch 10: no more touches; {both}"));
        assert_eq!(of(Some(StopReason::NothingToLearn), &likely), format!("touch 10: nothing left to touch; {both}"));
        assert_eq!(of(None, &likely), format!("touch 10: {both}; next 4.0 mm, 0.0 mm, 0.0 degrees"));
        // A part that is hardly probable is not named.
        let one = "touch 10: no more touches; perhaps O, 60.1 %";
        assert_eq!(of(limit, &other(0.04)), one);
        assert_eq!(report(limit, None).line(), one);
    }

    #[test]
    fn what_is_sure_is_one_part_or_none_and_the_label_names_no_other() {
        let of = |stop| {
            let report = report(stop, Some(other(0.389)));
            (report.line(), report.label())
        };
        let confident = of(Some(StopReason::Confident));
        assert_eq!(confident, ("touch 10: it is O, 60.1 % sure".into(), "O".into()));
        let none = of(Some(StopReason::NoneOfThese));
        assert_eq!(none, ("touch 10: none of these parts (O is the nearest)".into(), "none of these".into()));
        assert_eq!([of(Some(StopReason::TouchLimit)).1, of(None).1], ["O?", "O?"]);
        let mut report = report(Some(StopReason::NoneOfThese), None);
        report.estimate.warnings = vec!["no touch is like it".into()];
        assert_eq!(report.line(), "touch 10: none of these parts (O is the nearest; no touch is like it)");
    }

    #[test]
    fn a_report_reads_back_and_so_does_one_from_before_there_was_a_runner_up() {
        let now = report(None, Some(other(0.1 + 0.2)));
        let mut json = serde_json::to_value(&now).unwrap();
        assert_eq!(serde_json::from_str::<DecisionReport>(&json.to_string()).unwrap(), now);
        json["estimate"].as_object_mut().unwrap().remove("runner_up");
        assert_eq!(serde_json::from_value::<DecisionReport>(json).unwrap(), report(None, None));
    }
}

//! How the next touch is chosen: the rule and the effort.

use serde::{Deserialize, Serialize};

/// How the next touch is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActionRule {
    /// The largest sum of 1 / f_PP between the view from a likely state and the views from the states
    /// drawn from the belief (paper, Eq. 5 and 6), with f_PP = exp(cosine / temperature) > 0.
    Paper,
    /// The largest expected gain of the true state's log-probability, under the filter's own likelihood. Where touches match
    /// badly, views like theirs count less: a part or a sensor that the network does not know is mistaken there again.
    #[default]
    Information,
    /// Any action allowed, each equally likely.
    Random,
    /// Any action allowed that would show an edge from the likeliest state, each equally likely: the paper's action set
    /// without its rule. Where none would, any.
    #[serde(rename = "random-edge")]
    RandomEdge,
}

/// How actions are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActionConfig {
    /// The rule.
    pub rule: ActionRule,
    /// States drawn from the belief, against which an action is judged; 1 to 100,000.
    pub n_draws: usize,
    /// States supposed true in turn, s* of the paper; 1 to 10,000. For the paper's rule the first is the
    /// likeliest state and the others are drawn; for expected information all are drawn.
    pub n_suppositions: usize,
    /// Candidates judged by all draws, the best of a first pass with a sixth of them; at least 1. `None`: all of them. Draws times
    /// suppositions times the candidates that they judge are at most 1e8, of 1,000 candidates.
    pub n_finalists: Option<usize>,
    /// delta_act: an action counts only from those supposed states where it would show a larger share of
    /// edge pixels than this, 0..=1.
    pub contact_threshold: f32,
    /// A touch keeps at least this far from every earlier one, mm, not negative ...
    pub min_separation_mm: f64,
    /// ... or is turned against it by at least this much, degrees. `None`: by a full turn, which counts only once the
    /// separation was halved.
    pub min_separation_deg: Option<f64>,
    /// What a millimetre of travel must tell to be worth it, nats, not negative; expected information only.
    pub travel_nats_per_mm: f64,
}

impl Default for ActionConfig {
    /// 160 draws as measured on a prototype, 24 suppositions on random contours; 4 mm on the tuning letters,
    /// where 12 mm drove touches out of the recorded area of small parts.
    fn default() -> Self {
        Self {
            rule: ActionRule::default(),
            n_draws: 160,
            n_suppositions: 24,
            n_finalists: Some(24),
            contact_threshold: 0.01,
            min_separation_mm: 4.0,
            min_separation_deg: None,
            travel_nats_per_mm: 0.0,
        }
    }
}

impl ActionConfig {
    /// Alg. 1, lines 9-10: the likeliest state against the K = 100 particles, any pose, those with contact.
    pub fn paper() -> Self {
        Self {
            rule: ActionRule::Paper,
            n_draws: 100,
            n_suppositions: 1,
            n_finalists: None,
            min_separation_mm: 0.0,
            ..Self::default()
        }
    }
}

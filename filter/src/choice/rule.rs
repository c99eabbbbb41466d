//! How the next touch is chosen.

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

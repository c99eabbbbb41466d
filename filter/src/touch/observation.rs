//! What the filter takes in of one touch.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tactile_data::touch::Side;

/// One touch as the filter sees it: made of a frame by [`Sensor::observe`](crate::Sensor::observe).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// The embedding of what was touched, `[dim]`; its length does not matter, its direction does.
    pub query: Vec<f32>,
    /// Share of the view that shows an edge, 0..=1.
    pub edge_share: f32,
    /// Which side was touched: an episode is of one.
    #[serde(default, skip_serializing_if = "Side::is_hole")]
    pub side: Side,
    /// A hash of the frame's bytes: the same picture after a motion means a camera that has stopped. `None`: not checked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_hash: Option<u64>,
    /// The model that made the query; `None`: not checked.
    #[serde(skip)]
    pub model_sha256: Option<Arc<str>>,
}

impl Observation {
    /// An observation of a hole of which only the embedding is known: neither its frame nor its model is checked.
    pub fn new(query: Vec<f32>, edge_share: f32) -> Self {
        Self { query, edge_share, side: Side::Hole, frame_hash: None, model_sha256: None }
    }

    /// The same observation, of this side.
    #[must_use]
    pub fn of_side(self, side: Side) -> Self {
        Self { side, ..self }
    }

    /// The same observation, of a simulated frame: two of them may be equal though the sensor moved.
    #[must_use]
    pub fn of_simulation(self) -> Self {
        Self { frame_hash: None, ..self }
    }
}

//! What the filter takes in of one touch.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::maps::DrawnMap;

use crate::error::{Error, Result};

/// One touch as the filter sees it: made of a frame by [`Sensor::observe`](crate::Sensor::observe).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// The embedding of what was touched, `[dim]`; its length does not matter, its direction does.
    pub query: Vec<f32>,
    /// Share of the view that shows an edge, 0..=1.
    pub edge_share: f32,
    /// How rare what is felt is in the world of parts, above the average touch, nats
    /// ([`MatchOdds::rarity_of`](tactile_infer::calibration::match_odds::MatchOdds::rarity_of)); 0 where that is not known.
    #[serde(default)]
    pub rarity: f32,
    /// What the touch shows, place by place, where the model draws maps ([`Model::with_maps`](tactile_infer::Model::with_maps)).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<Box<DrawnMap>>,
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
    /// An observation of a hole by its embedding alone: neither a frame nor a model is checked.
    pub fn new(query: Vec<f32>, edge_share: f32) -> Self {
        let (rarity, map, side, frame_hash, model_sha256) = (0.0, None, Side::Hole, None, None);
        Self { query, edge_share, rarity, map, side, frame_hash, model_sha256 }
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

    /// The same, whose map shows as much as the views of a bank: one sensor, or two alike, touch both.
    pub(crate) fn seen_as(&self, bank: &Bank) -> Self {
        let view_mm = bank.origin().map(|origin| origin.sensor.field_of_view_mm);
        let mut seen = self.clone();
        if let Some(view_mm) = view_mm {
            seen.map = seen.map.map(|map| Box::new(map.of_view(view_mm)));
        }
        seen
    }

    /// Refuses a map that no sensor draws.
    pub(crate) fn check_map(&self) -> Result<()> {
        Ok(self.map.as_ref().map_or(Ok(()), |map| map.validate())?)
    }

    /// Refuses an observation of another model than this one.
    pub(crate) fn check_model(&self, sha256: &str) -> Result<()> {
        match &self.model_sha256 {
            Some(got) if &**got != sha256 => {
                Err(Error::WrongModel { what: "observation", expected: sha256.to_string(), got: got.to_string() })
            }
            _ => Ok(()),
        }
    }

    /// Refuses an observation that cannot follow another after a motion: of the other side, or the same picture, which a
    /// camera's noise alone would have changed.
    pub(crate) fn check_follows(&self, before: &Self, moved: &Se2) -> Result<()> {
        /// A robot that does not move is still to within this, mm and degrees.
        const STILL: f64 = 0.02;
        if self.side != before.side {
            return Err(Error::WrongSide { expected: before.side, got: self.side });
        }
        let (mm, deg) = (moved.x_mm.hypot(moved.y_mm), moved.theta_deg().abs());
        if before.frame_hash.is_some() && before.frame_hash == self.frame_hash && mm.max(deg) > STILL {
            return Err(Error::FrozenFrame { mm, deg });
        }
        Ok(())
    }
}

/// Refuses a motion that no robot made; NaN could not be made. Far beyond, composed poses overflow.
pub(crate) fn check_motion(moved: &Se2) -> Result<()> {
    let Se2 { x_mm, y_mm, theta_rad } = *moved;
    if x_mm.abs() <= 1e6 && y_mm.abs() <= 1e6 && theta_rad.abs() <= 1e3 {
        return Ok(());
    }
    Err(Error::Motion { x_mm, y_mm, theta_rad })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_observation_of_before_rarity_was_known_is_as_rare_as_the_average() {
        let read = |json: &str| serde_json::from_str::<Observation>(json).unwrap();
        let old = read(r#"{"query": [0.6, 0.8], "edge_share": 0.25}"#);
        assert_eq!(old, Observation::new(vec![0.6, 0.8], 0.25));
        assert_eq!(old.rarity, 0.0);
        let rare = Observation { rarity: -1.25, ..old };
        assert_eq!(read(&serde_json::to_string(&rare).unwrap()), rare);
    }
}

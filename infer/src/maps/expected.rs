//! What a verifier says of touches that were made on a part, where they were made: not of every part alike. A socket reads unlike its
//! plug; fine teeth are lost in a map.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;

use crate::calibration::Spread;
use crate::error::{Error, Result};

/// The log-odds that a verifier gives to touches with an edge at their own poses, of each part, nats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// The checksum of the networks that drew the maps and judge.
    pub maps_sha256: String,
    /// Where holes are touched, `[n_parts]`; `None` of a part that hardly shows an edge.
    pub holes: Vec<Option<Spread>>,
    /// Where pegs are.
    pub pegs: Vec<Option<Spread>>,
}

impl Expected {
    /// What to expect of a part where a side is touched.
    pub fn of(&self, part: usize, side: Side) -> Option<Spread> {
        let of_side = if side == Side::Peg { &self.pegs } else { &self.holes };
        of_side.get(part).copied().flatten()
    }

    /// The same of some of the parts, in their order.
    pub(crate) fn of_parts(&self, parts: &[usize]) -> Self {
        let some = |of: &[Option<Spread>]| parts.iter().filter_map(|part| of.get(*part).copied()).collect();
        Self { maps_sha256: self.maps_sha256.clone(), holes: some(&self.holes), pegs: some(&self.pegs) }
    }

    /// Refuses what cannot be of so many parts.
    pub(crate) fn validate(&self, n_parts: usize) -> Result<()> {
        let is_good = |spread: &Spread| spread.mean.is_finite() && spread.sd.is_finite() && spread.sd >= 0.0;
        let are_good = self.holes.iter().chain(&self.pegs).flatten().all(is_good);
        if [&self.holes, &self.pegs].iter().any(|side| side.len() != n_parts) || !are_good {
            return Err(Error::invalid("verified", format!("finite log-odds of each of {n_parts} parts"), "others"));
        }
        Ok(())
    }
}

//! What touches that were made on a part come to where they were made: not alike of every part. A socket reads unlike its plug; fine
//! teeth are lost in a map.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;

use crate::calibration::Spread;
use crate::error::{Error, Result};
use crate::maps::usual_strain::UsualStrain;

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
    /// How a part seems to differ in size from its own map where its hole is touched, `[n_parts]`; empty in older banks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hole_strains: Vec<Option<UsualStrain>>,
    /// Where its peg is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub peg_strains: Vec<Option<UsualStrain>>,
}

impl Expected {
    /// What to expect of a part where a side is touched.
    pub fn of(&self, part: usize, side: Side) -> Option<Spread> {
        let of_side = if side == Side::Peg { &self.pegs } else { &self.holes };
        of_side.get(part).copied().flatten()
    }

    /// How a part seems to differ in size from its own map where a side is touched.
    pub fn strain_of(&self, part: usize, side: Side) -> Option<UsualStrain> {
        let of_side = if side == Side::Peg { &self.peg_strains } else { &self.hole_strains };
        of_side.get(part).copied().flatten()
    }

    /// The same of some of the parts, in their order.
    pub(crate) fn of_parts(&self, parts: &[usize]) -> Self {
        fn some<T: Copy>(of: &[T], parts: &[usize]) -> Vec<T> {
            parts.iter().filter_map(|part| of.get(*part).copied()).collect()
        }
        Self {
            maps_sha256: self.maps_sha256.clone(),
            holes: some(&self.holes, parts),
            pegs: some(&self.pegs, parts),
            hole_strains: some(&self.hole_strains, parts),
            peg_strains: some(&self.peg_strains, parts),
        }
    }

    /// Refuses what cannot be of so many parts.
    pub(crate) fn validate(&self, n_parts: usize) -> Result<()> {
        let is_good = |spread: &Spread| spread.mean.is_finite() && spread.sd.is_finite() && spread.sd >= 0.0;
        let are_good = self.holes.iter().chain(&self.pegs).flatten().all(is_good);
        let strains = [&self.hole_strains, &self.peg_strains];
        let are_strains = |side: &Vec<Option<UsualStrain>>| {
            (side.is_empty() || side.len() == n_parts) && side.iter().flatten().all(UsualStrain::is_possible)
        };
        if [&self.holes, &self.pegs].iter().any(|side| side.len() != n_parts) || !are_good {
            return Err(Error::invalid("verified", format!("finite log-odds of each of {n_parts} parts"), "others"));
        }
        if !strains.into_iter().all(are_strains) {
            return Err(Error::invalid("verified", format!("finite strains of each of {n_parts} parts"), "others"));
        }
        Ok(())
    }
}

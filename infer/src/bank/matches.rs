//! How well the touches of each part match its own views: not every part's alike. The hole of a plug with a latch looks
//! unlike the plug; fine teeth are lost between recorded poses.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;

use crate::calibration::Spread;
use crate::calibration::match_odds::distance;
use crate::error::{Error, Result};

/// How the edged touches of one side of one part match the views of a bank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartMatch {
    /// The cosine with the view that was touched ([`Bank::cosine_at`](crate::Bank::cosine_at)).
    pub matched: Spread,
}

impl PartMatch {
    fn is_valid(&self) -> bool {
        self.matched.mean.is_finite() && self.matched.sd.is_finite() && self.matched.sd >= 0.0
    }
}

/// The match of every part of a bank, as far as it is known: measured in simulation where a bank is made of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Matches {
    /// Where holes are touched, `[n_parts]`.
    pub holes: Vec<Option<PartMatch>>,
    /// Where pegs are.
    pub pegs: Vec<Option<PartMatch>>,
}

impl Matches {
    /// The match of a part where one side is touched.
    pub fn of(&self, part: usize, side: Side) -> Option<PartMatch> {
        let of_side = if side == Side::Peg { &self.pegs } else { &self.holes };
        of_side.get(part).copied().flatten()
    }

    /// How far touches of one side are from the views that they are made at, the mean of all parts that are known; `None`
    /// where none is.
    pub fn own_distance(&self, side: Side) -> Option<f64> {
        let of_side = if side == Side::Peg { &self.pegs } else { &self.holes };
        let known: Vec<f64> = of_side.iter().flatten().map(|part| distance(part.matched.mean)).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// The matches of some of the parts, in their order.
    pub(crate) fn of_parts(&self, parts: &[usize]) -> Self {
        let some = |of: &[Option<PartMatch>]| {
            let of_part = |part: &usize| of.get(*part).copied();
            parts.iter().filter_map(of_part).collect()
        };
        Self { holes: some(&self.holes), pegs: some(&self.pegs) }
    }

    /// Refuses what cannot be of so many parts.
    pub(crate) fn validate(&self, n_parts: usize) -> Result<()> {
        let all = || self.holes.iter().chain(&self.pegs);
        if all().count() != 2 * n_parts || self.holes.len() != n_parts || !all().flatten().all(PartMatch::is_valid) {
            return Err(Error::invalid("matches", format!("finite ones of each of {n_parts} parts"), "others"));
        }
        Ok(())
    }
}

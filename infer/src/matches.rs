//! How well the touches of each part match its own views: not every part's alike. The hole of a plug with a latch looks
//! unlike the plug; fine teeth are lost between recorded poses.

use serde::{Deserialize, Serialize};
use tactile_data::touch::Side;

use crate::calibration::Spread;
use crate::error::{Error, Result};

/// How the edged touches of one side of one part match the views of a bank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartMatch {
    /// The cosine with the view that was touched ([`Bank::cosine_at`](crate::Bank::cosine_at)).
    pub matched: Spread,
    /// How far that is below the best cosine with any recorded view of any part.
    pub gap: Spread,
}

impl PartMatch {
    fn is_valid(&self) -> bool {
        let fine = |spread: &Spread| spread.mean.is_finite() && spread.sd.is_finite() && spread.sd >= 0.0;
        fine(&self.matched) && fine(&self.gap)
    }
}

/// That of every part of a bank, as far as it is known: measured in simulation where a bank is made of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Matches {
    /// Where holes are touched, `[n_parts]`.
    pub holes: Vec<Option<PartMatch>>,
    /// Where pegs are.
    pub pegs: Vec<Option<PartMatch>>,
}

impl Matches {
    /// That of a part where one side is touched.
    pub fn of(&self, part: usize, side: Side) -> Option<PartMatch> {
        let of_side = if side == Side::Peg { &self.pegs } else { &self.holes };
        of_side.get(part).copied().flatten()
    }

    /// Those of some of the parts, in their order.
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

#[cfg(feature = "sim")]
pub(crate) use simulated::match_touches;

#[cfg(feature = "sim")]
mod simulated {
    use rand::RngExt;
    use rayon::prelude::*;
    use tactile_data::se2::Se2;
    use tactile_data::simulator::{Simulator, frame_rng};

    use super::*;
    use crate::bank::Bank;
    use crate::between::is_fine;
    use crate::calibration::BLANK_SHARE;
    use crate::model::Model;

    /// Touches of each side of each part.
    const N_TOUCHES: u64 = 64;

    /// Fewer edged ones say too little.
    const ENOUGH: usize = 16;

    /// Touches each part of a bank, `parts` in the simulator, anywhere within the bank's poses, or at them where they are
    /// too far apart to be interpolated, and compares. The frames are of another session than the bank's.
    pub(crate) fn match_touches(
        model: &Model,
        bank: &Bank,
        simulator: &Simulator,
        parts: &[usize],
        seed: u64,
    ) -> Result<Matches> {
        let seed = seed ^ 0x6d61_7463_6865_7300;
        let scene = simulator.scene();
        let background = model.background(&simulator.no_contact(seed))?.lit_by(&scene.sensor.known_lamps())?;
        let pose = |rng: &mut _| {
            let grid = bank.grid();
            if !is_fine(grid) {
                return grid.pose(RngExt::random_range(rng, 0..grid.len()));
            }
            let mut around = |half: f64| half * (2.0 * RngExt::random::<f64>(rng) - 1.0);
            Se2::from_degrees(around(grid.xy_half_mm), around(grid.xy_half_mm), around(grid.theta_half_deg))
        };
        let edged = bank.edged_rows();
        // The touch's cosine with its own view, and how far that is below the best.
        let compare = |(part, side, stream): (usize, Side, u64)| -> Result<Option<[f64; 2]>> {
            let mut rng = frame_rng(seed, stream);
            let pose = pose(&mut rng);
            let image = background.tactile_image(&simulator.touch(parts[part], side, &pose, &mut rng)?)?;
            if image.edge_share < BLANK_SHARE {
                return Ok(None);
            }
            let query = model.embed_side(&[image], side)?;
            let mut all = Vec::new();
            bank.similarities(&query, &mut all);
            let best = edged.iter().map(|row| all[*row]).fold(-1.0, f32::max);
            let matched = bank.cosine_at(&query, part, &pose);
            Ok(matched.map(|matched| [f64::from(matched), f64::from(best - matched)]))
        };
        let sides = |part: usize| [(part, Side::Hole), (part, Side::Peg)];
        let all: Vec<(usize, Side)> = (0..parts.len()).flat_map(sides).collect();
        all.par_iter().try_for_each(|(part, side)| simulator.prepare(parts[*part], *side))?;
        let of_part = |part: usize, side: Side| {
            let streams =
                (1..=N_TOUCHES).map(|touch| touch + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg)));
            let compared = streams.collect::<Vec<_>>().into_par_iter().map(|stream| compare((part, side, stream)));
            let compared: Vec<[f64; 2]> = compared.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
            let spread = |of: usize| Spread::of(&compared.iter().map(|values| values[of]).collect::<Vec<_>>());
            Ok((compared.len() >= ENOUGH).then(|| PartMatch { matched: spread(0), gap: spread(1) }))
        };
        let of_side = |side: Side| (0..parts.len()).map(|part| of_part(part, side)).collect::<Result<Vec<_>>>();
        Ok(Matches { holes: of_side(Side::Hole)?, pegs: of_side(Side::Peg)? })
    }
}

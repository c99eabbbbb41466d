//! How well the touches of each part match its own views, measured in simulation.

use rand::RngExt;
use tactile_data::se2::Se2;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::between::is_fine;
use crate::calibration::{BLANK_SHARE, Spread};
use crate::error::Result;
use crate::matches::{Matches, PartMatch};
use crate::model::Model;
use crate::threads;

/// Touches of each side of each part.
const N_TOUCHES: u64 = 64;

/// Fewer edged ones say too little.
const ENOUGH: usize = 16;

/// Touches each part of a bank, `parts` in the simulator, anywhere within the bank's poses, or at them where they are
/// too far apart to be interpolated, and compares. The frames are of another session than the bank's.
pub(super) fn match_touches(
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
    // The cosine of an edged touch with its own view, where that is known.
    let touch = |part: usize, side: Side, stream: u64| -> Result<Option<f64>> {
        let mut rng = frame_rng(seed, stream);
        let pose = pose(&mut rng);
        let image = background.tactile_image(&simulator.touch(parts[part], side, &pose, &mut rng)?)?;
        if image.edge_share < BLANK_SHARE {
            return Ok(None);
        }
        let query = model.embed_side(&[image], side)?;
        Ok(bank.cosine_at(&query, part, &pose).map(f64::from))
    };
    let of_part = |part: usize, side: Side| -> Result<Option<PartMatch>> {
        let first = 1 + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg));
        let touches = (first..first + N_TOUCHES).map(|stream| touch(part, side, stream));
        let matched: Vec<f64> = touches.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        Ok((matched.len() >= ENOUGH).then(|| PartMatch { matched: Spread::of(&matched) }))
    };
    let of_side = |side: Side| threads::each(0..parts.len(), |part| of_part(part, side));
    Ok(Matches { holes: of_side(Side::Hole)?, pegs: of_side(Side::Peg)? })
}

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

/// Rows compared with all touches of a part before the next ones: as many as stay in a core's cache.
const ROWS_AT_A_TIME: usize = 256;

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
    // The query of an edged touch and its cosine with its own view, where that is known.
    let touch = |part: usize, side: Side, stream: u64| -> Result<Option<(Vec<f32>, f32)>> {
        let mut rng = frame_rng(seed, stream);
        let pose = pose(&mut rng);
        let image = background.tactile_image(&simulator.touch(parts[part], side, &pose, &mut rng)?)?;
        if image.edge_share < BLANK_SHARE {
            return Ok(None);
        }
        let query = model.embed_side(&[image], side)?;
        let matched = bank.cosine_at(&query, part, &pose);
        Ok(matched.map(|matched| (query, matched)))
    };
    let is_edged = edged(bank);
    let of_part = |part: usize, side: Side| -> Result<Option<PartMatch>> {
        let first = 1 + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg));
        let touches = (first..first + N_TOUCHES).map(|stream| touch(part, side, stream));
        let touches: Vec<(Vec<f32>, f32)> = touches.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        let queries: Vec<&[f32]> = touches.iter().map(|(query, _)| &query[..]).collect();
        let best = best_of_each(bank, &is_edged, &queries);
        let matched: Vec<f64> = touches.iter().map(|(_, matched)| f64::from(*matched)).collect();
        let gaps = touches.iter().zip(best).map(|((_, matched), best)| f64::from(best - matched));
        let (matched, gap) = (Spread::of(&matched), Spread::of(&gaps.collect::<Vec<_>>()));
        Ok((touches.len() >= ENOUGH).then_some(PartMatch { matched, gap }))
    };
    let of_side = |side: Side| threads::each(0..parts.len(), |part| of_part(part, side));
    Ok(Matches { holes: of_side(Side::Hole)?, pegs: of_side(Side::Peg)? })
}

/// Which rows were recorded and show an edge, `[n_rows]`.
fn edged(bank: &Bank) -> Vec<bool> {
    let mut is_edged = vec![false; bank.n_rows()];
    bank.edged_rows().into_iter().for_each(|row| is_edged[row] = true);
    is_edged
}

/// The best cosine of each query with any edged row of a bank, -1..=1; -1 where none is edged. The rows are read once
/// for all queries.
fn best_of_each(bank: &Bank, is_edged: &[bool], queries: &[&[f32]]) -> Vec<f32> {
    let (mut best, mut cosines) = (vec![-1.0_f32; queries.len()], Vec::new());
    for (start, is_edged) in (0..).step_by(ROWS_AT_A_TIME).zip(is_edged.chunks(ROWS_AT_A_TIME)) {
        if !is_edged.contains(&true) {
            continue;
        }
        for (best, query) in best.iter_mut().zip(queries) {
            bank.rows().similarities_in(start..start + is_edged.len(), query, &mut cosines);
            let of_edged = cosines.iter().zip(is_edged).filter(|(_, is_edged)| **is_edged);
            *best = of_edged.fold(*best, |best, (cosine, _)| best.max(*cosine));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::Rows;
    use tactile_data::grid::PoseGrid;

    #[test]
    fn the_best_of_each_is_the_largest_of_all() {
        const DIM: usize = 128;
        let grid = PoseGrid { xy_half_mm: 16.0, xy_step_mm: 2.0, theta_half_deg: 60.0, theta_step_deg: 15.0 };
        let values: Vec<f32> = (0..grid.len() * DIM).map(|i| ((i * i % 9973) as f32 * 0.37).sin()).collect();
        let shares: Vec<f32> = (0..grid.len()).map(|row| if row % 7 == 0 { 0.0 } else { 0.3 }).collect();
        let bank = Bank::from_rows(vec!["A".into()], grid, Rows::new(DIM, values).unwrap(), shares, "").unwrap();
        let is_edged = edged(&bank);
        let queries: Vec<Vec<f32>> = (0..5).map(|row| bank.row(7 * row).into_owned()).collect();
        let queries: Vec<&[f32]> = queries.iter().map(|query| &query[..]).collect();
        for (query, best) in queries.iter().zip(best_of_each(&bank, &is_edged, &queries)) {
            let mut all = Vec::new();
            bank.rows().similarities(query, &mut all);
            let of_edged = all.iter().zip(&is_edged).filter(|(_, is_edged)| **is_edged);
            assert_eq!(best, of_edged.fold(-1.0, |best: f32, (cosine, _)| best.max(*cosine)));
        }
    }
}

//! What the exact engine leaves out, against the f64 reference over all states.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::Observation;
use tactile_filter::TouchModel;
use tactile_filter::belief::{Belief, EngineConfig};
use tactile_filter::likelihood::TouchLikelihood;

use super::case::{Case, Group};
use super::reference::OF_COSINE;
use super::sample::Sample;
use crate::Result;

/// Touches of a hole.
const N_TOUCHES: usize = 10;

/// The total variation after each of ten touches; of one hole, steep and flat, and of a hole whose later touches are
/// those of another part, which the earlier ones ruled out.
pub fn cases(seed: u64) -> Result<Vec<Case>> {
    let grid = PoseGrid::SMALL;
    // Far from each other, whatever the grid.
    let cells: Vec<usize> = (0..N_TOUCHES).map(|k| (17 + 131 * k) % grid.len()).collect();
    let motions: Vec<Se2> = cells.windows(2).map(|pair| grid.pose(pair[0]).inverse() * grid.pose(pair[1])).collect();
    let sample = Sample::along(6, grid, 64, grid.pose(cells[0]), &motions, seed);
    let other = Sample { touches: contradicted(&sample, &cells), ..sample.clone() };
    let usual = Sample::model();
    let flat = TouchModel { steepness: 5.0, ..usual };
    let kinds = [("one hole", &sample, usual), ("one hole, flat", &sample, flat), ("two holes", &other, usual)];
    let mut cases = Vec::new();
    for (variant, sample, config) in kinds {
        let bank = sample.bank()?;
        let likelihood = |touch: &Observation| TouchLikelihood::new(touch, &bank, &config);
        let mut belief = Belief::new(&bank, EngineConfig::Exact, 1, seed, likelihood(&sample.touches[0].1)?);
        for n_touches in 1..=N_TOUCHES {
            if let Some((moved, touch)) = sample.touches[1..n_touches].last() {
                belief.update(moved, likelihood(touch)?);
            }
            let first = Sample { touches: sample.touches[..n_touches].to_vec(), ..sample.clone() };
            let reference = first.expected(&config, OF_COSINE);
            let apart = total_variation(&belief, &reference.logs);
            let expected = "the total variation from all states is within what may be left out";
            // Half of what any probability is off, relative to it.
            let bound = belief.posterior().left_out() + 0.5 * reference.relative();
            let case = Case::measured(Group::LeftOut, variant, expected, apart, bound);
            cases.push(case.at(n_touches as f64).by("what the belief says that it left out, and rounding of cosines"));
        }
    }
    Ok(cases)
}

/// The touches of a sample at these cells, of which those from the fifth on show what the second part does there.
fn contradicted(sample: &Sample, cells: &[usize]) -> Vec<(Se2, Observation)> {
    let of_other = |cell: usize| {
        let row = sample.grid.len() + cell;
        let shown = sample.rows[row * sample.dim..(row + 1) * sample.dim].to_vec();
        Observation::new(shown, sample.edge_shares[row])
    };
    let touches = sample.touches.iter().zip(cells).enumerate();
    touches.map(|(at, ((moved, felt), cell))| (*moved, if at < 4 { felt.clone() } else { of_other(*cell) })).collect()
}

/// Half the sum of the differences between the belief and what it should be, given as logs.
fn total_variation(belief: &Belief, expected: &[f64]) -> f64 {
    let mut apart: Vec<f64> = expected.iter().map(|log| log.exp()).collect();
    for (state, mass) in belief.posterior().states() {
        apart[state.part * belief.posterior().grid().len() + state.cell] -= mass;
    }
    apart.iter().map(|apart| apart.abs()).sum::<f64>() / 2.0
}

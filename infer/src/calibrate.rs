//! Fits a [`Calibration`] to touches of holes, or of pegs, whose parts and poses are known.

use rayon::prelude::*;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_data::store::Dataset;
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::calibration::{BLANK_SHARE, Calibration, Gap};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::recorded::tactile_images;

/// Fewer holes with an edge than this say too little.
const MIN_HOLES: usize = 50;

/// More than this many holes are thinned out evenly.
const MAX_HOLES: usize = 1_500;

/// Mean and standard deviation of values, of which there is at least one.
fn gap_of(values: &[f64]) -> Gap {
    let mean_of = |value: &dyn Fn(f64) -> f64| values.iter().map(|v| value(*v)).sum::<f64>() / values.len() as f64;
    let mean = mean_of(&|v| v);
    Gap { mean, sd: mean_of(&|v| (v - mean).powi(2)).sqrt() }
}

/// One hole against all recorded pegs, by how far each cosine is below the best.
struct Compared {
    /// Edged rows of the bank in each range of [`GAP`], the best first.
    rows_by_gap: Vec<u32>,
    /// Those around the true pose, on the right part.
    near: Vec<f32>,
    /// The best cosine.
    best: f32,
}

/// Ranges of cosine that are distinguished: a tenth of the smallest temperature tried.
const GAP: f32 = 0.0005;

impl Compared {
    fn new(cosines: &[f32], near: &[usize]) -> Self {
        let best = cosines.iter().copied().fold(-1.0, f32::max);
        let mut rows_by_gap = vec![0; (2.0 / GAP) as usize + 2];
        cosines.iter().for_each(|s| rows_by_gap[((best - s) / GAP) as usize] += 1);
        rows_by_gap.truncate(rows_by_gap.iter().rposition(|n| *n > 0).map_or(0, |last| last + 1));
        Self { rows_by_gap, near: near.iter().map(|at| best - cosines[*at]).collect(), best }
    }

    /// How far the best of the rows around the true pose is below the best.
    fn gap(&self) -> f64 {
        f64::from(self.near.iter().copied().fold(f32::INFINITY, f32::min))
    }

    fn n_rows(&self) -> f64 {
        self.rows_by_gap.iter().map(|n| f64::from(*n)).sum()
    }

    fn nll(&self, temperature: f64, floor: f64) -> f64 {
        let weight = |gap: f64| (-gap / temperature).exp() + floor;
        let of_range = |(i, n): (usize, &u32)| f64::from(*n) * weight((i as f64 + 0.5) * f64::from(GAP));
        let all: f64 = self.rows_by_gap.iter().enumerate().filter(|(_, n)| **n > 0).map(of_range).sum();
        let near: f64 = self.near.iter().map(|gap| weight(f64::from(*gap))).sum();
        all.ln() - near.ln()
    }
}

/// Fits temperature and floor by maximum likelihood: for each hole the recorded poses within one step of
/// the true one, on the right part, are to be found among all rows of the bank, each weighing
/// `exp((s - s_max) / tau) + eps`. The holes should lie between the recorded poses, as a robot's do. With the side `Peg`
/// the touches are of pegs, not the ones that the bank was made of.
///
/// # Errors
/// A bank of another model, holes of parts that the bank does not hold, or too few that show an edge.
pub fn calibrate(model: &Model, bank: &Bank, holes: &Dataset, side: Side) -> Result<Calibration> {
    let name = &holes.meta().name;
    let of_side: Vec<usize> = (0..holes.len()).filter(|i| holes.touch(*i).side == Some(side)).collect();
    let frames: Vec<usize> = of_side.iter().step_by(of_side.len().div_ceil(MAX_HOLES).max(1)).copied().collect();
    let images = tactile_images(&model.background_of(holes)?, holes, &frames)?;
    let queries = model.embed_side(&images, side)?;
    let is_edged = |share: f32| share >= BLANK_SHARE;
    let edged: Vec<usize> =
        (0..bank.n_rows()).filter(|row| is_edged(bank.edge_shares()[*row]) && bank.is_recorded(*row)).collect();
    let (mut n_agree, mut n_placed, mut compared, mut all) = (0, 0, Vec::new(), Vec::new());
    for (i, frame) in frames.iter().enumerate() {
        let touch = holes.touch(*frame);
        let known = touch.part.as_ref().and_then(|part| bank.parts().iter().position(|name| name == part));
        let (Some(part), Some(pose)) = (known, touch.part_from_sensor) else {
            let expected = format!("{side}s of the bank's parts, with their poses");
            return Err(Error::invalid(format!("{name}: index row {frame}"), expected, format!("{:?}", touch.part)));
        };
        let nearest = bank.grid().nearest(&pose);
        let Some(cell) = nearest.filter(|cell| bank.is_recorded(part * bank.grid().len() + cell)) else { continue };
        let shows_edge = is_edged(images[i].edge_share);
        n_placed += 1;
        n_agree += usize::from(is_edged(bank.edge_shares()[part * bank.grid().len() + cell]) == shows_edge);
        if !shows_edge {
            continue;
        }
        let query = &queries[i * model.dim()..(i + 1) * model.dim()];
        let near = (0..edged.len()).filter(|at| {
            let (of, cell) = (edged[*at] / bank.grid().len(), edged[*at] % bank.grid().len());
            of == part && is_near(bank.grid(), &bank.grid().pose(cell), &pose)
        });
        let near: Vec<usize> = near.collect();
        if !near.is_empty() {
            bank.similarities(query, &mut all);
            let cosines: Vec<f32> = edged.iter().map(|row| all[*row].clamp(-1.0, 1.0)).collect();
            compared.push(Compared::new(&cosines, &near));
        }
    }
    if compared.len() < MIN_HOLES {
        let expected = format!("{MIN_HOLES} or more {side}s that show an edge within the bank's poses");
        return Err(Error::invalid(name, expected, compared.len().to_string()));
    }
    let (temperature, outlier_floor, nll_nats) = fit(&compared);
    let mut bests: Vec<f32> = compared.iter().map(|hole| hole.best).collect();
    bests.sort_by(f32::total_cmp);
    let chance = |hole: &Compared| (hole.n_rows() / hole.near.len() as f64).ln();
    Ok(Calibration {
        temperature,
        outlier_floor,
        // Laplace's rule: no finite sample makes disagreement impossible.
        blank_agreement: (f64::from(n_agree as u32) + 1.0) / (f64::from(n_placed as u32) + 2.0),
        low_similarity: bests[bests.len() / 100],
        nll_nats,
        gap: Some(gap_of(&compared.iter().map(Compared::gap).collect::<Vec<_>>())),
        chance_nats: compared.iter().map(chance).sum::<f64>() / compared.len() as f64,
        n_holes: compared.len(),
    })
}

/// Whether a recorded pose is within one step of another pose on every axis.
fn is_near(grid: &PoseGrid, recorded: &Se2, pose: &Se2) -> bool {
    let turn = wrap_angle(recorded.theta_rad - pose.theta_rad).to_degrees().abs();
    let shift = (recorded.x_mm - pose.x_mm).abs().max((recorded.y_mm - pose.y_mm).abs());
    shift < grid.xy_step_mm && turn < grid.theta_step_deg
}

/// The temperature and floor of least mean negative log-likelihood, by a search on a logarithmic grid
/// that is refined once around its best point.
fn fit(holes: &[Compared]) -> (f64, f64, f64) {
    let log_grid = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..n).map(|i| (low.ln() + (high / low).ln() * i as f64 / (n - 1) as f64).exp()).collect()
    };
    let best_of = |temperatures: &[f64], floors: &[f64]| {
        let points = temperatures.iter().flat_map(|t| floors.iter().map(move |f| (*t, *f))).collect::<Vec<_>>();
        let scored = points.into_par_iter().map(|(t, f)| (t, f, nll(holes, t, f)));
        scored.reduce(|| (f64::NAN, f64::NAN, f64::INFINITY), |a, b| if b.2 < a.2 { b } else { a })
    };
    let (t, f, _) = best_of(&log_grid(0.005, 0.5, 16), &log_grid(1e-6, 0.1, 11));
    best_of(&log_grid(t / 1.4, t * 1.4, 9), &log_grid(f / 3.0, f * 3.0, 7))
}

fn nll(holes: &[Compared], temperature: f64, floor: f64) -> f64 {
    holes.iter().map(|hole| hole.nll(temperature, floor)).sum::<f64>() / holes.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_gap_is_to_the_best_row_of_those_round_the_true_pose() {
        let gaps = [&[2, 1][..], &[0, 2]].map(|near| Compared::new(&[0.9, 0.4, 0.6], near).gap());
        assert!((gaps[0] - 0.3).abs() < 1e-6 && gaps[1] == 0.0, "{gaps:?}");
        // By hand: 1, 2 and 6 have a mean of 3 and squares of 4, 1 and 9 from it.
        assert_eq!(gap_of(&[1.0, 2.0, 6.0]), Gap { mean: 3.0, sd: (14.0_f64 / 3.0).sqrt() });
    }

    /// Cosines drawn so that the posterior is a softmax at a known temperature: one of `n` rows is drawn with
    /// probability proportional to `exp(s / tau)` and called the true one.
    #[test]
    fn a_known_temperature_is_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (n, temperature) = (200, 0.06);
        let rows: Vec<Compared> = (0..2 * n)
            .map(|_| {
                let cosines: Vec<f32> = (0..n).map(|_| 0.4 * rng.random::<f32>()).collect();
                let weights: Vec<f64> = cosines.iter().map(|s| (f64::from(*s) / temperature).exp()).collect();
                let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
                let drawn = weights.iter().position(|w| {
                    left -= w;
                    left <= 0.0
                });
                Compared::new(&cosines, &[drawn.unwrap_or(0)])
            })
            .collect();
        let (found, floor, nll_found) = fit(&rows);
        // 400 draws: some 10 % on the temperature; a floor is not called for.
        assert!((found / temperature - 1.0).abs() < 0.3, "{found}");
        assert!(floor < 0.05 && nll_found < (n as f64).ln());
    }
}

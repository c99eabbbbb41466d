//! A bank and the touches of one of its holes, drawn at random.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::normalize_rows;

use super::reference::{Expected, Touch, cosines, expected};
use crate::Result;
use tactile_filter::Observation;
use tactile_filter::TouchModel;
use tactile_filter::belief::{Belief, EngineConfig};
use tactile_filter::likelihood::TouchLikelihood;

/// Length of the noise on a touch, whose row has length 1: their cosine is about 0.86. Half of each row is
/// common to all, so that two rows have a cosine of about 0.5.
const NOISE: f32 = 0.6;

/// The distance of a touch from its row.
const OWN_DISTANCE: f64 = 0.53;

/// One cell in so many is blank, the same on each part.
const BLANK_EVERY: usize = 9;

/// How rare touches are, nats, a standard deviation.
const RARITY: f32 = 2.0;

/// Rows of a bank, and what was felt of the hole of part [`Sample::TRUTH`].
#[derive(Clone, Debug)]
pub struct Sample {
    /// Number of parts.
    pub n_parts: usize,
    /// The poses of each.
    pub grid: PoseGrid,
    /// Length of a row.
    pub dim: usize,
    /// `[n_parts * grid.len(), dim]`.
    pub rows: Vec<f32>,
    /// The edge share of each row.
    pub edge_shares: Vec<f32>,
    /// Each with the motion since the one before.
    pub touches: Vec<(Se2, Observation)>,
}

impl Sample {
    /// The true part.
    pub const TRUTH: usize = 0;

    /// The defaults, but for how far touches are from their rows.
    pub fn model() -> TouchModel {
        TouchModel { own_distance: OWN_DISTANCE, ..TouchModel::default() }
    }

    /// Random rows; the touches are within a tenth of a step of recorded poses of the true part, the first at one.
    pub fn draw(n_parts: usize, grid: PoseGrid, dim: usize, n_touches: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6d6f_7665);
        let mut recorded = || grid.pose(rng.random_range(0..grid.len()));
        let mut poses: Vec<Se2> = (0..n_touches.max(1)).map(|_| recorded()).collect();
        for pose in &mut poses[1..] {
            let mut within = |step: f64| 0.2 * step * (rng.random::<f64>() - 0.5);
            *pose = Se2::from_degrees(
                pose.x_mm + within(grid.xy_step_mm),
                pose.y_mm + within(grid.xy_step_mm),
                pose.theta_deg() + within(grid.theta_step_deg),
            );
        }
        let motions: Vec<Se2> = poses.windows(2).map(|pair| pair[0].inverse() * pair[1]).collect();
        Self::along(n_parts, grid, dim, poses[0], &motions, seed)
    }

    /// Random rows, touched at `first` and after each of the motions.
    #[expect(clippy::too_many_arguments, reason = "each is one number of the sample")]
    pub fn along(n_parts: usize, grid: PoseGrid, dim: usize, first: Se2, motions: &[Se2], seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let n_rows = n_parts * grid.len();
        let common = normals(dim, &mut rng);
        let mut rows: Vec<f32> = Vec::with_capacity(n_rows * dim);
        let mut edge_shares: Vec<f32> = Vec::with_capacity(n_rows);
        for row in 0..n_rows {
            let own = normals(dim, &mut rng);
            rows.extend(own.iter().zip(&common).map(|(own, common)| own + common));
            edge_shares.push(if row % grid.len() % BLANK_EVERY == 4 { 0.0 } else { 0.2 });
        }
        normalize_rows(&mut rows, dim);
        let mut sample = Self { n_parts, grid, dim, rows, edge_shares, touches: Vec::new() };
        let mut pose = first;
        for moved in [&Se2::IDENTITY].into_iter().chain(motions) {
            pose = pose * *moved;
            let row = Self::TRUTH * grid.len() + grid.nearest(&pose).unwrap_or(0);
            let spread = NOISE / (dim as f32).sqrt();
            let noise = normals(dim, &mut rng);
            let felt = sample.rows[row * dim..(row + 1) * dim].iter().zip(noise);
            let query = felt.map(|(value, noise)| value + spread * noise).collect();
            let rarity = RARITY * normals(1, &mut rng)[0];
            let observation = Observation { rarity, ..Observation::new(query, sample.edge_shares[row]) };
            sample.touches.push((*moved, observation));
        }
        sample
    }

    /// The bank of its rows.
    pub fn bank(&self) -> Result<Bank> {
        let names = (0..self.n_parts).map(|part| part.to_string()).collect();
        let (rows, shares) = (self.rows.clone(), self.edge_shares.clone());
        Ok(Bank::from_rows(names, self.grid, Rows::new(self.dim, rows)?, shares, "")?)
    }

    /// What the filter believes after all touches; by the exact engine over all states, so that the arithmetic alone is
    /// seen.
    pub fn belief(&self, engine: EngineConfig, seed: u64, config: &TouchModel) -> Result<Belief> {
        self.belief_with(&self.bank()?, engine, seed, config)
    }

    /// The same with a bank of its own, such as one of rounded rows.
    pub fn belief_with(&self, bank: &Bank, engine: EngineConfig, seed: u64, config: &TouchModel) -> Result<Belief> {
        let likelihood = |touch: &Observation| TouchLikelihood::new(touch, bank, config);
        let first = likelihood(&self.touches[0].1)?;
        let mut belief = match engine {
            EngineConfig::Exact => Belief::of_all_states(bank, 1, first),
            EngineConfig::Particle(_) => Belief::new(bank, engine, 1, seed, first),
        };
        for (moved, touch) in &self.touches[1..] {
            belief.update(moved, likelihood(touch)?);
        }
        Ok(belief)
    }

    /// What it should believe, where a cosine may be off by an error.
    pub fn expected(&self, config: &TouchModel, error: f64) -> Expected {
        let touch = |(moved, seen): &(Se2, Observation)| {
            let cosines = cosines(&self.rows, &seen.query);
            Touch { moved: *moved, edge_share: seen.edge_share, rarity: seen.rarity, cosines }
        };
        let touches: Vec<Touch> = self.touches.iter().map(touch).collect();
        expected(&self.grid, &touches, config, error)
    }
}

/// Numbers of mean 0 and variance 1, close to normal: the sum of 12 uniform draws less 6.
pub fn normals(n: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..n).map(|_| (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn touches_are_alike_to_their_row_and_less_to_others() {
        let sample = Sample::draw(3, PoseGrid::SMALL, 128, 4, 1);
        for (_, touch) in &sample.touches {
            let mut found = cosines(&sample.rows, &touch.query);
            found.sort_by(f64::total_cmp);
            let (best, next) = (found[found.len() - 1], found[found.len() - 2]);
            assert!((0.8..0.95).contains(&best) && next < best - 0.05, "{best} {next}");
        }
    }
}

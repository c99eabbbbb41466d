//! How good a model is, measured on boards that it was not trained on.

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_infer::bank::similarity::{dot, normalize_rows};
use tactile_infer::embedding::network::Network;

use crate::batch::Batch;
use crate::error::{Error, Result};
use crate::mating::Pair;
use crate::pairs::Pairs;

/// At most this many pairs of a held-out board are compared with each other.
const MAX_PAIRS: usize = 400;

/// Pegs within this distance, mm and degrees, are near neighbours, which the filter must distinguish.
const NEAR: (f64, f64) = (6.0, 40.0);

/// How good a model is on held-out boards. A low loss alone does not show it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Share of holes whose own peg is the most similar of all pegs of the same board, 0..=1.
    pub retrieval_1: f64,
    /// Share of holes whose own peg is among the five most similar, 0..=1.
    pub retrieval_5: f64,
    /// Retrieval@1 by chance, 0..=1.
    pub chance_1: f64,
    /// Share of holes whose own peg is the most similar of those within 6 mm and 40 degrees, 0..=1; of holes
    /// that have such a neighbour. `None` where none has.
    pub near_1: Option<f64>,
    /// That share by chance, 0..=1.
    pub near_chance: Option<f64>,
    /// Mean rank of the own peg among those neighbours; 1 is best.
    pub near_rank: Option<f64>,
    /// Share of holes of parts never trained on whose nearest peg is of the right part, 0..=1; `None`
    /// without tuning datasets.
    pub tuning_accuracy: Option<f64>,
    /// Mean cosine of mating pairs less the mean of the other pairs of the board.
    pub cosine_gap: f64,
    /// Mean standard deviation of an embedding's values times the square root of its length: 1 where
    /// embeddings fill the sphere, 0 where they have collapsed to a point.
    pub spread: f64,
    /// Holes compared.
    pub n_holes: usize,
}

/// Embeds the held-out pairs and compares each hole with every peg of its own board. Does not measure
/// [`Validation::tuning_accuracy`].
pub fn validate(network: &Network, pairs: &Pairs<'_>, device: &Device) -> Result<Validation> {
    let device = device.clone().inner();
    let mut totals = Validation::default();
    let mut near = Near::default();
    let mut n_boards = 0;
    for board in boards(pairs) {
        let (queries, keys, dim) = embed(network, pairs, board, &device)?;
        let n = board.len();
        let poses: Vec<Option<Se2>> = board.iter().map(|pair| pairs.dataset.touch(pair.peg).part_from_sensor).collect();
        for (i, query) in queries.chunks_exact(dim).enumerate() {
            let cosines: Vec<f32> = keys.chunks_exact(dim).map(|key| dot(query, key)).collect();
            let better = (0..n).filter(|j| is_better(&cosines, *j, i)).count();
            totals.retrieval_1 += f64::from(better == 0);
            totals.retrieval_5 += f64::from(better < 5);
            totals.chance_1 += 1.0 / n as f64;
            let others = cosines.iter().map(|c| f64::from(*c)).sum::<f64>() - f64::from(cosines[i]);
            totals.cosine_gap += f64::from(cosines[i]) - others / (n - 1) as f64;
            near.add(i, &cosines, &poses);
        }
        totals.n_holes += n;
        totals.spread += spread(&keys, dim);
        n_boards += 1;
    }
    if totals.n_holes > 0 {
        let n = totals.n_holes as f64;
        for total in [&mut totals.retrieval_1, &mut totals.retrieval_5, &mut totals.chance_1, &mut totals.cosine_gap] {
            *total /= n;
        }
        totals.spread /= f64::from(n_boards);
    }
    [totals.near_1, totals.near_chance, totals.near_rank] = near.means();
    Ok(totals)
}

/// Images that [`validate`] embeds.
pub fn n_images(pairs: &Pairs<'_>) -> usize {
    boards(pairs).map(|board| 2 * board.len()).sum()
}

/// The pairs of each held-out board that are compared with each other.
fn boards<'a>(pairs: &'a Pairs<'_>) -> impl Iterator<Item = &'a [Pair]> {
    pairs.held_out.iter().filter(|board| board.len() > 1).map(|board| &board[..board.len().min(MAX_PAIRS)])
}

/// Whether peg `j` is at least as similar as peg `own`. A collapsed embedding, where all are equal, and one
/// that is NaN retrieve nothing.
fn is_better(cosines: &[f32], j: usize, own: usize) -> bool {
    j != own && (cosines[j] >= cosines[own] || cosines[j].is_nan() || cosines[own].is_nan())
}

/// Sums over holes that have neighbours.
#[derive(Default)]
struct Near {
    n: f64,
    first: f64,
    chance: f64,
    rank: f64,
}

impl Near {
    /// Adds hole `i`, by its cosines with the pegs at `poses`.
    fn add(&mut self, i: usize, cosines: &[f32], poses: &[Option<Se2>]) {
        let Some(own) = poses[i] else { return };
        let is_near = |pose: &Option<Se2>| {
            pose.is_some_and(|pose| {
                let turned = wrap_angle(pose.theta_rad - own.theta_rad).to_degrees().abs();
                pose.distance_mm(&own) <= NEAR.0 && turned <= NEAR.1
            })
        };
        let others = || (0..poses.len()).filter(|j| *j != i && is_near(&poses[*j]));
        let n_others = others().count();
        if n_others == 0 {
            return;
        }
        let better = others().filter(|j| is_better(cosines, *j, i)).count();
        self.n += 1.0;
        self.first += f64::from(better == 0);
        self.chance += 1.0 / (n_others + 1) as f64;
        self.rank += (better + 1) as f64;
    }

    /// Retrieval@1, its chance and the mean rank.
    fn means(&self) -> [Option<f64>; 3] {
        [self.first, self.chance, self.rank].map(|sum| (self.n > 0.0).then(|| sum / self.n))
    }
}

fn embed(network: &Network, pairs: &Pairs<'_>, board: &[Pair], device: &Device) -> Result<(Vec<f32>, Vec<f32>, usize)> {
    let (mut queries, mut keys) = (Vec::new(), Vec::new());
    for chunk in board.chunks(64) {
        let batch: Batch = pairs.plain(chunk)?;
        for both in batch.micro_batches(1, pairs.preprocessing.input_px, device) {
            let (holes, pegs) = (both.clone().narrow(0, 0, chunk.len()), both.narrow(0, chunk.len(), chunk.len()));
            for (rows, tensor) in [(&mut queries, network.query(holes)), (&mut keys, network.key(pegs))] {
                let values = tensor.into_data().try_into_vec::<f32>();
                rows.extend(values.map_err(|e| Error::invalid("embedding", "f32", format!("{e:?}")))?);
            }
        }
    }
    let dim = queries.len() / board.len();
    normalize_rows(&mut queries, dim);
    normalize_rows(&mut keys, dim);
    Ok((queries, keys, dim))
}

/// Mean over the axes of the standard deviation along each, times the square root of the number of axes.
fn spread(rows: &[f32], dim: usize) -> f64 {
    let n = (rows.len() / dim) as f64;
    let deviation = |axis: usize| {
        let values = || rows.iter().skip(axis).step_by(dim).map(|v| f64::from(*v));
        let mean = values().sum::<f64>() / n;
        (values().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (0..dim).map(deviation).sum::<f64>() / dim as f64 * (dim as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collapsed_embedding_has_no_spread_and_a_full_one_has_one() {
        assert_eq!(spread(&[0.6, 0.8, 0.6, 0.8], 2), 0.0);
        // The four points (+-1, 0), (0, +-1): variance 1/2 on each axis, sqrt(1/2) * sqrt(2) = 1.
        assert!((spread(&[1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, -1.0], 2) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn near_neighbours_are_those_of_a_few_millimetres_and_degrees() {
        let pose = |x, deg| Some(Se2::from_degrees(x, 0.0, deg));
        // Of hole 0 the second and the fifth peg are near, the second the more similar; the others are too far, too
        // much rotated, or of unknown pose.
        let poses = [pose(0.0, 0.0), pose(5.0, 30.0), pose(7.0, 0.0), pose(0.0, 60.0), pose(-5.9, -39.0), None];
        let mut near = Near::default();
        near.add(0, &[0.8, 0.9, 1.0, 1.0, 0.7, 1.0], &poses);
        near.add(5, &[0.0; 6], &poses);
        assert_eq!(near.means(), [Some(0.0), Some(1.0 / 3.0), Some(2.0)]);
        assert_eq!(Near::default().means(), [None; 3]);
    }
}

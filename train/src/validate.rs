//! Is it learning? Measured on boards that were never trained on.

use burn::tensor::Device;
use serde::Serialize;
use tactile_infer::encoder::Network;
use tactile_infer::similarity::{dot, normalize_rows};

use crate::batch::{Pair, Pairs};
use crate::error::{Error, Result};

/// At most this many pairs of a held-out board are compared with each other.
const MAX_PAIRS: usize = 400;

/// What a model does on held-out boards. A loss alone misleads; these do not.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Validation {
    /// Share of holes whose own peg is the most alike of all pegs of the same board, 0..=1.
    pub retrieval_1: f64,
    /// Share of holes whose own peg is among the five most alike, 0..=1.
    pub retrieval_5: f64,
    /// Mean cosine of mating pairs less that of the other pairs of the board.
    pub cosine_gap: f64,
    /// Mean standard deviation of an embedding's values times the root of its length: one where
    /// embeddings fill the sphere, nought where they have collapsed to a point.
    pub spread: f64,
    /// Holes compared.
    pub n_holes: usize,
}

/// Embeds the held-out pairs and compares each hole with every peg of its own board.
pub fn validate(network: &Network, pairs: &Pairs<'_>, device: &Device) -> Result<Validation> {
    let device = device.clone().inner();
    let mut totals = Validation::default();
    let mut n_boards = 0;
    for board in pairs.held_out.iter().filter(|board| board.len() > 1) {
        let board = &board[..board.len().min(MAX_PAIRS)];
        let (queries, keys, dim) = embed(network, pairs, board, &device)?;
        let n = board.len();
        for (i, query) in queries.chunks_exact(dim).enumerate() {
            let cosines: Vec<f32> = keys.chunks_exact(dim).map(|key| dot(query, key)).collect();
            let better = cosines.iter().filter(|cosine| **cosine > cosines[i]).count();
            totals.retrieval_1 += f64::from(better == 0);
            totals.retrieval_5 += f64::from(better < 5);
            let others = cosines.iter().map(|c| f64::from(*c)).sum::<f64>() - f64::from(cosines[i]);
            totals.cosine_gap += f64::from(cosines[i]) - others / (n - 1) as f64;
        }
        totals.n_holes += n;
        totals.spread += spread(&keys, dim);
        n_boards += 1;
    }
    if totals.n_holes > 0 {
        let n = totals.n_holes as f64;
        totals.retrieval_1 /= n;
        totals.retrieval_5 /= n;
        totals.cosine_gap /= n;
        totals.spread /= f64::from(n_boards);
    }
    Ok(totals)
}

fn embed(network: &Network, pairs: &Pairs<'_>, board: &[Pair], device: &Device) -> Result<(Vec<f32>, Vec<f32>, usize)> {
    let (mut queries, mut keys) = (Vec::new(), Vec::new());
    for chunk in board.chunks(64) {
        for (holes, pegs) in pairs.plain(chunk)?.shards(1, pairs.preprocessing.input_px, device) {
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

/// Mean over the axes of the standard deviation along each, times the root of the number of axes.
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
}

//! Batches: drawn, decoded, differenced and augmented ahead of the step that needs them.

use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use crate::augment::Augmentation;
use crate::config::{FalseNegatives, Flips, TrainConfig};
use crate::error::{Error, Result};
use crate::info_nce::MASKED;
use crate::pairs::{ALIKE, Pair, Pairs};

/// One batch in memory: `[n, 3, height, width]` each, row `i` of one mates with row `i` of the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Values of the hole images.
    pub holes: Vec<f32>,
    /// Values of the peg images.
    pub pegs: Vec<f32>,
    /// Where the run leaves false negatives out: `[n, n]`, nought or [`MASKED`].
    pub mask: Option<Vec<f32>>,
}

impl Batch {
    /// The batch as tensors `(holes, pegs)`, in `n_shards` parts of nearly equal size.
    pub fn shards(&self, n_shards: usize, [width, height]: [usize; 2], device: &Device) -> Vec<(Tensor<4>, Tensor<4>)> {
        let length = 3 * width * height;
        let n_pairs = self.holes.len() / length;
        let tensor = |values: &[f32]| {
            let n = values.len() / length;
            Tensor::from_data(TensorData::new(values.to_vec(), [n, 3, height, width]), device)
        };
        let bound = |shard: usize| shard * n_pairs / n_shards * length;
        let part = |shard: usize| {
            let range = bound(shard)..bound(shard + 1);
            (tensor(&self.holes[range.clone()]), tensor(&self.pegs[range]))
        };
        (0..n_shards).map(part).collect()
    }

    /// The mask as a tensor, `[n, n]`.
    pub fn mask(&self, device: &Device) -> Option<Tensor<2>> {
        let mask = self.mask.as_ref()?;
        let n = mask.len().isqrt();
        Some(Tensor::from_data(TensorData::new(mask.clone(), [n, n]), device))
    }
}

impl Pairs<'_> {
    /// The batch of a step: drawn from `(seed, step)` alone, so that a resumed run sees what an
    /// uninterrupted one does. Smaller than the settings say where the dataset has fewer pairs.
    ///
    /// With probability `near_share` the next pair is a neighbour of the one before, on the same board a few
    /// mm and degrees away: the negatives that the filter has to tell apart. Else it is any. Blank pairs
    /// beyond `max_blank` are drawn again.
    pub fn batch(&self, config: &TrainConfig, step: usize) -> Result<Batch> {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(step as u64 + 1);
        let chosen = self.choose(config, &mut rng)?;
        let flips = config.flips != Flips::None;
        let drawn: Vec<(Pair, Augmentation)> = chosen
            .iter()
            .map(|index| (self.training[*index], Augmentation::draw(&mut rng, config.min_crop, flips)))
            .collect();
        let mask = match config.false_negatives {
            FalseNegatives::Keep => None,
            FalseNegatives::Mask => {
                let flipped = drawn.iter().map(|(_, drawn)| [drawn.flip_x, drawn.flip_y]);
                Some(self.false_negatives(&chosen, &flipped.collect::<Vec<_>>()))
            }
        };
        Ok(Batch { mask, ..self.load(&drawn)? })
    }

    fn choose(&self, config: &TrainConfig, rng: &mut ChaCha8Rng) -> Result<Vec<usize>> {
        let max_blank = (config.max_blank * config.n_pairs as f64).round() as usize;
        let n_blank = self.places.iter().filter(|place| place.blank).count();
        let n_pairs = config.n_pairs.min(self.training.len() - n_blank + n_blank.min(max_blank));
        if n_pairs < 2 * config.n_shards {
            let expected = format!("at least {} pairs a batch, two for each of the shards", 2 * config.n_shards);
            let got = format!("{} pairs, {n_blank} of them blank", self.training.len());
            return Err(Error::invalid(&self.dataset.meta().name, expected, got));
        }
        let mut chosen: Vec<usize> = Vec::with_capacity(n_pairs);
        let mut taken = vec![false; self.training.len()];
        let mut blank_left = max_blank;
        while chosen.len() < n_pairs {
            let near = match chosen.last() {
                Some(&last) if rng.random_bool(config.near_share) => {
                    let close = &self.neighbours[last];
                    (!close.is_empty()).then(|| close[rng.random_range(0..close.len())] as usize)
                }
                _ => None,
            };
            let next = match near {
                Some(near) if !taken[near] => near,
                _ => rng.random_range(0..self.training.len()),
            };
            let is_blank = self.places[next].blank;
            if !taken[next] && (!is_blank || blank_left > 0) {
                taken[next] = true;
                blank_left -= usize::from(is_blank);
                chosen.push(next);
            }
        }
        Ok(chosen)
    }

    /// The mask of a batch: pairs that no picture can tell apart, because both are blank, or because they
    /// are of one place and mirrored alike.
    fn false_negatives(&self, chosen: &[usize], flipped: &[[bool; 2]]) -> Vec<f32> {
        let n = chosen.len();
        let mut mask = vec![0.0; n * n];
        for i in 0..n {
            let a = &self.places[chosen[i]];
            for j in 0..i {
                let b = &self.places[chosen[j]];
                let same_place = flipped[i] == flipped[j] && a.is_within(b, ALIKE.0, ALIKE.1);
                if same_place || (a.blank && b.blank) {
                    mask[i * n + j] = MASKED;
                    mask[j * n + i] = MASKED;
                }
            }
        }
        mask
    }

    /// Pairs without augmentation, for validation.
    pub fn plain(&self, pairs: &[Pair]) -> Result<Batch> {
        let drawn: Vec<_> = pairs.iter().map(|pair| (*pair, Augmentation::NONE)).collect();
        self.load(&drawn)
    }

    fn load(&self, drawn: &[(Pair, Augmentation)]) -> Result<Batch> {
        let input_px = self.preprocessing.input_px;
        let load = |frame: usize, augmentation: &Augmentation| -> Result<Vec<f32>> {
            let image = self.background.tactile_image(&self.dataset.frame(frame))?;
            let mut values = Vec::with_capacity(3 * input_px[0] * input_px[1]);
            augmentation.apply(&image, input_px, &mut values);
            if let Some(relight) = &self.relight {
                relight.apply(augmentation.flip_x, augmentation.flip_y, &mut values);
            }
            Ok(values)
        };
        let loaded = drawn
            .par_iter()
            .map(|(pair, augmentation)| Ok((load(pair.hole, augmentation)?, load(pair.peg, augmentation)?)))
            .collect::<Result<Vec<_>>>()?;
        let (holes, pegs): (Vec<_>, Vec<_>) = loaded.into_iter().unzip();
        Ok(Batch { holes: holes.concat(), pegs: pegs.concat(), mask: None })
    }
}

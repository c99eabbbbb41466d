//! Batches: drawn, decoded, differenced and augmented ahead of the step that needs them.

use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use tactile_data::dataset::touch::Side;

use crate::augmentation::Augmentation;
use crate::config::{Flips, TrainConfig};
use crate::error::{Error, Result};
use crate::mating::Pair;
use crate::pairs::Pairs;
use crate::smooth_field::{self, Field};

/// A training pair of a batch.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Its number among the training pairs.
    pub index: usize,
    /// What is done to its pictures.
    pub change: Change,
}

/// How a pair's pictures are changed before they are trained on.
#[derive(Clone, Debug)]
pub struct Change {
    /// Crop and flips.
    pub augmentation: Augmentation,
    /// A smooth field for the hole's picture and one for the peg's.
    pub fields: Option<[Field; 2]>,
}

/// One batch in memory: `[n, 3, height, width]` each, row `i` of one mates with row `i` of the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Pairs in it.
    pub n_pairs: usize,
    /// Values of the hole images.
    pub holes: Vec<f32>,
    /// Values of the peg images.
    pub pegs: Vec<f32>,
}

impl Batch {
    /// The batch as tensors of holes, then pegs, `[2 n_m, 3, height, width]`, in `n` micro-batches of nearly equal size.
    pub fn micro_batches(&self, n: usize, [width, height]: [usize; 2], device: &Device) -> Vec<Tensor<4>> {
        let length = 3 * width * height;
        let bound = |i: usize| i * self.n_pairs / n * length;
        let part = |i: usize| {
            let range = bound(i)..bound(i + 1);
            let both = [&self.holes[range.clone()], &self.pegs[range]].concat();
            let n = both.len() / length;
            Tensor::from_data(TensorData::new(both, [n, 3, height, width]), device)
        };
        (0..n).map(part).collect()
    }
}

impl Pairs<'_> {
    /// The batch of a step: drawn from `(seed, step)` alone, so that a resumed run sees the same batches as one
    /// without a stop. Smaller than the settings say where the dataset has fewer pairs.
    ///
    /// With probability `near_share` the next pair is a neighbour of the one before, on the same board a few
    /// mm and degrees away: the negatives that the filter must distinguish. Otherwise it is any pair. Blank pairs
    /// beyond `max_blank` are drawn again.
    pub fn batch(&self, config: &TrainConfig, step: usize) -> Result<Batch> {
        let drawn = self.draw(config, step)?;
        self.load(drawn.into_iter().map(|drawn| (self.training[drawn.index], drawn.change)).collect())
    }

    /// Which pairs a batch has, and how each is changed.
    pub fn draw(&self, config: &TrainConfig, step: usize) -> Result<Vec<Drawn>> {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(step as u64 + 1);
        let chosen = self.choose(config, &mut rng)?;
        let flips = config.flips != Flips::None;
        let drawn = chosen.iter().map(|index| {
            let augmentation = Augmentation::draw(&mut rng, config.min_crop, flips);
            Drawn { index: *index, change: Change { augmentation, fields: None } }
        });
        let mut drawn: Vec<Drawn> = drawn.collect();
        // A stream of its own: what is drawn above does not depend on it.
        rng.set_stream(u64::MAX - step as u64);
        if config.field_counts > 0.0 {
            let mut field = || smooth_field::draw(&mut rng, config.field_counts, &self.preprocessing);
            drawn.iter_mut().for_each(|drawn| drawn.change.fields = Some([field(), field()]));
        }
        Ok(drawn)
    }

    fn choose(&self, config: &TrainConfig, rng: &mut ChaCha8Rng) -> Result<Vec<usize>> {
        let max_blank = (config.max_blank * config.n_pairs as f64).round() as usize;
        let n_blank = self.places.iter().filter(|place| place.blank).count();
        let n_pairs = config.n_pairs.min(self.training.len() - n_blank + n_blank.min(max_blank));
        let n_least = 2 * config.n_micro_batches;
        if n_pairs < n_least {
            let expected = format!("at least {n_least} pairs in a batch, two for each micro-batch");
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

    /// Pairs without augmentation, for validation.
    pub fn plain(&self, pairs: &[Pair]) -> Result<Batch> {
        let plain = |pair: &Pair| (*pair, Change { augmentation: Augmentation::NONE, fields: None });
        self.load(pairs.iter().map(plain).collect())
    }

    fn load(&self, changed: Vec<(Pair, Change)>) -> Result<Batch> {
        let input_px = self.preprocessing.input_px;
        let load = |(pair, change): &(Pair, Change), side: Side| -> Result<Vec<f32>> {
            let Change { augmentation, fields } = change;
            let image = self.background.tactile_image(&self.frame(pair, side))?;
            let mut values = Vec::with_capacity(3 * input_px[0] * input_px[1]);
            augmentation.apply(&image, input_px, &mut values);
            if let Some(relighting) = &self.relighting {
                relighting.apply(augmentation.flip_x, augmentation.flip_y, &mut values);
            }
            if let Some(fields) = fields {
                smooth_field::add(&fields[usize::from(side == Side::Peg)], &mut values, input_px);
            }
            Ok(values)
        };
        let loaded = changed
            .par_iter()
            .map(|changed| Ok((load(changed, Side::Hole)?, load(changed, Side::Peg)?)))
            .collect::<Result<Vec<_>>>()?;
        let (holes, pegs): (Vec<_>, Vec<_>) = loaded.into_iter().unzip();
        Ok(Batch { n_pairs: changed.len(), holes: holes.concat(), pegs: pegs.concat() })
    }
}

//! Pairs from disk to batches: decoded, differenced and augmented ahead of the step that needs them.

use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use tactile_data::frame::{Background, Preprocessing};
use tactile_data::store::Dataset;
use tactile_data::touch::{Side, Touch};

use crate::augment::Augmentation;
use crate::error::{Error, Result};

/// The frames of one mating pair in a dataset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Index of the hole's frame.
    pub hole: usize,
    /// Index of the peg's frame.
    pub peg: usize,
}

/// The pairs of a dataset, split by board, and the statistics of its training frames.
#[derive(Debug)]
pub struct Pairs<'a> {
    dataset: &'a Dataset,
    background: Background,
    /// Preprocessing for the network: input size, mean and standard deviation of the training frames.
    pub preprocessing: Preprocessing,
    /// Pairs of the training boards.
    pub training: Vec<Pair>,
    /// Pairs of the held-out boards, board by board.
    pub held_out: Vec<Vec<Pair>>,
    neighbours: Vec<Vec<u32>>,
}

/// One batch in memory: `[n, 3, height, width]` each, row `i` of one mates with row `i` of the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Values of the hole images.
    pub holes: Vec<f32>,
    /// Values of the peg images.
    pub pegs: Vec<f32>,
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
}

impl<'a> Pairs<'a> {
    /// Finds the pairs: a hole frame and a peg frame of one part at one pose, next to each other in the
    /// index. Measures mean and variance over (at most 2,000) training frames. Fails on no pairs.
    pub fn new(dataset: &'a Dataset, input_px: [usize; 2]) -> Result<Self> {
        let held_out_boards = &dataset.meta().held_out;
        let mut training = Vec::new();
        let mut held_out = vec![Vec::new(); held_out_boards.len()];
        for index in 1..dataset.len() {
            let (first, second) = (dataset.touch(index - 1), dataset.touch(index));
            let Some(pair) = mate(index - 1, first, index, second) else { continue };
            match held_out_boards.iter().position(|board| Some(board) == first.part.as_ref()) {
                Some(board) => held_out[board].push(pair),
                None => training.push(pair),
            }
        }
        if training.is_empty() {
            let name = &dataset.meta().name;
            return Err(Error::invalid(name, "mating pairs of hole and peg frames to train on", "0 pairs"));
        }
        let preprocessing = measure(dataset, &training, input_px)?;
        // Decoded at twice the input size, so that a crop still has a pixel for each of the input's.
        let wide = Preprocessing { input_px: input_px.map(|n| 2 * n), ..preprocessing.clone() };
        let unusable =
            |e: tactile_data::Error| Error::invalid(&dataset.meta().name, "frames to train on", e.to_string());
        let background = Background::new(dataset.no_contact(), &wide).map_err(unusable)?;
        let neighbours = neighbours(dataset, &training);
        Ok(Self { dataset, background, preprocessing, training, held_out, neighbours })
    }

    /// The batch of a step: drawn from `(seed, step)` alone, so that a resumed run sees what an
    /// uninterrupted one does.
    ///
    /// With probability `near_share` the next pair is a neighbour of the one before, on the same board a few
    /// mm and degrees away: the negatives that the filter has to tell apart. Else it is any.
    pub fn batch(&self, seed: u64, step: usize, n_pairs: usize, min_scale: f32, near_share: f64) -> Result<Batch> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(step as u64 + 1);
        let mut chosen: Vec<usize> = Vec::with_capacity(n_pairs);
        let mut taken = vec![false; self.training.len()];
        while chosen.len() < n_pairs.min(self.training.len()) {
            let near = match chosen.last() {
                Some(&last) if rng.random_bool(near_share) => {
                    let close = &self.neighbours[last];
                    (!close.is_empty()).then(|| close[rng.random_range(0..close.len())] as usize)
                }
                _ => None,
            };
            let next = match near {
                Some(near) if !taken[near] => near,
                _ => rng.random_range(0..self.training.len()),
            };
            if !taken[next] {
                taken[next] = true;
                chosen.push(next);
            }
        }
        let drawn: Vec<(Pair, Augmentation)> =
            chosen.into_iter().map(|index| (self.training[index], Augmentation::draw(&mut rng, min_scale))).collect();
        self.load(&drawn)
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
            Ok(values)
        };
        let loaded = drawn
            .par_iter()
            .map(|(pair, augmentation)| Ok((load(pair.hole, augmentation)?, load(pair.peg, augmentation)?)))
            .collect::<Result<Vec<_>>>()?;
        let (holes, pegs): (Vec<_>, Vec<_>) = loaded.into_iter().unzip();
        Ok(Batch { holes: holes.concat(), pegs: pegs.concat() })
    }
}

/// The pair that two neighbouring frames make, if they do.
fn mate(first: usize, a: &Touch, second: usize, b: &Touch) -> Option<Pair> {
    let same_place = a.part.is_some() && a.part == b.part && a.part_from_sensor == b.part_from_sensor;
    match (a.side?, b.side?) {
        (Side::Hole, Side::Peg) if same_place => Some(Pair { hole: first, peg: second }),
        (Side::Peg, Side::Hole) if same_place => Some(Pair { hole: second, peg: first }),
        _ => None,
    }
}

/// Mean and standard deviation of each channel over training frames, f64 sums.
fn measure(dataset: &Dataset, training: &[Pair], input_px: [usize; 2]) -> Result<Preprocessing> {
    let background = Background::new(dataset.no_contact(), &Preprocessing::counts(input_px))?;
    let stride = training.len().div_ceil(1_000);
    let sums = training
        .par_iter()
        .step_by(stride)
        .flat_map_iter(|pair| [pair.hole, pair.peg])
        .map(|frame| {
            let image = background.tactile_image(&dataset.frame(frame))?;
            let n_pixels = input_px[0] * input_px[1];
            let mut sums = [[0.0_f64; 2]; 3];
            for (sum, plane) in sums.iter_mut().zip(image.planes.chunks_exact(n_pixels)) {
                for &value in plane {
                    sum[0] += f64::from(value) / n_pixels as f64;
                    sum[1] += f64::from(value).powi(2) / n_pixels as f64;
                }
            }
            Ok(sums)
        })
        .collect::<Result<Vec<_>>>()?;
    let mean_of =
        |channel: usize, power: usize| sums.iter().map(|sum| sum[channel][power]).sum::<f64>() / sums.len() as f64;
    let mean = [0, 1, 2].map(|channel| mean_of(channel, 0));
    let std = [0, 1, 2].map(|channel| (mean_of(channel, 1) - mean[channel].powi(2)).sqrt());
    if std.iter().any(|s| s.is_nan() || *s <= 0.1) {
        let got = format!("standard deviation {std:?} counts");
        return Err(Error::invalid(&dataset.meta().name, "frames that differ from the sensor at rest", got));
    }
    let meta = dataset.meta();
    let field_of_view_mm = [0, 1].map(|axis| meta.mm_per_px[axis] * meta.frame_px[axis] as f64);
    Ok(Preprocessing { input_px, field_of_view_mm, mean: mean.map(|m| m as f32), std: std.map(|s| s as f32) })
}

/// For each training pair, others on the same board 1 to 8 mm away and at most 40 degrees turned.
fn neighbours(dataset: &Dataset, training: &[Pair]) -> Vec<Vec<u32>> {
    let places: Vec<_> = training
        .iter()
        .map(|pair| {
            let touch = dataset.touch(pair.peg);
            (touch.part.as_deref(), touch.part_from_sensor)
        })
        .collect();
    places
        .par_iter()
        .map(|(part, pose)| {
            let Some(pose) = pose else { return Vec::new() };
            let is_near = |(other_part, other): &(Option<&str>, Option<tactile_data::se2::Se2>)| {
                let Some(other) = other else { return false };
                let turned = tactile_data::se2::wrap_angle(other.theta_rad - pose.theta_rad).to_degrees().abs();
                let apart = pose.distance_mm(other);
                other_part == part && apart < 8.0 && turned < 40.0 && (apart > 1.0 || turned > 10.0)
            };
            places.iter().enumerate().filter(|(_, place)| is_near(place)).map(|(i, _)| i as u32).collect()
        })
        .collect()
}

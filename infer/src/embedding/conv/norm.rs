//! Batch normalisation, the skip and the rectifier behind a convolution, forward and backward.

use std::sync::Mutex;

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::{Conv, arch};
use crate::embedding::threads;

/// Values that one thread takes at a time.
const CHUNK: usize = 1 << 14;

/// Mean and biased variance of each channel over a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Means, `[channels]`.
    pub mean: Vec<f32>,
    /// Variances, divided by the number of values, `[channels]`.
    pub variance: Vec<f32>,
}

/// The convolution of a batch and the statistics of its output, taken image by image while each is in
/// the cache and joined in order (Chan et al. 1979): the same bits on any number of threads.
pub fn forward_with_statistics(conv: &Conv, images: &[f32], weights: &[f32]) -> (Vec<f32>, Statistics) {
    let parts: Mutex<Vec<(usize, Vec<[f32; 2]>)>> = Mutex::new(Vec::new());
    let before = conv.forward(images, &conv.pack(weights), |at, out| {
        let part = moments(out, conv.n_out);
        if let Ok(mut parts) = parts.lock() {
            parts.push((at, part));
        }
    });
    let mut parts = parts.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    parts.sort_unstable_by_key(|(at, _)| *at);
    let n_pixels = conv.out_size().iter().product::<usize>() as f64;
    let mut joined = vec![[0.0_f64; 2]; conv.n_out];
    for (n_before, (_, part)) in parts.iter().enumerate() {
        let n_before = n_before as f64;
        for (joined, [mean, squares]) in joined.iter_mut().zip(part) {
            let apart = f64::from(*mean) - joined[0];
            joined[0] += apart / (n_before + 1.0);
            joined[1] += f64::from(*squares) + apart * apart * n_pixels * n_before / (n_before + 1.0);
        }
    }
    let n = (parts.len() as f64 * n_pixels).max(1.0);
    let mean = joined.iter().map(|[mean, _]| *mean as f32).collect();
    let variance = joined.iter().map(|[_, squares]| (squares / n) as f32).collect();
    (before, Statistics { mean, variance })
}

/// Mean of each channel, and the sum of squares about it.
fn moments(image: &[f32], n_channels: usize) -> Vec<[f32; 2]> {
    let n = (image.len() / n_channels) as f32;
    let sums = arch().dispatch(Sums { image, about: &vec![0.0; n_channels], squares: false });
    let mean: Vec<f32> = sums.into_iter().map(|sum| sum / n).collect();
    let squares = arch().dispatch(Sums { image, about: &mean, squares: true });
    mean.into_iter().zip(squares).map(|(mean, squares)| [mean, squares]).collect()
}

/// The distances of a channel's values from `about`, summed, or their squares.
struct Sums<'a> {
    image: &'a [f32],
    about: &'a [f32],
    squares: bool,
}

impl WithSimd for Sums<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vec<f32> {
        let n = self.about.len();
        let mut sums = vec![0.0_f32; n];
        for pixel in self.image.chunks_exact(n) {
            let (sums, pixel, about) = (&mut sums[..n], &pixel[..n], &self.about[..n]);
            if self.squares {
                for c in 0..n {
                    sums[c] += (pixel[c] - about[c]) * (pixel[c] - about[c]);
                }
            } else {
                for c in 0..n {
                    sums[c] += pixel[c] - about[c];
                }
            }
        }
        sums
    }
}

/// `scale * value + shift` of each channel, with what its gradient needs.
#[derive(Clone, Debug)]
pub struct Norm {
    mean: Vec<f32>,
    /// One over the deviation.
    inverse: Vec<f32>,
    scale: Vec<f32>,
    shift: Vec<f32>,
}

/// Gradients of a layer but for its convolution.
#[derive(Clone, Debug)]
pub struct NormGradient {
    /// The gradient of the convolution's output, NHWC.
    pub before: Vec<f32>,
    /// The gradient of the scale, `[channels]`.
    pub gamma: Vec<f32>,
    /// The gradient of the shift, `[channels]`.
    pub beta: Vec<f32>,
}

impl Norm {
    /// The normalisation with given statistics; `beta` may be empty where only gradients are asked for.
    pub fn new(statistics: &Statistics, gamma: &[f32], beta: &[f32], epsilon: f64) -> Self {
        let inverse: Vec<f32> =
            statistics.variance.iter().map(|v| (1.0 / (f64::from(*v) + epsilon).sqrt()) as f32).collect();
        let scale: Vec<f32> = gamma.iter().zip(&inverse).map(|(gamma, inverse)| gamma * inverse).collect();
        let shifts = beta.iter().zip(&statistics.mean).zip(&scale);
        let shift = shifts.map(|((beta, mean), scale)| beta - mean * scale).collect();
        Self { mean: statistics.mean.clone(), inverse, scale, shift }
    }

    /// `relu(scale * before + shift [+ skip])`, all NHWC.
    pub fn apply(&self, before: &[f32], skip: Option<&[f32]>) -> Vec<f32> {
        let n = self.scale.len();
        let chunk = n * (CHUNK / n).max(1);
        threads::made_by_blocks(
            before.len(),
            chunk,
            || (),
            |(), at, out| {
                let start = at * chunk;
                let before = &before[start..start + out.len()];
                let skip = skip.map(|skip| &skip[start..start + out.len()]);
                arch().dispatch(Apply { norm: self, before, skip, out });
            },
        )
    }

    /// Gradients from the gradient of the layer's output. `before` and `out` are what the forward pass made.
    pub fn gradient(&self, before: &[f32], out: &[f32], out_gradient: &[f32]) -> NormGradient {
        let n = self.scale.len();
        let chunk = n * (CHUNK / n).max(1);
        let chunks = || before.par_chunks(chunk).zip(out.par_chunks(chunk)).zip(out_gradient.par_chunks(chunk));
        // Sums of the gradient, and of the gradient times the normalised value, for each channel.
        let parts: Vec<[Vec<f32>; 2]> = chunks()
            .map(|((before, out), gradient)| arch().dispatch(GradientSums { norm: self, before, out, gradient }))
            .collect();
        let total = |which: usize, c: usize| parts.iter().map(|part| f64::from(part[which][c])).sum::<f64>();
        let beta: Vec<f32> = (0..n).map(|c| total(0, c) as f32).collect();
        let gamma: Vec<f32> = (0..n).map(|c| total(1, c) as f32 * self.inverse[c]).collect();
        let n_values = (before.len() / n).max(1) as f32;
        // d before = scale * (passed - mean(passed) - normalised * mean(passed * normalised))
        let slope: Vec<f32> = (0..n).map(|c| gamma[c] / n_values * self.inverse[c]).collect();
        let offset: Vec<f32> = (0..n).map(|c| beta[c] / n_values - slope[c] * self.mean[c]).collect();
        let of_block = |(): &mut (), at: usize, back: &mut [f32]| {
            let [before, out, gradient] = [before, out, out_gradient].map(|values| &values[at * chunk..][..back.len()]);
            arch().dispatch(Back { norm: self, slope: &slope, offset: &offset, before, out, gradient, back });
        };
        let back = threads::made_by_blocks(before.len(), chunk, || (), of_block);
        NormGradient { before: back, gamma, beta }
    }

    /// Adds the gradient that passes the rectifier: what the skip carries back to the input.
    pub fn add_rectified(&self, out: &[f32], out_gradient: &[f32], sum: &mut [f32]) {
        let chunks = sum.par_chunks_mut(CHUNK).zip(out.par_chunks(CHUNK)).zip(out_gradient.par_chunks(CHUNK));
        chunks.for_each(|((sum, out), gradient)| arch().dispatch(AddRectified { out, gradient, sum }));
    }
}

// The loops below are plain, over slices of one length: so the compiler makes wide vectors of them. They are no
// closures, because those are not compiled for the vectors of `dispatch`.

/// `gradient` where `out` is above zero, else zero.
#[inline(always)]
fn passed(out: f32, gradient: f32) -> f32 {
    if out > 0.0 { gradient } else { 0.0 }
}

struct Apply<'a> {
    norm: &'a Norm,
    before: &'a [f32],
    skip: Option<&'a [f32]>,
    out: &'a mut [f32],
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let n = self.norm.scale.len();
        let (scale, shift) = (&self.norm.scale[..n], &self.norm.shift[..n]);
        for (pixel, (out, before)) in self.out.chunks_exact_mut(n).zip(self.before.chunks_exact(n)).enumerate() {
            let (out, before) = (&mut out[..n], &before[..n]);
            match self.skip {
                Some(skip) => {
                    let skip = &skip[pixel * n..][..n];
                    for c in 0..n {
                        out[c] = (before[c] * scale[c] + shift[c] + skip[c]).max(0.0);
                    }
                }
                None => {
                    for c in 0..n {
                        out[c] = (before[c] * scale[c] + shift[c]).max(0.0);
                    }
                }
            }
        }
    }
}

/// For each channel the sum of what passes the rectifier, and of that times the distance from the mean.
struct GradientSums<'a> {
    norm: &'a Norm,
    before: &'a [f32],
    out: &'a [f32],
    gradient: &'a [f32],
}

impl WithSimd for GradientSums<'_> {
    type Output = [Vec<f32>; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> [Vec<f32>; 2] {
        let n = self.norm.mean.len();
        let mean = &self.norm.mean[..n];
        let (mut plain, mut weighted) = (vec![0.0_f32; n], vec![0.0_f32; n]);
        let pixels = self.before.chunks_exact(n).zip(self.out.chunks_exact(n)).zip(self.gradient.chunks_exact(n));
        for ((before, out), gradient) in pixels {
            let (before, out, gradient) = (&before[..n], &out[..n], &gradient[..n]);
            let (plain, weighted) = (&mut plain[..n], &mut weighted[..n]);
            for c in 0..n {
                let passed = passed(out[c], gradient[c]);
                plain[c] += passed;
                weighted[c] += passed * (before[c] - mean[c]);
            }
        }
        [plain, weighted]
    }
}

/// `scale * (passed - offset - slope * before)` of each channel.
struct Back<'a> {
    norm: &'a Norm,
    slope: &'a [f32],
    offset: &'a [f32],
    before: &'a [f32],
    out: &'a [f32],
    gradient: &'a [f32],
    back: &'a mut [f32],
}

impl WithSimd for Back<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let n = self.norm.scale.len();
        let (scale, slope, offset) = (&self.norm.scale[..n], &self.slope[..n], &self.offset[..n]);
        let pixels = self.before.chunks_exact(n).zip(self.out.chunks_exact(n)).zip(self.gradient.chunks_exact(n));
        for (back, ((before, out), gradient)) in self.back.chunks_exact_mut(n).zip(pixels) {
            let (back, before, out, gradient) = (&mut back[..n], &before[..n], &out[..n], &gradient[..n]);
            for c in 0..n {
                back[c] = scale[c] * (passed(out[c], gradient[c]) - offset[c] - slope[c] * before[c]);
            }
        }
    }
}

struct AddRectified<'a> {
    out: &'a [f32],
    gradient: &'a [f32],
    sum: &'a mut [f32],
}

impl WithSimd for AddRectified<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let n = self.sum.len();
        let (sum, out, gradient) = (self.sum, &self.out[..n], &self.gradient[..n]);
        for i in 0..n {
            sum[i] += passed(out[i], gradient[i]);
        }
    }
}

//! Batch normalisation, the skip and the rectifier behind a convolution, forward and backward.

use std::sync::Mutex;

use pulp::Arch;
use rayon::prelude::*;

use super::Conv;

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

/// The convolution of a batch and the statistics of its output, taken image by image while each lies in
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
    Arch::new().dispatch(|| moments_of_lines(image, n_channels))
}

#[inline(always)]
fn moments_of_lines(image: &[f32], n_channels: usize) -> Vec<[f32; 2]> {
    let mut mean = vec![0.0_f32; n_channels];
    for pixel in image.chunks_exact(n_channels) {
        mean.iter_mut().zip(pixel).for_each(|(mean, value)| *mean += value);
    }
    let n = (image.len() / n_channels) as f32;
    mean.iter_mut().for_each(|mean| *mean /= n);
    let mut squares = vec![0.0_f32; n_channels];
    for pixel in image.chunks_exact(n_channels) {
        for ((sum, value), mean) in squares.iter_mut().zip(pixel).zip(&mean) {
            *sum += (value - mean) * (value - mean);
        }
    }
    mean.into_iter().zip(squares).map(|(mean, squares)| [mean, squares]).collect()
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
    /// Of the convolution's output, NHWC.
    pub before: Vec<f32>,
    /// Of the scale, `[channels]`.
    pub gamma: Vec<f32>,
    /// Of the shift, `[channels]`.
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
        let mut out = vec![0.0; before.len()];
        out.par_chunks_mut(chunk).enumerate().for_each(|(at, out)| {
            let start = at * chunk;
            let before = &before[start..start + out.len()];
            let skip = skip.map(|skip| &skip[start..start + out.len()]);
            Arch::new().dispatch(|| self.apply_to(before, skip, out));
        });
        out
    }

    #[inline(always)]
    fn apply_to(&self, before: &[f32], skip: Option<&[f32]>, out: &mut [f32]) {
        let n = self.scale.len();
        for (pixel, (out, before)) in out.chunks_exact_mut(n).zip(before.chunks_exact(n)).enumerate() {
            let affine = before.iter().zip(&self.scale).zip(&self.shift);
            let affine = affine.map(|((value, scale), shift)| value * scale + shift);
            match skip {
                Some(skip) => {
                    let skip = &skip[pixel * n..(pixel + 1) * n];
                    out.iter_mut().zip(affine).zip(skip).for_each(|((o, v), s)| *o = (v + s).max(0.0));
                }
                None => out.iter_mut().zip(affine).for_each(|(o, v)| *o = v.max(0.0)),
            }
        }
    }

    /// Gradients from that of the layer's output. `before` and `out` are what the forward pass made.
    pub fn gradient(&self, before: &[f32], out: &[f32], out_gradient: &[f32]) -> NormGradient {
        let n = self.scale.len();
        let chunk = n * (CHUNK / n).max(1);
        let chunks = || before.par_chunks(chunk).zip(out.par_chunks(chunk)).zip(out_gradient.par_chunks(chunk));
        // Sums of the gradient, and of the gradient times the normalised value, for each channel.
        let parts: Vec<[Vec<f32>; 2]> = chunks()
            .map(|((before, out), gradient)| Arch::new().dispatch(|| self.sums(before, out, gradient)))
            .collect();
        let total = |which: usize, c: usize| parts.iter().map(|part| f64::from(part[which][c])).sum::<f64>();
        let beta: Vec<f32> = (0..n).map(|c| total(0, c) as f32).collect();
        let gamma: Vec<f32> = (0..n).map(|c| total(1, c) as f32 * self.inverse[c]).collect();
        let n_values = (before.len() / n).max(1) as f32;
        // d before = scale * (passed - mean(passed) - normalised * mean(passed * normalised))
        let slope: Vec<f32> = (0..n).map(|c| gamma[c] / n_values * self.inverse[c]).collect();
        let offset: Vec<f32> = (0..n).map(|c| beta[c] / n_values - slope[c] * self.mean[c]).collect();
        let mut back = vec![0.0; before.len()];
        back.par_chunks_mut(chunk).zip(chunks()).for_each(|(back, ((before, out), gradient))| {
            Arch::new().dispatch(|| self.back(&slope, &offset, [before, out, gradient], back));
        });
        NormGradient { before: back, gamma, beta }
    }

    /// For each channel the sum of what passes the rectifier, and of that times the distance from the mean.
    #[inline(always)]
    fn sums(&self, before: &[f32], out: &[f32], gradient: &[f32]) -> [Vec<f32>; 2] {
        let n = self.scale.len();
        let (mut plain, mut weighted) = (vec![0.0_f32; n], vec![0.0_f32; n]);
        for ((before, out), gradient) in before.chunks_exact(n).zip(out.chunks_exact(n)).zip(gradient.chunks_exact(n)) {
            let values = before.iter().zip(out).zip(gradient).zip(&self.mean);
            for ((plain, weighted), (((before, out), gradient), mean)) in
                plain.iter_mut().zip(&mut weighted).zip(values)
            {
                let passed = if *out > 0.0 { *gradient } else { 0.0 };
                *plain += passed;
                *weighted += passed * (before - mean);
            }
        }
        [plain, weighted]
    }

    #[inline(always)]
    fn back(&self, slope: &[f32], offset: &[f32], [before, out, gradient]: [&[f32]; 3], back: &mut [f32]) {
        let n = self.scale.len();
        let pixels = before.chunks_exact(n).zip(out.chunks_exact(n)).zip(gradient.chunks_exact(n));
        for (back, ((before, out), gradient)) in back.chunks_exact_mut(n).zip(pixels) {
            let constants = self.scale.iter().zip(slope).zip(offset);
            let values = before.iter().zip(out).zip(gradient).zip(constants);
            for (back, (((before, out), gradient), ((scale, slope), offset))) in back.iter_mut().zip(values) {
                let passed = if *out > 0.0 { *gradient } else { 0.0 };
                *back = scale * (passed - offset - slope * before);
            }
        }
    }

    /// Adds the gradient that passes the rectifier: what the skip carries back to the input.
    pub fn add_rectified(&self, out: &[f32], out_gradient: &[f32], sum: &mut [f32]) {
        Arch::new().dispatch(|| {
            for ((sum, out), gradient) in sum.iter_mut().zip(out).zip(out_gradient) {
                *sum += if *out > 0.0 { *gradient } else { 0.0 };
            }
        });
    }
}

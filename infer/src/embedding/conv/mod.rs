//! Convolutions on the CPU: forward, gradient of the input, gradient of the weights.
//!
//! Written for this network because a general library's kernels lose half their time to copying windows
//! (NOTES.md has the figures). Plain slices, no tensors: `op` makes burn operations of them, and
//! [`crate::embedding::encoder`] an encoder without burn.

mod axis;
#[cfg(test)]
mod bodies;
#[cfg(feature = "wgpu")]
mod card;
#[cfg(feature = "burn")]
mod norm;
#[cfg(feature = "burn")]
pub mod op;
mod padded;
mod plan;
mod tile;
mod winograd;

use std::cell::Cell;

use pulp::Arch;
use rayon::prelude::*;

pub use padded::Padded;
use plan::Gather;
pub use plan::Panels;
use winograd::{Scratch, Windows};

use crate::embedding::threads;

/// Images that share one partial sum of the weights' gradient. A constant, so that the sum does not
/// depend on the number of threads.
const IMAGES_A_PART: usize = 32;

/// The widest vectors at hand; in a test the vectors that it asks for on its thread.
#[inline(always)]
fn arch() -> Arch {
    #[cfg(test)]
    if let Some(arch) = bodies::asked_for() {
        return arch;
    }
    Arch::new()
}

/// `weight([ky, kx], input channel, output channel)` gives each weight.
type Weight<'a> = dyn Fn([usize; 2], usize, usize) -> f32 + Sync + 'a;

/// Weights laid out for one of the two ways to compute a convolution.
#[derive(Clone, Debug)]
pub enum Packed {
    /// As it is defined.
    Direct(Panels),
    /// With fewer products.
    Winograd(winograd::Packed),
}

impl Packed {
    /// Images that one thread takes together.
    fn images_at_once(&self) -> usize {
        match self {
            Self::Direct(_) => 1,
            Self::Winograd(packed) => packed.windows().images_at_once(),
        }
    }

    /// Some images, `[n, height, width, channels]`, at most [`Self::images_at_once`] of them, into `out`.
    fn correlate(&self, images: &[f32], scratch: &mut Scratch, out: &mut [f32]) {
        match self {
            Self::Direct(panels) => panels.correlate(images, &mut scratch.padded, out),
            Self::Winograd(packed) => packed.correlate(images, scratch, out),
        }
    }
}

/// A square convolution without bias, padded by half its kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conv {
    /// Channels of the input.
    pub n_in: usize,
    /// Channels of the output.
    pub n_out: usize,
    /// Side of the kernel, odd.
    pub kernel: usize,
    /// Step between outputs, pixels.
    pub stride: usize,
    /// Height and width of the input, pixels.
    pub size: [usize; 2],
}

impl Conv {
    /// Height and width of the output, pixels.
    pub fn out_size(&self) -> [usize; 2] {
        self.size.map(|n| n.div_ceil(self.stride))
    }

    fn in_length(&self) -> usize {
        self.size[0] * self.size[1] * self.n_in
    }

    fn out_length(&self) -> usize {
        self.out_size()[0] * self.out_size()[1] * self.n_out
    }

    /// Weights laid out for the forward pass. `weights`: `[n_out, n_in, kernel, kernel]`, as PyTorch has them.
    pub fn pack(&self, weights: &[f32]) -> Packed {
        let weight = |tap, c, out| weights[self.place(tap, c, out)];
        match Windows::for_conv(self) {
            Some(windows) => Packed::Winograd(winograd::Packed::new(windows, &weight)),
            None => Packed::Direct(self.panels(weights)),
        }
    }

    /// The weights as [`Packed::Direct`] reads them.
    pub fn panels(&self, weights: &[f32]) -> Panels {
        let weight = |_, tap, c, out| weights[self.place(tap, c, out)];
        Panels::new(vec![Gather::forward(self)], self.n_out, weight)
    }

    /// Where a weight is in `[n_out, n_in, kernel, kernel]`.
    fn place(&self, [ky, kx]: [usize; 2], c: usize, out: usize) -> usize {
        ((out * self.n_in + c) * self.kernel + ky) * self.kernel + kx
    }

    /// `[n, height, width, n_in]` -> `[n, out height, out width, n_out]`; `finish` sees each image of the
    /// result while it is in the cache, with its index.
    pub fn forward(&self, images: &[f32], packed: &Packed, finish: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
        correlate(images, packed, [self.in_length(), self.out_length()], finish)
    }

    /// Gradient of the input from the gradient of the output, both NHWC.
    pub fn input_gradient(&self, gradient: &[f32], weights: &[f32]) -> Vec<f32> {
        // At stride 1 it is the convolution with the weights rotated by half a turn, inputs and outputs exchanged.
        let packed = match Windows::for_conv(&Self { n_in: self.n_out, n_out: self.n_in, ..*self }) {
            Some(windows) => {
                let turned = |[ky, kx]: [usize; 2], c, out| weights[self.place([2 - ky, 2 - kx], out, c)];
                Packed::Winograd(winograd::Packed::new(windows, &turned))
            }
            None => {
                let weight = |_, tap, c, out| weights[self.place(tap, out, c)];
                Packed::Direct(Panels::new(Gather::backward(self), self.n_in, weight))
            }
        };
        correlate(gradient, &packed, [self.out_length(), self.in_length()], |_, _| ())
    }

    /// Gradient of the weights, `[n_out, n_in, kernel, kernel]`.
    pub fn weight_gradient(&self, images: &[f32], gradient: &[f32]) -> Vec<f32> {
        if let Some(windows) = Windows::for_conv(self) {
            return winograd::weight_gradient(&windows, images, gradient);
        }
        let gather = Gather::forward(self);
        let parts = images
            .par_chunks(IMAGES_A_PART * self.in_length())
            .zip(gradient.par_chunks(IMAGES_A_PART * self.out_length()));
        let parts = parts.map(|(images, gradient)| gather.outer(images, gradient, self.n_out)).collect();
        let rows = self.kernel * self.kernel * self.n_in; // [ky, kx, n_in]
        let sums = sum(parts);
        let mut weights = vec![0.0; self.n_out * rows];
        for row in 0..rows {
            let (tap, c) = (row / self.n_in, row % self.n_in);
            for out in 0..self.n_out {
                weights[self.place([tap / self.kernel, tap % self.kernel], c, out)] = sums[row * self.n_out + out];
            }
        }
        weights
    }
}

thread_local! {
    static SCRATCH: Cell<Scratch> = Cell::default();
}

/// The thread's scratch space, while a convolution has it.
struct Kept(Scratch);

impl Drop for Kept {
    fn drop(&mut self) {
        SCRATCH.set(std::mem::take(&mut self.0));
    }
}

/// Images of `lengths[0]` values through a convolution to images of `lengths[1]`.
fn correlate(
    images: &[f32],
    packed: &Packed,
    lengths: [usize; 2],
    finish: impl Fn(usize, &mut [f32]) + Sync,
) -> Vec<f32> {
    let n = packed.images_at_once();
    let n_values = images.len() / lengths[0] * lengths[1];
    threads::made_by_blocks(
        n_values,
        n * lengths[1],
        || Kept(SCRATCH.take()),
        |Kept(scratch), at, out| {
            let images = &images[at * n * lengths[0]..][..out.len() / lengths[1] * lengths[0]];
            packed.correlate(images, scratch, out);
            out.chunks_exact_mut(lengths[1]).enumerate().for_each(|(i, out)| finish(n * at + i, out));
        },
    )
}

/// The parts' sum, value by value, in their order.
fn sum(parts: Vec<Vec<f32>>) -> Vec<f32> {
    /// Values that one thread takes at a time.
    const CHUNK: usize = 1 << 12;
    let mut sums = vec![0.0; parts.first().map_or(0, Vec::len)];
    sums.par_chunks_mut(CHUNK).enumerate().for_each(|(at, sums)| {
        for part in &parts {
            sums.iter_mut().zip(&part[at * CHUNK..]).for_each(|(sum, value)| *sum += value);
        }
    });
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, in f64: the window's products summed for each output.
    pub(super) fn direct(conv: &Conv, image: &[f32], weights: &[f32]) -> Vec<f64> {
        let ([height, width], [rows, columns]) = (conv.size, conv.out_size());
        let pad = conv.kernel / 2;
        let mut out = vec![0.0; rows * columns * conv.n_out];
        for (at, value) in out.iter_mut().enumerate() {
            let (o, x, y) = (at % conv.n_out, at / conv.n_out % columns, at / conv.n_out / columns);
            for ky in 0..conv.kernel {
                for kx in 0..conv.kernel {
                    let (iy, ix) = (y * conv.stride + ky, x * conv.stride + kx);
                    if iy < pad || ix < pad || iy - pad >= height || ix - pad >= width {
                        continue;
                    }
                    for c in 0..conv.n_in {
                        let weight = weights[((o * conv.n_in + c) * conv.kernel + ky) * conv.kernel + kx];
                        let pixel = image[((iy - pad) * width + ix - pad) * conv.n_in + c];
                        *value += f64::from(weight) * f64::from(pixel);
                    }
                }
            }
        }
        out
    }

    pub(super) fn values(n: usize, seed: f32) -> Vec<f32> {
        (0..n).map(|i| (seed * (i as f32 + 1.0)).sin()).collect()
    }

    pub(super) fn layers() -> Vec<Conv> {
        let conv = |n_in, n_out, kernel, stride, size| Conv { n_in, n_out, kernel, stride, size };
        vec![
            conv(3, 32, 5, 2, [30, 40]),
            conv(32, 33, 3, 2, [15, 20]),
            conv(4, 64, 3, 1, [8, 10]),
            conv(40, 7, 1, 1, [4, 5]),
            conv(2, 3, 3, 2, [1, 7]),
            conv(5, 4, 5, 2, [9, 3]),
            conv(3, 2, 3, 3, [8, 7]),
            conv(32, 16, 3, 1, [4, 5]),
            conv(16, 48, 3, 1, [5, 2]),
            conv(32, 32, 3, 1, [9, 11]),
            conv(16, 16, 3, 1, [1, 4]),
        ]
    }

    #[test]
    pub(super) fn forward_agrees_with_the_definition() {
        for conv in layers() {
            let images = values(2 * conv.in_length(), 0.37);
            let weights = values(conv.n_in * conv.n_out * conv.kernel.pow(2), 0.23);
            let expected: Vec<f64> =
                images.chunks(conv.in_length()).flat_map(|image| direct(&conv, image, &weights)).collect();
            // Some 300 products of order 1, each rounded to 6e-8; the longest windows round several times as coarsely.
            let out = conv.forward(&images, &conv.pack(&weights), |_, _| ());
            assert_eq!(out.len(), expected.len());
            let largest = out.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            assert!(largest < 1e-4, "{conv:?}: {largest}");
        }
    }

    /// The convolution is linear in its input and in its weights, so `<g, conv(x + dx, w)> - <g, conv(x, w)>` is
    /// exactly the inner product of the gradient with the change.
    #[test]
    pub(super) fn gradients_are_the_adjoints_of_the_definition() {
        for conv in layers() {
            let (n, n_weights) = (3, conv.n_in * conv.n_out * conv.kernel.pow(2));
            let (images, gradient) = (values(n * conv.in_length(), 0.37), values(n * conv.out_length(), 0.71));
            let weights = values(n_weights, 0.23);
            let inner = |images: &[f32], weights: &[f32]| -> f64 {
                let out = images.chunks(conv.in_length()).flat_map(|image| direct(&conv, image, weights));
                out.zip(&gradient).map(|(a, b)| a * f64::from(*b)).sum()
            };
            let of_input = conv.input_gradient(&gradient, &weights);
            for at in [0, 1, n * conv.in_length() / 2, n * conv.in_length() - 1] {
                let mut unit = vec![0.0; images.len()];
                unit[at] = 1.0;
                let expected = inner(&unit, &weights);
                assert!((f64::from(of_input[at]) - expected).abs() < 5e-5, "{conv:?} input {at}");
            }
            let of_weights = conv.weight_gradient(&images, &gradient);
            for at in [0, 1, n_weights / 2, n_weights - 1] {
                let mut unit = vec![0.0; n_weights];
                unit[at] = 1.0;
                let expected = inner(&images, &unit);
                assert!((f64::from(of_weights[at]) - expected).abs() < 5e-5, "{conv:?} weight {at}");
            }
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        for (n_in, n_out, n_images) in [(3, 5, 150), (16, 16, 400)] {
            let conv = Conv { n_in, n_out, kernel: 3, stride: 1, size: [6, 5] };
            let images = values(n_images * conv.in_length(), 0.37);
            let gradient = values(n_images * conv.out_length(), 0.71);
            let on = |n: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
                pool.install(|| conv.weight_gradient(&images, &gradient))
            };
            assert_eq!(on(1), on(3));
            // In no pool, and with images that fill no block.
            let few = [37 * conv.in_length(), 37 * conv.out_length()];
            let alone = conv.weight_gradient(&images[..few[0]], &gradient[..few[1]]);
            let weights = values(n_in * n_out * 9, 0.23);
            let out = conv.forward(&images[..few[0]], &conv.pack(&weights), |_, _| ());
            let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let (a, b) = (inner(&alone, &weights), inner(&out, &gradient[..few[1]]));
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }
}

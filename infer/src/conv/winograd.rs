//! 3x3 convolutions of stride 1 with four products where the definition has nine.
//!
//! Winograd's F(2x2, 3x3) (Lavin and Gray 2016, Sec. 4.1): each 4x4 window of the input becomes 16 numbers a channel,
//! which meet 16 matrices made of the weights; 16 sums become 2x2 outputs. In f32 it rounds about twice as coarsely as
//! the definition.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::threads;

use super::maps::{back_into_window, both_ways, into_window, narrow, out_of_window, widen};
use super::plan::{Columns, with_rows};
use super::tile::{Sums, columns, gather, lanes, outer, rows};
use super::{Conv, Weight};

/// Products of a window: a side of four, squared.
const N: usize = 16;

/// Windows that are taken together, about: their 16 matrices and the sums share a second-level cache of 1 MiB.
const WINDOWS: usize = 48;

/// Windows of a part of the weights' gradient that are taken together, about: more, because sums are read and written
/// once for each lot.
const WINDOWS_BACK: usize = 96;

/// Where the windows of a convolution lie.
#[derive(Clone, Copy, Debug)]
pub struct Windows {
    n_in: usize,
    n_out: usize,
    size: [usize; 2],
}

/// What one thread keeps between images.
#[derive(Debug, Default)]
pub struct Scratch {
    pub padded: Vec<f32>,
    windows: Vec<f32>,
    sums: Vec<f32>,
}

impl Windows {
    /// The windows of a convolution; `None` where this method does not suit it.
    pub fn of(conv: &Conv) -> Option<Self> {
        let suits = conv.kernel == 3
            && conv.stride == 1
            && conv.n_in.is_multiple_of(N)
            && conv.n_out.is_multiple_of(N)
            && conv.size.iter().all(|n| *n >= 2);
        suits.then_some(Self { n_in: conv.n_in, n_out: conv.n_out, size: conv.size })
    }

    /// Windows of an image, rows and columns of them.
    fn counts(&self) -> [usize; 2] {
        self.size.map(|n| n.div_ceil(2))
    }

    fn n_windows(&self) -> usize {
        self.counts()[0] * self.counts()[1]
    }

    /// Images to take together for about so many windows.
    fn images_for(&self, windows: usize) -> usize {
        (windows / self.n_windows()).max(1)
    }

    /// Images that [`Packed::correlate`] likes to take together.
    pub fn images_at_once(&self) -> usize {
        self.images_for(WINDOWS)
    }

    fn padded_length(&self, n_channels: usize) -> usize {
        let [rows, columns] = self.counts();
        (2 * rows + 2) * (2 * columns + 2) * n_channels
    }

    /// The windows of some images as 16 matrices `[n_images * n_windows, n_channels]` in a row.
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, images: &[f32], padded: &mut Vec<f32>, windows: &mut Vec<f32>) {
        let (n_channels, [rows, columns], [height, width]) = (self.n_in, self.counts(), self.size);
        let length = height * width * n_channels;
        let n_rows = images.len() / length * self.n_windows();
        padded.clear();
        padded.resize(self.padded_length(n_channels), 0.0);
        windows.resize(N * n_rows * n_channels, 0.0);
        let line = (2 * columns + 2) * n_channels;
        for (at, image) in images.chunks_exact(length).enumerate() {
            for (y, pixels) in image.chunks_exact(width * n_channels).enumerate() {
                padded[(y + 1) * line + n_channels..][..width * n_channels].copy_from_slice(pixels);
            }
            for window in 0..rows * columns {
                let corner = window / columns * 2 * line + window % columns * 2 * n_channels;
                let row = at * rows * columns + window;
                for channel in (0..n_channels).step_by(S::F32_LANES) {
                    let mut read = [[simd.splat_f32s(0.0); 4]; 4];
                    for y in 0..4 {
                        for x in 0..4 {
                            read[y][x] = load::<S>(&padded[corner + y * line + x * n_channels + channel..]);
                        }
                    }
                    let made = both_ways!(simd: S, into_window, read, 4 -> 4);
                    for k in 0..N {
                        store::<S>(made[k / 4][k % 4], &mut windows[(k * n_rows + row) * n_channels + channel..]);
                    }
                }
            }
        }
    }
}

/// The 16 matrices of a layer's weights, each in panels as [`gather`] reads them.
#[derive(Clone, Debug)]
pub struct Packed {
    windows: Windows,
    /// `[blocks, 16, n_in, columns]`, a block being a tile's columns of output channels.
    panels: Vec<f32>,
}

impl Packed {
    /// `weight([ky, kx], input channel, output channel)` gives each weight.
    pub fn new(windows: Windows, weight: &Weight<'_>) -> Self {
        Self { windows, panels: Arch::new().dispatch(Pack { windows, weight }) }
    }

    /// How its windows lie.
    pub fn windows(&self) -> &Windows {
        &self.windows
    }

    /// Some images, `[n, height, width, n_in]`, into `out`.
    pub fn correlate(&self, images: &[f32], scratch: &mut Scratch, out: &mut [f32]) {
        Arch::new().dispatch(Correlate { packed: self, images, scratch, out });
    }
}

struct Pack<'a> {
    windows: Windows,
    weight: &'a Weight<'a>,
}

impl WithSimd for Pack<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vec<f32> {
        let Windows { n_in, n_out, .. } = self.windows;
        let width = columns::<S>();
        let mut panels = vec![0.0; N * n_out.div_ceil(width) * n_in * width];
        threads::for_each_block(
            &mut panels,
            N * n_in * width,
            || (),
            |(), block, panels| {
                for (column, out) in (block * width..n_out.min((block + 1) * width)).enumerate() {
                    for c in 0..n_in {
                        // G g G^T
                        let kernel: [[f32; 3]; 3] =
                            std::array::from_fn(|ky| std::array::from_fn(|kx| (self.weight)([ky, kx], c, out)));
                        let lines = kernel.map(widen);
                        let made: [[f32; 4]; 4] =
                            std::array::from_fn(|x| widen([lines[0][x], lines[1][x], lines[2][x]]));
                        for k in 0..N {
                            panels[(k * n_in + c) * width + column] = made[k % 4][k / 4];
                        }
                    }
                }
            },
        );
        panels
    }
}

#[inline(always)]
fn load<S: Simd>(values: &[f32]) -> S::f32s {
    S::as_simd_f32s(&values[..S::F32_LANES]).0[0]
}

#[inline(always)]
fn store<S: Simd>(value: S::f32s, to: &mut [f32]) {
    S::as_mut_simd_f32s(&mut to[..S::F32_LANES]).0[0] = value;
}

struct Correlate<'a> {
    packed: &'a Packed,
    images: &'a [f32],
    scratch: &'a mut Scratch,
    out: &'a mut [f32],
}

impl WithSimd for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Packed { windows, panels } = self.packed;
        let Scratch { padded, windows: matrices, sums } = self.scratch;
        let Windows { n_in, n_out, size: [height, width] } = *windows;
        windows.transform(simd, self.images, padded, matrices);
        let n_rows = matrices.len() / N / n_in;
        sums.resize(N * n_rows * n_out, 0.0);
        for (k, sums) in sums.chunks_exact_mut(n_rows * n_out).enumerate() {
            let matrix = &matrices[k * n_rows * n_in..][..n_rows * n_in];
            for first in (0..n_out).step_by(columns::<S>()) {
                let panel = &panels[(first * N + k * columns::<S>()) * n_in..][..n_in * columns::<S>()];
                let (panel, _) = S::as_simd_f32s(panel);
                for at in (0..n_rows).step_by(rows::<S>()) {
                    let n = rows::<S>().min(n_rows - at);
                    let sums = &mut sums[at * n_out + first..];
                    let matrix = &matrix[at * n_in..];
                    with_rows!(n, multiply_tile::<S>(simd, matrix, n_in, panel, [first, n_out], sums));
                }
            }
        }
        let columns = windows.counts()[1];
        for row in 0..n_rows {
            let (image, window) = (row / windows.n_windows(), row % windows.n_windows());
            let [top, left] = [window / columns * 2, window % columns * 2];
            for channel in (0..n_out).step_by(S::F32_LANES) {
                let mut read = [[simd.splat_f32s(0.0); 4]; 4];
                for k in 0..N {
                    read[k / 4][k % 4] = load::<S>(&sums[(k * n_rows + row) * n_out + channel..]);
                }
                let made = both_ways!(simd: S, out_of_window, read, 4 -> 2);
                for k in 0..4 {
                    let [y, x] = [top + k / 2, left + k % 2];
                    if y < height && x < width {
                        let at = ((image * height + y) * width + x) * n_out + channel;
                        store::<S>(made[k / 2][k % 2], &mut self.out[at..]);
                    }
                }
            }
        }
    }
}

/// Some rows of a matrix times one panel of another.
#[expect(clippy::too_many_arguments, reason = "an inner loop: everything in registers")]
#[inline(always)]
fn multiply_tile<S: Simd, const ROWS: usize>(
    simd: S,
    matrix: &[f32],
    n_in: usize,
    panel: &[S::f32s],
    [first, n_out]: [usize; 2],
    sums: &mut [f32],
) {
    let bases: [usize; ROWS] = std::array::from_fn(|i| i * n_in);
    let made: Sums<S, ROWS> = gather(simd, matrix, &bases, &[0], n_in, panel);
    for (made, line) in made.iter().zip(sums.chunks_mut(n_out)) {
        let values: &[f32] = lanes::<S>(made);
        let n = values.len().min(n_out - first);
        line[..n].copy_from_slice(&values[..n]);
    }
}

/// Gradient of the weights of some images, as it is before `G^T u G`: `[16, blocks, n_in, columns]`, a block being a
/// tile's columns of output channels.
pub fn outer_windows(windows: &Windows, images: &[f32], gradient: &[f32]) -> Vec<f32> {
    Arch::new().dispatch(Outer { windows, images, gradient })
}

/// The gradient of each weight, `[n_out, n_in, 3, 3]`, from the sum of [`outer_windows`].
pub fn weights_of_windows(windows: &Windows, sums: &[f32]) -> Vec<f32> {
    let Windows { n_in, n_out, .. } = *windows;
    let width = Arch::new().dispatch(Columns);
    let n_blocks = n_out.div_ceil(width);
    let mut weights = vec![0.0; n_out * n_in * 9];
    weights.par_chunks_mut(9).with_min_len(1 << 12).enumerate().for_each(|(at, kernel)| {
        let (out, c) = (at / n_in, at % n_in);
        let first = (out / width * n_in + c) * width + out % width;
        let square: [[f32; 4]; 4] =
            std::array::from_fn(|y| std::array::from_fn(|x| sums[(4 * y + x) * n_blocks * n_in * width + first]));
        let lines = square.map(narrow);
        let columns: [[f32; 3]; 3] = std::array::from_fn(|x| narrow(lines.map(|line| line[x])));
        for (tap, value) in kernel.iter_mut().enumerate() {
            *value = columns[tap % 3][tap / 3];
        }
    });
    weights
}

struct Outer<'a> {
    windows: &'a Windows,
    images: &'a [f32],
    gradient: &'a [f32],
}

impl WithSimd for Outer<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let windows = self.windows;
        let Windows { n_in, n_out, size: [height, width] } = *windows;
        let (n_blocks, n_columns) = (n_out.div_ceil(columns::<S>()), columns::<S>());
        let mut sums = vec![0.0; N * n_in * n_blocks * n_columns]; // [16, blocks, n_in, columns]
        let mut scratch = Scratch::default();
        let at_once = windows.images_for(WINDOWS_BACK);
        let lots = self.images.chunks(at_once * height * width * n_in);
        for (images, gradient) in lots.zip(self.gradient.chunks(at_once * height * width * n_out)) {
            windows.transform(simd, images, &mut scratch.padded, &mut scratch.windows);
            let n_rows = scratch.windows.len() / N / n_in;
            let panels = &mut scratch.sums; // [16, blocks, rows, columns]
            panels.resize(N * n_blocks * n_rows * n_columns, 0.0);
            for row in 0..n_rows {
                let (image, window) = (row / windows.n_windows(), row % windows.n_windows());
                let per_line = windows.counts()[1];
                let [top, left] = [window / per_line * 2, window % per_line * 2];
                for channel in (0..n_out).step_by(S::F32_LANES) {
                    let mut read = [[simd.splat_f32s(0.0); 2]; 2];
                    for k in 0..4 {
                        let [y, x] = [top + k / 2, left + k % 2];
                        if y < height && x < width {
                            let at = ((image * height + y) * width + x) * n_out + channel;
                            read[k / 2][k % 2] = load::<S>(&gradient[at..]);
                        }
                    }
                    let made = both_ways!(simd: S, back_into_window, read, 2 -> 4);
                    let (block, within) = (channel / n_columns, channel % n_columns);
                    for k in 0..N {
                        let at = ((k * n_blocks + block) * n_rows + row) * n_columns + within;
                        store::<S>(made[k / 4][k % 4], &mut panels[at..]);
                    }
                }
            }
            let bases: Vec<usize> = (0..n_rows).map(|row| row * n_in).collect();
            for k in 0..N {
                let matrix = &scratch.windows[k * n_rows * n_in..][..n_rows * n_in];
                for block in 0..n_blocks {
                    let at = k * n_blocks + block;
                    let (panel, _) = S::as_simd_f32s(&panels[at * n_rows * n_columns..][..n_rows * n_columns]);
                    let sums = &mut sums[at * n_in * n_columns..][..n_in * n_columns];
                    for c in (0..n_in).step_by(rows::<S>()) {
                        let n = rows::<S>().min(n_in - c);
                        let sums = &mut sums[c * n_columns..];
                        with_rows!(n, outer_tile::<S>(simd, matrix, &bases, c, panel, sums));
                    }
                }
            }
        }
        sums
    }
}

#[expect(clippy::too_many_arguments, reason = "an inner loop: everything in registers")]
#[inline(always)]
fn outer_tile<S: Simd, const ROWS: usize>(
    simd: S,
    matrix: &[f32],
    bases: &[usize],
    c: usize,
    panel: &[S::f32s],
    sums: &mut [f32],
) {
    let added: Sums<S, ROWS> = outer(simd, matrix, bases, c, panel);
    for (added, line) in added.iter().zip(sums.chunks_exact_mut(columns::<S>())) {
        for (sum, value) in line.iter_mut().zip(lanes::<S>(added)) {
            *sum += value;
        }
    }
}

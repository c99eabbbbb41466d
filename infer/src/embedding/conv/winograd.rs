//! 3x3 convolutions of stride 1 with fewer products than the definition has.
//!
//! Winograd's method (Lavin and Gray 2016, Sec. 4.1): each window of the input becomes as many factors a channel as it has
//! pixels, which meet as many matrices made of the weights; the sums become outputs. Windows of 2x2 outputs need 4 products
//! for 9, windows of 4x5 need 2.1 and round about four times as coarsely as the definition ([`super::axis`]).

use pulp::{Simd, WithSimd};

use crate::embedding::threads;

use super::axis::{Axis, Inputs, Outputs, OutputsBack, Square, Weights, WeightsBack};
use super::padded::{Layout, Padded};
use super::plan::{Columns, with_rows, with_tile};
use super::tile::{Sums, VECTORS, columns, gather, lanes, outer, rows, tiles, write};
use super::{Conv, Weight, arch};

/// Channels are a multiple of it: the widest vectors at hand. Matrices lie this much farther apart than they are long, so
/// that the same place in each is not in the same set of a cache.
const LANES: usize = 16;

/// Factors of a channel that are taken together, about: 30 rows of the matrices of windows of 4x5.
const FACTORS: usize = 1260;

/// Blocks of the weights' gradient whose factors are held at a time: sums are read and written once for each lot of them.
const BLOCKS: usize = 8;

/// Where the windows of a convolution lie.
#[derive(Clone, Copy, Debug)]
pub struct Windows {
    n_in: usize,
    n_out: usize,
    size: [usize; 2],
    /// Along rows and columns.
    axes: [Axis; 2],
}

/// What one thread keeps between images, and between convolutions: made anew it would be set to zero each time.
#[derive(Debug, Default)]
pub struct Scratch {
    pub padded: Padded,
    factors: Vec<f32>,
    sums: Vec<f32>,
}

impl Windows {
    /// The windows of a convolution; `None` where this method does not suit it.
    pub fn for_conv(conv: &Conv) -> Option<Self> {
        let suits = conv.kernel == 3
            && conv.stride == 1
            && conv.n_in.is_multiple_of(LANES)
            && conv.n_out.is_multiple_of(LANES)
            && conv.size.iter().all(|n| *n >= 2);
        let axes = conv.size.map(Axis::covering);
        suits.then_some(Self { n_in: conv.n_in, n_out: conv.n_out, size: conv.size, axes })
    }

    /// Windows of an image, rows and columns of them.
    fn counts(&self) -> [usize; 2] {
        [0, 1].map(|i| self.axes[i].count(self.size[i]))
    }

    fn n_windows(&self) -> usize {
        self.counts()[0] * self.counts()[1]
    }

    /// Products of a window, rows and columns of them.
    fn products(&self) -> [usize; 2] {
        self.axes.map(Axis::products)
    }

    fn n_products(&self) -> usize {
        self.products()[0] * self.products()[1]
    }

    /// Windows of some images, `[n, height, width, n_in]`: the rows of each product's matrix.
    fn n_rows(&self, images: &[f32]) -> usize {
        images.len() / (self.size[0] * self.size[1] * self.n_in) * self.n_windows()
    }

    /// Images to take together.
    pub fn images_at_once(&self) -> usize {
        (FACTORS / self.n_products() / self.n_windows()).max(1)
    }

    /// The windows of some images as a matrix `[n_images * n_windows, n_channels]` for each product, `apart` from each
    /// other.
    #[inline(always)]
    fn transform<S: Simd>(&self, simd: S, images: &[f32], padded: &mut Padded, (apart, factors): (usize, &mut [f32])) {
        let (n_channels, [rows, columns], [height, width]) = (self.n_in, self.counts(), self.size);
        let ([step_y, step_x], [n_y, n_x]) = (self.axes.map(Axis::outputs), self.products());
        let length = height * width * n_channels;
        let line = (step_x * columns + 2) * n_channels;
        let (size, image) = ([step_y * rows + 2, line], [height, width * n_channels]);
        let layout = Layout { size, before: [1, n_channels], image };
        let mut square = Square::new(simd);
        for (at, image) in images.chunks_exact(length).enumerate() {
            let padded = padded.of(image, layout);
            for window in 0..rows * columns {
                let corner = window / columns * step_y * line + window % columns * step_x * n_channels;
                let row = at * rows * columns + window;
                for channel in (0..n_channels).step_by(S::F32_LANES) {
                    for y in 0..n_y {
                        for x in 0..n_x {
                            square.values[y][x] = load::<S>(&padded[corner + y * line + x * n_channels + channel..]);
                        }
                    }
                    square.map::<Inputs>(simd, self.axes);
                    for y in 0..n_y {
                        for x in 0..n_x {
                            let at = (y * n_x + x) * apart + row * n_channels + channel;
                            store::<S>(square.values[y][x], &mut factors[at..]);
                        }
                    }
                }
            }
        }
    }

    /// The pixels of the outputs of a window, `(y, x, first value in [n, height, width, n_out])`: `row` counts the windows of
    /// all images.
    #[inline(always)]
    fn outputs(&self, row: usize, mut each: impl FnMut(usize, usize, usize)) {
        let ([height, width], columns, [step_y, step_x]) = (self.size, self.counts()[1], self.axes.map(Axis::outputs));
        let (image, window) = (row / self.n_windows(), row % self.n_windows());
        let [top, left] = [window / columns * step_y, window % columns * step_x];
        for y in 0..step_y.min(height - top) {
            for x in 0..step_x.min(width - left) {
                each(y, x, ((image * height + top + y) * width + left + x) * self.n_out);
            }
        }
    }
}

/// The matrices of a layer's weights, one for each product, in panels as [`gather`] reads them.
#[derive(Clone, Debug)]
pub struct Packed {
    windows: Windows,
    /// `[tiles, products, n_in, width]`, of the [tiles] of output channels.
    panels: Vec<f32>,
}

impl Packed {
    /// `weight([ky, kx], input channel, output channel)` gives each weight.
    pub fn new(windows: Windows, weight: &Weight<'_>) -> Self {
        Self { windows, panels: arch().dispatch(Pack { windows, weight }) }
    }

    /// How its windows lie.
    pub fn windows(&self) -> &Windows {
        &self.windows
    }

    /// Some images, `[n, height, width, n_in]`, into `out`.
    pub fn correlate(&self, images: &[f32], scratch: &mut Scratch, out: &mut [f32]) {
        arch().dispatch(Correlate { packed: self, images, scratch, out });
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
        let windows = self.windows;
        let n_places = windows.n_products() * windows.n_in;
        let mut panels = vec![0.0; n_places * tiles::<S>(windows.n_out).map(|[_, width]| width).sum::<usize>()];
        // All are full but the last.
        let pack = |(): &mut (), tile: usize, panels: &mut [f32]| {
            let first = tile * columns::<S>();
            let channels = first..windows.n_out.min(first + panels.len() / n_places);
            // Threads begin with narrow vectors.
            arch().dispatch(PackBlock { windows, weight: self.weight, channels, panels });
        };
        threads::for_each_block(&mut panels, n_places * columns::<S>(), || (), pack);
        panels
    }
}

/// `G g G^T` of one tile of output channels.
struct PackBlock<'a> {
    windows: Windows,
    weight: &'a Weight<'a>,
    channels: std::ops::Range<usize>,
    panels: &'a mut [f32], // [products, n_in, width]
}

impl WithSimd for PackBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Windows { n_in, axes, .. } = self.windows;
        let [n_y, n_x] = self.windows.products();
        let width = self.panels.len() / (n_y * n_x * n_in);
        let mut square = Square::new(simd);
        let mut line = vec![0.0; S::F32_LANES];
        for c in 0..n_in {
            for first in (0..width).step_by(S::F32_LANES) {
                for tap in 0..9 {
                    for (at, value) in line.iter_mut().enumerate() {
                        let out = self.channels.start + first + at;
                        let is_there = out < self.channels.end;
                        *value = if is_there { (self.weight)([tap / 3, tap % 3], c, out) } else { 0.0 };
                    }
                    square.values[tap / 3][tap % 3] = load::<S>(&line);
                }
                square.map::<Weights>(simd, axes);
                for y in 0..n_y {
                    for x in 0..n_x {
                        let at = ((y * n_x + x) * n_in + c) * width + first;
                        store::<S>(square.values[y][x], &mut self.panels[at..]);
                    }
                }
            }
        }
    }
}

/// The first values of some that are kept, so many: anything.
fn grown(kept: &mut Vec<f32>, n: usize) -> &mut [f32] {
    if kept.len() < n {
        kept.resize(n, 0.0);
    }
    &mut kept[..n]
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
        let Scratch { padded, factors, sums } = self.scratch;
        let Windows { n_in, n_out, axes, .. } = *windows;
        let (n_products, n_x) = (windows.n_products(), windows.products()[1]);
        let n_rows = windows.n_rows(self.images);
        let [factors_apart, sums_apart] = [n_in, n_out].map(|n| n_rows * n + LANES);
        let factors = grown(factors, n_products * factors_apart);
        windows.transform(simd, self.images, padded, (factors_apart, factors));
        let sums = grown(sums, n_products * sums_apart);
        for (k, sums) in sums.chunks_exact_mut(sums_apart).enumerate() {
            let matrix = &factors[k * factors_apart..][..n_rows * n_in];
            for [first, width] in tiles::<S>(n_out) {
                let panel = &panels[(first * n_products + k * width) * n_in..][..n_in * width];
                let (panel, _) = S::as_simd_f32s(panel);
                for at in (0..n_rows).step_by(rows::<S>()) {
                    let n = rows::<S>().min(n_rows - at);
                    let sums = &mut sums[at * n_out + first..n_rows * n_out];
                    let matrix = &matrix[at * n_in..];
                    with_tile!([n, width], multiply_tile::<S>(simd, matrix, n_in, panel, [first, n_out], sums));
                }
            }
        }
        let mut square = Square::new(simd);
        for row in 0..n_rows {
            for channel in (0..n_out).step_by(S::F32_LANES) {
                for k in 0..n_products {
                    square.values[k / n_x][k % n_x] = load::<S>(&sums[k * sums_apart + row * n_out + channel..]);
                }
                square.map::<Outputs>(simd, axes);
                windows.outputs(
                    row,
                    #[inline(always)]
                    |y, x, at| store::<S>(square.values[y][x], &mut self.out[at + channel..]),
                );
            }
        }
    }
}

/// Some rows of a matrix times one panel of another.
#[expect(clippy::too_many_arguments, reason = "an inner loop: everything in registers")]
#[inline(always)]
fn multiply_tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    matrix: &[f32],
    n_in: usize,
    panel: &[S::f32s],
    [first, n_out]: [usize; 2],
    sums: &mut [f32],
) {
    let bases: [usize; ROWS] = std::array::from_fn(|i| i * n_in);
    let made: Sums<S, ROWS, VECTORS> = gather(simd, matrix, &bases, &[0], n_in, panel);
    for (made, line) in made.iter().zip(sums.chunks_mut(n_out)) {
        let n = (VECTORS * S::F32_LANES).min(n_out - first);
        write::<S, VECTORS>(made, &mut line[..n]);
    }
}

/// Gradient of the weights, `[n_out, n_in, 3, 3]`, of some images.
///
/// Some images at a time are transformed, by blocks of them, then each product's sums are added to: threads share the blocks,
/// then the products, and nothing depends on how many there are.
pub fn weight_gradient(windows: &Windows, images: &[f32], gradient: &[f32]) -> Vec<f32> {
    let Windows { n_in, n_out, size: [height, width], .. } = *windows;
    let n_columns = arch().dispatch(Columns);
    let [n_blocks, n_products] = [n_out.div_ceil(n_columns), windows.n_products()];
    let at_once = windows.images_at_once();
    let [in_length, out_length] = [n_in, n_out].map(|n| at_once * height * width * n);
    let n_rows = at_once * windows.n_windows();
    let apart = [n_rows * n_in + LANES, n_blocks * n_rows * n_columns + LANES];
    // Of each block of images the factors, then the panels.
    let length = n_products * (apart[0] + apart[1]);
    let mut blocks = vec![0.0; length * BLOCKS.min(images.len().div_ceil(in_length))];
    let mut sums = vec![0.0; n_products * n_blocks * n_in * n_columns]; // [products, blocks, n_in, columns]
    for (images, gradient) in images.chunks(BLOCKS * in_length).zip(gradient.chunks(BLOCKS * out_length)) {
        let n_images = images.len() / (in_length / at_once);
        let blocks = &mut blocks[..length * n_images.div_ceil(at_once)];
        threads::for_each_block(blocks, length, Padded::default, |padded, at, block| {
            let images = &images[at * in_length..images.len().min((at + 1) * in_length)];
            let gradient = &gradient[at * out_length..gradient.len().min((at + 1) * out_length)];
            arch().dispatch(TransformBlock { windows, images, gradient, apart, padded, block });
        });
        threads::for_each_block(
            &mut sums,
            n_blocks * n_in * n_columns,
            || (),
            |(), k, sums| {
                for (at, block) in blocks.chunks_exact(length).enumerate() {
                    let n_rows = (n_images - at * at_once).min(at_once) * windows.n_windows();
                    arch().dispatch(AddProducts { windows, block, apart, n_rows, k, sums });
                }
            },
        );
    }
    weights_of_windows(windows, &sums)
}

/// The gradient of each weight, `[n_out, n_in, 3, 3]`, from the gradient of each product,
/// `[products, blocks, n_in, columns]`.
fn weights_of_windows(windows: &Windows, sums: &[f32]) -> Vec<f32> {
    let width = arch().dispatch(Columns);
    let mut weights = vec![0.0; windows.n_out * windows.n_in * 9];
    threads::for_each_block(
        &mut weights,
        width * windows.n_in * 9,
        || (),
        |(), block, weights| {
            arch().dispatch(WeightsOfBlock { windows: *windows, sums, block, weights });
        },
    );
    weights
}

/// `G^T u G` of one block of output channels.
struct WeightsOfBlock<'a> {
    windows: Windows,
    sums: &'a [f32],
    block: usize,
    weights: &'a mut [f32],
}

impl WithSimd for WeightsOfBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Windows { n_in, n_out, axes, .. } = self.windows;
        let ([n_y, n_x], width) = (self.windows.products(), columns::<S>());
        let n_blocks = n_out.div_ceil(width);
        let mut square = Square::new(simd);
        for c in 0..n_in {
            for first in (0..width).step_by(S::F32_LANES) {
                for k in 0..n_y * n_x {
                    let at = ((k * n_blocks + self.block) * n_in + c) * width + first;
                    square.values[k / n_x][k % n_x] = load::<S>(&self.sums[at..]);
                }
                square.map::<WeightsBack>(simd, axes);
                for tap in 0..9 {
                    let values = [square.values[tap / 3][tap % 3]];
                    for (at, value) in lanes::<S>(&values).iter().enumerate() {
                        let place = ((first + at) * n_in + c) * 9 + tap;
                        if let Some(weight) = self.weights.get_mut(place) {
                            *weight = *value;
                        }
                    }
                }
            }
        }
    }
}

/// The factors of some images and, in panels as [`outer`] reads them, of the gradient of their outputs.
struct TransformBlock<'a> {
    windows: &'a Windows,
    images: &'a [f32],
    gradient: &'a [f32],
    /// How far the matrices of two products are apart: of factors, of panels `[blocks, rows, columns]`.
    apart: [usize; 2],
    padded: &'a mut Padded,
    block: &'a mut [f32],
}

impl WithSimd for TransformBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { windows, gradient, apart: [factors_apart, apart], .. } = self;
        let (factors, panels) = self.block.split_at_mut(windows.n_products() * factors_apart);
        let n_rows = windows.n_rows(self.images);
        windows.transform(simd, self.images, self.padded, (factors_apart, factors));
        let (n_x, n_columns) = (windows.products()[1], columns::<S>());
        let (mut square, zeros) = (Square::new(simd), Square::new(simd).values);
        for row in 0..n_rows {
            for channel in (0..windows.n_out).step_by(S::F32_LANES) {
                square.values = zeros;
                windows.outputs(
                    row,
                    #[inline(always)]
                    |y, x, at| square.values[y][x] = load::<S>(&gradient[at + channel..]),
                );
                square.map::<OutputsBack>(simd, windows.axes);
                let (block, within) = (channel / n_columns, channel % n_columns);
                for k in 0..windows.n_products() {
                    let at = k * apart + (block * n_rows + row) * n_columns + within;
                    store::<S>(square.values[k / n_x][k % n_x], &mut panels[at..]);
                }
            }
        }
    }
}

/// Adds to the sums of one product what a block of images brings.
struct AddProducts<'a> {
    windows: &'a Windows,
    /// As [`TransformBlock`] makes it.
    block: &'a [f32],
    apart: [usize; 2],
    n_rows: usize,
    k: usize,
    sums: &'a mut [f32], // [blocks, n_in, columns]
}

impl WithSimd for AddProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { windows: &Windows { n_in, .. }, apart, n_rows, k, .. } = self;
        let n_columns = columns::<S>();
        let (factors, panels) = self.block.split_at(self.windows.n_products() * apart[0]);
        let (matrix, panels) = (&factors[k * apart[0]..][..n_rows * n_in], &panels[k * apart[1]..]);
        let bases: Vec<usize> = (0..n_rows).map(|row| row * n_in).collect();
        for (sums, panel) in self.sums.chunks_exact_mut(n_in * n_columns).zip(panels.chunks_exact(n_rows * n_columns)) {
            let (panel, _) = S::as_simd_f32s(panel);
            for c in (0..n_in).step_by(rows::<S>()) {
                let n = rows::<S>().min(n_in - c);
                let sums = &mut sums[c * n_columns..];
                with_rows!(n, outer_tile::<S>(simd, matrix, &bases, c, panel, sums));
            }
        }
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
    let added: Sums<S, ROWS, VECTORS> = outer(simd, matrix, bases, c, panel);
    for (added, line) in added.iter().zip(sums.chunks_exact_mut(columns::<S>())) {
        for (sum, value) in line.iter_mut().zip(lanes::<S>(added)) {
            *sum += value;
        }
    }
}

//! Where a convolution reads, and its weights in the order in which they are read.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::padded::{Layout, Padded};
use super::tile::{Sums, VECTORS, columns, gather, lanes, outer, rows, tiles, write};
use super::{Conv, arch};

/// Pixels of the gradient that are taken together.
const PIXELS_AT_ONCE: usize = 128;

/// Tiles whose values are taken together from those pixels: with a panel they fill a first-level cache of 32 KiB, or of 48
/// KiB with wider vectors.
const TILES_AT_ONCE: usize = 8;

/// Which pixels of a padded image each output reads: runs of memory, the same for each output but for
/// where they begin.
#[derive(Clone, Debug)]
pub struct Gather {
    /// Height, width and channels of what is read, before padding.
    source: [usize; 3],
    /// Pixels of padding on each side.
    pad: usize,
    /// For each output, where it begins in the padded image.
    bases: Vec<usize>,
    /// For each output, which pixel of the result it is.
    targets: Vec<usize>,
    /// Where each run is behind the base.
    starts: Vec<usize>,
    /// Taps of each run: rows of the kernel.
    taps_y: Vec<usize>,
    /// Taps within each run: columns of the kernel.
    taps_x: Vec<usize>,
}

impl Gather {
    /// Windows of the input.
    pub fn forward(conv: &Conv) -> Self {
        let source = [conv.size[0], conv.size[1], conv.n_in];
        let pad = conv.kernel / 2;
        let row = (source[1] + 2 * pad) * source[2];
        let [height, width] = conv.out_size();
        let base = |at: usize| at / width * conv.stride * row + at % width * conv.stride * source[2];
        let taps: Vec<usize> = (0..conv.kernel).collect();
        Self {
            source,
            pad,
            bases: (0..height * width).map(base).collect(),
            targets: (0..height * width).collect(),
            starts: taps.iter().map(|ky| ky * row).collect(),
            taps_y: taps.clone(),
            taps_x: taps,
        }
    }

    /// Windows of the output's gradient that reach each pixel of the input: one plan for each of the
    /// stride's phases, because each phase meets other taps.
    pub fn backward(conv: &Conv) -> Vec<Self> {
        let (stride, half) = (conv.stride, conv.kernel / 2);
        let [out_height, out_width] = conv.out_size();
        let source = [out_height, out_width, conv.n_out];
        // A tap reaches at most this far beyond the outputs.
        let pad = half.div_ceil(stride) + 1;
        let row = (source[1] + 2 * pad) * source[2];
        // Taps of a phase, falling, so that the outputs they reach rise.
        let taps =
            |phase: usize| -> Vec<usize> { (0..conv.kernel).rev().filter(|tap| tap % stride == phase).collect() };
        // The first output that pixel `at` reaches: (at + half - largest tap) / stride.
        let first = |at: usize, taps: &[usize]| (at + half + pad * stride - taps[0]) / stride;
        let mut plans = Vec::new();
        for phase in 0..stride * stride {
            let (taps_y, taps_x) = (taps(phase / stride), taps(phase % stride));
            if taps_y.is_empty() || taps_x.is_empty() {
                continue; // A pixel that no window meets: its gradient stays zero.
            }
            let lies_in = |at: usize, phase: usize| (at + half) % stride == phase;
            let pixels: Vec<[usize; 2]> = (0..conv.size[0] * conv.size[1])
                .map(|at| [at / conv.size[1], at % conv.size[1]])
                .filter(|[y, x]| lies_in(*y, phase / stride) && lies_in(*x, phase % stride))
                .collect();
            let base = |[y, x]: &[usize; 2]| first(*y, &taps_y) * row + first(*x, &taps_x) * source[2];
            plans.push(Self {
                source,
                pad,
                bases: pixels.iter().map(base).collect(),
                targets: pixels.iter().map(|[y, x]| y * conv.size[1] + x).collect(),
                starts: (0..taps_y.len()).map(|i| i * row).collect(),
                taps_y,
                taps_x,
            });
        }
        plans
    }

    fn run(&self) -> usize {
        self.taps_x.len() * self.source[2]
    }

    fn layout(&self) -> Layout {
        let ([height, width, n_channels], pad) = (self.source, self.pad);
        Layout {
            size: [height + 2 * pad, (width + 2 * pad) * n_channels],
            before: [pad, pad * n_channels],
            image: [height, width * n_channels],
        }
    }

    /// Gradient of the weights, `[ky, kx, n_in, n_out]`, of some images.
    pub fn outer(&self, images: &[f32], gradient: &[f32], n_out: usize) -> Vec<f32> {
        arch().dispatch(Outer { plan: self, images, gradient, n_out })
    }
}

/// Weights in panels: for each [tile](tiles) of output channels, each run and each place in it, the tile's
/// weights side by side, zeros beyond the last channel.
#[derive(Clone, Debug)]
pub struct Panels {
    plans: Vec<(Gather, Vec<f32>)>,
    n_out: usize,
}

impl Panels {
    /// `weight(plan, [ky, kx], input channel, output channel)` gives each weight.
    pub fn new(plans: Vec<Gather>, n_out: usize, weight: impl Fn(usize, [usize; 2], usize, usize) -> f32) -> Self {
        let tiles = arch().dispatch(Tiles(n_out));
        let pack = |(at, plan): (usize, Gather)| {
            let mut panels = Vec::new();
            for [first, width] in tiles.iter().copied() {
                for ky in &plan.taps_y {
                    for kx in &plan.taps_x {
                        for c in 0..plan.source[2] {
                            let value = |out| if out < n_out { weight(at, [*ky, *kx], c, out) } else { 0.0 };
                            panels.extend((first..first + width).map(value));
                        }
                    }
                }
            }
            (plan, panels)
        };
        Self { plans: plans.into_iter().enumerate().map(pack).collect(), n_out }
    }

    /// One image, `[height, width, channels]`, into `out`. `padded` is scratch, kept between images.
    pub fn correlate(&self, image: &[f32], padded: &mut Padded, out: &mut [f32]) {
        let plans = self.plans.iter().map(|(plan, panels)| (plan, panels.as_slice())).collect();
        arch().dispatch(Correlate { plans, n_out: self.n_out, image, padded, out });
    }

    /// Rows of numbers, `[n, channels]`, as the pixels of one image: what a linear layer is to a kernel of one.
    pub fn multiply(&self, rows: &[f32], n_in: usize, padded: &mut Padded, out: &mut [f32]) {
        let size = [1, rows.len() / n_in];
        let plan = Gather::forward(&Conv { n_in, n_out: self.n_out, kernel: 1, stride: 1, size });
        let plans = self.plans.iter().map(|(_, panels)| (&plan, panels.as_slice())).collect();
        arch().dispatch(Correlate { plans, n_out: self.n_out, image: rows, padded, out });
    }
}

/// The tiles of so many channels on the machine at hand.
struct Tiles(usize);

impl WithSimd for Tiles {
    type Output = Vec<[usize; 2]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vec<[usize; 2]> {
        tiles::<S>(self.0).collect()
    }
}

/// Channels in a full tile of the machine at hand.
pub(super) struct Columns;

impl WithSimd for Columns {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> usize {
        columns::<S>()
    }
}

/// Calls `$run::<S, ROWS, ...>` with a constant number of rows.
macro_rules! with_rows {
    ($n:expr, $run:ident :: <$simd:ty $(, $vectors:literal)?> $arguments:tt) => {
        match $n {
            1 => $run::<$simd, 1 $(, $vectors)?> $arguments,
            2 => $run::<$simd, 2 $(, $vectors)?> $arguments,
            3 => $run::<$simd, 3 $(, $vectors)?> $arguments,
            4 => $run::<$simd, 4 $(, $vectors)?> $arguments,
            5 => $run::<$simd, 5 $(, $vectors)?> $arguments,
            6 => $run::<$simd, 6 $(, $vectors)?> $arguments,
            7 => $run::<$simd, 7 $(, $vectors)?> $arguments,
            8 => $run::<$simd, 8 $(, $vectors)?> $arguments,
            9 => $run::<$simd, 9 $(, $vectors)?> $arguments,
            _ => $run::<$simd, 10 $(, $vectors)?> $arguments,
        }
    };
}

/// Calls `$run::<S, ROWS, VECTORS>` for a tile of so many rows and of a width that [`tiles`] gives.
macro_rules! with_tile {
    ($size:expr, $run:ident :: <$simd:ty> $arguments:tt) => {
        match $size {
            [n, width] if width == <$simd>::F32_LANES => with_rows!(n, $run::<$simd, 1> $arguments),
            [n, _] => with_rows!(n, $run::<$simd, 2> $arguments),
        }
    };
}

pub(super) use {with_rows, with_tile};

struct Correlate<'a> {
    plans: Vec<(&'a Gather, &'a [f32])>,
    n_out: usize,
    image: &'a [f32],
    padded: &'a mut Padded,
    out: &'a mut [f32],
}

impl WithSimd for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let n_out = self.n_out;
        // All plans of a convolution read the same padded image.
        let Some((first, _)) = self.plans.first() else { return };
        let padded = self.padded.of(self.image, first.layout());
        for (plan, panels) in &self.plans {
            let (mut panels, _) = S::as_simd_f32s(panels);
            let n_places = plan.starts.len() * plan.run();
            for [first, width] in tiles::<S>(n_out) {
                let (panel, rest) = panels.split_at(n_places * width / S::F32_LANES);
                panels = rest;
                let channels = first..n_out.min(first + width);
                for at in (0..plan.bases.len()).step_by(rows::<S>()) {
                    let pixels = at..(at + rows::<S>()).min(plan.bases.len());
                    let size = [pixels.len(), width];
                    let to = (pixels, channels.clone(), n_out);
                    with_tile!(size, correlate_tile::<S>(simd, (plan, panel), padded, to, self.out));
                }
            }
        }
    }
}

/// Some pixels of some channels, of so many, into `out`.
#[inline(always)]
fn correlate_tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    (plan, panel): (&Gather, &[S::f32s]),
    image: &[f32],
    (pixels, channels, n_out): (Range<usize>, Range<usize>, usize),
    out: &mut [f32],
) {
    let bases = &plan.bases[pixels.clone()];
    let sums: Sums<S, ROWS, VECTORS> = gather(simd, image, bases, &plan.starts, plan.run(), panel);
    for (sums, target) in sums.iter().zip(&plan.targets[pixels]) {
        let line = &mut out[target * n_out..][channels.clone()];
        write::<S, VECTORS>(sums, line);
    }
}

struct Outer<'a> {
    plan: &'a Gather,
    images: &'a [f32],
    gradient: &'a [f32],
    n_out: usize,
}

impl WithSimd for Outer<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let Self { plan, n_out, .. } = self;
        let n_padded = n_out.div_ceil(columns::<S>()) * columns::<S>();
        let (n_pixels, run) = (plan.bases.len(), plan.run());
        let in_length: usize = plan.source.iter().product();
        let mut sums = vec![0.0; plan.starts.len() * run * n_padded]; // [ky, kx, n_in, n_padded]
        // Small images are taken together: sums are read and written once for each lot of pixels.
        let together = (PIXELS_AT_ONCE / n_pixels).max(1);
        let layout = plan.layout();
        let length = layout.len();
        let mut padded = vec![0.0; together * length];
        let bases: Vec<usize> =
            (0..together).flat_map(|image| plan.bases.iter().map(move |base| image * length + base)).collect();
        // Values that some places of a window have at all pixels, side by side: where they are read from, pixels may be
        // apart by a power of two, and would push each other out of the cache.
        let places = TILES_AT_ONCE * rows::<S>();
        let packed_bases: Vec<usize> = (0..PIXELS_AT_ONCE).map(|pixel| pixel * places).collect();
        let mut packed = vec![0.0; PIXELS_AT_ONCE * places];
        let mut panels = vec![0.0; PIXELS_AT_ONCE * n_padded];
        let lots = self.images.chunks(together * in_length).zip(self.gradient.chunks(together * n_pixels * n_out));
        for (images, gradient) in lots {
            for (image, padded) in images.chunks_exact(in_length).zip(padded.chunks_exact_mut(length)) {
                layout.copy(image, padded);
            }
            let bases = &bases[..gradient.len() / n_out];
            let pixels = bases.chunks(PIXELS_AT_ONCE).zip(gradient.chunks(PIXELS_AT_ONCE * n_out));
            for (bases, gradient) in pixels {
                into_panels(gradient, n_out, columns::<S>(), &mut panels[..bases.len() * n_padded]);
                for (tap, start) in plan.starts.iter().enumerate() {
                    for place in (0..run).step_by(places) {
                        let n_places = places.min(run - place);
                        for (packed, base) in packed.chunks_exact_mut(places).zip(bases) {
                            packed[..n_places].copy_from_slice(&padded[base + start + place..][..n_places]);
                        }
                        let sums = &mut sums[(tap * run + place) * n_padded..][..n_places * n_padded];
                        for first in (0..n_padded).step_by(columns::<S>()) {
                            let (panel, _) =
                                S::as_simd_f32s(&panels[first * bases.len()..][..bases.len() * columns::<S>()]);
                            for row in (0..n_places).step_by(rows::<S>()) {
                                let n_rows = rows::<S>().min(n_places - row);
                                let sums = &mut sums[row * n_padded..];
                                let bases = &packed_bases[..bases.len()];
                                with_rows!(
                                    n_rows,
                                    outer_tile::<S>(simd, &packed, bases, row, panel, [first, n_padded], sums)
                                );
                            }
                        }
                    }
                }
            }
        }
        if n_padded == n_out {
            return sums;
        }
        sums.chunks_exact(n_padded).flat_map(|line| &line[..n_out]).copied().collect()
    }
}

/// Pixels of `n_channels` in blocks of `columns` channels, `[blocks, pixels, columns]`; beyond the last channel anything.
#[inline(always)]
fn into_panels(pixels: &[f32], n_channels: usize, columns: usize, panels: &mut [f32]) {
    let n_pixels = pixels.len() / n_channels;
    for (block, panel) in panels.chunks_exact_mut(n_pixels * columns).enumerate() {
        let channels = block * columns..n_channels.min((block + 1) * columns);
        for (line, pixel) in panel.chunks_exact_mut(columns).zip(pixels.chunks_exact(n_channels)) {
            line[..channels.len()].copy_from_slice(&pixel[channels.clone()]);
        }
    }
}

#[expect(clippy::too_many_arguments, reason = "an inner loop: everything in registers")]
#[inline(always)]
fn outer_tile<S: Simd, const ROWS: usize>(
    simd: S,
    image: &[f32],
    bases: &[usize],
    start: usize,
    panel: &[S::f32s],
    [first, n_padded]: [usize; 2],
    sums: &mut [f32],
) {
    let added: Sums<S, ROWS, VECTORS> = outer(simd, image, bases, start, panel);
    for (added, line) in added.iter().zip(sums.chunks_mut(n_padded)) {
        let line = &mut line[first..first + columns::<S>()];
        for (sum, value) in line.iter_mut().zip(lanes::<S>(added)) {
            *sum += value;
        }
    }
}

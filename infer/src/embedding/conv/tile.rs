//! The two inner loops of a convolution, a register tile each, for the widest vectors at hand.
//!
//! Images are NHWC: the channels of a pixel lie together, so a row of a kernel's window is one run of
//! memory, and nothing need be copied out of the image before it is multiplied.

use pulp::Simd;

/// Vectors side by side in a tile that is full.
pub const VECTORS: usize = 2;

/// Pixels in a tile: with two vectors each they fill the registers without spilling.
pub const fn rows<S: Simd>() -> usize {
    // AVX-512 has 32 registers, AVX2 16.
    if S::F32_LANES >= 16 { 10 } else { 5 }
}

/// Channels in a full tile.
pub const fn columns<S: Simd>() -> usize {
    VECTORS * S::F32_LANES
}

/// The tiles of so many channels: the first channel of each, and its width. The last is one vector wide where that holds what is
/// left.
#[inline(always)]
pub fn tiles<S: Simd>(n_channels: usize) -> impl Iterator<Item = [usize; 2]> {
    let width = move |first: usize| if n_channels - first > S::F32_LANES { columns::<S>() } else { S::F32_LANES };
    (0..n_channels).step_by(columns::<S>()).map(move |first| [first, width(first)])
}

/// The lanes of some vectors as numbers.
#[inline(always)]
pub fn lanes<S: Simd>(vectors: &[S::f32s]) -> &[f32] {
    pulp::bytemuck::cast_slice(vectors)
}

/// Writes the first values of some vectors, as many as `line` holds: whole vectors where it holds all.
#[inline(always)]
pub fn write<S: Simd, const VECTORS: usize>(vectors: &[S::f32s; VECTORS], line: &mut [f32]) {
    if line.len() == VECTORS * S::F32_LANES {
        let (to, _) = S::as_mut_simd_f32s(line);
        to.copy_from_slice(vectors);
    } else {
        line.copy_from_slice(&lanes::<S>(vectors)[..line.len()]);
    }
}

/// Sums of products of one tile.
pub type Sums<S, const ROWS: usize, const VECTORS: usize> = [[<S as Simd>::f32s; VECTORS]; ROWS];

/// `sums[i][j] = sum over runs r and places k of image[bases[i] + starts[r] + k] * panel[r, k, j]`.
#[expect(clippy::too_many_arguments, reason = "an inner loop: everything in registers")]
#[inline(always)]
pub fn gather<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    image: &[f32],
    bases: &[usize],
    starts: &[usize],
    run: usize,
    panel: &[S::f32s], // [starts, run, VECTORS]
) -> Sums<S, ROWS, VECTORS> {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    for (panel, start) in panel.chunks_exact(VECTORS * run).zip(starts) {
        let runs: [&[f32]; ROWS] = std::array::from_fn(|i| &image[bases[i] + start..][..run]);
        for k in 0..run {
            let weights: [S::f32s; VECTORS] = std::array::from_fn(|j| panel[VECTORS * k + j]);
            for i in 0..ROWS {
                let value = simd.splat_f32s(runs[i][k]);
                for j in 0..VECTORS {
                    sums[i][j] = simd.mul_add_f32s(value, weights[j], sums[i][j]);
                }
            }
        }
    }
    sums
}

/// `sums[i][j] = sum over pixels p of image[bases[p] + start + i] * panel[p, j]`.
#[inline(always)]
pub fn outer<S: Simd, const ROWS: usize>(
    simd: S,
    image: &[f32],
    bases: &[usize],
    start: usize,
    panel: &[S::f32s], // [pixels, VECTORS]
) -> Sums<S, ROWS, VECTORS> {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    for (base, gradient) in bases.iter().zip(panel.chunks_exact(VECTORS)) {
        let values: &[f32] = &image[base + start..][..ROWS];
        let gradient = [gradient[0], gradient[1]];
        for i in 0..ROWS {
            let value = simd.splat_f32s(values[i]);
            sums[i][0] = simd.mul_add_f32s(value, gradient[0], sums[i][0]);
            sums[i][1] = simd.mul_add_f32s(value, gradient[1], sums[i][1]);
        }
    }
    sums
}

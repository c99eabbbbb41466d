//! The kernels of a layer on a graphics card: plain loops over buffers of f32, images NHWC, matrices row by row.
//!
//! A sum over many rows is made in two launches without atomics, so that it is the same in every run: blocks of rows
//! first, then the blocks.

#![allow(clippy::too_many_arguments, reason = "a kernel takes its buffers one by one")]

use burn_cubecl::cubecl;
use cubecl::prelude::*;

/// Channels that a cube of threads takes together ...
pub const LANES: u32 = 32;

/// ... and rows that it takes at the same time.
pub const ROWS: u32 = 8;

/// The geometry of a convolution, known when its kernels are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Geometry {
    /// Height and width of the input, pixels.
    pub height: usize,
    pub width: usize,
    /// Height and width of the output, pixels.
    pub out_height: usize,
    pub out_width: usize,
    /// Channels of the input.
    pub channels: usize,
    /// Side of the kernel, pixels.
    pub kernel: usize,
    /// Step between outputs, pixels.
    pub stride: usize,
    /// Rows and columns of zeros around the input.
    pub pad: usize,
    /// Values of a window as a row: the next multiple of four, the last ones zero.
    pub row: usize,
}

/// The windows of `images` as rows: `[n, height, width, channels]` -> `[n out_height out_width, row]`, zero where a window
/// reaches over the border.
#[cube(launch)]
pub fn windows(images: &[f32], rows: &mut [f32], #[comptime] g: Geometry) {
    let at = ABSOLUTE_POS;
    if at < rows.len() {
        let of_window = at % g.row;
        let (inside, place) = source(at / g.row, of_window / g.channels, g);
        let mut value = 0.0f32;
        if inside && of_window < comptime![g.kernel * g.kernel * g.channels] {
            value = images[place * g.channels + of_window % g.channels];
        }
        rows[at] = value;
    }
}

/// The same, four channels at a time.
#[cube(launch)]
pub fn windows_by_fours(
    images: &[Vector<f32, Const<4>>],
    rows: &mut [Vector<f32, Const<4>>],
    n: usize,
    #[comptime] g: Geometry,
) {
    let at = ABSOLUTE_POS;
    let fours = comptime![g.channels / 4];
    let a_row = comptime![g.row / 4];
    if at < n {
        let of_window = at % a_row;
        let (inside, place) = source(at / a_row, of_window / fours, g);
        let mut value = Vector::<f32, Const<4>>::new(0.0f32);
        if inside {
            value = images[place * fours + of_window % fours];
        }
        rows[at] = value;
    }
}

/// The input pixel that a tap of an output pixel's window sees, and whether it is inside the image.
#[cube]
fn source(pixel: usize, tap: usize, #[comptime] g: Geometry) -> (bool, usize) {
    // In the padded image.
    let x = pixel % g.out_width * g.stride + tap % g.kernel;
    let y = pixel / g.out_width % g.out_height * g.stride + tap / g.kernel;
    let image = pixel / comptime![g.out_width * g.out_height];
    let inside = x >= g.pad && x < comptime![g.width + g.pad] && y >= g.pad && y < comptime![g.height + g.pad];
    let place = (image * g.height + y) * g.width + x;
    (inside, place - select(inside, comptime![g.pad * g.width + g.pad], 0))
}

/// Weights `[n_out, n_in, kernel, kernel]` as a matrix `[row, n_out]`, or turned, `[n_out, row]`, zero in the last rows.
#[cube(launch)]
pub fn matrix(weights: &[f32], matrix: &mut [f32], n_out: usize, #[comptime] g: Geometry, #[comptime] turned: bool) {
    let at = ABSOLUTE_POS;
    if at < matrix.len() {
        let mut of_window = at / n_out;
        let mut out = at % n_out;
        if turned {
            of_window = at % g.row;
            out = at / g.row;
        }
        let mut value = 0.0f32;
        if of_window < comptime![g.kernel * g.kernel * g.channels] {
            let (tap, channel) = (of_window / g.channels, of_window % g.channels);
            value = weights[(out * g.channels + channel) * comptime![g.kernel * g.kernel] + tap];
        }
        matrix[at] = value;
    }
}

/// A matrix `[row, n_out]` as weights `[n_out, n_in, kernel, kernel]`.
#[cube(launch)]
pub fn weights(matrix: &[f32], weights: &mut [f32], n_out: usize, #[comptime] g: Geometry) {
    let at = ABSOLUTE_POS;
    if at < weights.len() {
        let tap = at % comptime![g.kernel * g.kernel];
        let channel = at / comptime![g.kernel * g.kernel] % g.channels;
        let out = at / comptime![g.kernel * g.kernel * g.channels];
        weights[at] = matrix[(tap * g.channels + channel) * n_out + out];
    }
}

/// The gradient of the images from the gradient of their windows: each value takes from every window that saw it, and,
/// with a skip, what the rectifier let pass of `out_gradient`.
#[cube(launch)]
pub fn windows_gradient(
    rows: &[f32],
    out: &[f32],
    out_gradient: &[f32],
    images: &mut [f32],
    #[comptime] g: Geometry,
    #[comptime] skips: bool,
) {
    let at = ABSOLUTE_POS;
    if at < images.len() {
        let channel = at % g.channels;
        let pixel = at / g.channels;
        // In the padded image.
        let x = pixel % g.width + g.pad;
        let y = pixel / g.width % g.height + g.pad;
        let image = pixel / (g.width * g.height);
        let mut sum = 0.0f32;
        if skips {
            sum = passed(out[at], out_gradient[at], true);
        }
        #[unroll]
        for ky in 0..g.kernel {
            #[unroll]
            for kx in 0..g.kernel {
                if y >= ky && x >= kx {
                    let (top, left) = (y - ky, x - kx);
                    let (row, column) = (top / g.stride, left / g.stride);
                    let on_grid = row * g.stride == top && column * g.stride == left;
                    if on_grid && row < g.out_height && column < g.out_width {
                        let window = (image * g.out_height + row) * g.out_width + column;
                        sum += rows[window * g.row + (ky * g.kernel + kx) * g.channels + channel];
                    }
                }
            }
        }
        images[at] = sum;
    }
}

/// `gradient` where the rectifier let pass, else zero; all of it without a rectifier.
#[cube]
fn passed(out: f32, gradient: f32, #[comptime] rectifies: bool) -> f32 {
    let mut value = gradient;
    if rectifies {
        if out <= 0.0 {
            value = 0.0f32;
        }
    }
    value
}

/// The sums of each channel over a block of rows, of the distance from the first row and of its square.
/// `values`: `[n, channels]`; `sums`: `[blocks, 2, channels]`.
#[cube(launch)]
pub fn moments(values: &[f32], sums: &mut [f32], rows_a_block: u32, #[comptime] channels: usize) {
    let channel = (CUBE_POS_X * LANES + UNIT_POS_X) as usize;
    let n_rows = values.len() / channels;
    let mut first = 0.0f32;
    let mut second = 0.0f32;
    if channel < channels {
        let origin = values[channel];
        let begin = (CUBE_POS_Y * rows_a_block) as usize;
        let end = (begin + rows_a_block as usize).min(n_rows);
        let mut row = begin + UNIT_POS_Y as usize;
        while row < end {
            let value = values[row * channels + channel] - origin;
            first += value;
            second += value * value;
            row += ROWS as usize;
        }
    }
    write_sums(first, second, sums, channel, channels);
}

/// The sums of each channel over a block of rows, of what the rectifier lets pass of the gradient, and of that times the distance
/// of `before` from its mean. `numbers` begins with the mean of each channel.
#[cube(launch)]
pub fn gradient_moments(
    before: &[f32],
    out: &[f32],
    out_gradient: &[f32],
    numbers: &[f32],
    sums: &mut [f32],
    rows_a_block: u32,
    #[comptime] channels: usize,
    #[comptime] rectifies: bool,
) {
    let channel = (CUBE_POS_X * LANES + UNIT_POS_X) as usize;
    let n_rows = before.len() / channels;
    let mut first = 0.0f32;
    let mut second = 0.0f32;
    if channel < channels {
        let mean = numbers[channel];
        let begin = (CUBE_POS_Y * rows_a_block) as usize;
        let end = (begin + rows_a_block as usize).min(n_rows);
        let mut row = begin + UNIT_POS_Y as usize;
        while row < end {
            let at = row * channels + channel;
            let gradient = passed(out[at], out_gradient[at], rectifies);
            first += gradient;
            second += gradient * (before[at] - mean);
            row += ROWS as usize;
        }
    }
    write_sums(first, second, sums, channel, channels);
}

/// Adds what the rows of a cube have summed, and writes it as block `CUBE_POS_Y` of `[blocks, 2, channels]`.
#[cube]
fn write_sums(first: f32, second: f32, sums: &mut [f32], channel: usize, #[comptime] channels: usize) {
    let (first, second) = over_cube(first, second);
    if UNIT_POS_Y == 0 && channel < channels {
        let block = CUBE_POS_Y as usize * 2 * channels;
        sums[block + channel] = first;
        sums[block + channels + channel] = second;
    }
}

/// The sums over the rows of a cube, in the threads of its first row.
#[cube]
fn over_cube(first: f32, second: f32) -> (f32, f32) {
    let mut shared = Shared::<[f32]>::new_slice(comptime![(2 * LANES * ROWS) as usize]);
    let half = (LANES * ROWS) as usize;
    let at = (UNIT_POS_Y * LANES + UNIT_POS_X) as usize;
    shared[at] = first;
    shared[half + at] = second;
    sync_cube();
    let mut first = 0.0f32;
    let mut second = 0.0f32;
    if UNIT_POS_Y == 0 {
        #[unroll]
        for row in 0..ROWS {
            let at = (row * LANES + UNIT_POS_X) as usize;
            first += shared[at];
            second += shared[half + at];
        }
    }
    (first, second)
}

/// The sums of all blocks of a channel, in the threads of a cube's first row.
#[cube]
fn over_blocks(sums: &[f32], channel: usize, #[comptime] channels: usize) -> (f32, f32) {
    let mut first = 0.0f32;
    let mut second = 0.0f32;
    if channel < channels {
        let n_blocks = sums.len() / (2 * channels);
        let mut block = UNIT_POS_Y as usize;
        while block < n_blocks {
            first += sums[block * 2 * channels + channel];
            second += sums[(block * 2 + 1) * channels + channel];
            block += ROWS as usize;
        }
    }
    over_cube(first, second)
}

/// What normalises each channel, from the sums of its blocks: `numbers` is `[4, channels]`, mean, 1 / deviation, and the
/// factor and the summand that do it. The running statistics follow by `momentum`.
#[cube(launch)]
pub fn norm(
    values: &[f32],
    sums: &[f32],
    gamma: &[f32],
    beta: &[f32],
    running_mean: &[f32],
    running_variance: &[f32],
    numbers: &mut [f32],
    new_mean: &mut [f32],
    new_variance: &mut [f32],
    epsilon: f32,
    momentum: f32,
    #[comptime] channels: usize,
) {
    let channel = (CUBE_POS_X * LANES + UNIT_POS_X) as usize;
    let (first, second) = over_blocks(sums, channel, channels);
    if UNIT_POS_Y == 0 && channel < channels {
        let n_rows = f32::cast_from(values.len() / channels);
        let shift = first / n_rows;
        let mean = values[channel] + shift;
        let variance = (second / n_rows - shift * shift).max(0.0f32);
        let inverse = 1.0f32 / (variance + epsilon).sqrt();
        let scale = gamma[channel] * inverse;
        numbers[channel] = mean;
        numbers[channels + channel] = inverse;
        numbers[2 * channels + channel] = scale;
        numbers[3 * channels + channel] = beta[channel] - mean * scale;
        new_mean[channel] = running_mean[channel] * (1.0f32 - momentum) + mean * momentum;
        new_variance[channel] = running_variance[channel] * (1.0f32 - momentum) + variance * momentum;
    }
}

/// `relu(factor * before + summand [+ skip])`.
#[cube(launch)]
pub fn apply(
    before: &[f32],
    skip: &[f32],
    numbers: &[f32],
    out: &mut [f32],
    #[comptime] channels: usize,
    #[comptime] skips: bool,
    #[comptime] rectifies: bool,
) {
    let at = ABSOLUTE_POS;
    if at < out.len() {
        let channel = at % channels;
        let mut value = before[at] * numbers[2 * channels + channel] + numbers[3 * channels + channel];
        if skips {
            value += skip[at];
        }
        if rectifies {
            value = value.max(0.0f32);
        }
        out[at] = value;
    }
}

/// From the sums of the blocks the gradients of gamma and beta, and `back` `[2, channels]`: slope and offset of
/// [`norm_gradient`].
#[cube(launch)]
pub fn gradient_numbers(
    before: &[f32],
    sums: &[f32],
    numbers: &[f32],
    gamma: &mut [f32],
    beta: &mut [f32],
    back: &mut [f32],
    #[comptime] channels: usize,
) {
    let channel = (CUBE_POS_X * LANES + UNIT_POS_X) as usize;
    let (first, second) = over_blocks(sums, channel, channels);
    if UNIT_POS_Y == 0 && channel < channels {
        let n_rows = f32::cast_from(before.len() / channels);
        let inverse = numbers[channels + channel];
        let slope = second * inverse / n_rows * inverse;
        gamma[channel] = second * inverse;
        beta[channel] = first;
        back[channel] = slope;
        back[channels + channel] = first / n_rows - slope * numbers[channel];
    }
}

/// The gradient of the convolution's output: `factor * (passed - offset - slope * before)` of each channel.
#[cube(launch)]
pub fn norm_gradient(
    before: &[f32],
    out: &[f32],
    out_gradient: &[f32],
    numbers: &[f32],
    back: &[f32],
    gradient: &mut [f32],
    #[comptime] channels: usize,
    #[comptime] rectifies: bool,
) {
    let at = ABSOLUTE_POS;
    if at < gradient.len() {
        let channel = at % channels;
        let passed = passed(out[at], out_gradient[at], rectifies);
        let centred = passed - back[channels + channel] - back[channel] * before[at];
        gradient[at] = numbers[2 * channels + channel] * centred;
    }
}

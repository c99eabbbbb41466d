//! LAMB's kernels: one cube of threads takes a block of a tensor's values at a time.

#![allow(clippy::too_many_arguments, reason = "a kernel takes its buffers one by one")]

use burn_cubecl::cubecl;
use cubecl::prelude::*;

/// Threads of a cube.
pub const THREADS: u32 = 256;

/// Most cubes of a tensor.
pub const MAX_CUBES: usize = 128;

/// Moments and update of each value, and of each cube the sums of squares of weights and of the update, `[cubes, 2]`.
#[cube(launch)]
pub fn update(
    weights: &[f32],
    gradient: &[f32],
    first: &[f32],
    second: &[f32],
    new_first: &mut [f32],
    new_second: &mut [f32],
    update: &mut [f32],
    squares: &mut [f32],
    beta_1: f32,
    beta_2: f32,
    unbias_1: f32,
    unbias_2: f32,
    epsilon: f32,
    decay: f32,
) {
    let mut of_weights = 0.0f32;
    let mut of_update = 0.0f32;
    let mut at = ABSOLUTE_POS;
    let step = CUBE_COUNT_X as usize * THREADS as usize;
    while at < weights.len() {
        let (weight, slope) = (weights[at], gradient[at]);
        let mean = first[at] * beta_1 + slope * (1.0f32 - beta_1);
        let square = second[at] * beta_2 + slope * slope * (1.0f32 - beta_2);
        let change = (mean / unbias_1) / ((square / unbias_2).sqrt() + epsilon) + weight * decay;
        new_first[at] = mean;
        new_second[at] = square;
        update[at] = change;
        of_weights += weight * weight;
        of_update += change * change;
        at += step;
    }
    let (of_weights, of_update) = over_cube(of_weights, of_update);
    if UNIT_POS == 0 {
        squares[2 * CUBE_POS_X as usize] = of_weights;
        squares[2 * CUBE_POS_X as usize + 1] = of_update;
    }
}

/// The weights, moved against the update by `rate` times the ratio of their lengths.
#[cube(launch)]
pub fn apply(weights: &[f32], update: &[f32], squares: &[f32], out: &mut [f32], rate: f32) {
    let mut of_weights = 0.0f32;
    let mut of_update = 0.0f32;
    let mut block = UNIT_POS as usize;
    while block < squares.len() / 2 {
        of_weights += squares[2 * block];
        of_update += squares[2 * block + 1];
        block += THREADS as usize;
    }
    let (of_weights, of_update) = over_cube(of_weights, of_update);
    let mut trust = 1.0f32;
    if of_weights > 0.0 && of_update > 0.0 {
        trust = (of_weights / of_update).sqrt();
    }
    let mut at = ABSOLUTE_POS;
    let step = CUBE_COUNT_X as usize * THREADS as usize;
    while at < out.len() {
        out[at] = weights[at] - update[at] * trust * rate;
        at += step;
    }
}

/// The sum of squares of all values, by one cube, as number `at` of `sums`.
#[cube(launch)]
pub fn squares(values: &[f32], sums: &mut [f32], at: usize) {
    let mut sum = 0.0f32;
    let mut next = UNIT_POS as usize;
    while next < values.len() {
        sum += values[next] * values[next];
        next += THREADS as usize;
    }
    let (sum, _) = over_cube(sum, 0.0f32);
    if UNIT_POS == 0 {
        sums[at] = sum;
    }
}

/// `slow + (fast - slow) * share`, as `slow * (1 - share) + fast * share`.
#[cube(launch)]
pub fn follow(slow: &[f32], fast: &[f32], out: &mut [f32], share: f32) {
    let at = ABSOLUTE_POS;
    if at < out.len() {
        out[at] = slow[at] * (1.0f32 - share) + fast[at] * share;
    }
}

/// The sums over a cube, in all of its threads.
#[cube]
fn over_cube(first: f32, second: f32) -> (f32, f32) {
    let mut shared = Shared::<[f32]>::new_slice(comptime![2 * THREADS as usize]);
    let at = UNIT_POS as usize;
    shared[at] = first;
    shared[THREADS as usize + at] = second;
    sync_cube();
    #[unroll]
    for halving in 0..8u32 {
        let half = comptime![(THREADS >> (halving + 1)) as usize];
        if at < half {
            let other = shared[at + half];
            shared[at] += other;
            let other = shared[THREADS as usize + at + half];
            shared[THREADS as usize + at] += other;
        }
        sync_cube();
    }
    (shared[0], shared[THREADS as usize])
}

//! Products of matrices of f32 on a graphics card, for the shapes of a layer: one factor is tall, the other small.
//!
//! A cube of threads makes a tile of the result; the tiles of the factors that it needs go through memory which its threads
//! share, and each thread keeps its values in registers. burn's own products are chosen by trying some fifteen kernels for each
//! shape, which takes minutes at the first step; this one needs no choice.

#![allow(clippy::too_many_arguments, reason = "a kernel takes its buffers one by one")]

use burn_cubecl::cubecl;
use burn_cubecl::cubecl::prelude::*;
use burn_cubecl::kernel::matmul::{MatmulStrategy, matmul};
use burn_cubecl::ops::{permute, reshape};
use burn_cubecl::tensor::CubeTensor;

use crate::embedding::card::{like, one_a_value};

/// Rows of a tile.
const TILE_M: usize = 128;
/// Terms of the sums that are shared at a time.
const TILE_K: usize = 16;
/// Threads along the rows and along the columns of a tile.
const SIDE: usize = 16;
/// Rows of a thread.
const ROWS: usize = TILE_M / SIDE;
/// Tiles that keep a large card busy.
const ENOUGH_TILES: usize = 264;
/// Fewest terms of a part of a sum.
const MIN_TERMS: usize = 256;
/// Values that are read and written together.
const FOUR: usize = 4;

type Four = Vector<f32, Const<4>>;

/// How the first factor is kept, and how many fours of columns a thread has; known when the kernel is compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Layout {
    /// The first factor as `[k, m]` instead of `[m, k]`.
    turned: bool,
    /// Fours of columns of a thread.
    fours: usize,
}

/// `a b`, `[m, n]`, of `a` `[m, k]`, or `[k, m]` where it is `turned`, and `b` `[k, n]`, row by row without gaps. Sums of many
/// terms are made in parts, whose order does not depend on the card.
pub fn product(a: &CubeTensor, turned: bool, b: &CubeTensor, [m, k, n]: [usize; 3]) -> CubeTensor {
    let inner = if turned { m } else { k };
    if !inner.is_multiple_of(FOUR) || !n.is_multiple_of(FOUR) {
        return any_product(a, turned, b, [m, n]);
    }
    let layout = Layout { turned, fours: if n > SIDE * FOUR { 2 } else { 1 } };
    let tiles = [m.div_ceil(TILE_M), n.div_ceil(SIDE * FOUR * layout.fours)];
    let mut parts = 1;
    while tiles[0] * tiles[1] * parts < ENOUGH_TILES && k / (2 * parts) >= MIN_TERMS {
        parts *= 2;
    }
    let terms = k.div_ceil(parts).next_multiple_of(TILE_K);
    let parts = k.div_ceil(terms);
    let out = like(a, &[parts, m, n]);
    multiply::launch(
        &out.client,
        CubeCount::Static(tiles[1] as u32, tiles[0] as u32, parts as u32),
        CubeDim::new_1d((SIDE * SIDE) as u32),
        a.clone().into_buffer_arg(),
        b.clone().into_buffer_arg(),
        out.clone().into_buffer_arg(),
        m,
        n,
        k,
        terms,
        layout,
    );
    if parts == 1 {
        return reshape(out, [m, n].into());
    }
    let sum = like(a, &[m, n]);
    let (count, cube) = one_a_value(&sum);
    add_parts::launch(&sum.client, count, cube, out.into_buffer_arg(), sum.clone().into_buffer_arg());
    sum
}

/// A product of matrices whose sides are no multiples of four, by burn's kernels.
fn any_product(a: &CubeTensor, turned: bool, b: &CubeTensor, shape: [usize; 2]) -> CubeTensor {
    let meant = if turned { permute(a.clone(), &[1, 0]) } else { a.clone() };
    let (out, dtype) = (like(a, &shape), a.dtype);
    #[expect(clippy::expect_used, reason = "shapes agree by construction, and burn's plainest kernel takes any")]
    matmul(meant, b.clone(), Some(out), MatmulStrategy::default(), dtype).expect("matrices of agreeing shapes")
}

/// The sum of a product's parts.
#[cube(launch)]
fn add_parts(parts: &[f32], sum: &mut [f32]) {
    let at = ABSOLUTE_POS;
    if at < sum.len() {
        let mut total = 0.0f32;
        let mut part = at;
        while part < parts.len() {
            total += parts[part];
            part += sum.len();
        }
        sum[at] = total;
    }
}

/// A tile of a product, or of the part `CUBE_POS_Z` of its sums. A thread has `ROWS` rows of fours of columns.
#[cube(launch)]
fn multiply(
    a: &[Four],
    b: &[Four],
    out: &mut [Four],
    m: usize,
    n: usize,
    k: usize,
    terms: usize,
    #[comptime] layout: Layout,
) {
    // `[m, k]`: a row's terms next to each other, and a gap so that threads of different rows do not wait for one bank.
    let pitch_a = comptime![if layout.turned { TILE_M / FOUR } else { TILE_K / FOUR + 1 }];
    let tile_b = comptime![SIDE * layout.fours];
    let mut shared_a = Shared::<[Four]>::new_slice(comptime![TILE_M * (TILE_K / FOUR + 1)]);
    let mut shared_b = Shared::<[Four]>::new_slice(comptime![TILE_K * SIDE * layout.fours]);
    let zero = Four::new(0.0f32);
    let mut sums = Array::<Four>::new(comptime![ROWS * layout.fours]);
    #[unroll]
    for at in 0..comptime![ROWS * layout.fours] {
        sums[at] = zero;
    }

    let thread = UNIT_POS as usize;
    let column = thread % SIDE;
    let row = thread / SIDE;
    let first_m = CUBE_POS_Y as usize * TILE_M;
    let first_n = CUBE_POS_X as usize * tile_b; // in fours
    let columns = n / FOUR;
    let mut first_k = CUBE_POS_Z as usize * terms;
    let end = (first_k + terms).min(k);

    while first_k < end {
        #[unroll]
        for load in 0..comptime![TILE_M * TILE_K / FOUR / (SIDE * SIDE)] {
            let at = load * SIDE * SIDE + thread;
            let mut value = zero;
            if layout.turned {
                let (term, four) = (at / comptime![TILE_M / FOUR], at % comptime![TILE_M / FOUR]);
                if first_m + four * FOUR < m && first_k + term < end {
                    value = a[((first_k + term) * m + first_m) / FOUR + four];
                }
                shared_a[term * pitch_a + four] = value;
            } else {
                let (tile_row, four) = (at / comptime![TILE_K / FOUR], at % comptime![TILE_K / FOUR]);
                if first_m + tile_row < m && first_k + four * FOUR < end {
                    value = a[((first_m + tile_row) * k + first_k) / FOUR + four];
                }
                shared_a[tile_row * pitch_a + four] = value;
            }
        }
        #[unroll]
        for load in 0..comptime![layout.fours * TILE_K / SIDE] {
            let at = load * SIDE * SIDE + thread;
            let (term, four) = (at / tile_b, at % tile_b);
            let mut value = zero;
            if first_n + four < columns && first_k + term < end {
                value = b[(first_k + term) * columns + first_n + four];
            }
            shared_b[term * tile_b + four] = value;
        }
        sync_cube();
        #[unroll]
        for four in 0..comptime![TILE_K / FOUR] {
            let mut of_a = Array::<Four>::new(comptime![ROWS]);
            if comptime![!layout.turned] {
                #[unroll]
                for i in 0..ROWS {
                    of_a[i] = shared_a[(row + i * SIDE) * pitch_a + four];
                }
            }
            #[unroll]
            for part in 0..FOUR {
                let term = comptime![four * FOUR + part];
                if layout.turned {
                    of_a[0] = shared_a[term * pitch_a + row];
                    of_a[1] = shared_a[term * pitch_a + row + SIDE];
                }
                #[unroll]
                for j in 0..layout.fours {
                    let of_b = shared_b[term * tile_b + column + j * SIDE];
                    #[unroll]
                    for i in 0..ROWS {
                        let at = comptime![i * layout.fours + j];
                        let (which, lane) = comptime![if layout.turned { (i / FOUR, i % FOUR) } else { (i, part) }];
                        sums[at] = fma(Four::new(of_a[which].extract(lane)), of_b, sums[at]);
                    }
                }
            }
        }
        sync_cube();
        first_k += TILE_K;
    }
    #[unroll]
    for i in 0..ROWS {
        let mut y = first_m + row + i * SIDE;
        if layout.turned {
            y = first_m + comptime![i / FOUR * SIDE * FOUR + i % FOUR] + row * FOUR;
        }
        #[unroll]
        for j in 0..layout.fours {
            let x = first_n + column + j * SIDE;
            if y < m && x < columns {
                out[(CUBE_POS_Z as usize * m + y) * columns + x] = sums[comptime![i * layout.fours + j]];
            }
        }
    }
}

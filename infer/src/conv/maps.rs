//! The linear maps of Winograd's F(2, 3), along one axis and along both: weights, inputs and outputs of a window.

use pulp::Simd;

/// A linear map of `$m` vectors to `$k` on the lines and then the columns of a square. Loops, because closures and
/// the array's own `map` are not compiled for the wide vectors of their caller.
macro_rules! both_ways {
    ($simd:ident: $s:ty, $map:ident, $square:ident, $m:literal -> $k:literal) => {{
        let zero = $simd.splat_f32s(0.0);
        let mut lines = [[zero; $k]; $m];
        for y in 0..$m {
            lines[y] = $map::<$s>($simd, $square[y]);
        }
        let mut made = [[zero; $k]; $k];
        for x in 0..$k {
            let mut column = [zero; $m];
            for y in 0..$m {
                column[y] = lines[y][x];
            }
            let mapped = $map::<$s>($simd, column);
            for y in 0..$k {
                made[y][x] = mapped[y];
            }
        }
        made
    }};
}

pub(super) use both_ways;

/// `G g`: three weights as the four of a window.
pub fn widen([a, b, c]: [f32; 3]) -> [f32; 4] {
    [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c]
}

/// `G^T u`: the adjoint of [`widen`].
pub fn narrow([a, b, c, d]: [f32; 4]) -> [f32; 3] {
    [a + 0.5 * (b + c), 0.5 * (b - c), 0.5 * (b + c) + d]
}

/// `B^T d`: four inputs as the four of a window.
#[inline(always)]
pub fn into_window<S: Simd>(simd: S, [a, b, c, d]: [S::f32s; 4]) -> [S::f32s; 4] {
    [simd.sub_f32s(a, c), simd.add_f32s(b, c), simd.sub_f32s(c, b), simd.sub_f32s(b, d)]
}

/// `A^T m`: four sums as two outputs.
#[inline(always)]
pub fn out_of_window<S: Simd>(simd: S, [a, b, c, d]: [S::f32s; 4]) -> [S::f32s; 2] {
    [simd.add_f32s(simd.add_f32s(a, b), c), simd.sub_f32s(simd.sub_f32s(b, c), d)]
}

/// `A y`: the adjoint of [`out_of_window`].
#[inline(always)]
pub fn back_into_window<S: Simd>(simd: S, [a, b]: [S::f32s; 2]) -> [S::f32s; 4] {
    [a, simd.add_f32s(a, b), simd.sub_f32s(a, b), simd.sub_f32s(simd.splat_f32s(0.0), b)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    #[test]
    fn four_products_make_two_outputs_of_three_taps() {
        let (g, d) = ([0.5, -2.0, 3.0], [1.0, 4.0, -1.5, 2.0]);
        let [weights, window] = [widen(g), into_window(Scalar, d)];
        let products = std::array::from_fn(|k| weights[k] * window[k]);
        let direct = [0, 1].map(|at| (0..3).map(|tap| g[tap] * d[at + tap]).sum::<f32>());
        assert_eq!(out_of_window(Scalar, products), direct);
    }

    #[test]
    fn the_way_back_is_the_adjoint() {
        let (u, g, y) = ([1.0, -3.0, 0.5, 2.0], [2.0, 5.0, -1.0], [4.0, -0.5]);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        assert_eq!(dot(&widen(g), &u), dot(&g, &narrow(u)));
        assert_eq!(dot(&out_of_window(Scalar, u), &y), dot(&u, &back_into_window(Scalar, y)));
    }
}

//! Each body of the inner products, one for each vector unit, against the others and against the definition.

use std::io::Write;

use multiversion::multiversion;

use super::*;
use crate::bank::similarity::in_lanes;

/// The bodies of an inner product: what every processor of the architecture runs, and what one with AVX2 does.
macro_rules! bodies {
    ($name:ident, $value:ty, $other:ty, $of:path) => {
        mod $name {
            use super::*;

            pub fn baseline(a: &[$value], b: &[$other]) -> f32 {
                $of(a, b)
            }

            #[multiversion(targets("x86_64+avx2"))]
            pub fn avx2(a: &[$value], b: &[$other]) -> f32 {
                $of(a, b)
            }

            #[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw"))]
            pub fn avx512(a: &[$value], b: &[$other]) -> f32 {
                $of(a, b)
            }
        }
    };
}

bodies!(wide, f32, f32, in_lanes);
bodies!(whole, i8, i8, whole_dot);
bodies!(of_query, i16, i8, whole_query_dot);

type Body<A, B> = fn(&[A], &[B]) -> f32;

/// The bodies among three that this machine runs. Says which they are and which are not, past the capture of a test's
/// output: what was not run must be seen where all passes.
fn here<A, B>(what: &str, bodies: [Body<A, B>; 3]) -> Vec<Body<A, B>> {
    #[cfg(target_arch = "x86_64")]
    let has = [
        true,
        is_x86_feature_detected!("avx2"),
        // As the dispatcher asks for it: processors before VBMI2 lower their clock for these.
        is_x86_feature_detected!("avx512vbmi2") && is_x86_feature_detected!("avx512bw"),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let has = [true, false, false];
    let named = |is: bool| {
        let of_kind = ["baseline", "AVX2", "AVX-512"].into_iter().zip(has).filter(move |(_, has)| *has == is);
        of_kind.map(|(name, _)| name).collect::<Vec<_>>()
    };
    let (run, missing) = (named(true), named(false));
    let n_missing = missing.len();
    let line = format!("{what}: compared on {run:?}; {n_missing} not run, this machine lacks {missing:?}\n");
    std::io::stderr().write_all(line.as_bytes()).unwrap();
    bodies.into_iter().zip(has).filter(|(_, has)| *has).map(|(body, _)| body).collect()
}

/// No values, fewer than lanes, whole lanes, lanes with remainders, and the longest rows.
const LENGTHS: [usize; 16] = [0, 1, 3, 7, 8, 15, 16, 17, 31, 32, 33, 127, 128, 131, 1_000, MAX_DIM];

/// Whole numbers are summed without any error: every body gives the sum, to the bit of its one rounding to f32.
#[test]
fn every_body_sums_whole_numbers_exactly() {
    let whole = here("inner products of i8", [whole::baseline, whole::avx2, whole::avx512]);
    let of_query = here("inner products of i16 and i8", [of_query::baseline, of_query::avx2, of_query::avx512]);
    for n in LENGTHS {
        for most in [127_i32, 3] {
            let row = |seed: i32| -> Vec<i8> {
                // The largest at all places, and any.
                let value = |i: i32| if most == 127 { 127 } else { (i * 7_919 + seed * 31) % 255 - 127 };
                (0..n as i32).map(|i| value(i) as i8).collect()
            };
            let (a, b) = (row(1), row(2));
            let query: Vec<i16> = a.iter().map(|value| i16::from(*value) * 32).collect();
            let sum = |factor: i64| a.iter().zip(&b).map(|(a, b)| factor * i64::from(*a) * i64::from(*b)).sum::<i64>();
            assert!(whole.iter().all(|body| body(&a, &b) == sum(1) as f32), "{n}");
            assert!(of_query.iter().all(|body| body(&query, &b) == sum(32) as f32), "{n}");
        }
    }
}

/// Sixteen lanes on every unit and nothing fused: one result, to the bit, within Higham's bound of the exact sum.
#[test]
fn every_body_sums_f32_to_the_same_bits() {
    let wide = here("inner products of f32", [wide::baseline, wide::avx2, wide::avx512]);
    for n in LENGTHS {
        let values = |seed: usize| -> Vec<f32> { (0..n).map(|i| ((i * 37 + seed) as f32 * 0.37).sin()).collect() };
        let (mut a, b) = (values(1), values(2));
        let products = || a.iter().zip(&b).map(|(a, b)| f64::from(*a) * f64::from(*b));
        let (exact, size) = (products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
        let first = wide[0](&a, &b);
        let n_roundings = n.div_ceil(16) + 17 + n % 16;
        assert!((f64::from(first) - exact).abs() <= n_roundings as f64 * size / f64::from(1 << 24), "{n}");
        assert!(wide.iter().all(|body| body(&a, &b).to_bits() == first.to_bits()), "{n}");
        // Denormal numbers, infinities and NaN, at each end, in whole lanes and in what is left of them.
        for odd in [1e-45, -1e-40, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 3e38] {
            for at in [0, n / 2, n.saturating_sub(1)].into_iter().filter(|at| *at < n) {
                let before = std::mem::replace(&mut a[at], odd);
                let first = wide[0](&a, &b);
                let is_same = |found: f32| found.to_bits() == first.to_bits() || found.is_nan() && first.is_nan();
                assert!(wide.iter().all(|body| is_same(body(&a, &b))), "{n} {odd}");
                assert!(odd.is_finite() || !first.is_finite(), "{n} {odd}: {first}");
                a[at] = before;
            }
        }
    }
}

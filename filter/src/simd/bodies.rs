//! Each body of a function, one for each vector unit, against the others and against the definition.

use std::io::Write;

use super::*;

/// What a body is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// What every processor of the architecture has.
    Baseline,
    /// 256 bits.
    Avx2,
    /// 512 bits.
    Avx512,
}

impl Unit {
    const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Whether this machine runs it. Without it the dispatcher would run the baseline under its name.
    fn is_here(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                // Some processors lower their clock for these: those before VBMI2 are not asked for them.
                let of_width = is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw");
                let of_age = is_x86_feature_detected!("avx512vbmi2")
                    && is_x86_feature_detected!("avx512bitalg")
                    && is_x86_feature_detected!("avx512vnni")
                    && is_x86_feature_detected!("gfni")
                    && is_x86_feature_detected!("vaes")
                    && is_x86_feature_detected!("vpclmulqdq");
                of_width && of_age
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The units of this machine. Says which they are and which are not, past the capture of a test's output: what was
    /// not run must be seen where all passes.
    fn here(what: &str) -> Vec<Self> {
        let (here, missing): (Vec<Self>, Vec<Self>) = Self::ALL.into_iter().partition(|unit| unit.is_here());
        let n_missing = missing.len();
        let line = format!("{what}: compared on {here:?}; {n_missing} not run, this machine lacks {missing:?}\n");
        std::io::stderr().write_all(line.as_bytes()).unwrap();
        here
    }
}

/// A function's bodies, and `of`, which calls the one for a unit.
macro_rules! bodies {
    ($($given:ident: $kind:ty),+ $(=> $made:ty)?; $body:block) => {
        fn baseline($($given: $kind),+) $(-> $made)? $body

        #[multiversion(targets("x86_64+avx2"))]
        fn avx2($($given: $kind),+) $(-> $made)? $body

        #[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw"))]
        fn avx512($($given: $kind),+) $(-> $made)? $body

        pub fn of(unit: bodies::Unit, $($given: $kind),+) $(-> $made)? {
            match unit {
                bodies::Unit::Baseline => baseline($($given),+),
                bodies::Unit::Avx2 => avx2($($given),+),
                bodies::Unit::Avx512 => avx512($($given),+),
            }
        }
    };
}

pub(super) use bodies;

/// What is inlined into the functions that interpolate.
mod blending {
    use super::*;

    pub mod four {
        use super::*;
        bodies!(weights: &[f32; 4], lines: [&[f32]; 4], out: &mut [f32]; { blend(weights, lines, out); });
    }

    pub mod six {
        use super::*;
        bodies!(constant: f32, weights: &[f32; 6], lines: [&[f32]; 6], out: &mut [f32]; {
            blend_six(constant, weights, lines, out);
        });
    }
}

/// No values, fewer than lanes, whole lanes, and lanes with every remainder.
const LENGTHS: [usize; 22] = [0, 1, 2, 3, 5, 7, 8, 9, 11, 15, 16, 17, 23, 24, 31, 32, 33, 63, 64, 65, 127, 1_001];

/// Logs as they come, and those that may come: denormal numbers, zeros of either sign, infinities and NaN.
fn logs(n: usize, odd: bool) -> Vec<f64> {
    const ODD: [f64; 11] = [
        -5e-324,
        -2.3e-308,
        -0.0,
        0.0,
        -707.999,
        -708.0,
        -708.001,
        -1e300,
        f64::NEG_INFINITY,
        f64::NAN,
        -f64::MIN_POSITIVE,
    ];
    let usual = |i: usize| -((i * 7_919 % 1_009) as f64) * 0.043;
    (0..n).map(|i| if odd && i % 3 == 1 { ODD[i / 3 % ODD.len()] } else { usual(i) }).collect()
}

fn values(n: usize, seed: usize, odd: bool) -> Vec<f32> {
    const ODD: [f32; 9] =
        [1e-45, -1e-40, 0.0, -0.0, f32::MIN_POSITIVE, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, -3e38];
    let usual = |i: usize| ((i * 7_919 + seed * 104_729) % 1_009) as f32 / 50.0 - 10.0;
    (0..n).map(|i| if odd && (i + seed) % 4 == 1 { ODD[i / 4 % ODD.len()] } else { usual(i) }).collect()
}

/// All NaN are one: which of two a processor keeps is its own.
fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() }).collect()
}

fn bits_f32(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| if value.is_nan() { f32::NAN.to_bits() } else { value.to_bits() }).collect()
}

/// e^x as it is meant: nothing below the normal numbers and of what is no number.
fn power_of(x: f64) -> f64 {
    if x >= -708.0 { x.exp() } else { 0.0 }
}

/// What `of` makes of each length, without and with odd values, is equal to the bit for each unit; returns the first
/// unit's.
fn alike<T: PartialEq + std::fmt::Debug>(units: &[Unit], of: impl Fn(Unit, usize, bool) -> T) -> Vec<(usize, bool, T)> {
    let mut made = Vec::new();
    for (n, odd) in LENGTHS.into_iter().flat_map(|n| [(n, false), (n, true)]) {
        let first = of(units[0], n, odd);
        for unit in &units[1..] {
            assert_eq!(of(*unit, n, odd), first, "{unit:?}, {n} values, odd ones: {odd}");
        }
        made.push((n, odd, first));
    }
    made
}

/// Lanes are as many on each unit, and nothing is fused: there is no error between them at all. To the definition it is
/// 2 units in the last place of each power, and of sums what n roundings make.
#[test]
fn every_body_of_the_logs_functions_makes_the_same_bits() {
    let units = Unit::here("simd, f64");
    let joint = 0.37;
    let made = alike(&units, |unit, n, odd| {
        powers::of(unit, &logs(n, odd), 0.0, joint).iter().map(|p| p.to_bits()).collect::<Vec<_>>()
    });
    for (n, odd, found) in made {
        for (bits, log) in found.into_iter().zip(logs(n, odd)) {
            let (found, expected) = (f64::from_bits(bits), power_of(joint * log));
            assert!((found - expected).abs() <= 4.5e-16 * expected, "{log}: {found}, not {expected}");
        }
    }
    let made = alike(&units, |unit, n, odd| {
        let (mut lowered, mut exps) = (logs(n, odd), vec![7.0; 3]);
        lower::of(unit, &mut lowered, 1.5, &mut exps);
        [bits(&lowered), bits(&exps)]
    });
    for (n, odd, [lowered, exps]) in made {
        for ((log, lowered), power) in logs(n, odd).into_iter().zip(lowered).zip(exps) {
            let expected = if log.is_nan() { f64::NEG_INFINITY } else { log - 1.5 };
            assert_eq!(f64::from_bits(lowered), expected);
            assert!((f64::from_bits(power) - power_of(expected)).abs() <= 4.5e-16 * power_of(expected));
        }
    }
    let made = alike(&units, |unit, n, odd| bits(&sums_of_powers::of(unit, &logs(n, odd), 0.0)));
    for (n, odd, found) in made {
        let of = |log: f64| [power_of(log), log * power_of(log)];
        let pairs = logs(n, odd).into_iter().map(of).filter(|[power, _]| *power > 0.0);
        let [sum, log_sum] = pairs.fold([0.0, 0.0], |[a, b], [c, d]| [a + c, b + d]);
        let bound = 4.0 * (n as f64 + 4.0) * f64::EPSILON;
        let found: Vec<f64> = found.into_iter().map(f64::from_bits).collect();
        assert!((found[0] - sum).abs() <= bound * sum && (found[1] - log_sum).abs() <= -bound * log_sum, "{n} {odd}");
    }
}

#[test]
fn every_body_of_the_sums_makes_the_same_bits() {
    let units = Unit::here("simd, sums");
    let counts = |n: usize| (0..n).map(|i| (i % 5) as f64 / 4.0).collect::<Vec<f64>>();
    let made = alike(&units, |unit, n, odd| {
        let (mut plain, mut weighted) = (counts(n), logs(n, false));
        add::of(unit, &logs(n, odd), &mut plain);
        add_weighted::of(unit, &logs(n, odd), &counts(n), &mut weighted);
        [bits(&plain), bits(&weighted)]
    });
    for (n, odd, [plain, weighted]) in made {
        let each = logs(n, odd).into_iter().zip(counts(n)).zip(logs(n, false));
        let expected: Vec<[f64; 2]> = each.map(|((value, count), log)| [count + value, log + count * value]).collect();
        assert_eq!(plain, bits(&expected.iter().map(|pair| pair[0]).collect::<Vec<_>>()));
        assert_eq!(weighted, bits(&expected.iter().map(|pair| pair[1]).collect::<Vec<_>>()));
    }
}

#[test]
fn every_body_of_the_interpolation_makes_the_same_bits() {
    let units = Unit::here("simd, f32");
    let made = alike(&units, |unit, n, odd| {
        let mut found = values(n, 1, odd);
        softplus::of(unit, &mut found);
        bits_f32(&found)
    });
    for (n, odd, found) in made {
        for (found, z) in found.into_iter().map(f32::from_bits).zip(values(n, 1, odd)) {
            // What is no number is nothing, as e^NaN is.
            let z = if z.is_nan() { f64::NEG_INFINITY } else { f64::from(z) };
            let exact = z.max(0.0) + (-z.abs()).exp().ln_1p();
            let is_near = (f64::from(found) - exact).abs() <= 3e-7 + 1e-7 * exact;
            assert!(is_near || f64::from(found) == exact, "{z}: {found}, not {exact}");
        }
    }
    let weights = [0.5625_f32, -0.0625, 0.5, -0.125, 1.25, -2.0];
    let made = alike(&units, |unit, n, odd| {
        let lines: Vec<Vec<f32>> = (0..6).map(|seed| values(n, seed, odd)).collect();
        let (mut four, mut six) = (vec![0.0; n], vec![0.0; n]);
        let four_weights = [0, 1, 2, 3].map(|k: usize| weights[k]);
        blending::four::of(unit, &four_weights, [0, 1, 2, 3].map(|k: usize| lines[k].as_slice()), &mut four);
        let lines = [0, 1, 2, 3, 4, 5].map(|k: usize| lines[k].as_slice());
        blending::six::of(unit, 0.25, &weights, lines, &mut six);
        [bits_f32(&four), bits_f32(&six)]
    });
    for (n, odd, found) in made {
        let lines: Vec<Vec<f32>> = (0..6).map(|seed| values(n, seed, odd)).collect();
        for ((found, n_lines), constant) in found.into_iter().zip([4, 6]).zip([0.0, 0.25]) {
            for (i, found) in found.into_iter().map(f32::from_bits).enumerate() {
                let products = || (0..n_lines).map(|k| f64::from(weights[k]) * f64::from(lines[k][i]));
                let (exact, sizes) = (constant + products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
                // So many roundings, each of at most the sum of the sizes; beyond the range of f32 infinite or no
                // number.
                let is_near = (f64::from(found) - exact).abs() <= 8.0 * (sizes + 1.0) / f64::from(1 << 24);
                assert!(is_near || (!exact.is_finite() || sizes > 3e38) && !found.is_finite(), "{i}: {found} {exact}");
            }
        }
    }
}

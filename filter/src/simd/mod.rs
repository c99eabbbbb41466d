//! What is asked of every state at every touch, in lanes, so that it vectorises: one after the other, each addition
//! would wait for the one before.

use multiversion::multiversion;

#[cfg(test)]
mod bodies;

const N: usize = 8;

/// A function that is compiled for each of some vector units: the first that the machine has is called. For tests there
/// is a module of the same name, by which each body is called alone.
macro_rules! for_units {
    ($(#[$doc:meta])* [$($unit:literal),+] $name:ident($($given:ident: $kind:ty),+) $(-> $made:ty)? $body:block) => {
        $(#[$doc])*
        #[multiversion(targets($($unit),+))]
        pub fn $name($($given: $kind),+) $(-> $made)? $body

        #[cfg(test)]
        pub mod $name {
            use super::*;
            bodies::bodies!($($given: $kind),+ $(=> $made)?; $body);
        }
    };
}

/// The sum of all values.
pub fn sum(values: &[f64]) -> f64 {
    sum_of(values, values, |value, _| value)
}

/// The sum of the values that are finite and positive.
pub fn sum_of_positive(values: &[f64]) -> f64 {
    sum_of(values, values, |value, _| if value > 0.0 && value < f64::INFINITY { value } else { 0.0 })
}

#[inline(always)]
fn sum_of(a: &[f64], b: &[f64], value: impl Fn(f64, f64) -> f64) -> f64 {
    let mut lanes = [0.0; N];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<N>(), b.as_chunks::<N>());
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| value(*a, *b)).sum();
    for (a, b) in a.iter().zip(b) {
        (0..N).for_each(|lane| lanes[lane] += value(a[lane], b[lane]));
    }
    lanes.iter().sum::<f64>() + rest
}

/// The largest value that is a number; -inf without any.
pub fn largest(values: &[f64]) -> f64 {
    let larger = |a: f64, b: f64| if b > a { b } else { a };
    let mut lanes = [f64::NEG_INFINITY; N];
    let (chunks, rest) = values.as_chunks::<N>();
    for chunk in chunks {
        (0..N).for_each(|lane| lanes[lane] = larger(lanes[lane], chunk[lane]));
    }
    rest.iter().chain(&lanes).copied().fold(f64::NEG_INFINITY, larger)
}

for_units! {
    /// Lowers all logs by `by` and makes `exps` what they are then the logs of, `[n]`. NaN becomes -inf. No log is
    /// larger than `by`.
    ["x86_64+avx2"]
    lower(logs: &mut [f64], by: f64, exps: &mut Vec<f64>) {
        exps.resize(logs.len(), 0.0);
        for (log, power) in logs.iter_mut().zip(exps.iter_mut()) {
            let lowered = if log.is_nan() { f64::NEG_INFINITY } else { *log - by };
            *log = lowered;
            *power = exp(lowered);
        }
    }
}

for_units! {
    /// `e^(joint (value - largest))` of each value, `largest` being the largest.
    ["x86_64+avx2"]
    powers(values: &[f64], largest: f64, joint: f64) -> Vec<f64> {
        let mut powers = vec![0.0; values.len()];
        // A loop, not an iterator that calls for each value: it vectorises.
        for (power, value) in powers.iter_mut().zip(values) {
            *power = exp(joint * (*value - largest));
        }
        powers
    }
}

/// One of [`powers`] of 1, to the same bits.
pub fn power(value: f64, largest: f64) -> f64 {
    exp(value - largest)
}

for_units! {
    /// The sum of [`powers`] of 1, and the sum of each times its log, which is 0 or less. Of many states all touches say the
    /// same: where some values are those before, so are the powers.
    ["x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"]
    sums_of_powers(values: &[f64], largest: f64) -> [f64; 2] {
        let (chunks, rest) = values.as_chunks::<N>();
        let (mut lanes, mut last, mut powers) = ([[0.0; N]; 2], [f64::NAN; N], [[0.0; N]; 2]);
        for chunk in chunks {
            if !(0..N).fold(true, |same, lane| same & (chunk[lane] == last[lane])) {
                (0..N).for_each(|lane| [powers[0][lane], powers[1][lane]] = with_log(chunk[lane] - largest));
                last = *chunk;
            }
            (0..N).for_each(|lane| lanes[0][lane] += powers[0][lane]);
            (0..N).for_each(|lane| lanes[1][lane] += powers[1][lane]);
        }
        let mut sums = lanes.map(|lanes| lanes.iter().sum::<f64>());
        for value in rest {
            let [power, with_log] = with_log(value - largest);
            sums[0] += power;
            sums[1] += with_log;
        }
        sums
    }
}

/// A power and what it is times its log: nothing where it is zero, though zero times a log of -inf is no number.
#[inline(always)]
fn with_log(log: f64) -> [f64; 2] {
    let power = exp(log);
    [power, if power > 0.0 { power * log } else { 0.0 }]
}

/// e^x for x at most 0, to 2 units in the last place: `2^k e^r` with `r` within half a binary order of 0, by the
/// series of e^r up to the 13th power, whose next term is 4e-18. Zero where e^x is no normal number.
#[inline(always)]
fn exp(x: f64) -> f64 {
    /// Added, it leaves a whole number in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
    /// ln 2 in two parts, the first with so many zeros at the end that its multiples are exact.
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    const FACTORIALS: [f64; 14] = {
        let mut of = [1.0; 14];
        let mut n = 1;
        while n < of.len() {
            of[n] = of[n - 1] * n as f64;
            n += 1;
        }
        of
    };
    let inside = if x > SMALLEST { x } else { SMALLEST };
    let shifted = inside * std::f64::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = (inside - k * LN_2[0]) - k * LN_2[1];
    let mut power = 1.0 / FACTORIALS[13];
    for n in (0..13).rev() {
        power = power * r + 1.0 / FACTORIALS[n];
    }
    let scaled = f64::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 52));
    if x >= SMALLEST { scaled } else { 0.0 }
}

/// About the log of the smallest normal number.
const SMALLEST: f64 = -708.0;

for_units! {
    /// Adds each value to its sum.
    ["x86_64+avx2"]
    add(values: &[f64], sums: &mut [f64]) {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
}

for_units! {
    /// Adds to each sum its value as often as it counts.
    ["x86_64+avx2"]
    add_weighted(values: &[f64], counts: &[f64], sums: &mut [f64]) {
        for ((sum, value), count) in sums.iter_mut().zip(values).zip(counts) {
            *sum += count * value;
        }
    }
}

/// Weighted sums of four values each: `w0 a + w1 b + w2 c + w3 d`, each line as long as `out`.
#[inline(always)]
pub fn blend(weights: &[f32; 4], lines: [&[f32]; 4], out: &mut [f32]) {
    let (n, [w0, w1, w2, w3], [a, b, c, d]) = (out.len(), weights, lines);
    let value = |i: usize| w0 * a[i] + w1 * b[i] + w2 * c[i] + w3 * d[i];
    if n < N {
        (0..n).for_each(|i| out[i] = value(i));
        return;
    }
    let mut start = 0;
    while start < n {
        let at = last_whole(start, n);
        let (a, b, c, d, out) = (&a[at..at + N], &b[at..at + N], &c[at..at + N], &d[at..at + N], &mut out[at..at + N]);
        let mut blended = [0.0; N];
        for i in 0..N {
            blended[i] = w0 * a[i] + w1 * b[i] + w2 * c[i] + w3 * d[i];
        }
        out.copy_from_slice(&blended);
        start = at + N;
    }
}

/// Where the next lanes of a line of `n` values start. Lines are short: what is left of whole lanes is found with the last
/// whole ones again, not one by one.
#[inline(always)]
fn last_whole(start: usize, n: usize) -> usize {
    start.min(n - N)
}

/// A constant and weighted sums of six values each, each line as long as `out`.
#[inline(always)]
pub fn blend_six(constant: f32, weights: &[f32; 6], lines: [&[f32]; 6], out: &mut [f32]) {
    let (n, w, [a, b, c, d, e, f]) = (out.len(), weights, lines);
    if n < N {
        for i in 0..n {
            out[i] = constant + w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i] + w[4] * e[i] + w[5] * f[i];
        }
        return;
    }
    let mut start = 0;
    while start < n {
        let at = last_whole(start, n);
        let (a, b, c) = (&a[at..at + N], &b[at..at + N], &c[at..at + N]);
        let (d, e, f) = (&d[at..at + N], &e[at..at + N], &f[at..at + N]);
        let mut blended = [0.0; N];
        for i in 0..N {
            blended[i] = constant + w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i] + w[4] * e[i] + w[5] * f[i];
        }
        out[at..at + N].copy_from_slice(&blended);
        start = at + N;
    }
}

for_units! {
    /// ln(1 + e^z) of each value, to 3e-7 and 1e-7 of itself: what rounding leaves of a distance in f32 times a steepness.
    ["x86_64+avx2"]
    softplus(values: &mut [f32]) {
        /// Below, e^z is less than that. Most views are so unlike a touch.
        const NOTHING: f32 = -17.0;
        let (chunks, rest) = values.as_chunks_mut::<N>();
        for chunk in chunks {
            if chunk.iter().fold(true, |all, z| all & (*z < NOTHING)) {
                *chunk = [0.0; N];
            } else {
                chunk.iter_mut().for_each(|value| *value = softplus_of(*value));
            }
        }
        rest.iter_mut().for_each(|value| *value = softplus_of(*value));
    }
}

#[inline(always)]
fn softplus_of(z: f32) -> f32 {
    /// Added, it leaves a whole number in the lowest bits.
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23
    const LN_2: [f32; 2] = [0.693_145_75, 1.428_606_8e-6];
    // e^-|z|, no smaller than matters.
    let x = if z.abs() < 80.0 { -z.abs() } else { -80.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = (x - k * LN_2[0]) - k * LN_2[1];
    let series = 1.0 + r * (1.0 + r * (1.0 / 2.0 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    let power = f32::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 23));
    // ln(1 + p) = 2 artanh(p / (2 + p)), whose argument is at most a third.
    let s = power / (2.0 + power);
    let q = s * s;
    let series =
        1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0 + q / 13.0)))));
    (if z > 0.0 { z } else { 0.0 }) + 2.0 * s * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Runs of equal values, whose powers are found once, as one by one.
        #[test]
        fn powers_of_runs_are_summed_as_of_any(runs in prop::collection::vec((-30.0..0.0_f64, 1..40_usize), 1..9)) {
            let values: Vec<f64> = runs.iter().flat_map(|(value, n)| vec![*value; *n]).collect();
            let exact: f64 = values.iter().map(|value| value.exp()).sum();
            let logs: f64 = values.iter().map(|value| value * value.exp()).sum();
            let [sum, log_sum] = sums_of_powers(&values, 0.0);
            prop_assert!((sum / exact - 1.0).abs() < 1e-13 && (log_sum - logs).abs() <= 1e-13 * logs.abs(), "{log_sum} {logs}");
            let one_by_one: Vec<f64> = values.iter().map(|value| power(*value, 0.0)).collect();
            prop_assert_eq!(powers(&values, 0.0, 1.0), one_by_one);
        }

        #[test]
        fn sums_and_maxima_are_those_of_one_by_one(values in prop::collection::vec(-1e3..1e3_f64, 0..40)) {
            prop_assert!((sum(&values) - values.iter().sum::<f64>()).abs() < 1e-10);
            let positive: f64 = values.iter().filter(|value| **value > 0.0).sum();
            prop_assert!((sum_of_positive(&values) - positive).abs() < 1e-10);
            prop_assert_eq!(largest(&values), values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        }

        #[test]
        fn exponentials_are_the_libraries(x in -708.0..0.0_f64) {
            prop_assert!((exp(x) / x.exp() - 1.0).abs() < 4.5e-16, "{x}: {} {}", exp(x), x.exp());
        }
    }

    #[test]
    fn softplus_is_its_definition() {
        let places: Vec<f32> = (-4000..4000).map(|i| i as f32 * 0.037).chain([-1e30, 1e30, -80.0, 80.0]).collect();
        let mut found = places.clone();
        softplus(&mut found);
        for (z, found) in places.into_iter().map(f64::from).zip(found) {
            let exact = z.max(0.0) + (-z.abs()).exp().ln_1p();
            assert!((f64::from(found) - exact).abs() < 3e-7 + 1e-7 * exact, "{z}: {found}, not {exact}");
        }
    }

    #[test]
    fn blends_are_their_sums() {
        let line = |k: usize| -> Vec<f32> { (0..13).map(|i| ((i * 7 + k * 31) % 11) as f32).collect() };
        let lines: Vec<Vec<f32>> = (0..6).map(line).collect();
        let weights = [1.0, -2.0, 0.5, 3.0, -0.25, 4.0];
        let (mut four, mut six) = ([0.0; 13], [0.0; 13]);
        blend(&[1.0, -2.0, 0.5, 3.0], [0, 1, 2, 3].map(|k: usize| lines[k].as_slice()), &mut four);
        blend_six(2.0, &weights, [0, 1, 2, 3, 4, 5].map(|k: usize| lines[k].as_slice()), &mut six);
        for i in 0..13 {
            let sum = |n: usize| (0..n).map(|k| weights[k] * lines[k][i]).sum::<f32>();
            assert_eq!([four[i], six[i]], [sum(4), 2.0 + sum(6)]);
        }
        let mut few = [0.0; 3];
        blend(&[1.0, -2.0, 0.5, 3.0], [0, 1, 2, 3].map(|k: usize| lines[k].as_slice()), &mut few);
        assert_eq!(few, four[..3]);
    }

    #[test]
    fn the_ends_are_exact_and_what_is_no_number_is_nothing() {
        assert_eq!([exp(0.0), exp(-709.0), exp(-1e300), exp(f64::NEG_INFINITY)], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(sum_of_positive(&[f64::INFINITY, f64::NAN, -1.0, 2.0]), 2.0);
        assert_eq!(sums_of_powers(&[-1e300, 0.0, f64::NEG_INFINITY], 0.0), [1.0, 0.0]);
        assert_eq!(sums_of_powers(&[f64::NEG_INFINITY; 9], 0.0), [0.0, 0.0]);
        assert_eq!(largest(&[f64::NAN, -2.0, f64::NAN]), -2.0);
        assert_eq!(largest(&[f64::NAN; 9]), f64::NEG_INFINITY);
        let (mut logs, mut exps) = (vec![3.0, f64::NAN, f64::NEG_INFINITY], vec![7.0]);
        lower(&mut logs, 3.0, &mut exps);
        assert_eq!((logs, exps), (vec![0.0, f64::NEG_INFINITY, f64::NEG_INFINITY], vec![1.0, 0.0, 0.0]));
    }
}

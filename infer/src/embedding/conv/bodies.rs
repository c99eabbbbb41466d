//! Each body of the convolutions, one for each vector unit, against the others and against the definition.

use std::cell::Cell;
use std::io::Write;

use pulp::Arch;

use super::tests::{direct, forward_agrees_with_the_definition, gradients_are_the_adjoints_of_the_definition};
use super::tests::{layers, values};
use super::*;

thread_local! {
    static ASKED_FOR: Cell<Option<Arch>> = const { Cell::new(None) };
}

/// The unit that a test asks for on this thread.
pub fn asked_for() -> Option<Arch> {
    ASKED_FOR.get()
}

/// The units of this machine. Says which they are and which are not, past the capture of a test's output: what was not
/// run must be seen where all passes.
fn here(what: &str) -> Vec<(&'static str, Arch)> {
    #[cfg(target_arch = "x86_64")]
    let all = [
        ("scalar", Some(Arch::Scalar)),
        ("AVX2", pulp::x86::V3::try_new().map(Arch::V3)),
        ("AVX-512", pulp::x86::V4::try_new().map(Arch::V4)),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let all = [("scalar", Some(Arch::Scalar)), ("the machine's", Some(Arch::new()))];
    let missing: Vec<&str> = all.iter().filter(|(_, arch)| arch.is_none()).map(|(name, _)| *name).collect();
    let here: Vec<(&str, Arch)> = all.into_iter().filter_map(|(name, arch)| Some((name, arch?))).collect();
    let names: Vec<&str> = here.iter().map(|(name, _)| *name).collect();
    let n_missing = missing.len();
    let line = format!("{what}: compared on {names:?}; {n_missing} not run, this machine lacks {missing:?}\n");
    std::io::stderr().write_all(line.as_bytes()).unwrap();
    here
}

/// Does some work with the vectors of one unit, on one thread.
fn on<T: Send>(arch: Arch, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        ASKED_FOR.set(Some(arch));
        work()
    })
}

#[test]
fn every_body_agrees_with_the_definition() {
    for (name, arch) in here("convolutions, against the definition") {
        on(arch, || {
            assert_eq!(std::mem::discriminant(&super::arch()), std::mem::discriminant(&arch), "{name}");
            forward_agrees_with_the_definition();
            gradients_are_the_adjoints_of_the_definition();
            #[cfg(feature = "burn")]
            normalisation_agrees_with_f64();
        });
    }
}

/// The forward pass and both gradients of one layer.
fn passes(conv: &Conv, images: &[f32]) -> [Vec<f32>; 3] {
    let n = images.len() / conv.in_length();
    let (weights, gradient) =
        (values(conv.n_in * conv.n_out * conv.kernel.pow(2), 0.23), values(n * conv.out_length(), 0.71));
    let out = conv.forward(images, &conv.pack(&weights), |_, _| ());
    [out, conv.input_gradient(&gradient, &weights), conv.weight_gradient(images, &gradient)]
}

/// Bodies differ by how many products are summed in a lane and whether they are fused: two sums of `n` products of
/// order 1, each within `n` roundings of the exact one. Winograd's windows round four times as coarsely
/// ([`super::axis`]).
#[test]
fn bodies_agree_with_each_other() {
    let here = here("convolutions, with each other");
    for conv in layers() {
        let images = values(3 * conv.in_length(), 0.37);
        let all: Vec<_> = here.iter().map(|(name, arch)| (*name, on(*arch, || passes(&conv, &images)))).collect();
        let [height, width] = conv.out_size();
        let n_summed = [conv.kernel.pow(2) * conv.n_in, conv.kernel.pow(2) * conv.n_out, 3 * height * width];
        for (name, made) in &all[1..] {
            for ((first, made), n_summed) in all[0].1.iter().zip(made).zip(n_summed) {
                let bound = 4.0 * 2.0 * (n_summed + 8) as f32 * f32::EPSILON / 2.0 * n_summed as f32;
                let largest = first.iter().zip(made).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(first.len() == made.len() && largest <= bound, "{conv:?} {name}: {largest} > {bound}");
            }
        }
    }
}

/// What is no number stays no number, where the definition has it, on every unit; infinity too, unless it becomes no
/// number. Windows of Winograd spread it over their outputs and no further.
#[test]
fn odd_pixels_spoil_the_same_outputs_on_every_body() {
    let here = here("convolutions, NaN and infinity");
    for conv in layers() {
        let n = conv.in_length();
        let mut images = values(3 * n, 0.37);
        images[n / 2] = f32::NAN;
        images[n + n / 2] = f32::INFINITY;
        // Denormal numbers are as good as zeros, not slow or lost: the third image is clean.
        images[2 * n + n / 2] = 1e-41;
        let weights = values(conv.n_in * conv.n_out * conv.kernel.pow(2), 0.23);
        let spoilt = |out: &[f32]| out.iter().map(|value| !value.is_finite()).collect::<Vec<bool>>();
        let of = |arch: Arch| spoilt(&on(arch, || conv.forward(&images, &conv.pack(&weights), |_, _| ())));
        let first = of(here[0].1);
        let expected: Vec<f64> = images.chunks(n).flat_map(|image| direct(&conv, image, &weights)).collect();
        for (at, value) in expected.iter().enumerate() {
            assert!(value.is_finite() || first[at], "{conv:?}: output {at} hides what is no number");
        }
        assert!(first[2 * conv.out_length()..].iter().all(|spoilt| !spoilt), "{conv:?}: a clean image is spoilt");
        for (name, arch) in &here[1..] {
            assert!(of(*arch) == first, "{conv:?}: {name} spoils other outputs");
        }
    }
}

/// Statistics, output and gradients of batch normalisation, skip and rectifier, in f64 straight from their definitions.
#[cfg(feature = "burn")]
fn normalisation_agrees_with_f64() {
    use norm::{Norm, forward_with_statistics};

    /// Sums of 231 values of order 1 to 10 in f32, and their squares; what is divided by a deviation of 0.1 and more.
    const BOUND: f64 = 2e-3;
    let epsilon = 1e-5;
    // Odd numbers of channels and pixels: no lane is full at the end.
    for conv in [Conv { n_in: 5, n_out: 33, kernel: 3, stride: 1, size: [7, 11] }, layers()[9]] {
        let (images, n) = (values(3 * conv.in_length(), 0.37), conv.n_out);
        let weights = values(conv.n_in * n * conv.kernel.pow(2), 0.23);
        let (before, statistics) = forward_with_statistics(&conv, &images, &weights);
        let wide: Vec<f64> = before.iter().map(|value| f64::from(*value)).collect();
        let n_pixels = (wide.len() / n) as f64;
        let mean_of = |value: &dyn Fn(usize) -> f64, c: usize| -> f64 {
            (0..wide.len() / n).map(|pixel| value(pixel * n + c)).sum::<f64>() / n_pixels
        };
        let mean: Vec<f64> = (0..n).map(|c| mean_of(&|at| wide[at], c)).collect();
        let variance: Vec<f64> = (0..n).map(|c| mean_of(&|at| (wide[at] - mean[c]).powi(2), c)).collect();
        let close = |what: &str, got: &[f32], expected: &dyn Fn(usize) -> f64| {
            for (at, got) in got.iter().enumerate() {
                let bound = BOUND * (1.0 + expected(at).abs());
                assert!((f64::from(*got) - expected(at)).abs() <= bound, "{what} {at}: {got}, not {}", expected(at));
            }
        };
        close("mean", &statistics.mean, &|c| mean[c]);
        close("variance", &statistics.variance, &|c| variance[c]);
        let (gamma, beta) = (values(n, 0.9), values(n, 0.4));
        let (skip, gradient) = (values(before.len(), 0.61), values(before.len(), 0.71));
        let norm = Norm::new(&statistics, &gamma, &beta, epsilon);
        let out = norm.apply(&before, Some(&skip));
        let normed = |at: usize| (wide[at] - mean[at % n]) / (variance[at % n] + epsilon).sqrt();
        let summed = |at: usize| f64::from(gamma[at % n]) * normed(at) + f64::from(beta[at % n]) + f64::from(skip[at]);
        close("out", &out, &|at| summed(at).max(0.0));
        // The gradient by its definition: what passes the rectifier, less its mean and its share along the normalised
        // values.
        let back = norm.gradient(&before, &out, &gradient);
        let passed = |at: usize| if out[at] > 0.0 { f64::from(gradient[at]) } else { 0.0 };
        let of_beta: Vec<f64> = (0..n).map(|c| mean_of(&passed, c) * n_pixels).collect();
        let of_gamma: Vec<f64> = (0..n).map(|c| mean_of(&|at| passed(at) * normed(at), c) * n_pixels).collect();
        close("beta", &back.beta, &|c| of_beta[c]);
        close("gamma", &back.gamma, &|c| of_gamma[c]);
        close("before", &back.before, &|at| {
            let c = at % n;
            let scale = f64::from(gamma[c]) / (variance[c] + epsilon).sqrt();
            scale * (passed(at) - of_beta[c] / n_pixels - normed(at) * of_gamma[c] / n_pixels)
        });
        let mut added = skip.clone();
        norm.add_rectified(&out, &gradient, &mut added);
        close("skip", &added, &|at| f64::from(skip[at]) + passed(at));
    }
}

//! Networks whose weights are rounded, and the arithmetic of f32, against the network in f64 from its definition.

use std::io::Write;
use std::path::Path;

use super::*;
use crate::embedding::architecture::ConvLayer;
use crate::embedding::checkpoint::Checkpoint;
use crate::embedding::encoder::Encoder;

/// What batch normalisation adds to a variance.
const EPSILON: f64 = 1e-5;

/// The network in f64, by its tensors as they are in the checkpoint: nothing folded, packed or fused.
struct Wide<'a>(&'a Checkpoint);

impl Wide<'_> {
    fn tensor(&self, name: &str) -> &[f32] {
        &self.0.tensors.iter().find(|tensor| tensor.name == name).unwrap().values
    }

    /// Batch normalisation of channel `c`.
    fn norm(&self, name: &str, c: usize, value: f64) -> f64 {
        let [gamma, beta, mean, variance] = ["gamma", "beta", "running_mean", "running_var"]
            .map(|field| f64::from(self.tensor(&format!("{name}.{field}"))[c]));
        (value - mean) / (variance + EPSILON).sqrt() * gamma + beta
    }

    /// One image `[n_in, height, width]` through a convolution, its normalisation, skip and rectifier.
    fn layer(&self, layer: &ConvLayer, image: &[f64], [height, width]: [usize; 2]) -> (Vec<f64>, [usize; 2]) {
        let ConvLayer { name, n_in, n_out, kernel, stride, adds_input } = *layer;
        let [rows, columns] = [height, width].map(|n| n.div_ceil(stride));
        let weights = self.tensor(&format!("encoder.{name}.conv.weight"));
        let mut out = vec![0.0; n_out * rows * columns];
        for (at, value) in out.iter_mut().enumerate() {
            let (o, y, x) = (at / columns / rows, at / columns % rows, at % columns);
            for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                let inside = |place: usize, n: usize| place.checked_sub(kernel / 2).filter(|place| *place < n);
                let (Some(iy), Some(ix)) = (inside(y * stride + ky, height), inside(x * stride + kx, width)) else {
                    continue;
                };
                for c in 0..n_in {
                    let weight = weights[((o * n_in + c) * kernel + ky) * kernel + kx];
                    *value += f64::from(weight) * image[(c * height + iy) * width + ix];
                }
            }
            let skip = if adds_input { image[at] } else { 0.0 };
            *value = (self.norm(&format!("encoder.{name}.norm"), o, *value) + skip).max(0.0);
        }
        (out, [rows, columns])
    }

    /// A linear layer, `[n_in, n_out]`.
    fn dense(&self, name: &str, norm: Option<&str>, row: &[f64]) -> Vec<f64> {
        let weights = self.tensor(&format!("{name}.weight"));
        let n_out = weights.len() / row.len();
        let product = |at: usize, out: usize| row[at] * f64::from(weights[at * n_out + out]);
        let sum = |out: usize| (0..row.len()).map(|at| product(at, out)).sum::<f64>();
        let normed = |out: usize| norm.map_or(sum(out), |norm| self.norm(norm, out, sum(out)));
        (0..n_out).map(normed).collect()
    }

    /// Key and query of an image, `[3, height, width]`.
    fn embed(&self, image: &[f32]) -> [Vec<f64>; 2] {
        let rectified = |row: Vec<f64>| row.into_iter().map(|value| value.max(0.0)).collect::<Vec<f64>>();
        let [width, height] = self.0.config.input_px;
        let first = (image.iter().map(|value| f64::from(*value)).collect::<Vec<f64>>(), [height, width]);
        let layers = self.0.config.conv_layers();
        let (flat, _) = layers.iter().fold(first, |(image, size), layer| self.layer(layer, &image, size));
        let hidden = rectified(self.dense("encoder.project_1", Some("encoder.norm_1"), &flat));
        let key = self.dense("encoder.project_2", Some("encoder.norm_2"), &hidden);
        let hidden = rectified(self.dense("predictor.predict_1", Some("predictor.norm_1"), &key));
        let query = self.dense("predictor.predict_2", None, &hidden);
        [key, query]
    }
}

/// Bars and rings as a sensor's contrast shows them, `[3, height, width]`, in deviations.
fn image(number: usize, [width, height]: [usize; 2]) -> Vec<f32> {
    let (turn, shift) = (0.7 * number as f32, 3.0 * (number as f32 * 1.9).sin());
    let value = |at: usize| {
        let (c, y, x) = (at / width / height, at / width % height, at % width);
        let (x, y) = (x as f32 - width as f32 / 2.0, y as f32 - height as f32 / 2.0);
        let bar = x * turn.cos() + y * turn.sin() - shift;
        let ring = x.hypot(y) - 6.0 - shift;
        let slope = |d: f32| d * (-d * d / 8.0).exp();
        2.0 * slope(if number.is_multiple_of(3) { ring } else { bar }) * (c as f32 * 2.1 + turn).cos()
            + 0.05 * (at as f32).sin()
    };
    (0..3 * height * width).map(value).collect()
}

fn cosines(queries: &[Vec<f64>], keys: &[Vec<f64>]) -> Vec<f64> {
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let cosine = |a: &[f64], b: &[f64]| inner(a, b) / (inner(a, a) * inner(b, b)).sqrt();
    queries.iter().flat_map(|query| keys.iter().map(|key| cosine(query, key))).collect()
}

/// The shipped network. In f32 sums of up to 2,560 products in ten layers, each rounded to 6e-8; rounded weights by the
/// promise of [`Checkpoint::with_weights`], which both references are held to: a tenth of a log-odds of a usual touch, whose distance
/// `d` from its own view changes by `-1 / d` of the cosine.
#[test]
fn cosines_of_rounded_weights_change_log_odds_by_less_than_a_tenth() {
    const N_IMAGES: usize = 7;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/maze-small.safetensors");
    let (exact, _) = Checkpoint::load(&path).unwrap();
    let odds = exact.match_odds[0].as_ref().unwrap();
    let promised = 0.1 * odds.own_distance / odds.steepness;
    let images: Vec<Vec<f32>> = (0..N_IMAGES).map(|number| image(number, exact.config.input_px)).collect();
    let wide = |checkpoint: &Checkpoint| {
        let all: Vec<[Vec<f64>; 2]> = images.iter().map(|image| Wide(checkpoint).embed(image)).collect();
        let [keys, queries] = [0, 1].map(|which: usize| all.iter().map(|both| both[which].clone()).collect::<Vec<_>>());
        cosines(&queries, &keys)
    };
    let expected = wide(&exact);
    for precision in Precision::WEIGHTS.map(|name| name.parse::<Precision>().unwrap()) {
        let rounded = exact.clone().with_weights(precision).unwrap();
        let encoder = Encoder::new(&rounded.config, &rounded.tensors).unwrap();
        let rows = |made: Vec<f32>| -> Vec<Vec<f64>> {
            made.chunks_exact(rounded.config.dim).map(|row| row.iter().map(|v| f64::from(*v)).collect()).collect()
        };
        let all = images.concat();
        let found = cosines(&rows(encoder.query(&all)), &rows(encoder.key(&all)));
        let largest = |expected: &[f64]| found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let [of_arithmetic, in_all] = [largest(&wide(&rounded)), largest(&expected)];
        let line = format!(
            "weights in {precision}: cosines off by {of_arithmetic:.1e} in f32, {in_all:.1e} in all, of {promised:.1e}\n"
        );
        std::io::stderr().write_all(line.as_bytes()).unwrap();
        assert!(of_arithmetic < 1e-5 && in_all < promised, "{precision}: {of_arithmetic} {in_all}");
    }
}

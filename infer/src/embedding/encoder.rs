//! The trained network on the CPU without tensors: normalisations folded into the weights, the weights
//! packed once, NHWC throughout.
//!
//! What a robot runs at each touch. It computes the same function as the burn network (feature `burn`) up to rounding, and
//! is several times faster than a general library's kernels on one image (`cargo xtask bench training`).

use std::collections::BTreeMap;

use crate::embedding::architecture::{ConvLayer, NetworkConfig};
use crate::embedding::conv::{Conv, Packed, Padded, Panels};
use crate::embedding::threads;
use crate::error::{Error, Result};
use crate::safefile::NamedTensor;

/// What batch normalisation adds to a variance: burn's and PyTorch's default, with which the network is built.
const EPSILON: f64 = 1e-5;

/// Rows of a linear layer that one thread takes.
const ROWS_AT_ONCE: usize = 40;

/// Encoder and predictor, ready to run.
#[derive(Clone, Debug)]
pub struct Encoder {
    size: [usize; 2],
    layers: Vec<Layer>,
    project: [Dense; 2],
    predict: [Dense; 2],
}

/// A convolution with its normalisation, skip and rectifier.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    conv: Conv,
    packed: Packed,
    shift: Vec<f32>,
    adds_input: bool,
}

/// A linear layer with its normalisation and rectifier.
#[derive(Clone, Debug)]
pub(crate) struct Dense {
    n_in: usize,
    panels: Panels,
    shift: Vec<f32>,
    is_rectified: bool,
}

impl Encoder {
    /// Folds the tensors of a checkpoint.
    ///
    /// # Errors
    /// A tensor that is missing or of another size, values that are not finite, and variances below zero.
    pub fn new(config: &NetworkConfig, tensors: &[NamedTensor]) -> Result<Self> {
        let tensors = Tensors::of(tensors);
        let [width, height] = config.input_px;
        let mut size = [height, width];
        let mut layers = Vec::new();
        for layer in config.conv_layers() {
            let layer = Layer::new(&tensors, &format!("encoder.{}", layer.name), &layer, size)?;
            size = layer.conv.out_size();
            layers.push(layer);
        }
        let [n_pixels, n_channels] = [size[0] * size[1], 2 * config.width];
        // The checkpoint's order is [channel, pixel], as PyTorch flattens; ours is [pixel, channel].
        let flattened = |at: usize| at % n_channels * n_pixels + at / n_channels;
        let (hidden, dim) = (config.hidden, config.dim);
        Ok(Self {
            size: [height, width],
            layers,
            project: [
                Dense::new(
                    &tensors,
                    "encoder.project_1",
                    Some("encoder.norm_1"),
                    [n_pixels * n_channels, hidden],
                    flattened,
                )?
                .rectified(),
                Dense::new(&tensors, "encoder.project_2", Some("encoder.norm_2"), [hidden, dim], |at| at)?,
            ],
            predict: [
                Dense::new(&tensors, "predictor.predict_1", Some("predictor.norm_1"), [dim, hidden], |at| at)?
                    .rectified(),
                Dense::new(&tensors, "predictor.predict_2", None, [hidden, dim], |at| at)?,
            ],
        })
    }

    /// `[n, 3, height, width]` -> `[n, dim]`, not normalised: what `Network::key` gives.
    pub fn key(&self, images: &[f32]) -> Vec<f32> {
        let x = pixel_by_pixel::<3>(images, self.size);
        let x = self.layers.iter().fold(x, |x, layer| layer.forward(&x));
        self.project.iter().fold(x, |x, layer| layer.forward(&x))
    }

    /// `[n, 3, height, width]` -> `[n, dim]`, not normalised: what `Network::query` gives.
    pub fn query(&self, images: &[f32]) -> Vec<f32> {
        self.predict.iter().fold(self.key(images), |x, layer| layer.forward(&x))
    }
}

/// `[n, C, height, width]` -> `[n, height, width, C]`.
pub(crate) fn pixel_by_pixel<const C: usize>(images: &[f32], [height, width]: [usize; 2]) -> Vec<f32> {
    let n_pixels = height * width;
    let mut x = vec![0.0; images.len()];
    for (out, image) in x.chunks_exact_mut(C * n_pixels).zip(images.chunks_exact(C * n_pixels)) {
        for (at, pixel) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
            pixel.iter_mut().enumerate().for_each(|(c, value)| *value = image[c * n_pixels + at]);
        }
    }
    x
}

impl Layer {
    /// The layer of this name for images of a size, height and width.
    pub(crate) fn new(tensors: &Tensors<'_>, name: &str, layer: &ConvLayer, size: [usize; 2]) -> Result<Self> {
        let ConvLayer { n_in, n_out, kernel, stride, adds_input, .. } = *layer;
        let conv = Conv { n_in, n_out, kernel, stride, size };
        let mut weights = tensors.get(&format!("{name}.conv.weight"), n_in * n_out * kernel * kernel)?.to_vec();
        let [scale, shift] = tensors.norm(&format!("{name}.norm"), n_out)?;
        for (weights, scale) in weights.chunks_exact_mut(n_in * kernel * kernel).zip(&scale) {
            weights.iter_mut().for_each(|weight| *weight *= scale);
        }
        Ok(Self { conv, packed: conv.pack(&weights), shift, adds_input })
    }

    /// Height and width of its output, and its channels.
    pub(crate) fn out_size(&self) -> ([usize; 2], usize) {
        (self.conv.out_size(), self.shift.len())
    }

    /// `[n, height, width, n_in]` -> `[n, rows, columns, n_out]`.
    pub(crate) fn forward(&self, images: &[f32]) -> Vec<f32> {
        let n = self.shift.len();
        self.conv.forward(images, &self.packed, |at, out| {
            if self.adds_input {
                let skip = &images[at * out.len()..][..out.len()];
                out.iter_mut().zip(skip).for_each(|(value, skip)| *value += skip);
            }
            for pixel in out.chunks_exact_mut(n) {
                pixel.iter_mut().zip(&self.shift).for_each(|(value, shift)| *value = (*value + shift).max(0.0));
            }
        })
    }
}

impl Dense {
    /// A layer from `[n_in, n_out]` weights whose row for input `at` is row `row(at)`.
    pub(crate) fn new(
        tensors: &Tensors<'_>,
        name: &str,
        norm: Option<&str>,
        [n_in, n_out]: [usize; 2],
        row: impl Fn(usize) -> usize,
    ) -> Result<Self> {
        let weights = tensors.get(&format!("{name}.weight"), n_in * n_out)?;
        let [scale, shift] = match norm {
            Some(norm) => tensors.norm(norm, n_out)?,
            None => [vec![1.0; n_out], vec![0.0; n_out]],
        };
        let scaled: Vec<f32> = scale
            .iter()
            .enumerate()
            .flat_map(|(out, scale)| (0..n_in).map(move |at| (at, out, *scale)))
            .map(|(at, out, scale)| weights[row(at) * n_out + out] * scale)
            .collect();
        let panels = Conv { n_in, n_out, kernel: 1, stride: 1, size: [1, 1] }.panels(&scaled);
        Ok(Self { n_in, panels, shift, is_rectified: false })
    }

    /// The same without a normalisation, but with these added to its outputs.
    pub(crate) fn with_bias(self, bias: &[f32]) -> Self {
        Self { shift: bias.to_vec(), ..self }
    }

    fn rectified(self) -> Self {
        Self { is_rectified: true, ..self }
    }

    /// `[n, n_in]` -> `[n, n_out]`.
    pub(crate) fn forward(&self, rows: &[f32]) -> Vec<f32> {
        let n_out = self.shift.len();
        let mut out = vec![0.0; rows.len() / self.n_in * n_out];
        let least = if self.is_rectified { 0.0 } else { f32::NEG_INFINITY };
        threads::for_each_block(&mut out, ROWS_AT_ONCE * n_out, Padded::default, |scratch, at, out| {
            let rows = &rows[at * ROWS_AT_ONCE * self.n_in..][..out.len() / n_out * self.n_in];
            self.panels.multiply(rows, self.n_in, scratch, out);
            for row in out.chunks_exact_mut(n_out) {
                row.iter_mut().zip(&self.shift).for_each(|(value, shift)| *value = (*value + shift).max(least));
            }
        });
        out
    }
}

/// The tensors of a checkpoint by name.
pub(crate) struct Tensors<'a>(BTreeMap<&'a str, &'a [f32]>);

impl<'a> Tensors<'a> {
    pub(crate) fn of(tensors: &'a [NamedTensor]) -> Self {
        Self(tensors.iter().map(|t| (t.name.as_str(), t.values.as_slice())).collect())
    }

    pub(crate) fn get(&self, name: &str, length: usize) -> Result<&'a [f32]> {
        let found = self.0.get(name).copied().filter(|values| values.len() == length);
        let found = found.ok_or_else(|| {
            let got = self.0.get(name).map_or("nothing".to_owned(), |values| format!("{} values", values.len()));
            Error::invalid(name, format!("a tensor of {length} values"), got)
        })?;
        let is_variance = name.ends_with(".running_var");
        let is_bad = |value: &&f32| !value.is_finite() || is_variance && **value < 0.0;
        match found.iter().find(is_bad) {
            Some(bad) => {
                let expected = if is_variance { "variances of zero or more" } else { "finite values" };
                Err(Error::invalid(name, expected, bad.to_string()))
            }
            None => Ok(found),
        }
    }

    /// What a normalisation does once it is trained: `[scale, shift]` of each channel.
    fn norm(&self, name: &str, n: usize) -> Result<[Vec<f32>; 2]> {
        let get = |field: &str| self.get(&format!("{name}.{field}"), n);
        let (gamma, beta) = (get("gamma")?, get("beta")?);
        let (mean, variance) = (get("running_mean")?, get("running_var")?);
        let scale: Vec<f32> = gamma
            .iter()
            .zip(variance)
            .map(|(gamma, variance)| (f64::from(*gamma) / (f64::from(*variance) + EPSILON).sqrt()) as f32)
            .collect();
        let shift = beta.iter().zip(mean).zip(&scale).map(|((beta, mean), scale)| beta - mean * scale).collect();
        Ok([scale, shift])
    }
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use burn::tensor::{Tensor, TensorData};

    use super::*;
    use crate::embedding::device::DeviceKind;
    use crate::embedding::network::{tensors_of, with_tensors};

    #[test]
    fn folding_changes_nothing_but_the_rounding() {
        // Sizes that fill no vector evenly, and statistics that are not those of a fresh network.
        let config = NetworkConfig { input_px: [19, 14], width: 5, hidden: 9, dim: 7 };
        let device = DeviceKind::Flex.tensor_device();
        let mut tensors = tensors_of(&config.init(3, &device));
        for tensor in tensors.iter_mut().filter(|t| t.shape.len() == 1) {
            let is_variance = tensor.name.ends_with("var");
            for (i, value) in tensor.values.iter_mut().enumerate() {
                *value = if is_variance { 0.5 + 0.1 * i as f32 } else { (i as f32 + tensor.name.len() as f32).sin() };
            }
        }
        let network = with_tensors(config.init(4, &device), tensors.clone()).unwrap();
        let images: Vec<f32> = (0..13 * 3 * 14 * 19).map(|i| (i as f32 * 0.7).sin()).collect();
        let input = Tensor::from_data(TensorData::new(images.clone(), [13, 3, 14, 19]), &device);
        let encoder = Encoder::new(&config, &tensors).unwrap();
        for (rows, expected) in
            [(encoder.key(&images), network.key(input.clone())), (encoder.query(&images), network.query(input))]
        {
            let expected = expected.into_data().try_into_vec::<f32>().unwrap();
            assert_eq!(rows.len(), expected.len());
            let largest = expected.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            // Sums of a thousand products, each rounded to 6e-8 of the largest.
            assert!(rows.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4 * largest), "{rows:?} {expected:?}");
        }
    }

    #[test]
    fn values_that_no_training_gives_are_refused_by_name() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let whole = tensors_of(&config.init(3, &DeviceKind::Flex.tensor_device()));
        let names = ["encoder.half.conv.weight", "encoder.project_1.weight", "predictor.norm_1.running_var"];
        for (name, bad) in names.into_iter().zip([f32::NAN, f32::INFINITY, -1e-3]) {
            let mut tensors = whole.clone();
            tensors.iter_mut().find(|tensor| tensor.name == name).unwrap().values[1] = bad;
            let error = Encoder::new(&config, &tensors).unwrap_err().to_string();
            assert!(error.starts_with(name) && error.ends_with(&bad.to_string()), "{error}");
        }
    }

    #[test]
    fn a_missing_tensor_is_named() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let mut tensors = tensors_of(&config.init(3, &DeviceKind::Flex.tensor_device()));
        tensors.retain(|tensor| tensor.name != "encoder.norm_1.beta");
        assert!(Encoder::new(&config, &tensors).unwrap_err().to_string().contains("encoder.norm_1.beta"));
    }
}

//! The network: one encoder for holes and pegs, one predictor for queries.
//!
//! `query = predictor(encoder(hole))`, `key = encoder(peg)` (MoCo-v3, Sec. 3). The encoder keeps the
//! layout of the view to its last layer, because where an edge lies is as telling as that it is there:
//! a global average would throw the pose away.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::conv;
use crate::error::{Error, Result};

/// The sizes of a network. Saved in its checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// Width and height of the input, pixels.
    pub input_px: [usize; 2],
    /// Channels of the first layer; the later ones hold four times as many.
    pub width: usize,
    /// Units of the hidden layer of projector and predictor.
    pub hidden: usize,
    /// Length of an embedding.
    pub dim: usize,
}

impl NetworkConfig {
    /// The network of the `tiny` preset: minutes of training on two cores.
    pub const TINY: Self = Self { input_px: [40, 30], width: 32, hidden: 256, dim: 128 };

    /// Refuses sizes that make no network.
    pub fn validate(&self) -> Result<()> {
        let [width, height] = self.input_px;
        let sizes = [self.width, self.hidden, self.dim];
        if width < 8 || height < 8 || width > 1_024 || height > 1_024 || sizes.iter().any(|n| *n == 0 || *n > 4_096) {
            return Err(Error::invalid("network", "inputs of 8..=1024 px and 1..=4096 units", format!("{self:?}")));
        }
        Ok(())
    }

    /// The weights of its largest layers: the 3x3 convolutions and the first of the projector.
    pub fn n_weights_at_least(&self) -> usize {
        let [columns, rows] = self.input_px.map(|n| n.div_ceil(8));
        9 * 16 * 3 * self.width * self.width + 2 * self.width * columns * rows * self.hidden
    }

    /// A network with weights drawn from `seed`: the same on every backend.
    pub fn init(&self, seed: u64, device: &Device) -> Network {
        let [w, d] = [self.width, self.dim];
        // Each of the three strided layers halves the side, rounding up.
        let [columns, rows] = self.input_px.map(|n| n.div_ceil(2).div_ceil(2).div_ceil(2));
        let linear = |n_in, n_out| LinearConfig::new(n_in, n_out).with_bias(false).init(device);
        let network = Network {
            encoder: Encoder {
                stem: ConvBn::new([3, w], 5, 2, device),
                half: ConvBn::new([w, 4 * w], 3, 2, device),
                residual_1: ConvBn::new([4 * w, 4 * w], 3, 1, device),
                quarter: ConvBn::new([4 * w, 4 * w], 3, 2, device),
                residual_2: ConvBn::new([4 * w, 4 * w], 3, 1, device),
                narrow: ConvBn::new([4 * w, 2 * w], 1, 1, device),
                project_1: linear(2 * w * columns * rows, self.hidden),
                norm_1: BatchNormConfig::new(self.hidden).init(device),
                project_2: linear(self.hidden, d),
                norm_2: BatchNormConfig::new(d).init(device),
            },
            predictor: Predictor {
                predict_1: linear(d, self.hidden),
                norm_1: BatchNormConfig::new(self.hidden).init(device),
                predict_2: linear(self.hidden, d),
            },
        };
        network.map(&mut DrawWeights { rng: ChaCha8Rng::seed_from_u64(seed) })
    }
}

/// Encoder and predictor together: what is trained and what a checkpoint holds.
#[derive(Module, Debug)]
pub struct Network {
    /// Shared by holes and pegs.
    pub encoder: Encoder,
    /// Applied to queries only.
    pub predictor: Predictor,
}

impl Network {
    /// `[n, 3, height, width]` -> `[n, dim]`: the query, not normalised.
    pub fn query(&self, images: Tensor<4>) -> Tensor<2> {
        self.predictor.forward(self.encoder.forward(images))
    }

    /// `[n, 3, height, width]` -> `[n, dim]`: the key, not normalised.
    pub fn key(&self, images: Tensor<4>) -> Tensor<2> {
        self.encoder.forward(images)
    }
}

/// Backbone and projector. Shapes for the tiny network at 40x30 px, `w` = 32.
#[derive(Module, Debug)]
pub struct Encoder {
    stem: ConvBn,       // [n, 3, 30, 40] -> [n, w, 15, 20]
    half: ConvBn,       // -> [n, 4w, 8, 10]
    residual_1: ConvBn, // adds to its input
    quarter: ConvBn,    // -> [n, 4w, 4, 5]
    residual_2: ConvBn, // adds to its input
    narrow: ConvBn,     // -> [n, 2w, 4, 5], keeps the projector small
    project_1: Linear,  // [n, 2w * 20] -> [n, hidden]
    norm_1: BatchNorm,
    project_2: Linear, // -> [n, dim]
    norm_2: BatchNorm,
}

impl Encoder {
    /// `[n, 3, height, width]` -> `[n, dim]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let device = images.device();
        let x = if device.is_autodiff() && conv::op::is_supported(&device) {
            self.layers_on_cpu(images)
        } else {
            self.layers(images)
        };
        let x = x.flatten::<2>(1, 3); // [n, 2w * rows * columns]
        let x = relu(self.norm_1.forward(self.project_1.forward(x)));
        self.norm_2.forward(self.project_2.forward(x))
    }

    /// The convolutions by burn's own kernels, on any backend.
    fn layers(&self, images: Tensor<4>) -> Tensor<4> {
        let x = relu(self.stem.forward(images));
        let x = relu(self.half.forward(x));
        let x = relu(x.clone() + self.residual_1.forward(x));
        let x = relu(self.quarter.forward(x));
        let x = relu(x.clone() + self.residual_2.forward(x));
        relu(self.narrow.forward(x))
    }

    /// The convolutions by ours, in training on the CPU. The same numbers but for rounding.
    fn layers_on_cpu(&self, images: Tensor<4>) -> Tensor<4> {
        let x = images.permute([0, 2, 3, 1]); // [n, height, width, channels] from here on
        let x = self.stem.train_on_cpu(x, false);
        let x = self.half.train_on_cpu(x, false);
        let x = self.residual_1.train_on_cpu(x, true);
        let x = self.quarter.train_on_cpu(x, false);
        let x = self.residual_2.train_on_cpu(x, true);
        self.narrow.train_on_cpu(x, false).permute([0, 3, 1, 2])
    }
}

/// The query's extra two layers (MoCo-v3: they keep the two sides from collapsing onto each other).
#[derive(Module, Debug)]
pub struct Predictor {
    predict_1: Linear,
    norm_1: BatchNorm,
    predict_2: Linear,
}

impl Predictor {
    /// `[n, dim]` -> `[n, dim]`.
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.predict_2.forward(relu(self.norm_1.forward(self.predict_1.forward(x))))
    }
}

/// A convolution without bias and its batch normalisation.
#[derive(Module, Debug)]
pub struct ConvBn {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvBn {
    fn new(channels: [usize; 2], kernel: usize, stride: usize, device: &Device) -> Self {
        let pad = kernel / 2;
        Self {
            conv: Conv2dConfig::new(channels, [kernel; 2])
                .with_stride([stride; 2])
                .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
                .with_bias(false)
                .init(device),
            norm: BatchNormConfig::new(channels[1]).init(device),
        }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        self.norm.forward(self.conv.forward(x))
    }

    /// `relu(norm(conv(x)) [+ x])` by our own kernels, NHWC; the running statistics follow the batch's.
    fn train_on_cpu(&self, x: Tensor<4>, adds_input: bool) -> Tensor<4> {
        let norm = &self.norm;
        let layer = conv::op::Layer { stride: self.conv.stride[0], adds_input, epsilon: norm.epsilon };
        let (out, mean, variance) =
            conv::op::train_layer(x, self.conv.weight.val(), norm.gamma.val(), norm.beta.val(), layer);
        for (running, batch) in [(&norm.running_mean, mean), (&norm.running_var, variance)] {
            let old = running.value_sync().to_device(&out.device());
            running.update((old * (1.0 - norm.momentum) + batch.detach() * norm.momentum).detach());
        }
        out
    }
}

/// Draws each matrix and kernel from N(0, 2 / fan-in) (He et al. 2015); vectors keep their ones and noughts.
struct DrawWeights {
    rng: ChaCha8Rng,
}

impl ModuleMapper for DrawWeights {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if D == 1 {
            return param;
        }
        param.map(|tensor| {
            let shape = tensor.dims();
            // Convolutions are [out, in, k, k]; linear layers are [in, out].
            let fan_in: usize = if D == 2 { shape[0] } else { shape[1..].iter().product() };
            let scale = (2.0 / fan_in as f64).sqrt();
            let values: Vec<f32> =
                (0..shape.iter().product()).map(|_| (scale * normal(&mut self.rng)) as f32).collect();
            let device = tensor.device();
            let requires_grad = tensor.is_require_grad();
            Tensor::from_data(TensorData::new(values, shape), &device).set_require_grad(requires_grad)
        })
    }
}

/// One standard normal variate by Box and Muller's method.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

/// One named tensor of a module: its path, its shape and its values.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTensor {
    /// Path of fields, joined by dots: `encoder.stem.conv.weight`.
    pub name: String,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Values, last axis fastest.
    pub values: Vec<f32>,
}

/// Every float tensor of a module, running statistics included, in the order of its fields.
pub fn tensors_of<M: Module>(module: &M) -> Vec<NamedTensor> {
    let mut collect = Collect { path: Vec::new(), tensors: Vec::new() };
    module.visit(&mut collect);
    collect.tensors
}

struct Collect {
    path: Vec<String>,
    tensors: Vec<NamedTensor>,
}

impl ModuleVisitor for Collect {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let shape = tensor.dims().to_vec();
        // The tensors of this module are f32 by construction.
        let values = tensor.into_data().convert::<f32>().try_into_vec::<f32>().unwrap_or_default();
        self.tensors.push(NamedTensor { name: self.path.join("."), shape, values });
    }
}

/// Puts named tensors into a module of the same layout. Fails where one is missing or of another shape.
pub fn with_tensors<M: Module>(module: M, tensors: Vec<NamedTensor>) -> Result<M> {
    let mut replace = Replace { path: Vec::new(), tensors, error: None };
    let module = module.map(&mut replace);
    if let Some(error) = replace.error {
        return Err(error);
    }
    if let Some(extra) = replace.tensors.first() {
        return Err(Error::invalid(&extra.name, "no such tensor in this network", format!("shape {:?}", extra.shape)));
    }
    Ok(module)
}

struct Replace {
    path: Vec<String>,
    tensors: Vec<NamedTensor>,
    error: Option<Error>,
}

impl ModuleMapper for Replace {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.path.join(".");
        let shape = param.val().dims().to_vec();
        let Some(at) = self.tensors.iter().position(|t| t.name == name) else {
            self.error.get_or_insert(Error::invalid(name, format!("a tensor of shape {shape:?}"), "nothing"));
            return param;
        };
        let found = self.tensors.swap_remove(at);
        if found.shape != shape || found.values.len() != shape.iter().product::<usize>() {
            self.error.get_or_insert(Error::invalid(name, format!("shape {shape:?}"), format!("{:?}", found.shape)));
            return param;
        }
        param.map(|tensor| {
            let requires_grad = tensor.is_require_grad();
            Tensor::from_data(TensorData::new(found.values, tensor.dims()), &tensor.device())
                .set_require_grad(requires_grad)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::DeviceKind;

    fn tiny() -> NetworkConfig {
        NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 }
    }

    fn image(n: usize, device: &Device) -> Tensor<4> {
        let values: Vec<f32> = (0..n * 3 * 12 * 16).map(|i| ((i * 37 % 101) as f32 - 50.0) / 30.0).collect();
        Tensor::from_data(TensorData::new(values, [n, 3, 12, 16]), device)
    }

    #[test]
    fn the_same_seed_gives_the_same_network_on_every_backend() {
        let embed = |kind: DeviceKind| {
            let device = kind.tensor_device();
            let network = tiny().init(7, &device);
            network.query(image(2, &device)).into_data().try_into_vec::<f32>().unwrap()
        };
        let (flex, ndarray) = (embed(DeviceKind::Flex), embed(DeviceKind::Ndarray));
        assert_eq!(flex.len(), 12);
        // The two backends sum in another order: some 1e-6 a layer on values of order 1.
        assert!(flex.iter().zip(&ndarray).all(|(a, b)| (a - b).abs() < 1e-4), "{flex:?} {ndarray:?}");
    }

    #[test]
    fn tensors_taken_out_and_put_back_give_the_same_embedding() {
        let device = DeviceKind::Flex.tensor_device();
        let network = tiny().init(1, &device);
        let other = with_tensors(tiny().init(2, &device), tensors_of(&network)).unwrap();
        let embed = |n: &Network| n.query(image(3, &device)).into_data().try_into_vec::<f32>().unwrap();
        assert_eq!(embed(&network), embed(&other));
    }

    /// One step of training by our kernels and by burn's own: outputs, running statistics and every gradient.
    #[cfg(feature = "autodiff")]
    #[test]
    fn our_kernels_train_as_burns_own_do() {
        let run = |kind: DeviceKind| {
            let device = kind.tensor_device().autodiff();
            let network = tiny().init(7, &device);
            let out = network.query(image(4, &device));
            let weights: Vec<f32> = (0..24).map(|i| (i as f32 * 1.3).cos()).collect();
            let weights = Tensor::<2>::from_data(TensorData::new(weights, [4, 6]), &device);
            let mut gradients = (out.clone() * weights).sum().backward();
            let mut found = Vec::new();
            let mut collect = CollectGradients { gradients: &mut gradients, found: &mut found };
            network.visit(&mut collect);
            (out.into_data().try_into_vec::<f32>().unwrap(), tensors_of(&network), found)
        };
        let close = |a: &[f32], b: &[f32]| {
            let largest = b.iter().fold(0.05_f32, |m, v| m.max(v.abs())); // some gradients are nought but for rounding
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-4 * largest)
        };
        let (ours, burns) = (run(DeviceKind::Flex), run(DeviceKind::Ndarray));
        assert!(close(&ours.0, &burns.0), "{:?} {:?}", ours.0, burns.0);
        for (a, b) in ours.1.iter().zip(&burns.1) {
            assert!(close(&a.values, &b.values), "{} {:?} {:?}", a.name, a.values, b.values);
        }
        assert!(ours.2.len() > 20 && ours.2.len() == burns.2.len());
        for (a, b) in ours.2.iter().zip(&burns.2) {
            assert!(close(a, b), "{a:?} {b:?}");
        }
    }

    #[cfg(feature = "autodiff")]
    struct CollectGradients<'a> {
        gradients: &'a mut burn::tensor::Gradients,
        found: &'a mut Vec<Vec<f32>>,
    }

    #[cfg(feature = "autodiff")]
    impl ModuleVisitor for CollectGradients<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(gradient) = param.val().grad_remove(self.gradients) {
                self.found.push(gradient.into_data().try_into_vec::<f32>().unwrap());
            }
        }
    }

    #[test]
    fn a_tensor_of_another_shape_is_named() {
        let device = DeviceKind::Flex.tensor_device();
        let mut tensors = tensors_of(&tiny().init(1, &device));
        tensors[0].shape[0] += 1;
        let error = with_tensors(tiny().init(2, &device), tensors).unwrap_err().to_string();
        assert!(error.contains("encoder.stem.conv.weight"), "{error}");
    }
}

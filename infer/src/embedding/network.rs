//! The network as a burn module: one encoder for holes and pegs, one predictor for queries. For training, and for devices
//! other than the CPU; a robot runs [`crate::embedding::encoder`].
//!
//! `query = predictor(encoder(hole))`, `key = encoder(peg)` (MoCo-v3, Sec. 3). The encoder keeps the
//! layout of the view to its last layer, because where an edge is says as much as that it is there:
//! a global average would throw the pose away.

use crate::embedding::architecture::{ConvLayer, NetworkConfig};
use crate::embedding::conv::op;
pub use crate::embedding::conv::op::is_card;
use crate::error::{Error, Result};
use crate::safefile::NamedTensor;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

impl NetworkConfig {
    /// A network with weights drawn from `seed`: the same on every backend.
    pub fn init(&self, seed: u64, device: &Device) -> Network {
        let linear = |n_in, n_out| LinearConfig::new(n_in, n_out).with_bias(false).init(device);
        let network = Network {
            encoder: Encoder {
                convs: self.conv_layers().iter().map(|layer| ConvBn::new(layer, device)).collect(),
                project_1: linear(self.n_flattened(), self.hidden),
                norm_1: BatchNormConfig::new(self.hidden).init(device),
                project_2: linear(self.hidden, self.dim),
                norm_2: BatchNormConfig::new(self.dim).init(device),
            },
            predictor: Predictor {
                predict_1: linear(self.dim, self.hidden),
                norm_1: BatchNormConfig::new(self.hidden).init(device),
                predict_2: linear(self.hidden, self.dim),
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

/// Backbone and projector: [`NetworkConfig::conv_layers`], then two linear layers.
#[derive(Module, Debug)]
pub struct Encoder {
    convs: Vec<ConvBn>,
    project_1: Linear, // [n, flattened] -> [n, hidden]
    norm_1: BatchNorm,
    project_2: Linear, // -> [n, dim]
    norm_2: BatchNorm,
}

impl Encoder {
    /// `[n, 3, height, width]` -> `[n, dim]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let device = images.device();
        // In training by our own kernels: the same numbers but for rounding.
        match () {
            () if device.is_autodiff() && op::is_card(&device) => self.project_on_card(self.convolve_ours(images)),
            () if device.is_autodiff() && op::is_cpu(&device) => self.project(self.convolve_ours(images)),
            () => self.project(self.convolve(images)),
        }
    }

    /// By our own kernels: `[n, 3, height, width]` -> `[n, channels, rows, columns]`.
    fn convolve_ours(&self, images: Tensor<4>) -> Tensor<4> {
        let x = images.permute([0, 2, 3, 1]); // [n, height, width, channels]
        self.convs.iter().fold(x, |x, conv| conv.train(x)).permute([0, 3, 1, 2])
    }

    /// The same by burn's kernels, on any device.
    fn convolve(&self, images: Tensor<4>) -> Tensor<4> {
        self.convs.iter().fold(images, |x, conv| conv.forward(x))
    }

    fn project(&self, x: Tensor<4>) -> Tensor<2> {
        let x = x.flatten::<2>(1, 3); // [n, channels * rows * columns]
        let x = relu(self.norm_1.forward(self.project_1.forward(x)));
        self.norm_2.forward(self.project_2.forward(x))
    }

    /// The same by our own kernels on a graphics card.
    fn project_on_card(&self, x: Tensor<4>) -> Tensor<2> {
        let x = train_linear(x.flatten::<2>(1, 3), &self.project_1, &self.norm_1, true);
        train_linear(x, &self.project_2, &self.norm_2, false)
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
        let device = x.device();
        if device.is_autodiff() && op::is_card(&device) {
            return self.predict_2.forward(train_linear(x, &self.predict_1, &self.norm_1, true));
        }
        self.predict_2.forward(relu(self.norm_1.forward(self.predict_1.forward(x))))
    }
}

/// `relu(norm(conv(x)) [+ x])`: a convolution without bias, its batch normalisation, the skip and the rectifier.
#[derive(Module, Debug)]
pub struct ConvBn {
    conv: Conv2d,
    norm: BatchNorm,
    adds_input: bool,
}

impl ConvBn {
    pub(crate) fn new(layer: &ConvLayer, device: &Device) -> Self {
        let pad = layer.kernel / 2;
        Self {
            conv: Conv2dConfig::new([layer.n_in, layer.n_out], [layer.kernel; 2])
                .with_stride([layer.stride; 2])
                .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
                .with_bias(false)
                .init(device),
            norm: BatchNormConfig::new(layer.n_out).init(device),
            adds_input: layer.adds_input,
        }
    }

    /// In training by our own kernels, else by burn's: `[n, height, width, channels]`.
    pub(crate) fn forward_nhwc(&self, x: Tensor<4>) -> Tensor<4> {
        let device = x.device();
        if device.is_autodiff() && (op::is_cpu(&device) || op::is_card(&device)) {
            return self.train(x);
        }
        self.forward(x.permute([0, 3, 1, 2])).permute([0, 2, 3, 1])
    }

    /// By burn's kernels, on any device: `[n, channels, height, width]`.
    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let out = self.norm.forward(self.conv.forward(x.clone()));
        relu(if self.adds_input { x + out } else { out })
    }

    /// By our own kernels, `[n, height, width, channels]`; the running statistics follow the batch's.
    fn train(&self, x: Tensor<4>) -> Tensor<4> {
        let joined = Joined { stride: self.conv.stride[0], adds_input: self.adds_input, rectifies: true };
        train_layer(x, self.conv.weight.val(), &self.norm, joined)
    }
}

/// A linear layer, its batch normalisation and perhaps the rectifier, by our own kernels on a graphics card:
/// `[n, n_in]` -> `[n, n_out]`.
fn train_linear(x: Tensor<2>, linear: &Linear, norm: &BatchNorm, rectifies: bool) -> Tensor<2> {
    let [n, n_in] = x.dims();
    let joined = Joined { stride: 1, adds_input: false, rectifies };
    train_layer(x.reshape([n, 1, 1, n_in]), linear.weight.val(), norm, joined).flatten::<2>(1, 3)
}

/// How a layer goes from its product with the weights to its output.
struct Joined {
    stride: usize,
    adds_input: bool,
    rectifies: bool,
}

/// A layer by our own kernels; the running statistics of its normalisation follow the batch's.
fn train_layer<const D: usize>(x: Tensor<4>, weights: Tensor<D>, norm: &BatchNorm, joined: Joined) -> Tensor<4> {
    let Joined { stride, adds_input, rectifies } = joined;
    let layer = op::Layer { stride, adds_input, rectifies, epsilon: norm.epsilon, momentum: norm.momentum };
    let device = x.device();
    let running = [&norm.running_mean, &norm.running_var];
    let [mean, variance] = running.map(|running| running.value_sync().to_device(&device));
    let (out, followed) = op::train_layer(x, weights, [norm.gamma.val(), norm.beta.val(), mean, variance], layer);
    for (running, new) in running.into_iter().zip(followed) {
        // In the place of `update`, whose mean over threads is a launch more. Clones share their value.
        let _ = running.clone().map(&mut NewValue(new.detach()));
    }
    out
}

/// Puts a tensor in the place of another.
struct NewValue(Tensor<1>);

impl ModuleMapper for NewValue {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|old| self.0.clone().reshape(old.dims()))
    }
}

/// Draws each matrix and kernel from N(0, 2 / fan-in) (He et al. 2015); vectors keep their ones and zeros.
pub(crate) struct DrawWeights {
    pub(crate) rng: ChaCha8Rng,
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

/// Every float tensor of a module, running statistics included, in the order of its fields.
pub fn tensors_of<M: Module>(module: &M) -> Vec<NamedTensor> {
    let mut collect = Collect { path: Vec::new(), tensors: Vec::new() };
    module.visit(&mut collect);
    collect.tensors
}

/// The name of a tensor from the fields that lead to it: a convolution has its layer's name instead of its place in the list.
fn tensor_name(path: &[String]) -> String {
    let layers = NetworkConfig::TINY.conv_layers();
    let mut parts: Vec<&str> = path.iter().map(String::as_str).collect();
    if let Some(list) = parts.iter().position(|part| *part == "convs") {
        let layer = parts.get(list + 1).and_then(|index| layers.get(index.parse::<usize>().ok()?));
        parts.splice(list..=list + 1, layer.map(|layer| layer.name));
    }
    parts.join(".")
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
        self.tensors.push(NamedTensor { name: tensor_name(&self.path), shape, values });
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
        let name = tensor_name(&self.path);
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
    use crate::embedding::device::DeviceKind;

    fn tiny() -> NetworkConfig {
        NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 }
    }

    fn image(n: usize, device: &Device) -> Tensor<4> {
        let values: Vec<f32> = (0..n * 3 * 12 * 16).map(|i| ((i * 37 % 101) as f32 - 50.0) / 30.0).collect();
        Tensor::from_data(TensorData::new(values, [n, 3, 12, 16]), device)
    }

    #[cfg(feature = "ndarray")]
    #[test]
    fn the_same_seed_gives_the_same_network_on_ndarray() {
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

    /// What one step of training makes: output, running statistics and every gradient.
    #[cfg(feature = "autodiff")]
    struct Step {
        out: Vec<f32>,
        tensors: Vec<NamedTensor>,
        gradients: Vec<Vec<f32>>,
    }

    #[cfg(feature = "autodiff")]
    impl Step {
        fn of(config: NetworkConfig, kind: DeviceKind, query: fn(&Network, Tensor<4>) -> Tensor<2>) -> Self {
            let device = kind.tensor_device().autodiff();
            let network = config.init(7, &device);
            let [width, height] = config.input_px;
            let values = (0..6 * 3 * width * height).map(|i| ((i * 37 % 101) as f32 - 50.0) / 30.0).collect::<Vec<_>>();
            let out = query(&network, Tensor::from_data(TensorData::new(values, [6, 3, height, width]), &device));
            let weights: Vec<f32> = (0..6 * config.dim).map(|i| (i as f32 * 1.3).cos()).collect();
            let weights = Tensor::<2>::from_data(TensorData::new(weights, [6, config.dim]), &device);
            let mut gradients = (out.clone() * weights).sum().backward();
            let mut found = Vec::new();
            network.visit(&mut CollectGradients { gradients: &mut gradients, found: &mut found });
            // burn's own layers keep their last statistics back until they are asked for.
            let tensors = tensors_of(&network.valid());
            Self { out: out.into_data().try_into_vec().unwrap(), tensors, gradients: found }
        }

        fn assert_is(&self, other: &Self) {
            let close = |a: &[f32], b: &[f32]| {
                let largest = b.iter().fold(0.05_f32, |m, v| m.max(v.abs())); // some gradients are zero but for rounding
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-4 * largest)
            };
            assert!(close(&self.out, &other.out), "{:?} {:?}", self.out, other.out);
            for (a, b) in self.tensors.iter().zip(&other.tensors) {
                assert!(close(&a.values, &b.values), "{} {:?} {:?}", a.name, a.values, b.values);
            }
            assert!(self.gradients.len() > 20 && self.gradients.len() == other.gradients.len());
            for (a, b) in self.gradients.iter().zip(&other.gradients) {
                assert!(close(a, b), "{a:?} {b:?}");
            }
        }
    }

    #[cfg(feature = "autodiff")]
    #[test]
    fn our_kernels_train_as_burns_own_do() {
        let burns = |network: &Network, images| {
            let Network { encoder, predictor } = network;
            predictor.forward(encoder.project(encoder.convolve(images)))
        };
        Step::of(tiny(), DeviceKind::Flex, Network::query).assert_is(&Step::of(tiny(), DeviceKind::Flex, burns));
    }

    /// Widths of whole fours, and others, whose products burn makes.
    #[cfg(all(feature = "autodiff", feature = "wgpu"))]
    #[test]
    fn our_kernels_train_on_a_card_as_on_the_cpu() {
        let odd = NetworkConfig { input_px: [25, 17], width: 3, hidden: 30, dim: 10 };
        let wide = NetworkConfig { input_px: [40, 30], width: 32, hidden: 256, dim: 128 };
        for config in [tiny(), odd, wide] {
            let [card, cpu] = [DeviceKind::Wgpu, DeviceKind::Flex].map(|kind| Step::of(config, kind, Network::query));
            card.assert_is(&cpu);
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

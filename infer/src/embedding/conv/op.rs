//! Convolution, batch normalisation, the skip and the rectifier as one burn operation, on the CPU and on graphics cards.
//!
//! `relu(norm(conv(x)) [+ x])`: taken together the four pass over their data half as often, and the
//! gradient needs only what the forward pass kept anyway.

use std::fmt::Debug;

use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, DispatchDevice, ExtensionType, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Device, Tensor, TensorData};
#[cfg(feature = "wgpu")]
use burn_cubecl::CubeBackend;

use super::Conv;
use super::norm::{Norm, Statistics};

/// How a layer goes from its convolution to its output.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// Step between outputs, pixels.
    pub stride: usize,
    /// Whether the input is added before the rectifier.
    pub adds_input: bool,
    /// Whether there is a rectifier; on the CPU there always is.
    pub rectifies: bool,
    /// What keeps the division by the deviation finite.
    pub epsilon: f64,
    /// The share of a batch in the running statistics.
    pub momentum: f64,
}

/// What goes into a layer: images `[n, h, w, n_in]`, weights `[n_out, n_in, k, k]` (on a card also `[n_in, n_out]`, a linear
/// layer), the other four `[n_out]`.
#[derive(ExtensionType)]
pub struct Trained<B: Backend> {
    /// `[n, h, w, n_in]`.
    pub images: FloatTensor<B>,
    /// `[n_out, n_in, k, k]`, or `[n_in, n_out]`.
    pub weights: FloatTensor<B>,
    /// The factor after the normalisation.
    pub gamma: FloatTensor<B>,
    /// The summand after it.
    pub beta: FloatTensor<B>,
    /// Running mean of the convolution's output ...
    pub running_mean: FloatTensor<B>,
    /// ... and its running variance.
    pub running_variance: FloatTensor<B>,
}

/// What comes out: `[n, h', w', n_out]`, and the running statistics that have followed the batch's.
#[derive(ExtensionType)]
pub struct Normalised<B: Backend> {
    /// The layer's output.
    pub out: FloatTensor<B>,
    /// The new running mean.
    pub running_mean: FloatTensor<B>,
    /// The new running variance.
    pub running_variance: FloatTensor<B>,
}

/// The gradients of what is trained, and of the images where they are asked for.
#[derive(Clone, Debug)]
pub struct Gradients<B: Backend> {
    /// As the images.
    pub images: Option<FloatTensor<B>>,
    /// As the weights.
    pub weights: FloatTensor<B>,
    /// `[n_out]`.
    pub gamma: FloatTensor<B>,
    /// `[n_out]`.
    pub beta: FloatTensor<B>,
}

/// A backend with kernels of ours for a layer and its gradient.
pub trait Differentiable: Backend {
    /// What the gradient needs of the forward pass.
    type Kept: Clone + Debug + Send + 'static;

    /// The layer of a batch, by the batch's own statistics.
    fn forward(trained: Trained<Self>, layer: Layer) -> (Normalised<Self>, Self::Kept);

    /// The gradients from the output's.
    fn gradients(kept: Self::Kept, out_gradient: FloatTensor<Self>, images_too: bool) -> Gradients<Self>;
}

/// The layer in training, with gradients or without.
#[cfg_attr(all(feature = "autodiff", feature = "wgpu"), backend_extension(Flex, Cube, Autodiff))]
#[cfg_attr(all(feature = "autodiff", not(feature = "wgpu")), backend_extension(Flex, Autodiff))]
#[cfg_attr(all(not(feature = "autodiff"), feature = "wgpu"), backend_extension(Flex, Cube))]
#[cfg_attr(all(not(feature = "autodiff"), not(feature = "wgpu")), backend_extension(Flex))]
pub trait LayerOps: Backend {
    /// The layer of a batch, by the batch's own statistics.
    fn train_layer(#[extension_type] trained: Trained<Self>, layer: Layer) -> Normalised<Self>;
}

/// Whether this is our CPU backend.
pub fn is_cpu(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Flex(_))
}

/// Whether this is a graphics card.
#[cfg(feature = "wgpu")]
pub fn is_card(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Cube(_))
}

/// Whether this is a graphics card.
#[cfg(not(feature = "wgpu"))]
pub fn is_card(_device: &Device) -> bool {
    false
}

/// [`LayerOps::train_layer`] on tensors: images, weights, `[gamma, beta, running mean, running variance]`.
///
/// # Panics
/// On another device than our CPU backend and a graphics card.
pub fn train_layer<const D: usize>(
    images: Tensor<4>,
    weights: Tensor<D>,
    [gamma, beta, running_mean, running_variance]: [Tensor<1>; 4],
    layer: Layer,
) -> (Tensor<4>, [Tensor<1>; 2]) {
    let [gamma, beta, running_mean, running_variance] =
        [gamma, beta, running_mean, running_variance].map(Tensor::into_dispatch);
    let [images, weights] = [images.into_dispatch(), weights.into_dispatch()];
    let trained = Trained { images, weights, gamma, beta, running_mean, running_variance };
    let Normalised { out, running_mean, running_variance } = <Dispatch as LayerOps>::train_layer(trained, layer);
    (Tensor::from_dispatch(out), [running_mean, running_variance].map(Tensor::from_dispatch))
}

/// The operation of a backend that can be differentiated, without gradients.
macro_rules! layer_ops {
    ($backend:ty) => {
        impl LayerOps for $backend {
            fn train_layer(trained: Trained<Self>, layer: Layer) -> Normalised<Self> {
                Self::forward(trained, layer).0
            }
        }
    };
}

layer_ops!(Flex);
#[cfg(feature = "wgpu")]
layer_ops!(CubeBackend);

/// What the gradient needs of the forward pass on the CPU.
#[derive(Clone, Debug)]
pub struct Kept {
    conv: Conv,
    images: FlexTensor,
    weights: FlexTensor,
    gamma: FlexTensor,
    /// Output of the convolution, before the normalisation.
    before: FlexTensor,
    out: FlexTensor,
    statistics: Statistics,
    layer: Layer,
}

impl Differentiable for Flex {
    type Kept = Kept;

    fn forward(trained: Trained<Self>, layer: Layer) -> (Normalised<Self>, Kept) {
        let Trained { images, weights, gamma, beta, running_mean, running_variance } = trained;
        debug_assert!(layer.rectifies);
        let [images, weights, gamma, beta] = [images, weights, gamma, beta].map(packed);
        let (shape, kernel) = (images.shape(), weights.shape());
        let conv = Conv {
            n_in: shape[3],
            n_out: kernel[0],
            kernel: kernel[2],
            stride: layer.stride,
            size: [shape[1], shape[2]],
        };
        let (before, statistics) =
            on_all_threads(|| super::norm::forward_with_statistics(&conv, values(&images), values(&weights)));
        let norm = Norm::new(&statistics, values(&gamma), values(&beta), layer.epsilon);
        let out = on_all_threads(|| norm.apply(&before, layer.adds_input.then(|| values(&images))));
        let [rows, columns] = conv.out_size();
        let shape = [shape[0], rows, columns, conv.n_out];
        let (before, out) = (tensor(before, &shape), tensor(out, &shape));
        let followed = |running: FlexTensor, batch: &[f32]| {
            let shares = [1.0 - layer.momentum, layer.momentum].map(|share| share as f32);
            let moved = values(&packed(running))
                .iter()
                .zip(batch)
                .map(|(old, new)| old * shares[0] + new * shares[1])
                .collect();
            tensor(moved, &[conv.n_out])
        };
        let normalised = Normalised {
            out: out.clone(),
            running_mean: followed(running_mean, &statistics.mean),
            running_variance: followed(running_variance, &statistics.variance),
        };
        (normalised, Kept { conv, images, weights, gamma, before, out, statistics, layer })
    }

    fn gradients(kept: Kept, out_gradient: FlexTensor, images_too: bool) -> Gradients<Self> {
        let (conv, out_gradient) = (kept.conv, packed(out_gradient));
        let norm = Norm::new(&kept.statistics, values(&kept.gamma), &[], kept.layer.epsilon);
        let back = on_all_threads(|| norm.gradient(values(&kept.before), values(&kept.out), values(&out_gradient)));
        let images = images_too.then(|| {
            let mut gradient = on_all_threads(|| conv.input_gradient(&back.before, values(&kept.weights)));
            if kept.layer.adds_input {
                norm.add_rectified(values(&kept.out), values(&out_gradient), &mut gradient);
            }
            tensor(gradient, &kept.images.shape())
        });
        let weights = on_all_threads(|| conv.weight_gradient(values(&kept.images), &back.before));
        Gradients {
            images,
            weights: tensor(weights, &kept.weights.shape()),
            gamma: tensor(back.gamma, &[conv.n_out]),
            beta: tensor(back.beta, &[conv.n_out]),
        }
    }
}

/// Training takes the whole machine: runs `work` in rayon's global pool.
fn on_all_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::scope(|_| work())
}

/// The tensor with its values in order from the start of its storage.
fn packed(tensor: FlexTensor) -> FlexTensor {
    let is_whole = tensor.is_contiguous()
        && tensor.layout().start_offset() == 0
        && tensor.storage::<f32>().len() == tensor.layout().num_elements();
    if is_whole { tensor } else { FlexTensor::from_data(tensor.into_data()) }
}

fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.storage()
}

fn tensor(values: Vec<f32>, shape: &[usize]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

#[cfg(feature = "autodiff")]
mod gradient {
    use std::marker::PhantomData;

    use burn::backend::Autodiff;
    use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
    use burn::backend::autodiff::grads::Gradients as Registered;
    use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};

    use super::*;

    #[derive(Debug)]
    struct LayerGradient<B>(PhantomData<B>);

    impl<B: Differentiable> Backward<B, 4> for LayerGradient<B> {
        type State = B::Kept;

        fn backward(self, ops: Ops<B::Kept, 4>, grads: &mut Registered, _checkpointer: &mut Checkpointer) {
            let out_gradient = grads.consume::<B>(&ops.node);
            let [images, weights, gamma, beta] = ops.parents.map(|parent| parent.map(|node| node.id));
            let found = B::gradients(ops.state, out_gradient, images.is_some());
            let of_parents = [
                (images, found.images),
                (weights, Some(found.weights)),
                (gamma, Some(found.gamma)),
                (beta, Some(found.beta)),
            ];
            for (parent, gradient) in of_parents {
                if let (Some(id), Some(gradient)) = (parent, gradient) {
                    grads.register::<B>(id, gradient);
                }
            }
        }
    }

    impl<B: Differentiable, C: CheckpointStrategy> LayerOps for Autodiff<B, C> {
        fn train_layer(trained: Trained<Self>, layer: Layer) -> Normalised<Self> {
            let Trained { images, weights, gamma, beta, running_mean, running_variance } = trained;
            let prepared = LayerGradient(PhantomData::<B>)
                .prepare::<C>([images.node(), weights.node(), gamma.node(), beta.node()])
                .compute_bound()
                .stateful();
            let [images, weights, gamma, beta, running_mean, running_variance] =
                [images, weights, gamma, beta, running_mean, running_variance].map(|t| t.into_primitive());
            let trained = Trained { images, weights, gamma, beta, running_mean, running_variance };
            let (Normalised { out, running_mean, running_variance }, kept) = B::forward(trained, layer);
            let out = match prepared {
                OpsKind::Tracked(prepared) => prepared.finish(kept, out),
                OpsKind::UnTracked(prepared) => prepared.finish(out),
            };
            let [running_mean, running_variance] = [running_mean, running_variance].map(FloatTensor::<Self>::new);
            Normalised { out, running_mean, running_variance }
        }
    }
}

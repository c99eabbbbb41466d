//! Convolution, batch normalisation, the skip and the rectifier as one burn operation on the CPU.
//!
//! `relu(norm(conv(x)) [+ x])`: taken together the four pass over their data half as often, and the
//! gradient needs only what the forward pass kept anyway.

use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, DispatchDevice, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Device, Tensor, TensorData};

use super::Conv;
use super::norm::{Norm, Statistics};

/// How a layer goes from its convolution to its output.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// Step between outputs, pixels.
    pub stride: usize,
    /// Whether the input is added before the rectifier.
    pub adds_input: bool,
    /// What keeps the division by the deviation finite.
    pub epsilon: f64,
}

/// The layer in training, on the CPU backend with gradients or without.
#[cfg_attr(feature = "autodiff", backend_extension(Flex, Autodiff))]
#[cfg_attr(not(feature = "autodiff"), backend_extension(Flex))]
pub trait LayerOps: Backend {
    /// `[n, h, w, n_in]`, `[n_out, n_in, k, k]`, `[n_out]` twice -> output `[n, h', w', n_out]`, and the batch's
    /// mean and biased variance, `[n_out]`.
    fn train_layer(
        images: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        layer: Layer,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

/// Whether [`train_layer`] works on this device, with gradients or without.
pub fn is_supported(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Flex(_))
}

/// [`LayerOps::train_layer`] on tensors.
///
/// # Panics
/// On a device that [`is_supported`] does not name.
pub fn train_layer(
    images: Tensor<4>,
    weights: Tensor<4>,
    gamma: Tensor<1>,
    beta: Tensor<1>,
    layer: Layer,
) -> (Tensor<4>, Tensor<1>, Tensor<1>) {
    let (out, mean, variance) = <Dispatch as LayerOps>::train_layer(
        images.into_dispatch(),
        weights.into_dispatch(),
        gamma.into_dispatch(),
        beta.into_dispatch(),
        layer,
    );
    (Tensor::from_dispatch(out), Tensor::from_dispatch(mean), Tensor::from_dispatch(variance))
}

impl LayerOps for Flex {
    fn train_layer(
        images: FlexTensor,
        weights: FlexTensor,
        gamma: FlexTensor,
        beta: FlexTensor,
        layer: Layer,
    ) -> (FlexTensor, FlexTensor, FlexTensor) {
        let (out, kept) = forward(images, weights, gamma, beta, layer);
        let channels = [kept.conv.n_out];
        (out, tensor(kept.statistics.mean, &channels), tensor(kept.statistics.variance, &channels))
    }
}

/// What the gradient needs of the forward pass.
#[derive(Clone, Debug)]
struct Kept {
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

fn forward(
    images: FlexTensor,
    weights: FlexTensor,
    gamma: FlexTensor,
    beta: FlexTensor,
    layer: Layer,
) -> (FlexTensor, Kept) {
    let [images, weights, gamma, beta] = [images, weights, gamma, beta].map(packed);
    let (shape, kernel) = (images.shape(), weights.shape());
    let conv =
        Conv { n_in: shape[3], n_out: kernel[0], kernel: kernel[2], stride: layer.stride, size: [shape[1], shape[2]] };
    let (before, statistics) =
        on_all_threads(|| super::norm::forward_with_statistics(&conv, values(&images), values(&weights)));
    let norm = Norm::new(&statistics, values(&gamma), values(&beta), layer.epsilon);
    let out = on_all_threads(|| norm.apply(&before, layer.adds_input.then(|| values(&images))));
    let [rows, columns] = conv.out_size();
    let shape = [shape[0], rows, columns, conv.n_out];
    let (before, out) = (tensor(before, &shape), tensor(out, &shape));
    (out.clone(), Kept { conv, images, weights, gamma, before, out, statistics, layer })
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
    use burn::backend::Autodiff;
    use burn::backend::autodiff::NodeId;
    use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
    use burn::backend::autodiff::grads::Gradients;
    use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};

    use super::*;

    #[derive(Debug)]
    struct LayerGradient;

    impl Backward<Flex, 4> for LayerGradient {
        type State = Kept;

        fn backward(self, ops: Ops<Kept, 4>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
            let out_gradient = packed(grads.consume::<Flex>(&ops.node));
            let kept = ops.state;
            let conv = kept.conv;
            let norm = Norm::new(&kept.statistics, values(&kept.gamma), &[], kept.layer.epsilon);
            let back = on_all_threads(|| norm.gradient(values(&kept.before), values(&kept.out), values(&out_gradient)));
            let mut register = |parent: Option<NodeId>, make: &dyn Fn() -> FlexTensor| {
                if let Some(id) = parent {
                    grads.register::<Flex>(id, make());
                }
            };
            let [images, weights, gamma, beta] = ops.parents.map(|parent| parent.map(|node| node.id));
            register(images, &|| {
                let mut gradient = on_all_threads(|| conv.input_gradient(&back.before, values(&kept.weights)));
                if kept.layer.adds_input {
                    norm.add_rectified(values(&kept.out), values(&out_gradient), &mut gradient);
                }
                tensor(gradient, &kept.images.shape())
            });
            register(weights, &|| {
                let gradient = on_all_threads(|| conv.weight_gradient(values(&kept.images), &back.before));
                tensor(gradient, &kept.weights.shape())
            });
            register(gamma, &|| tensor(back.gamma.clone(), &[conv.n_out]));
            register(beta, &|| tensor(back.beta.clone(), &[conv.n_out]));
        }
    }

    impl<C: CheckpointStrategy> LayerOps for Autodiff<Flex, C> {
        fn train_layer(
            images: FloatTensor<Self>,
            weights: FloatTensor<Self>,
            gamma: FloatTensor<Self>,
            beta: FloatTensor<Self>,
            layer: Layer,
        ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
            let prepared = LayerGradient
                .prepare::<C>([images.node(), weights.node(), gamma.node(), beta.node()])
                .compute_bound()
                .stateful();
            let [images, weights, gamma, beta] = [images, weights, gamma, beta].map(|t| t.into_primitive());
            let (out, kept) = forward(images, weights, gamma, beta, layer);
            let channels = [kept.conv.n_out];
            let constant = |values: &[f32]| FloatTensor::<Self>::new(tensor(values.to_vec(), &channels));
            let (mean, variance) = (constant(&kept.statistics.mean), constant(&kept.statistics.variance));
            let out = match prepared {
                OpsKind::Tracked(prepared) => prepared.finish(kept, out),
                OpsKind::UnTracked(prepared) => prepared.finish(out),
            };
            (out, mean, variance)
        }
    }
}

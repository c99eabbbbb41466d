//! How large a gradient is.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{GradientsParams, MultiGradientsParams};
use burn::tensor::{Device, Tensor};

/// The Euclidean length of the gradient of all of a module's parameters, the parts of the batch summed.
/// Not finite where a value is not, or where its square leaves f32.
pub fn norm<M: Module>(module: &M, gradients: &MultiGradientsParams) -> f64 {
    let mut squares = Squares { parts: &gradients.grads, sums: Vec::new() };
    module.visit(&mut squares);
    if squares.sums.is_empty() {
        return 0.0;
    }
    f64::from(Tensor::cat(squares.sums, 0).sum().into_scalar::<f32>()).sqrt()
}

struct Squares<'a> {
    parts: &'a [(GradientsParams, Device)],
    sums: Vec<Tensor<1>>,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let parts = self.parts.iter().filter_map(|(gradients, _)| gradients.get::<D>(param.id));
        if let Some(total) = parts.reduce(|sum, part| sum + part) {
            self.sums.push(total.square().sum());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::LinearConfig;
    use tactile_infer::DeviceKind;

    #[test]
    fn the_norm_of_two_parts_is_that_of_their_sum() {
        let device = DeviceKind::Flex.tensor_device().autodiff();
        let linear = LinearConfig::new(2, 1).with_bias(false).init(&device);
        let part = |x: [f32; 2]| {
            let out = linear.forward(Tensor::<2>::from_data([x], &device)).sum();
            (GradientsParams::from_grads(out.backward(), &linear), device.clone())
        };
        // d(w . x)/dw = x: (1, 2) + (2, 2) = (3, 4), of length 5.
        let gradients = MultiGradientsParams { grads: vec![part([1.0, 2.0]), part([2.0, 2.0])] };
        assert!((norm(&linear, &gradients) - 5.0).abs() < 1e-6);
    }
}

//! How large a gradient is.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

#[cfg(feature = "wgpu")]
use crate::lamb::SquareSums;

/// The length of the gradient over all parameters, `[1]`; `None` where none has a gradient.
pub fn norm<M: Module>(module: &M, gradients: &GradientsParams) -> Option<Tensor<1>> {
    let mut squares = Squares {
        gradients,
        sums: Vec::new(),
        #[cfg(feature = "wgpu")]
        on_card: SquareSums::default(),
    };
    module.visit(&mut squares);
    #[cfg(feature = "wgpu")]
    if squares.sums.is_empty() {
        return squares.on_card.length();
    }
    (!squares.sums.is_empty()).then(|| Tensor::cat(squares.sums, 0).sum().sqrt())
}

struct Squares<'a> {
    gradients: &'a GradientsParams,
    sums: Vec<Tensor<1>>,
    #[cfg(feature = "wgpu")]
    on_card: SquareSums,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Some(gradient) = self.gradients.get::<D>(param.id) else { return };
        #[cfg(feature = "wgpu")]
        if tactile_infer::embedding::network::is_card(&gradient.device()) {
            self.on_card.add(gradient.inner());
            return;
        }
        self.sums.push(gradient.square().sum());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::LinearConfig;
    use tactile_infer::DeviceKind;

    #[test]
    fn the_norm_is_the_length_of_the_gradient() {
        let device = DeviceKind::Flex.tensor_device().autodiff();
        let linear = LinearConfig::new(2, 1).with_bias(false).init(&device);
        let out = linear.forward(Tensor::<2>::from_data([[3.0_f32, 4.0]], &device)).sum();
        // d(w . x)/dw = x: (3, 4), of length 5.
        let gradients = GradientsParams::from_grads(out.backward(), &linear);
        let norm = norm(&linear, &gradients).unwrap().into_scalar::<f32>();
        assert!((norm - 5.0).abs() < 1e-6);
    }
}

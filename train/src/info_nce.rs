//! The contrastive loss.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Int, Tensor};

/// InfoNCE (paper, Eq. 1): cross-entropy of `cos(query_i, key_j) / temperature` against `j = i`, the
/// mean over the batch, times `2 temperature` as MoCo-v3 scales it.
///
/// `queries` and `keys`: `[n, dim]`, rows of any length; row `i` of one belongs to row `i` of the other,
/// and all other rows are its negatives. No gradient should flow through `keys`: pass them detached.
pub fn info_nce(queries: Tensor<2>, keys: Tensor<2>, temperature: f64) -> Tensor<1> {
    let [n, _] = queries.dims();
    let logits = unit_rows(queries).matmul(unit_rows(keys).transpose()) / temperature; // [n, n]
    let targets = Tensor::<1, Int>::arange(0..n as i64, &logits.device()).reshape([n, 1]);
    log_softmax(logits, 1).gather(1, targets).mean() * (-2.0 * temperature)
}

/// Rows scaled to unit length. `[n, dim]` -> `[n, dim]`.
pub fn unit_rows(rows: Tensor<2>) -> Tensor<2> {
    let norms = (rows.clone().square().sum_dim(1) + 1e-12).sqrt(); // [n, 1]; 1e-12 keeps the gradient of a zero row finite
    rows / norms
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};
    use tactile_infer::DeviceKind;

    fn device() -> Device {
        DeviceKind::Flex.tensor_device()
    }

    fn value(loss: Tensor<1>) -> f64 {
        f64::from(loss.into_scalar::<f32>())
    }

    #[test]
    fn two_pairs_agree_with_hand_arithmetic() {
        let queries = Tensor::from_data([[1.0_f32, 0.0], [0.0, 2.0]], &device());
        let keys = Tensor::from_data([[3.0_f32, 0.0], [1.0, 1.0]], &device());
        // cos: [[1, 0.7071], [0, 0.7071]], tau 0.5.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let row_1 = -(2.0_f64.exp() / (2.0_f64.exp() + (2.0 * half).exp())).ln();
        let row_2 = -((2.0 * half).exp() / (1.0 + (2.0 * half).exp())).ln();
        let expected = 2.0 * 0.5 * (row_1 + row_2) / 2.0;
        assert!((value(info_nce(queries, keys, 0.5)) - expected).abs() < 1e-6);
    }

    /// Symmetrised MoCo-v3 losses, 4 tau x cross-entropy: equal rows give 4 tau ln n; perfect and
    /// orthogonal gives 4 tau ln(1 + (n - 1) exp(-1 / tau)).
    #[test]
    fn published_batch_sizes_give_the_known_values() {
        for (n, tau, equal, orthogonal) in [(256, 1.0, 22.18, 18.21), (256, 0.2, 4.44, 0.80), (512, 0.2, 4.99, 1.19)] {
            let same = Tensor::<2>::ones([n, n], &device());
            assert!((2.0 * value(info_nce(same.clone(), same, tau)) - equal).abs() < 0.005);
            let eye = Tensor::<2>::from_data(
                TensorData::new((0..n * n).map(|i| f32::from(i % (n + 1) == 0)).collect::<Vec<_>>(), [n, n]),
                &device(),
            );
            assert!((2.0 * value(info_nce(eye.clone(), eye, tau)) - orthogonal).abs() < 0.005);
        }
    }

    #[test]
    fn no_gradient_flows_through_detached_keys() {
        let device = device().autodiff();
        let tensor = |seed: f32| {
            let values: Vec<f32> = (0..12).map(|i| (seed + i as f32).sin()).collect();
            Tensor::<2>::from_data(TensorData::new(values, [3, 4]), &device).require_grad()
        };
        let (queries, keys) = (tensor(0.3), tensor(1.7));
        let gradients = info_nce(queries.clone(), keys.clone().detach(), 0.2).backward();
        assert!(queries.grad(&gradients).is_some());
        assert!(keys.grad(&gradients).is_none());
    }
}

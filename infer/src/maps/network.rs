//! The network that draws a touch's map as a burn module: for training.
//!
//! It halves the picture three times and comes back up, each time with what it saw at that size on the way down (U-Net,
//! Ronneberger et al. 2015). All of it is convolutions by our own kernels, `[n, height, width, channels]`.

use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::{Device, Tensor};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::{MapConfig, N_DRAWN, StageLayers};
use crate::embedding::network::{ConvBn, DrawWeights};

impl MapConfig {
    /// A network with weights drawn from `seed`.
    pub fn init(&self, seed: u64, device: &Device) -> MapNetwork {
        let stage = |layers: &StageLayers| Stage {
            change: ConvBn::new(&layers.change, device),
            refine: ConvBn::new(&layers.refine, device),
        };
        let [down, up] = self.stages().map(|stages| stages.iter().map(stage).collect());
        // Matrices are drawn below; its own draws would follow no seed.
        let draw = LinearConfig::new(self.width, N_DRAWN).with_initializer(Initializer::Zeros).init(device);
        let network = MapNetwork { down, up, draw };
        network.map(&mut DrawWeights { rng: ChaCha8Rng::seed_from_u64(seed) })
    }
}

/// The network.
#[derive(Module, Debug)]
pub struct MapNetwork {
    /// From the full size to the smallest.
    down: Vec<Stage>,
    /// From the second smallest to the full size.
    up: Vec<Stage>,
    draw: Linear,
}

/// Two convolutions at one size.
#[derive(Module, Debug)]
pub struct Stage {
    change: ConvBn,
    refine: ConvBn,
}

impl MapNetwork {
    /// `[n, N_SEEN, height, width]` -> `[n, height, width, N_DRAWN]`; in training by our own kernels.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<4> {
        let mut x = images.permute([0, 2, 3, 1]);
        let mut seen = Vec::with_capacity(self.down.len());
        for stage in &self.down {
            x = stage.forward(x);
            seen.push(x.clone());
        }
        seen.pop();
        for stage in &self.up {
            // As many sizes up as down.
            let Some(before) = seen.pop() else { break };
            let [_, height, width, _] = before.dims();
            x = stage.forward(Tensor::cat(vec![doubled(x, [height, width]), before], 3));
        }
        self.draw.forward(x)
    }
}

impl Stage {
    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        self.refine.forward_nhwc(self.change.forward_nhwc(x))
    }
}

/// Each pixel as two by two, cut to a size: `[n, h, w, c]` -> `[n, height, width, c]`.
fn doubled(x: Tensor<4>, [height, width]: [usize; 2]) -> Tensor<4> {
    let [n, h, w, c] = x.dims();
    let wide = x.reshape([n * h, w, 1, c]).expand([n * h, w, 2, c]).reshape([n, h, 1, 2 * w * c]);
    let high = wide.expand([n, h, 2, 2 * w * c]).reshape([n, 2 * h, 2 * w, c]);
    high.slice([0..n, 0..height, 0..width, 0..c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedding::device::DeviceKind;
    use crate::maps::N_SEEN;
    use burn::tensor::TensorData;

    #[test]
    fn a_pixel_becomes_two_by_two_and_what_is_over_is_cut() {
        let device = DeviceKind::Flex.tensor_device();
        let x = Tensor::<4>::from_data(TensorData::new((0..12).map(|v| v as f32).collect(), [1, 2, 3, 2]), &device);
        let found = doubled(x, [3, 5]);
        assert_eq!(found.dims(), [1, 3, 5, 2]);
        let found = found.into_data().try_into_vec::<f32>().unwrap();
        for (at, value) in found.iter().enumerate() {
            let (row, column, channel) = (at / 10, at / 2 % 5, at % 2);
            assert_eq!(*value, (row / 2 * 6 + column / 2 * 2 + channel) as f32);
        }
    }

    #[test]
    fn a_map_is_as_large_as_its_picture() {
        let config = MapConfig { input_px: [21, 17], width: 4 };
        config.validate().unwrap();
        let device = DeviceKind::Flex.tensor_device();
        let network = config.init(1, &device);
        let images = Tensor::<4>::zeros([2, N_SEEN, 17, 21], &device);
        assert_eq!(network.forward(images).dims(), [2, 17, 21, N_DRAWN]);
        assert!(MapConfig { input_px: [8, 30], width: 4 }.validate().is_err());
    }
}

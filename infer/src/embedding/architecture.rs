//! The layers of the network and their sizes, in one place: the burn module and the tensor-free encoder are both made
//! from this description.

use serde::{Deserialize, Serialize};

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

    /// The convolutions of the encoder, in order.
    pub fn conv_layers(&self) -> [ConvLayer; 6] {
        let w = self.width;
        let layer =
            |name, n_in, n_out, kernel, stride, adds_input| ConvLayer { name, n_in, n_out, kernel, stride, adds_input };
        [
            layer("stem", 3, w, 5, 2, false),
            layer("half", w, 4 * w, 3, 2, false),
            layer("residual_1", 4 * w, 4 * w, 3, 1, true),
            layer("quarter", 4 * w, 4 * w, 3, 2, false),
            layer("residual_2", 4 * w, 4 * w, 3, 1, true),
            layer("narrow", 4 * w, 2 * w, 1, 1, false), // keeps the projector small
        ]
    }

    /// Values of one image after the convolutions: the input of the projector.
    pub fn n_flattened(&self) -> usize {
        let side = |n: usize| self.conv_layers().iter().fold(n, |n, layer| n.div_ceil(layer.stride));
        2 * self.width * side(self.input_px[0]) * side(self.input_px[1])
    }
}

/// One convolution of the encoder, followed by batch normalisation, the sum with its own input where it is residual, and
/// a rectifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvLayer {
    /// Its name in a checkpoint: `encoder.NAME.conv.weight`.
    pub name: &'static str,
    /// Channels of the input.
    pub n_in: usize,
    /// Channels of the output.
    pub n_out: usize,
    /// Side of the kernel, pixels, odd; the input is padded by half of it.
    pub kernel: usize,
    /// Step between outputs, pixels.
    pub stride: usize,
    /// Whether the input is added before the rectifier.
    pub adds_input: bool,
}

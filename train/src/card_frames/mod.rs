//! The training pictures on a graphics card, where they are cropped, flipped and relit: a step sends it some numbers a picture,
//! and no processor is busy with decoding.

mod kernels;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::{Device, Int, Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;
use rayon::prelude::*;
use tactile_data::dataset::touch::Side;
use tactile_infer::embedding::card::threads;

use crate::batch::{Change, Drawn};
use crate::error::Result;
use crate::pairs::Pairs;
use crate::relighting::Affine;
use kernels::{N_PARAMETERS, STEPS_A_UNIT, Sizes};

/// Words of one buffer of pictures; cards take a few gigabytes at once.
const WORDS_A_BUFFER: usize = 1 << 28;

/// Colours that do not change.
const AS_IT_IS: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// All pictures of the training pairs on a card.
#[derive(Debug)]
pub struct CardFrames {
    /// `[n, words]`: the picture of hole `i` is number `2 i`, that of its peg `2 i + 1`.
    buffers: Vec<Tensor<2, Int>>,
    sizes: Sizes,
}

impl CardFrames {
    /// Decodes the pictures of all training pairs and sends them to the card.
    ///
    /// # Errors
    /// Frames that cannot be trained on.
    pub fn new(pairs: &Pairs<'_>, device: &Device) -> Result<Self> {
        let input = pairs.preprocessing.input_px;
        let wide = input.map(|n| 2 * n);
        let words = (3 * wide[0] * wide[1]).div_ceil(2);
        let device = device.clone().inner();
        let decode = |pair, side| -> Result<Vec<i32>> {
            Ok(pack(&pairs.background.tactile_image(&pairs.frame(pair, side))?.planes))
        };
        let buffers = pairs.training.chunks((WORDS_A_BUFFER / words / 2).max(1)).map(|some| {
            let both = some.par_iter().map(|pair| Ok([decode(pair, Side::Hole)?, decode(pair, Side::Peg)?].concat()));
            let packed = both.collect::<Result<Vec<_>>>()?.concat();
            Ok(Tensor::from_data(TensorData::new(packed, [2 * some.len(), words]), &device))
        });
        Ok(Self { buffers: buffers.collect::<Result<_>>()?, sizes: Sizes { wide, input, words } })
    }

    /// The pictures of a batch in `n` micro-batches, `[2 n_m, 3, height, width]` each, holes first.
    pub fn micro_batches(&self, pairs: &Pairs<'_>, drawn: &[Drawn], n: usize, device: &Device) -> Vec<Tensor<4>> {
        let bound = |i: usize| i * drawn.len() / n;
        (0..n).map(|i| self.micro_batch(pairs, &drawn[bound(i)..bound(i + 1)], device)).collect()
    }

    fn micro_batch(&self, pairs: &Pairs<'_>, drawn: &[Drawn], device: &Device) -> Tensor<4> {
        let inner = device.clone().inner();
        let sides = [Side::Hole, Side::Peg];
        let rows = sides.into_iter().flat_map(|side| drawn.iter().map(move |drawn| (drawn, side)));
        let picks: Vec<i32> = rows.clone().map(|(d, side)| 2 * d.index as i32 + i32::from(side == Side::Peg)).collect();
        let parameters: Vec<f32> = rows.flat_map(|(drawn, side)| self.parameters(pairs, drawn, side)).collect();
        let n = picks.len();
        let picks = Tensor::<1, Int>::from_data(TensorData::new(picks, [n]), &inner);
        let parameters = Tensor::<2>::from_data(TensorData::new(parameters, [n, N_PARAMETERS]), &inner);
        let [width, height] = self.sizes.input;
        let mut images = Tensor::<4>::empty([n, height, width, 3], &inner);
        let mut first = 0;
        for buffer in &self.buffers {
            let n_frames = buffer.dims()[0];
            images = Tensor::from_dispatch(<Dispatch as FrameOps>::augment(
                buffer.clone().into_dispatch(),
                picks.clone().into_dispatch(),
                parameters.clone().into_dispatch(),
                images.into_dispatch(),
                Among { first: first as i32, sizes: self.sizes },
            ));
            first += n_frames;
        }
        Tensor::from_inner(images).permute([0, 3, 1, 2])
    }

    /// How a picture is changed, in the kernel's order.
    fn parameters(&self, pairs: &Pairs<'_>, drawn: &Drawn, side: Side) -> [f32; N_PARAMETERS] {
        let Change { augmentation, fields } = &drawn.change;
        let mut all = [0.0; N_PARAMETERS];
        for (axis, flip) in [augmentation.flip_x, augmentation.flip_y].into_iter().enumerate() {
            let [start, span] = augmentation.crop(axis, self.sizes.wide[axis]);
            let step = span / (2 * self.sizes.input[axis]) as f32;
            all[3 * axis..][..3].copy_from_slice(&[start, step, f32::from(flip)]);
        }
        let relighting = pairs.relighting.as_ref();
        let light = relighting.and_then(|r| r.of_flips(augmentation.flip_x, augmentation.flip_y)).unwrap_or(&AS_IT_IS);
        all[6..18].copy_from_slice(light.as_flattened());
        if let Some(fields) = fields {
            all[18..].copy_from_slice(fields[usize::from(side == Side::Peg)].as_flattened());
        }
        all
    }
}

/// Two values to a word, as whole numbers of 16 bits.
fn pack(planes: &[f32]) -> Vec<i32> {
    let whole = |value: f32| (value * STEPS_A_UNIT).round() as i16;
    let words = planes.chunks(2).map(|two| {
        let [low, high] = [0, 1].map(|i| two.get(i).copied().map_or(0, whole));
        i32::from(high) << 16 | i32::from(low) & 0xffff
    });
    words.collect()
}

/// Which of the card's pictures a buffer has.
#[derive(Clone, Copy, Debug)]
pub struct Among {
    first: i32,
    sizes: Sizes,
}

/// What is done to pictures on a card.
#[backend_extension(Cube)]
pub trait FrameOps: Backend {
    /// Pictures `[n, words]`, which of all each row takes `[n]`, how each is changed, and the images `[n, height, width, 3]` that
    /// take those of this buffer.
    fn augment(
        frames: IntTensor<Self>,
        picks: IntTensor<Self>,
        parameters: FloatTensor<Self>,
        images: FloatTensor<Self>,
        among: Among,
    ) -> FloatTensor<Self>;
}

impl FrameOps for CubeBackend {
    fn augment(
        frames: CubeTensor,
        picks: CubeTensor,
        parameters: CubeTensor,
        images: CubeTensor,
        among: Among,
    ) -> CubeTensor {
        let [frames, picks, parameters, images] = [frames, picks, parameters, images].map(into_contiguous);
        let (count, cube) = threads(&images, images.meta.num_elements() / 3);
        kernels::augment::launch(
            &images.client,
            count,
            cube,
            frames.into_buffer_arg(),
            picks.into_buffer_arg(),
            parameters.into_buffer_arg(),
            images.clone().into_buffer_arg(),
            among.first,
            among.sizes,
        );
        images
    }
}

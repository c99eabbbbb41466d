//! LAMB on a graphics card, in two launches a tensor instead of some twenty: burn's formula and burn's state, so that a run
//! goes on wherever it began.

mod kernels;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::optim::{Lamb, LambState, LearningRate, Optimizer};
use burn::tensor::{Device, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::cubecl::prelude::{CubeCount, CubeDim};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;
use tactile_infer::embedding::card::{like, one_a_value};

use kernels::{MAX_CUBES, THREADS};

/// LAMB's numbers at a step of a tensor.
#[derive(Clone, Copy, Debug)]
pub struct Numbers {
    rate: f64,
    /// Steps of this tensor, this one included.
    time: usize,
    weight_decay: f32,
}

const BETAS: [f32; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-6;

/// LAMB (You et al. 2020) in kernels of our own.
#[derive(Clone, Debug)]
pub struct CardLamb {
    /// Decoupled weight decay, before the trust ratio.
    pub weight_decay: f32,
}

/// What is done to whole tensors at once.
#[backend_extension(Cube)]
pub trait WeightOps: Backend {
    /// Weights, gradient and both moments -> the new weights and moments, all of one shape.
    fn lamb(
        weights: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        first: FloatTensor<Self>,
        second: FloatTensor<Self>,
        numbers: Numbers,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);

    /// `sums` with the sum of the squares of all values as number `at`.
    fn squares(values: FloatTensor<Self>, sums: FloatTensor<Self>, at: usize) -> FloatTensor<Self>;

    /// `slow (1 - share) + fast share`.
    fn follow(slow: FloatTensor<Self>, fast: FloatTensor<Self>, share: f64) -> FloatTensor<Self>;
}

/// A moving average on a card: `slow (1 - share) + fast share`.
pub fn follow<const D: usize>(slow: Tensor<D>, fast: Tensor<D>, share: f64) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as WeightOps>::follow(slow.into_dispatch(), fast.into_dispatch(), share))
}

/// The sums of squares of tensors on a card, `[n]`.
#[derive(Debug, Default)]
pub struct SquareSums {
    /// The last one has places left.
    blocks: Vec<Tensor<1>>,
    n: usize,
}

impl SquareSums {
    /// Tensors of a block.
    const BLOCK: usize = 64;

    /// Adds the sum of a tensor's squares.
    pub fn add<const D: usize>(&mut self, values: Tensor<D>) {
        let at = self.n % Self::BLOCK;
        let last = if at == 0 { None } else { self.blocks.pop() };
        let sums = last.unwrap_or_else(|| Tensor::zeros([Self::BLOCK], &values.device()));
        let (values, sums) = (values.into_dispatch(), sums.into_dispatch());
        self.blocks.push(Tensor::from_dispatch(<Dispatch as WeightOps>::squares(values, sums, at)));
        self.n += 1;
    }

    /// The length of all together, `[1]`; `None` of no tensor.
    pub fn length(self) -> Option<Tensor<1>> {
        (!self.blocks.is_empty()).then(|| Tensor::cat(self.blocks, 0).sum().sqrt())
    }
}

impl Optimizer for CardLamb {
    type State<const D: usize> = LambState<D>;

    fn step<const D: usize>(
        &self,
        rate: LearningRate,
        weights: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<LambState<D>>,
    ) -> (Tensor<D>, Option<LambState<D>>) {
        let zeros = || weights.zeros_like();
        let LambState { time, moment_1, moment_2 } =
            state.unwrap_or_else(|| LambState { time: 0, moment_1: zeros(), moment_2: zeros() });
        let numbers = Numbers { rate, time: time + 1, weight_decay: self.weight_decay };
        let [weights, gradient, moment_1, moment_2] =
            [weights, gradient, moment_1, moment_2].map(Tensor::into_dispatch);
        let (weights, moment_1, moment_2) =
            <Dispatch as WeightOps>::lamb(weights, gradient, moment_1, moment_2, numbers);
        let [weights, moment_1, moment_2] = [weights, moment_1, moment_2].map(Tensor::from_dispatch);
        (weights, Some(LambState { time: time + 1, moment_1, moment_2 }))
    }

    fn to_device<const D: usize>(state: LambState<D>, device: &Device) -> LambState<D> {
        <Lamb as Optimizer>::to_device(state, device)
    }
}

impl WeightOps for CubeBackend {
    fn lamb(
        weights: CubeTensor,
        gradient: CubeTensor,
        first: CubeTensor,
        second: CubeTensor,
        numbers: Numbers,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let Numbers { rate, time, weight_decay } = numbers;
        let [weights, gradient, first, second] = [weights, gradient, first, second].map(into_contiguous);
        let client = weights.client.clone();
        let n_cubes = weights.meta.num_elements().div_ceil(THREADS as usize).min(MAX_CUBES);
        let (count, cube) = (CubeCount::Static(n_cubes as u32, 1, 1), CubeDim::new_1d(THREADS));
        let [new_first, new_second, update, out] = [(); 4].map(|()| like(&weights, weights.meta.shape()));
        let squares = like(&weights, &[n_cubes, 2]);
        let time = i32::try_from(time).unwrap_or(i32::MAX);
        let [unbias_1, unbias_2] = BETAS.map(|beta| 1.0 - beta.powi(time));
        kernels::update::launch(
            &client,
            count.clone(),
            cube,
            weights.clone().into_buffer_arg(),
            gradient.into_buffer_arg(),
            first.into_buffer_arg(),
            second.into_buffer_arg(),
            new_first.clone().into_buffer_arg(),
            new_second.clone().into_buffer_arg(),
            update.clone().into_buffer_arg(),
            squares.clone().into_buffer_arg(),
            BETAS[0],
            BETAS[1],
            unbias_1,
            unbias_2,
            EPSILON,
            weight_decay,
        );
        kernels::apply::launch(
            &client,
            count,
            cube,
            weights.into_buffer_arg(),
            update.into_buffer_arg(),
            squares.into_buffer_arg(),
            out.clone().into_buffer_arg(),
            rate as f32,
        );
        (out, new_first, new_second)
    }

    fn squares(values: CubeTensor, sums: CubeTensor, at: usize) -> CubeTensor {
        let values = into_contiguous(values);
        let (count, cube) = (CubeCount::Static(1, 1, 1), CubeDim::new_1d(THREADS));
        let (from, to) = (values.clone().into_buffer_arg(), sums.clone().into_buffer_arg());
        kernels::squares::launch(&values.client, count, cube, from, to, at);
        sums
    }

    fn follow(slow: CubeTensor, fast: CubeTensor, share: f64) -> CubeTensor {
        let [slow, fast] = [slow, fast].map(into_contiguous);
        let out = like(&slow, slow.meta.shape());
        let (count, cube) = one_a_value(&out);
        kernels::follow::launch(
            &out.client,
            count,
            cube,
            slow.into_buffer_arg(),
            fast.into_buffer_arg(),
            out.clone().into_buffer_arg(),
            share as f32,
        );
        out
    }
}

//! A layer in training on a graphics card: convolutions as products of matrices, and everything around them in kernels
//! of our own ([`kernels`]), because burn's own convolution of f32 is a plain loop on most cards and each of its normalisations
//! takes some twenty launches.

mod kernels;
mod product;

use burn_cubecl::cubecl::prelude::{CubeCount, CubeDim};
use burn_cubecl::ops::{permute, reshape};
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{CubeBackend, kernel::into_contiguous};

use super::op::{Differentiable, Gradients, Layer, Normalised, Trained};
use crate::embedding::card::{like, one_a_value, threads};
use kernels::{Geometry, LANES, ROWS};
use product::product;

/// Most blocks of rows that a sum is made of.
const MAX_BLOCKS: usize = 128;

/// Fewest rows of a block: four for each thread.
const MIN_ROWS: usize = 4 * ROWS as usize;

/// What the gradient needs of the forward pass.
#[derive(Clone, Debug)]
pub struct Kept {
    layer: Layer,
    geometry: Geometry,
    images: CubeTensor,
    /// The windows as rows, `[m, row]`.
    rows: CubeTensor,
    weights: CubeTensor,
    /// `[m, n_out]`: the convolution's output, before the normalisation.
    before: CubeTensor,
    out: CubeTensor,
    /// `[4, n_out]`: mean, 1 / deviation, factor and summand of each channel.
    numbers: CubeTensor,
}

impl Differentiable for CubeBackend {
    type Kept = Kept;

    fn forward(trained: Trained<Self>, layer: Layer) -> (Normalised<Self>, Kept) {
        let Trained { images, weights, gamma, beta, running_mean, running_variance } = trained;
        let images = into_contiguous(images);
        let [gamma, beta, running_mean, running_variance] =
            [gamma, beta, running_mean, running_variance].map(into_contiguous);
        let geometry = geometry(&images, &weights, layer);
        let weights = into_contiguous(weights);
        let n = gamma.meta.num_elements();
        let matrix = if is_linear(&weights) { weights.clone() } else { matrix(&weights, n, geometry, false) };
        let rows = rows(&images, geometry);
        let [m, k] = [rows.meta.shape()[0], rows.meta.shape()[1]];

        let before = product(&rows, false, &matrix, [m, k, n]);
        let sums = sums(&before);
        let (count, cube) = channels_in_cubes(n, m.div_ceil(rows_a_block(m)));
        kernels::moments::launch(
            &before.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            sums.clone().into_buffer_arg(),
            rows_a_block(m) as u32,
            n,
        );
        let (count, cube) = channels_in_cubes(n, 1);
        let (numbers, new_mean, new_variance) = (like(&before, &[4, n]), like(&before, &[n]), like(&before, &[n]));
        kernels::norm::launch(
            &before.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            sums.into_buffer_arg(),
            gamma.into_buffer_arg(),
            beta.into_buffer_arg(),
            running_mean.into_buffer_arg(),
            running_variance.into_buffer_arg(),
            numbers.clone().into_buffer_arg(),
            new_mean.clone().into_buffer_arg(),
            new_variance.clone().into_buffer_arg(),
            layer.epsilon as f32,
            layer.momentum as f32,
            n,
        );
        let out_shape = [images.meta.shape()[0], geometry.out_height, geometry.out_width, n];
        let out = like(&before, &out_shape);
        let (count, cube) = one_a_value(&out);
        let skip = if layer.adds_input { images.clone() } else { before.clone() };
        kernels::apply::launch(
            &out.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            skip.into_buffer_arg(),
            numbers.clone().into_buffer_arg(),
            out.clone().into_buffer_arg(),
            n,
            layer.adds_input,
            layer.rectifies,
        );
        let normalised = Normalised { out: out.clone(), running_mean: new_mean, running_variance: new_variance };
        (normalised, Kept { layer, geometry, images, rows, weights, before, out, numbers })
    }

    fn gradients(kept: Kept, out_gradient: CubeTensor, images_too: bool) -> Gradients<Self> {
        let Kept { layer, geometry: g, images, rows, weights, before, out, numbers } = kept;
        let out_gradient = into_contiguous(out_gradient);
        let [m, k] = [rows.meta.shape()[0], rows.meta.shape()[1]];
        let n = before.meta.shape()[1];

        let sums = sums(&before);
        let (count, cube) = channels_in_cubes(n, m.div_ceil(rows_a_block(m)));
        kernels::gradient_moments::launch(
            &before.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            out.clone().into_buffer_arg(),
            out_gradient.clone().into_buffer_arg(),
            numbers.clone().into_buffer_arg(),
            sums.clone().into_buffer_arg(),
            rows_a_block(m) as u32,
            n,
            layer.rectifies,
        );
        let (gamma, beta, back) = (like(&before, &[n]), like(&before, &[n]), like(&before, &[2, n]));
        let (count, cube) = channels_in_cubes(n, 1);
        kernels::gradient_numbers::launch(
            &before.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            sums.into_buffer_arg(),
            numbers.clone().into_buffer_arg(),
            gamma.clone().into_buffer_arg(),
            beta.clone().into_buffer_arg(),
            back.clone().into_buffer_arg(),
            n,
        );
        let gradient = like(&before, &[m, n]);
        let (count, cube) = one_a_value(&gradient);
        kernels::norm_gradient::launch(
            &before.client,
            count,
            cube,
            before.clone().into_buffer_arg(),
            out.clone().into_buffer_arg(),
            out_gradient.clone().into_buffer_arg(),
            numbers.into_buffer_arg(),
            back.into_buffer_arg(),
            gradient.clone().into_buffer_arg(),
            n,
            layer.rectifies,
        );

        let of_matrix = product(&rows, true, &gradient, [k, m, n]);
        let of_weights = if is_linear(&weights) { of_matrix } else { as_weights(&of_matrix, &weights, n, g) };
        let images = images_too.then(|| {
            let turned = match is_linear(&weights) {
                true => into_contiguous(permute(weights, &[1, 0])),
                false => matrix(&weights, n, g, true),
            };
            let rows = product(&gradient, false, &turned, [m, n, k]);
            if is_pointwise(g) && !layer.adds_input {
                return reshape(rows, images.meta.shape().clone());
            }
            let of_images = like(&images, images.meta.shape());
            let (count, cube) = one_a_value(&of_images);
            kernels::windows_gradient::launch(
                &of_images.client,
                count,
                cube,
                rows.into_buffer_arg(),
                out.into_buffer_arg(),
                out_gradient.into_buffer_arg(),
                of_images.clone().into_buffer_arg(),
                g,
                layer.adds_input,
            );
            of_images
        });
        Gradients { images, weights: of_weights, gamma, beta }
    }
}

/// Whether these are the weights of a linear layer, `[n_in, n_out]`.
fn is_linear(weights: &CubeTensor) -> bool {
    weights.meta.num_dims() == 2
}

/// The geometry of a layer over `[n, height, width, channels]`.
fn geometry(images: &CubeTensor, weights: &CubeTensor, layer: Layer) -> Geometry {
    let (shape, of_weights) = (images.meta.shape(), weights.meta.shape());
    let kernel = of_weights.get(2).copied().unwrap_or(1);
    Geometry {
        height: shape[1],
        width: shape[2],
        out_height: shape[1].div_ceil(layer.stride),
        out_width: shape[2].div_ceil(layer.stride),
        channels: shape[3],
        kernel,
        stride: layer.stride,
        pad: kernel / 2,
        row: (kernel * kernel * shape[3]).next_multiple_of(if kernel == 1 { 1 } else { 4 }),
    }
}

fn is_pointwise(g: Geometry) -> bool {
    g.kernel == 1 && g.stride == 1 && g.row == g.channels
}

/// `[n_out, n_in, kernel, kernel]` as a matrix `[row, n_out]`, or `turned`, `[n_out, row]`.
fn matrix(weights: &CubeTensor, n: usize, g: Geometry, turned: bool) -> CubeTensor {
    let matrix = like(weights, &if turned { [n, g.row] } else { [g.row, n] });
    let (count, cube) = one_a_value(&matrix);
    let (from, to) = (weights.clone().into_buffer_arg(), matrix.clone().into_buffer_arg());
    kernels::matrix::launch(&matrix.client, count, cube, from, to, n, g, turned);
    matrix
}

/// A matrix `[row, n_out]` as weights of the shape of others.
fn as_weights(matrix: &CubeTensor, others: &CubeTensor, n: usize, g: Geometry) -> CubeTensor {
    let weights = like(matrix, others.meta.shape());
    let (count, cube) = one_a_value(&weights);
    let (from, to) = (matrix.clone().into_buffer_arg(), weights.clone().into_buffer_arg());
    kernels::weights::launch(&weights.client, count, cube, from, to, n, g);
    weights
}

/// The windows of the images as rows, `[m, row]`.
fn rows(images: &CubeTensor, g: Geometry) -> CubeTensor {
    let shape = [images.meta.shape()[0] * g.out_height * g.out_width, g.row];
    if is_pointwise(g) {
        return reshape(images.clone(), shape.into());
    }
    let rows = like(images, &shape);
    let (from, to) = (images.clone().into_buffer_arg(), rows.clone().into_buffer_arg());
    if g.channels.is_multiple_of(4) {
        let n = rows.meta.num_elements() / 4;
        let (count, cube) = threads(&rows, n);
        kernels::windows_by_fours::launch(&rows.client, count, cube, from, to, n, g);
    } else {
        let (count, cube) = one_a_value(&rows);
        kernels::windows::launch(&rows.client, count, cube, from, to, g);
    }
    rows
}

/// Room for the sums of blocks: `[blocks, 2, n]` of `[m, n]` values.
fn sums(values: &CubeTensor) -> CubeTensor {
    let [m, n] = [values.meta.shape()[0], values.meta.shape()[1]];
    like(values, &[m.div_ceil(rows_a_block(m)), 2, n])
}

fn rows_a_block(n_rows: usize) -> usize {
    n_rows.div_ceil(MAX_BLOCKS).max(MIN_ROWS)
}

/// A thread for each channel, in cubes of `LANES` by `ROWS`; as many rows of cubes as there are blocks.
fn channels_in_cubes(n_channels: usize, n_blocks: usize) -> (CubeCount, CubeDim) {
    let columns = (n_channels as u32).div_ceil(LANES);
    (CubeCount::Static(columns, n_blocks as u32, 1), CubeDim::new_2d(LANES, ROWS))
}

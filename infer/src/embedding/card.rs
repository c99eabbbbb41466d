//! What kernels of our own need of a graphics card: room for their values, and threads.

use burn_cubecl::cubecl::calculate_cube_count_elemwise;
use burn_cubecl::cubecl::prelude::{CubeCount, CubeDim};
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;

/// Room for values of a shape, without gaps, next to another tensor's.
pub fn like(tensor: &CubeTensor, shape: &[usize]) -> CubeTensor {
    empty_device_contiguous_dtype(tensor.client.clone(), tensor.device.clone(), shape.to_vec().into(), tensor.dtype)
}

/// So many threads, on a tensor's card.
pub fn threads(tensor: &CubeTensor, n: usize) -> (CubeCount, CubeDim) {
    let cube = CubeDim::new(&tensor.client, n);
    (calculate_cube_count_elemwise(&tensor.client, n, cube), cube)
}

/// A thread for each value of a tensor.
pub fn one_a_value(tensor: &CubeTensor) -> (CubeCount, CubeDim) {
    threads(tensor, tensor.meta.num_elements())
}

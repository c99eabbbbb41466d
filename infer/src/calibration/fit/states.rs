//! Embeddings of one part at all the states that the filter weighs: the recorded poses, and half way between them.

use tactile_data::pose::grid::PoseGrid;

use crate::bank::between::Around;
use crate::bank::similarity::dot;

/// States between two recorded poses on each axis, with one of them: the filter's `subdivisions`.
pub(super) const TIMES: usize = 2;

/// Views that have nothing in common could interpolate to nothing at all: the filter's shortest length.
const SHORTEST: f32 = 0.3;

/// The embeddings of a part at the states of `grid`, of unit length: `[grid.subdivided(2, 2).len(), dim]`. `rows`: at its recorded
/// poses, `[grid.len(), dim]`, of unit length.
pub(super) fn states(grid: &PoseGrid, rows: &[f32], dim: usize) -> Vec<f32> {
    let mut shape = [grid.n_xy(), grid.n_xy(), grid.n_theta()];
    let mut values = rows.to_vec();
    for axis in 0..3 {
        (values, shape) = denser(&values, shape, axis, dim, axis == 2 && grid.goes_round());
    }
    for row in values.chunks_exact_mut(dim) {
        let length = dot(row, row).sqrt().max(SHORTEST);
        row.iter_mut().for_each(|value| *value /= length);
    }
    values
}

/// Values at twice as many places along an axis.
fn denser(values: &[f32], shape: [usize; 3], axis: usize, dim: usize, goes_round: bool) -> (Vec<f32>, [usize; 3]) {
    let n = shape[axis];
    let n_dense = if goes_round { TIMES * n } else { TIMES * (n - 1) + 1 };
    let places: Vec<Around> = (0..n_dense).map(|at| Around::part_way(at, TIMES, n, goes_round)).collect();
    let stride = shape[axis + 1..].iter().product::<usize>() * dim;
    let mut dense = Vec::with_capacity(values.len() / n * n_dense);
    for block in values.chunks_exact(n * stride) {
        for Around { indices, weights, .. } in &places {
            let first = dense.len();
            dense.resize(first + stride, 0.0);
            for (index, weight) in indices.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                let from = &block[index * stride..(index + 1) * stride];
                dense[first..].iter_mut().zip(from).for_each(|(dense, value)| *dense += weight * value);
            }
        }
    }
    let mut dense_shape = shape;
    dense_shape[axis] = n_dense;
    (dense, dense_shape)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::Bank;
    use crate::bank::rows::Rows;
    use tactile_data::pose::se2::Se2;

    /// As the bank interpolates one pose after the other.
    #[test]
    fn states_are_the_banks_views_at_their_poses() {
        for theta_half_deg in [30.0, 180.0] {
            let grid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 1.0, theta_half_deg, theta_step_deg: 15.0 };
            const DIM: usize = 16;
            let value = |cell: usize, axis: usize| {
                let Se2 { x_mm, y_mm, theta_rad } = grid.pose(cell);
                (0.3 * x_mm + 0.2 * axis as f64).sin() + (0.4 * y_mm + theta_rad).cos() * (1.0 + axis as f64).recip()
            };
            let mut rows: Vec<f32> =
                (0..grid.len()).flat_map(|cell| (0..DIM).map(move |axis| value(cell, axis) as f32)).collect();
            for row in rows.chunks_exact_mut(DIM) {
                let length = dot(row, row).sqrt();
                row.iter_mut().for_each(|value| *value /= length);
            }
            let found = states(&grid, &rows, DIM);
            let dense = grid.subdivided(TIMES, TIMES);
            assert_eq!(found.len(), dense.len() * DIM);
            let kept = Rows::new(DIM, rows).unwrap();
            let bank = Bank::from_rows(vec!["a".into()], grid, kept, vec![0.3; grid.len()], "").unwrap();
            let query: Vec<f32> = found[7 * DIM..8 * DIM].to_vec();
            for (state, embedding) in found.chunks_exact(DIM).enumerate() {
                let expected = bank.cosine_at(&query, 0, &dense.pose(state)).unwrap();
                assert!((dot(embedding, &query) - expected).abs() < 1e-5, "{state}");
            }
        }
    }
}

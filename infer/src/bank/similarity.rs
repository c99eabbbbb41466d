//! Inner products of embeddings, and rows of unit length.

use multiversion::multiversion;

/// The inner product of two vectors of one length, summed in sixteen lanes so that it vectorises.
#[multiversion(targets("x86_64+avx2"))]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    in_lanes(a, b)
}

/// The inner product of one vector with each of `rows`, `[n, dim]`, appended to `out`: to the bit as [`dot`].
#[multiversion(targets("x86_64+avx2"))]
pub(crate) fn dots(query: &[f32], rows: &[f32], dim: usize, out: &mut Vec<f32>) {
    out.extend(rows.chunks_exact(dim).map(|row| in_lanes(query, row)));
}

/// The inner product of one vector with some rows of `rows`, given by their places: to the bit as [`dot`].
#[multiversion(targets("x86_64+avx2"))]
pub(crate) fn dots_at(query: &[f32], rows: &[f32], places: &[usize]) -> Vec<f32> {
    let dim = query.len();
    let mut dots = vec![0.0; places.len()];
    for (dot, at) in dots.iter_mut().zip(places) {
        *dot = in_lanes(query, &rows[at * dim..(at + 1) * dim]);
    }
    dots
}

#[inline(always)]
pub(crate) fn in_lanes(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0_f32; 16];
    let (a_chunks, b_chunks) = (a.chunks_exact(16), b.chunks_exact(16));
    let rest: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for lane in 0..16 {
            lanes[lane] += x[lane] * y[lane];
        }
    }
    lanes.iter().sum::<f32>() + rest
}

/// Scales each row of `[n, dim]` to unit length; a row of zeros stays as it is.
pub fn normalize_rows(rows: &mut [f32], dim: usize) {
    for row in rows.chunks_exact_mut(dim) {
        let norm = dot(row, row).sqrt();
        if norm > 0.0 && norm.is_finite() {
            row.iter_mut().for_each(|value| *value /= norm);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dot_agrees_with_f64() {
        let a: Vec<f32> = (0..131).map(|i| (i as f32 * 0.37).sin()).collect();
        let b: Vec<f32> = (0..131).map(|i| (i as f32 * 0.11).cos()).collect();
        let exact: f64 = a.iter().zip(&b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum();
        // 131 products of order 1, each rounded to f32's half ulp of 6e-8.
        assert!((f64::from(dot(&a, &b)) - exact).abs() < 131.0 * 6e-8);
    }

    #[test]
    fn a_row_of_zeros_stays_finite() {
        let mut rows = [3.0, 4.0, 0.0, 0.0];
        normalize_rows(&mut rows, 2);
        assert_eq!(rows, [0.6, 0.8, 0.0, 0.0]);
    }
}

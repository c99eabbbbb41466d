//! A copy of rows in f32 that takes a quarter of their memory, and says which of them a query may be near.

use std::ops::Range;

use super::{QUERY_MAX, rounded, times_dots_whole};
use crate::similarity::dot;

/// Fewer values fit into a core's cache, from which they are read as fast as they are multiplied: 1 MB.
pub(super) const WORTH_IT: usize = 1 << 18;

/// Rows in whole numbers.
#[derive(Debug)]
pub(super) struct Coarse {
    /// In -127..=127, `[n, dim]`.
    values: Vec<i8>,
    /// What those of each row are to be multiplied by.
    scales: Vec<f32>,
    /// The similarity of a query of length one with each row is off by at most this.
    off: Vec<f32>,
}

impl Coarse {
    /// A copy of `[n, dim]`.
    pub fn of(values: &[f32], dim: usize) -> Self {
        let n = values.len() / dim;
        let mut copy =
            Self { values: vec![0; values.len()], scales: Vec::with_capacity(n), off: Vec::with_capacity(n) };
        let mut left = vec![0.0; dim];
        for (row, whole) in values.chunks_exact(dim).zip(copy.values.chunks_exact_mut(dim)) {
            let largest = row.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
            let (scale, per_value) = if largest > 0.0 { (largest / 127.0, 127.0 / largest) } else { (0.0, 0.0) };
            for ((value, whole), left) in row.iter().zip(whole).zip(&mut left) {
                *whole = (value * per_value).round_ties_even() as i8;
                *left = value - scale * f32::from(*whole);
            }
            // Of a query's rounding to whole numbers at most half of one is left at each place.
            let of_query = 0.5 * (dim as f32).sqrt() / QUERY_MAX;
            let [left, length] = [dot(&left, &left), dot(row, row)].map(f32::sqrt);
            copy.scales.push(scale);
            // Sums of f32 are rounded by less than a thousandth of either.
            copy.off.push(1.001 * (left + of_query * (length + left)));
        }
        copy
    }

    /// Appends the similarities of some rows with a query.
    pub fn similarities(&self, rows: Range<usize>, query: &Query, out: &mut Vec<f32>) {
        let (first, dim) = (out.len(), query.values.len());
        out.extend(self.scales[rows.clone()].iter().map(|of_row| query.scale * of_row));
        times_dots_whole(&query.whole, &self.values[rows.start * dim..rows.end * dim], &mut out[first..]);
    }

    /// How far the similarity of a row with a query may be off.
    pub fn off(&self, row: usize, query: &Query) -> f32 {
        self.off[row] * query.length
    }
}

/// A query as rows are compared with it.
pub(crate) struct Query<'a> {
    /// What it is.
    pub values: &'a [f32],
    pub length: f32,
    /// In whole numbers, to be multiplied by `scale`.
    whole: Vec<i16>,
    scale: f32,
}

impl<'a> Query<'a> {
    /// `[dim]`.
    pub fn of(values: &'a [f32]) -> Self {
        let (scale, whole) = rounded(values);
        Self { values, length: dot(values, values).sqrt(), whole, scale }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FAR, Rows};
    use super::*;
    use crate::similarity::normalize_rows;

    const DIM: usize = 128;

    /// Neighbours are alike, as recorded views are.
    fn rows(n: usize) -> Vec<f32> {
        let value = |i: usize| ((i % DIM) as f32 * 0.7 + (i / DIM) as f32 * 0.013 * ((i % DIM % 7) as f32)).sin();
        let mut rows: Vec<f32> = (0..n * DIM).map(value).collect();
        normalize_rows(&mut rows, DIM);
        rows
    }

    #[test]
    fn what_is_near_the_best_is_exact_and_the_rest_is_off_by_no_more_than_it_says() {
        let n = 2 * WORTH_IT / DIM;
        let values = rows(n);
        let (coarse, all) = (Coarse::of(&values, DIM), Rows::new(DIM, values.clone()).unwrap());
        for times in [1.0, 1e-3, 50.0] {
            let query: Vec<f32> =
                all.row(n / 3).iter().enumerate().map(|(i, v)| times * (v + 0.01 * (i as f32).cos())).collect();
            let length = query.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
            let mut found = Vec::new();
            all.similarities_near_best(&query, &mut found);
            let exact = |row: usize| -> f64 {
                all.row(row).iter().zip(&query).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
            };
            let exact: Vec<f64> = (0..n).map(exact).collect();
            let best = exact.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mut n_near = 0;
            for (row, (found, exact)) in found.iter().zip(&exact).enumerate() {
                let off = (f64::from(*found) - exact).abs() / length;
                let is_near = *exact >= best - f64::from(FAR) * length;
                n_near += usize::from(is_near);
                // Rounded sums of 128 f32.
                assert!(off < if is_near { 1e-6 } else { f64::from(coarse.off[row]) }, "{row}: {off}");
            }
            assert!(n_near > 100 && n_near < n - 100, "{n_near} of {n}");
            assert!(coarse.off.iter().all(|off| *off < 0.02));
        }
    }

    #[test]
    fn some_of_the_parts_are_as_all_of_them() {
        let n = 2 * WORTH_IT / DIM;
        let all = Rows::new(DIM, rows(n)).unwrap();
        let some = all.ranges(&[n / 2..n, 0..n / 4]);
        let (query, mut found, mut of_some) = (all.row(n / 8).into_owned(), Vec::new(), Vec::new());
        all.similarities(&query, &mut found);
        some.similarities_near_best(&query, &mut of_some);
        assert_eq!(of_some.len(), some.len());
        assert_eq!(of_some[n / 2 + n / 8], found[n / 8]);
        let away = of_some.iter().zip(found[n / 2..].iter().chain(&found[..n / 4])).map(|(a, b)| (a - b).abs());
        assert!(away.fold(0.0, f32::max) < 0.02);
    }

    #[test]
    fn a_query_that_is_no_number_is_compared_as_it_is() {
        let all = Rows::new(DIM, rows(2 * WORTH_IT / DIM)).unwrap();
        let (mut query, mut found) = (all.row(0).into_owned(), Vec::new());
        query[3] = f32::NAN;
        all.similarities_near_best(&query, &mut found);
        assert!(found.iter().all(|similarity| similarity.is_nan()));
    }
}

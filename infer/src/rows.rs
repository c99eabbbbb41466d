//! Rows of unit length in the format they are kept in, and their cosines computed from it.

use std::borrow::Cow;
use std::ops::Range;

use half::slice::HalfFloatSliceExt;
use half::{bf16, f16};
use multiversion::multiversion;

use crate::error::{Error, Result};
use crate::precision::Precision;
use crate::similarity::{dot, dots};

/// The longest row: an embedding's largest length. Sums of whole numbers below stay in i32 for it.
pub const MAX_DIM: usize = 4_096;

/// The largest whole number of a query compared with rows of i8: `4095 * 127 * MAX_DIM < 2^31`, and its own rounding is
/// 32 times finer than the rows'.
const QUERY_MAX: f32 = 4_095.0;

/// Values of half precision widened at a time, on the stack.
const CHUNK: usize = 128;

/// A matrix `[n, dim]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    dim: usize,
    values: Values,
}

#[derive(Clone, Debug, PartialEq)]
enum Values {
    F32(Vec<f32>),
    F16(Vec<f16>),
    Bf16(Vec<bf16>),
    /// Whole numbers in -127..=127; times its row's scale each is the value.
    I8 {
        values: Vec<i8>,
        scales: Vec<f32>,
    },
}

impl Rows {
    /// Rows of `dim` values each, last axis fastest, in f32.
    ///
    /// # Errors
    /// A `dim` of zero or above [`MAX_DIM`], a number of values that makes no whole rows, and values that are not
    /// finite.
    pub fn new(dim: usize, values: Vec<f32>) -> Result<Self> {
        if dim == 0 || dim > MAX_DIM || !values.len().is_multiple_of(dim) {
            let expected = format!("whole rows of 1..={MAX_DIM} values");
            return Err(Error::invalid("bank", expected, format!("{} values in rows of {dim}", values.len())));
        }
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::invalid(format!("bank row {}", at / dim), "finite values", "NaN or infinity"));
        }
        Ok(Self { dim, values: Values::F32(values) })
    }

    /// Rows of whole numbers in -127..=127, each row with the scale that makes them values.
    ///
    /// # Errors
    /// As [`Self::new`], and for numbers that are not whole or too large, and scales that are negative, not finite or
    /// not one a row.
    pub fn scaled(dim: usize, whole: &[f32], scales: Vec<f32>) -> Result<Self> {
        let Rows { dim, .. } = Self::new(dim, whole.to_vec())?;
        if let Some(at) = whole.iter().position(|v| v.fract() != 0.0 || v.abs() > 127.0) {
            let got = whole[at].to_string();
            return Err(Error::invalid(format!("bank row {}", at / dim), "whole numbers in -127..=127", got));
        }
        // The largest value is then finite too.
        let is_scale = |scale: &f32| (0.0..=f32::MAX / 127.0).contains(scale);
        if scales.len() != whole.len() / dim || !scales.iter().all(is_scale) {
            let expected = format!("{} finite scales of zero or more", whole.len() / dim);
            return Err(Error::invalid("bank scales", expected, format!("{} scales", scales.len())));
        }
        Ok(Self { dim, values: Values::I8 { values: whole.iter().map(|v| *v as i8).collect(), scales } })
    }

    /// The same rows in another format, rounded once.
    ///
    /// # Errors
    /// A value beyond the format's range.
    pub fn to_precision(&self, precision: Precision) -> Result<Self> {
        if precision == self.precision() {
            return Ok(self.clone());
        }
        let mut all = self.to_f32();
        let values = match precision {
            Precision::I8 => {
                let (mut values, mut scales) = (Vec::with_capacity(all.len()), Vec::new());
                for row in all.chunks_exact(self.dim) {
                    let scale = row.iter().fold(0.0, |max: f32, value| max.max(value.abs())) / 127.0;
                    let whole = |value: &f32| if scale > 0.0 { (value / scale).round() as i8 } else { 0 };
                    values.extend(row.iter().map(whole));
                    scales.push(scale);
                }
                Values::I8 { values, scales }
            }
            _ => {
                precision.round_all("bank rows", &mut all)?;
                match precision {
                    Precision::F16 => Values::F16(all.iter().map(|value| f16::from_f32(*value)).collect()),
                    Precision::Bf16 => Values::Bf16(all.iter().map(|value| bf16::from_f32(*value)).collect()),
                    _ => Values::F32(all),
                }
            }
        };
        Ok(Self { dim: self.dim, values })
    }

    /// The format that the rows are kept in.
    pub fn precision(&self) -> Precision {
        match self.values {
            Values::F32(_) => Precision::F32,
            Values::F16(_) => Precision::F16,
            Values::Bf16(_) => Precision::Bf16,
            Values::I8 { .. } => Precision::I8,
        }
    }

    /// Length of a row.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.n_values() / self.dim
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.n_values() == 0
    }

    fn n_values(&self) -> usize {
        match &self.values {
            Values::F32(values) => values.len(),
            Values::F16(values) => values.len(),
            Values::Bf16(values) => values.len(),
            Values::I8 { values, .. } => values.len(),
        }
    }

    /// Memory that the rows take, bytes.
    pub fn n_bytes(&self) -> usize {
        self.len() * self.precision().n_bytes_of_row(self.dim())
    }

    /// All values, `[n, dim]`, in f32.
    pub fn to_f32(&self) -> Vec<f32> {
        (0..self.len()).flat_map(|row| self.row(row).into_owned()).collect()
    }

    /// One row, `[dim]`, in f32: borrowed where it is kept so.
    ///
    /// # Panics
    /// Where `row` is not below [`Self::len`].
    pub fn row(&self, row: usize) -> Cow<'_, [f32]> {
        let at = row * self.dim..(row + 1) * self.dim;
        match &self.values {
            Values::F32(values) => Cow::Borrowed(&values[at]),
            Values::F16(values) => Cow::Owned(values[at].to_f32_vec()),
            Values::Bf16(values) => Cow::Owned(values[at].to_f32_vec()),
            Values::I8 { values, scales } => {
                Cow::Owned(values[at].iter().map(|value| scales[row] * f32::from(*value)).collect())
            }
        }
    }

    /// The inner product of one query with each row. `query`: `[dim]`; `out` is cleared and filled with `[n]` values.
    ///
    /// Rows of half precision are widened to f32, exactly. For rows of i8 the query is rounded to whole numbers of
    /// 12 bits and a sign, and the products are summed as integers.
    pub fn similarities(&self, query: &[f32], out: &mut Vec<f32>) {
        out.clear();
        match &self.values {
            Values::F32(values) => dots(query, values, self.dim, out),
            Values::F16(values) => out.extend(values.chunks_exact(self.dim).map(|row| dot_half(query, row))),
            Values::Bf16(values) => out.extend(values.chunks_exact(self.dim).map(|row| dot_half(query, row))),
            Values::I8 { values, scales } => {
                let scale = query.iter().fold(0.0, |max: f32, value| max.max(value.abs())) / QUERY_MAX;
                let whole = |value: &f32| if scale > 0.0 { (value / scale).round() as i16 } else { 0 };
                let whole: Vec<i16> = query.iter().map(whole).collect();
                out.extend(scales.iter().map(|of_row| scale * of_row));
                times_dots_whole(&whole, values, out);
            }
        }
    }

    /// The inner product of two rows.
    ///
    /// # Panics
    /// Where a row is not below [`Self::len`].
    pub fn cosine(&self, row_a: usize, row_b: usize) -> f32 {
        let at = |row: usize| row * self.dim..(row + 1) * self.dim;
        let (a, b) = (at(row_a), at(row_b));
        match &self.values {
            Values::F32(values) => dot(&values[a], &values[b]),
            Values::F16(values) => dot_halves(&values[a], &values[b]),
            Values::Bf16(values) => dot_halves(&values[a], &values[b]),
            Values::I8 { values, scales } => {
                let products = values[a].iter().zip(&values[b]).map(|(x, y)| i32::from(i16::from(*x) * i16::from(*y)));
                products.sum::<i32>() as f32 * (scales[row_a] * scales[row_b])
            }
        }
    }

    /// The rows of some ranges, one after the other.
    ///
    /// # Panics
    /// Where a range ends above [`Self::len`].
    pub fn ranges(&self, ranges: &[Range<usize>]) -> Self {
        fn of<T: Clone>(values: &[T], ranges: &[Range<usize>], n: usize) -> Vec<T> {
            ranges.iter().flat_map(|range| values[range.start * n..range.end * n].iter().cloned()).collect()
        }
        let values = match &self.values {
            Values::F32(values) => Values::F32(of(values, ranges, self.dim)),
            Values::F16(values) => Values::F16(of(values, ranges, self.dim)),
            Values::Bf16(values) => Values::Bf16(of(values, ranges, self.dim)),
            Values::I8 { values, scales } => {
                Values::I8 { values: of(values, ranges, self.dim), scales: of(scales, ranges, 1) }
            }
        };
        Self { dim: self.dim, values }
    }

    /// What a file holds: the values, and for i8 the scales.
    pub(crate) fn parts(&self) -> (Vec<f32>, Option<Vec<f32>>) {
        match &self.values {
            Values::I8 { values, scales } => {
                (values.iter().map(|value| f32::from(*value)).collect(), Some(scales.clone()))
            }
            _ => (self.to_f32(), None),
        }
    }
}

/// The inner product of f32 and half precision, in chunks; the shorter length counts.
fn dot_half<T>(query: &[f32], row: &[T]) -> f32
where
    [T]: HalfFloatSliceExt,
{
    let mut wide = [0.0_f32; CHUNK];
    let chunks = query.chunks(CHUNK).zip(row.chunks(CHUNK));
    chunks
        .map(|(query, row)| {
            let wide = &mut wide[..row.len()];
            row.convert_to_f32_slice(wide);
            dot(query, wide)
        })
        .sum()
}

/// The inner product of two rows of half precision, in chunks.
fn dot_halves<T>(a: &[T], b: &[T]) -> f32
where
    [T]: HalfFloatSliceExt,
{
    let mut wide = [0.0_f32; CHUNK];
    let chunks = a.chunks(CHUNK).zip(b.chunks(CHUNK));
    chunks
        .map(|(a, b)| {
            let wide = &mut wide[..a.len()];
            a.convert_to_f32_slice(wide);
            dot_half(wide, b)
        })
        .sum()
}

/// Multiplies each value by the inner product of the query with its row of whole numbers; in i32, for rows of up to
/// [`MAX_DIM`].
#[multiversion(targets("x86_64+avx2"))]
fn times_dots_whole(query: &[i16], rows: &[i8], values: &mut [f32]) {
    for (value, row) in values.iter_mut().zip(rows.chunks_exact(query.len())) {
        let mut sum = 0_i32;
        for i in 0..row.len() {
            sum += i32::from(query[i]) * i32::from(i16::from(row[i]));
        }
        *value *= sum as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::similarity::normalize_rows;

    const DIM: usize = 131;
    const N: usize = 40;

    fn unit_rows() -> Vec<f32> {
        let mut rows: Vec<f32> = (0..N * DIM).map(|i| ((i * i % 997) as f32 * 0.37).sin()).collect();
        normalize_rows(&mut rows, DIM);
        rows
    }

    /// In f64.
    fn exact(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum()
    }

    fn kept(precision: Precision) -> Rows {
        Rows::new(DIM, unit_rows()).unwrap().to_precision(precision).unwrap()
    }

    const ALL: [Precision; 4] = [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8];

    #[test]
    fn similarities_are_those_of_the_rows_as_kept() {
        let query = &unit_rows()[..DIM];
        for precision in ALL {
            let rows = kept(precision);
            assert_eq!((rows.precision(), rows.len()), (precision, N));
            let mut found = Vec::new();
            rows.similarities(query, &mut found);
            // Rounded sums of 131 f32; for i8 the query's rounding besides: half of 1/4095 of its largest value at each
            // place, random signs, against a row of length one.
            let bound = if precision == Precision::I8 { 2e-4 } else { 1e-6 };
            for (row, found) in found.iter().enumerate() {
                assert!((exact(query, &rows.row(row)) - f64::from(*found)).abs() < bound, "{precision} {row}");
                let (cosine, direct) = (rows.cosine(row, 3), exact(&rows.row(row), &rows.row(3)));
                assert!((direct - f64::from(cosine)).abs() < 1e-6, "{precision} {row}");
            }
        }
    }

    #[test]
    fn a_narrower_format_costs_what_its_digits_say() {
        let wide = unit_rows();
        // Errors of one row of length one: relative for halves, half a step of 1/127 of the largest value at each
        // of 131 places for i8, whose values stay below 0.2 here.
        for (precision, bound) in
            [(Precision::F16, 2.0_f64.powi(-11)), (Precision::Bf16, 2.0_f64.powi(-8)), (Precision::I8, 0.01)]
        {
            let rows = kept(precision);
            for (row, wide) in wide.chunks_exact(DIM).enumerate() {
                let kept = rows.row(row);
                let squares = wide.iter().zip(&*kept).map(|(a, b)| f64::from(a - b).powi(2));
                assert!(squares.sum::<f64>().sqrt() < bound, "{precision} {row}");
            }
        }
        let bytes = ALL.map(|precision| kept(precision).n_bytes());
        assert_eq!(bytes, [4 * N * DIM, 2 * N * DIM, 2 * N * DIM, N * DIM + 4 * N]);
    }

    #[test]
    fn rows_left_out_leave_the_others() {
        for precision in ALL {
            let rows = kept(precision);
            let fewer = rows.ranges(&[0..10, 30..rows.len()]);
            assert_eq!(fewer.len(), 20);
            assert_eq!(fewer.row(9), rows.row(9));
            assert_eq!(fewer.row(10), rows.row(30));
        }
    }

    #[test]
    fn the_largest_sums_of_whole_numbers_fit() {
        let rows = Rows::scaled(MAX_DIM, &[127.0; MAX_DIM], vec![1.0]).unwrap();
        let mut out = Vec::new();
        rows.similarities(&[1.0; MAX_DIM], &mut out);
        assert!((out[0] / (127.0 * MAX_DIM as f32) - 1.0).abs() < 1e-6, "{out:?}");
        assert!(Rows::new(MAX_DIM + 1, vec![0.0; MAX_DIM + 1]).is_err());
        let blank = Rows::new(2, vec![0.0; 2]).unwrap().to_precision(Precision::I8).unwrap();
        assert_eq!((blank.row(0).into_owned(), blank.cosine(0, 0)), (vec![0.0; 2], 0.0));
    }

    #[test]
    fn odd_whole_numbers_and_scales_are_refused() {
        for (whole, scale) in [(0.5, 1.0), (128.0, 1.0), (f32::NAN, 1.0), (1.0, -1.0), (1.0, f32::NAN), (1.0, f32::MAX)]
        {
            assert!(Rows::scaled(1, &[whole], vec![scale]).is_err(), "{whole} {scale}");
        }
        assert!(Rows::scaled(1, &[1.0], vec![]).is_err());
    }
}

//! Rows of unit length in the format they are kept in, and their cosines computed from it.

use std::borrow::Cow;
use std::io::Read;
use std::ops::Range;
use std::sync::Arc;

use half::slice::HalfFloatSliceExt;
use half::{bf16, f16};
use multiversion::multiversion;

use crate::bank::similarity::{dot, dots, dots_at};
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};
use crate::safefile::pieces::read_values;

/// The longest row: an embedding's largest length. Sums of whole numbers below stay in i32 for it.
pub const MAX_DIM: usize = 4_096;

/// The largest whole number of a query compared with rows of i8: `4095 * 127 * MAX_DIM < 2^31`, and its own rounding is
/// 32 times finer than the rows'.
const QUERY_MAX: f32 = 4_095.0;

/// Values of half precision widened at a time, on the stack.
const CHUNK: usize = 128;

/// A matrix `[n, dim]`. Its values are shared by its clones and by the matrices of some of its rows ([`Self::ranges`]).
#[derive(Clone, Debug)]
pub struct Rows {
    dim: usize,
    values: Arc<Values>,
    /// Which of the stored rows this matrix has, one block after the other; none of them empty.
    blocks: Vec<Block>,
}

/// Rows that are stored together.
#[derive(Clone, Debug)]
struct Block {
    /// The first of them in the matrix.
    first: usize,
    /// Where they are stored.
    stored: Range<usize>,
}

#[derive(Debug)]
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

impl Values {
    /// Number of values.
    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F16(values) => values.len(),
            Self::Bf16(values) => values.len(),
            Self::I8 { values, .. } => values.len(),
        }
    }
}

impl PartialEq for Rows {
    /// Whether both hold the same values in the same format, however they are stored.
    fn eq(&self, other: &Self) -> bool {
        let alike = (self.dim, self.len(), self.precision()) == (other.dim, other.len(), other.precision());
        alike && (0..self.len()).all(|row| self.row(row) == other.row(row))
    }
}

impl Rows {
    /// All of some values.
    fn from_values(dim: usize, values: Values) -> Self {
        let n = values.len() / dim;
        let all = Block { first: 0, stored: 0..n };
        let blocks = if n == 0 { Vec::new() } else { vec![all] };
        Self { dim, values: Arc::new(values), blocks }
    }

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
        Self::from_values(dim, Values::F32(values)).checked()
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
        Self::from_values(dim, Values::I8 { values: whole.iter().map(|v| *v as i8).collect(), scales }).checked()
    }

    /// Refuses values that no rows have.
    pub(crate) fn checked(self) -> Result<Self> {
        let not_finite = match &*self.values {
            Values::F32(values) => values.iter().position(|value| !value.is_finite()),
            Values::F16(values) => values.iter().position(|value| !value.is_finite()),
            Values::Bf16(values) => values.iter().position(|value| !value.is_finite()),
            Values::I8 { .. } => None,
        };
        if let Some(at) = not_finite {
            return Err(Error::invalid(format!("bank row {}", at / self.dim), "finite values", "NaN or infinity"));
        }
        let Values::I8 { values, scales } = &*self.values else { return Ok(self) };
        if let Some(at) = values.iter().position(|value| *value == i8::MIN) {
            return Err(Error::invalid(format!("bank row {}", at / self.dim), "whole numbers in -127..=127", "-128"));
        }
        // The largest value is then finite too.
        let is_scale = |scale: &f32| (0.0..=f32::MAX / 127.0).contains(scale);
        if scales.len() * self.dim != values.len() || !scales.iter().all(is_scale) {
            let expected = format!("{} finite scales of zero or more", values.len() / self.dim);
            return Err(Error::invalid("bank scales", expected, format!("{} scales", scales.len())));
        }
        Ok(self)
    }

    /// Reads the rows of a file, `[n, dim]`, which are not checked yet; rows of i8 have `scales`.
    pub(crate) fn read(
        [n, dim]: [usize; 2],
        precision: Precision,
        scales: Vec<f32>,
        reader: &mut impl Read,
    ) -> std::io::Result<Self> {
        let n_values = n * dim;
        let values = match precision {
            Precision::F32 => Values::F32(read_values(reader, n_values, f32::from_le_bytes)?),
            Precision::F16 => Values::F16(read_values(reader, n_values, f16::from_le_bytes)?),
            Precision::Bf16 => Values::Bf16(read_values(reader, n_values, bf16::from_le_bytes)?),
            Precision::I8 => Values::I8 { values: read_values(reader, n_values, i8::from_le_bytes)?, scales },
        };
        Ok(Self::from_values(dim, values))
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
        Ok(Self::from_values(self.dim, values))
    }

    /// The format that the rows are kept in.
    pub fn precision(&self) -> Precision {
        match *self.values {
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
        self.blocks.last().map_or(0, |last| last.first + last.stored.len())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Where a row is stored.
    fn stored(&self, row: usize) -> usize {
        let block = &self.blocks[self.block_of(row)];
        let stored = block.stored.start + (row - block.first);
        assert!(stored < block.stored.end, "row {row} of {}", self.len());
        stored
    }

    /// The block that has a row, or the last for one that there is not.
    fn block_of(&self, row: usize) -> usize {
        self.blocks.partition_point(|block| block.first <= row).saturating_sub(1)
    }

    /// Memory that the rows take, bytes, whether it is shared or not.
    pub fn n_bytes(&self) -> usize {
        self.len() * self.precision().n_bytes_of_row(self.dim())
    }

    /// All values, `[n, dim]`, in f32.
    pub fn to_f32(&self) -> Vec<f32> {
        let mut all = Vec::with_capacity(self.len() * self.dim);
        (0..self.len()).for_each(|row| all.extend_from_slice(&self.row(row)));
        all
    }

    /// One row, `[dim]`, in f32: borrowed where it is kept so.
    ///
    /// # Panics
    /// Where `row` is not below [`Self::len`].
    pub fn row(&self, row: usize) -> Cow<'_, [f32]> {
        let stored = self.stored(row);
        let at = stored * self.dim..(stored + 1) * self.dim;
        match &*self.values {
            Values::F32(values) => Cow::Borrowed(&values[at]),
            Values::F16(values) => Cow::Owned(values[at].to_f32_vec()),
            Values::Bf16(values) => Cow::Owned(values[at].to_f32_vec()),
            Values::I8 { values, scales } => {
                Cow::Owned(values[at].iter().map(|value| scales[stored] * f32::from(*value)).collect())
            }
        }
    }

    /// The inner product of one query with each row. `query`: `[dim]`; `out` is cleared and filled with `[n]` values.
    ///
    /// Rows of half precision are widened to f32, exactly. For rows of i8 the query is rounded to whole numbers of
    /// 12 bits and a sign, and the products are summed as integers.
    pub fn similarities(&self, query: &[f32], out: &mut Vec<f32>) {
        self.similarities_in(0..self.len(), query, out);
    }

    /// [`Self::similarities`] with the rows of a range alone.
    ///
    /// # Panics
    /// Where the range ends above [`Self::len`].
    fn similarities_in(&self, range: Range<usize>, query: &[f32], out: &mut Vec<f32>) {
        out.clear();
        let dim = self.dim;
        let (scale, whole) = match &*self.values {
            Values::I8 { .. } => rounded(query),
            _ => (0.0, Vec::new()),
        };
        for Range { start, end } in self.stored_ranges(range) {
            let at = start * dim..end * dim;
            match &*self.values {
                Values::F32(values) => dots(query, &values[at], dim, out),
                Values::F16(values) => out.extend(values[at].chunks_exact(dim).map(|row| dot_half(query, row))),
                Values::Bf16(values) => out.extend(values[at].chunks_exact(dim).map(|row| dot_half(query, row))),
                Values::I8 { values, scales } => {
                    let first = out.len();
                    out.extend(scales[start..end].iter().map(|of_row| scale * of_row));
                    times_dots_whole(&whole, &values[at], &mut out[first..]);
                }
            }
        }
    }

    /// Where the rows of a range are stored, block by block.
    fn stored_ranges(&self, range: Range<usize>) -> Vec<Range<usize>> {
        assert!(range.end <= self.len(), "rows {range:?} of {}", self.len());
        let blocks = self.blocks.get(self.block_of(range.start)..).unwrap_or_default();
        let of_block = |Block { first, stored }: &Block| {
            let at = |row: usize| stored.start + row.clamp(*first, first + stored.len()) - first;
            at(range.start)..at(range.end)
        };
        let begun = blocks.iter().take_while(|block| block.first < range.end);
        begun.map(of_block).filter(|stored| !stored.is_empty()).collect()
    }

    /// The inner product of two rows.
    ///
    /// # Panics
    /// Where a row is not below [`Self::len`].
    pub fn cosine(&self, row_a: usize, row_b: usize) -> f32 {
        let (a, b) = (self.stored(row_a), self.stored(row_b));
        let at = |row: usize| row * self.dim..(row + 1) * self.dim;
        match &*self.values {
            Values::F32(values) => dot(&values[at(a)], &values[at(b)]),
            Values::F16(values) => dot_halves(&values[at(a)], &values[at(b)]),
            Values::Bf16(values) => dot_halves(&values[at(a)], &values[at(b)]),
            Values::I8 { values, scales } => dot_of_whole(&values[at(a)], &values[at(b)]) * (scales[a] * scales[b]),
        }
    }

    /// [`Self::cosine`] of one row with each of some others.
    ///
    /// # Panics
    /// Where a row is not below [`Self::len`].
    pub fn cosines(&self, row: usize, others: &[usize]) -> Vec<f32> {
        let (stored, dim) = (self.stored(row), self.dim);
        let others: Vec<usize> = others.iter().map(|other| self.stored(*other)).collect();
        let at = |row: usize| row * dim..(row + 1) * dim;
        match &*self.values {
            Values::F32(values) => dots_at(&values[at(stored)], values, &others),
            Values::F16(values) => others.iter().map(|b| dot_halves(&values[at(stored)], &values[at(*b)])).collect(),
            Values::Bf16(values) => others.iter().map(|b| dot_halves(&values[at(stored)], &values[at(*b)])).collect(),
            Values::I8 { values, scales } => {
                let mut cosines: Vec<f32> = others.iter().map(|other| scales[stored] * scales[*other]).collect();
                times_dots_at(&values[at(stored)], values, &others, &mut cosines);
                cosines
            }
        }
    }

    /// The rows of some ranges, one after the other. They are not copied: the values are kept for as long as any matrix of
    /// some of them is.
    ///
    /// # Panics
    /// Where a range ends above [`Self::len`].
    #[must_use]
    pub fn ranges(&self, ranges: &[Range<usize>]) -> Self {
        let mut blocks: Vec<Block> = Vec::new();
        for stored in ranges.iter().flat_map(|range| self.stored_ranges(range.clone())) {
            let first = blocks.last().map_or(0, |last| last.first + last.stored.len());
            match blocks.last_mut().filter(|last| last.stored.end == stored.start) {
                Some(last) => last.stored.end = stored.end,
                None => blocks.push(Block { first, stored }),
            }
        }
        Self { dim: self.dim, values: self.values.clone(), blocks }
    }

    /// Some rows as they are in a file, little endian; rows of i8 without their scales.
    pub(crate) fn bytes(&self, rows: Range<usize>) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(rows.len() * self.dim * self.precision().dtype().bitsize() / 8);
        for Range { start, end } in self.stored_ranges(rows) {
            let at = start * self.dim..end * self.dim;
            match &*self.values {
                Values::F32(values) => bytes.extend(values[at].iter().flat_map(|value| value.to_le_bytes())),
                Values::F16(values) => bytes.extend(values[at].iter().flat_map(|value| value.to_le_bytes())),
                Values::Bf16(values) => bytes.extend(values[at].iter().flat_map(|value| value.to_le_bytes())),
                Values::I8 { values, .. } => bytes.extend(values[at].iter().flat_map(|value| value.to_le_bytes())),
            }
        }
        bytes
    }

    /// The scales of rows of i8, `[n]`.
    pub(crate) fn scales(&self) -> Option<Vec<f32>> {
        let Values::I8 { scales, .. } = &*self.values else { return None };
        Some(self.stored_ranges(0..self.len()).into_iter().flat_map(|at| scales[at].iter().copied()).collect())
    }
}

/// A query in whole numbers of 12 bits and a sign, and what they are to be multiplied by.
fn rounded(query: &[f32]) -> (f32, Vec<i16>) {
    let scale = query.iter().fold(0.0, |max: f32, value| max.max(value.abs())) / QUERY_MAX;
    let whole = |value: &f32| if scale > 0.0 { (value / scale).round() as i16 } else { 0 };
    (scale, query.iter().map(whole).collect())
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
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn times_dots_whole(query: &[i16], rows: &[i8], values: &mut [f32]) {
    for (value, row) in values.iter_mut().zip(rows.chunks_exact(query.len())) {
        *value *= whole_query_dot(query, row);
    }
}

/// The inner product of a query and a row of one length.
#[inline(always)]
fn whole_query_dot(query: &[i16], row: &[i8]) -> f32 {
    let mut sum = 0_i32;
    for i in 0..row.len() {
        sum += i32::from(query[i]) * i32::from(i16::from(row[i]));
    }
    sum as f32
}

/// Multiplies each value by the inner product of a row of whole numbers with one of `rows`, given by their places.
#[multiversion(targets("x86_64+avx2"))]
fn times_dots_at(row: &[i8], rows: &[i8], places: &[usize], values: &mut [f32]) {
    for (value, at) in values.iter_mut().zip(places) {
        *value *= whole_dot(row, &rows[at * row.len()..(at + 1) * row.len()]);
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn dot_of_whole(a: &[i8], b: &[i8]) -> f32 {
    whole_dot(a, b)
}

/// Products of rows of up to [`MAX_DIM`] whole numbers are summed in i32.
#[inline(always)]
fn whole_dot(a: &[i8], b: &[i8]) -> f32 {
    let mut sum = 0_i32;
    for i in 0..a.len().min(b.len()) {
        sum += i32::from(i16::from(a[i])) * i32::from(i16::from(b[i]));
    }
    sum as f32
}

#[cfg(test)]
mod bodies;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::similarity::normalize_rows;

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
    fn some_rows_are_those_copied_one_by_one() {
        let query = &unit_rows()[3 * DIM..4 * DIM];
        for precision in ALL {
            let rows = kept(precision);
            let some = rows.ranges(&[4..9, 9..11, 2..3, 30..30, 20..N]).ranges(&[1..8, 9..25, 0..2]);
            // Of 4 to 10, 2 and 20 to 39 the rows 1 to 7, 9 to 24, and 0 and 1.
            let chosen: Vec<usize> = [5..11, 2..3, 21..37, 4..6].into_iter().flatten().collect();
            assert_eq!(some.len(), chosen.len());
            let copied = chosen.iter().flat_map(|row| rows.row(*row).into_owned()).collect();
            let copied = Rows::new(DIM, copied).unwrap().to_precision(precision).unwrap();
            let (mut of_some, mut of_copied, mut in_range) = (Vec::new(), Vec::new(), Vec::new());
            some.similarities(query, &mut of_some);
            copied.similarities(query, &mut of_copied);
            some.similarities_in(3..20, query, &mut in_range);
            assert_eq!(in_range, of_some[3..20]);
            if precision == Precision::I8 {
                // Rounded twice.
                assert!(of_some.iter().zip(&of_copied).all(|(a, b)| (a - b).abs() < 1e-6));
            } else {
                assert_eq!((&some, of_some), (&copied, of_copied));
            }
            assert_eq!(some.cosine(7, 24), rows.cosine(21, 5));
            assert_eq!(some.to_f32(), (0..25).flat_map(|row| some.row(row).into_owned()).collect::<Vec<_>>());
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

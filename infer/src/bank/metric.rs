//! How far embeddings lie apart, measured by how far touches of one view do.
//!
//! Some directions of an embedding change from touch to touch of one view (noise, light, whether it is a hole) and others
//! hardly do. The cosine counts them alike. A bank that was simulated touches its own parts, sees by how much each touch is
//! off its view, `d`, and counts each direction the less the more touches differ along it: with the covariance `W` of `d`
//! the inner product of two embeddings becomes `a' W^-1 b`, and the cosine is taken from that. Speaker recognition calls it
//! within-class covariance normalisation (Hatch, Kajarekar, Stolcke 2006).

#[cfg(feature = "sim")]
mod learning;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::bank::learn_from::Learning;
use crate::bank::rows::Rows;
use crate::bank::similarity::dot;
use crate::error::{Error, Result};
#[cfg(feature = "sim")]
pub(crate) use learning::Pair;

/// A metric: embeddings are multiplied by a matrix before their cosine is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    dim: usize,
    /// The inverse of W's lower triangular root, `[dim, dim]`, zeros above its diagonal.
    matrix: Arc<[f32]>,
    measured: Measured,
    learning: Option<Learning>,
}

/// What a bank's own touches have in its metric. A file of before says more.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// How far the cosine of a touch with its view is from 1, relative to the cosine alone. Positive.
    pub error_scale: f64,
}

impl Metric {
    /// A metric by its matrix and what was measured in it.
    ///
    /// # Errors
    /// A matrix that is not `[dim, dim]`, not finite, not lower triangular, or not above zero on its diagonal, and a scale that is
    /// not positive.
    pub fn new(dim: usize, matrix: Vec<f32>, measured: Measured) -> Result<Self> {
        let is_triangular = |(row, values): (usize, &[f32])| {
            values[row] > 0.0 && values.iter().all(|v| v.is_finite()) && values[row + 1..].iter().all(|v| *v == 0.0)
        };
        if dim == 0 || matrix.len() != dim * dim || !matrix.chunks_exact(dim).enumerate().all(is_triangular) {
            let expected = format!("a lower triangular matrix [{dim}, {dim}], above zero on its diagonal");
            return Err(Error::invalid("metric", expected, format!("{} values", matrix.len())));
        }
        if !(measured.error_scale.is_finite() && measured.error_scale > 0.0) {
            return Err(Error::invalid("metric", "a positive scale of errors", format!("{measured:?}")));
        }
        Ok(Self { dim, matrix: matrix.into(), measured, learning: None })
    }

    /// The same metric, which was learnt like this.
    #[must_use]
    pub fn with_learning(self, learning: Learning) -> Self {
        Self { learning: Some(learning), ..self }
    }

    /// Length of an embedding.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// The matrix, `[dim, dim]`.
    pub fn matrix(&self) -> &[f32] {
        &self.matrix
    }

    /// By how much numbers that were calibrated by the cosine alone are scaled in it: half of [`Measured::error_scale`], on a
    /// logarithmic scale. How much of it another sensor than the bank's leaves is not known.
    pub fn counted_scale(&self) -> f64 {
        self.measured.error_scale.sqrt()
    }

    /// What was measured in it.
    pub fn measured(&self) -> Measured {
        self.measured
    }

    /// How a bank of a scene learnt it from all of its parts; `None` of another metric, and of a bank's file of before.
    pub fn learning(&self) -> Option<Learning> {
        self.learning
    }

    /// Rows as the metric has them, in f32.
    ///
    /// # Errors
    /// Values that leave the range of f32.
    pub(crate) fn rows(&self, rows: &Rows) -> Result<Rows> {
        Rows::new(self.dim, (0..rows.len()).flat_map(|row| self.apply(&rows.row(row))).collect())
    }

    /// An embedding as the metric has it, of the length that it had. `embedding`: `[dim]`.
    pub fn apply(&self, embedding: &[f32]) -> Vec<f32> {
        let lines = self.matrix.chunks_exact(self.dim).enumerate();
        let mut turned: Vec<f32> = lines.map(|(row, line)| dot(&line[..=row], &embedding[..=row])).collect();
        let [before, after] = [embedding, &turned].map(|values| dot(values, values).sqrt());
        let scale = if after > 0.0 { before / after } else { 1.0 };
        turned.iter_mut().for_each(|value| *value *= scale);
        turned
    }

    /// The embedding that the metric has like this, up to its length: [`Self::apply`] undone. `row`: `[dim]`.
    pub fn undo(&self, row: &[f32]) -> Vec<f32> {
        let mut embedding: Vec<f64> = Vec::with_capacity(self.dim);
        for (line, value) in self.matrix.chunks_exact(self.dim).zip(row) {
            let known: f64 = line.iter().zip(&embedding).map(|(factor, value)| f64::from(*factor) * value).sum();
            embedding.push((f64::from(*value) - known) / f64::from(line[embedding.len()]));
        }
        embedding.into_iter().map(|value| value as f32).collect()
    }
}

/// What a cosine in a metric counts as by the cosine alone ([`Metric::counted_scale`]), at least -1.
pub fn by_cosine(metric: Option<&Metric>, cosine: f32) -> f32 {
    metric.map_or(cosine, |metric| (1.0 - (1.0 - f64::from(cosine)) / metric.counted_scale()).max(-1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEASURED: Measured = Measured { error_scale: 0.49 };

    #[test]
    fn matrices_and_numbers_that_are_none_are_refused() {
        let new = |matrix: [f32; 4], measured| Metric::new(2, matrix.to_vec(), measured);
        let good = new([1.0, 0.0, 0.5, 2.0], MEASURED).unwrap();
        assert!((by_cosine(Some(&good), 0.93) - 0.9).abs() < 1e-6 && by_cosine(None, 0.93) == 0.93);
        assert_eq!(by_cosine(Some(&good), -0.9), -1.0);
        for matrix in [[1.0, 0.1, 0.5, 2.0], [0.0, 0.0, 0.5, 2.0], [1.0, 0.0, f32::NAN, 2.0], [1.0, 0.0, 0.5, -2.0]] {
            assert!(new(matrix, MEASURED).unwrap_err().to_string().starts_with("metric: expected a lower triangular"));
        }
        for error_scale in [0.0, -0.1, f64::NAN] {
            assert!(new([1.0, 0.0, 0.5, 2.0], Measured { error_scale }).is_err());
        }
        assert!(Metric::new(2, vec![1.0; 3], MEASURED).is_err());
    }

    #[test]
    fn what_is_undone_points_where_it_did_before() {
        let metric = Metric::new(3, vec![2.0, 0.0, 0.0, -1.5, 0.5, 0.0, 0.25, 3.0, 0.125], MEASURED).unwrap();
        let embedding = [0.6, -0.48, 0.64];
        let undone = metric.undo(&metric.apply(&embedding));
        assert!((dot(&undone, &embedding) / dot(&undone, &undone).sqrt() - 1.0).abs() < 1e-6, "{undone:?}");
    }
}

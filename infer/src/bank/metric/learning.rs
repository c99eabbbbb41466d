//! What touches of known views teach: the metric in which they lie nearest to them.

use crate::bank::similarity::dot;

use super::{Measured, Metric};

impl Measured {
    /// Nothing yet.
    const NOTHING: Self = Self { error_scale: 1.0 };
}

/// A touch's embedding and the view that it was made at, `[dim]` each, of any length.
#[derive(Clone, Debug)]
pub(crate) struct Pair {
    pub touch: Vec<f32>,
    pub view: Vec<f32>,
}

impl Metric {
    /// What touches of each side say; nothing is measured in it yet. `None` where they all lie at their views.
    ///
    /// Sides count by how many touches they have, however far these lie off. The cosine's own metric counts as much as `dim`
    /// touches, so that few touches change little.
    pub(crate) fn of_touches(dim: usize, sides: &[Vec<&Pair>]) -> Option<Self> {
        let mut total = vec![0.0; dim * dim];
        let mut n_touches = 0;
        for side in sides {
            let mut of_side = vec![0.0; dim * dim];
            side.iter().for_each(|pair| add_square(&mut of_side, &off(pair)));
            let trace: f64 = of_side.iter().step_by(dim + 1).sum();
            if trace > 0.0 {
                let scale = side.len() as f64 / trace;
                total.iter_mut().zip(&of_side).for_each(|(sum, value)| *sum += scale * value);
                n_touches += side.len();
            }
        }
        // The trace of `total` is the number of touches, that of the cosine's own then `dim`.
        total.iter_mut().step_by(dim + 1).for_each(|value| *value += 1.0);
        if n_touches == 0 {
            return None;
        }
        let root = root(dim, total)?;
        Some(Self {
            dim,
            matrix: inverse(dim, &root).into_iter().map(|v| v as f32).collect(),
            measured: Measured::NOTHING,
            learning: None,
        })
    }

    /// The same metric with what was measured in it.
    #[must_use]
    pub(crate) fn with_measured(self, measured: Measured) -> Self {
        Self { measured, ..self }
    }
}

impl Pair {
    /// The cosine of the touch with the view, -1..=1.
    pub fn cosine(&self, metric: Option<&Metric>) -> f64 {
        let turned = |values: &[f32]| metric.map_or(values.to_vec(), |metric| metric.apply(values));
        let [touch, view] = [&self.touch, &self.view].map(|values| turned(values));
        let norms = f64::from(dot(&touch, &touch)).sqrt() * f64::from(dot(&view, &view)).sqrt();
        if norms > 0.0 { (f64::from(dot(&touch, &view)) / norms).clamp(-1.0, 1.0) } else { 0.0 }
    }
}

/// By how much a touch is off its view, both of unit length.
fn off(pair: &Pair) -> Vec<f64> {
    let unit = |values: &[f32]| {
        let norm = f64::from(dot(values, values)).sqrt().max(f64::MIN_POSITIVE);
        values.iter().map(|value| f64::from(*value) / norm).collect::<Vec<_>>()
    };
    unit(&pair.touch).into_iter().zip(unit(&pair.view)).map(|(touch, view)| touch - view).collect()
}

/// Adds the products of all pairs of some values below the diagonal.
fn add_square(sums: &mut [f64], values: &[f64]) {
    for ((row, line), a) in sums.chunks_exact_mut(values.len()).enumerate().zip(values) {
        line[..=row].iter_mut().zip(values).for_each(|(sum, b)| *sum += a * b);
    }
}

/// Cholesky's root of a positive definite matrix, read from its lower half; `None` where the matrix is not positive
/// definite.
fn root(dim: usize, mut matrix: Vec<f64>) -> Option<Vec<f64>> {
    for row in 0..dim {
        let (above, rest) = matrix.split_at_mut(row * dim);
        let line = &mut rest[..dim];
        for column in 0..row {
            let other = &above[column * dim..column * dim + column + 1];
            let known: f64 = line[..column].iter().zip(other).map(|(a, b)| a * b).sum();
            line[column] = (line[column] - known) / other[column];
        }
        let left = line[row] - line[..row].iter().map(|value| value * value).sum::<f64>();
        if !(left.is_finite() && left > 0.0) {
            return None;
        }
        line[row] = left.sqrt();
        line[row + 1..].fill(0.0);
    }
    Some(matrix)
}

/// The inverse of a lower triangular matrix.
fn inverse(dim: usize, lower: &[f64]) -> Vec<f64> {
    let mut inverse = vec![0.0; dim * dim];
    for row in 0..dim {
        let (above, rest) = inverse.split_at_mut(row * dim);
        let (of_row, line) = (&lower[row * dim..(row + 1) * dim], &mut rest[..dim]);
        for (factor, known) in of_row[..row].iter().zip(above.chunks_exact(dim)) {
            line.iter_mut().zip(known).for_each(|(sum, value)| *sum -= factor * value);
        }
        line[row] = 1.0;
        line[..=row].iter_mut().for_each(|value| *value /= of_row[row]);
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Touches of views along the z axis that are off along x by 0.3 and along y by 0.1, either way.
    fn pairs() -> Vec<Pair> {
        let touch = |[x, y]: [f64; 2]| {
            let z = (1.0 - x * x - y * y).sqrt();
            Pair { touch: [x, y, z].map(|v| v as f32).to_vec(), view: vec![0.0, 0.0, 5.0] }
        };
        [[0.3, 0.0], [-0.3, 0.0], [0.0, 0.1], [0.0, -0.1]].map(touch).to_vec()
    }

    #[test]
    fn it_is_the_inverse_covariance_of_what_touches_are_off() {
        let metric = Metric::of_touches(3, &[pairs().iter().collect()]).unwrap();
        // By hand: the off values are (+-0.3, 0, dz) and (0, +-0.1, dz'), cross products with x and y cancel.
        let dz = [0.09_f64, 0.01].map(|square| (1.0 - square).sqrt() - 1.0);
        let squares = [2.0 * 0.09, 2.0 * 0.01, 2.0 * (dz[0] * dz[0] + dz[1] * dz[1])];
        let scale = 4.0 / squares.iter().sum::<f64>();
        let weights = squares.map(|square| 1.0 / (1.0 + scale * square));
        let inner = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * weights[i] * b[i]).sum::<f64>();
        let (a, b) = ([0.6, -0.2, 0.5], [0.1, 0.9, 0.3]);
        let expected = inner(a, b) / (inner(a, a) * inner(b, b)).sqrt();
        let pair = Pair { touch: a.map(|v| v as f32).to_vec(), view: b.map(|v| v as f32).to_vec() };
        assert!((pair.cosine(Some(&metric)) - expected).abs() < 1e-6, "{} {expected}", pair.cosine(Some(&metric)));
        let turned = metric.apply(&pair.touch);
        assert!((dot(&turned, &turned) - dot(&pair.touch, &pair.touch)).abs() < 1e-6);
        assert_eq!(metric.apply(&[0.0; 3]), [0.0; 3]);
    }

    #[test]
    fn touches_that_are_correlated_are_told_by_the_full_inverse() {
        // Off along (1, 1, 0) alone: of unit vectors near z, so that what is off along z is of second order.
        let off = [0.02_f32, -0.02].map(|x| Pair { touch: vec![x, x, 1.0], view: vec![0.0, 0.0, 1.0] }).to_vec();
        let metric = Metric::of_touches(3, &[off.iter().collect()]).unwrap();
        // The identity and two touches of trace 1 along (1, 1, 0) / sqrt(2): variances 3, 1 and 1.
        let along =
            |touch: [f32; 3]| 1.0 - Pair { touch: touch.to_vec(), view: vec![0.0, 0.0, 1.0] }.cosine(Some(&metric));
        let (same, across) = (along([0.1, 0.1, 1.0]), along([0.1, -0.1, 1.0]));
        assert!((across / same - 3.0).abs() < 0.05, "{across} {same}");
    }

    #[test]
    fn sides_count_by_their_touches_however_far_they_lie_off() {
        let far = pairs().into_iter().map(|pair| Pair { view: vec![0.0, 0.0, 1.0], ..pair }).collect::<Vec<_>>();
        let near: Vec<Pair> = [[0.0_f32, 0.01], [0.0, -0.01], [0.0, 0.01], [0.0, -0.01]]
            .map(|[x, y]| Pair { touch: vec![x, y, 1.0], view: vec![0.0, 0.0, 1.0] })
            .to_vec();
        let metric = Metric::of_touches(3, &[far.iter().collect(), near.iter().collect()]).unwrap();
        let error =
            |touch: [f32; 3]| 1.0 - Pair { touch: touch.to_vec(), view: vec![0.0, 0.0, 1.0] }.cosine(Some(&metric));
        // Along x 1 + 4 * 0.9 = 4.6 times, along y 1 + 4 * 0.1 + 4 = 5.4 times, but for what is off along z.
        assert!((error([0.1, 0.0, 1.0]) / error([0.0, 0.1, 1.0]) - 5.4 / 4.6).abs() < 0.03);
        assert_eq!(Metric::of_touches(3, &[Vec::new(), Vec::new()]), None);
        assert_eq!(
            Metric::of_touches(3, &[vec![&Pair { touch: vec![0.0, 0.0, 1.0], view: vec![0.0, 0.0, 2.0] }]]),
            None
        );
    }
}

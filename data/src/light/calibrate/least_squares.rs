//! Linear least squares from sums, so that one press can be left out by subtraction.

use crate::error::{Error, Result};

/// Sums over observations of a few outputs by `n` factors: `A^T A`, `A^T y` and `y^T y`.
#[derive(Clone, Debug)]
pub struct Sums {
    n: usize,
    n_observations: f64,
    /// `[n, n]`, the lower half alone: columns up to the row.
    squares: Vec<f64>,
    /// `[3, n]`.
    products: Vec<f64>,
    outputs: [f64; 3],
}

impl Sums {
    /// No observations of `n` factors.
    pub fn new(n: usize) -> Self {
        Self { n, n_observations: 0.0, squares: vec![0.0; n * n], products: vec![0.0; 3 * n], outputs: [0.0; 3] }
    }

    /// Adds an observation: its `n` factors and what they made of three outputs.
    pub fn add(&mut self, factors: &[f64], outputs: [f64; 3]) {
        for (row, (line, a)) in self.squares.chunks_exact_mut(self.n).zip(factors).enumerate() {
            line.iter_mut().zip(&factors[..=row]).for_each(|(sum, b)| *sum += a * b);
        }
        for ((line, y), square) in self.products.chunks_exact_mut(self.n).zip(outputs).zip(&mut self.outputs) {
            line.iter_mut().zip(factors).for_each(|(sum, a)| *sum += a * y);
            *square += y * y;
        }
        self.n_observations += 1.0;
    }

    /// Adds (`sign` 1) or takes away (-1) all observations of `other`.
    pub fn combine(&mut self, other: &Self, sign: f64) {
        let add = |sums: &mut [f64], others: &[f64]| sums.iter_mut().zip(others).for_each(|(a, b)| *a += sign * b);
        add(&mut self.squares, &other.squares);
        add(&mut self.products, &other.products);
        add(&mut self.outputs, &other.outputs);
        self.n_observations += sign * other.n_observations;
    }

    /// The sums of some of the factors, given in rising order.
    pub fn select(&self, chosen: &[usize]) -> Self {
        let n = chosen.len();
        Self {
            n,
            squares: chosen
                .iter()
                .flat_map(|row| chosen.iter().map(move |at| self.squares[row * self.n + at]))
                .collect(),
            products: (0..3).flat_map(|y| chosen.iter().map(move |at| self.products[y * self.n + at])).collect(),
            ..*self
        }
    }

    /// The weights of each output, `[3][n]`, of least squared error plus `ridge` times the weights' squares per
    /// observation, by Cholesky's decomposition. Fails where the observations do not separate the factors.
    pub fn solve(&self, ridge: f64) -> Result<[Vec<f64>; 3]> {
        let n = self.n;
        let mut root = self.squares.clone();
        for i in 0..n {
            root[i * n + i] += ridge * self.n_observations;
        }
        for i in 0..n {
            for j in 0..=i {
                let sum: f64 = (0..j).map(|k| root[i * n + k] * root[j * n + k]).sum();
                let rest = root[i * n + j] - sum;
                if i == j && (rest.is_nan() || rest <= 1e-12 * root[i * n + i]) {
                    let got = format!("nothing new from factor {i} of {n}");
                    return Err(Error::invalid("calibration", "presses that separate the light's factors", got));
                }
                root[i * n + j] = if i == j { rest.sqrt() } else { rest / root[j * n + j] };
            }
        }
        Ok([0, 1, 2].map(|output| {
            let mut weights = self.products[output * n..(output + 1) * n].to_vec();
            for i in 0..n {
                let sum: f64 = (0..i).map(|k| root[i * n + k] * weights[k]).sum();
                weights[i] = (weights[i] - sum) / root[i * n + i];
            }
            for i in (0..n).rev() {
                let sum: f64 = (i + 1..n).map(|k| root[k * n + i] * weights[k]).sum();
                weights[i] = (weights[i] - sum) / root[i * n + i];
            }
            weights
        }))
    }

    /// Sum over observations and outputs of the squared error that `weights` leave.
    pub fn squared_error(&self, weights: &[Vec<f64>; 3]) -> f64 {
        self.squared_errors(weights).iter().sum()
    }

    /// Sum over observations of the squared error that `weights` leave of each output.
    pub fn squared_errors(&self, weights: &[Vec<f64>; 3]) -> [f64; 3] {
        let n = self.n;
        let error = |output: usize| {
            let w = &weights[output];
            let below = |i: usize| (0..i).map(|j| self.squares[i * n + j] * w[j]).sum::<f64>();
            let model = |i: usize| 2.0 * below(i) + self.squares[i * n + i] * w[i];
            let cross = |i: usize| model(i) - 2.0 * self.products[output * n + i];
            self.outputs[output] + (0..n).map(|i| w[i] * cross(i)).sum::<f64>()
        };
        [0, 1, 2].map(error)
    }

    /// Number of observations.
    pub fn n_observations(&self) -> f64 {
        self.n_observations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_weights_come_back_and_their_error_is_counted() {
        let truth = [[1.5, -2.0, 0.25], [0.0, 3.0, 1.0], [4.0, 0.5, -1.0]];
        let (mut sums, mut kept) = (Sums::new(3), Sums::new(3));
        let mut error = 0.0;
        for i in 0..50 {
            let t = f64::from(i);
            let factors = [1.0, (0.3 * t).sin(), (0.7 * t).cos()];
            let noise = if i % 2 == 0 { 0.01 } else { -0.01 };
            let outputs = truth.map(|w: [f64; 3]| w.iter().zip(factors).map(|(w, f)| w * f).sum::<f64>() + noise);
            sums.add(&factors, outputs);
            if i >= 10 {
                kept.add(&factors, outputs);
                error += 3.0 * noise * noise;
            }
        }
        let mut first = Sums::new(3);
        first.combine(&sums, 1.0);
        first.combine(&kept, -1.0);
        sums.combine(&first, -1.0);
        assert_eq!(sums.n_observations(), 40.0);
        let weights = sums.solve(1e-12).unwrap();
        for (found, truth) in weights.iter().zip(truth) {
            assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 0.01), "{found:?}");
        }
        let exact = truth.map(|w| w.to_vec());
        assert!((kept.squared_error(&exact) - error).abs() < 1e-9);
        let some = kept.select(&[0, 2]).solve(1e-12).unwrap();
        assert!(kept.select(&[0, 2]).squared_error(&some) > kept.squared_error(&weights));
    }

    #[test]
    fn factors_that_always_go_together_are_refused() {
        let mut sums = Sums::new(2);
        (0..9).for_each(|i| sums.add(&[f64::from(i), 2.0 * f64::from(i)], [1.0; 3]));
        assert!(sums.solve(0.0).is_err());
    }
}

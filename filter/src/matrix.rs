//! Matrices of three rows: what is asked of a pose's covariance.

use tactile_infer::maps::align::inverse;

/// Rows and columns are x, y (mm) and the angle (rad).
pub(crate) type Matrix = [[f64; 3]; 3];

/// The covariance of what follows from something by its derivatives: J C J^T.
pub(crate) fn by_jacobian(jacobian: &Matrix, covariance: &Matrix) -> Matrix {
    product(&product(jacobian, covariance), &transposed(jacobian))
}

/// The determinant.
pub(crate) fn determinant(m: &Matrix) -> f64 {
    let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
    m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
}

/// x^T M x.
pub(crate) fn square(matrix: &Matrix, x: [f64; 3]) -> f64 {
    (0..3).map(|row| (0..3).map(|at| x[row] * matrix[row][at] * x[at]).sum::<f64>()).sum()
}

/// The inverse of a covariance; `None` where no distribution has it: a leading minor is not above zero (Sylvester).
pub(crate) fn information(covariance: &Matrix) -> Option<Matrix> {
    let m = covariance;
    let of_two = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let mut minors = [m[0][0], of_two, determinant(m)].into_iter();
    minors.all(|minor| minor > 0.0 && minor.is_finite()).then(|| inverse(*m)).flatten()
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| (0..3).map(|at| a[row][at] * b[at][column]).sum()))
}

fn transposed(m: &Matrix) -> Matrix {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| m[column][row]))
}

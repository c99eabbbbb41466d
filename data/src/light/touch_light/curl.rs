//! How each channel answers slopes, by what frames of touches show alone.
//!
//! To first order a channel changes with the gel's slope, `D = A g` with a 3 x 2 matrix `A` of lamps. The two principal axes of the
//! channels' differences span its columns, and the pair of axes within that plane is the one whose slopes have no curl, as the
//! slopes of any surface have none. Both are known up to one common factor; whether it is positive the gel shows, which is bent
//! sharply where it leaves what presses it, a peg or the plate about a hole, and gently where it rises from there.
//!
//! Not modelled: that light decreases over the frame, and that steep slopes respond less than linearly.

use crate::frame::TactileImage;

/// The slopes with the least curl must have at most this share of the curl of the next choice; otherwise the
/// frames do not show the lamps. Frames of a GelSight Mini have about 0.1, noise alone has 1.
const MAX_CURL_SHARE: f64 = 0.5;

/// What frames show of the lamps: sums over pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Second moments of the channels' differences.
    colours: [[f64; 3]; 3],
    /// Second moments of their changes along y and, negative, along x, a mm.
    changes: [[f64; 6]; 6],
    /// Third moments of these changes.
    bends: [[[f64; 6]; 6]; 6],
}

impl Moments {
    /// What one difference image shows, in counts ([`Preprocessing::counts`](crate::frame::Preprocessing::counts)) of `mm_per_px`.
    pub fn of(image: &TactileImage, mm_per_px: [f64; 2]) -> Self {
        let [width, height] = image.size_px;
        let n_pixels = width * height;
        let value = |c: usize, at: usize| f64::from(image.planes[c * n_pixels + at]);
        let mut moments = Self::default();
        for pixel in 0..n_pixels {
            add(&mut moments.colours, [0, 1, 2].map(|c| value(c, pixel)), 1.0);
        }
        for row in 1..height.saturating_sub(1) {
            for column in 1..width.saturating_sub(1) {
                let at = row * width + column;
                let change = |c: usize, step: usize| value(c, at + step) - value(c, at - step);
                let along_y = [0, 1, 2].map(|c| change(c, width) / mm_per_px[1]);
                let along_x = [0, 1, 2].map(|c| -change(c, 1) / mm_per_px[0]);
                let [[a, b, c], [d, e, f]] = [along_y, along_x];
                let changes = [a, b, c, d, e, f];
                add(&mut moments.changes, changes, 1.0);
                for (bends, value) in moments.bends.iter_mut().zip(changes) {
                    add(bends, changes, value);
                }
            }
        }
        moments
    }

    /// What several images show without one of them.
    pub fn without(&self, one: &Self) -> Self {
        let mut rest = *self;
        minus(&mut rest.colours, &one.colours);
        minus(&mut rest.changes, &one.changes);
        rest.bends.iter_mut().zip(&one.bends).for_each(|(rest, one)| minus(rest, one));
        rest
    }

    /// What several images show together.
    pub fn sum<'a>(moments: impl IntoIterator<Item = &'a Self>) -> Self {
        moments.into_iter().fold(Self::default(), |mut sum, one| {
            plus(&mut sum.colours, &one.colours);
            plus(&mut sum.changes, &one.changes);
            sum.bends.iter_mut().zip(&one.bends).for_each(|(sum, one)| plus(sum, one));
            sum
        })
    }
}

/// How the channels answer slopes, up to one common factor that is positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// For red, green and blue the change with a slope along x and along y.
    pub lamps: [[f64; 2]; 3],
    /// For the slope along x and along y what each channel's change adds to it: the pseudo-inverse of the lamps.
    pub slopes: [[f64; 3]; 2],
    /// The curl of these slopes, as a share of that of the next choice, 0..=1; not a number where nothing was pressed.
    pub curl_share: f64,
}

impl Response {
    /// By the moments of some images.
    pub fn of(moments: &Moments) -> Self {
        let (_, colours) = eigen(moments.colours);
        let axes = [colours[2], colours[1]];
        // Second moments of (dp1/dy, dp2/dy, -dp1/dx, -dp2/dx), p the coordinates on the two axes: the slopes
        // (w1 p1 + w2 p2, w3 p1 + w4 p2) have the mean squared curl w^T M w.
        let on = |i: usize, j: usize| {
            let (a, b) = (&axes[i % 2], &axes[j % 2]);
            let pairs = (0..3).flat_map(|c| (0..3).map(move |d| (c, d)));
            pairs.map(|(c, d)| a[c] * b[d] * moments.changes[3 * (i / 2) + c][3 * (j / 2) + d]).sum::<f64>()
        };
        let (curls, choices) = eigen::<4>(std::array::from_fn(|i| std::array::from_fn(|j| on(i, j))));
        let w = choices[0];
        let determinant = w[0] * w[3] - w[1] * w[2];
        // Slopes are W U^T D; the lamps are its pseudo-inverse, U W^-1.
        let slopes = [0, 2].map(|k| [0, 1, 2].map(|c| w[k] * axes[0][c] + w[k + 1] * axes[1][c]));
        let lamps = [0, 1, 2].map(|c| {
            let [u, v] = [axes[0][c], axes[1][c]];
            [(u * w[3] - v * w[2]) / determinant, (v * w[0] - u * w[1]) / determinant]
        });
        // The sum of the cubes of what bends a surface of these slopes, dg_x/dx + dg_y/dy: most where the gel leaves what presses it.
        let bend = [0, 1, 2, 3, 4, 5].map(|k| if k < 3 { slopes[1][k] } else { -slopes[0][k - 3] });
        let terms = (0..216).map(|at| [at / 36, at / 6 % 6, at % 6]);
        let cubes = terms.map(|[i, j, k]| bend[i] * bend[j] * bend[k] * moments.bends[i][j][k]).sum::<f64>();
        let sign = if cubes > 0.0 { -1.0 } else { 1.0 };
        let (slopes, lamps) =
            (slopes.map(|of| of.map(|value| sign * value)), lamps.map(|of| of.map(|value| sign * value)));
        let curl_share = if determinant.abs() < 1e-3 { f64::NAN } else { curls[0] / curls[1] };
        Self { lamps, slopes, curl_share }
    }

    /// Whether the images show the lamps at all.
    pub fn is_known(&self) -> bool {
        self.curl_share <= MAX_CURL_SHARE
    }
}

/// Adds the products of values in pairs, `times` as often.
fn add<const N: usize>(sums: &mut [[f64; N]; N], values: [f64; N], times: f64) {
    for (sums, a) in sums.iter_mut().zip(values) {
        sums.iter_mut().zip(values).for_each(|(sum, b)| *sum += times * a * b);
    }
}

fn plus<const N: usize>(sums: &mut [[f64; N]; N], others: &[[f64; N]; N]) {
    sums.as_flattened_mut().iter_mut().zip(others.as_flattened()).for_each(|(sum, other)| *sum += other);
}

fn minus<const N: usize>(sums: &mut [[f64; N]; N], others: &[[f64; N]; N]) {
    sums.as_flattened_mut().iter_mut().zip(others.as_flattened()).for_each(|(sum, other)| *sum -= other);
}

/// Eigenvalues in ascending order and their unit vectors, of a symmetric matrix, by Jacobi's rotations.
fn eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut vectors: [[f64; N]; N] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    // Convergence is quadratic: a 4 x 4 matrix needs about six sweeps.
    for _ in 0..30 {
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                let turn = |(x, y): (f64, f64)| (c * x - s * y, s * x + c * y);
                for row in &mut a {
                    (row[p], row[q]) = turn((row[p], row[q]));
                }
                for rows in [&mut a, &mut vectors] {
                    let (upper, lower) = rows.split_at_mut(q);
                    upper[p].iter_mut().zip(&mut lower[0]).for_each(|(x, y)| (*x, *y) = turn((*x, *y)));
                }
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j]));
    (order.map(|i| a[i][i]), order.map(|i| vectors[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_of_a_matrix_made_of_known_ones() {
        // diag(1, 3) turned by 30 degrees.
        let (c, s) = (0.75_f64.sqrt(), 0.5);
        let a = [[c * c + 3.0 * s * s, -2.0 * c * s], [-2.0 * c * s, s * s + 3.0 * c * c]];
        let (values, vectors) = eigen(a);
        assert!((values[0] - 1.0).abs() < 1e-12 && (values[1] - 3.0).abs() < 1e-12);
        assert!((vectors[0][0] * c + vectors[0][1] * s).abs() > 1.0 - 1e-12, "{vectors:?}");
    }
}

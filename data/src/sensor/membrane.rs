//! The obstacle problem of a membrane, solved by projected over-relaxation.
//!
//! In each cell `D = max(obstacle, w (sum of the four neighbours))` with `w = r / (1 + 4 r)` and
//! `r = (length / cell)^2`: what `D - l^2 lap D = 0` reads on a raster where nothing is touched. Beyond the
//! border the surface is mirrored. Cells are coloured as a chessboard and each colour is packed by itself,
//! so that a row of one colour, all of whose neighbours have the other, is worked on by whole vectors.

use multiversion::multiversion;

use crate::error::{Error, Result};
use crate::scene::shape::Raster;

/// The solver stops when no cell is off `max(obstacle, w (sum of the four neighbours))` by more than this
/// share of the press.
pub const RESIDUAL: f32 = 1e-6;

/// Sweeps between two looks at the residual.
const SWEEPS: usize = 16;

/// Sweeps after which the solver gives up: some four times what a length of 100 cells takes.
const MOST_SWEEPS: usize = 4_000;

/// How far a membrane of a decay length is pushed in, mm, by an obstacle `depth_mm` high at most.
///
/// Fails where a height is no number and where the residual is not reached.
pub fn membrane(obstacle: &Raster, length_mm: f64, depth_mm: f64) -> Result<Raster> {
    if let Some(i) = obstacle.values.iter().position(|height| !height.is_finite()) {
        let at = format!("obstacle, row {}, column {}", i / obstacle.n, i % obstacle.n);
        return Err(Error::invalid(at, "a finite height", obstacle.values[i].to_string()));
    }
    let ratio = (length_mm / obstacle.cell_mm).powi(2);
    let weight = (ratio / (1.0 + 4.0 * ratio)) as f32;
    // The best over-relaxation for the Jacobi radius 4 w of this operator (Young 1954).
    let radius = 4.0 * ratio / (1.0 + 4.0 * ratio);
    let omega = (2.0 / (1.0 + (1.0 - radius * radius).sqrt())) as f32;
    let floor = [0, 1].map(|colour| Colour::pack(obstacle, colour));
    let [mut even, mut odd] = floor.clone();
    even.mirror();
    odd.mirror();
    let most = RESIDUAL * depth_mm as f32;
    let mut worst = 0.0;
    for _ in 0..MOST_SWEEPS / SWEEPS {
        for sweep in 1..=SWEEPS {
            // The last sweep without over-relaxation, which multiplies what rounding leaves.
            let omega = if sweep < SWEEPS { omega } else { 1.0 };
            relax(&mut even, &odd, &floor[0], weight, omega);
            even.mirror();
            relax(&mut odd, &even, &floor[1], weight, omega);
            odd.mirror();
        }
        worst = residual(&even, &odd, &floor[0], weight).max(residual(&odd, &even, &floor[1], weight));
        if worst <= most {
            return Ok(unpack(obstacle, &even, &odd));
        }
    }
    let expected = format!("a residual of {most:.1e} mm within {MOST_SWEEPS} sweeps");
    Err(Error::invalid("gel", expected, format!("{worst:.1e} mm")))
}

/// The cells of one colour, `(row + column) % 2`, packed by rows; a ghost cell is before and after each
/// row, and a ghost row above and below.
#[derive(Clone, Debug)]
struct Colour {
    colour: usize,
    n_rows: usize,
    stride: usize,
    values: Vec<f32>,
}

impl Colour {
    fn pack(raster: &Raster, colour: usize) -> Self {
        // An odd raster is taken one cell wider, its last column doubled.
        let (n_rows, stride) = (raster.n, raster.n.div_ceil(2) + 2);
        let mut values = vec![0.0; (n_rows + 2) * stride];
        for (row, line) in raster.values.chunks_exact(raster.n).enumerate() {
            let packed = &mut values[(row + 1) * stride + 1..][..stride - 2];
            for (k, value) in packed.iter_mut().enumerate() {
                *value = line[(2 * k + (row + colour) % 2).min(raster.n - 1)];
            }
        }
        Self { colour, n_rows, stride, values }
    }

    /// Fills the ghost cells: the neighbour beyond the border is the one before it, which has this colour.
    fn mirror(&mut self) {
        let stride = self.stride;
        for row in self.values.chunks_exact_mut(stride) {
            row[0] = row[1];
            row[stride - 1] = row[stride - 2];
        }
        let last = self.n_rows + 1;
        self.values.copy_within(2 * stride..3 * stride, 0);
        self.values.copy_within((last - 2) * stride..(last - 1) * stride, last * stride);
    }

    /// The cells above, below, to the left and to the right of a row of the other colour, and where the row is.
    #[inline(always)]
    fn neighbours(&self, row: usize) -> ([&[f32]; 4], std::ops::Range<usize>) {
        let (at, n) = ((row + 1) * self.stride + 1, self.stride - 2);
        // In this row the other colour starts at its first column or at its second.
        let shift = (row + 1 + self.colour) % 2;
        let starts = [at - self.stride, at + self.stride, at + shift - 1, at + shift];
        (starts.map(|start| &self.values[start..start + n]), at..at + n)
    }
}

/// One sweep over the cells of a colour, whose neighbours all have the other.
#[multiversion(targets("x86_64+avx2"))]
fn relax(cells: &mut Colour, other: &Colour, floor: &Colour, weight: f32, omega: f32) {
    for row in 0..cells.n_rows {
        let ([above, below, left, right], range) = other.neighbours(row);
        let (floor, line) = (&floor.values[range.clone()], &mut cells.values[range]);
        for k in 0..above.len() {
            let sum = (above[k] + below[k]) + (left[k] + right[k]);
            let new = line[k] + omega * (weight * sum - line[k]);
            // Not f32::max, whose care for NaN costs a third: no height is NaN.
            line[k] = if new > floor[k] { new } else { floor[k] };
        }
    }
}

/// By how much the cells of a colour are off their own equation at most, mm.
#[multiversion(targets("x86_64+avx2"))]
fn residual(cells: &Colour, other: &Colour, floor: &Colour, weight: f32) -> f32 {
    // Bits of positive floats are in the order of the floats, and their maximum needs no order.
    let mut worst = 0_u32;
    for row in 0..cells.n_rows {
        let ([above, below, left, right], range) = other.neighbours(row);
        let (floor, line) = (&floor.values[range.clone()], &cells.values[range]);
        for k in 0..above.len() {
            let free = weight * ((above[k] + below[k]) + (left[k] + right[k]));
            let wanted = if free > floor[k] { free } else { floor[k] };
            worst = worst.max((line[k] - wanted).abs().to_bits());
        }
    }
    f32::from_bits(worst)
}

fn unpack(raster: &Raster, even: &Colour, odd: &Colour) -> Raster {
    let n = raster.n;
    let at = |row: usize, column: usize| {
        let cells = if (row + column).is_multiple_of(2) { even } else { odd };
        cells.values[(row + 1) * cells.stride + 1 + column / 2]
    };
    Raster { n, cell_mm: raster.cell_mm, values: (0..n * n).map(|i| at(i / n, i % n)).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Random pins of random height.
    fn pins(n: usize) -> Raster {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let height = |_| if rng.random_bool(0.01) { 0.8 * rng.random::<f32>() } else { 0.0 };
        Raster { n, cell_mm: 0.1, values: (0..n * n).map(height).collect() }
    }

    #[test]
    fn each_cell_solves_its_own_equation_read_off_the_plain_raster() {
        for (n, length_mm) in [(60, 0.3), (60, 1.2), (61, 1.2), (60, 10.0)] {
            let obstacle = pins(n);
            let pushed = membrane(&obstacle, length_mm, 0.8).unwrap();
            let ratio = (length_mm / 0.1_f64).powi(2);
            let at = |row: usize, column: usize| f64::from(pushed.values[row * n + column]);
            // Beyond the border the surface is mirrored; an odd raster is solved a column wider.
            let beyond = |i: usize| if i + 1 < n { i + 1 } else { n - 2 };
            for (row, column) in (0..n * n).map(|i| (i / n, i % n)).filter(|(_, column)| column + 1 < n) {
                let [above, left] = [row, column].map(|i| if i == 0 { 1 } else { i - 1 });
                let sum = at(above, column) + at(beyond(row), column) + at(row, left) + at(row, column + 1);
                let free = ratio / (1.0 + 4.0 * ratio) * sum;
                let off = at(row, column) - free.max(f64::from(obstacle.values[row * n + column]));
                // The stated residual, and f32's own rounding of four terms.
                assert!(off.abs() < 0.8 * f64::from(RESIDUAL) + 2e-7, "{n}, {length_mm}: {off} at {row}, {column}");
            }
        }
    }

    #[test]
    fn a_height_that_is_no_number_is_refused_by_place() {
        let mut obstacle = pins(20);
        obstacle.values[7] = f32::NAN;
        assert!(membrane(&obstacle, 1.2, 0.8).unwrap_err().to_string().contains("row 0, column 7"));
    }
}

//! The gel: an obstacle membrane.
//!
//! Pressed onto a part, the gel's surface is pushed in by `D(x, y) >= 0` mm, which minimises the
//! integral of `D^2 + l^2 |grad D|^2` subject to `D >= obstacle`. Beside a contact `D - l^2 lap D = 0`.
//! For a flat-topped part the obstacle is `depth` on the part and far below elsewhere, so `D` is
//! `depth` times the solution of a unit press: solved once for each part and side, and scaled for each
//! touch. A tilt scales it locally, `D(x) ~ depth(x) u(x)`: exact in contact, and beside it off by the
//! tilt's change over one decay length, 0.02 mm at most for half a degree.

use crate::error::{Error, Result};
use crate::se2::Se2;
use crate::shape::{Raster, Shape};
use crate::touch::Side;

/// Side of a cell of the solved surface, mm: a tenth of the decay length or less.
pub const CELL_MM: f64 = 0.1;

/// The camera's and the gel's own blur, mm.
const BLUR_MM: f64 = 0.06;

/// The sweep stops when no cell moves by more than this share of the press.
const RESIDUAL: f32 = 1e-4;

/// The gel's surface under a unit press on one side of one part.
#[derive(Clone, Debug)]
pub struct Surface {
    field: Raster,
    outside: f32,
}

impl Surface {
    /// Solves the unit press. `half_mm` is how far from the part's centre the surface is wanted;
    /// `clearance_mm` is by how much the hole's outline is wider than the peg's on every side. Without a
    /// gel length only where there is contact is worked out, one there and nought elsewhere.
    pub fn solve(
        shape: &Shape,
        side: Side,
        half_mm: f64,
        gel_length_mm: Option<f64>,
        clearance_mm: f64,
    ) -> Result<Self> {
        let gel_fits = gel_length_mm.is_none_or(|l| l > 0.0 && l.is_finite());
        if !(half_mm > 0.0 && half_mm <= 500.0 && gel_fits) {
            let got = format!("{half_mm} mm and {gel_length_mm:?} mm");
            return Err(Error::invalid("surface", "up to 500 mm and a positive gel length", got));
        }
        // A cell whose centre lies just outside the contact takes the fall beside a straight edge, so that
        // outlines and clearance count in fractions of a cell.
        let mut obstacle = Raster::distance(shape, half_mm, CELL_MM, clearance_mm + 2.0 * CELL_MM);
        let contact = |beside_mm: f32| match beside_mm {
            ..=0.0 => 1.0,
            beside if beside < CELL_MM as f32 => gel_length_mm.map_or(0.0, |l| (-beside / l as f32).exp()),
            _ => 0.0,
        };
        let (outside, clearance_mm) = (if side == Side::Peg { 0.0 } else { 1.0 }, clearance_mm as f32);
        for value in &mut obstacle.values {
            *value = contact(if side == Side::Peg { *value } else { clearance_mm - *value });
        }
        let Some(gel_length_mm) = gel_length_mm else {
            return Ok(Self { field: obstacle, outside });
        };
        let mut field = membrane(&obstacle, gel_length_mm, outside);
        blur(&mut field, outside);
        Ok(Self { field, outside })
    }

    /// Depth under a unit press at a point of the part, 0..=1: bilinear between cells.
    pub fn sample(&self, [x_mm, y_mm]: [f64; 2]) -> f32 {
        let n = self.field.n;
        let scale = 1.0 / self.field.cell_mm;
        let place = |mm: f64| (mm * scale + 0.5 * n as f64 - 0.5) as f32;
        let (x, y) = (place(x_mm), place(y_mm));
        let last = (n - 1) as f32;
        if !(x >= 0.0 && y >= 0.0 && x < last && y < last) {
            return self.outside;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let at = row * n + column;
        let cells = &self.field.values;
        let top = cells[at] + fx * (cells[at + 1] - cells[at]);
        let bottom = cells[at + n] + fx * (cells[at + n + 1] - cells[at + n]);
        top + fy * (bottom - top)
    }

    /// Depths under a unit press at each pixel of a view and one pixel round it:
    /// `[height + 2, width + 2]`, as the sensor sees them from `part_from_sensor`.
    pub fn view(&self, part_from_sensor: &Se2, frame_px: [usize; 2], mm_per_px: [f64; 2]) -> Vec<f32> {
        let [width, height] = frame_px.map(|n| n + 2);
        let mut depths = Vec::with_capacity(width * height);
        let (sin, cos) = part_from_sensor.theta_rad.sin_cos();
        let step = [cos * mm_per_px[0], sin * mm_per_px[0]];
        for row in 0..height {
            let y = (row as f64 - 0.5 * (height - 1) as f64) * mm_per_px[1];
            let x = -0.5 * (width - 1) as f64 * mm_per_px[0];
            let start = part_from_sensor.apply([x, y]);
            depths.extend((0..width).map(|column| {
                let t = column as f64;
                self.sample([start[0] + t * step[0], start[1] + t * step[1]])
            }));
        }
        depths
    }
}

/// The unit obstacle problem by projected red-black over-relaxation.
fn membrane(obstacle: &Raster, gel_length_mm: f64, outside: f32) -> Raster {
    let n = obstacle.n;
    let mut field = obstacle.clone();
    if n < 3 {
        return field;
    }
    let ratio = (gel_length_mm / obstacle.cell_mm).powi(2);
    // D_ij (1 + 4 r) = r (sum of four neighbours); r = (l / cell)^2.
    let weight = (ratio / (1.0 + 4.0 * ratio)) as f32;
    // The best over-relaxation for the Jacobi radius 4 w of this operator (Young 1954).
    let radius = 4.0 * f64::from(weight);
    let omega = (2.0 / (1.0 + (1.0 - radius * radius).sqrt())) as f32;
    let border = |values: &mut [f32]| {
        for i in 0..n {
            for at in [i, (n - 1) * n + i, i * n, i * n + n - 1] {
                values[at] = outside;
            }
        }
    };
    border(&mut field.values);
    for sweep in 0..4_000 {
        let mut moved = 0.0_f32;
        for colour in 0..2 {
            for row in 1..n - 1 {
                let (above, rest) = field.values.split_at_mut(row * n);
                let (line, below) = rest.split_at_mut(n);
                let above = &above[(row - 1) * n..];
                let floor = &obstacle.values[row * n..(row + 1) * n];
                let first = 1 + (row + colour) % 2;
                for column in (first..n - 1).step_by(2) {
                    let old = line[column];
                    let sum = above[column] + below[column] + line[column - 1] + line[column + 1];
                    let new = (old + omega * (weight * sum - old)).max(floor[column]);
                    moved = moved.max((new - old).abs());
                    line[column] = new;
                }
            }
        }
        if moved < RESIDUAL && sweep > 2 {
            break;
        }
    }
    field
}

/// Gaussian blur, separable, of radius three cells.
fn blur(field: &mut Raster, outside: f32) {
    let sigma = BLUR_MM / field.cell_mm;
    let kernel: Vec<f32> = (-3..=3).map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp() as f32).collect();
    let total: f32 = kernel.iter().sum();
    let n = field.n;
    let mut line = vec![0.0_f32; n + 6];
    for (stride, step) in [(n, 1), (1, n)] {
        for at in 0..n {
            line.fill(outside);
            (0..n).for_each(|i| line[i + 3] = field.values[at * stride + i * step]);
            for i in 0..n {
                let sum: f32 = kernel.iter().zip(&line[i..i + 7]).map(|(k, v)| k * v).sum();
                field.values[at * stride + i * step] = sum / total;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const L: f64 = 1.2;

    fn box_of(x: [f64; 2], y: [f64; 2]) -> Shape {
        Shape { regions: vec![vec![vec![[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]]] }
    }

    #[test]
    fn beside_a_straight_edge_the_gel_decays_exponentially() {
        let surface = Surface::solve(&box_of([-30.0, 0.0], [-30.0, 30.0]), Side::Peg, 20.0, Some(L), 0.0).unwrap();
        for s in [0.5_f64, 1.0, 2.0, 3.0] {
            let expected = (-s / L).exp();
            let got = f64::from(surface.sample([s, 0.0]));
            // The blur's share, 0.06^2 / (2 l^2), and the border's, e^-17, are smaller than the solver's.
            assert!((got - expected).abs() < 0.01 * expected + 1e-3, "at {s} mm: {got}, not {expected}");
        }
    }

    #[test]
    fn a_slit_keeps_its_centre_up_by_the_cosh_law() {
        for half_width in [0.5_f64, 1.0, 2.0] {
            let slit = box_of([-half_width, half_width], [-40.0, 40.0]);
            let surface = Surface::solve(&slit, Side::Hole, 20.0, Some(L), 0.0).unwrap();
            let expected = 1.0 / (half_width / L).cosh();
            let got = f64::from(surface.sample([0.0, 0.0]));
            assert!((got - expected).abs() < 0.02, "half width {half_width}: {got}, not {expected}");
            // The wall's slope, a quarter to three quarters of a mm inside: (1/l) sinh(x/l) / cosh(w/l).
            let x = half_width - 0.3;
            let slope = f64::from(surface.sample([x + 0.1, 0.0]) - surface.sample([x - 0.1, 0.0])) / 0.2;
            let law = (x / L).sinh() / (half_width / L).cosh() / L;
            assert!((slope - law).abs() < 0.05 * law + 0.02, "slope {slope}, not {law}");
        }
    }

    #[test]
    fn nothing_leaves_the_gel_flat_and_a_plate_presses_it_everywhere() {
        let peg = Surface::solve(&Shape::default(), Side::Peg, 10.0, Some(L), 0.1).unwrap();
        let plate = Surface::solve(&Shape::default(), Side::Hole, 10.0, Some(L), 0.1).unwrap();
        assert!(peg.field.values.iter().all(|d| *d == 0.0));
        assert!(plate.field.values.iter().all(|d| (*d - 1.0).abs() < 1e-6));
    }

    #[test]
    fn extreme_gels_stay_between_nought_and_the_press() {
        let pin = box_of([-0.05, 0.05], [-0.05, 0.05]);
        for gel_length in [0.1, 10.0] {
            for side in [Side::Peg, Side::Hole] {
                let surface = Surface::solve(&pin, side, 8.0, Some(gel_length), 0.15).unwrap();
                assert!(surface.field.values.iter().all(|d| (-1e-6..=1.0 + 1e-5).contains(d)));
            }
        }
        assert!(Surface::solve(&pin, Side::Peg, 8.0, Some(f64::NAN), 0.1).is_err());
    }

    #[test]
    fn a_view_turns_with_the_sensor() {
        let surface = Surface::solve(&box_of([0.0, 5.0], [-1.0, 1.0]), Side::Peg, 15.0, Some(L), 0.0).unwrap();
        // The bar points right; a sensor turned by 90 degrees sees it point up.
        let view = surface.view(&Se2::from_degrees(0.0, 0.0, 90.0), [40, 40], [0.25, 0.25]);
        let at = |column: usize, row: usize| view[(row + 1) * 42 + column + 1];
        // 2 mm beside the bar the gel is down to exp(-2 / 1.2) = 0.19.
        assert!(at(20, 8) > 0.9 && at(20, 32) < 0.25 && at(8, 20) < 0.25 && at(32, 20) < 0.25);
    }
}

//! How much larger or smaller than the mosaic it is laid over the part is that was touched, along each axis.
//!
//! Touches of a bar that is a millimetre longer fit the map of the shorter one anywhere but at both ends at once. So, after
//! [`super::align`], Gauss and Newton look for the pose and a symmetric strain `E` about the part's origin: what a touch shows at `q`
//! of the part's frame, the mosaic shows at `q - E q`. A constant offset of the distance is left open: a deeper press or more play
//! moves an outline without stretching it.

use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::Se2;

use super::align::{self, Drawing, FAR, Pixel, SHARED, USUAL_COST, pixels_of};
use super::mosaic::Mosaic;
use super::usual_strain::UsualStrain;

/// Steps at most; strains are small, so that the third rarely moves one by a thousandth.
const STEPS: usize = 4;

/// A step of less than so many standard deviations of each number is the last one.
const STILL: f64 = 0.02;

/// Only this near an outline, mm, does a distance say where that is: farther off maps are cut off.
const REACH_MM: f64 = 2.5;

/// A part differs from a stranger by so much, mm, along an axis: less is no other size. Half and twice of it fit parts and strangers as well.
const SIZE_MM: f64 = 0.25;

/// No part's touches agree better than this, in variance, with all of them together.
const LEAST_TIMES: f64 = 0.1;

/// What is looked for: x and y, mm; the angle, rad; the strain along x, along y and across; the offset of the distance, mm.
const N: usize = 7;

/// How far each is expected from where the touches were laid, of no strain and no offset, standard deviations.
const EXPECTED: [f64; N] = [1.0, 1.0, 0.05, 0.1, 0.1, 0.1, 0.15];

/// The strain of the part that was touched, with respect to the one it is laid over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Strain {
    /// Along x, along y and across (half of the shear), 1 for twice as long.
    pub mean: [f64; 3],
    /// Its covariance.
    pub covariance: [[f64; 3]; 3],
}

impl Strain {
    /// The strain at which the distances of touches, laid at a pose, are those of a mosaic.
    pub fn of(touches: &[Drawing<'_>], mosaic: &Mosaic<'_>, part_from_first: &Se2) -> Self {
        let near = |pixel: &Pixel| pixel.distance_mm.abs() < REACH_MM;
        let pixels: Vec<Pixel> = touches.iter().flat_map(pixels_of).filter(near).collect();
        let start = [part_from_first.x_mm, part_from_first.y_mm, part_from_first.theta_rad, 0.0, 0.0, 0.0, 0.0];
        let mut found = start;
        let mut covariance = [[0.0; N]; N];
        for _ in 0..STEPS {
            let mut sums = Sums::of(&pixels, mosaic, &found);
            for (at, sd) in EXPECTED.into_iter().enumerate() {
                sums.squares[at][at] += sd.powi(-2);
                sums.slopes[at] += (found[at] - start[at]) * sd.powi(-2);
            }
            covariance = inverse(sums.squares);
            let step = covariance.map(|row| -row.iter().zip(sums.slopes).map(|(a, b)| a * b).sum::<f64>());
            found.iter_mut().zip(step).for_each(|(number, step)| *number += step);
            if (0..N).all(|at| step[at].powi(2) < STILL * STILL * covariance[at][at]) {
                break;
            }
        }
        let of_strain = |at: usize| 3 + at;
        Self {
            mean: [0, 1, 2].map(|at| found[of_strain(at)]),
            covariance: [0, 1, 2].map(|row| [0, 1, 2].map(|at| covariance[of_strain(row)][of_strain(at)])),
        }
    }

    /// The same beyond what is usual of the part.
    pub fn against(&self, usual: &UsualStrain) -> Self {
        Self {
            mean: [0, 1, 2].map(|at| self.mean[at] - usual.mean[at]),
            covariance: self.covariance.map(|row| row.map(|value| usual.times.max(LEAST_TIMES) * value)),
        }
    }

    /// The same beyond what is this sensor's ([`super::sensor_offset`]), of which a part may show half more or less.
    pub fn without(&self, sensor: f64) -> Self {
        let Self { mean: [along_x, along_y, across], mut covariance } = *self;
        let variance = (0.5 * sensor).powi(2);
        covariance[..2].iter_mut().for_each(|row| row[..2].iter_mut().for_each(|value| *value += variance));
        Self { mean: [along_x - sensor, along_y - sensor, across], covariance }
    }

    /// How far it is from none, squared standard deviations: about 3 where there is none.
    pub(super) fn squared(&self) -> f64 {
        let Some(information) = align::inverse(self.covariance) else { return 0.0 };
        let along = |row: usize| (0..3).map(|at| information[row][at] * self.mean[at]).sum::<f64>();
        (0..3).map(|row| self.mean[row] * along(row)).sum()
    }

    /// How far it is from none, nats: each doubling of a strain that is far off adds as much, since under a strange sensor a part that is
    /// there comes to a few standard deviations, too (a t distribution's tail).
    pub fn off_nats(&self) -> f64 {
        (self.squared() / 3.0).ln_1p()
    }

    /// How much the touches say of the size of a part, nats, as large as a square of this side and known to a quarter of a millimetre before.
    pub fn known_nats(&self, side_mm: f64) -> f64 {
        let before = SIZE_MM * SIZE_MM;
        let after = self.covariance.map(|row| row.map(|value| side_mm * side_mm * value));
        let mut both = after;
        (0..3).for_each(|axis| both[axis][axis] += before);
        let nats = 0.5 * (align::determinant(&both) / align::determinant(&after)).ln();
        if nats.is_finite() { nats.max(0.0) } else { 0.0 }
    }
}

/// The derivatives of what pixels cost, and the squares that are taken for the second ones.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    slopes: [f64; N],
    squares: [[f64; N]; N],
}

impl Sums {
    fn of(
        pixels: &[Pixel],
        mosaic: &Mosaic<'_>,
        [x_mm, y_mm, theta_rad, along_x, along_y, across, offset_mm]: &[f64; N],
    ) -> Self {
        let (sin, cos) = theta_rad.sin_cos();
        let mut sums = Self::default();
        let (mut cost, mut n) = (0.0, 0.0);
        for Pixel { first_mm: [x, y], distance_mm, error_mm } in pixels {
            let turned = [cos * x - sin * y, sin * x + cos * y];
            let [qx, qy] = [turned[0] + x_mm, turned[1] + y_mm];
            let unstrained = [qx - along_x * qx - across * qy, qy - along_y * qy - across * qx];
            let there = mosaic.slope(unstrained).filter(|there| there.distance_mm.abs() < REACH_MM);
            let Some(there) = there else { continue };
            let error = (error_mm.powi(2) + there.error_mm.powi(2)).sqrt();
            let off = (there.distance_mm - offset_mm - distance_mm) / error;
            let weight = if off.abs() > FAR { FAR / off.abs() } else { 1.0 };
            (cost, n) = (cost + weight * off * off * (1.0 - 0.5 * weight), n + 1.0);
            let [gx, gy] = there.by_xy.map(|by| by / error);
            let slope = [gx, gy, gy * turned[0] - gx * turned[1], -gx * qx, -gy * qy, -gx * qy - gy * qx, -1.0 / error];
            for row in 0..N {
                sums.slopes[row] += weight * off * slope[row];
                (0..=row).for_each(|at| sums.squares[row][at] += weight * slope[row] * slope[at]);
            }
        }
        let share = 1.0 / (SHARED * (cost / f64::max(n, 1.0) / USUAL_COST).max(1.0));
        sums.slopes.iter_mut().for_each(|sum| *sum *= share);
        for row in 0..N {
            for at in 0..=row {
                sums.squares[row][at] *= share;
                sums.squares[at][row] = sums.squares[row][at];
            }
        }
        sums
    }
}

/// The inverse of a symmetric positive definite matrix (Gauss and Jordan).
fn inverse(mut m: [[f64; N]; N]) -> [[f64; N]; N] {
    for at in 0..N {
        let pivot = m[at][at].recip();
        m[at][at] = 1.0;
        m[at].iter_mut().for_each(|value| *value *= pivot);
        let of_pivot = m[at];
        for row in (0..N).filter(|row| *row != at) {
            let share = m[row][at];
            m[row][at] = 0.0;
            m[row].iter_mut().zip(of_pivot).for_each(|(value, pivot)| *value -= share * pivot);
        }
    }
    m
}

#[cfg(test)]
pub(super) mod tests {
    use tactile_data::dataset::touch::Side;

    use super::super::DrawnMap;
    use super::super::mosaic::tests::{map_of, mosaics, outline};
    use super::*;

    /// Touches round a part that is the known one, stretched by `1 + strain` along each axis and moved outwards by `offset_mm`.
    pub(in super::super) fn stretched(strain: [f64; 3], offset_mm: f64) -> Vec<(Se2, DrawnMap)> {
        let first = Se2::from_degrees(4.5, 0.3, 20.0);
        let poses = [[4.5, 0.3, 20.0], [-4.2, 0.4, 130.0], [0.3, 3.1, -70.0], [-0.8, -2.9, 10.0]];
        let shape = |[x, y]: [f64; 2]| {
            let [along_x, along_y, across] = strain;
            outline([x - along_x * x - across * y, y - along_y * y - across * x]) - offset_mm
        };
        let touch = |[x, y, deg]: [f64; 3]| {
            let pose = Se2::from_degrees(x, y, deg);
            (first.inverse() * pose, map_of(&shape, &pose, 0.1))
        };
        poses.map(touch).into()
    }

    fn found(strain: [f64; 3], offset_mm: f64) -> Strain {
        let touches = stretched(strain, offset_mm);
        let drawings: Vec<Drawing<'_>> = touches
            .iter()
            .map(|(first_from_sensor, map)| Drawing { map, first_from_sensor: *first_from_sensor })
            .collect();
        // Not quite where they were made.
        Strain::of(&drawings, &mosaics().of(0, Side::Peg), &Se2::from_degrees(4.65, 0.2, 21.0))
    }

    #[test]
    fn a_stretched_part_is_found_stretched() {
        for (strain, offset_mm) in [
            ([0.0; 3], 0.0),
            ([0.06, 0.0, 0.0], 0.0),
            ([-0.04, 0.05, 0.0], 0.0),
            ([0.02, -0.03, 0.04], 0.0),
            ([0.05, 0.0, 0.0], 0.2),
            ([0.0, 0.0, 0.0], -0.15),
        ] {
            let Strain { mean, covariance } = found(strain, offset_mm);
            for axis in 0..3 {
                assert!((mean[axis] - strain[axis]).abs() < 0.008, "{strain:?} {offset_mm}: {mean:?}");
                assert!((0.002..0.03).contains(&covariance[axis][axis].sqrt()), "{covariance:?}");
            }
        }
    }

    #[test]
    fn what_is_a_sensors_is_taken_off_and_half_of_it_left_unsure() {
        let variance = 0.01_f64.powi(2);
        let covariance = [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]];
        let left = Strain { mean: [0.05, 0.03, 0.01], covariance }.without(0.04);
        assert!((left.mean[0] - 0.01).abs() < 1e-12 && (left.mean[1] + 0.01).abs() < 1e-12 && left.mean[2] == 0.01);
        // Along both axes together less is known, between them as much as before.
        let sum = left.covariance[0][0] + 2.0 * left.covariance[0][1] + left.covariance[1][1];
        let difference = left.covariance[0][0] - 2.0 * left.covariance[0][1] + left.covariance[1][1];
        assert!(
            (sum - 2.0 * variance - 4.0 * 0.02 * 0.02).abs() < 1e-12 && (difference - 2.0 * variance).abs() < 1e-12
        );
    }

    #[test]
    fn one_touch_knows_less_than_four_and_what_is_nowhere_nothing() {
        let touches = stretched([0.05, 0.0, 0.0], 0.0);
        let drawing = |(first_from_sensor, map)| Drawing { map, first_from_sensor };
        let drawings: Vec<Drawing<'_>> = touches.iter().map(|(pose, map)| drawing((*pose, map))).collect();
        let (mosaics, first) = (mosaics(), Se2::from_degrees(4.5, 0.3, 20.0));
        let [one, all] = [&drawings[..1], &drawings].map(|of| Strain::of(of, &mosaics.of(0, Side::Peg), &first));
        assert!((0..3).all(|axis| all.covariance[axis][axis] < one.covariance[axis][axis]), "{one:?} {all:?}");
        let nowhere = Strain::of(&drawings, &mosaics.of(0, Side::Peg), &Se2::from_degrees(90.0, 0.0, 0.0));
        assert_eq!(nowhere.mean, [0.0; 3]);
        assert!((0..3).all(|axis| (nowhere.covariance[axis][axis].sqrt() - 0.1).abs() < 1e-12));
    }

    #[test]
    fn an_inverse_times_its_matrix_is_one() {
        // Positive definite: the squares of rows, and a little on the diagonal.
        let root = |row: usize, at: usize| ((row * 5 + at * 3 + 1) as f64).sin();
        let square = |row: usize, at: usize| (0..N).map(|k| root(row, k) * root(at, k)).sum::<f64>();
        let m: [[f64; N]; N] =
            std::array::from_fn(|row| std::array::from_fn(|at| square(row, at) + if row == at { 0.1 } else { 0.0 }));
        let found = inverse(m);
        for (row, at) in (0..N * N).map(|at| (at / N, at % N)) {
            let product: f64 = (0..N).map(|k| m[row][k] * found[k][at]).sum();
            assert!((product - f64::from(u8::from(row == at))).abs() < 1e-9, "{row} {at}");
        }
    }
}

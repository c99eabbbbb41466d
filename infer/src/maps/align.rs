//! Where touches of one hole lie on a part's mosaic: the pose at which their distances are those of the mosaic (Gauss-Newton).

use tactile_data::pose::se2::{Se2, wrap_angle};

use super::DrawnMap;
use super::mosaic::Mosaic;

/// Steps; the fourth rarely moves a touch by more than a hundredth of a millimetre.
const STEPS: usize = 6;

/// A pixel that is off by more than so many errors counts by its root alone (Huber).
pub(super) const FAR: f64 = 2.0;

/// The mean cost of a pixel that is as far off as the errors say.
pub(super) const USUAL_COST: f64 = 0.5;

/// Every second pixel along each axis is compared: neighbours share their error.
const EVERY: usize = 2;

/// Pixels that are compared and count as one, since they still share their error.
pub(super) const SHARED: f64 = 4.0;

/// A touch of a hole: its map, and the sensor's pose in the frame of the first touch.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// What it shows.
    pub map: &'a DrawnMap,
    /// Where it was made.
    pub first_from_sensor: Se2,
}

/// Touches laid over a mosaic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aligned {
    /// The pose of the first touch in the part's frame.
    pub part_from_first: Se2,
    /// Covariance of x, y (mm) and the angle (rad).
    pub covariance: [[f64; 3]; 3],
    /// Mean cost of a pixel that both show, in halves of squared errors; a pixel far off by its root.
    pub cost: f64,
    /// The share of the touches that the mosaic shows, 0..=1.
    pub overlap: f64,
}

/// Where touches are thought to have been made: the pose of the first one in the part's frame, and its covariance, of x, y (mm)
/// and the angle (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The pose.
    pub part_from_first: Se2,
    /// How well it is known.
    pub covariance: [[f64; 3]; 3],
}

impl Start {
    /// A pose that is known to so many standard deviations, mm and degrees.
    pub fn known_to(part_from_first: Se2, [mm, deg]: [f64; 2]) -> Self {
        let mut covariance = [[0.0; 3]; 3];
        [mm, mm, deg.to_radians()].into_iter().enumerate().for_each(|(axis, sd)| covariance[axis][axis] = sd * sd);
        Self { part_from_first, covariance }
    }
}

/// Moves touches together from a start to where their distances are those of a mosaic.
///
/// Each pixel counts by the errors that the map and the mosaic state, and by less where all of them are farther off than that: a
/// socket is not its plug. The start counts as a measurement of the pose by its covariance, so that a straight edge, along which
/// nothing holds it, stays where it was. A start without a covariance stays.
pub fn align(touches: &[Drawing<'_>], mosaic: &Mosaic<'_>, start: &Start) -> Aligned {
    let mut pose = start.part_from_first;
    let pixels: Vec<Pixel> = touches.iter().flat_map(pixels_of).collect();
    let Some(information) = inverse(start.covariance) else {
        let sums = Sums::of(&pixels, mosaic, &pose, (&pose, [[0.0; 3]; 3]));
        let n = sums.n.max(1.0);
        let overlap = sums.n / sums.n_all.max(1.0);
        return Aligned { part_from_first: pose, covariance: start.covariance, cost: sums.cost / n, overlap };
    };
    let prior = (&start.part_from_first, information);
    let sums_at = |pose: &Se2| Sums::of(&pixels, mosaic, pose, prior);
    let mut sums = sums_at(&pose);
    for _ in 0..STEPS {
        let Some(covariance) = inverse(sums.squares) else { break };
        let step = [0, 1, 2].map(|row| -(0..3).map(|at| covariance[row][at] * sums.slopes[at]).sum::<f64>());
        let moved = Se2::new(pose.x_mm + step[0], pose.y_mm + step[1], pose.theta_rad + step[2]);
        let after = sums_at(&moved);
        // What costs more is not better, even where the slope promised it.
        if after.total >= sums.total {
            break;
        }
        (pose, sums) = (moved, after);
    }
    let covariance = inverse(sums.squares).unwrap_or([[0.0; 3]; 3]);
    let n = sums.n.max(1.0);
    Aligned { part_from_first: pose, covariance, cost: sums.cost / n, overlap: sums.n / sums.n_all.max(1.0) }
}

/// What a touch shows of a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixel {
    pub(super) first_mm: [f64; 2],
    pub(super) distance_mm: f64,
    pub(super) error_mm: f64,
}

/// The pixels of a touch that are compared.
pub(super) fn pixels_of(touch: &Drawing<'_>) -> impl Iterator<Item = Pixel> {
    let Drawing { map, first_from_sensor } = *touch;
    map.places_mm(EVERY).map(move |(at, place_mm)| Pixel {
        first_mm: first_from_sensor.apply(place_mm),
        distance_mm: f64::from(map.distance_mm[at]),
        error_mm: f64::from(map.error_mm[at]),
    })
}

/// What a pose costs, its derivatives, and the squares that Gauss and Newton take for the second ones.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    cost: f64,
    total: f64,
    slopes: [f64; 3],
    squares: [[f64; 3]; 3],
    n: f64,
    n_all: f64,
}

impl Sums {
    fn of(pixels: &[Pixel], mosaic: &Mosaic<'_>, pose: &Se2, (start, information): (&Se2, [[f64; 3]; 3])) -> Self {
        let mut sums = Self { n_all: pixels.len() as f64, ..Self::default() };
        sums.add(pixels, mosaic, pose);
        let mean = sums.cost / sums.n.max(1.0);
        let share = 1.0 / (SHARED * (mean / USUAL_COST).max(1.0));
        sums.slopes.iter_mut().chain(sums.squares.as_flattened_mut()).for_each(|sum| *sum *= share);
        // Where less is shown, less speaks against the pose: what is not shown costs as much as what is.
        sums.total = mean * sums.n_all / SHARED;
        let off = [pose.x_mm - start.x_mm, pose.y_mm - start.y_mm, wrap_angle(pose.theta_rad - start.theta_rad)];
        for row in 0..3 {
            let pull: f64 = (0..3).map(|column| information[row][column] * off[column]).sum();
            sums.total += 0.5 * pull * off[row];
            sums.slopes[row] += pull;
            (0..3).for_each(|column| sums.squares[row][column] += information[row][column]);
        }
        sums
    }

    /// Adds what pixels cost.
    fn add(&mut self, pixels: &[Pixel], mosaic: &Mosaic<'_>, pose: &Se2) {
        let (sin, cos) = pose.theta_rad.sin_cos();
        for Pixel { first_mm: [x, y], distance_mm, error_mm } in pixels {
            let turned = [cos * x - sin * y, sin * x + cos * y];
            let Some(there) = mosaic.slope([turned[0] + pose.x_mm, turned[1] + pose.y_mm]) else { continue };
            self.n += 1.0;
            // What is not known of either counts for as little.
            let error = (error_mm.powi(2) + there.error_mm.powi(2)).sqrt();
            let off = (there.distance_mm - distance_mm) / error;
            let weight = if off.abs() > FAR { FAR / off.abs() } else { 1.0 };
            self.cost += weight * off * off * (1.0 - 0.5 * weight);
            let (by_x, by_y) = (there.by_xy[0] / error, there.by_xy[1] / error);
            let slope = [by_x, by_y, by_y * turned[0] - by_x * turned[1]];
            for row in 0..3 {
                self.slopes[row] += weight * off * slope[row];
                (0..3).for_each(|column| self.squares[row][column] += weight * slope[row] * slope[column]);
            }
        }
    }
}

/// The determinant of a matrix without a row and a column, with its sign.
fn cofactor(m: &[[f64; 3]; 3], row: usize, column: usize) -> f64 {
    let [r0, r1] = [(row + 1) % 3, (row + 2) % 3];
    let [c0, c1] = [(column + 1) % 3, (column + 2) % 3];
    m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0]
}

/// The determinant of a matrix.
pub(super) fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    (0..3).map(|column| m[0][column] * cofactor(m, 0, column)).sum()
}

/// The inverse of a symmetric matrix, by its cofactors; `None` of one that has none.
pub fn inverse(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let determinant = determinant(&m);
    let inverse = [0, 1, 2].map(|row| [0, 1, 2].map(|column| cofactor(&m, column, row) / determinant));
    inverse.as_flattened().iter().all(|value| value.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use tactile_data::dataset::touch::Side;

    use super::super::mosaic::tests::{map, mosaics};
    use super::*;

    fn coarse(pose: Se2) -> Start {
        Start::known_to(pose, [1.5, 8.0])
    }

    fn first(map: &DrawnMap) -> Drawing<'_> {
        Drawing { map, first_from_sensor: Se2::IDENTITY }
    }

    #[test]
    fn touches_hold_each_other() {
        let mosaics = mosaics();
        let truth = Se2::from_degrees(3.3, -1.2, 71.0);
        let moved = Se2::from_degrees(-5.0, 2.0, 40.0);
        let maps = [map(&truth, 0.1), map(&(truth * moved), 0.1)];
        let touches = [first(&maps[0]), Drawing { map: &maps[1], first_from_sensor: moved }];
        let start = Se2::from_degrees(2.5, -0.4, 66.0);
        let [one, both] = [&touches[..1], &touches].map(|of| align(of, &mosaics.of(0, Side::Peg), &coarse(start)));
        assert!(both.part_from_first.distance_mm(&truth) < 0.05, "{both:?}");
        assert!((0..3).all(|axis| both.covariance[axis][axis] < one.covariance[axis][axis]));
        // A second touch that was made elsewhere fits nowhere.
        let wrong = Drawing { first_from_sensor: Se2::from_degrees(-2.0, 2.0, 40.0), ..touches[1] };
        assert!(align(&[touches[0], wrong], &mosaics.of(0, Side::Peg), &coarse(start)).cost > 10.0 * both.cost);
    }

    #[test]
    fn a_touch_comes_back_to_where_it_was_made() {
        let mosaics = mosaics();
        let truth = Se2::from_degrees(3.3, -1.2, 71.0);
        let touch = map(&truth, 0.1);
        for [x, y, deg] in [[0.0, 0.0, 0.0], [1.0, 0.5, 7.0], [-0.9, 0.8, -8.0], [0.4, -1.4, 4.0]] {
            let start = Se2::from_degrees(truth.x_mm + x, truth.y_mm + y, truth.theta_deg() + deg);
            let found = align(&[first(&touch)], &mosaics.of(0, Side::Peg), &coarse(start));
            let turned = wrap_angle(found.part_from_first.theta_rad - truth.theta_rad).to_degrees().abs();
            assert!(found.part_from_first.distance_mm(&truth) < 0.05 && turned < 0.5, "{start:?} {found:?}");
            assert!(found.cost < 0.1 && found.overlap > 0.9, "{found:?}");
            // Some 500 pixels near the outline, sixteen of which count as one, each 0.14 mm off with the mosaic's error: an axis is
            // told by half of them.
            let sd = found.covariance[0][0].sqrt();
            assert!((0.02..0.08).contains(&sd), "{sd}");
        }
    }

    #[test]
    fn what_is_not_on_the_mosaic_stays_where_it_was() {
        let mosaics = mosaics();
        let nowhere = Se2::from_degrees(80.0, 0.0, 10.0);
        let found = align(&[first(&map(&nowhere, 0.1))], &mosaics.of(0, Side::Peg), &coarse(nowhere));
        assert_eq!((found.part_from_first, found.overlap, found.cost), (nowhere, 0.0, 0.0));
        assert!((found.covariance[0][0].sqrt() - 1.5).abs() < 1e-9);
    }

    #[test]
    fn a_start_counts_as_it_is_known() {
        let mosaics = mosaics();
        let truth = Se2::from_degrees(3.3, -1.2, 71.0);
        let touch = map(&truth, 0.1);
        let start = Se2::from_degrees(2.8, -1.2, 71.0);
        let at = |sd: f64| align(&[first(&touch)], &mosaics.of(0, Side::Peg), &Start::known_to(start, [sd, 1.0]));
        let off = |found: &Aligned| found.part_from_first.distance_mm(&truth);
        // As sure as the touch, about half way; not at all, all the way; exactly, none of it.
        let touch_sd = at(1e3).covariance[0][0].sqrt();
        assert!(off(&at(1e3)) < 0.05 && (off(&at(touch_sd)) - 0.25).abs() < 0.15, "{touch_sd}");
        assert_eq!(
            (at(0.0).part_from_first, at(0.0).covariance),
            (start, Start::known_to(start, [0.0, 1.0]).covariance)
        );
        // Of a map that is sure and wrong little is believed.
        let mut wrong = touch.clone();
        wrong.distance_mm.iter_mut().enumerate().for_each(|(at, mm)| *mm += if at % 2 == 0 { 1.0 } else { -1.0 });
        let found = align(&[first(&wrong)], &mosaics.of(0, Side::Peg), &coarse(start));
        assert!(found.cost > 2.0 && found.covariance[0][0] > 2.0 * at(1.5).covariance[0][0], "{found:?}");
    }

    #[test]
    fn an_inverse_times_its_matrix_is_one() {
        let m = [[4.0, 1.0, -0.5], [1.0, 3.0, 0.25], [-0.5, 0.25, 2.0]];
        let found = inverse(m).unwrap();
        for (row, column) in (0..9).map(|at| (at / 3, at % 3)) {
            let product: f64 = (0..3).map(|at| m[row][at] * found[at][column]).sum();
            assert!((product - f64::from(u8::from(row == column))).abs() < 1e-12);
        }
        assert_eq!(inverse([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), None);
    }
}

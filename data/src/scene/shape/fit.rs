//! Whether a peg goes into a hole: outline against outline, with play.

use super::crossing::is_inside;
use super::raster::sides;
use super::{Contour, Shape};
use crate::pose::se2::Se2;

/// Points of a peg's outline that are compared with a hole are this close, mm.
const OUTLINE_STEP_MM: f64 = 0.05;

/// Points of a peg's inside that are compared with a hole are this close, mm.
const INSIDE_STEP_MM: f64 = 0.2;

/// What rounding makes of a length, mm: a peg fits into a hole of its own size.
const ROUNDING_MM: f64 = 1e-9;

impl Shape {
    /// Whether a peg of this outline goes straight down into `hole`, an opening that is wider than drawn by
    /// `clearance_mm` on every side (round its corners, as simulated holes are), where the peg's frame is at
    /// `hole_from_peg`: nothing of the peg is over the plate, nor over an island left in the opening.
    ///
    /// Tested at points 0.05 mm apart along the peg's outline and 0.2 mm apart inside; an island narrower than
    /// that can be overlooked. Nothing fits at a pose that is not finite; an empty peg fits elsewhere.
    pub fn fits_in(&self, hole: &Shape, clearance_mm: f64, hole_from_peg: &Se2) -> bool {
        let goes_in = |point: [f64; 2]| hole.is_within(hole_from_peg.apply(point), clearance_mm + ROUNDING_MM);
        // The outline first: it finds most of those that do not fit.
        hole_from_peg.is_finite() && self.outline_points().all(goes_in) && self.inside_points().all(goes_in)
    }

    /// Whether a point is in the shape or no further than `reach_mm` outside.
    fn is_within(&self, point: [f64; 2], reach_mm: f64) -> bool {
        self.contains(point)
            || self
                .regions
                .iter()
                .flat_map(|region| sides(region))
                .any(|side| distance_squared(side, point) <= reach_mm * reach_mm)
    }

    /// Whether a point is in the shape.
    pub(super) fn contains(&self, point: [f64; 2]) -> bool {
        let is_in = |region: &Vec<Contour>| region.iter().filter(|contour| is_inside(contour, point)).count() % 2 == 1;
        self.regions.iter().any(is_in)
    }

    /// Points of the outline, 0.05 mm apart at most.
    pub fn outline_points(&self) -> impl Iterator<Item = [f64; 2]> {
        self.regions.iter().flat_map(|region| sides(region)).flat_map(|[a, b]| {
            let n = ((b[0] - a[0]).hypot(b[1] - a[1]) / OUTLINE_STEP_MM).ceil().max(1.0);
            (0..n as usize).map(move |i| [0, 1].map(|axis| a[axis] + i as f64 / n * (b[axis] - a[axis])))
        })
    }

    fn inside_points(&self) -> impl Iterator<Item = [f64; 2]> {
        let [x_min, y_min, x_max, y_max] = self.bounds();
        let n = |low: f64, high: f64| ((high - low) / INSIDE_STEP_MM).ceil() as usize;
        let along = |low: f64, i: usize| low + (i as f64 + 0.5) * INSIDE_STEP_MM;
        let columns = n(x_min, x_max);
        let point = move |row: usize| (0..columns).map(move |column| [along(x_min, column), along(y_min, row)]);
        (0..n(y_min, y_max)).flat_map(point).filter(|point| self.contains(*point))
    }
}

/// Squared distance of a point from a side, mm^2.
fn distance_squared([a, b]: [[f64; 2]; 2], [x, y]: [f64; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let length_squared = (along[0] * along[0] + along[1] * along[1]).max(1e-18);
    let t = (((x - a[0]) * along[0] + (y - a[1]) * along[1]) / length_squared).clamp(0.0, 1.0);
    (x - a[0] - t * along[0]).powi(2) + (y - a[1] - t * along[1]).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::glyph::glyph;
    use crate::scene::shape::relief::rectangle;
    use crate::scene::shape::{Raster, Relief};
    use std::f64::consts::{PI, SQRT_2, TAU};

    fn square(half: f64) -> Shape {
        rectangle([-half, -half, half, half])
    }

    fn disc(radius: f64) -> Contour {
        (0..720).map(|i| TAU * f64::from(i) / 720.0).map(|t| [radius * t.cos(), radius * t.sin()]).collect()
    }

    fn of(contours: Vec<Contour>) -> Shape {
        Shape { regions: vec![contours] }
    }

    fn shifted(x: f64, y: f64) -> Se2 {
        Se2::new(x, y, 0.0)
    }

    #[test]
    fn a_square_has_the_clearance_as_play_and_less_towards_a_round_corner() {
        let fits = |x, y| square(5.0).fits_in(&square(5.0), 2.0, &shifted(x, y));
        assert!(fits(1.99, 0.0) && fits(0.0, -1.99) && !fits(2.01, 0.0) && !fits(0.0, -2.01));
        let diagonal = 2.0 / SQRT_2;
        assert!(fits(diagonal - 0.01, diagonal - 0.01) && !fits(diagonal + 0.01, diagonal + 0.01));
        assert!(!fits(f64::NAN, 0.0) && square(5.0).fits_in(&square(5.0), 0.0, &Se2::IDENTITY));
    }

    #[test]
    fn a_square_turns_until_a_corner_meets_the_wall() {
        // A corner of a square of half side 5, turned by t, rises to 5 (cos t + sin t) = 5 + 0.5.
        let limit = (1.1 / SQRT_2).asin() - PI / 4.0;
        let fits = |turn| square(5.0).fits_in(&square(5.0), 0.5, &Se2::new(0.0, 0.0, turn));
        assert!(fits(limit - 0.002) && !fits(limit + 0.002) && fits(0.5 * PI + limit - 0.002));
    }

    #[test]
    fn a_disc_goes_in_as_far_as_the_radii_differ() {
        let fits = |x| of(vec![disc(3.0)]).fits_in(&of(vec![disc(4.0)]), 0.5, &Se2::new(0.6 * x, 0.8 * x, 1.0));
        assert!(fits(1.49) && !fits(1.51));
    }

    #[test]
    fn an_island_keeps_a_peg_without_its_counter_out() {
        let ring = || of(vec![disc(10.0), disc(5.0)]);
        let fits = |peg: Shape, clearance_mm, x| peg.fits_in(&ring(), clearance_mm, &shifted(x, 0.0));
        // The ring's own peg: the island of radius 5 - 2 in its counter of radius 5.
        assert!(fits(ring(), 2.0, 1.99) && !fits(ring(), 2.0, 2.01));
        // A full disc covers the island, all of it and without touching it, until the clearance leaves none.
        assert!(!fits(of(vec![disc(9.0)]), 2.0, 0.0) && !fits(of(vec![disc(9.0)]), 4.5, 0.0));
        assert!(fits(of(vec![disc(9.0)]), 5.01, 0.0));
        // A small one goes in next to it: between 3 and 12 mm.
        let small = |x| fits(of(vec![disc(1.5)]), 2.0, x);
        assert!(small(7.5) && small(4.51) && small(10.49) && !small(4.49) && !small(10.51));
    }

    #[test]
    fn what_other_regions_fill_is_open_too() {
        let bars = Shape {
            regions: [rectangle([-5.0, -1.0, 5.0, 1.0]), rectangle([-1.0, -5.0, 1.0, 5.0])]
                .into_iter()
                .flat_map(|bar| bar.regions)
                .collect(),
        };
        assert!(bars.fits_in(&bars, 0.5, &Se2::new(0.3, 0.3, 0.5 * PI)));
        assert!(!square(1.6).fits_in(&bars, 0.4, &Se2::IDENTITY) && square(1.2).fits_in(&bars, 0.4, &Se2::IDENTITY));
    }

    #[test]
    fn letters_fit_their_own_holes_and_symmetric_ones_after_half_a_turn_too() {
        for c in 'A'..='Z' {
            let letter = glyph(c, 32.0, 28.0).unwrap();
            let fits = |clearance_mm, pose| letter.fits_in(&letter, clearance_mm, &pose);
            assert!(fits(0.0, Se2::IDENTITY), "{c}");
            let turned = fits(0.5, Se2::new(0.0, 0.0, PI));
            assert!(turned || !Relief::peg(letter.clone()).symmetry().is_any(), "{c}");
            assert!(!turned || !"MLTF".contains(c), "{c}");
        }
    }

    #[test]
    fn a_letter_goes_in_where_no_covered_cell_is_further_out_than_the_clearance() {
        let (clearance_mm, cell_mm) = (2.0, 0.25);
        let mut judged = [0; 2];
        for (i, (peg, hole)) in "MLTFMOT".chars().zip("MLTFLOF".chars()).enumerate() {
            let [peg, hole] = [peg, hole].map(|c| glyph(c, 32.0, 28.0).unwrap());
            let away = Raster::distance(&hole, 30.0, cell_mm, 5.0);
            for k in 0..12 {
                let (turn, far) = (TAU * (0.618 * f64::from(k)), 0.25 * f64::from(k));
                let pose = Se2::from_degrees(far * turn.cos(), far * turn.sin(), (k % 3 * 3 - 3).into());
                let covered = Raster::coverage(&peg.clone().map(|p| pose.apply(p)), 30.0, cell_mm);
                let furthest = |least: f32| {
                    let cells = covered.values.iter().zip(&away.values).filter(|(share, _)| **share > least);
                    cells.map(|(_, mm)| f64::from(*mm)).fold(f64::NEG_INFINITY, f64::max)
                };
                // A cell's centre is at most 0.18 mm from what is covered of it.
                let fits = peg.fits_in(&hole, clearance_mm, &pose);
                if furthest(0.0) < clearance_mm - 0.18 {
                    assert!(fits, "{i} {k}");
                    judged[0] += 1;
                } else if furthest(0.99) > clearance_mm {
                    assert!(!fits, "{i} {k}");
                    judged[1] += 1;
                }
            }
        }
        assert!(judged.iter().all(|n| *n >= 12), "{judged:?}");
    }
}

//! The symmetry of a side of a part, from its geometry.

use std::f64::consts::TAU;

use super::Raster;
use super::relief::{Layer, Relief};
use crate::pose::symmetry::Symmetry;

/// Deepest drop that counts when turned sides are compared, mm: what is lower is hardly touched.
const LOOK_MM: f32 = 1.0;

/// Two sides that look the same differ in less than this share of what rises from the open or the bare plate.
const SAME_SHARE: f32 = 0.01;

/// Nor do they differ anywhere by half over a square of this side, mm: a notch as small as the gel can show.
const NOTCH_MM: f64 = 0.3;

/// Turns of a round part that are looked at, evenly spread: a prime, which no other symmetry that is looked for divides.
const N_ROUND: usize = 37;

impl Relief {
    /// The turns after which the side looks the same, to 1 % of what differs from the open or the bare plate round it and
    /// to 0.15 mm at every place (a peg of I, N and O looks the same after half a turn), of the highest order up to
    /// [`Symmetry::MAX_ORDER`]; any turn of a round one. The centre is the centre of mass.
    pub fn symmetry(&self) -> Symmetry {
        let Some(compared) = Compared::new(self) else { return Symmetry::NONE };
        let is_of = |order: usize| (1..order).all(|k| compared.is_same(TAU * k as f64 / order as f64));
        let found = |order| Symmetry { order, centre_mm: compared.centre_mm };
        if is_of(N_ROUND) {
            return found(None);
        }
        (2..=Symmetry::MAX_ORDER).rev().find(|order| is_of(*order)).map_or(Symmetry::NONE, |order| found(Some(order)))
    }
}

/// A side as it is, to be compared with itself turned.
struct Compared<'a> {
    relief: &'a Relief,
    centre_mm: [f64; 2],
    half_mm: f64,
    cell_mm: f64,
    /// What is above the deepest that counts, as a share of it, on a square raster: coverage for a flat peg.
    rises: Vec<f32>,
    /// The sum of what differs from the open or the bare plate.
    mass: f32,
}

impl<'a> Compared<'a> {
    /// `None` where nothing rises.
    fn new(relief: &'a Relief) -> Option<Self> {
        let bounds = relief.layers.iter().flat_map(|layer| match layer {
            Layer::Face(face) => face.outline.bounds(),
            Layer::Heights(map) => map.bounds(),
        });
        let half = bounds.map(f64::abs).fold(0.0, f64::max);
        let at_once =
            Self { relief, centre_mm: [0.0; 2], half_mm: 1.5 * half, cell_mm: half / 100.0, rises: vec![], mass: 0.0 };
        if half == 0.0 {
            return None;
        }
        let rises = at_once.turned(0.0);
        let around = relief.layers.iter().map(|layer| match layer {
            Layer::Face(face) if face.outside => rise(face.drop_mm as f32),
            _ => 0.0,
        });
        let around = around.fold(0.0, f32::max);
        let mass: f32 = rises.iter().map(|value| (value - around).abs()).sum();
        let n = rises.len().isqrt();
        let mean = |place: &dyn Fn(usize) -> usize| {
            let moment = |(i, value): (usize, &f32)| f64::from((value - around).abs()) * at_once.centre(place(i), n);
            rises.iter().enumerate().map(moment).sum::<f64>() / f64::from(mass)
        };
        let centre_mm = [mean(&|i| i % n), mean(&|i| i / n)];
        (mass > 0.0).then_some(Self { centre_mm, rises, mass, ..at_once })
    }

    /// Centre of a row or column of the raster, mm.
    fn centre(&self, index: usize, n: usize) -> f64 {
        (index as f64 + 0.5 - 0.5 * n as f64) * self.cell_mm
    }

    /// The raster of the side after a turn about its centre.
    fn turned(&self, theta_rad: f64) -> Vec<f32> {
        let n = (2.0 * self.half_mm / self.cell_mm).ceil() as usize;
        let mut rises = vec![0.0_f32; n * n];
        let turn = Symmetry { centre_mm: self.centre_mm, ..Symmetry::NONE }.turn(theta_rad);
        for layer in &self.relief.layers {
            match layer {
                Layer::Face(face) => {
                    let height = rise(face.drop_mm as f32);
                    let outline = face.outline.clone().map(|point| turn.apply(point));
                    let covered = Raster::coverage(&outline, self.half_mm, self.cell_mm).values;
                    for (value, covered) in rises.iter_mut().zip(covered) {
                        *value = value.max(height * if face.outside { 1.0 - covered } else { covered });
                    }
                }
                Layer::Heights(map) => {
                    let back = turn.inverse();
                    for (i, value) in rises.iter_mut().enumerate() {
                        let point = back.apply([self.centre(i % n, n), self.centre(i / n, n)]);
                        *value = value.max(map.drop_at(point).map_or(0.0, rise));
                    }
                }
            }
        }
        rises
    }

    fn is_same(&self, theta_rad: f64) -> bool {
        let turned = self.turned(theta_rad);
        let differs: Vec<f32> = self.rises.iter().zip(&turned).map(|(a, b)| (a - b).abs()).collect();
        let square = ((NOTCH_MM / self.cell_mm).round() as usize).max(2);
        differs.iter().sum::<f32>() < SAME_SHARE * self.mass && most_in_square(&differs, square) < 0.5
    }
}

/// What is above the deepest that counts, as a share of it.
fn rise(drop_mm: f32) -> f32 {
    (1.0 - drop_mm / LOOK_MM).max(0.0)
}

/// The largest mean of a square raster over squares of `side` cells.
fn most_in_square(values: &[f32], side: usize) -> f32 {
    let n = values.len().isqrt();
    let sums = |line: &[f32]| line.windows(side).map(|window| window.iter().sum::<f32>()).collect::<Vec<_>>();
    let of_rows: Vec<Vec<f32>> = values.chunks_exact(n).map(sums).collect();
    let stacked = |rows: &[Vec<f32>]| {
        let of_columns = |column: usize| rows.iter().map(|row| row[column]).sum::<f32>();
        (0..rows[0].len()).map(of_columns).fold(0.0, f32::max)
    };
    of_rows.windows(side).map(stacked).fold(0.0, f32::max) / (side * side) as f32
}

#[cfg(test)]
mod tests {
    use super::super::relief::{Face, rectangle};
    use super::super::{HeightMap, Shape};
    use super::*;
    use crate::scene::shape::glyph::glyph;

    fn order(relief: &Relief) -> Option<usize> {
        relief.symmetry().order
    }

    /// A closed outline from its radius at each of `n` angles.
    fn polar(n: usize, radius: impl Fn(f64) -> f64) -> Shape {
        let point = |i: usize| {
            let angle = TAU * i as f64 / n as f64;
            [radius(angle) * angle.cos() + 0.4, radius(angle) * angle.sin() - 0.2]
        };
        Shape { regions: vec![vec![(0..n).map(point).collect()]] }
    }

    #[test]
    fn letters_that_look_alike_upside_down_are_known_on_both_sides() {
        let symmetric = |side: fn(Shape) -> Relief| -> String {
            ('A'..='Z').filter(|c| order(&side(glyph(*c, 32.0, 40.0).unwrap())) == Some(2)).collect()
        };
        // This font draws H, S, X and Z a little heavier at the foot: their halves differ.
        assert_eq!(symmetric(Relief::peg), "INO");
        assert_eq!(symmetric(|outline| Relief::hole(outline, 0.15)), "INO");
    }

    #[test]
    fn polygons_gears_and_circles_have_their_own_order_about_their_own_centre() {
        for n in [3, 5, 7, 11] {
            let found = Relief::peg(polar(n, |_| 5.0)).symmetry();
            assert_eq!(found.order, Some(n));
            assert!((found.centre_mm[0] - 0.4).abs() < 0.02 && (found.centre_mm[1] + 0.2).abs() < 0.02, "{found:?}");
        }
        // No corner at a tooth's flank.
        let gear = |teeth: f64| polar(720, move |angle| 5.0 + 0.5 * (teeth * (angle + 0.004)).sin().signum());
        assert_eq!([order(&Relief::peg(gear(9.0))), order(&Relief::hole(gear(10.0), 0.15))], [Some(9), Some(10)]);
        assert_eq!(order(&Relief::peg(polar(180, |_| 5.0))), None);
        assert_eq!(order(&Relief::hole(polar(180, |_| 5.0), 0.15)), None);
        // Nearly round is not round: radii 5 % apart.
        assert_eq!(order(&Relief::peg(polar(360, |angle| 5.0 + 0.25 * (2.0 * angle).cos()))), Some(2));
    }

    #[test]
    fn a_notch_breaks_what_it_breaks() {
        let disc = |notches: usize| {
            let width = 0.06;
            polar(720, move |angle| {
                let of_notch = |k: usize| (angle - TAU * k as f64 / 4.0 - 0.3).abs() < width;
                if (0..notches).any(of_notch) { 4.4 } else { 5.0 }
            })
        };
        // 0.6 x 0.6 mm of a disc of 79 mm2: less than 1 %.
        assert_eq!(order(&Relief::peg(disc(1))), Some(1));
        assert_eq!(order(&Relief::peg(disc(4))), Some(4));
    }

    #[test]
    fn a_step_tells_the_halves_of_a_square_apart() {
        let square = rectangle([-3.0, -3.0, 3.0, 3.0]);
        let upper = rectangle([-3.0, -3.0, 3.0, 0.0]);
        let layer = |outline: &Shape, drop_mm| Layer::Face(Face { drop_mm, ..Face::of(outline.clone()) });
        let stepped = |drop_mm| Relief { layers: vec![layer(&upper, 0.0), layer(&square, drop_mm)] };
        assert_eq!([order(&stepped(0.0)), order(&stepped(0.5))], [Some(4), Some(1)]);
    }

    #[test]
    fn a_measured_surface_is_judged_by_its_heights() {
        let map = |height: fn(f64, f64) -> f64| {
            let at = |i: usize| (i as f64 - 29.5) * 0.1;
            let heights: Vec<f32> = (0..3_600).map(|i| height(at(i % 60), at(i / 60)) as f32).collect();
            Relief { layers: vec![Layer::Heights(HeightMap::new([60, 60], [0.1, 0.1], &heights).unwrap())] }
        };
        assert_eq!(order(&map(|x, y| 0.1 * x * y)), Some(2));
        assert_eq!(order(&map(|x, _| 0.2 * x)), Some(1));
    }
}

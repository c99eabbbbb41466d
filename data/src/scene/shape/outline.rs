//! Random closed outlines, each of its seed and number: parts that nobody drew.
//!
//! Every contour is given by its distance from one middle in each direction, so that it never crosses itself. No outline
//! looks the same after a turn: corners are uneven, a gear misses a tooth, a ring's notches are unevenly spaced.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

use super::{Contour, Shape};
use crate::scene::random::{frame_rng, uniform};

/// Straight pieces of a smooth outline.
const SMOOTH_PIECES: usize = 96;

/// Straight pieces of a circle's quarter between corners of a ring or a gear.
const ARC_RAD: f64 = TAU / 96.0;

/// Kinds of outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A smooth closed curve.
    Blob,
    /// A polygon of four to eight corners.
    Polygon,
    /// A star of four to seven uneven points.
    Star,
    /// A gear of seven to ten teeth, less one, sometimes with a hole for its axle.
    Gear,
    /// A ring with one to three notches.
    NotchedRing,
}

impl Kind {
    /// All of them.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Its name in a part's.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The kind of outline number `index`: one after the other.
    pub fn of(index: usize) -> Self {
        Self::ALL[index % Self::ALL.len()]
    }
}

/// Outline number `index` of a seed, centred on its own box, whose longer side is between the two of `size_mm`.
pub fn outline(seed: u64, index: usize, size_mm: [f64; 2]) -> Shape {
    let rng = &mut frame_rng(seed, index as u64);
    let long_mm = uniform(rng, size_mm);
    outline_of(Kind::of(index), long_mm, rng)
}

/// An outline of a kind, centred on its own box, whose longer side is `long_mm`.
pub(super) fn outline_of(kind: Kind, long_mm: f64, rng: &mut ChaCha8Rng) -> Shape {
    let contours = match kind {
        Kind::Blob => vec![blob(rng)],
        Kind::Polygon => vec![polygon(rng)],
        Kind::Star => vec![star(rng)],
        Kind::Gear => gear(rng),
        Kind::NotchedRing => notched_ring(rng),
    };
    // Slender outlines are as common as round ones; a squeezed contour still does not cross itself.
    let squeeze = match kind {
        Kind::Blob | Kind::Polygon | Kind::Star => uniform(rng, [0.6, 1.0]),
        Kind::Gear | Kind::NotchedRing => 1.0,
    };
    let turn_rad = uniform(rng, [0.0, TAU]);
    let (sin, cos) = turn_rad.sin_cos();
    let drawn = Shape { regions: vec![contours] }
        .map(|[x, y]| [x, squeeze * y])
        .map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]);
    drawn.scaled_to(long_mm)
}

/// Name of outline number `index`: `gear-3`.
pub fn name(index: usize) -> String {
    format!("{}-{index}", Kind::of(index).name())
}

fn at(angle_rad: f64, radius: f64) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [radius * cos, radius * sin]
}

/// A circle that is bent by waves of two to five to the turn, all together by less than half of its radius.
fn blob(rng: &mut ChaCha8Rng) -> Contour {
    let waves: Vec<(f64, f64, f64)> =
        (2..=5).map(|n| (f64::from(n), uniform(rng, [0.05, 0.4]) / f64::from(n), uniform(rng, [0.0, TAU]))).collect();
    let radius =
        |angle: f64| 1.0 + waves.iter().map(|(n, height, phase)| height * (n * angle + phase).cos()).sum::<f64>();
    let angles = (0..SMOOTH_PIECES).map(|i| TAU * i as f64 / SMOOTH_PIECES as f64);
    angles.map(|angle| at(angle, radius(angle))).collect()
}

/// `n` directions, evenly spaced but for a third of a step either way.
fn uneven(rng: &mut ChaCha8Rng, n: usize) -> Vec<f64> {
    (0..n).map(|i| TAU * (i as f64 + uniform(rng, [-0.3, 0.3])) / n as f64).collect()
}

fn polygon(rng: &mut ChaCha8Rng) -> Contour {
    let n = rng.random_range(4..=8);
    uneven(rng, n).into_iter().map(|angle| at(angle, uniform(rng, [0.6, 1.0]))).collect()
}

fn star(rng: &mut ChaCha8Rng) -> Contour {
    let n = rng.random_range(4..=7_usize);
    let inner = uniform(rng, [0.35, 0.6]);
    let corner = |(i, angle): (usize, f64)| {
        let radius = if i % 2 == 0 { uniform(rng, [0.75, 1.0]) } else { inner };
        at(angle, radius)
    };
    let step = TAU / (2 * n) as f64;
    (0..2 * n).map(|i| step * i as f64).enumerate().map(corner).collect()
}

/// Points on a circle from one direction to another, both included.
fn arc(from_rad: f64, to_rad: f64, radius: f64) -> impl Iterator<Item = [f64; 2]> {
    let n = ((to_rad - from_rad) / ARC_RAD).ceil().max(1.0) as usize;
    (0..=n).map(move |i| at(from_rad + (to_rad - from_rad) * i as f64 / n as f64, radius))
}

fn gear(rng: &mut ChaCha8Rng) -> Vec<Contour> {
    let n = rng.random_range(7..=10_usize);
    let (root, share) = (uniform(rng, [0.65, 0.8]), uniform(rng, [0.4, 0.6]));
    let axle = rng.random_bool(0.5).then(|| uniform(rng, [0.2, 0.4]));
    let step = TAU / n as f64;
    let tooth = |i: usize| {
        let [start, end, next] = [0.0, share, 1.0].map(|part| step * (i as f64 + part));
        // The first is missing.
        let tip = if i == 0 { root } else { 1.0 };
        arc(start, end, tip).chain(arc(end, next, root))
    };
    let outside = (0..n).flat_map(tooth).collect();
    std::iter::once(outside).chain(axle.map(|radius| arc(0.0, TAU - ARC_RAD, radius).collect())).collect()
}

fn notched_ring(rng: &mut ChaCha8Rng) -> Vec<Contour> {
    let n = rng.random_range(1..=3_usize);
    let (inner, floor) = (uniform(rng, [0.35, 0.55]), uniform(rng, [0.7, 0.85]));
    // Each notch begins in the first half of its share of the turn.
    let notches: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let start = TAU * (i as f64 + uniform(rng, [0.05, 0.5])) / n as f64;
            [start, start + uniform(rng, [0.25, 0.45])]
        })
        .collect();
    let ends = notches.iter().skip(1).map(|notch| notch[0]).chain([notches[0][0] + TAU]);
    let outside =
        notches.iter().zip(ends).flat_map(|([start, end], next)| arc(*start, *end, floor).chain(arc(*end, next, 1.0)));
    vec![outside.collect(), arc(0.0, TAU - ARC_RAD, inner).collect()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::crossing::{area_mm2, first_crossing};
    use crate::scene::shape::{Raster, Relief};

    #[test]
    fn outlines_are_simple_of_the_size_asked_for_and_centred() {
        for index in 0..100 {
            let shape = outline(7, index, [8.0, 14.0]);
            let [x_min, y_min, x_max, y_max] = shape.bounds();
            let long_mm = (x_max - x_min).max(y_max - y_min);
            assert!((8.0..=14.0).contains(&long_mm), "{}: {long_mm}", name(index));
            assert!((x_max + x_min).abs() < 1e-9 && (y_max + y_min).abs() < 1e-9, "{}", name(index));
            assert_eq!(first_crossing(&shape.regions[0]), None, "{} crosses itself", name(index));
        }
    }

    #[test]
    fn areas_are_those_of_the_polygons_and_counters_are_open() {
        for index in 0..40 {
            let shape = outline(3, index, [10.0, 10.0]);
            let expected = area_mm2(&shape.regions[0]);
            let covered = Raster::coverage(&shape, 6.0, 0.05);
            let area: f64 = covered.values.iter().map(|share| f64::from(*share) * 0.05 * 0.05).sum();
            assert!((area / expected - 1.0).abs() < 0.01, "{}: {area}, not {expected}", name(index));
            // Neither a splinter nor all of its box.
            assert!((0.15..0.95).contains(&(area / 100.0)), "{}: {area}", name(index));
        }
    }

    #[test]
    fn no_outline_looks_the_same_after_half_a_turn_and_no_two_alike() {
        let shapes: Vec<Shape> = (0..40).map(|index| outline(5, index, [12.0, 12.0])).collect();
        for (index, shape) in shapes.iter().enumerate() {
            assert!(!Relief::peg(shape.clone()).symmetry().is_any(), "{}", name(index));
            assert!(shapes[..index].iter().all(|other| other != shape), "{}", name(index));
        }
        assert_ne!(outline(6, 0, [12.0, 12.0]), shapes[0]);
        assert_eq!(outline(5, 0, [12.0, 12.0]), shapes[0]);
    }
}

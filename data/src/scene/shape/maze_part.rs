//! MAZE parts: crops of MAZE boards, islands, blobs, polygons, stars, gears and notched rings in turn.
//!
//! Unlike [`outline`]s, crops and islands have several pieces and may look the same after a turn.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::clip::clipped;
use super::crossing::{area_mm2, signed_area};
use super::island::islands;
use super::maze::{MazeSpec, draw};
use super::outline::{self, outline_of};
use super::raster::sides;
use super::{Contour, Raster, Shape};
use crate::error::{Error, Result};
use crate::scene::random::{frame_rng, uniform};

/// Kinds of part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Crop,
    Islands,
    Outline(outline::Kind),
}

/// A part that cannot be touched well is drawn again, so often at most.
const MOST_DRAWS: usize = 1000;

/// Least and greatest share of a crop's window that is filled. A fuller crop is its window, an emptier one is dust.
const FILLED_SHARE: [f64; 2] = [0.1, 0.85];

/// Least share of the box of a part that is filled.
const LEAST_OF_BOX: f64 = 0.1;

/// Least width of a piece, mm. The gel shows no sliver.
const LEAST_WIDTH_MM: f64 = 0.8;

/// Least area of a piece, mm^2. A smaller piece is dust.
const LEAST_AREA_MM2: f64 = 2.0;

/// Least length of a crop, as a share of its window's: it is scaled to the window's length.
const LEAST_LENGTH_SHARE: f64 = 0.8;

/// Rows and columns of islands.
const LAYOUTS: [[usize; 2]; 4] = [[1, 1], [1, 2], [1, 3], [2, 2]];

/// What sets the seeds of MAZE parts apart from those of other outlines.
const SEED: u64 = 0x70_6172_7473;

impl Kind {
    /// One kind after the other.
    fn of(index: usize) -> Self {
        match index % (2 + outline::Kind::ALL.len()) {
            0 => Self::Crop,
            1 => Self::Islands,
            at => Self::Outline(outline::Kind::ALL[at - 2]),
        }
    }
}

/// Name of part number `index`: `crop-0`, `islands-8`, `star-18`.
pub fn name(index: usize) -> String {
    let kind = match Kind::of(index) {
        Kind::Crop => "crop",
        Kind::Islands => "islands",
        Kind::Outline(kind) => kind.name(),
    };
    format!("{kind}-{index}")
}

/// What draws part number `index` of a seed, one generator for each of up to three uses of it (0 to 2).
///
/// A MAZE board that is trained on is drawn from stream 0 of a generator ([`maze`](super::maze::maze)), a part from a
/// later stream. Two streams of ChaCha have no block in common, also where two seeds are the same; so no part is cut from
/// a board that is trained on, for any seeds.
pub(crate) fn part_rng(seed: u64, index: usize, usage: u64) -> ChaCha8Rng {
    frame_rng(seed ^ SEED, 1 + 3 * index as u64 + usage)
}

/// Part number `index` of a seed, centred on its own box, whose longer side is between the two of `size_mm`, drawn
/// log-uniformly.
///
/// # Errors
/// No part of that size in a thousand draws: sizes of less than a few mm.
pub fn maze_part(seed: u64, index: usize, size_mm: [f64; 2]) -> Result<Shape> {
    let rng = &mut part_rng(seed, index, 0);
    let long_mm = uniform(rng, size_mm.map(f64::ln)).exp();
    let drawn = |_| match Kind::of(index) {
        Kind::Crop => crop(long_mm, rng),
        Kind::Islands => a_few_islands(long_mm, rng),
        Kind::Outline(kind) => Some(outline_of(kind, long_mm, rng)),
    };
    let fills_its_box = |shape: &Shape| {
        let [x_min, y_min, x_max, y_max] = shape.bounds();
        covered_mm2(shape, long_mm) >= LEAST_OF_BOX * (x_max - x_min) * (y_max - y_min)
    };
    (0..MOST_DRAWS).filter_map(drawn).find(fills_its_box).ok_or_else(|| {
        let expected = format!("a size at which one of {MOST_DRAWS} draws can be touched");
        Error::invalid(name(index), expected, format!("{long_mm:.1} mm"))
    })
}

/// Least depth of what is cut off, mm. A gel hardly shows that less is missing.
const LEAST_CUT_MM: f64 = 2.0;

/// Halvings by which a cut's place is found: to a billionth of the part.
const HALVINGS: usize = 30;

/// What sets the seeds of cuts apart from those of parts.
const CUT_SEED: u64 = 0x63_7574;

/// A part without what is beyond a straight line, centred on its own box: it has the rest in common with the whole part, as an F has with an
/// E. Part number `index` of a seed; what is cut off is a share of its area between the two of `share`, and 2 mm deep at least.
///
/// # Errors
/// No such cut in a thousand draws that leaves neither a sliver nor dust: a part of a few mm.
pub fn cut_part(whole: &Shape, seed: u64, index: usize, share: [f64; 2]) -> Result<Shape> {
    let rng = &mut frame_rng(seed ^ CUT_SEED, 1 + index as u64);
    let area = |shape: &Shape| shape.regions.iter().map(|region| area_mm2(region)).sum::<f64>();
    let drawn = |_| {
        let direction = uniform(rng, [0.0, TAU]);
        let left_mm2 = (1.0 - uniform(rng, share)) * area(whole);
        let (sin, cos) = direction.sin_cos();
        let along = whole.regions.iter().flatten().flatten().map(|[x, y]| cos * x + sin * y);
        let [low, high] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        let [mut below, mut above] = [low, high];
        for _ in 0..HALVINGS {
            let middle = 0.5 * (below + above);
            *if area(&without(whole, direction, middle)) < left_mm2 { &mut below } else { &mut above } = middle;
        }
        let left = without(whole, direction, above);
        let is_good = high - above >= LEAST_CUT_MM && !left.regions.is_empty();
        (is_good && left.regions.iter().flatten().all(is_thick)).then(|| left.centred())
    };
    (0..MOST_DRAWS).find_map(drawn).ok_or_else(|| {
        let expected = format!("a part that one of {MOST_DRAWS} cuts of {LEAST_CUT_MM} mm or more leaves whole");
        Error::invalid(name(index), expected, "none")
    })
}

/// What sets the seeds of stretches apart from those of parts.
const STRETCH_SEED: u64 = 0x73_7472;

/// A part stretched along x, along y or along both, each as likely, about its middle: it is a stranger of another size, as a pin is to one a
/// millimetre thicker. Part number `index` of a seed; it is longer by between the two of `mm`.
pub fn stretched_part(whole: &Shape, seed: u64, index: usize, mm: [f64; 2]) -> Shape {
    let rng = &mut frame_rng(seed ^ STRETCH_SEED, 1 + index as u64);
    let [x_min, y_min, x_max, y_max] = whole.bounds();
    let which = rng.random_range(0..3);
    let by = uniform(rng, mm);
    let along = |size: f64, is_fixed: bool| if is_fixed { 1.0 } else { 1.0 + by / size };
    let (x, y) = (along(x_max - x_min, which == 1), along(y_max - y_min, which == 0));
    whole.clone().map(|[u, v]| [x * u, y * v])
}

/// What sets the seeds of bars apart from those of parts.
const BAR_SEED: u64 = 0x62_6172;

/// How much longer than wide a bar is.
const BAR_LENGTHS: [f64; 2] = [1.5, 3.0];

/// Least share of a bar that is beyond the part.
const BAR_SHARE: f64 = 0.7;

/// A part with a bar added at a place of its outline, each as likely, centred on its own box: it has the rest in common with the
/// part, as an E has with an F. Part number `index` of a seed; the bar is between the two of `width_mm` wide and 1.5 to 3 times as long.
///
/// # Errors
/// No such bar in a thousand draws.
pub fn barred_part(whole: &Shape, seed: u64, index: usize, width_mm: [f64; 2]) -> Result<Shape> {
    let rng = &mut frame_rng(seed ^ BAR_SEED, 1 + index as u64);
    let all: Vec<[[f64; 2]; 2]> = whole.regions.iter().flat_map(|region| sides(region)).collect();
    let length = |[a, b]: &[[f64; 2]; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
    let total = all.iter().map(length).sum::<f64>();
    let drawn = |_| {
        let mut along = uniform(rng, [0.0, total]);
        let width = uniform(rng, width_mm);
        let long = width * uniform(rng, BAR_LENGTHS);
        let [a, b] = *all.iter().find(|side| {
            along -= length(side);
            along < 0.0
        })?;
        let mm = length(&[a, b]);
        let [u, v] = [(b[0] - a[0]) / mm, (b[1] - a[1]) / mm];
        let root = [b[0] + along * u, b[1] + along * v];
        // Outwards of the two directions across the side.
        let across = |sign: f64| [-sign * v, sign * u];
        let off = |[x, y]: [f64; 2], by: f64| [root[0] + by * x, root[1] + by * y];
        let out = [1.0, -1.0]
            .map(across)
            .into_iter()
            .find(|out| !whole.contains(off(*out, 0.02)) && whole.contains(off(*out, -0.02)))?;
        let corner = |side: f64, end: f64| [0, 1].map(|axis| off(out, end)[axis] + 0.5 * side * width * [u, v][axis]);
        let bar = vec![corner(-1.0, -0.5 * width), corner(1.0, -0.5 * width), corner(1.0, long), corner(-1.0, long)];
        let mut grown = whole.clone();
        grown.regions.push(vec![bar]);
        let reach = 2.0 * grown.bounds().into_iter().fold(0.0, |most: f64, mm| most.max(mm.abs()));
        let more_mm2 = covered_mm2(&grown, reach) - covered_mm2(whole, reach);
        (more_mm2 >= BAR_SHARE * width * long).then(|| grown.centred())
    };
    (0..MOST_DRAWS).find_map(drawn).ok_or_else(|| {
        let expected = format!("a part beyond which one of {MOST_DRAWS} bars reaches");
        Error::invalid(name(index), expected, "none")
    })
}

/// What is nearer than `end_mm` along a direction.
fn without(whole: &Shape, direction: f64, end_mm: f64) -> Shape {
    let (sin, cos) = direction.sin_cos();
    let reach = 2.0 * whole.bounds().into_iter().fold(0.0, |most: f64, mm| most.max(mm.abs()));
    // Beyond the part on three sides; the corners turn from x to y.
    let corners = [[-reach, -reach], [end_mm, -reach], [end_mm, reach], [-reach, reach]];
    let window = corners.map(|[u, v]| [cos * u - sin * v, sin * u + cos * v]).to_vec();
    let regions = whole.regions.iter().map(|region| clipped(region.clone(), &window));
    Shape { regions: regions.filter(|region| !region.is_empty()).collect() }
}

/// What a window shows of the walls of a MAZE board; `None` where it shows too much or too little, or only one side of the
/// window has walls.
fn crop(long_mm: f64, rng: &mut ChaCha8Rng) -> Option<Shape> {
    let spec = MazeSpec::default();
    // A small window on a coarse board shows one straight edge.
    let pitch_mm = [0.5, 1.0].map(|share| share * long_mm);
    let spec = MazeSpec {
        side_mm: spec.side_mm.max(2.0 * long_mm),
        pitch_mm: [0, 1].map(|end| spec.pitch_mm[end].min(pitch_mm[end])),
        island_share: 0.0,
        ..spec
    };
    let board = draw(&spec, rng);
    let window = window(long_mm, rng);
    // A window is nowhere further from its middle than this share of its length.
    let room_mm = 0.5 * spec.side_mm - 0.71 * long_mm;
    let [x, y] = [0, 1].map(|_| uniform(rng, [-room_mm, room_mm]));
    let (sin, cos) = uniform(rng, [0.0, TAU]).sin_cos();
    let board = board.map(|[px, py]| [cos * (px - x) - sin * (py - y), sin * (px - x) + cos * (py - y)]);
    let pieces = board.regions.into_iter().flat_map(|wall| clipped(wall, &window)).filter(is_thick);
    let shape = Shape { regions: pieces.map(|piece| vec![piece]).collect() };
    let filled = covered_mm2(&shape, long_mm) / signed_area(&window);
    let [x_min, y_min, x_max, y_max] = shape.bounds();
    let is_long = (x_max - x_min).max(y_max - y_min) >= LEAST_LENGTH_SHARE * long_mm;
    (is_long && (FILLED_SHARE[0]..FILLED_SHARE[1]).contains(&filled)).then(|| shape.scaled_to(long_mm))
}

/// A rectangle or an oval, turned by any angle, whose box is `long_mm` long and centred.
fn window(long_mm: f64, rng: &mut ChaCha8Rng) -> Contour {
    let n_corners = if rng.random_bool(0.5) { 4 } else { 32 };
    let squeeze = uniform(rng, [0.5, 1.0]);
    let (sin, cos) = uniform(rng, [0.0, TAU]).sin_cos();
    let corner = |i: usize| {
        let (y, x) = (TAU * (i as f64 + 0.5) / n_corners as f64).sin_cos();
        [cos * x - sin * squeeze * y, sin * x + cos * squeeze * y]
    };
    let drawn = Shape { regions: vec![vec![(0..n_corners).map(corner).collect()]] };
    drawn.scaled_to(long_mm).regions.into_iter().flatten().flatten().collect()
}

/// One to four islands, as on a MAZE board; `None` where one is a sliver.
fn a_few_islands(long_mm: f64, rng: &mut ChaCha8Rng) -> Option<Shape> {
    let [n_rows, n_columns] = LAYOUTS[rng.random_range(0..LAYOUTS.len())];
    let nodes: Vec<[f64; 2]> =
        (0..n_rows * n_columns).map(|i| [i % n_columns, i / n_columns].map(|k| k as f64)).collect();
    let drawn = islands(&nodes, 1.0, rng);
    if drawn.regions.is_empty() {
        return None;
    }
    let shape = drawn.scaled_to(long_mm);
    shape.regions.iter().flatten().all(is_thick).then_some(shape)
}

/// Whether a piece is neither a sliver nor dust.
fn is_thick(piece: &Contour) -> bool {
    signed_area(piece).abs() >= LEAST_AREA_MM2 && width_mm(std::slice::from_ref(piece)) >= LEAST_WIDTH_MM
}

/// Width of a region as that of a strip of the same area and the same length of its sides, mm.
pub(crate) fn width_mm(region: &[Contour]) -> f64 {
    let length_mm: f64 = sides(region).map(|[a, b]| (b[0] - a[0]).hypot(b[1] - a[1])).sum();
    2.0 * area_mm2(region) / length_mm
}

/// Area of a shape whose pieces overlap, mm^2, of a part that is `long_mm` long and nearly centred.
fn covered_mm2(shape: &Shape, long_mm: f64) -> f64 {
    let cell_mm = long_mm / 100.0;
    let covered = Raster::coverage(shape, 0.5 * long_mm, cell_mm);
    covered.values.iter().map(|share| f64::from(*share)).sum::<f64>() * cell_mm * cell_mm
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::crossing::first_crossing;
    use crate::scene::shape::maze::maze;
    use std::collections::HashSet;

    const SIZE_MM: [f64; 2] = [8.0, 40.0];

    #[test]
    fn a_part_follows_from_seed_and_number_and_no_two_are_alike() {
        let drawn = |seed| (0..140).map(move |index| maze_part(seed, index, SIZE_MM).unwrap());
        let (all, others): (Vec<Shape>, Vec<Shape>) = (drawn(1).collect(), drawn(2).collect());
        assert_eq!(maze_part(1, 77, SIZE_MM).unwrap(), all[77]);
        for (i, shape) in all.iter().enumerate() {
            assert!(!all[..i].contains(shape) && !others.contains(shape), "{}", name(i));
        }
    }

    #[test]
    fn kinds_are_equally_common_and_sizes_too_in_each_octave() {
        let kinds = |kind: &str| (0..300).filter(|index| name(*index).starts_with(kind)).count();
        for kind in ["crop-", "islands-", "blob-", "polygon-", "star-", "gear-", "notched-ring-"] {
            assert!((42..=43).contains(&kinds(kind)), "{kind}");
        }
        let long_mm = |index| {
            let shape = maze_part(3, index, SIZE_MM).unwrap();
            assert!(shape.regions.iter().all(|region| first_crossing(region).is_none()), "{}", name(index));
            let [x_min, y_min, x_max, y_max] = shape.bounds();
            assert!((x_min + x_max).abs() < 1e-9 && (y_min + y_max).abs() < 1e-9, "{}", name(index));
            (x_max - x_min).max(y_max - y_min)
        };
        let sizes: Vec<f64> = (0..300).map(long_mm).collect();
        assert!(sizes.iter().all(|mm| (8.0 - 1e-9..=40.0 + 1e-9).contains(mm)));
        // Half of them are below the geometric mean; four standard errors.
        let small = sizes.iter().filter(|mm| **mm < 320.0_f64.sqrt()).count();
        assert!((small as f64 / 300.0 - 0.5).abs() < 0.116, "{small}");
    }

    #[test]
    fn no_board_is_one_that_is_trained_on() {
        let spec = MazeSpec::default();
        let key = |board: &Shape| board.regions[0][0][0].map(f64::to_bits);
        let mut trained = HashSet::new();
        for seed in [1, 2, 3, 20_261_201, 20_261_202, 20_261_203] {
            let boards = (0..480).map(|part| maze(&spec, u64::wrapping_mul(seed, 1_000_003).wrapping_add(part)));
            trained.extend(boards.map(|board| key(&board)));
        }
        for seed in [1, 20_261_201, 20_261_202, 20_261_203] {
            for index in 0..300 {
                let rng = &mut part_rng(seed, index, 0);
                let _size_mm = uniform(rng, SIZE_MM);
                assert!((0..3).all(|_| !trained.contains(&key(&draw(&spec, rng)))), "{seed} {index}");
            }
        }
        // Boards of stream 0 would be found.
        assert!(trained.contains(&key(&draw(&spec, &mut frame_rng(1_000_003 + 7, 0)))));
        assert!(!trained.contains(&key(&draw(&spec, &mut frame_rng(1_000_003 + 7, 1)))));
    }

    #[test]
    fn a_size_at_which_each_piece_is_dust_is_refused() {
        let error = maze_part(1, 0, [1.0, 1.0]).unwrap_err().to_string();
        assert!(error.starts_with("crop-0: expected a size at which") && error.ends_with("got 1.0 mm"), "{error}");
    }
}

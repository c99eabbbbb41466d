//! MAZE parts as a scene declares them.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::part::Part;
use super::parts::MOST_PARTS;
use super::side_shares::{MOST_FALL_MM, SideShares};
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::scene::random::uniform;
use crate::scene::shape::maze_part::{barred_part, cut_part, maze_part, name, part_rng, stretched_part, width_mm};
use crate::scene::shape::{Face, Layer, Relief, Rounding};

/// Parts without end, drawn as MAZE boards are and never trained on: crops of boards, islands and outlines in turn, see
/// [`maze_part`](crate::scene::shape::maze_part). On top of an outline, holes may be rims instead of openings in a plate and pegs
/// shells, both with or without a core and with sharp or rounded edges.
///
/// A part follows from the seed and its number alone. A peg goes into its hole by their outlines; a core, which the gel
/// feels, is drawn for each side alone as on MAZE boards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MazeParts {
    /// How many.
    pub n: usize,
    /// Number of the first part; parts before it are left out.
    #[serde(default, skip_serializing_if = "is_first")]
    pub first: usize,
    /// What draws them.
    pub seed: u64,
    /// Least and greatest length of the longer side, mm, drawn log-uniformly.
    pub size_mm: [f64; 2],
    /// Least and greatest play of a hole on every side, mm, drawn for each part; without it the scene's clearance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub play_mm: Option<[f64; 2]>,
    /// With it each part comes twice: whole, and then without what is beyond a straight line, which is a share of its area
    /// between these two ([`cut_part`]). Each of the two is a stranger that has the rest in common with the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut_share: Option<[f64; 2]>,
    /// The same with a bar added to the outline, between the two of these wide, mm ([`barred_part`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bar_mm: Option<[f64; 2]>,
    /// The same stretched along x, along y or along both, by between these two, mm ([`stretched_part`]): a stranger of another size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch_mm: Option<[f64; 2]>,
}

/// Which of the two that a part comes as.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Whole,
    /// Without a share of its area.
    Cut([f64; 2]),
    /// With a bar of a width, mm.
    Barred([f64; 2]),
    /// Longer by so much, mm.
    Stretched([f64; 2]),
}

fn is_first(first: &usize) -> bool {
    *first == 0
}

/// Sides of MAZE parts are drawn as those of the boards that the shipped model was trained on; no rim or shell is thinner
/// than the gel shows.
const SHARES: SideShares =
    SideShares { band: 0.5, band_mm: [0.3, 2.5], core: 0.4, rounded: 0.3, most_fall_mm: MOST_FALL_MM };

/// The most parts before the first.
const MOST_BEFORE: usize = 1_000_000;

/// The same side with edges that are rounded up to the middle of each face at most, where its narrowest piece is
/// `width_mm` wide: a rim that is narrower than its rounding would fall away from the gel.
fn touchable(mut side: Relief, width_mm: f64) -> Relief {
    for layer in &mut side.layers {
        let Layer::Face(Face { outside, band_mm, rounding: Some(rounding), .. }) = layer else { continue };
        let face_mm = band_mm.unwrap_or(if *outside { f64::INFINITY } else { width_mm });
        let share = (0.5 * face_mm / rounding.width_mm).min(1.0);
        *rounding = Rounding { width_mm: share * rounding.width_mm, fall_mm: share * rounding.fall_mm };
    }
    side
}

impl MazeParts {
    /// Numbers of the parts.
    pub(super) fn range(&self) -> Range<usize> {
        self.first..self.first.saturating_add(self.n)
    }

    /// What is drawn as the part of a number.
    fn drawn(&self, index: usize) -> (usize, Kind) {
        let Some(changed) = self.changes().into_iter().flatten().next() else { return (index, Kind::Whole) };
        (index / 2, if index.is_multiple_of(2) { Kind::Whole } else { changed })
    }

    /// The ways in which a part comes a second time; one at most is declared.
    fn changes(&self) -> [Option<Kind>; 3] {
        [self.cut_share.map(Kind::Cut), self.bar_mm.map(Kind::Barred), self.stretch_mm.map(Kind::Stretched)]
    }

    /// Name of the part of a number: `gear-5`, `gear-5-cut`.
    pub(super) fn name(&self, index: usize) -> String {
        let (index, kind) = self.drawn(index);
        let ending = match kind {
            Kind::Whole => "",
            Kind::Cut(_) => "-cut",
            Kind::Barred(_) => "-bar",
            Kind::Stretched(_) => "-longer",
        };
        format!("{}{ending}", name(index))
    }

    /// The part of a number.
    pub(super) fn part(&self, index: usize, clearance_mm: f64) -> Result<Part> {
        let (index, kind) = self.drawn(index);
        let outline = maze_part(self.seed, index, self.size_mm)?;
        let outline = match kind {
            Kind::Whole => outline,
            Kind::Cut(share) => cut_part(&outline, self.seed, index, share)?,
            Kind::Barred(width_mm) => barred_part(&outline, self.seed, index, width_mm)?,
            Kind::Stretched(mm) => stretched_part(&outline, self.seed, index, mm),
        };
        let [mut of_hole, mut of_peg] = [1, 2].map(|usage| part_rng(self.seed, index, usage));
        let clearance_mm = self.play_mm.map_or(clearance_mm, |play_mm| uniform(&mut of_hole, play_mm));
        let side = |side, rng| SHARES.side(outline.clone(), side, clearance_mm, rng);
        let width_mm = outline.regions.iter().map(|region| width_mm(region)).fold(f64::INFINITY, f64::min);
        let hole = touchable(side(Side::Hole, &mut of_hole), width_mm);
        let peg = touchable(side(Side::Peg, &mut of_peg), width_mm);
        Ok(Part { taken: outline.clone(), outline, clearance_mm, stands: false, peg, hole })
    }

    /// `n` of these parts, from part number `skipped` of these on.
    ///
    /// # Errors
    /// Parts that are not among these.
    pub fn take(self, skipped: usize, n: usize) -> Result<Self> {
        if n == 0 || skipped.checked_add(n).is_none_or(|end| end > self.n) {
            let expected = format!("N at least 1, FIRST + N at most {}", self.n);
            return Err(Error::invalid("parts.maze_parts", expected, format!("{skipped}+{n}")));
        }
        Ok(Self { first: self.first + skipped, n, ..self })
    }

    /// Refuses parts that cannot be drawn, naming the field.
    pub(super) fn validate(&self) -> Result<()> {
        let refuse = |field: &str, expected: &str, got: String| {
            Err(Error::invalid(format!("parts.maze_parts.{field}"), expected, got))
        };
        if !(1..=MOST_PARTS).contains(&self.n) {
            return refuse("n", &format!("1 to {MOST_PARTS}"), self.n.to_string());
        }
        if self.first > MOST_BEFORE {
            return refuse("first", &format!("0 to {MOST_BEFORE}"), self.first.to_string());
        }
        let ordered = |[low, high]: [f64; 2], least: f64, most: f64| low >= least && high >= low && high <= most;
        let [low, high] = self.size_mm;
        if !ordered(self.size_mm, 5.0, 200.0) {
            return refuse("size_mm", "5 to 200 mm, in order", format!("{low} to {high}"));
        }
        if let Some([low, high]) = self.cut_share.filter(|share| !ordered(*share, 0.0, 0.9)) {
            return refuse("cut_share", "shares of the area, 0 to 0.9, in order", format!("{low} to {high}"));
        }
        if let Some([low, high]) = self.bar_mm.filter(|mm| !ordered(*mm, 0.5, 20.0)) {
            return refuse("bar_mm", "widths of 0.5 to 20 mm, in order", format!("{low} to {high}"));
        }
        if let Some([low, high]) = self.stretch_mm.filter(|mm| !ordered(*mm, 0.0, 20.0)) {
            return refuse("stretch_mm", "lengths of 0 to 20 mm, in order", format!("{low} to {high}"));
        }
        let n_changes = self.changes().into_iter().flatten().count();
        if n_changes > 1 {
            let got = format!("{n_changes} of them");
            let expected = "one of cut_share, bar_mm and stretch_mm";
            return Err(Error::invalid("parts.maze_parts", expected, got));
        }
        match self.play_mm {
            Some(play_mm) if !ordered(play_mm, 0.0, 5.0) => {
                refuse("play_mm", "0 to 5 mm, in order", format!("{} to {}", play_mm[0], play_mm[1]))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;
    use crate::scene::Scene;
    use crate::scene::shape::Shape;
    use crate::scene::shape::maze_part::name;
    use crate::sensor::obstacle::{Cells, obstacle};

    const PARTS: MazeParts = MazeParts {
        n: 300,
        first: 0,
        seed: 1,
        size_mm: [8.0, 40.0],
        play_mm: Some([0.1, 0.4]),
        cut_share: None,
        bar_mm: None,
        stretch_mm: None,
    };

    const CELL_MM: f64 = 0.05;

    /// The cells whose middles are inside, from -`half` to `half` cells, by the even-odd rule, row by row.
    fn cells(shape: &Shape, half: i32) -> Vec<bool> {
        let middle = |i: i32| (f64::from(i) + 0.5) * CELL_MM;
        let mut covered = Vec::new();
        for y in (-half..half).map(middle) {
            let mut row = vec![false; 2 * half as usize];
            for region in &shape.regions {
                let mut crossings = Vec::new();
                for contour in region {
                    let mut last = contour[contour.len() - 1];
                    for &[u, v] in contour {
                        if (v > y) != (last[1] > y) {
                            crossings.push(u + (y - v) * (last[0] - u) / (last[1] - v));
                        }
                        last = [u, v];
                    }
                }
                let is_in = |x: f64| crossings.iter().filter(|crossing| **crossing < x).count() % 2 == 1;
                row.iter_mut().zip(-half..half).for_each(|(cell, x)| *cell |= is_in(middle(x)));
            }
            covered.extend(row);
        }
        covered
    }

    /// Half a raster round a part, in cells.
    fn half_of(shape: &Shape) -> i32 {
        let [.., x_max, y_max] = shape.bounds();
        (x_max.max(y_max) / CELL_MM) as i32 + 20
    }

    /// The steps from a cell to those no further away than `mm`, in a raster of rows of `n` cells.
    fn disc(mm: f64, n: usize) -> Vec<isize> {
        let reach = (mm / CELL_MM) as isize;
        let near = move |x: isize, y: isize| ((x * x + y * y) as f64).sqrt() * CELL_MM <= mm;
        let row = move |y: isize| (-reach..=reach).filter(move |x| near(*x, y)).map(move |x| y * n as isize + x);
        (-reach..=reach).flat_map(row).collect()
    }

    fn any_near(cells: &[bool], at: usize, steps: &[isize], value: bool) -> bool {
        steps.iter().any(|step| at.checked_add_signed(*step).and_then(|i| cells.get(i)) == Some(&value))
    }

    fn count(cells: &[bool]) -> f64 {
        cells.iter().filter(|inside| **inside).count() as f64
    }

    #[test]
    fn every_peg_grown_by_its_play_goes_into_its_hole_and_grown_by_more_does_not() {
        PARTS.range().into_par_iter().for_each(|index| {
            let part = PARTS.part(index, 9.0).unwrap();
            assert!((0.1..=0.4).contains(&part.clearance_mm), "{}", name(index));
            let half = half_of(&part.outline);
            let peg = cells(&part.outline, half);
            // The opening as it is felt where edges are sharp; a core is felt below it.
            let [Layer::Face(opening), ..] = part.hole.layers.as_slice() else { panic!("a face") };
            let opening = Relief { layers: vec![Layer::Face(Face { rounding: None, ..opening.clone() })] };
            let felt = Cells { half_mm: f64::from(half) * CELL_MM - 1e-9, cell_mm: CELL_MM };
            let plate: Vec<bool> =
                obstacle(&[opening], Side::Hole, felt, None, 1.0).values.into_iter().map(|mm| mm > 0.0).collect();
            let is_blocked = |grow_mm: f64| {
                let steps = disc(grow_mm, 2 * half as usize);
                (0..peg.len()).any(|at| peg[at] && any_near(&plate, at, &steps, true))
            };
            // A cell's diagonal on either side.
            assert!(!is_blocked(part.clearance_mm - 0.08) && is_blocked(part.clearance_mm + 0.08), "{}", name(index));
        });
    }

    #[test]
    fn a_tenth_of_the_box_is_filled_and_no_piece_is_a_sliver_or_dust() {
        PARTS.range().into_par_iter().for_each(|index| {
            let outline = PARTS.part(index, 0.1).unwrap().outline;
            let half = half_of(&outline);
            let (inside, n) = (cells(&outline, half), 2 * half as usize);
            let [x_min, y_min, x_max, y_max] = outline.bounds();
            let share = count(&inside) * CELL_MM * CELL_MM / ((x_max - x_min) * (y_max - y_min));
            assert!(share >= 0.095, "{}: {share}", name(index));
            // What a disc of 0.3 mm reaches from inside.
            let steps = disc(0.15, n);
            let core: Vec<bool> = (0..n * n).map(|at| inside[at] && !any_near(&inside, at, &steps, false)).collect();
            let opened: Vec<bool> = (0..n * n).map(|at| inside[at] && any_near(&core, at, &steps, true)).collect();
            let lost = 1.0 - count(&opened) / count(&inside);
            assert!(lost < 0.03, "{}: {lost} is narrower than 0.3 mm", name(index));
            // Fewer cells than these are the end of an acute corner.
            for piece in pieces(&inside, n).into_iter().filter(|piece| piece.len() > 20) {
                let kept = piece.iter().filter(|at| core[**at]).count() as f64 * CELL_MM * CELL_MM;
                assert!(kept > 0.5, "{}: a piece of {kept} mm^2", name(index));
            }
        });
    }

    /// The cells of each connected piece.
    fn pieces(inside: &[bool], n: usize) -> Vec<Vec<usize>> {
        let (mut open, mut pieces) = (inside.to_vec(), Vec::new());
        while let Some(first) = open.iter().position(|inside| *inside) {
            open[first] = false;
            let (mut stack, mut piece) = (vec![first], Vec::new());
            while let Some(at) = stack.pop() {
                piece.push(at);
                for next in [at - 1, at + 1, at - n, at + n] {
                    if std::mem::take(&mut open[next]) {
                        stack.push(next);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    #[test]
    fn a_cut_part_is_its_whole_less_a_tenth_to_a_half() {
        let parts = MazeParts { n: 120, cut_share: Some([0.1, 0.5]), size_mm: [10.0, 40.0], ..PARTS };
        assert_eq!([4, 5].map(|index| parts.name(index)), ["blob-2", "blob-2-cut"]);
        let whole_alone = MazeParts { cut_share: None, ..parts };
        parts.range().into_par_iter().filter(|index| index % 2 == 1).for_each(|index| {
            let [whole, cut] = [index - 1, index].map(|index| parts.part(index, 0.1).unwrap());
            let name = parts.name(index);
            assert_eq!(whole.outline, whole_alone.part(index / 2, 0.1).unwrap().outline, "{name}");
            assert_eq!(whole.clearance_mm, cut.clearance_mm, "{name}");
            let half = half_of(&whole.outline);
            let n = 2 * half as usize;
            let all = cells(&whole.outline, half);
            // Where the cut one lies in the whole is not known: where most of its corners are corners of the whole.
            let corners = |shape: &Shape| shape.regions.iter().flatten().flatten().copied().collect::<Vec<_>>();
            let (of_whole, of_cut) = (corners(&whole.outline), corners(&cut.outline));
            let n_met = |[x, y]: [f64; 2]| {
                let is_met = |[u, v]: &[f64; 2]| of_whole.iter().any(|[a, b]| (u + x - a).hypot(v + y - b) < 1e-6);
                of_cut.iter().filter(|corner| is_met(corner)).count()
            };
            let shifts = of_cut.iter().take(8).flat_map(|[u, v]| of_whole.iter().map(move |[a, b]| [a - u, b - v]));
            let [x, y] = shifts.max_by_key(|shift| n_met(*shift)).unwrap();
            let inside = cells(&cut.outline.clone().map(|[u, v]| [u + x, v + y]), half);
            let rim = disc(0.07, n);
            let outside = (0..n * n).filter(|at| inside[*at] && !all[*at]);
            assert_eq!(outside.filter(|at| !any_near(&all, *at, &rim, true)).count(), 0, "{name}");
            let share = 1.0 - count(&cells(&cut.outline, half)) / count(&all);
            assert!((0.09..0.51).contains(&share), "{name}: {share}");
        });
    }

    #[test]
    fn a_barred_part_covers_what_its_whole_covers_and_a_bar() {
        let parts = MazeParts { n: 80, bar_mm: Some([2.0, 6.0]), size_mm: [10.0, 40.0], ..PARTS };
        assert_eq!([4, 5].map(|index| parts.name(index)), ["blob-2", "blob-2-bar"]);
        parts.range().into_par_iter().filter(|index| index % 2 == 1).for_each(|index| {
            let [whole, barred] = [index - 1, index].map(|index| parts.part(index, 0.1).unwrap().outline);
            let name = parts.name(index);
            let (bar, rest) = barred.regions.split_last().unwrap();
            let [corners] = bar.as_slice() else { panic!("{name}: a bar has one contour") };
            let side = |i: usize| (corners[i][0] - corners[i + 1][0]).hypot(corners[i][1] - corners[i + 1][1]);
            let (width, long) = (side(0), side(1) - 0.5 * side(0));
            assert!((2.0..=6.0).contains(&width) && (1.49..3.01).contains(&(long / width)), "{name}: {width} {long}");
            // The rest is the whole part, moved.
            let ([x, y], [u, v]) = (rest[0][0][0], whole.regions[0][0][0]);
            let moved = Shape { regions: rest.to_vec() }.map(|[a, b]| [a - x + u, b - y + v]);
            let points =
                |shape: &Shape| shape.regions.iter().flatten().flatten().flatten().copied().collect::<Vec<_>>();
            assert!(points(&moved).iter().zip(points(&whole)).all(|(a, b)| (a - b).abs() < 1e-9), "{name}");
            let half = half_of(&barred).max(half_of(&whole));
            let more = (count(&cells(&barred, half)) - count(&cells(&whole, half))) * CELL_MM * CELL_MM;
            assert!((0.67..1.51).contains(&(more / (width * long))), "{name}: {more} of {width} x {long}");
        });
    }

    #[test]
    fn a_stretched_part_is_its_whole_made_longer_along_one_axis_or_both() {
        let parts = MazeParts { n: 120, stretch_mm: Some([1.0, 2.0]), ..PARTS };
        assert_eq!([4, 5].map(|index| parts.name(index)), ["blob-2", "blob-2-longer"]);
        let mut n_along = [0; 3];
        for index in parts.range().filter(|index| index % 2 == 1) {
            let [whole, longer] = [index - 1, index].map(|index| parts.part(index, 0.1).unwrap());
            let size = |part: &Part| {
                let [x_min, y_min, x_max, y_max] = part.outline.bounds();
                [x_max - x_min, y_max - y_min]
            };
            let ([w, h], [wider, higher]) = (size(&whole), size(&longer));
            let more = [wider - w, higher - h];
            let is_longer = more.map(|mm| (1.0 - 1e-9..=2.0 + 1e-9).contains(&mm));
            assert!(more.into_iter().zip(is_longer).all(|(mm, is)| is || mm.abs() < 1e-9), "{index}: {more:?}");
            n_along[match is_longer {
                [true, false] => 0,
                [false, true] => 1,
                [true, true] => 2,
                [false, false] => panic!("{index}: {more:?}"),
            }] += 1;
            let area = |part: &Part| count(&cells(&part.outline, half_of(&longer.outline)));
            let grown = area(&longer) / area(&whole) / (wider * higher / (w * h));
            assert!((grown - 1.0).abs() < 0.02, "{index}: {grown}");
            assert_eq!(whole.clearance_mm, longer.clearance_mm);
        }
        assert!(n_along.iter().all(|n| *n > 10), "{n_along:?}");
    }

    #[test]
    fn every_side_is_felt_and_of_every_kind() {
        let felt = Cells { half_mm: 24.0, cell_mm: 0.15 };
        let sides = |index| {
            let part = PARTS.part(index, 0.1).unwrap();
            [(part.peg, Side::Peg), (part.hole, Side::Hole)]
        };
        let kinds: Vec<[bool; 3]> = PARTS
            .range()
            .into_par_iter()
            .flat_map_iter(sides)
            .map(|(relief, side)| {
                let n_felt = obstacle(std::slice::from_ref(&relief), side, felt, Some(1.2), 0.35).values;
                let felt_mm2 = n_felt.iter().filter(|mm| **mm > 0.1).count() as f64 * 0.15 * 0.15;
                assert!(felt_mm2 > 1.5, "{felt_mm2} mm^2 of {relief:?}");
                let Layer::Face(face) = &relief.layers[0] else { panic!("a face") };
                [face.band_mm.is_some(), relief.layers.len() == 2, face.rounding.is_some()]
            })
            .collect();
        for (kind, expected) in [0.5, 0.2, 0.3].into_iter().enumerate() {
            let share = kinds.iter().filter(|of| of[kind]).count() as f64 / 600.0;
            // Four standard errors.
            assert!((share - expected).abs() < 0.082, "{kind}: {share}");
        }
    }

    #[test]
    fn a_rectangle_looks_the_same_after_half_a_turn_and_goes_into_its_hole_after_it() {
        let parts = (0..20_000).filter(|index| name(*index).starts_with("islands"));
        let is_rectangle = |part: &Part| match part.outline.regions.iter().flatten().collect::<Vec<_>>()[..] {
            [corners] if corners.len() == 4 => {
                let side = |i: usize| [0, 1].map(|k| corners[(i + 1) % 4][k] - corners[i][k]);
                (side(0)[0] + side(2)[0]).hypot(side(0)[1] + side(2)[1]) < 1e-9
            }
            _ => false,
        };
        let rectangles: Vec<Part> =
            parts.map(|index| PARTS.part(index, 0.1).unwrap()).filter(is_rectangle).take(3).collect();
        assert_eq!(rectangles.len(), 3);
        for part in rectangles {
            let symmetry = part.peg.symmetry();
            assert_eq!(symmetry.order, Some(2));
            assert!(part.outline.fits_in(&part.outline, 0.1, &symmetry.turn(std::f64::consts::PI)));
        }
    }

    #[test]
    fn without_a_play_of_its_own_a_hole_has_the_scenes() {
        assert_eq!(MazeParts { play_mm: None, ..PARTS }.part(4, 0.25).unwrap().clearance_mm, 0.25);
    }

    #[test]
    fn parts_are_taken_by_name_in_every_scene_of_them() {
        let names =
            ["maze-parts", "maze-parts-calibration", "maze-parts-alike", "maze-parts-strangers", "maze-parts-training"];
        let mut seeds = Vec::new();
        for of in names {
            let file = format!("{}/scenes/{of}.toml", env!("CARGO_MANIFEST_DIR"));
            let (all, twelve) = (Scene::load(&file).unwrap(), Scene::load(&format!("{file}#24+12")).unwrap());
            assert_eq!(twelve.name, format!("{of}#24+12"));
            assert_eq!(twelve.part_names(), all.part_names()[24..36]);
            assert_eq!(twelve.part_names()[..2], ["polygon-24", "star-25"]);
            assert_eq!(twelve.shape(5, 1).unwrap(), all.shape(29, 7).unwrap());
            let back: Scene = toml::from_str(&toml::to_string(&twelve).unwrap()).unwrap();
            assert_eq!(back, twelve);
            seeds.push(all.shape(0, 1).unwrap());
        }
        for (at, seed) in seeds.iter().enumerate() {
            assert!(!seeds[..at].contains(seed), "{}", names[at]);
        }
    }
}

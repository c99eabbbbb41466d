//! Which way the shading of a picture says that the walls of a known surface face.
//!
//! A wall lit by one lamp turns brighter or darker as it faces the lamp or not, and the opposite wall the other
//! way. So the lamp's side, taken from one wall, gives the sign of every other wall's change: a picture and a
//! height map agree where all these signs are right.

use crate::error::{Error, Result};
use crate::scene::shape::HeightMap;

/// How far from a wall its surroundings are taken, mm.
const FLANK_MM: f64 = 0.3;

/// The least area of a wall, mm^2.
const LEAST_MM2: f64 = 0.2;

/// Walls nearer to a right angle than this cosine say nothing about each other's lamp.
const LEAST_COSINE: f64 = 0.5;

/// A steep area of a height map that faces one way.
#[derive(Clone, Debug, PartialEq)]
pub struct Wall {
    /// Its pixels, in order.
    pub pixels: Vec<usize>,
    /// Its middle in x and y, pixels.
    pub centre_px: [f64; 2],
    /// How much it rises to the right and downwards, mm a mm, on average.
    pub slope: [f64; 2],
}

/// What a picture shows of a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// By what share it is brighter than what surrounds it, or than the sensor at rest.
    pub change: f64,
    /// How much a pixel on the wall and up to 0.3 mm at its foot changes, as a share of that and of how much one
    /// up to 0.3 mm at its top does: a half where all change by the same, one where only the inside of a groove does.
    pub inside: f64,
}

/// The walls of a map steeper than `steepness` (mm a mm), the largest first.
pub fn find(map: &HeightMap, steepness: f64) -> Vec<Wall> {
    let [width, height] = map.size_px();
    let mm_per_px = map.mm_per_px();
    let slope = |i: usize| {
        let (x, y) = (i % width, i / width);
        let rise = |from: usize, to: usize, n_px: usize, mm: f64| {
            f64::from(map.drops_mm()[from] - map.drops_mm()[to]) / (n_px.max(1) as f64 * mm)
        };
        let ([left, right], [top, bottom]) = (beside(x, width), beside(y, height));
        [
            rise(y * width + left, y * width + right, right - left, mm_per_px[0]),
            rise(top * width + x, bottom * width + x, bottom - top, mm_per_px[1]),
        ]
    };
    let slopes: Vec<[f64; 2]> = (0..width * height).map(slope).collect();
    // The axis along which a steep pixel rises most, and whether it rises.
    let faces = |i: usize| {
        let [x, y] = slopes[i];
        let axis = usize::from(y.abs() > x.abs());
        (x.hypot(y) > steepness).then(|| (axis, slopes[i][axis] > 0.0))
    };
    let least = (LEAST_MM2 / (mm_per_px[0] * mm_per_px[1])).ceil() as usize;
    let mut seen = vec![false; width * height];
    let mut walls = Vec::new();
    for start in 0..width * height {
        let Some(way) = faces(start).filter(|_| !seen[start]) else { continue };
        seen[start] = true;
        let (mut pixels, mut next) = (vec![start], 0);
        while let Some(&pixel) = pixels.get(next) {
            next += 1;
            let (x, y) = (pixel % width, pixel / width);
            let ([left, right], [top, bottom]) = (beside(x, width), beside(y, height));
            for other in [y * width + left, y * width + right, top * width + x, bottom * width + x] {
                if !seen[other] && faces(other) == Some(way) {
                    seen[other] = true;
                    pixels.push(other);
                }
            }
        }
        if pixels.len() >= least {
            pixels.sort_unstable();
            let mean =
                |value: &dyn Fn(usize) -> f64| pixels.iter().map(|i| value(*i)).sum::<f64>() / pixels.len() as f64;
            let centre_px = [mean(&|i| (i % width) as f64), mean(&|i| (i / width) as f64)];
            let slope = [mean(&|i| slopes[i][0]), mean(&|i| slopes[i][1])];
            walls.push(Wall { pixels, centre_px, slope });
        }
    }
    walls.sort_by_key(|wall| std::cmp::Reverse(wall.pixels.len()));
    walls
}

/// The places before and after one of `n`, kept among them.
fn beside(at: usize, n: usize) -> [usize; 2] {
    [at.saturating_sub(1), (at + 1).min(n - 1)]
}

/// What one channel of a picture of the map's size shows of each wall: against the same channel at rest, or,
/// without it, against what is next to the wall. Fails where a size differs from the map's.
pub fn shading(walls: &[Wall], map: &HeightMap, channel: &[f32], at_rest: Option<&[f32]>) -> Result<Vec<Shading>> {
    let n_pixels = map.size_px()[0] * map.size_px()[1];
    if channel.len() != n_pixels || at_rest.is_some_and(|rest| rest.len() != n_pixels) {
        let expected = format!("{}x{} pixels as the map", map.size_px()[0], map.size_px()[1]);
        return Err(Error::invalid("picture", expected, format!("{} pixels", channel.len())));
    }
    let mut is_wall = vec![false; n_pixels];
    walls.iter().flat_map(|wall| &wall.pixels).for_each(|pixel| is_wall[*pixel] = true);
    Ok(walls.iter().map(|wall| one_shading(wall, &is_wall, map, channel, at_rest)).collect())
}

fn one_shading(wall: &Wall, is_wall: &[bool], map: &HeightMap, channel: &[f32], at_rest: Option<&[f32]>) -> Shading {
    let [width, height] = map.size_px();
    // Lines of pixels run across the wall.
    let axis = usize::from(wall.slope[1].abs() > wall.slope[0].abs());
    let (stride, n_along, n_lines) = if axis == 0 { (1, width, height) } else { (width, height, width) };
    let flank = ((FLANK_MM / map.mm_per_px()[axis]).round() as usize).max(1);
    let mut lines = vec![None; n_lines];
    for pixel in &wall.pixels {
        let place = [pixel % width, pixel / width];
        let (at, line) = (place[axis], place[1 - axis]);
        let (first, last) = lines[line].unwrap_or((at, at));
        lines[line] = Some((at.min(first), at.max(last)));
    }
    let [mut changed, mut level] = [0.0_f64; 2];
    // Sum and number of changes at the foot and on the wall, and at the top.
    let mut sides = [[0.0_f64; 2]; 2];
    for (line, (first, last)) in lines.into_iter().enumerate().filter_map(|(line, ends)| Some((line, ends?))) {
        let pixel = |at: usize| at * stride + line * if axis == 0 { width } else { 1 };
        let value = |at: usize| f64::from(channel[pixel(at)]);
        let (before, after) = (first.saturating_sub(flank)..first, last + 1..(last + 1 + flank).min(n_along));
        let around = || before.clone().chain(after.clone()).filter(|at| !is_wall[pixel(*at)]);
        if around().next().is_none() {
            continue;
        }
        let beside = around().map(value).sum::<f64>() / around().count() as f64;
        let at_rest = |at: usize| at_rest.map_or(beside, |rest| f64::from(rest[pixel(at)]));
        let change = |at: usize| value(at) - at_rest(at);
        changed += (first..=last).map(change).sum::<f64>();
        level += (first..=last).map(at_rest).sum::<f64>();
        // Rising along the line, the wall's top is after it.
        let (foot, top) = if wall.slope[axis] > 0.0 { (before, after) } else { (after, before) };
        let mut add = |side: usize, range: std::ops::Range<usize>| {
            sides[side][0] += range.clone().map(|at| change(at).abs()).sum::<f64>();
            sides[side][1] += range.len() as f64;
        };
        add(0, foot);
        add(0, first..last + 1);
        add(1, top);
    }
    let [inside, outside] = sides.map(|[sum, n]| sum / n.max(1.0));
    Shading { change: changed / level.max(1e-9), inside: inside / (inside + outside).max(1e-9) }
}

/// How many walls' signs are right by a lamp taken from one other wall, and how many such pairs there are.
pub fn signs(walls: &[Wall], shading: &[Shading]) -> [usize; 2] {
    let [mut n_right, mut n_tested] = [0; 2];
    for (from, seen) in walls.iter().zip(shading) {
        for (wall, shown) in walls.iter().zip(shading).filter(|(wall, _)| !std::ptr::eq(*wall, from)) {
            let along = from.slope[0] * wall.slope[0] + from.slope[1] * wall.slope[1];
            let steep = from.slope[0].hypot(from.slope[1]) * wall.slope[0].hypot(wall.slope[1]);
            if along.abs() > LEAST_COSINE * steep {
                n_tested += 1;
                n_right += usize::from(seen.change * along * shown.change > 0.0);
            }
        }
    }
    [n_right, n_tested]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [usize; 2] = [120, 80];

    /// A plate with two grooves across, 0.4 mm deep, their walls 4 pixels wide, and a pixel 0.05 mm.
    fn map(heights: impl Fn(f64) -> f64) -> HeightMap {
        let heights: Vec<f32> = (0..120 * 80).map(|i| heights((i % 120) as f64) as f32).collect();
        HeightMap::new(SIZE_PX, [0.05; 2], &heights).unwrap()
    }

    fn groove(x: f64) -> f64 {
        let one = |from: f64, to: f64| ((x - from).min(to - x) / 4.0).clamp(0.0, 1.0);
        -0.4 * (one(20.0, 50.0) + one(70.0, 100.0))
    }

    #[test]
    fn walls_are_found_with_their_slopes() {
        let walls = find(&map(groove), 0.5);
        let mut found: Vec<_> =
            walls.iter().map(|wall| (wall.centre_px[0].round() as i32, wall.slope[0] > 0.0)).collect();
        found.sort_unstable();
        assert_eq!(found, [(22, false), (48, true), (72, false), (98, true)]);
        // 0.1 mm a pixel of 0.05 mm, half of that at the ends.
        assert!(walls.iter().all(|wall| (1.5..=2.0).contains(&wall.slope[0].abs()) && wall.slope[1].abs() < 1e-6));
    }

    #[test]
    fn a_picture_lit_from_one_side_has_all_signs_right_and_one_without_a_lamp_has_not() {
        let map = map(groove);
        let walls = find(&map, 0.5);
        let slope = |i: usize| {
            let x = (i % 120) as f64;
            (groove(x + 1.0) - groove(x - 1.0)) / 0.1
        };
        let lit: Vec<f32> = (0..120 * 80).map(|i| (90.0 + 0.2 * (i / 120) as f64 - 15.0 * slope(i)) as f32).collect();
        let shown = shading(&walls, &map, &lit, None).unwrap();
        assert_eq!(signs(&walls, &shown), [12, 12]);
        // 15 counts of about 98 for each mm a mm.
        for (wall, shown) in walls.iter().zip(&shown) {
            assert!((shown.change + 15.0 * wall.slope[0] / 98.0).abs() < 0.02, "{shown:?} of {:?}", wall.slope);
            assert!(shown.inside > 0.9);
        }
        let even: Vec<f32> = (0..120 * 80).map(|i| (90.0 - 15.0 * slope(i).abs()) as f32).collect();
        // Walls that face the same way agree, those that face each other do not.
        assert_eq!(signs(&walls, &shading(&walls, &map, &even, None).unwrap()), [4, 12]);
    }

    #[test]
    fn a_band_outside_the_outline_is_told_from_one_inside() {
        let map = map(groove);
        let walls = find(&map, 0.5);
        let rest = vec![100.0; 120 * 80];
        let band = |from: f64, to: f64| -> Vec<f32> {
            (0..120 * 80).map(|i| if (from..to).contains(&((i % 120) as f64)) { 140.0 } else { 100.0 }).collect()
        };
        // The wall at 20 to 24 falls to the right.
        let at_wall = |channel: &[f32]| {
            let shown = shading(&walls, &map, channel, Some(&rest)).unwrap();
            let at = walls.iter().position(|wall| wall.centre_px[0].round() == 22.0).unwrap();
            shown[at].inside
        };
        assert_eq!(at_wall(&band(20.0, 28.0)), 1.0);
        assert_eq!(at_wall(&band(15.0, 19.0)), 0.0);
        assert!(shading(&walls, &map, &rest[1..], None).is_err());
    }
}

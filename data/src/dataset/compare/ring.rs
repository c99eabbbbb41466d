//! How far from a predicted outline the bright and dark ring is that a face's edge makes.
//!
//! Each side of the outline is moved outwards and inwards a pixel at a time, and the median of what the press
//! changed along it is taken, channel by channel. A ring is where these medians differ most from those some
//! pixels to both sides. Medians along a side are blind to scratches and to the texture of a printed face; dark
//! marks printed on a gel are left out. Where a part was pressed is often known less well than its size, so the
//! outline is also moved as a whole to where its ring is strongest.

use super::Press;
use crate::error::{Error, Result};
use crate::frame::Frame;

/// A ring differs from what is this far to both its sides, pixels: half its width on a Mini's frame.
const BESIDE_PX: usize = 8;

/// Share of a side left out at each end: corners are rounded.
const CORNER: f64 = 0.1;

/// A pixel darker than this share of the median round it is a mark.
const MARK: f64 = 0.85;

/// The median round a pixel is of this many pixels either way, computed for blocks of [`BLOCK_PX`].
const AROUND_PX: usize = 20;

/// Side of the blocks that share a median, pixels.
const BLOCK_PX: usize = 8;

/// Marks are widened by this, pixels: their borders are soft, and their shadows coloured.
const MARK_BORDER_PX: usize = 4;

/// The least share of a side without marks that shows where its ring is.
const LEAST_CLEAR: f64 = 0.05;

/// The ring of a polygon, and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// How far outside the outline it is where the outline was predicted, pixels.
    pub offset_px: f64,
    /// By how much the outline moves in x and y to where its ring is strongest, pixels.
    pub moved_px: [f64; 2],
    /// How far outside the outline it is once that is moved, pixels: by how much the outline is too small.
    pub moved_offset_px: f64,
    /// How far outside each side of the outline as predicted that ring is, pixels.
    pub sides_px: Vec<f64>,
    /// How strong the ring of the moved outline is, counts.
    pub counts: f64,
}

/// One side of a polygon.
struct Side {
    outwards: [f64; 2],
    /// How strong the ring is at each offset from -reach to reach, counts.
    strengths: Vec<f64>,
}

/// Finds the ring within `reach_px` of a polygon, whose corners are given in pixels, the middle of the first pixel
/// being `[0, 0]`. Fails where the polygon is nearer than 8 pixels more to the frame's border, and where marks hide
/// the ring.
pub fn find(press: Press, corners_px: &[[f64; 2]], reach_px: usize) -> Result<Ring> {
    press.validate("frame")?;
    let size_px = [press.frame.width_px(), press.frame.height_px()];
    let reach = reach_px.saturating_add(BESIDE_PX) as f64;
    let within = |at: f64, n: usize| at - reach >= 0.0 && at + reach <= (n - 1) as f64;
    let fits = |corner: &[f64; 2]| within(corner[0], size_px[0]) && within(corner[1], size_px[1]);
    if corners_px.len() < 3 || reach_px == 0 || !corners_px.iter().all(fits) {
        let expected = format!("3 or more corners, {reach} pixels within {}x{}", size_px[0], size_px[1]);
        return Err(Error::invalid("outline", expected, format!("{corners_px:?}")));
    }
    let (_, difference) = press.difference(&(0..size_px[0] * size_px[1]).collect::<Vec<_>>());
    let marks = [press.frame, press.at_rest].map(marks);
    let clear = |pixel: usize| (!(marks[0][pixel] || marks[1][pixel])).then(|| &difference[3 * pixel..3 * pixel + 3]);
    let n = corners_px.len();
    let centre = [0, 1].map(|axis| corners_px.iter().map(|corner| corner[axis]).sum::<f64>() / n as f64);
    let sides: Vec<Side> = (0..n)
        .map(|i| {
            let (from, to) = (corners_px[i], corners_px[(i + 1) % n]);
            let along = [to[0] - from[0], to[1] - from[1]];
            let length = along[0].hypot(along[1]).max(1e-9);
            let outwards = [along[1] / length, -along[0] / length];
            let away = (from[0] - centre[0]) * outwards[0] + (from[1] - centre[1]) * outwards[1];
            let outwards = if away < 0.0 { outwards.map(|v| -v) } else { outwards };
            let n_points = (length * (1.0 - 2.0 * CORNER)).ceil() as usize;
            let medians = |offset: f64| {
                let points = (0..n_points).filter_map(|k| {
                    let share = CORNER + (1.0 - 2.0 * CORNER) * (k as f64 + 0.5) / n_points as f64;
                    let at = [0, 1].map(|axis| (from[axis] + share * along[axis] + offset * outwards[axis]).round());
                    clear(at[1] as usize * size_px[0] + at[0] as usize)
                });
                let points: Vec<&[f32]> = points.collect();
                let is_enough = points.len() as f64 >= (LEAST_CLEAR * n_points as f64).max(1.0);
                is_enough.then(|| [0, 1, 2].map(|c| median(points.iter().map(|counts| f64::from(counts[c])))))
            };
            let line: Vec<Option<[f64; 3]>> =
                (0..=2 * (reach_px + BESIDE_PX)).map(|i| medians(i as f64 - reach)).collect();
            let stands_out = |i: usize| {
                let (Some(before), Some(here), Some(after)) = (line[i], line[i + BESIDE_PX], line[i + 2 * BESIDE_PX])
                else {
                    return 0.0;
                };
                (0..3).map(|c| (here[c] - 0.5 * (before[c] + after[c])).abs()).fold(0.0, f64::max)
            };
            Side { outwards, strengths: (0..=2 * reach_px).map(stands_out).collect() }
        })
        .collect();
    let steps = || (0..=2 * reach_px).map(|i| i as f64 - reach_px as f64);
    let in_place = steps().map(|offset| (strength(&sides, [0.0; 2], offset), [0.0; 2], offset));
    let moved = steps().flat_map(|x| steps().map(move |y| [x, y]));
    let moved = moved.flat_map(|by| steps().map(move |offset| (by, offset)));
    let moved = moved.map(|(by, offset)| (strength(&sides, by, offset), by, offset));
    let ((_, _, offset_px), (counts, moved_px, moved_offset_px)) = (strongest(in_place), strongest(moved));
    if counts <= 0.0 {
        return Err(Error::invalid("outline", "a ring that shows between marks", "none"));
    }
    let sides_px = sides.iter().map(|side| side.offset_px(moved_px, moved_offset_px)).collect();
    Ok(Ring { offset_px, moved_px, moved_offset_px, sides_px, counts })
}

impl Side {
    /// How far outside this side the same side of the outline is, moved and widened.
    fn offset_px(&self, by: [f64; 2], wider: f64) -> f64 {
        wider + self.outwards[0] * by[0] + self.outwards[1] * by[1]
    }
}

/// The mean strength over sides of a ring near the outline, moved and widened; zero beyond reach.
fn strength(sides: &[Side], by: [f64; 2], wider: f64) -> f64 {
    let of_side = |side: &Side| {
        let at = (side.offset_px(by, wider) + 0.5 * (side.strengths.len() - 1) as f64).round();
        if at < 0.0 { 0.0 } else { side.strengths.get(at as usize).copied().unwrap_or(0.0) }
    };
    sides.iter().map(of_side).sum::<f64>() / sides.len() as f64
}

/// The strongest of candidates; of several, the one moved and widened least.
fn strongest(candidates: impl Iterator<Item = (f64, [f64; 2], f64)>) -> (f64, [f64; 2], f64) {
    let least = |(_, [x, y], wider): &(f64, [f64; 2], f64)| x.abs() + y.abs() + wider.abs();
    let better =
        |a: &(f64, [f64; 2], f64), b: &(f64, [f64; 2], f64)| a.0.total_cmp(&b.0).then(least(b).total_cmp(&least(a)));
    candidates.max_by(better).unwrap_or_default()
}

/// The middle value, the upper of two; zero of none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Pixels of marks printed on the gel and of their borders.
fn marks(frame: &Frame) -> Vec<bool> {
    let [width, height] = [frame.width_px(), frame.height_px()];
    let grey: Vec<f64> = frame.rgb().as_chunks::<3>().0.iter().map(|rgb| rgb.map(f64::from).iter().sum()).collect();
    let mut marks = vec![false; width * height];
    for (top, left) in (0..height).step_by(BLOCK_PX).flat_map(|y| (0..width).step_by(BLOCK_PX).map(move |x| (y, x))) {
        let around = |at: usize, n: usize| at.saturating_sub(AROUND_PX)..(at + BLOCK_PX + AROUND_PX).min(n);
        let columns = around(left, width);
        let level = MARK * median(around(top, height).flat_map(|y| &grey[y * width..][columns.clone()]).copied());
        for y in top..(top + BLOCK_PX).min(height) {
            for x in (left..(left + BLOCK_PX).min(width)).filter(|x| grey[y * width + x] < level) {
                let near = |at: usize, n: usize| at.saturating_sub(MARK_BORDER_PX)..(at + MARK_BORDER_PX + 1).min(n);
                near(y, height).for_each(|row| marks[row * width..][near(x, width)].fill(true));
            }
        }
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square ring, its sides `off` pixels outside 40..100 x 30..90, one pixel wide and 30 counts bright on the
    /// left and 12 dark elsewhere; and marks on the gel, moved by 3 pixels.
    fn frames(off: [f64; 4]) -> [Frame; 2] {
        let frame = |pressed: bool| {
            let rgb = (0..140 * 120).flat_map(|i| {
                let (x, y) = ((i % 140) as f64, (i / 140) as f64);
                let [left, right, top, bottom] = [40.0 - off[0], 100.0 + off[1], 30.0 - off[2], 90.0 + off[3]];
                let inside = (left..=right).contains(&x) && (top..=bottom).contains(&y);
                let edge =
                    if inside && x == left { 30 } else { -12 * i32::from(x == right || y == top || y == bottom) };
                let moved = if pressed { 3.0 } else { 0.0 };
                let mark = (x - moved).rem_euclid(34.0) < 10.0 && (y + moved).rem_euclid(34.0) < 10.0;
                let change = if pressed && inside { edge } else { 0 };
                [100, 120, 110].map(|v: i32| if mark { v as u8 / 2 } else { (v + change + i % 3) as u8 })
            });
            Frame::new(140, 120, rgb.collect()).unwrap()
        };
        [frame(true), frame(false)]
    }

    const SQUARE: [[f64; 2]; 4] = [[40.0, 30.0], [100.0, 30.0], [100.0, 90.0], [40.0, 90.0]];

    #[test]
    fn the_ring_is_found_between_marks_and_the_outline_moved_to_it() {
        let [frame, at_rest] = frames([4.0; 4]);
        let ring = find(Press { frame: &frame, at_rest: &at_rest }, &SQUARE, 10).unwrap();
        assert_eq!((ring.offset_px, ring.moved_px, ring.moved_offset_px), (4.0, [0.0; 2], 4.0));
        // Left 4 pixels inside, right 6 outside; top 3 outside, bottom 1 inside: moved by 5 and -2, wider by 1.
        let [frame, at_rest] = frames([-4.0, 6.0, 3.0, -1.0]);
        let ring = find(Press { frame: &frame, at_rest: &at_rest }, &SQUARE, 10).unwrap();
        assert_eq!((ring.moved_px, ring.moved_offset_px), ([5.0, -2.0], 1.0));
        // Top, right, bottom, left.
        assert_eq!(ring.sides_px, [3.0, 6.0, -1.0, -4.0]);
    }

    #[test]
    fn an_outline_off_the_frame_is_refused() {
        let [frame, at_rest] = frames([0.0; 4]);
        let press = Press { frame: &frame, at_rest: &at_rest };
        assert!(find(press, &[[5.0, 30.0], [100.0, 30.0], [100.0, 90.0]], 10).is_err());
        assert!(find(press, &SQUARE[..2], 10).is_err());
    }
}

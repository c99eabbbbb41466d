//! How far from a predicted outline the bright and dark ring lies that a face's edge makes.
//!
//! Each side of the outline is moved outwards and inwards a pixel at a time. At each offset the median of what
//! the press changed along the side, channel by channel, is held against the median over all offsets: the
//! offset where they differ most is where the edge shows. Medians along a side are blind to scratches and
//! to the texture of a printed face; dark marks printed on a gel are left out.

use super::Press;
use crate::error::{Error, Result};
use crate::frame::Frame;

/// Share of a side left out at each end: corners are rounded.
const CORNER: f64 = 0.1;

/// A pixel darker than this share of the median round it is a mark.
const MARK: f64 = 0.85;

/// The median round a pixel is of this many pixels either way, worked out for blocks of [`BLOCK_PX`].
const AROUND_PX: usize = 20;

/// Side of the blocks that share a median, pixels.
const BLOCK_PX: usize = 8;

/// Marks are widened by this, pixels: their borders are soft, and their shadows coloured.
const MARK_BORDER_PX: usize = 4;

/// The least share of a side without marks that tells where its ring lies.
const LEAST_CLEAR: f64 = 0.05;

/// Where the ring lies beside a polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// Where it is strongest beside each side, pixels outwards.
    pub sides_px: Vec<f64>,
    /// Where it is strongest beside all sides together, pixels outwards.
    pub offset_px: f64,
    /// How strong it is there, counts.
    pub counts: f64,
}

/// Finds the ring within `reach_px` of a polygon, whose corners are given in pixels, the middle of the first pixel
/// being `[0, 0]`. Fails where the polygon leaves the frame or marks hide it.
pub fn find(press: Press, corners_px: &[[f64; 2]], reach_px: usize) -> Result<Ring> {
    press.validate("frame")?;
    let [width, height] = [press.frame.width_px(), press.frame.height_px()];
    let reach = reach_px as f64;
    let fits = |[x, y]: &[f64; 2]| {
        let within = |at: f64, n: usize| at - reach >= 0.0 && at + reach <= (n - 1) as f64;
        within(*x, width) && within(*y, height)
    };
    if corners_px.len() < 3 || reach_px == 0 || !corners_px.iter().all(fits) {
        let expected = format!("3 or more corners, {reach_px} pixels or more within {width}x{height}");
        return Err(Error::invalid("outline", expected, format!("{corners_px:?}")));
    }
    let (_, difference) = press.difference(&(0..width * height).collect::<Vec<_>>());
    let marks = [press.frame, press.at_rest].map(marks);
    let is_clear = |pixel: usize| !(marks[0][pixel] || marks[1][pixel]);
    let n = corners_px.len() as f64;
    let centre = [0, 1].map(|axis| corners_px.iter().map(|corner| corner[axis]).sum::<f64>() / n);
    let offsets: Vec<f64> = (0..=2 * reach_px).map(|i| i as f64 - reach).collect();
    let mut total = vec![0.0; offsets.len()];
    let mut sides_px = Vec::new();
    for (i, from) in corners_px.iter().enumerate() {
        let to = corners_px[(i + 1) % corners_px.len()];
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = along[0].hypot(along[1]).max(1e-9);
        let mut outwards = [along[1] / length, -along[0] / length];
        if (from[0] - centre[0]) * outwards[0] + (from[1] - centre[1]) * outwards[1] < 0.0 {
            outwards = outwards.map(|v| -v);
        }
        let n_points = (length * (1.0 - 2.0 * CORNER)).ceil() as usize;
        // Medians of red, green and blue at each offset, where enough is clear.
        let medians: Vec<Option<[f64; 3]>> = (offsets.iter())
            .map(|offset| {
                let pixels = (0..n_points).map(|k| {
                    let share = CORNER + (1.0 - 2.0 * CORNER) * (k as f64 + 0.5) / n_points as f64;
                    let at = [0, 1].map(|axis| (from[axis] + share * along[axis] + offset * outwards[axis]).round());
                    at[1] as usize * width + at[0] as usize
                });
                let clear: Vec<usize> = pixels.filter(|pixel| is_clear(*pixel)).collect();
                let enough = clear.len() as f64 >= (LEAST_CLEAR * n_points as f64).max(1.0);
                let channel = |c: usize| median(clear.iter().map(|pixel| f64::from(difference[3 * pixel + c])));
                enough.then(|| [0, 1, 2].map(channel))
            })
            .collect();
        let around = [0, 1, 2].map(|c| median(medians.iter().flatten().map(|counts| counts[c])));
        let strength = |counts: &Option<[f64; 3]>| {
            counts.map_or(0.0, |counts| (0..3).map(|c| (counts[c] - around[c]).abs()).fold(0.0, f64::max))
        };
        let strengths: Vec<f64> = medians.iter().map(strength).collect();
        total.iter_mut().zip(&strengths).for_each(|(sum, strength)| *sum += strength / n);
        sides_px.push(offsets[strongest(&strengths)]);
    }
    let at = strongest(&total);
    if total[at] <= 0.0 {
        return Err(Error::invalid("outline", "a side that shows between marks", "none"));
    }
    Ok(Ring { sides_px, offset_px: offsets[at], counts: total[at] })
}

/// The index of the largest value, the one nearest to the middle of several.
fn strongest(values: &[f64]) -> usize {
    let from_middle = |i: usize| i.abs_diff(values.len() / 2);
    let better = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]).then(from_middle(*b).cmp(&from_middle(*a)));
    (0..values.len()).max_by(better).unwrap_or(0)
}

/// The middle value, the upper of two; nought of none.
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
    /// left and 20 dark elsewhere; and marks on the gel, moved by 3 pixels.
    fn frames(off: [f64; 4]) -> [Frame; 2] {
        let frame = |pressed: bool| {
            let rgb = (0..140 * 120).flat_map(|i| {
                let (x, y) = ((i % 140) as f64, (i / 140) as f64);
                let [left, right, top, bottom] = [40.0 - off[0], 100.0 + off[1], 30.0 - off[2], 90.0 + off[3]];
                let inside = (left..=right).contains(&x) && (top..=bottom).contains(&y);
                let edge = if inside && x == left { 30 } else { -20 * i32::from(x == right || y == top || y == bottom) };
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
    fn the_ring_is_found_beside_each_side_between_marks() {
        let [frame, at_rest] = frames([2.0, -3.0, 0.0, 5.0]);
        let ring = find(Press { frame: &frame, at_rest: &at_rest }, &SQUARE, 10).unwrap();
        // Top, right, bottom, left.
        assert_eq!(ring.sides_px, [0.0, -3.0, 5.0, 2.0]);
        let [frame, at_rest] = frames([4.0; 4]);
        let ring = find(Press { frame: &frame, at_rest: &at_rest }, &SQUARE, 10).unwrap();
        assert_eq!((ring.sides_px, ring.offset_px), (vec![4.0; 4], 4.0));
    }

    #[test]
    fn an_outline_off_the_frame_is_refused() {
        let [frame, at_rest] = frames([0.0; 4]);
        let press = Press { frame: &frame, at_rest: &at_rest };
        assert!(find(press, &[[5.0, 30.0], [100.0, 30.0], [100.0, 90.0]], 10).is_err());
        assert!(find(press, &SQUARE[..2], 10).is_err());
    }
}

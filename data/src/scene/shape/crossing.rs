//! Outlines whose sides cross: they bound nothing.

use super::Contour;
use super::raster::sides;

/// Where two sides of a region cross, mm; none where it can be made. Contours that only touch do not cross.
pub fn first_crossing(region: &[Contour]) -> Option<[f64; 2]> {
    let left = |side: &[[f64; 2]; 2]| side[0][0].min(side[1][0]);
    let right = |side: &[[f64; 2]; 2]| side[0][0].max(side[1][0]);
    let mut sides: Vec<[[f64; 2]; 2]> = sides(region).collect();
    sides.sort_by(|a, b| left(a).total_cmp(&left(b)));
    for (i, side) in sides.iter().enumerate() {
        // Only sides that begin before this one ends can cross it.
        let near = sides[i + 1..].iter().take_while(|other| left(other) <= right(side));
        if let Some(place) = near.filter_map(|other| crossing(side, other)).next() {
            return Some(place);
        }
    }
    None
}

/// Area that a region encloses by the even-odd rule where its contours do not cross, mm^2, from the area of
/// each contour: those inside an odd number of others are counters.
pub fn area_mm2(region: &[Contour]) -> f64 {
    let depth = |i: usize| {
        let holds = |outer: &Contour| region[i].first().is_some_and(|point| is_inside(outer, *point));
        region.iter().enumerate().filter(|(j, outer)| *j != i && holds(outer)).count()
    };
    let signed = |i: usize| if depth(i).is_multiple_of(2) { 1.0 } else { -1.0 } * signed_area(&region[i]).abs();
    (0..region.len()).map(signed).sum()
}

/// Area of one contour by the shoelace formula, mm^2; positive where it turns from x to y.
pub(super) fn signed_area(contour: &Contour) -> f64 {
    let next = contour.iter().skip(1).chain(contour.first());
    0.5 * contour.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>()
}

/// Whether a point is inside a contour, by the even-odd rule.
pub(super) fn is_inside(contour: &Contour, [x, y]: [f64; 2]) -> bool {
    let next = contour.iter().skip(1).chain(contour.first());
    let crosses = |(a, b): (&[f64; 2], &[f64; 2])| {
        (a[1] <= y) != (b[1] <= y) && a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) < x
    };
    contour.iter().zip(next).filter(|pair| crosses(*pair)).count() % 2 == 1
}

/// Where two sides cross within both.
fn crossing([a, b]: &[[f64; 2]; 2], [c, d]: &[[f64; 2]; 2]) -> Option<[f64; 2]> {
    let turn = |p: &[f64; 2], q: &[f64; 2], r: &[f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let (from_a, from_b) = (turn(c, d, a), turn(c, d, b));
    if from_a * from_b >= 0.0 || turn(a, b, c) * turn(a, b, d) >= 0.0 {
        return None;
    }
    let t = from_a / (from_a - from_b);
    Some([0, 1].map(|k| a[k] + t * (b[k] - a[k])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::glyph::glyph;
    use crate::scene::shape::{Raster, Shape};

    #[test]
    fn a_bow_tie_crosses_in_its_middle() {
        let tie = vec![[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]];
        assert_eq!(first_crossing(&[tie]), Some([5.0, 5.0]));
    }

    #[test]
    fn letters_and_squares_that_touch_do_not_cross() {
        for letter in 'A'..='Z' {
            let shape = glyph(letter, 12.0, 16.0).unwrap();
            assert_eq!(first_crossing(&shape.regions[0]), None, "{letter}");
        }
        let square = |x: f64| vec![[x, 0.0], [x + 1.0, 0.0], [x + 1.0, 1.0], [x, 1.0]];
        assert_eq!(first_crossing(&[square(0.0), square(1.0)]), None);
        assert!(first_crossing(&[square(0.0), square(0.5).into_iter().map(|[x, y]| [x, y + 0.5]).collect()]).is_some());
    }

    #[test]
    fn the_area_is_that_of_the_raster() {
        for letter in "AOB".chars() {
            let shape: Shape = glyph(letter, 12.0, 16.0).unwrap();
            let counted: f32 = Raster::coverage(&shape, 9.0, 0.05).values.iter().sum();
            // A quarter of a cell in y on all sides.
            assert!((area_mm2(&shape.regions[0]) / (f64::from(counted) * 0.0025) - 1.0).abs() < 0.01, "{letter}");
        }
    }
}

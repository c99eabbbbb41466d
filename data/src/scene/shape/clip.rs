//! What of an outline is inside a convex window.

use super::Contour;
use super::raster::sides;

/// The part of a region that is inside a convex window, as contours that are filled by the even-odd rule. The window's
/// corners turn from x to y. An outline that the window cuts into pieces becomes a contour for each piece: no side runs
/// along the window between two pieces, as the sides of Sutherland and Hodgman's method do.
pub(super) fn clipped(region: Vec<Contour>, window: &Contour) -> Vec<Contour> {
    sides(std::slice::from_ref(window)).fold(region, cut)
}

/// What is to the left of the line through two points (x right, y up).
fn cut(region: Vec<Contour>, [a, b]: [[f64; 2]; 2]) -> Vec<Contour> {
    let along = [b[0] - a[0], b[1] - a[1]];
    let inside = |p: [f64; 2]| along[0] * (p[1] - a[1]) - along[1] * (p[0] - a[0]);
    let (mut kept, mut chains) = (Vec::new(), Vec::new());
    for contour in region {
        match contour.iter().position(|point| inside(*point) < 0.0) {
            None => kept.push(contour),
            Some(outside) => chains.extend(chains_of(&contour, outside, inside)),
        }
    }
    // Along the line the inside is between the first and the second crossing, the third and the fourth, and so on. End
    // 2 i of a chain is its first point, end 2 i + 1 its last.
    let place = |p: [f64; 2]| along[0] * p[0] + along[1] * p[1];
    let end = |end: usize| {
        if end.is_multiple_of(2) { chains[end / 2][0] } else { chains[end / 2][chains[end / 2].len() - 1] }
    };
    let mut ends: Vec<usize> = (0..2 * chains.len()).collect();
    ends.sort_by(|i, j| place(end(*i)).total_cmp(&place(end(*j))));
    let mut partner = vec![0; ends.len()];
    for pair in ends.chunks_exact(2) {
        (partner[pair[0]], partner[pair[1]]) = (pair[1], pair[0]);
    }
    let mut is_joined = vec![false; chains.len()];
    for first in 0..chains.len() {
        let (mut contour, mut entry) = (Contour::new(), 2 * first);
        while !is_joined[entry / 2] {
            is_joined[entry / 2] = true;
            let chain = chains[entry / 2].iter().copied();
            if entry.is_multiple_of(2) {
                contour.extend(chain)
            } else {
                contour.extend(chain.rev())
            }
            entry = partner[entry ^ 1];
        }
        if !contour.is_empty() {
            kept.push(contour);
        }
    }
    kept
}

/// The pieces of a contour that are inside, each from crossing to crossing; point number `outside` is not inside.
fn chains_of(contour: &Contour, outside: usize, inside: impl Fn([f64; 2]) -> f64) -> Vec<Contour> {
    let (mut chains, mut chain) = (Vec::new(), Contour::new());
    for i in 0..contour.len() {
        let [a, b] = [0, 1].map(|k| contour[(outside + i + k) % contour.len()]);
        let (from_a, from_b) = (inside(a), inside(b));
        if (from_a < 0.0) != (from_b < 0.0) {
            let t = from_a / (from_a - from_b);
            chain.push([0, 1].map(|k| a[k] + t * (b[k] - a[k])));
        }
        if from_b >= 0.0 {
            chain.push(b);
        } else if !chain.is_empty() {
            chains.push(std::mem::take(&mut chain));
        }
    }
    chains
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::random::{frame_rng, uniform};
    use crate::scene::shape::crossing::is_inside;
    use crate::scene::shape::outline::outline;
    use std::f64::consts::TAU;

    fn square(half: f64) -> Contour {
        vec![[-half, -half], [half, -half], [half, half], [-half, half]]
    }

    fn is_in(region: &[Contour], point: [f64; 2]) -> bool {
        region.iter().filter(|contour| is_inside(contour, point)).count() % 2 == 1
    }

    #[test]
    fn a_point_is_inside_what_is_left_where_it_is_inside_outline_and_window() {
        let rng = &mut frame_rng(8, 0);
        let mut n_inside = 0;
        for index in 0..60 {
            let region = outline(8, index, [10.0, 10.0]).regions.remove(0);
            let [x, y, turn] = [-4.0, -4.0, 0.0].map(|low| uniform(rng, [low, 4.0]));
            let n = 3 + index % 6;
            let corner = |i: usize| turn + TAU * i as f64 / n as f64;
            let window: Contour = (0..n).map(|i| [x + 4.0 * corner(i).cos(), y + 3.0 * corner(i).sin()]).collect();
            let left = clipped(region.clone(), &window);
            for _ in 0..400 {
                let point = [0, 1].map(|_| uniform(rng, [-6.0, 6.0]));
                let expected = is_in(&region, point) && is_inside(&window, point);
                assert_eq!(is_in(&left, point), expected, "{index} {point:?}");
                n_inside += usize::from(expected);
            }
        }
        assert!(n_inside > 1000, "{n_inside}");
    }

    #[test]
    fn a_comb_is_cut_into_its_teeth_without_a_side_between_them() {
        let comb = vec![
            [-3.0, -9.0],
            [3.0, -9.0],
            [3.0, 0.0],
            [1.0, 0.0],
            [1.0, -6.0],
            [-1.0, -6.0],
            [-1.0, 0.0],
            [-3.0, 0.0],
        ];
        let teeth = clipped(vec![comb], &square(4.0));
        assert_eq!(teeth.len(), 2);
        for tooth in &teeth {
            let xs = || tooth.iter().map(|point| point[0].abs());
            assert!(xs().all(|x| (1.0..=3.0).contains(&x)) && tooth.len() == 4, "{tooth:?}");
        }
    }

    #[test]
    fn all_or_nothing_of_an_outline_is_left_where_no_side_is_crossed() {
        assert_eq!(clipped(vec![square(1.0)], &square(2.0)), [square(1.0)]);
        assert_eq!(
            clipped(vec![square(1.0).iter().map(|[x, y]| [x + 9.0, *y]).collect()], &square(2.0)),
            [] as [Contour; 0]
        );
        // A window inside the outline is what is left.
        let left = clipped(vec![square(3.0)], &square(2.0));
        assert!(
            left.len() == 1 && (crate::scene::shape::crossing::signed_area(&left[0]).abs() - 16.0).abs() < 1e-9,
            "{left:?}"
        );
    }
}

//! The outline of what rises to within a depth of a height map's top.

use super::{Contour, HeightMap, Shape};

const NONE: u32 = u32::MAX;

/// Outline of the pixels that are less than `drop_mm` below the map's top, in the part's frame; linear
/// between the pixels' centres, and the map's edge where they reach it.
pub fn outline(map: &HeightMap, drop_mm: f32) -> Shape {
    let [n_columns, n_rows] = map.size_px();
    let [mm_x, mm_y] = map.mm_per_px();
    let [x_min, y_min, ..] = map.bounds();
    // Points are the pixels' centres and one ring round them, which is always outside.
    let width = n_columns + 2;
    let drop = |row: usize, column: usize| {
        let on_map = (1..=n_rows).contains(&row) && (1..=n_columns).contains(&column);
        on_map.then(|| map.drops_mm()[(row - 1) * n_columns + column - 1])
    };
    let inside = |[row, column]: [usize; 2]| drop(row, column).is_some_and(|drop| drop < drop_mm);
    // Marching squares. An edge is its first point, doubled, plus one where it runs down.
    let mut next = vec![NONE; 2 * width * (n_rows + 2)];
    for row in 0..=n_rows {
        for column in 0..=n_columns {
            let corners = [[row, column], [row, column + 1], [row + 1, column + 1], [row + 1, column]].map(inside);
            if corners == [corners[0]; 4] {
                continue;
            }
            let edge = |row: usize, column: usize, down: usize| 2 * (row * width + column) + down;
            let edges =
                [edge(row, column, 0), edge(row, column + 1, 1), edge(row + 1, column, 0), edge(row, column, 1)];
            // Clockwise, the line goes from where the inside is left to where it is entered again.
            for leaves in (0..4).filter(|side| corners[*side] && !corners[(side + 1) % 4]) {
                let enters = (1..4).map(|step| (leaves + step) % 4).find(|side| corners[(side + 1) % 4]);
                next[edges[leaves]] = enters.map_or(NONE, |side| edges[side] as u32);
            }
        }
    }
    let place = |edge: usize| {
        let (row, column, down) = (edge / 2 / width, edge / 2 % width, edge % 2);
        let along = match (drop(row, column), drop(row + down, column + 1 - down)) {
            (Some(a), Some(b)) => f64::from((drop_mm - a) / (b - a)),
            _ => 0.5,
        };
        let [along_x, along_y] = if down == 1 { [0.0, along] } else { [along, 0.0] };
        [x_min + (column as f64 + along_x - 0.5) * mm_x, y_min + (row as f64 + along_y - 0.5) * mm_y]
    };
    let mut contours: Vec<Contour> = Vec::new();
    for first in 0..next.len() {
        let (mut contour, mut edge) = (Contour::new(), first);
        while next[edge] != NONE {
            contour.push(place(edge));
            edge = std::mem::replace(&mut next[edge], NONE) as usize;
        }
        if !contour.is_empty() {
            contours.push(contour);
        }
    }
    Shape { regions: if contours.is_empty() { Vec::new() } else { vec![contours] } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::crossing::{area_mm2, first_crossing};

    fn map(size_px: [usize; 2], height: impl Fn([f64; 2]) -> f64) -> HeightMap {
        let mm = 0.1;
        let at = |i: usize, n: usize| (i as f64 - 0.5 * (n - 1) as f64) * mm;
        let heights: Vec<f32> = (0..size_px[0] * size_px[1])
            .map(|i| height([at(i % size_px[0], size_px[0]), at(i / size_px[0], size_px[1])]) as f32)
            .collect();
        HeightMap::new(size_px, [mm, mm], &heights).unwrap()
    }

    #[test]
    fn the_level_of_a_cone_is_a_circle() {
        // Its top is half a pixel off the nearest centre: 0.07 mm below the peak.
        let cone = map([80, 60], |[x, y]| -x.hypot(y));
        let shape = outline(&cone.shifted([3.0, -2.0]), 2.0 - 0.0707);
        let contour = &shape.regions[0][0];
        assert!(contour.iter().all(|[x, y]| ((x - 3.0).hypot(y + 2.0) - 2.0).abs() < 0.002));
        assert!((area_mm2(&shape.regions[0]) - std::f64::consts::PI * 4.0).abs() < 0.02);
    }

    #[test]
    fn a_flat_map_is_its_own_rectangle_and_a_ring_keeps_its_counter() {
        let flat = outline(&map([30, 20], |_| 1.0), 1.0);
        assert_eq!(flat.regions[0].len(), 1);
        // The corners are cut by half a pixel each way.
        assert!((area_mm2(&flat.regions[0]) - (6.0 - 4.0 * 0.5 * 0.05 * 0.05)).abs() < 1e-9);
        let ring = outline(&map([60, 60], |[x, y]| if (1.0..2.0).contains(&x.hypot(y)) { 0.0 } else { -5.0 }), 1.0);
        assert_eq!(ring.regions[0].len(), 2);
        assert!((area_mm2(&ring.regions[0]) - 3.0 * std::f64::consts::PI).abs() < 0.5);
        assert_eq!(first_crossing(&ring.regions[0]), None);
    }

    #[test]
    fn pixels_that_touch_by_a_corner_are_parted_or_joined_but_never_lost() {
        let chess = map([2, 2], |[x, y]| if x * y > 0.0 { 0.0 } else { -1.0 });
        let region = &outline(&chess, 0.5).regions[0];
        assert_eq!(first_crossing(region), None);
        assert!(region.iter().map(Vec::len).sum::<usize>() == 8);
    }
}

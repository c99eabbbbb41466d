//! What a part puts in the gel's way.

use crate::dataset::touch::Side;
use crate::scene::shape::{Layer, Raster, Relief};

/// A square raster round a part's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// It reaches from `-half_mm` to `half_mm` in x and y.
    pub half_mm: f64,
    /// Side of a cell, mm.
    pub cell_mm: f64,
}

/// How far each cell must be pushed in for the gel not to enter the part, mm, pressed `depth_mm` deep; zero
/// where nothing is touched.
///
/// Pegs are on one board, so the highest is met; each hole is a plate with an opening, and an opening in
/// one of them opens the board, so the lowest is. A cell whose centre is less than one cell from a
/// face is pushed in as next to a straight edge, by `exp(-distance / gel_length_mm)`, so that outlines and
/// clearance count in fractions of a cell; without a gel length it is not touched.
pub fn obstacle(reliefs: &[Relief], side: Side, cells: Cells, gel_length_mm: Option<f64>, depth_mm: f64) -> Raster {
    let Cells { half_mm, cell_mm } = cells;
    let n = (2.0 * half_mm / cell_mm).ceil() as usize;
    let rests_on = |relief: &Relief| {
        let mut highest = Raster { n, cell_mm, values: vec![0.0; n * n] };
        for layer in &relief.layers {
            raise(&mut highest, layer, half_mm, gel_length_mm, depth_mm);
        }
        highest
    };
    let start = if side == Side::Peg { 0.0 } else { depth_mm as f32 };
    let mut board = Raster { n, cell_mm, values: vec![start; n * n] };
    for relief in reliefs {
        for (value, other) in board.values.iter_mut().zip(rests_on(relief).values) {
            *value = if side == Side::Peg { value.max(other) } else { value.min(other) };
        }
    }
    board
}

/// Raises the cells to a layer where it is higher.
fn raise(highest: &mut Raster, layer: &Layer, half_mm: f64, gel_length_mm: Option<f64>, depth_mm: f64) {
    let (n, cell_mm) = (highest.n, highest.cell_mm);
    match layer {
        Layer::Face(face) => {
            let depth = (depth_mm - face.drop_mm) as f32;
            if depth <= 0.0 {
                return;
            }
            let rounded_mm = face.rounding.map_or(0.0, |rounding| rounding.width_mm);
            let limit_mm = face.grow_mm.abs() + face.band_mm.unwrap_or(0.0) + rounded_mm + 2.0 * cell_mm;
            let distances = Raster::distance(&face.outline, half_mm, cell_mm, limit_mm);
            let sign = if face.outside { -1.0 } else { 1.0 };
            for (value, distance) in highest.values.iter_mut().zip(distances.values) {
                let outside = sign * (distance - face.grow_mm as f32);
                // Outside a band is what is beyond either of its edges.
                let outside = face.band_mm.map_or(outside, |band| outside.max(-outside - band as f32));
                let share = match outside {
                    ..=0.0 => 1.0,
                    outside if outside < cell_mm as f32 => gel_length_mm.map_or(0.0, |l| (-outside / l as f32).exp()),
                    _ => continue,
                };
                let fallen = face.rounding.map_or(0.0, |rounding| rounding.fallen_mm(f64::from(-outside)) as f32);
                *value = value.max((depth - fallen) * share);
            }
        }
        Layer::Heights(map) => {
            let [x_min, y_min, x_max, y_max] = map.bounds();
            let centre = |i: usize| (i as f64 - 0.5 * (n as f64 - 1.0)) * cell_mm;
            let within = |low: f64, high: f64| (0..n).filter(move |i| (low..=high).contains(&centre(*i)));
            for row in within(y_min, y_max) {
                for column in within(x_min, x_max) {
                    if let Some(drop_mm) = map.drop_at([centre(column), centre(row)]) {
                        let value = &mut highest.values[row * n + column];
                        *value = value.max(depth_mm as f32 - drop_mm);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::{Face, HeightMap, Rounding, Shape};

    fn square(half: f64) -> Shape {
        Shape { regions: vec![vec![vec![[-half, -half], [half, -half], [half, half], [-half, half]]]] }
    }

    /// The value at the cell nearest to a place.
    fn at(board: &Raster, x: f64, y: f64) -> f32 {
        let place = |mm: f64| (mm / board.cell_mm + 0.5 * board.n as f64) as usize;
        board.values[place(y) * board.n + place(x)]
    }

    const CELLS: Cells = Cells { half_mm: 5.0, cell_mm: 0.1 };

    #[test]
    fn a_band_ends_at_both_its_edges() {
        let shell = obstacle(&[Relief::peg(square(2.0)).banded(0.5)], Side::Peg, CELLS, None, 0.5);
        assert_eq!([1.0, 1.45, 1.55, 1.95, 2.05].map(|x| at(&shell, x, 0.0)), [0.0, 0.0, 0.5, 0.5, 0.0]);
        let rim = obstacle(&[Relief::hole(square(2.0), 0.2).banded(0.5)], Side::Hole, CELLS, None, 0.5);
        assert_eq!([1.0, 2.15, 2.25, 2.65, 2.75, 4.0].map(|x| at(&rim, x, 0.0)), [0.0, 0.0, 0.5, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn pegs_stand_together_and_openings_open_the_board() {
        let pegs = [Relief::peg(square(1.0)), Relief::peg(square(1.0)).shifted([3.0, 0.0])];
        let board = obstacle(&pegs, Side::Peg, CELLS, None, 0.5);
        assert_eq!([at(&board, 0.0, 0.0), at(&board, 3.0, 0.0), at(&board, 1.5, 0.0)], [0.5, 0.5, 0.0]);
        let holes = [Relief::hole(square(1.0), 0.2), Relief::hole(square(1.0), 0.2).shifted([3.0, 0.0])];
        let board = obstacle(&holes, Side::Hole, CELLS, None, 0.5);
        assert_eq!([at(&board, 0.0, 0.0), at(&board, 3.0, 0.0), at(&board, 1.5, 0.0)], [0.0, 0.0, 0.5]);
        assert_eq!([at(&board, 0.0, 1.15), at(&board, 0.0, 1.25)], [0.0, 0.5]);
    }

    #[test]
    fn a_rounded_edge_falls_as_an_ellipse_does_and_is_touched_down_to_the_press() {
        let rounding = Rounding { width_mm: 1.0, fall_mm: 0.8 };
        let felt = |relief: Relief, side| obstacle(&[relief.rounded(rounding)], side, CELLS, None, 0.5);
        let peg = felt(Relief::peg(square(2.0)), Side::Peg);
        let hole = felt(Relief::hole(square(2.0), 0.0), Side::Hole);
        for inside_mm in [0.05, 0.15, 0.45, 0.75, 1.05, 1.45] {
            let from_flat = f64::max(1.0 - inside_mm, 0.0);
            let expected = f64::max(0.5 - 0.8 * (1.0 - (1.0 - from_flat.powi(2)).sqrt()), 0.0);
            for felt in [at(&peg, 2.0 - inside_mm, 0.0), at(&hole, 2.0 + inside_mm, 0.0)] {
                assert!((f64::from(felt) - expected).abs() < 1e-3, "{inside_mm}: {felt}, not {expected}");
            }
        }
        assert!(at(&peg, 1.95, 0.0) == 0.0 && at(&peg, 0.0, 0.0) == 0.5);
    }

    #[test]
    fn lower_faces_and_heights_are_met_when_pressed_past_their_drop() {
        let face = |half, drop_mm| Layer::Face(Face { drop_mm, ..Face::of(square(half)) });
        let steps = [Relief { layers: vec![face(1.0, 0.0), face(2.0, 0.25)] }];
        let board = obstacle(&steps, Side::Peg, CELLS, None, 1.0);
        assert_eq!([at(&board, 0.0, 0.0), at(&board, 1.5, 0.0), at(&board, 2.5, 0.0)], [1.0, 0.75, 0.0]);
        assert_eq!(at(&obstacle(&steps, Side::Peg, CELLS, None, 0.2), 1.5, 0.0), 0.0);
        // Falls by 1 mm a mm from left to right.
        let slope: Vec<f32> = (0..400).map(|i| -0.1 * (i % 20) as f32).collect();
        let map = HeightMap::new([20, 20], [0.1, 0.1], &slope).unwrap();
        let board = obstacle(&[Relief { layers: vec![Layer::Heights(map)] }], Side::Peg, CELLS, None, 1.0);
        assert!((at(&board, -0.93, 0.0) - 1.0).abs() < 0.01 && (at(&board, -0.43, 0.0) - 0.5).abs() < 0.01);
        assert_eq!([at(&board, 0.5, 0.0), at(&board, 0.0, 1.2)], [0.0, 0.0]);
    }
}

//! One side of a part as the gel meets it: faces at several heights, or a height map.

use super::height_map::HeightMap;
use super::{Raster, Shape};

/// Deepest drop that counts when two halves of a side are compared, mm: what is lower is hardly touched.
const LOOK_MM: f32 = 1.0;

/// One side of one part, seen from the sensor. Where there is no layer it is open and never touched.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Relief {
    /// What is there; where layers overlap, the highest is touched.
    pub layers: Vec<Layer>,
}

/// One height of a relief.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// A flat face.
    Face(Face),
    /// A measured surface.
    Heights(HeightMap),
}

/// A flat face bounded by an outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// The outline, mm.
    pub outline: Shape,
    /// By how much the outline is widened on every side before use, mm.
    pub grow_mm: f64,
    /// Whether the face is outside the outline instead of inside: a plate round an opening.
    pub outside: bool,
    /// How far the face is below the highest point of the side, mm.
    pub drop_mm: f64,
    /// The face is a band of this width along the outline instead of all on its side of it, mm: a shell, a rim.
    pub band_mm: Option<f64>,
    /// How its edges are rounded; none: they are sharp.
    pub rounding: Option<Rounding>,
}

impl Face {
    /// All inside an outline, at the height of the side's highest point, with sharp edges.
    pub fn of(outline: Shape) -> Self {
        Self { outline, grow_mm: 0.0, outside: false, drop_mm: 0.0, band_mm: None, rounding: None }
    }
}

/// A rounded edge: from `width_mm` inside the outline outwards the face falls as a quarter of an ellipse does. A face
/// less than twice as wide is a dome.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounding {
    /// How far from the outline the face begins to fall, mm, more than 0.
    pub width_mm: f64,
    /// How far it has fallen at the outline, mm.
    pub fall_mm: f64,
}

impl Rounding {
    /// How far the face has fallen at a place `inside_mm` from the outline, mm.
    pub fn fallen_mm(self, inside_mm: f64) -> f64 {
        let from_flat = (1.0 - inside_mm / self.width_mm).clamp(0.0, 1.0);
        self.fall_mm * (1.0 - (1.0 - from_flat * from_flat).sqrt())
    }
}

impl Relief {
    /// A peg: the outline's inside is raised.
    pub fn peg(outline: Shape) -> Self {
        Self { layers: vec![Layer::Face(Face::of(outline))] }
    }

    /// A hole: a plate with an opening, wider than the outline by `clearance_mm` on every side.
    pub fn hole(outline: Shape, clearance_mm: f64) -> Self {
        let plate = Face { grow_mm: clearance_mm, outside: true, ..Face::of(outline) };
        Self { layers: vec![Layer::Face(plate)] }
    }

    /// A measured plate with its openings: off the map the plate continues at the height of the map's top.
    pub fn plate(map: HeightMap) -> Self {
        let edge = Face { outside: true, ..Face::of(rectangle(map.bounds())) };
        Self { layers: vec![Layer::Heights(map), Layer::Face(edge)] }
    }

    /// The same relief with the outlines of its faces wider by `grow_mm` on every side.
    pub fn grown(mut self, grow_mm: f64) -> Self {
        for layer in &mut self.layers {
            if let Layer::Face(face) = layer {
                face.grow_mm += if face.outside { -grow_mm } else { grow_mm };
            }
        }
        self
    }

    /// The same relief with its faces as bands of this width along their outlines: shells of pegs, rims of holes.
    pub fn banded(mut self, band_mm: f64) -> Self {
        for layer in &mut self.layers {
            if let Layer::Face(face) = layer {
                face.band_mm = Some(band_mm);
            }
        }
        self
    }

    /// The same relief with the edges of its faces rounded.
    pub fn rounded(mut self, rounding: Rounding) -> Self {
        for layer in &mut self.layers {
            if let Layer::Face(face) = layer {
                face.rounding = Some(rounding);
            }
        }
        self
    }

    /// The same relief moved by `offset_mm`.
    pub fn shifted(self, [dx, dy]: [f64; 2]) -> Self {
        let moved = |layer| match layer {
            Layer::Face(face) => Layer::Face(Face { outline: face.outline.map(|[x, y]| [x + dx, y + dy]), ..face }),
            Layer::Heights(map) => Layer::Heights(map.shifted([dx, dy])),
        };
        Self { layers: self.layers.into_iter().map(moved).collect() }
    }

    /// Whether all that can be touched is at one height, so that a deeper press only scales the gel's
    /// surface.
    pub fn is_flat(&self) -> bool {
        self.layers
            .iter()
            .all(|layer| matches!(layer, Layer::Face(face) if face.drop_mm == 0.0 && face.rounding.is_none()))
    }

    /// Whether the side looks the same after half a turn about the part's centre (a peg of I, N and O does),
    /// to 1 % of what differs from the open or the bare plate round it.
    pub fn is_half_turn_symmetric(&self) -> bool {
        let bounds = self.layers.iter().flat_map(|layer| match layer {
            Layer::Face(face) => face.outline.bounds(),
            Layer::Heights(map) => map.bounds(),
        });
        let half = bounds.map(f64::abs).fold(0.0, f64::max);
        if half == 0.0 {
            return true;
        }
        // Heights above the deepest that counts, as a share of it: coverage for a flat peg.
        let (half_mm, cell_mm) = (1.05 * half, half / 100.0);
        let n = (2.0 * half_mm / cell_mm).ceil() as usize;
        let mut values = vec![0.0_f32; n * n];
        let rise = |drop_mm: f32| (1.0 - drop_mm / LOOK_MM).max(0.0);
        let mut around = 0.0;
        for layer in &self.layers {
            match layer {
                Layer::Face(face) => {
                    let height = rise(face.drop_mm as f32);
                    around = if face.outside { height.max(around) } else { around };
                    let covered = Raster::coverage(&face.outline, half_mm, cell_mm);
                    for (value, covered) in values.iter_mut().zip(covered.values) {
                        *value = value.max(height * if face.outside { 1.0 - covered } else { covered });
                    }
                }
                Layer::Heights(map) => {
                    let centre = |i: usize| (i as f64 + 0.5 - 0.5 * n as f64) * cell_mm;
                    for (i, value) in values.iter_mut().enumerate() {
                        *value = value.max(map.drop_at([centre(i % n), centre(i / n)]).map_or(0.0, rise));
                    }
                }
            }
        }
        let differs: f32 = values.iter().zip(values.iter().rev()).map(|(a, b)| (a - b).abs()).sum();
        differs < 0.01 * values.iter().map(|value| (value - around).abs()).sum::<f32>()
    }
}

/// A rectangle as an outline, from `[x_min, y_min, x_max, y_max]` in mm.
pub fn rectangle([x_min, y_min, x_max, y_max]: [f64; 4]) -> Shape {
    Shape { regions: vec![vec![vec![[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]]]] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::glyph::glyph;

    #[test]
    fn letters_that_look_alike_upside_down_are_known_on_both_sides() {
        let symmetric = |side: fn(Shape) -> Relief| -> String {
            ('A'..='Z').filter(|c| side(glyph(*c, 32.0, 40.0).unwrap()).is_half_turn_symmetric()).collect()
        };
        // This font draws H, S, X and Z a little heavier at the foot: their halves differ.
        assert_eq!(symmetric(Relief::peg), "INO");
        assert_eq!(symmetric(|outline| Relief::hole(outline, 0.15)), "INO");
    }

    #[test]
    fn a_step_tells_the_halves_of_a_square_apart() {
        let square = rectangle([-3.0, -3.0, 3.0, 3.0]);
        let upper = rectangle([-3.0, -3.0, 3.0, 0.0]);
        let layer = |outline: &Shape, drop_mm| Layer::Face(Face { drop_mm, ..Face::of(outline.clone()) });
        let stepped = |drop_mm| Relief { layers: vec![layer(&upper, 0.0), layer(&square, drop_mm)] };
        assert!(stepped(0.0).is_half_turn_symmetric() && !stepped(0.5).is_half_turn_symmetric());
    }

    #[test]
    fn a_measured_surface_is_judged_by_its_heights() {
        let map = |height: fn(f64, f64) -> f64| {
            let at = |i: usize| (i as f64 - 29.5) * 0.1;
            let heights: Vec<f32> = (0..3_600).map(|i| height(at(i % 60), at(i / 60)) as f32).collect();
            Relief { layers: vec![Layer::Heights(HeightMap::new([60, 60], [0.1, 0.1], &heights).unwrap())] }
        };
        assert!(map(|x, y| x * y).is_half_turn_symmetric());
        assert!(!map(|x, _| 0.2 * x).is_half_turn_symmetric());
    }
}

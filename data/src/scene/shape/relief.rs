//! One side of a part as the gel meets it: faces at several heights, or a height map.

use super::Shape;
use super::height_map::HeightMap;

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
}

/// A rectangle as an outline, from `[x_min, y_min, x_max, y_max]` in mm.
pub fn rectangle([x_min, y_min, x_max, y_max]: [f64; 4]) -> Shape {
    Shape { regions: vec![vec![vec![[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]]]] }
}

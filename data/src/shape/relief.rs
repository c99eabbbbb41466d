//! One side of a part as the gel meets it: faces at several heights, or a height map.

use super::Shape;
use super::height_map::HeightMap;

/// One side of one part, seen from the sensor. Where no layer lies it is open and never touched.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Relief {
    /// What lies there; where layers overlap, the highest is touched.
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
    /// Whether the face lies outside the outline instead of inside: a plate round an opening.
    pub outside: bool,
    /// How far the face lies below the highest point of the side, mm.
    pub drop_mm: f64,
}

impl Relief {
    /// A peg: the outline's inside stands up.
    pub fn peg(outline: Shape) -> Self {
        Self { layers: vec![Layer::Face(Face { outline, grow_mm: 0.0, outside: false, drop_mm: 0.0 })] }
    }

    /// A hole: a plate with an opening, wider than the outline by `clearance_mm` on every side.
    pub fn hole(outline: Shape, clearance_mm: f64) -> Self {
        Self { layers: vec![Layer::Face(Face { outline, grow_mm: clearance_mm, outside: true, drop_mm: 0.0 })] }
    }

    /// The same relief moved by `offset_mm`.
    pub fn shifted(self, [dx, dy]: [f64; 2]) -> Self {
        let moved = |layer| match layer {
            Layer::Face(face) => Layer::Face(Face { outline: face.outline.map(|[x, y]| [x + dx, y + dy]), ..face }),
            Layer::Heights(map) => Layer::Heights(map.shifted([dx, dy])),
        };
        Self { layers: self.layers.into_iter().map(moved).collect() }
    }

    /// Whether all that can be touched lies at one height, so that a deeper press only scales the gel's
    /// surface.
    pub fn is_flat(&self) -> bool {
        self.layers.iter().all(|layer| matches!(layer, Layer::Face(face) if face.drop_mm == 0.0))
    }
}

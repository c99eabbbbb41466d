//! One part of a kit.

use crate::dataset::touch::Side;
use crate::scene::shape::{Relief, Shape};

/// One part of a kit, with both its sides; all mm round its centre.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// Outline of the peg.
    pub outline: Shape,
    /// What the hole's side takes of a board, before the clearance.
    pub taken: Shape,
    /// By how much the opening is widened on every side, mm.
    pub clearance_mm: f64,
    /// Whether the hole's side is mounted on the board instead of being a plate with an opening.
    pub stands: bool,
    /// What is felt of the peg.
    pub peg: Relief,
    /// What is felt of the hole.
    pub hole: Relief,
}

impl Part {
    /// A part whose hole is a through opening of its outline.
    pub fn extruded(outline: Shape, peg: Relief, clearance_mm: f64) -> Self {
        let hole = Relief::hole(outline.clone(), clearance_mm);
        Self { taken: outline.clone(), outline, clearance_mm, stands: false, peg, hole }
    }

    /// One of its sides.
    pub fn side(self, side: Side) -> Relief {
        match side {
            Side::Peg => self.peg,
            Side::Hole => self.hole,
        }
    }

    /// What a peg goes into, and by how much it is widened on every side, mm; `None` where the hole's side
    /// is mounted on the board.
    pub fn opening(self) -> Option<(Shape, f64)> {
        (!self.stands).then_some((self.taken, self.clearance_mm))
    }

    /// What peg and hole take of a board, before the clearance.
    pub fn footprint(&self) -> Shape {
        Shape { regions: self.outline.regions.iter().chain(&self.taken.regions).cloned().collect() }
    }

    /// Smallest box `[x_min, y_min, x_max, y_max]` round the footprint, mm.
    pub fn bounds(&self) -> [f64; 4] {
        let [x_min, y_min, x_max, y_max] = self.footprint().bounds();
        let grow = self.clearance_mm;
        [x_min - grow, y_min - grow, x_max + grow, y_max + grow]
    }
}

//! How often the sides of a part are rims, shells or rounded.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use crate::dataset::touch::Side;
use crate::scene::random::uniform;
use crate::scene::shape::{Face, Layer, Relief, Rounding, Shape};

/// Least and greatest distance between a rim or shell and its core, mm.
const CORE_INSET_MM: [f64; 2] = [0.2, 1.0];

/// Least and greatest depth of a core below its rim or shell, mm.
const CORE_DROP_MM: [f64; 2] = [0.0, 0.8];

/// Least and greatest width of a rounded edge, mm, drawn log-uniformly: from a broken edge to a dome.
const ROUNDING_MM: [f64; 2] = [0.3, 4.0];

/// How far a rounded edge falls, as a share of its width.
const FALL_SHARE: [f64; 2] = [0.3, 1.0];

/// How far it falls at most, mm, if nothing else is asked for: what is deeper a press of a millimetre hardly feels.
pub(super) const MOST_FALL_MM: f64 = 1.0;

/// Shares of the holes that are rims instead of openings in a plate, of the pegs that are shells instead of solid, and of
/// both that have rounded edges; each is drawn for a side alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct SideShares {
    /// Share of the rims and of the shells.
    pub band: f64,
    /// Narrowest and widest rim or shell, mm, drawn log-uniformly.
    pub band_mm: [f64; 2],
    /// Share of the rims and of the shells with a core inside.
    pub core: f64,
    /// Share of the sides with rounded edges.
    pub rounded: f64,
    /// How far a rounded edge falls at most, mm.
    pub most_fall_mm: f64,
}

impl SideShares {
    /// One side of a part or board whose pegs have the outline `walls`; its rim or shell and its rounding are drawn from
    /// `rng`.
    pub fn side(&self, walls: Shape, side: Side, clearance_mm: f64, rng: &mut ChaCha8Rng) -> Relief {
        let relief = self.banded(walls, side, clearance_mm, rng);
        if rng.random::<f64>() >= self.rounded {
            return relief;
        }
        let width_mm = uniform(rng, ROUNDING_MM.map(f64::ln)).exp();
        let fall_mm = (width_mm * uniform(rng, FALL_SHARE)).min(self.most_fall_mm);
        relief.rounded(Rounding { width_mm, fall_mm })
    }

    fn banded(&self, walls: Shape, side: Side, clearance_mm: f64, rng: &mut ChaCha8Rng) -> Relief {
        let whole = match side {
            Side::Peg => Relief::peg(walls.clone()),
            Side::Hole => Relief::hole(walls.clone(), clearance_mm),
        };
        if rng.random::<f64>() >= self.band {
            return whole;
        }
        // Log-uniform: sheet metal is as common as a block's wall.
        let band_mm = uniform(rng, self.band_mm.map(f64::ln)).exp();
        let (inset_mm, drop_mm) = (uniform(rng, CORE_INSET_MM), uniform(rng, CORE_DROP_MM));
        let mut relief = whole.banded(band_mm);
        if rng.random::<f64>() < self.core {
            // A shell's core begins where the shell ends.
            let grow_mm = -inset_mm - if side == Side::Peg { band_mm } else { 0.0 };
            relief.layers.push(Layer::Face(Face { grow_mm, drop_mm, ..Face::of(walls) }));
        }
        relief
    }
}

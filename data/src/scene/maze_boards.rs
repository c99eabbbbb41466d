//! MAZE boards as a scene declares them.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::sensor::SensorSpec;
use crate::shape::maze::MazeSpec;
use crate::shape::{Face, Layer, Relief, Shape};
use crate::simulator::frame_rng;
use crate::touch::Side;

/// A set of MAZE boards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MazeBoards {
    /// Boards to draw.
    pub n_boards: usize,
    /// The last boards of these are held out: never trained on.
    pub n_held_out: usize,
    /// Pairs of touches over all boards.
    pub n_pairs: usize,
    /// Shortest and longest decay length of the gel, mm; one is drawn for each board, since another
    /// gel is what a trained model meets.
    pub gel_length_mm: [f64; 2],
    /// Share of the boards whose holes are rims instead of openings in a plate and, drawn apart, of those whose
    /// pegs are shells instead of solid, as sockets and plugs are, 0..=1.
    #[serde(default)]
    pub band_share: f64,
    /// Narrowest and widest rim or shell, mm; drawn for each.
    #[serde(default = "default_band")]
    pub band_mm: [f64; 2],
    /// Share of the rims and of the shells with a core inside: a socket's tongue, a plug's insulator, 0..=1.
    #[serde(default)]
    pub core_share: f64,
    /// How boards are drawn.
    #[serde(default)]
    pub spec: MazeSpec,
}

/// Least and greatest distance between a rim or shell and its core, mm.
const CORE_INSET_MM: [f64; 2] = [0.2, 1.0];

/// Least and greatest depth of a core below its rim or shell, mm.
const CORE_DROP_MM: [f64; 2] = [0.0, 0.8];

fn default_band() -> [f64; 2] {
    [0.3, 2.0]
}

impl MazeBoards {
    /// One side of a board whose pegs have the outline `walls`; `seed` draws the boards.
    pub fn side(&self, walls: Shape, board: usize, side: Side, clearance_mm: f64, seed: u64) -> Relief {
        let whole = match side {
            Side::Peg => Relief::peg(walls.clone()),
            Side::Hole => Relief::hole(walls.clone(), clearance_mm),
        };
        let mut rng = frame_rng(seed ^ 0x6261_6e64, 2 * board as u64 + u64::from(side == Side::Peg));
        if rng.random::<f64>() >= self.band_share {
            return whole;
        }
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        let (band_mm, inset_mm, drop_mm) = (between(self.band_mm), between(CORE_INSET_MM), between(CORE_DROP_MM));
        let mut relief = whole.banded(band_mm);
        if between([0.0, 1.0]) < self.core_share {
            // A shell's core begins where the shell ends.
            let grow_mm = -inset_mm - if side == Side::Peg { band_mm } else { 0.0 };
            relief.layers.push(Layer::Face(Face { outline: walls, grow_mm, outside: false, drop_mm, band_mm: None }));
        }
        relief
    }

    /// Refuses boards that cannot be drawn or touched, naming the field.
    pub(super) fn validate(&self, sensor: &SensorSpec) -> Result<()> {
        if self.n_boards == 0 || self.n_held_out >= self.n_boards {
            let got = format!("{} of {}", self.n_held_out, self.n_boards);
            return Err(Error::invalid("parts.maze.n_held_out", "fewer than n_boards", got));
        }
        if self.n_pairs == 0 {
            return Err(Error::invalid("parts.maze.n_pairs", "at least one pair", "0"));
        }
        let view = sensor.field_of_view_mm[0].hypot(sensor.field_of_view_mm[1]);
        let spec = &self.spec;
        if !(spec.side_mm > view && spec.side_mm <= 300.0) {
            let expected = format!("more than a view's diagonal of {view:.1} mm, at most 300");
            return Err(Error::invalid("parts.maze.spec.side_mm", expected, spec.side_mm.to_string()));
        }
        let ordered = |field: &str, [low, high]: [f64; 2], least: f64, most: f64| {
            let fits = low >= least && high >= low && high <= most;
            let error = || {
                Error::invalid(
                    format!("parts.maze.{field}"),
                    format!("{least} to {most}, in order"),
                    format!("{low}..{high}"),
                )
            };
            fits.then_some(()).ok_or_else(error)
        };
        ordered("band_share", [0.0, self.band_share], 0.0, 1.0)?;
        ordered("core_share", [0.0, self.core_share], 0.0, 1.0)?;
        ordered("band_mm", self.band_mm, 0.1, 20.0)?;
        ordered("gel_length_mm", self.gel_length_mm, 0.1, 10.0)?;
        ordered("spec.pitch_mm", spec.pitch_mm, 1.0, spec.side_mm)?;
        ordered("spec.wall_share", spec.wall_share, 0.05, 0.9)?;
        ordered("spec.kept_share", spec.kept_share, 0.0, 1.0)?;
        ordered("spec.node_jitter", [spec.node_jitter, 0.5], 0.0, 0.5)?;
        ordered("spec.bent_share", [spec.bent_share, 1.0], 0.0, 1.0)
    }
}

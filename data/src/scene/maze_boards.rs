//! MAZE boards as a scene declares them.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::sensor::SensorSpec;
use crate::shape::maze::MazeSpec;
use crate::simulator::frame_rng;

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
    /// Share of the boards whose holes are rims and whose pegs are shells, as sockets and plugs are, 0..=1.
    #[serde(default)]
    pub band_share: f64,
    /// Narrowest and widest rim or shell, mm; both are drawn for each such board.
    #[serde(default = "default_band")]
    pub band_mm: [f64; 2],
    /// How boards are drawn.
    #[serde(default)]
    pub spec: MazeSpec,
}

fn default_band() -> [f64; 2] {
    [0.3, 2.0]
}

impl MazeBoards {
    /// Width of a board's rims and of its shells, mm; `None` for plates and solid pegs. `seed` draws the boards.
    pub fn bands_mm(&self, board: usize, seed: u64) -> Option<[f64; 2]> {
        let mut rng = frame_rng(seed ^ 0x6261_6e64, board as u64);
        let [narrow, wide] = self.band_mm;
        let is_banded = rng.random::<f64>() < self.band_share;
        let drawn = [0, 1].map(|_| narrow + (wide - narrow) * rng.random::<f64>());
        is_banded.then_some(drawn)
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
        ordered("band_mm", self.band_mm, 0.1, 20.0)?;
        ordered("gel_length_mm", self.gel_length_mm, 0.1, 10.0)?;
        ordered("spec.pitch_mm", spec.pitch_mm, 1.0, spec.side_mm)?;
        ordered("spec.wall_share", spec.wall_share, 0.05, 0.9)?;
        ordered("spec.node_jitter", [spec.node_jitter, 0.5], 0.0, 0.5)?;
        ordered("spec.bent_share", [spec.bent_share, 1.0], 0.0, 1.0)
    }
}

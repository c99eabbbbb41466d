//! MAZE boards as a scene declares them.

use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::side_shares::{MOST_FALL_MM, SideShares};
use super::{SensorRange, is_zero};
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::scene::random::{around_zero, frame_rng, uniform};
use crate::scene::shape::maze::MazeSpec;
use crate::sensor::SensorSpec;

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
    /// Share of the boards whose holes are rims instead of openings in a plate and, drawn separately, of the boards
    /// whose pegs are shells instead of solid, as sockets and plugs are, 0..=1.
    #[serde(default)]
    pub band_share: f64,
    /// Narrowest and widest rim or shell, mm; drawn for each, narrow ones as often as wide ones in each octave.
    #[serde(default = "default_band")]
    pub band_mm: [f64; 2],
    /// Share of the rims and of the shells with a core inside: a socket's tongue, a plug's insulator, 0..=1.
    #[serde(default)]
    pub core_share: f64,
    /// Share of the boards whose holes have rounded edges and, drawn separately, of the boards whose pegs have
    /// them, 0..=1.
    /// A wall narrower than twice the rounding is a dome.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rounded_share: f64,
    /// How far a rounded edge falls at most, mm: a press that is deeper feels more of it.
    #[serde(default = "most_fall_mm", skip_serializing_if = "is_most_fall")]
    pub most_fall_mm: f64,
    /// Other sensors, one drawn for each board; without them the scene's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensors: Option<SensorRange>,
    /// How boards are drawn.
    #[serde(default)]
    pub spec: MazeSpec,
}

/// The most boards of a scene: what is known of a board before it is touched takes about 1 kB of memory.
const MOST_BOARDS: usize = 100_000;

fn default_band() -> [f64; 2] {
    [0.25, 2.5]
}

fn most_fall_mm() -> f64 {
    MOST_FALL_MM
}

fn is_most_fall(mm: &f64) -> bool {
    *mm == MOST_FALL_MM
}

impl MazeBoards {
    /// What draws the rim or the shell of one side of a board, where `seed` draws the boards.
    pub(super) fn band_rng(seed: u64, board: usize, side: Side) -> ChaCha8Rng {
        frame_rng(seed ^ 0x6261_6e64, 2 * board as u64 + u64::from(side == Side::Peg))
    }

    /// How the sides of boards are drawn.
    pub(super) fn side_shares(&self) -> SideShares {
        let Self { band_share, band_mm, core_share, rounded_share, most_fall_mm, .. } = *self;
        SideShares { band: band_share, band_mm, core: core_share, rounded: rounded_share, most_fall_mm }
    }

    /// The diagonal of the largest view that a sensor may have, mm.
    pub fn widest_view_mm(&self, sensor: &SensorSpec) -> f64 {
        let [width, height] = sensor.field_of_view_mm;
        self.sensors.map_or(1.0, |sensors| sensors.widest()) * width.hypot(height)
    }

    /// A sensor drawn round the scene's own: another gel, other lamps and, where boards are felt by many sensors, another
    /// press, camera and scale.
    pub fn draw_sensor(&self, spec: &SensorSpec, rng: &mut ChaCha8Rng) -> SensorSpec {
        let gel_length_mm = uniform(rng, self.gel_length_mm);
        let mut around = |half| around_zero(rng, half);
        // Two Minis' fitted lamps differ by some 4 to 17 degrees and 10 % of brightness.
        let (strength, turn_deg) = ([0; 3].map(|_| 1.0 + around(0.15)), [0; 3].map(|_| around(10.0)));
        let spec = SensorSpec { gel_length_mm, light: spec.light.varied(strength, turn_deg), ..spec.clone() };
        match self.sensors {
            Some(sensors) => sensors.draw(spec, rng),
            None => spec,
        }
    }

    /// Refuses boards that cannot be drawn or touched, naming the field.
    pub(super) fn validate(&self, sensor: &SensorSpec) -> Result<()> {
        if self.n_boards > MOST_BOARDS {
            let expected = format!("at most {MOST_BOARDS}, each kept in memory");
            return Err(Error::invalid("parts.maze.n_boards", expected, self.n_boards.to_string()));
        }
        if self.n_boards == 0 || self.n_held_out >= self.n_boards {
            let got = format!("{} of {}", self.n_held_out, self.n_boards);
            return Err(Error::invalid("parts.maze.n_held_out", "fewer than n_boards", got));
        }
        if self.n_pairs == 0 {
            return Err(Error::invalid("parts.maze.n_pairs", "at least one pair", "0"));
        }
        self.sensors.map_or(Ok(()), |sensors| sensors.validate())?;
        let view = self.widest_view_mm(sensor);
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
        ordered("band_mm", self.band_mm, 0.1, 20.0)?;
        ordered("gel_length_mm", self.gel_length_mm, 0.1, 10.0)?;
        ordered("most_fall_mm", [self.most_fall_mm; 2], 0.1, 10.0)?;
        ordered("spec.pitch_mm", spec.pitch_mm, 1.0, spec.side_mm)?;
        ordered("spec.wall_share", spec.wall_share, 0.05, 0.9)?;
        ordered("spec.kept_share", spec.kept_share, 0.0, 1.0)?;
        let shares = [
            ("band_share", self.band_share, 1.0),
            ("core_share", self.core_share, 1.0),
            ("rounded_share", self.rounded_share, 1.0),
            ("spec.node_jitter", spec.node_jitter, 0.5),
            ("spec.bent_share", spec.bent_share, 1.0),
            ("spec.island_share", spec.island_share, 1.0),
        ];
        match shares.into_iter().find(|(_, value, most)| !(0.0..=*most).contains(value)) {
            Some((field, value, most)) => {
                Err(Error::invalid(format!("parts.maze.{field}"), format!("0 to {most}"), value.to_string()))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::relief::rectangle;
    use crate::scene::shape::{Face, Layer, Relief, Rounding, Shape};
    use crate::scene::{Parts, Scene};
    use crate::sensor::obstacle::{Cells, obstacle};

    fn boards(band_share: f64, core_share: f64) -> MazeBoards {
        let Parts::Maze(maze) = Scene::preset("maze").unwrap().parts else { panic!("maze boards") };
        MazeBoards { band_share, core_share, ..maze }
    }

    fn wall() -> Shape {
        rectangle([-30.0, -3.0, 30.0, 3.0])
    }

    fn drawn(boards: &MazeBoards, board: usize, side: Side, clearance_mm: f64, seed: u64) -> Relief {
        boards.side_shares().side(wall(), side, clearance_mm, &mut MazeBoards::band_rng(seed, board, side))
    }

    #[test]
    fn rims_and_shells_are_drawn_apart_each_as_often_as_asked() {
        let boards = boards(0.3, 0.5);
        let boards = &boards;
        let built = |side| (0..400).map(move |board| drawn(boards, board, side, 0.15, 7).layers);
        let [pegs, holes]: [Vec<_>; 2] = [Side::Peg, Side::Hole].map(|side| built(side).collect());
        let is_band = |layers: &Vec<Layer>| matches!(&layers[0], Layer::Face(face) if face.band_mm.is_some());
        for side in [&pegs, &holes] {
            let (bands, cores): (Vec<_>, Vec<_>) = (
                side.iter().filter(|layers| is_band(layers)).collect(),
                side.iter().filter(|layers| layers.len() == 2).collect(),
            );
            // Four standard errors of a share of 400, and of 120.
            assert!((bands.len() as f64 / 400.0 - 0.3).abs() < 0.092, "{}", bands.len());
            assert!((cores.len() as f64 / bands.len() as f64 - 0.5).abs() < 0.183, "{}", cores.len());
        }
        let both = pegs.iter().zip(&holes).filter(|(peg, hole)| is_band(peg) && is_band(hole)).count();
        assert!((both as f64 / 400.0 - 0.09).abs() < 0.058, "{both}");
    }

    #[test]
    fn a_socket_and_a_plug_meet_the_gel_where_they_stand() {
        let boards = MazeBoards { band_mm: [0.5, 0.5], ..boards(1.0, 1.0) };
        let (half_mm, cell_mm) = (6.0, 0.05);
        for board in 0..10 {
            let felt = |side: Side| {
                obstacle(&[drawn(&boards, board, side, 0.2, 3)], side, Cells { half_mm, cell_mm }, None, 1.0)
            };
            let at = |raster: &crate::scene::shape::Raster, y: f64| {
                let cell = |mm: f64| ((mm + half_mm) / cell_mm) as usize;
                raster.values[cell(y) * raster.n + cell(0.0)]
            };
            let (peg, hole) = (felt(Side::Peg), felt(Side::Hole));
            // A shell from 2.5 to 3 mm, a rim from 3.2 to 3.7, open beyond; a core in the middle, open next to the bands.
            assert_eq!([2.8, 3.1, 5.0].map(|y| at(&peg, y)), [1.0, 0.0, 0.0]);
            assert_eq!([3.1, 3.4, 4.0].map(|y| at(&hole, y)), [0.0, 1.0, 0.0]);
            assert!(at(&peg, 2.4) == 0.0 && at(&hole, 2.9) == 0.0);
            assert!([&peg, &hole].iter().all(|side| (0.2..=1.0).contains(&at(side, 0.0))));
        }
    }

    #[test]
    fn edges_are_rounded_as_often_as_asked_and_nothing_else_is_changed() {
        let (sharp, rounded) =
            (boards(0.5, 0.5), MazeBoards { rounded_share: 0.25, most_fall_mm: 2.5, ..boards(0.5, 0.5) });
        let (mut n_rounded, mut farthest) = (0, 0.0);
        for board in 0..400 {
            let [plain, mut relief] = [&sharp, &rounded].map(|boards| drawn(boards, board, Side::Peg, 0.15, 7));
            n_rounded += usize::from(!relief.is_flat() && relief != plain);
            for layer in &mut relief.layers {
                if let Layer::Face(Face { rounding, .. }) = layer {
                    let given = rounding.take().is_none_or(|Rounding { width_mm, fall_mm }| {
                        farthest = f64::max(farthest, fall_mm);
                        (0.3..=4.0).contains(&width_mm) && (0.09..=2.5).contains(&fall_mm) && fall_mm <= width_mm
                    });
                    assert!(given);
                }
            }
            assert_eq!(relief, plain);
        }
        // Four standard errors of a share of 400.
        assert!((f64::from(n_rounded as u32) / 400.0 - 0.25).abs() < 0.087, "{n_rounded}");
        // One in twenty falls farther.
        assert_eq!(farthest, 2.5);
    }

    #[test]
    fn plain_boards_are_plates_and_solid_pegs() {
        let boards = boards(0.0, 1.0);
        assert_eq!(drawn(&boards, 3, Side::Peg, 0.2, 1), Relief::peg(wall()));
        assert_eq!(drawn(&boards, 3, Side::Hole, 0.2, 1), Relief::hole(wall(), 0.2));
    }
}

//! What is simulated: parts, board, sensor, reach and fidelity. Everything else follows from a scene.

mod board;
pub mod lab;
mod maze_boards;
mod maze_parts;
mod origin;
mod part;
mod parts;
mod preset;
pub(crate) mod random;
mod sensor_range;
mod sensor_table;
pub mod shape;
mod side_shares;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::dataset::needs::Needs;
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::light::calibrate::Calibration;
use crate::pose::grid::PoseGrid;
use crate::scene::shape::maze::maze;
use crate::scene::shape::{Relief, Shape};
use crate::sensor::{Fidelity, SensorSpec};
use crate::text::printable::is_printable;
use crate::text::suggest::with_closest;

pub use board::Board;
pub use maze_boards::MazeBoards;
pub use maze_parts::MazeParts;
pub use parts::{Connectors, Kit, Letters, Outlines, PartFile, Parts, Solids};
pub use sensor_range::SensorRange;

use parts::MOST_PARTS;

/// A scene, as a TOML file declares it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// A short name.
    pub name: String,
    /// What is touched.
    pub parts: Parts,
    /// The board that the parts share; without it each is alone in an endless one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<Board>,
    /// The poses at which each part is recorded; MAZE boards are touched anywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<PoseGrid>,
    /// By how much a hole's outline is wider than its peg's on every side, mm.
    #[serde(default = "default_clearance")]
    pub clearance_mm: f64,
    /// How much of the sensor is computed.
    #[serde(default = "default_fidelity")]
    pub fidelity: Fidelity,
    /// The sensor. In a file it may also have a `preset` and `mm_per_px`, see `data/scenes/`.
    #[serde(default, deserialize_with = "sensor_table::deserialize")]
    pub sensor: SensorSpec,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn default_clearance() -> f64 {
    0.15
}

fn default_fidelity() -> Fidelity {
    Fidelity::Camera
}

impl Scene {
    /// A preset, or a TOML file; paths in it start at its folder. `FILE.toml#24+12` takes parts 24 to 35 of its MAZE parts.
    ///
    /// # Errors
    /// A scene that cannot be read or touched: the file, the line where it is known, and the field that is wrong. MAZE
    /// parts that the scene does not have.
    pub fn load(preset_or_file: &str) -> Result<Self> {
        let file = Self::file_of(preset_or_file);
        let whole = Self::load_whole(file)?;
        match preset_or_file[file.len()..].strip_prefix('#') {
            Some(range) => whole.take(range).map_err(|e| e.within(preset_or_file)),
            None => Ok(whole),
        }
    }

    /// The preset or file that [`Self::load`] reads: without the parts that are taken of it.
    pub fn file_of(preset_or_file: &str) -> &str {
        match preset_or_file.rsplit_once('#') {
            Some((whole, _)) if !Path::new(preset_or_file).exists() => whole,
            _ => preset_or_file,
        }
    }

    fn load_whole(preset_or_file: &str) -> Result<Self> {
        if let Some(scene) = Self::preset(preset_or_file) {
            return Ok(scene);
        }
        let path = Path::new(preset_or_file);
        if !path.exists() {
            let expected = format!("a scene file or one of {}", Self::PRESETS.join(", "));
            return Err(Error::invalid("--scene", expected, with_closest(preset_or_file, Self::PRESETS)));
        }
        let text = bounded_file::read_to_string(path, Kind::SCENE)?;
        let mut scene: Self = toml::from_str(&text).map_err(|e| {
            let line = 1 + e.span().map_or(0, |span| text.bytes().take(span.start).filter(|b| *b == b'\n').count());
            Error::invalid(format!("{preset_or_file}, line {line}"), "a scene", e.message().to_owned())
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        scene.start_at(folder).and_then(|()| scene.validate()).map_err(|e| e.within(preset_or_file))?;
        Ok(scene)
    }

    /// The same scene with some of its MAZE parts, `FIRST+N`.
    fn take(mut self, range: &str) -> Result<Self> {
        let numbers = range.split_once('+').and_then(|(first, n)| Some((first.parse().ok()?, n.parse().ok()?)));
        let (first, n) =
            numbers.ok_or_else(|| Error::invalid("parts", "#FIRST+N, such as #24+12", format!("#{range}")))?;
        let Parts::Kit(Kit { maze_parts: Some(parts), .. }) = &mut self.parts else {
            return Err(Error::invalid("parts", "maze_parts to take some from", "none"));
        };
        *parts = parts.take(first, n)?;
        self.name = format!("{}#{range}", self.name);
        Ok(self)
    }

    /// The scene as a file has it.
    ///
    /// # Errors
    /// None that a scene could have; building the text may fail in principle.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|error| Error::invalid(&self.name, "a scene that TOML has", error.to_string()))
    }

    /// Has the paths of a scene start at `folder`, and reads the sensor's calibration.
    fn start_at(&mut self, folder: &Path) -> Result<()> {
        if let Parts::Kit(kit) = &mut self.parts {
            kit.start_at(folder);
        }
        if let Some(path) = self.sensor.calibration.take() {
            let calibration = Calibration::load(folder.join(path)).map_err(|e| e.within("sensor.calibration"))?;
            let spec = std::mem::take(&mut self.sensor);
            self.sensor = calibration.light_for(spec).map_err(|e| e.within("sensor.calibration"))?;
        } else if self.sensor.calibration_centre_mm.is_some() {
            return Err(Error::invalid("sensor.calibration_centre_mm", "a calibration that it is in", "none"));
        }
        Ok(())
    }

    /// The same scene under a calibrated sensor: what it shows, its light and its gel; frames keep their size in pixels, and
    /// the gels of MAZE boards are drawn about the calibrated length, as widely as before.
    pub fn under(mut self, calibration: &Calibration) -> Result<Self> {
        let frame_px = self.sensor.frame_px;
        let before_mm = SensorSpec::default().gel_length_mm;
        self.sensor = SensorSpec { frame_px, ..calibration.spec(self.sensor)? };
        if let (Parts::Maze(boards), Some(length_mm)) = (&mut self.parts, calibration.gel_length_mm) {
            boards.gel_length_mm = boards.gel_length_mm.map(|mm| mm * length_mm / before_mm);
        }
        self.validate()?;
        Ok(self)
    }

    /// Refuses a scene that cannot be touched, naming the field. Reads the files of its parts.
    pub fn validate(&self) -> Result<()> {
        self.sensor.validate()?;
        if !is_printable(&self.name) {
            return Err(Error::invalid("name", "a name without control characters", format!("{:?}", self.name)));
        }
        if !(0.0..=5.0).contains(&self.clearance_mm) {
            return Err(Error::invalid("clearance_mm", "0 to 5 mm", self.clearance_mm.to_string()));
        }
        match (&self.parts, &self.board) {
            (Parts::Kit(kit), board) => {
                let reach =
                    self.reach.ok_or_else(|| Error::invalid("reach", "a grid of poses for each part", "none"))?;
                reach.validate()?;
                let n_parts = kit.n_parts();
                if n_parts > MOST_PARTS {
                    // Holes and pegs, each at each pose.
                    let n_touches = n_parts.saturating_mul(2).saturating_mul(reach.len());
                    let needs = Needs::of(self.half_extent_mm(), n_parts, 2, n_touches).to_string();
                    return Err(Error::invalid("parts", format!("at most {MOST_PARTS} parts"), needs));
                }
                kit.validate()?;
                let (names, parts) = (kit.names(), kit.parts(self.clearance_mm)?);
                board.as_ref().map_or(Ok(()), |board| board.validate(&names, &parts))
            }
            (Parts::Maze(boards), None) => boards.validate(&self.sensor),
            (Parts::Maze(_), Some(_)) => Err(Error::invalid("board", "none: each MAZE is a board", "one")),
        }
    }

    /// Names of the parts.
    pub fn part_names(&self) -> Vec<String> {
        match &self.parts {
            Parts::Kit(kit) => kit.names(),
            Parts::Maze(boards) => (0..boards.n_boards).map(|board| format!("maze-{board:03}")).collect(),
        }
    }

    /// The outline of a part; `seed` draws MAZE boards.
    pub fn shape(&self, part: usize, seed: u64) -> Result<Shape> {
        match &self.parts {
            Parts::Kit(kit) => Ok(kit.part(part, self.clearance_mm)?.outline),
            Parts::Maze(boards) => Ok(maze(&boards.spec, seed.wrapping_mul(1_000_003).wrapping_add(part as u64))),
        }
    }

    /// The opening that a part's peg goes into, in the part's frame, and by how much it is widened on every side,
    /// mm; for [`Shape::fits_in`].
    ///
    /// # Errors
    /// A part that is none of the scene's, or whose peg goes into no opening: a MAZE board, a connector.
    pub fn opening(&self, part: usize) -> Result<(Shape, f64)> {
        let none = |got: String| Error::invalid("parts", "parts whose pegs go into a hole: letters or files", got);
        match &self.parts {
            Parts::Maze(_) => Err(none("maze boards".into())),
            Parts::Kit(kit) => {
                let opening = kit.part(part, self.clearance_mm)?.opening();
                opening.ok_or_else(|| none(format!("the connector {}", kit.names()[part])))
            }
        }
    }

    /// What the sensor meets on one side round a part, in the part's own frame: the part first, then what else
    /// of the board is within reach. Pegs are on one board: the highest is touched. Holes are plates, each with
    /// its opening, and what one leaves open is open: the lowest counts. Connectors are mounted on their board on
    /// both sides: their receptacles are one relief. `seed` draws MAZE boards.
    pub fn reliefs(&self, part: usize, side: Side, seed: u64) -> Result<Vec<Relief>> {
        let kit = match &self.parts {
            Parts::Kit(kit) => kit,
            Parts::Maze(boards) => {
                let rng = &mut MazeBoards::band_rng(seed, part, side);
                return Ok(vec![boards.side_shares().side(self.shape(part, seed)?, side, self.clearance_mm, rng)]);
            }
        };
        let own = kit.part(part, self.clearance_mm)?;
        let stands = own.stands;
        let mut reliefs = vec![own.side(side)];
        let Some(board) = &self.board else { return Ok(reliefs) };
        let places = board.places_mm(kit.names().len())?;
        for (other, place) in places.iter().enumerate().filter(|(other, _)| *other != part) {
            let offset = [0, 1].map(|axis| place[axis] - places[part][axis]);
            let neighbour = kit.part(other, self.clearance_mm)?;
            if is_within(neighbour.bounds(), offset, self.half_extent_mm()) {
                reliefs.push(neighbour.side(side).shifted(offset));
            }
        }
        match side {
            Side::Hole if stands => Ok(vec![Relief { layers: reliefs.into_iter().flat_map(|r| r.layers).collect() }]),
            Side::Hole => {
                reliefs.push(Relief::peg(board.outline_round(places[part])));
                Ok(reliefs)
            }
            Side::Peg => Ok(reliefs),
        }
    }

    /// How far from a part's centre a view can reach, mm.
    pub fn half_extent_mm(&self) -> f64 {
        let [width, height] = self.sensor.field_of_view_mm;
        match &self.parts {
            Parts::Kit(_) => {
                let reach = self.reach.map_or(0.0, |reach| reach.xy_half_mm + 0.5 * reach.xy_step_mm);
                reach + 0.5 * width.hypot(height) + 1.0
            }
            Parts::Maze(boards) => 0.5 * boards.spec.side_mm,
        }
    }
}

/// Whether a box moved by `offset` reaches into the square of `half_mm` round the origin.
fn is_within([x_min, y_min, x_max, y_max]: [f64; 4], [dx, dy]: [f64; 2], half_mm: f64) -> bool {
    let meets = |low: f64, high: f64| low < half_mm && high > -half_mm;
    meets(x_min + dx, x_max + dx) && meets(y_min + dy, y_max + dy)
}

#[cfg(test)]
mod tests;

//! What is simulated: parts, sensor, reach and fidelity. Everything else follows from a scene.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::grid::PoseGrid;
use crate::sensor::{Fidelity, SensorSpec};
use crate::shape::Shape;
use crate::shape::glyph::glyph;
use crate::shape::maze::{MazeSpec, maze};

/// A scene, as a TOML file declares it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// A short name.
    pub name: String,
    /// What is touched.
    pub parts: Parts,
    /// The poses at which each letter is recorded; MAZE boards are touched anywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<PoseGrid>,
    /// By how much a hole's outline is wider than its peg's on every side, mm.
    #[serde(default = "default_clearance")]
    pub clearance_mm: f64,
    /// How much of the sensor is computed.
    #[serde(default = "default_fidelity")]
    pub fidelity: Fidelity,
    /// The sensor.
    #[serde(default)]
    pub sensor: SensorSpec,
}

fn default_clearance() -> f64 {
    0.15
}

fn default_fidelity() -> Fidelity {
    Fidelity::Camera
}

/// The parts of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Parts {
    /// Letters of a heavy sans, one part each.
    Letters(Letters),
    /// Random boards to train on, with pairs of touches all over them.
    Maze(MazeBoards),
}

/// Letters of one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Letters {
    /// The letters, each once.
    pub letters: String,
    /// Height of a letter, mm.
    pub height_mm: f64,
    /// Width a letter is narrowed to where it would be wider, mm.
    pub max_width_mm: f64,
}

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
    /// How boards are drawn.
    #[serde(default)]
    pub spec: MazeSpec,
}

impl Scene {
    /// Names that [`Scene::load`] knows without a file. Those on `-dev` are for tuning; the others are
    /// never trained or tuned on.
    pub const PRESETS: [&str; 5] =
        ["maze", "alphabet-small", "alphabet-large", "alphabet-small-dev", "alphabet-large-dev"];

    /// A preset by its name.
    pub fn preset(name: &str) -> Option<Self> {
        let letters = |letters: &str, height_mm, max_width_mm, reach| {
            let parts = Parts::Letters(Letters { letters: letters.into(), height_mm, max_width_mm });
            (parts, Some(reach))
        };
        let (parts, reach) = match name {
            "maze" => {
                let boards = MazeBoards {
                    n_boards: 80,
                    n_held_out: 6,
                    n_pairs: 12_000,
                    gel_length_mm: [0.9, 1.6],
                    spec: MazeSpec::default(),
                };
                (Parts::Maze(boards), None)
            }
            "alphabet-small" => letters("ABCDEFGHIJKL", 12.0, 16.0, PoseGrid::SMALL),
            "alphabet-large" => letters("ABCDEFGHIJKL", 32.0, 40.0, PoseGrid::LARGE),
            "alphabet-small-dev" => letters("MNOPQRSTUVWX", 12.0, 16.0, PoseGrid::SMALL),
            "alphabet-large-dev" => letters("MNOPQRSTUVWX", 32.0, 40.0, PoseGrid::LARGE),
            _ => return None,
        };
        Some(Self {
            name: name.into(),
            parts,
            reach,
            clearance_mm: default_clearance(),
            fidelity: default_fidelity(),
            sensor: SensorSpec::default(),
        })
    }

    /// A preset, or a TOML file. Fails with the file, the line and the field that is wrong.
    pub fn load(preset_or_file: &str) -> Result<Self> {
        if let Some(scene) = Self::preset(preset_or_file) {
            return Ok(scene);
        }
        let path = Path::new(preset_or_file);
        if !path.exists() {
            let expected = format!("a scene file or one of {}", Self::PRESETS.join(", "));
            return Err(Error::invalid("--scene", expected, preset_or_file));
        }
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let scene: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{preset_or_file}, line {line}"), "a scene", e.message().to_owned())
        })?;
        scene.validate().map_err(|e| Error::invalid(preset_or_file, "a scene that can be touched", e.to_string()))?;
        Ok(scene)
    }

    /// Refuses a scene that cannot be touched, naming the field.
    pub fn validate(&self) -> Result<()> {
        self.sensor.validate()?;
        if !(0.0..=5.0).contains(&self.clearance_mm) {
            return Err(Error::invalid("clearance_mm", "0 to 5 mm", self.clearance_mm.to_string()));
        }
        match &self.parts {
            Parts::Letters(letters) => {
                let reach = self.reach.ok_or_else(|| Error::invalid("reach", "a grid of poses for letters", "none"))?;
                reach.validate()?;
                letters.validate()
            }
            Parts::Maze(boards) => boards.validate(&self.sensor),
        }
    }

    /// Names of the parts.
    pub fn part_names(&self) -> Vec<String> {
        match &self.parts {
            Parts::Letters(letters) => letters.letters.chars().map(String::from).collect(),
            Parts::Maze(boards) => (0..boards.n_boards).map(|board| format!("maze-{board:03}")).collect(),
        }
    }

    /// The outline of a part; `seed` draws MAZE boards.
    pub fn shape(&self, part: usize, seed: u64) -> Result<Shape> {
        match &self.parts {
            Parts::Letters(letters) => {
                let letter = letters.letters.chars().nth(part);
                let letter = letter.ok_or_else(|| Error::invalid("part", "a part of the scene", part.to_string()))?;
                glyph(letter, letters.height_mm, letters.max_width_mm)
            }
            Parts::Maze(boards) => Ok(maze(&boards.spec, seed.wrapping_mul(1_000_003).wrapping_add(part as u64))),
        }
    }

    /// How far from a part's centre a view can reach, mm.
    pub fn half_extent_mm(&self) -> f64 {
        let [width, height] = self.sensor.field_of_view_mm;
        match &self.parts {
            Parts::Letters(_) => {
                let reach = self.reach.map_or(0.0, |reach| reach.xy_half_mm + 0.5 * reach.xy_step_mm);
                reach + 0.5 * width.hypot(height) + 1.0
            }
            Parts::Maze(boards) => 0.5 * boards.spec.side_mm,
        }
    }
}

impl Letters {
    fn validate(&self) -> Result<()> {
        let sizes = [("height_mm", self.height_mm), ("max_width_mm", self.max_width_mm)];
        if let Some((field, value)) = sizes.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0 && *v <= 200.0)) {
            return Err(Error::invalid(format!("parts.letters.{field}"), "0 to 200 mm", value.to_string()));
        }
        let mut seen = Vec::new();
        for letter in self.letters.chars() {
            if seen.contains(&letter) {
                return Err(Error::invalid("parts.letters.letters", "each letter once", format!("'{letter}' twice")));
            }
            glyph(letter, self.height_mm, self.max_width_mm)?;
            seen.push(letter);
        }
        if seen.is_empty() {
            return Err(Error::invalid("parts.letters.letters", "at least one letter", "none"));
        }
        Ok(())
    }
}

impl MazeBoards {
    fn validate(&self, sensor: &SensorSpec) -> Result<()> {
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
        ordered("gel_length_mm", self.gel_length_mm, 0.1, 10.0)?;
        ordered("spec.pitch_mm", spec.pitch_mm, 1.0, spec.side_mm)?;
        ordered("spec.wall_share", spec.wall_share, 0.05, 0.9)?;
        ordered("spec.node_jitter", [spec.node_jitter, 0.5], 0.0, 0.5)?;
        ordered("spec.bent_share", [spec.bent_share, 1.0], 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_valid_and_survives_a_file() {
        for name in Scene::PRESETS {
            let scene = Scene::preset(name).unwrap();
            scene.validate().unwrap();
            let back: Scene = toml::from_str(&toml::to_string(&scene).unwrap()).unwrap();
            assert_eq!(back, scene);
        }
    }

    #[test]
    fn evaluation_letters_are_not_tuning_letters() {
        let letters = |name: &str| Scene::preset(name).unwrap().part_names();
        for size in ["small", "large"] {
            let (held_out, dev) = (letters(&format!("alphabet-{size}")), letters(&format!("alphabet-{size}-dev")));
            assert!(held_out.len() == 12 && dev.len() == 12 && held_out.iter().all(|l| !dev.contains(l)));
        }
    }

    #[test]
    fn a_wrong_scene_names_file_and_field() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let good = toml::to_string(&Scene::preset("alphabet-small").unwrap()).unwrap();
        for (from, to, named) in [
            ("letters = \"ABC", "letters = \"A\u{2603}C\u{e000}", "letter"),
            ("height_mm = 12.0", "height_mm = -1.0", "height_mm"),
            ("xy_step_mm = 4.0", "xy_step_mm = 3.0", "reach.xy"),
            ("depth_mm = 0.6", "depth_cm = 0.6", "depth_cm"),
            ("fidelity = \"camera\"", "fidelity = \"perfect\"", "perfect"),
        ] {
            assert!(good.contains(from), "{from}\n{good}");
            std::fs::write(&path, good.replace(from, to)).unwrap();
            let error = Scene::load(path.to_str().unwrap()).unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("scene.toml") && !error.contains('\n'), "{error}");
        }
        assert!(Scene::load("alphabet-smal").unwrap_err().to_string().contains("alphabet-small"));
    }
}

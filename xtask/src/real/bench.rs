//! The programs, run in the output folder, and the bank's parts as a scene.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::named::Named;
use crate::error::{Error, Result};
use crate::json;
use crate::program::Program;
use crate::workspace::Workspace;

/// The parts of every bank: simple bodies, those that were pressed among them, and letters for tuning; with them the balls
/// that a set asks for.
const SOLIDS: [&str; 13] = [
    "cylinder:3",
    "cylinder:4",
    "cylinder:5",
    "cylinder:6",
    "cylinder:8",
    "ring:5:3",
    "ring:8:5",
    "ring:10:6",
    "ring:12:9",
    "cuboid:10x10",
    "cuboid:6x6",
    "cuboid:10x6",
    "cuboid:14x4",
];
const LETTERS: &str = "MNPRSX";

/// Where the programs work.
pub struct Bench<'a> {
    /// The programs.
    pub workspace: &'a Workspace,
    /// The real images.
    pub real: PathBuf,
    /// The model.
    pub model: PathBuf,
    /// Networks that draw and verify by maps, where there are any.
    pub maps: Option<PathBuf>,
    /// The output folder.
    pub out: PathBuf,
}

/// The one ball of most banks: how deep a ball is pressed and how large it is are hard to tell apart.
pub const ONE_BALL: &[&str] = &["ball:4.7"];

/// The balls and the sensor that a bank is simulated with.
pub struct Sensor<'a> {
    /// Balls among the bank's parts.
    pub balls: &'a [&'a str],
    /// Width and height of what a frame shows, mm.
    pub view_mm: [f64; 2],
    /// How deep parts are pressed in, mm; the scene's default without.
    pub depth_mm: Option<f64>,
    /// A calibration file in the output folder; the default light without.
    pub calibration: Option<&'a str>,
}

impl Bench<'_> {
    /// A file or folder of the real images; none, and said so, where it is missing.
    pub fn has(&self, name: &str, title: &str) -> bool {
        let is_there = self.real.join(name).exists();
        if !is_there {
            println!("skipped: {title} is not in the folder");
        }
        is_there
    }

    /// A program with words separated by blanks; `REAL/` in a word is the folder of the images, `MODEL` the model, `MAPS` what draws maps.
    fn line(&self, program: &str, line: &str) -> Program {
        println!("== {program} {line}");
        let (real, model) = (format!("{}/", self.real.display()), self.model.display().to_string());
        let maps = self.maps.as_ref().map_or(String::new(), |path| path.display().to_string());
        let known = [("REAL/", &real), ("MODEL", &model), ("MAPS", &maps)];
        let words = line
            .split_whitespace()
            .map(|word| known.iter().fold(word.to_owned(), |word, (name, path)| word.replace(name, path)));
        words.fold(self.workspace.program(program), Program::arg)
    }

    /// Runs a line in the output folder.
    pub fn run(&self, program: &str, line: &str) -> Result<()> {
        self.line(program, line).output(&self.out).map(|_| ())
    }

    /// The same with `--json`, read.
    pub fn json(&self, program: &str, line: &str) -> Result<Value> {
        self.line(program, &format!("{line} --json")).json(&self.out)
    }

    /// The words that name them.
    pub fn with_maps(&self) -> &'static str {
        if self.maps.is_some() { " --maps MAPS" } else { "" }
    }

    /// Simulates the bank of all parts by a sensor into `NAME.bank`.
    pub fn bank(&self, name: &str, sensor: &Sensor<'_>) -> Result<()> {
        let Sensor { balls, view_mm: [x, y], depth_mm, calibration } = sensor;
        let solids: Vec<String> = balls.iter().chain(&SOLIDS).map(|solid| format!("\"{solid}\"")).collect();
        let solids = solids.join(", ");
        let depth = depth_mm.map_or(String::new(), |mm| format!("depth_mm = {mm:.3}\n"));
        let calibration = calibration.map_or(String::new(), |file| format!("calibration = \"{file}\"\n"));
        let scene = format!(
            "name = \"{name}\"\n\n[parts.solids]\nnames = [{solids}]\n\n[parts.letters]\nletters = \"{LETTERS}\"\n\
             height_mm = 12.0\nmax_width_mm = 16.0\n\n[reach]\nxy_half_mm = 6.0\nxy_step_mm = 2.0\n\
             theta_half_deg = 90.0\ntheta_step_deg = 15.0\n\n[sensor]\nframe_px = [160, 120]\n\
             field_of_view_mm = [{x:.4}, {y:.4}]\n{depth}{calibration}"
        );
        self.write(&format!("{name}.toml"), &scene)?;
        let options = format!("--views pegs --learn-from peg --auto-steps{}", self.with_maps());
        self.run("tactile-infer", &format!("bank --model MODEL --scene {name}.toml {options} --out {name}.bank"))
    }

    /// Names the episodes of a dataset of pegs by a bank.
    pub fn replay(&self, bank: &str, data: &str) -> Result<Vec<Named>> {
        self.replay_by("MODEL", bank, data)
    }

    /// The same by a model of the output folder, or `MODEL`.
    pub fn replay_by(&self, model: &str, bank: &str, data: &str) -> Result<Vec<Named>> {
        let maps = self.with_maps();
        let line = format!("replay --model {model} --bank {bank}.bank --data {data} --side peg --json{maps}");
        let said = self.line("tactile-filter", &line).output(&self.out)?;
        // One line an episode; without any the program says so in words.
        let lines = said.lines().filter(|line| line.starts_with('{'));
        lines.map(|line| Named::read(&json::parse("replay", line)?)).collect()
    }

    /// Writes a file of the output folder.
    pub fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.out.join(name);
        fs::write(&path, text).map_err(Error::io(&path))
    }

    /// Makes a folder in the output folder.
    pub fn folder(&self, name: &str) -> Result<PathBuf> {
        let path = self.out.join(name);
        fs::create_dir_all(&path).map_err(Error::io(&path))?;
        Ok(path)
    }

    /// The model's file name and the identity of its weights.
    pub fn model_name(&self) -> Result<Value> {
        let name = self.model.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(
            serde_json::json!({ "file": name, "bytes": fs::metadata(&self.model).map_err(Error::io(&self.model))?.len() }),
        )
    }
}

/// Copies a file.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::copy(from, to).map(|_| ()).map_err(Error::io(from))
}

//! A lab's recordings through the whole chain, simulated: boards and letters written out as JPEG with CSV and as MCAP,
//! with a robot's errors, imported, aligned, trained on, banked and evaluated, next to the same without errors.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::json;
use crate::program::Program;
use crate::workspace::Workspace;

/// What the lab gets wrong: noise of the poses, missing touches, and where the hole board is.
const ERRORS: &str = "--lab pose_noise=0.1,0.3 missing=0.03";
const OFFSET: [f64; 3] = [0.4, -0.3, 1.0];

/// The letters for tuning.
const LETTERS: &str = "alphabet-small-dev";

/// What `cargo xtask lab` takes.
#[derive(Args)]
pub struct LabArgs {
    /// Folder for everything it makes; must be empty [default: lab in the build folder].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Pairs of touches of MAZE boards to train on; 0 takes the shipped model instead.
    #[arg(long, default_value_t = 4_000)]
    pairs: usize,
    /// Episodes to evaluate.
    #[arg(long, default_value_t = 500)]
    episodes: usize,
}

/// How touches are written out and read back.
#[derive(Clone, Copy)]
struct Format {
    name: &'static str,
    export: &'static str,
    import: &'static str,
}

const FOLDER: Format =
    Format { name: "folder", export: "--to folder --jpeg 90", import: "--no-contact no_contact.png" };
const BAG: Format = Format { name: "mcap", export: "--to mcap --jpeg 90", import: "--touches poses" };

/// Runs the chain without errors and with them, and prints both next to each other.
pub fn lab(workspace: &Workspace, args: &LabArgs) -> Result<()> {
    let out = workspace.folder(args.out.as_deref(), &workspace.target.join("lab"))?;
    if std::fs::read_dir(&out).map_err(Error::io(&out))?.next().is_some() {
        return Err(Error::invalid(out.display().to_string(), "an empty folder", "files of an earlier run"));
    }
    workspace.build()?;
    let lab = Lab { workspace, args, out: &out };
    let exact = lab.chain("exact", None)?;
    println!("{exact}");
    for format in [FOLDER, BAG] {
        println!("{}", lab.chain(format.name, Some(format))?);
    }
    println!("without errors, for comparison: {exact}");
    Ok(())
}

struct Lab<'a> {
    workspace: &'a Workspace,
    args: &'a LabArgs,
    out: &'a Path,
}

impl Lab<'_> {
    fn program(&self, name: &str) -> Program {
        self.workspace.program(name)
    }

    fn run(&self, program: &str, words: String) -> Result<()> {
        println!("== {program} {words}");
        self.program(program).words(words).run(self.out).map(|_| ())
    }

    /// One chain from touches to figures, in a sentence.
    fn chain(&self, name: &str, format: Option<Format>) -> Result<String> {
        let model = self.model(name, format)?;
        let pegs = self.touches(name, format, "peg", "11")?;
        let holes = self.touches(name, format, "hole", "12")?;
        let mut text = format!("{name}: ");
        if format.is_some() {
            text += &self.align(&model, &format!("--data {pegs} --holes {holes}"))?;
        }
        let bank = format!("{name}.bank");
        self.run("tactile-infer", format!("bank --model {model} --data {pegs} --out {bank}"))?;
        let evaluation = format!("{name}-evaluation");
        let n = self.args.episodes;
        let common =
            format!("evaluate --model {model} --bank {bank} --engines exact --episodes {n} --out {evaluation}");
        self.run("tactile-filter", format!("{common} --actions information --holes {holes}"))?;
        let figures = json::read(&self.out.join(&evaluation).join("evaluation.json"))?;
        for n_touches in [1.0, 3.0, 5.0] {
            text += &format!("{:.1} % after {n_touches}, ", 100.0 * accuracy(&figures, n_touches)?);
        }
        Ok(text + "touches right")
    }

    /// The model: trained on boards that were touched the same way, or the shipped one.
    fn model(&self, name: &str, format: Option<Format>) -> Result<String> {
        if self.args.pairs == 0 {
            return Ok(self.workspace.shipped_model().display().to_string());
        }
        // The same number of boards as a lab prints: of each a region is held out.
        let scene = format!("maze --boards 11 --pairs {}", self.args.pairs);
        let data = self.recorded(&format!("{name}-maze"), format, &scene, "--seed 3")?;
        if format.is_some() {
            println!(
                "{}",
                self.align(&self.workspace.shipped_model().display().to_string(), &format!("--data {data}"))?
            );
        }
        let model = format!("{name}-model");
        self.run("tactile-train", format!("--data {data} --out {model}"))?;
        Ok(format!("{model}/model.safetensors"))
    }

    /// The letters' touches of one side.
    fn touches(&self, name: &str, format: Option<Format>, side: &str, seed: &str) -> Result<String> {
        self.recorded(&format!("{name}-{side}s"), format, LETTERS, &format!("--sides {side} --seed {seed}"))
    }

    /// A dataset: generated as it is, or by a lab, written out and imported again.
    fn recorded(&self, name: &str, format: Option<Format>, scene: &str, more: &str) -> Result<String> {
        let Some(Format { export, import, .. }) = format else {
            self.run("tactile-data", format!("generate --scene {scene} {more} --out {name}"))?;
            return Ok(name.to_owned());
        };
        let [x, y, deg] = OFFSET;
        let lab = format!("{ERRORS} hole_offset={x},{y},{deg}");
        self.run("tactile-data", format!("generate --scene {scene} {more} {lab} --out {name}-made"))?;
        let file = if export.contains("mcap") { format!("{name}.mcap") } else { format!("{name}-pictures") };
        self.run("tactile-data", format!("export {name}-made {export} --out {file}"))?;
        let import = import.replace("no_contact.png", &format!("{file}/no_contact.png"));
        self.run("tactile-data", format!("import {file} {import} --out {name}"))?;
        Ok(name.to_owned())
    }

    /// Finds the offset of the hole board; says how far from the truth it is.
    fn align(&self, model: &str, data: &str) -> Result<String> {
        let words = format!("align --model {model} {data} --json");
        println!("== tactile-infer {words}");
        let found = self.program("tactile-infer").words(words).json(self.out)?;
        let at = |field: &str| json::number(&found, &format!("/peg_from_hole/{field}"));
        let (x, y, deg) = (at("x_mm")?, at("y_mm")?, at("theta_rad")?.to_degrees());
        let off_mm = (x - OFFSET[0]).hypot(y - OFFSET[1]);
        Ok(format!("offset found {off_mm:.3} mm and {:.2} degrees from the truth; ", (deg - OFFSET[2]).abs()))
    }
}

/// The filter's accuracy after some touches, 0..=1.
fn accuracy(figures: &Value, n_touches: f64) -> Result<f64> {
    let rows = json::entries(figures, "/rows")?;
    let is_it = |row: &&Value| row["method"] == "filter" && row["n_touches"].as_f64() == Some(n_touches);
    let row = rows.iter().find(is_it);
    let row = row.ok_or_else(|| Error::invalid("evaluation.json", format!("a row of {n_touches} touches"), "none"))?;
    json::number(row, "/accuracy")
}

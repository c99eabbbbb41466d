//! The steps of each part, in order. They run in the output folder: paths are short and the same in every folder.

use std::path::{Path, PathBuf};

use super::{Amount, Part};
use crate::program::Program;
use crate::step::Step;
use crate::workspace::Workspace;

/// A finer bank, for touches between the paper's poses.
const FINE: &str = "--xy-step-mm 2 --theta-step-deg 15";

/// The ways that the paper's tables compare.
const ALL_WAYS: &str = "--engines exact,paper --actions information,paper,random";

/// The default against chance.
const INFORMED: &str = "--engines exact --actions information,random";

/// The default alone.
const DEFAULT: &str = "--engines exact --actions information";

/// The boards of the paper's first two tables.
const BOARDS: [&str; 2] = ["small", "large"];

/// Scene files of the robustness rows, and whether the bank is the small board's and not the scene's own.
const ROBUST: [(&str, &str, bool); 8] = [
    ("cmu-light", "robust/cmu-light.toml", false),
    ("soft-gel", "robust/soft-gel.toml", false),
    ("changed-gel", "robust/soft-gel.toml", true),
    ("noisy-camera", "robust/noisy-camera.toml", false),
    ("shallow-press", "robust/shallow-press.toml", false),
    ("crowded-board", "robust/crowded-board.toml", false),
    ("crowded-holes", "robust/crowded-board.toml", true),
    ("attachment", "robust/attachment.toml", false),
];

/// Models that are trained to be compared in the trade-off: name, dataset, settings.
const MODELS: [(&str, &str, &str); 4] = [
    ("tiny", "maze", ""),
    ("tiny-optics", "maze-optics", ""),
    ("tiny-28x21", "maze", "--input-px 28x21"),
    ("tiny-narrow", "maze", "--width 16"),
];

/// What an evaluation needs: a model, a bank made with it, and a scene.
struct Setup {
    model: PathBuf,
    bank: String,
    /// A preset's name, or a file.
    scene: String,
}

/// Makes steps.
struct Maker<'a> {
    workspace: &'a Workspace,
    model: &'a Path,
    amount: Amount,
    steps: Vec<Step>,
}

/// The steps of some parts; what several need is made once.
pub fn steps(workspace: &Workspace, model: &Path, parts: &[Part], amount: Amount) -> Vec<Step> {
    let mut maker = Maker { workspace, model, amount, steps: Vec::new() };
    for part in parts {
        match part {
            Part::Tables => maker.tables(),
            Part::Connectors => maker.connectors(),
            Part::Anywhere => maker.anywhere(),
            Part::Classes => maker.classes(),
            Part::Absent => maker.absent(),
            Part::Assembly => maker.assembly(),
            Part::Hard => maker.hard(),
            Part::Robust => maker.robust(),
            Part::Tradeoff => maker.tradeoff(),
        }
    }
    maker.steps
}

impl Maker<'_> {
    fn tables(&mut self) {
        for board in BOARDS {
            let setup = self.recorded(board, &alphabet(board));
            self.evaluate(board, &setup, self.amount.episodes, &format!("{ALL_WAYS} --pegs {board}-pegs"));
        }
    }

    fn connectors(&mut self) {
        let centred = self.scene_file("connectors-centred.toml");
        for (name, scene, touches) in [("connectors", "connectors", 10), ("connectors-centred", &centred, 1)] {
            let setup = self.recorded(name, scene);
            let more = format!("{DEFAULT} --pegs {name}-pegs --touches {touches}");
            self.evaluate(name, &setup, self.amount.episodes, &more);
        }
    }

    fn anywhere(&mut self) {
        for board in BOARDS {
            let setup = self.bank(&format!("{board}-fine"), &alphabet(board), FINE);
            let more = format!("{INFORMED} --poses off-grid");
            self.evaluate(&format!("{board}-anywhere"), &setup, self.amount.episodes, &more);
        }
    }

    fn classes(&mut self) {
        let setup = self.recorded("large", &alphabet("large"));
        for classes in [4, 8] {
            let more = format!("{DEFAULT} --classes {classes}");
            self.evaluate(&format!("large-{classes}"), &setup, self.amount.episodes, &more);
        }
    }

    fn absent(&mut self) {
        for board in BOARDS {
            let setup = self.recorded(board, &alphabet(board));
            let more = format!("{DEFAULT} --absent");
            self.evaluate(&format!("{board}-absent"), &setup, self.amount.episodes, &more);
        }
        let setup = self.bank("small-fine", &alphabet("small"), FINE);
        let more = format!("{DEFAULT} --absent --poses off-grid");
        self.evaluate("small-anywhere-absent", &setup, self.amount.episodes, &more);
    }

    fn assembly(&mut self) {
        let scene = self.scene_file("four-letters.toml");
        let setup = self.bank("four-letters", &scene, FINE);
        let program = self.on(&setup, "assemble").words(format!("--trials {} --out assembly", self.amount.trials));
        let step = Step::new("assembly", program, "assembly").with_last("assembly.json");
        self.add(step.needs(&setup.model).needs(&setup.bank));
    }

    fn hard(&mut self) {
        for board in ["small-hard", "large-hard"] {
            let model = self.calibrate(board, self.model, &format!("alphabet-{board}-dev"), false);
            let setup = Setup { model, ..self.bank(board, &alphabet(board), "") };
            self.evaluate(board, &setup, self.amount.episodes, INFORMED);
        }
    }

    fn robust(&mut self) {
        for (name, file, has_small_bank) in ROBUST {
            let (name, scene) = (format!("robust-{name}"), self.scene_file(file));
            let setup = if has_small_bank {
                Setup { scene, ..self.recorded("small", &alphabet("small")) }
            } else {
                self.bank(&name, &scene, "")
            };
            self.evaluate(&name, &setup, self.amount.fewer, DEFAULT);
        }
    }

    fn tradeoff(&mut self) {
        let (episodes, settings) = self.amount.of_settings;
        let mut models = vec![self.model.to_path_buf()];
        for (name, data, more) in if self.amount.trains { &MODELS[..] } else { &[] } {
            models.push(self.trained(name, data, more));
        }
        let mut program = self.program("tactile-filter", format!("tradeoff --out tradeoff --episodes {episodes}"));
        for model in &models {
            program = program.words("--model").arg(model);
        }
        if let Some(n) = settings {
            program = program.words(format!("--settings {n}"));
        }
        let step = Step::new("tradeoff", program, "tradeoff").with_last("tradeoff.json");
        self.add(models.into_iter().fold(step, Step::needs));
    }

    /// Trains and calibrates a model; returns its file.
    fn trained(&mut self, name: &str, data: &str, more: &str) -> PathBuf {
        let fidelity = if data == "maze" { "" } else { "--fidelity optics" };
        let proof = self.dataset(data, format!("--scene maze --pairs 12000 --out {data} {fidelity}"));
        let folder = format!("model-{name}");
        let program = self.program("tactile-train", format!("--data {data} --preset tiny --out {folder} {more}"));
        let step = Step::new(&folder, program, &folder).with_last("model.safetensors").needs(proof);
        self.add(step.resumes_from("state.safetensors"));
        self.calibrate(name, &Path::new(&folder).join("model.safetensors"), "alphabet-small-dev", true)
    }

    /// The bank of a board at its scene's poses, from the dataset of its pegs, `{board}-pegs`.
    fn recorded(&mut self, board: &str, scene: &str) -> Setup {
        let (pegs, bank) = (format!("{board}-pegs"), format!("{board}.bank"));
        let generate = self.program("tactile-data", "generate --scene").arg(scene);
        let generate = generate.words(format!("--sides peg --out {pegs}"));
        self.add(Step::new(&pegs, generate, &pegs).with_last("meta.json"));
        let program = self.program("tactile-infer", "bank --model").arg(self.model);
        let program = program.words(format!("--data {pegs} --out {bank}"));
        self.add(Step::new(&bank, program, &bank).needs(self.model).needs(format!("{pegs}/meta.json")));
        Setup { model: self.model.into(), bank, scene: scene.into() }
    }

    /// A bank without a dataset.
    fn bank(&mut self, name: &str, scene: &str, more: &str) -> Setup {
        self.bank_of(self.model, name, scene, more)
    }

    /// A bank of another model than the one evaluated elsewhere.
    fn bank_of(&mut self, model: &Path, name: &str, scene: &str, more: &str) -> Setup {
        let bank = format!("{name}.bank");
        let program = self.program("tactile-infer", "bank --model").arg(model).words("--scene").arg(scene);
        let program = program.words(format!("--out {bank} {more}"));
        self.add(Step::new(&bank, program, &bank).needs(model));
        Setup { model: model.into(), bank, scene: scene.into() }
    }

    fn evaluate(&mut self, name: &str, setup: &Setup, episodes: usize, more: &str) {
        let program = self.on(setup, "evaluate").words(format!("--episodes {episodes} {more} --out {name}"));
        let step = Step::new(name, program, name).with_last("evaluation.json");
        self.add(step.needs(&setup.model).needs(&setup.bank));
    }

    /// Calibrates a model on a scene for tuning, at its recorded poses or anywhere; returns its file.
    fn calibrate(&mut self, name: &str, model: &Path, scene: &str, anywhere: bool) -> PathBuf {
        let (of_bank, of_holes) = if anywhere { (FINE, "--anywhere 40") } else { ("", "") };
        let holes = format!("{scene}-holes");
        let proof = self.dataset(&holes, format!("--scene {scene} --sides hole --seed 9 --out {holes} {of_holes}"));
        let Setup { bank, .. } = self.bank_of(model, &format!("{name}-dev"), scene, of_bank);
        let calibrated = format!("{name}.safetensors");
        let program = self.program("tactile-infer", "calibrate --model").arg(model);
        let program = program.words(format!("--bank {bank} --holes {holes} --out {calibrated}"));
        self.add(Step::new(&calibrated, program, &calibrated).needs(bank).needs(proof));
        calibrated.into()
    }

    /// Adds the step that makes a dataset; returns the file of it that is written last.
    fn dataset(&mut self, name: &str, words: String) -> PathBuf {
        let program = self.program("tactile-data", format!("generate {words}"));
        self.add(Step::new(name, program, name).with_last("meta.json"));
        Path::new(name).join("meta.json")
    }

    /// Adds a step that is not there yet.
    fn add(&mut self, step: Step) {
        if self.steps.iter().all(|other| other.name != step.name) {
            self.steps.push(step);
        }
    }

    /// `tactile-filter` with a subcommand that takes a setup.
    fn on(&self, setup: &Setup, subcommand: &str) -> Program {
        let program = self.program("tactile-filter", subcommand).words("--model").arg(&setup.model);
        program.words(format!("--bank {} --scene", setup.bank)).arg(&setup.scene)
    }

    fn program(&self, name: &str, words: impl AsRef<str>) -> Program {
        self.workspace.program(name).words(words)
    }

    fn scene_file(&self, name: &str) -> String {
        self.workspace.root.join("data").join("scenes").join(name).display().to_string()
    }
}

fn alphabet(board: &str) -> String {
    format!("alphabet-{board}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    fn names(parts: &[Part], amount: Amount) -> Vec<String> {
        let workspace = Workspace { root: "/r".into(), target: "/t".into() };
        steps(&workspace, Path::new("/m"), parts, amount).into_iter().map(|step| step.name).collect()
    }

    #[test]
    fn what_several_parts_need_is_made_once_and_before_them() {
        let names = names(Part::value_variants(), Amount::WHOLE);
        let mut once = names.clone();
        once.sort();
        once.dedup();
        assert_eq!(once.len(), names.len());
        let at = |name: &str| names.iter().position(|found| found == name).unwrap();
        assert!(at("small.bank") < at("small") && at("large.bank") < at("large-4"));
        assert!(at("small-fine.bank") < at("small-anywhere-absent") && at("tiny.safetensors") < at("tradeoff"));
    }

    #[test]
    fn a_part_on_its_own_has_all_that_it_needs() {
        assert_eq!(names(&[Part::Classes], Amount::SMOKE), ["large-pegs", "large.bank", "large-4", "large-8"]);
        assert_eq!(names(&[Part::Tradeoff], Amount::SMOKE), ["tradeoff"]);
    }
}

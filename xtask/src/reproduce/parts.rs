//! The steps of each part, in order. They run in the output folder: paths are short and the same in every folder.

use std::path::{Path, PathBuf};

use super::{Amount, Part};
use crate::step::Step;
use crate::workspace::Workspace;

/// A finer bank, for touches between the paper's poses.
const FINE: [&str; 4] = ["--xy-step-mm", "2", "--theta-step-deg", "15"];

/// The ways that the paper's tables compare.
const ALL_WAYS: [&str; 4] = ["--engines", "exact,paper", "--actions", "information,paper,random"];

/// The default against chance.
const INFORMED: [&str; 4] = ["--engines", "exact", "--actions", "information,random"];

/// The default alone.
const DEFAULT: [&str; 4] = ["--engines", "exact", "--actions", "information"];

/// Scene files of the robustness rows, and the bank where it is another scene's.
const ROBUST: [(&str, &str, Option<&str>); 8] = [
    ("cmu-light", "robust/cmu-light.toml", None),
    ("soft-gel", "robust/soft-gel.toml", None),
    ("changed-gel", "robust/soft-gel.toml", Some("small.bank")),
    ("noisy-camera", "robust/noisy-camera.toml", None),
    ("shallow-press", "robust/shallow-press.toml", None),
    ("crowded-board", "robust/crowded-board.toml", None),
    ("crowded-holes", "robust/crowded-board.toml", Some("small.bank")),
    ("attachment", "robust/attachment.toml", None),
];

/// Models that are trained to be compared in the trade-off: name, dataset, settings.
const MODELS: [(&str, &str, &[&str]); 4] = [
    ("tiny", "maze", &[]),
    ("tiny-optics", "maze-optics", &[]),
    ("tiny-28x21", "maze", &["--input-px", "28x21"]),
    ("tiny-narrow", "maze", &["--width", "16"]),
];

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
        maker.part(*part);
    }
    maker.steps
}

impl Maker<'_> {
    fn part(&mut self, part: Part) {
        let Amount { episodes, fewer, trials, .. } = self.amount;
        match part {
            Part::Tables => {
                for board in ["small", "large"] {
                    let scene = format!("alphabet-{board}");
                    let pegs = self.recorded_bank(board, &scene);
                    let more = [&ALL_WAYS[..], &["--pegs", &pegs]].concat();
                    self.evaluate(board, &format!("{board}.bank"), &scene, episodes, &more);
                }
            }
            Part::Connectors => {
                let centred = self.scene_file("connectors-centred.toml");
                for (name, scene, touches) in
                    [("connectors", "connectors", "10"), ("connectors-centred", &centred, "1")]
                {
                    let pegs = self.recorded_bank(name, scene);
                    let more = [&DEFAULT[..], &["--pegs", &pegs, "--touches", touches]].concat();
                    self.evaluate(name, &format!("{name}.bank"), scene, episodes, &more);
                }
            }
            Part::Anywhere => {
                for board in ["small", "large"] {
                    let bank = self.bank(&format!("{board}-fine"), &format!("alphabet-{board}"), true);
                    let more = [&INFORMED[..], &["--poses", "off-grid"]].concat();
                    let name = format!("{board}-anywhere");
                    self.evaluate(&name, &bank, &format!("alphabet-{board}"), episodes, &more);
                }
            }
            Part::Classes => {
                self.recorded_bank("large", "alphabet-large");
                for classes in ["4", "8"] {
                    let more = [&DEFAULT[..], &["--classes", classes]].concat();
                    self.evaluate(&format!("large-{classes}"), "large.bank", "alphabet-large", episodes, &more);
                }
            }
            Part::Absent => {
                for board in ["small", "large"] {
                    let scene = format!("alphabet-{board}");
                    self.recorded_bank(board, &scene);
                    let more = [&DEFAULT[..], &["--absent"]].concat();
                    let (name, bank) = (format!("{board}-absent"), format!("{board}.bank"));
                    self.evaluate(&name, &bank, &scene, episodes, &more);
                }
                let bank = self.bank("small-fine", "alphabet-small", true);
                let more = [&DEFAULT[..], &["--absent", "--poses", "off-grid"]].concat();
                self.evaluate("small-anywhere-absent", &bank, "alphabet-small", episodes, &more);
            }
            Part::Assembly => {
                let scene = self.scene_file("four-letters.toml");
                let bank = self.bank("four-letters", &scene, true);
                let trials = trials.to_string();
                let model = self.model_word();
                let words =
                    ["assemble", "--model", &model, "--bank", &bank, "--scene", &scene, "--trials", &trials, "--out"];
                let step = self.step("assembly", "tactile-filter", &[&words[..], &["assembly"]].concat());
                self.add(step.needs(self.model).needs(&bank).makes("assembly", "assembly/assembly.json"));
            }
            Part::Hard => {
                for board in ["small-hard", "large-hard"] {
                    let scene = format!("alphabet-{board}");
                    let model = self.calibrate(board, &self.model_word(), &format!("{scene}-dev"), &[], &[]);
                    let bank = self.bank(board, &scene, false);
                    self.evaluate_model(&model, board, &bank, &scene, episodes, &INFORMED);
                }
            }
            Part::Robust => {
                for (name, file, bank) in ROBUST {
                    let (name, scene) = (format!("robust-{name}"), self.scene_file(file));
                    let bank = match bank {
                        Some(bank) => {
                            self.recorded_bank("small", "alphabet-small");
                            bank.to_owned()
                        }
                        None => self.bank(&name, &scene, false),
                    };
                    self.evaluate(&name, &bank, &scene, fewer, &DEFAULT);
                }
            }
            Part::Tradeoff => self.tradeoff(),
        }
    }

    /// The bank of a board at its scene's poses, with the dataset of its pegs, whose name is returned.
    fn recorded_bank(&mut self, board: &str, scene: &str) -> String {
        let (pegs, bank, model) = (format!("{board}-pegs"), format!("{board}.bank"), self.model_word());
        let words = ["generate", "--scene", scene, "--sides", "peg", "--out", &pegs];
        let proof = format!("{pegs}/meta.json");
        let touches = self.step(&pegs, "tactile-data", &words).makes(&pegs, &proof);
        self.add(touches);
        let words = ["bank", "--model", &model, "--data", &pegs, "--out", &bank];
        let made = self.step(&bank, "tactile-infer", &words).needs(self.model).needs(proof).makes(&bank, &bank);
        self.add(made);
        pegs
    }

    /// A bank without a dataset; returns its file.
    fn bank(&mut self, name: &str, scene: &str, fine: bool) -> String {
        let (bank, model) = (format!("{name}.bank"), self.model_word());
        let words = ["bank", "--model", &model, "--scene", scene, "--out", &bank];
        let words = if fine { [&words[..], &FINE].concat() } else { words.to_vec() };
        let step = self.step(&bank, "tactile-infer", &words).needs(self.model).makes(&bank, &bank);
        self.add(step);
        bank
    }

    fn evaluate(&mut self, name: &str, bank: &str, scene: &str, episodes: usize, more: &[&str]) {
        self.evaluate_model(&self.model_word(), name, bank, scene, episodes, more);
    }

    /// The same of another model than the one evaluated elsewhere.
    fn evaluate_model(&mut self, model: &str, name: &str, bank: &str, scene: &str, episodes: usize, more: &[&str]) {
        let (episodes, proof) = (episodes.to_string(), format!("{name}/evaluation.json"));
        let words = ["evaluate", "--model", model, "--bank", bank, "--scene", scene, "--episodes", &episodes];
        let words = [&words[..], more, &["--out", name]].concat();
        let step = self.step(name, "tactile-filter", &words).needs(model).needs(bank).makes(name, proof);
        self.add(step);
    }

    fn tradeoff(&mut self) {
        let (episodes, settings) = self.amount.of_settings;
        let mut models = vec![self.model_word()];
        for (name, data, more) in if self.amount.trains { &MODELS[..] } else { &[] } {
            let tier: &[&str] = if *data == "maze" { &[] } else { &["--fidelity", "optics"] };
            let words = [&["generate", "--scene", "maze", "--pairs", "12000", "--out", data][..], tier].concat();
            let proof = format!("{data}/meta.json");
            let touches = self.step(data, "tactile-data", &words).makes(*data, &proof);
            self.add(touches);
            let folder = format!("model-{name}");
            let checkpoint = format!("{folder}/model.safetensors");
            let words = [&["--data", data, "--preset", "tiny", "--out", &folder][..], more].concat();
            let trained = self
                .step(&folder, "tactile-train", &words)
                .needs(&proof)
                .makes(&folder, &checkpoint)
                .resumes_from(format!("{folder}/state.safetensors"));
            self.add(trained);
            models.push(self.calibrate(name, &checkpoint, "alphabet-small-dev", &FINE, &["--anywhere", "40"]));
        }
        let (episodes, settings) = (episodes.to_string(), settings.map(|n| n.to_string()));
        let mut words = vec!["tradeoff", "--out", "tradeoff", "--episodes", &episodes];
        words.extend(models.iter().flat_map(|model| ["--model", model.as_str()]));
        words.extend(settings.iter().flat_map(|n| ["--settings", n.as_str()]));
        let mut step = self.step("tradeoff", "tactile-filter", &words).makes("tradeoff", "tradeoff/tradeoff.json");
        step.inputs.extend(models.iter().map(PathBuf::from));
        self.add(step);
    }

    /// Calibrates a model on a scene of tuning, whose bank and holes may be made with more words; returns its file.
    fn calibrate(&mut self, name: &str, model: &str, scene: &str, of_bank: &[&str], of_holes: &[&str]) -> String {
        let (holes, bank) = (format!("{scene}-holes"), format!("{name}-dev.bank"));
        let words = ["generate", "--scene", scene, "--sides", "hole", "--seed", "9", "--out", &holes];
        let touches = self.step(&holes, "tactile-data", &[&words[..], of_holes].concat());
        let (recorded, calibrated) = (format!("{holes}/meta.json"), format!("{name}.safetensors"));
        self.add(touches.makes(&holes, &recorded));
        let words = [&["bank", "--model", model, "--scene", scene, "--out", &bank][..], of_bank].concat();
        let made = self.step(&bank, "tactile-infer", &words).needs(model).makes(&bank, &bank);
        self.add(made);
        let words = ["calibrate", "--model", model, "--bank", &bank, "--holes", &holes, "--out", &calibrated];
        let step = self.step(&calibrated, "tactile-infer", &words);
        self.add(step.needs(&bank).needs(recorded).makes(&calibrated, &calibrated));
        calibrated
    }

    fn step(&self, name: &str, program: &str, words: &[&str]) -> Step {
        Step {
            name: name.into(),
            program: self.workspace.program(program),
            args: words.iter().map(Into::into).collect(),
            inputs: Vec::new(),
            product: PathBuf::new(),
            proof: PathBuf::new(),
            resume_from: None,
        }
    }

    /// Adds a step that is not there yet.
    fn add(&mut self, step: Step) {
        if self.steps.iter().all(|other| other.name != step.name) {
            self.steps.push(step);
        }
    }

    fn model_word(&self) -> String {
        self.model.to_string_lossy().into_owned()
    }

    fn scene_file(&self, name: &str) -> String {
        self.workspace.root.join("data").join("scenes").join(name).to_string_lossy().into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    fn names(parts: &[Part], amount: Amount) -> Vec<String> {
        let workspace =
            Workspace { root: "/r".into(), target: "/t".into(), packages: Vec::new(), programs: Vec::new() };
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

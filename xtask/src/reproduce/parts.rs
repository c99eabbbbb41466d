//! The steps of each part, in order. They run in the output folder: paths are short and the same in every folder.

use std::path::{Path, PathBuf};

use super::{Amount, Part};
use crate::program::Program;
use crate::step::Step;
use crate::workspace::Workspace;

/// A finer bank, for touches between the paper's poses.
pub const FINE: &str = "--xy-step-mm 2 --theta-step-deg 15";

/// Embeddings are compared by the cosine alone, as in the paper.
pub const BY_COSINE: &str = "--learn-from nothing";

/// The ways that the paper's tables compare.
const ALL_WAYS: &str = "--engines exact,paper --actions information,paper,random,random-edge";

/// The default against chance: any touch, and any that should show an edge.
const INFORMED: &str = "--engines exact --actions information,random,random-edge";

/// The default alone.
pub(super) const DEFAULT: &str = "--engines exact --actions information";

/// How a bank is made.
#[derive(Clone, Copy)]
enum Kind {
    /// From the dataset `{bank}-pegs`, at its scene's poses: such a bank learns nothing.
    Recorded,
    /// Without a dataset.
    Simulated {
        /// `pegs`, as a robot records them, or `both`: the holes that the scene says, too.
        views: &'static str,
        /// [`FINE`] or nothing: the scene's poses.
        steps: &'static str,
        /// [`BY_COSINE`] or nothing: it learns from simulated holes how to compare embeddings, as is the default.
        metric: &'static str,
    },
}

impl Kind {
    /// A bank of pegs at its scene's poses.
    const PLAIN: Self = Self::Simulated { views: "pegs", steps: "", metric: "" };
    /// A bank of pegs on a finer grid.
    const FINE: Self = Self::Simulated { views: "pegs", steps: FINE, metric: "" };
    /// As [`Self::PLAIN`], of both sides.
    const PLAIN_BOTH: Self = Self::Simulated { views: "both", steps: "", metric: "" };
    /// As [`Self::FINE`], of both sides.
    const FINE_BOTH: Self = Self::Simulated { views: "both", steps: FINE, metric: "" };
    /// As [`Self::PLAIN`], by the cosine alone.
    const PLAIN_COSINE: Self = Self::Simulated { views: "pegs", steps: "", metric: BY_COSINE };
    /// As [`Self::FINE`], by the cosine alone.
    const FINE_COSINE: Self = Self::Simulated { views: "pegs", steps: FINE, metric: BY_COSINE };
}

/// The banks: name, kind and scene, a preset or a file.
const BANKS: [(&str, Kind, &str); 32] = [
    ("small", Kind::Recorded, "alphabet-small"),
    ("large", Kind::Recorded, "alphabet-large"),
    ("connectors", Kind::Recorded, "connectors"),
    ("connectors-centred", Kind::Recorded, "connectors-centred.toml"),
    ("small-fine", Kind::FINE, "alphabet-small"),
    ("large-fine", Kind::FINE, "alphabet-large"),
    ("small-cosine", Kind::FINE_COSINE, "alphabet-small"),
    ("large-cosine", Kind::FINE_COSINE, "alphabet-large"),
    ("wide", Kind::FINE, "wide-letters.toml"),
    ("four-letters", Kind::FINE, "four-letters.toml"),
    ("small-hard", Kind::PLAIN, "alphabet-small-hard"),
    ("large-hard", Kind::PLAIN, "alphabet-large-hard"),
    ("robust-cmu-light", Kind::PLAIN_COSINE, "robust/cmu-light.toml"),
    ("robust-soft-gel", Kind::PLAIN_COSINE, "robust/soft-gel.toml"),
    ("robust-noisy-camera", Kind::PLAIN_COSINE, "robust/noisy-camera.toml"),
    ("robust-shallow-press", Kind::PLAIN_COSINE, "robust/shallow-press.toml"),
    ("robust-crowded-board", Kind::PLAIN_COSINE, "robust/crowded-board.toml"),
    ("robust-attachment", Kind::PLAIN_COSINE, "robust/attachment.toml"),
    ("serif-letters", Kind::FINE_COSINE, "serif-letters.toml"),
    ("digits", Kind::FINE_COSINE, "digits.toml"),
    ("outlines", Kind::FINE_COSINE, "outlines.toml"),
    ("new-outlines", Kind::FINE_COSINE, "new-outlines.toml"),
    ("small-both", Kind::FINE_BOTH, "alphabet-small"),
    ("large-both", Kind::FINE_BOTH, "alphabet-large"),
    ("new-outlines-both", Kind::FINE_BOTH, "new-outlines.toml"),
    ("connectors-learnt", Kind::PLAIN, "connectors"),
    ("connectors-both", Kind::PLAIN_BOTH, "connectors"),
    ("small-hard-both", Kind::PLAIN_BOTH, "alphabet-small-hard"),
    ("large-hard-both", Kind::PLAIN_BOTH, "alphabet-large-hard"),
    ("connectors-fine-both", Kind::FINE_BOTH, "connectors"),
    ("look-alikes", Kind::FINE_COSINE, "look-alikes.toml"),
    ("look-alikes-both", Kind::FINE_BOTH, "look-alikes.toml"),
];

/// Part, name, bank, the scene where it is not the bank's, ways and settings.
type Evaluation = (Part, &'static str, &'static str, Option<&'static str>, &'static str, &'static str);

/// The evaluations.
const EVALUATIONS: [Evaluation; 52] = [
    (Part::Tables, "small", "small", None, ALL_WAYS, "--pegs small-pegs"),
    (Part::Tables, "large", "large", None, ALL_WAYS, "--pegs large-pegs"),
    (Part::Connectors, "connectors", "connectors", None, DEFAULT, "--pegs connectors-pegs --touches 10"),
    (Part::Connectors, "connectors-learnt", "connectors-learnt", None, INFORMED, ""),
    (
        Part::Connectors,
        "connectors-centred",
        "connectors-centred",
        None,
        DEFAULT,
        "--pegs connectors-centred-pegs --touches 1",
    ),
    (Part::Anywhere, "small-cosine", "small-cosine", None, DEFAULT, "--poses off-grid"),
    (Part::Anywhere, "large-cosine", "large-cosine", None, DEFAULT, "--poses off-grid"),
    (Part::Anywhere, "outlines-cosine", "new-outlines", None, INFORMED, "--poses off-grid"),
    (Part::Anywhere, "small-anywhere", "small-fine", None, INFORMED, "--poses off-grid"),
    (Part::Anywhere, "large-anywhere", "large-fine", None, INFORMED, "--poses off-grid"),
    (Part::Wide, "parts-wide", "wide", None, INFORMED, "--poses off-grid"),
    (Part::Classes, "large-4", "large", None, DEFAULT, "--classes 4"),
    (Part::Classes, "large-8", "large", None, DEFAULT, "--classes 8"),
    (Part::Absent, "small-absent", "small", None, DEFAULT, "--absent"),
    (Part::Absent, "large-absent", "large", None, DEFAULT, "--absent"),
    (Part::Absent, "small-anywhere-absent", "small-fine", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "strangers-small-own", "small-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "small-own", "small-both", None, DEFAULT, "--poses off-grid"),
    (Part::Strangers, "look-alikes", "look-alikes-both", None, INFORMED, "--poses off-grid"),
    (Part::Strangers, "look-alikes-own", "look-alikes-both", None, DEFAULT, "--poses off-grid"),
    (Part::Strangers, "strangers-alike", "look-alikes-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "strangers-alike-own", "look-alikes-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "new-outlines-own", "new-outlines-both", None, DEFAULT, "--poses off-grid"),
    (Part::Strangers, "strangers-outlines", "new-outlines-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "strangers-outlines-own", "new-outlines-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "connectors-fine", "connectors-fine-both", None, DEFAULT, "--poses off-grid"),
    (Part::Strangers, "connectors-own", "connectors-fine-both", None, DEFAULT, "--poses off-grid"),
    (Part::Strangers, "strangers-connectors", "connectors-fine-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Strangers, "strangers-connectors-own", "connectors-fine-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::Hard, "small-hard", "small-hard", None, INFORMED, ""),
    (Part::Hard, "large-hard", "large-hard", None, INFORMED, ""),
    (Part::Robust, "robust-cmu-light", "robust-cmu-light", None, DEFAULT, ""),
    (Part::Robust, "robust-soft-gel", "robust-soft-gel", None, DEFAULT, ""),
    (Part::Robust, "robust-changed-gel", "small", Some("robust/soft-gel.toml"), DEFAULT, ""),
    (Part::Robust, "robust-noisy-camera", "robust-noisy-camera", None, DEFAULT, ""),
    (Part::Robust, "robust-shallow-press", "robust-shallow-press", None, DEFAULT, ""),
    (Part::Robust, "robust-crowded-board", "robust-crowded-board", None, DEFAULT, ""),
    (Part::Robust, "robust-crowded-holes", "small", Some("robust/crowded-board.toml"), DEFAULT, ""),
    (Part::Robust, "robust-attachment", "robust-attachment", None, DEFAULT, ""),
    (Part::Sensors, "parts-serif-letters", "serif-letters", None, DEFAULT, "--poses off-grid"),
    (Part::Sensors, "parts-digits", "digits", None, DEFAULT, "--poses off-grid"),
    (Part::Sensors, "parts-look-alikes", "look-alikes", None, INFORMED, "--poses off-grid"),
    (Part::Sensors, "parts-new-outlines", "new-outlines", None, INFORMED, "--poses off-grid"),
    (Part::Sensors, "parts-outlines", "outlines", None, DEFAULT, "--poses off-grid"),
    (Part::KnownHoles, "known-small", "small-both", None, INFORMED, "--poses off-grid"),
    (Part::KnownHoles, "known-large", "large-both", None, INFORMED, "--poses off-grid"),
    (Part::KnownHoles, "known-outlines", "new-outlines-both", None, INFORMED, "--poses off-grid"),
    (Part::KnownHoles, "known-connectors", "connectors-both", None, INFORMED, ""),
    (Part::KnownHoles, "known-small-absent", "small-both", None, DEFAULT, "--absent --poses off-grid"),
    (Part::KnownHoles, "known-connectors-absent", "connectors-both", None, DEFAULT, "--absent"),
    (Part::KnownHoles, "known-small-hard", "small-hard-both", None, INFORMED, ""),
    (Part::KnownHoles, "known-large-hard", "large-hard-both", None, INFORMED, ""),
];

/// Models that are trained to be compared in the trade-off: name, dataset, settings.
const MODELS: [(&str, &str, &str); 4] = [
    ("tiny", "maze", ""),
    ("tiny-optics", "maze-optics", ""),
    ("tiny-28x21", "maze", "--set input_px=[28,21]"),
    ("tiny-narrow", "maze", "--set width=16"),
];

/// What steps are made for.
pub struct Job<'a> {
    /// Where the programs are.
    pub workspace: &'a Workspace,
    /// The model to evaluate.
    pub model: &'a Path,
    /// How much of everything.
    pub amount: Amount,
    /// Whether sensors are compared on the letters for tuning.
    pub tuning_letters: bool,
    /// Folder of real images.
    pub real: PathBuf,
}

/// Makes steps.
pub(super) struct Maker<'a> {
    pub(super) job: &'a Job<'a>,
    steps: Vec<Step>,
}

/// The steps of some parts; what several need is made once.
pub fn steps(job: &Job, parts: &[Part]) -> Vec<Step> {
    let mut maker = Maker { job, steps: Vec::new() };
    for part in parts {
        match part {
            Part::Sensors => maker.sensors(),
            Part::Assembly => maker.assembly(),
            Part::Tradeoff => maker.tradeoff(),
            _ => maker.evaluations(*part),
        }
    }
    maker.steps
}

impl Maker<'_> {
    pub(super) fn evaluations(&mut self, part: Part) {
        for (_, name, bank, scene, ways, more) in EVALUATIONS.into_iter().filter(|row| row.0 == part) {
            let model = match part {
                _ if name.ends_with("-hard") => {
                    let name = name.trim_start_matches("known-");
                    self.calibrate(name, self.job.model, &format!("alphabet-{name}-dev"), false)
                }
                _ if name.ends_with("-own") => self.calibrate_by_ten(),
                _ => self.job.model.to_path_buf(),
            };
            let Amount { episodes, fewer, .. } = self.job.amount;
            let episodes = if matches!(part, Part::Robust | Part::Sensors) { fewer } else { episodes };
            let (bank, scene_of_bank) = self.bank(bank);
            let scene = scene.map_or(scene_of_bank, |scene| self.scene(scene));
            let program = self.program("tactile-filter", "evaluate --model").arg(&model);
            let program = program.words(format!("--bank {bank} --scene")).arg(scene);
            let program = program.words(format!("--episodes {episodes} {ways} {more} --out {name}"));
            self.add(Step::new(name, program, name).with_last("evaluation.json").needs(model).needs(bank));
        }
    }

    fn assembly(&mut self) {
        let (bank, scene) = self.bank("four-letters");
        let program = self.program("tactile-filter", "assemble --model").arg(self.job.model);
        let program = program.words(format!("--bank {bank} --scene")).arg(scene);
        let program = program.words(format!("--trials {} --out assembly", self.job.amount.trials));
        let step = Step::new("assembly", program, "assembly").with_last("assembly.json");
        self.add(step.needs(self.job.model).needs(bank));
    }

    fn tradeoff(&mut self) {
        let (episodes, settings) = self.job.amount.of_settings;
        let mut models = vec![self.job.model.to_path_buf()];
        for (name, data, more) in if self.job.amount.trains { &MODELS[..] } else { &[] } {
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
        let touches = self.dataset(data, "maze", &format!("--pairs 12000 {fidelity}"));
        let folder = format!("model-{name}");
        let program = self.program("tactile-train", format!("--data {data} --preset tiny --out {folder} {more}"));
        let step = Step::new(&folder, program, &folder).with_last("model.safetensors").needs(touches);
        self.add(step.resumes_from("state.safetensors"));
        self.calibrate(name, &Path::new(&folder).join("model.safetensors"), "alphabet-small-dev", true)
    }

    /// Calibrates a model on a scene for tuning, at its recorded poses or anywhere; returns its file.
    pub(super) fn calibrate(&mut self, name: &str, model: &Path, scene: &str, anywhere: bool) -> PathBuf {
        let (of_bank, of_holes) = if anywhere { (FINE, "--anywhere 40") } else { ("", "") };
        let (holes, bank) = (format!("{}-holes", scene.trim_end_matches(".toml")), format!("{name}-dev.bank"));
        let touches = self.dataset(&holes, scene, &format!("--sides hole --seed 9 {of_holes}"));
        let program = self.program("tactile-infer", "bank --model").arg(model);
        let program = program.words(format!("--scene {scene} --out {bank} --views pegs {BY_COSINE} {of_bank}"));
        self.add(Step::new(&bank, program, &bank).needs(model).needs(scene));
        let calibrated = format!("{name}.safetensors");
        let program = self.program("tactile-infer", "calibrate --model").arg(model);
        let program = program.words(format!("--bank {bank} --holes {holes} --out {calibrated}"));
        self.add(Step::new(&calibrated, program, &calibrated).needs(bank).needs(touches));
        calibrated.into()
    }

    /// Adds the steps of a calibration by ten touches of the letters for tuning, as a user makes one of the own sensor,
    /// with a bank of both sides; returns the calibrated model's file.
    fn calibrate_by_ten(&mut self) -> PathBuf {
        const OWN: &str = "own.safetensors";
        let (scene, model) = ("alphabet-small-dev", self.job.model);
        let touches = self.dataset("own-holes", scene, "--sides hole --anywhere 20 --seed 9");
        let program = self.program("tactile-infer", "bank --model").arg(model);
        let program = program.words(format!("--scene {scene} --out own-dev.bank --views both {FINE}"));
        self.add(Step::new("own-dev.bank", program, "own-dev.bank").needs(model));
        let program = self.program("tactile-infer", "calibrate --model").arg(model);
        let program = program.words(format!("--bank own-dev.bank --holes own-holes --touches 10 --out {OWN}"));
        self.add(Step::new(OWN, program, OWN).needs("own-dev.bank").needs(touches));
        OWN.into()
    }

    /// Adds the steps of a bank; returns its file and its scene.
    fn bank(&mut self, name: &str) -> (String, String) {
        let found = BANKS.into_iter().find(|(bank, ..)| *bank == name);
        let (_, kind, scene) = found.unwrap_or((name, Kind::PLAIN, name));
        let (bank, scene) = (format!("{name}.bank"), self.scene(scene));
        let mut program = self.program("tactile-infer", "bank --model").arg(self.job.model);
        let mut touches = None;
        match kind {
            Kind::Recorded => {
                let pegs = format!("{name}-pegs");
                touches = Some(self.dataset(&pegs, &scene, "--sides peg"));
                program = program.words(format!("--data {pegs} --out {bank}"));
            }
            Kind::Simulated { views, steps, metric } => {
                let words = format!("--out {bank} --views {views} {steps} {metric}");
                program = program.words("--scene").arg(&scene).words(words);
            }
        }
        let step = Step::new(&bank, program, &bank).needs(self.job.model).needs(&scene);
        self.add(touches.into_iter().fold(step, Step::needs));
        (bank, scene)
    }

    /// Adds the step of a dataset; returns the file of it that is written last.
    fn dataset(&mut self, name: &str, scene: &str, more: &str) -> PathBuf {
        let program = self.program("tactile-data", "generate --scene").arg(scene);
        let program = program.words(format!("--out {name} {more}"));
        self.add(Step::new(name, program, name).with_last("meta.json").needs(scene));
        Path::new(name).join("meta.json")
    }

    /// Adds a step that is not there yet.
    pub(super) fn add(&mut self, step: Step) {
        if self.steps.iter().all(|other| other.name != step.name) {
            self.steps.push(step);
        }
    }

    pub(super) fn program(&self, name: &str, words: impl AsRef<str>) -> Program {
        self.job.workspace.program(name).words(words)
    }

    /// A preset's name as it is, a scene file with its folder.
    fn scene(&self, name: &str) -> String {
        let file = self.job.workspace.root.join("data").join("scenes").join(name);
        if name.ends_with(".toml") { file.display().to_string() } else { name.into() }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use clap::ValueEnum;

    /// A job without real images.
    pub fn job(tuning_letters: bool) -> Job<'static> {
        let workspace = Box::leak(Box::new(Workspace { root: "/r".into(), target: "/t".into() }));
        Job { workspace, model: Path::new("/m"), amount: Amount::SMOKE, tuning_letters, real: "/absent".into() }
    }

    /// The names of the steps of a job.
    pub fn names_of(job: &Job, parts: &[Part]) -> Vec<String> {
        steps(job, parts).into_iter().map(|step| step.name).collect()
    }

    fn names(parts: &[Part], amount: Amount) -> Vec<String> {
        names_of(&Job { amount, ..job(false) }, parts)
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
    fn every_evaluation_has_its_bank() {
        for (_, name, bank, ..) in EVALUATIONS {
            assert!(BANKS.iter().any(|(known, ..)| *known == bank), "{name}");
        }
    }

    #[test]
    fn figures_are_of_banks_in_the_format_that_a_user_gets() {
        let steps = steps(&job(false), Part::value_variants());
        let banks: Vec<String> = steps.iter().filter(|s| s.name.ends_with(".bank")).map(Step::command).collect();
        assert!(banks.len() > 30 && banks.iter().all(|command| !command.contains("--rows")), "{banks:?}");
    }

    #[test]
    fn chance_is_asked_for_an_edge_wherever_chance_is_asked() {
        for (_, name, _, _, ways, _) in EVALUATIONS {
            assert_eq!(ways.contains("random,random-edge"), ways.contains("random"), "{name}");
        }
    }

    #[test]
    fn a_part_on_its_own_has_all_that_it_needs() {
        assert_eq!(names(&[Part::Classes], Amount::SMOKE), ["large-pegs", "large.bank", "large-4", "large-8"]);
        assert_eq!(names(&[Part::Tradeoff], Amount::SMOKE), ["tradeoff"]);
    }
}

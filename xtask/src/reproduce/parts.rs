//! The steps of each part, in order. They run in the output folder: paths are short and the same in every folder.

use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::experiments::{Amount, Calibration, Experiments, Part};
use crate::program::Program;
use crate::step::Step;
use crate::workspace::Workspace;

/// What steps are made for.
pub struct Job<'a> {
    /// Where the programs are.
    pub workspace: &'a Workspace,
    /// What is run.
    pub experiments: &'a Experiments,
    /// The model to evaluate.
    pub model: &'a Path,
    /// How much of everything.
    pub amount: Amount,
    /// Whether sensors are compared on the letters for tuning.
    pub tuning_letters: bool,
    /// Folder of real images.
    pub real: PathBuf,
    /// Sensors that are left out, because their real images are missing.
    pub without: Vec<String>,
}

impl<'a> Job<'a> {
    /// Everything in full with a model.
    pub fn whole(workspace: &'a Workspace, experiments: &'a Experiments, model: &'a Path) -> Self {
        let (amount, tuning_letters, real, without) = (experiments.whole, false, PathBuf::new(), Vec::new());
        Self { workspace, experiments, model, amount, tuning_letters, real, without }
    }
}

/// The word of flags that is the file of the networks that draw and verify by maps.
const MAPS: &str = "MAPS";

/// Makes steps.
pub(super) struct Maker<'a> {
    pub(super) job: &'a Job<'a>,
    steps: Vec<Step>,
}

/// The steps of some parts; what several need is made once.
pub fn steps(job: &Job, parts: &[Part]) -> Result<Vec<Step>> {
    let mut maker = Maker { job, steps: Vec::new() };
    for part in parts {
        match part {
            Part::Sensors => maker.sensors()?,
            Part::Assembly => maker.assembly()?,
            Part::Tradeoff => maker.tradeoff()?,
            _ => maker.evaluations(*part)?,
        }
    }
    Ok(maker.steps)
}

impl Maker<'_> {
    pub(super) fn evaluations(&mut self, part: Part) -> Result<()> {
        let experiments = self.job.experiments;
        for evaluation in experiments.evaluations.iter().filter(|evaluation| evaluation.part == part) {
            let model = match &evaluation.calibration {
                Some(name) => self.calibrate(self.job.model, experiments.calibration(name)?)?,
                None => self.job.model.to_path_buf(),
            };
            let (name, n) = (&evaluation.name, Experiments::n_episodes(evaluation.episodes, self.job.amount));
            let (bank, scene_of_bank) = self.bank(&evaluation.bank)?;
            let scene = evaluation.scene.as_ref().map_or(scene_of_bank, |scene| self.scene(scene));
            let program = self.program("tactile-filter", "evaluate --model").arg(&model);
            let program = program.words(format!("--bank {bank} --scene")).arg(scene);
            let (program, maps) =
                self.flags(program.words(format!("--episodes {n} --out {name}")), &evaluation.flags)?;
            let step = Step::new(name, program, name).with_last("evaluation.json").needs(model).needs(bank);
            self.add(maps.into_iter().fold(step, Step::needs));
        }
        Ok(())
    }

    fn assembly(&mut self) -> Result<()> {
        let (bank, scene) = self.bank("four-letters")?;
        let program = self.program("tactile-filter", "assemble --model").arg(self.job.model);
        let program = program.words(format!("--bank {bank} --scene")).arg(scene);
        let program = program.words(format!("--trials {} --out assembly", self.job.amount.trials));
        let step = Step::new("assembly", program, "assembly").with_last("assembly.json");
        self.add(step.needs(self.job.model).needs(bank));
        Ok(())
    }

    fn tradeoff(&mut self) -> Result<()> {
        let Amount { of_settings: episodes, settings, trains, .. } = self.job.amount;
        let mut models = vec![self.job.model.to_path_buf()];
        for model in self.job.experiments.models.iter().filter(|_| trains) {
            models.push(self.trained(&model.name, &model.data, &model.flags)?);
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
        Ok(())
    }

    /// Trains and calibrates a model; returns its file.
    fn trained(&mut self, name: &str, data: &str, more: &str) -> Result<PathBuf> {
        let fidelity = if data == "maze" { "" } else { "--fidelity optics" };
        let touches = self.dataset(data, "maze", &format!("--pairs 12000 {fidelity}"));
        let folder = format!("model-{name}");
        let program = self.program("tactile-train", format!("--data {data} --preset tiny --out {folder} {more}"));
        let step = Step::new(&folder, program, &folder).with_last("model.safetensors").needs(touches);
        self.add(step.resumes_from("state.safetensors"));
        self.calibrate_anywhere(name, &Path::new(&folder).join("model.safetensors"), "alphabet-small-dev")
    }

    /// Calibrates a model on holes of a scene for tuning, touched anywhere; returns its file.
    pub(super) fn calibrate_anywhere(&mut self, name: &str, model: &Path, scene: &str) -> Result<PathBuf> {
        let (holes, bank) = ("--sides hole --seed 9 --anywhere 40".into(), "--views pegs $cosine $fine".into());
        let calibration = Calibration { name: name.into(), scene: scene.into(), holes, bank, ..Calibration::default() };
        self.calibrate(model, &calibration)
    }

    /// Adds the steps of a calibration; returns the calibrated model's file.
    fn calibrate(&mut self, model: &Path, of: &Calibration) -> Result<PathBuf> {
        let Calibration { name, scene, .. } = of;
        let bank = format!("{name}-dev.bank");
        let holes = of.dataset.clone().unwrap_or_else(|| format!("{}-holes", scene.trim_end_matches(".toml")));
        let touches = self.dataset(&holes, scene, &of.holes);
        let program = self.program("tactile-infer", "bank --model").arg(model);
        let flags = self.job.experiments.expand(&of.bank)?;
        let program = program.words(format!("--scene {scene} --out {bank} {flags}"));
        self.add(Step::new(&bank, program, &bank).needs(model).needs_scene(scene));
        let calibrated = format!("{name}.safetensors");
        let program = self.program("tactile-infer", "calibrate --model").arg(model);
        let program = program.words(format!("--bank {bank} --holes {holes} {} --out {calibrated}", of.flags));
        self.add(Step::new(&calibrated, program, &calibrated).needs(bank).needs(touches));
        Ok(calibrated.into())
    }

    /// A program with the words of some flags; `MAPS` among them are the networks beside the model, which then are an input.
    fn flags(&self, program: Program, flags: &str) -> Result<(Program, Option<PathBuf>)> {
        let (flags, maps) = (self.job.experiments.expand(flags)?, self.job.model.with_extension("maps.safetensors"));
        let has_maps = flags.split_whitespace().any(|word| word == MAPS);
        let add = |program: Program, word: &str| if word == MAPS { program.arg(&maps) } else { program.arg(word) };
        Ok((flags.split_whitespace().fold(program, add), has_maps.then_some(maps)))
    }

    /// Adds the steps of a bank; returns its file and its scene.
    fn bank(&mut self, name: &str) -> Result<(String, String)> {
        let made = self.job.experiments.bank(name)?;
        let (bank, scene) = (format!("{name}.bank"), self.scene(&made.scene));
        let mut program = self.program("tactile-infer", "bank --model").arg(self.job.model);
        let input;
        if let Some(flags) = &made.flags {
            program = program.words("--scene").arg(&scene).words(format!("--out {bank}"));
            (program, input) = self.flags(program, flags)?;
        } else {
            let pegs = format!("{name}-pegs");
            input = Some(self.dataset(&pegs, &scene, "--sides peg"));
            program = program.words(format!("--data {pegs} --out {bank}"));
        }
        let step = Step::new(&bank, program, &bank).needs(self.job.model).needs_scene(&scene);
        self.add(input.into_iter().fold(step, Step::needs));
        Ok((bank, scene))
    }

    /// Adds the step of a dataset; returns the file of it that is written last.
    fn dataset(&mut self, name: &str, scene: &str, more: &str) -> PathBuf {
        let program = self.program("tactile-data", "generate --scene").arg(scene);
        let program = program.words(format!("--out {name} {more}"));
        self.add(Step::new(name, program, name).with_last("meta.json").needs_scene(scene));
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
        let experiments: &Experiments = Box::leak(Box::new(Experiments::of_the_project()));
        let (amount, without) = (experiments.smoke, vec!["fots-balls".into()]);
        Job { amount, tuning_letters, without, ..Job::whole(workspace, experiments, Path::new("/m")) }
    }

    /// The names of the steps of a job.
    pub fn names_of(job: &Job, parts: &[Part]) -> Vec<String> {
        steps(job, parts).unwrap().into_iter().map(|step| step.name).collect()
    }

    #[test]
    fn what_several_parts_need_is_made_once_and_before_them() {
        let job = job(false);
        let names = names_of(&Job { amount: job.experiments.whole, ..job }, Part::value_variants());
        let mut once = names.clone();
        once.sort();
        once.dedup();
        assert_eq!(once.len(), names.len());
        let at = |name: &str| names.iter().position(|found| found == name).unwrap();
        assert!(at("small.bank") < at("small") && at("large.bank") < at("large-4"));
        assert!(at("small-fine.bank") < at("small-anywhere-absent") && at("tiny.safetensors") < at("tradeoff"));
    }

    #[test]
    fn figures_are_of_banks_in_the_format_that_a_user_gets() {
        let steps = steps(&job(false), Part::value_variants()).unwrap();
        let banks: Vec<String> = steps.iter().filter(|s| s.name.ends_with(".bank")).map(Step::command).collect();
        assert!(banks.len() > 30 && banks.iter().all(|command| !command.contains("--rows")), "{banks:?}");
    }

    #[test]
    fn chance_is_asked_for_an_edge_wherever_chance_is_asked() {
        let experiments = Experiments::of_the_project();
        for evaluation in &experiments.evaluations {
            let flags = experiments.expand(&evaluation.flags).unwrap();
            assert_eq!(flags.contains("random,random-edge"), flags.contains("random"), "{}", evaluation.name);
        }
    }

    #[test]
    fn a_part_on_its_own_has_all_that_it_needs() {
        assert_eq!(names_of(&job(false), &[Part::Classes]), ["large-pegs", "large.bank", "large-4", "large-8"]);
        assert_eq!(names_of(&job(false), &[Part::Tradeoff]), ["tradeoff"]);
    }
}

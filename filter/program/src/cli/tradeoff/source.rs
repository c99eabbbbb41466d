//! What a trade-off is measured on: a scene, or recorded touches.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::{Deserialize, Serialize};
use tactile_data::dataset::store::{self, Dataset};
use tactile_data::dataset::touch::Side;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_eval::holes::{OwnedHoles, RecordedHoles};
use tactile_eval::recorded_steps::RecordedSteps;
use tactile_eval::result::Poses;
use tactile_eval::sweep::Planned;
use tactile_eval::{Error, Result};
use tactile_filter::budget::Setup;
use tactile_infer::bank::recorded::mosaics::with_maps_of_dataset;
use tactile_infer::bank::recorded::{PegPoses, bank_of_dataset};
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::simulated::learner::Learner;
use tactile_infer::bank::simulated::mosaics::with_maps_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::{Bank, Model};

/// What pegs and holes are touched.
#[derive(Args)]
pub struct SourceArgs {
    /// Scene, preset or TOML file. What is shipped or used must be measured on parts for tuning
    #[arg(long, value_name = "PRESET|FILE.toml", default_value = "alphabet-small-dev")]
    scene: String,
    /// Recorded touches instead of a scene: the dataset of pegs that the banks are made of
    #[arg(long, value_name = "DIR", requires = "holes", conflicts_with_all = ["scene", "bank_seed"])]
    pegs: Option<PathBuf>,
    /// With --pegs: the filter chooses among the touches of this dataset's holes, each at most once
    #[arg(long, value_name = "DIR", requires = "pegs")]
    holes: Option<PathBuf>,
    /// Seed of the simulated touches of pegs
    #[arg(long, value_name = "SEED", default_value_t = 1, help_heading = "Episodes")]
    bank_seed: u64,
    /// Allow holes recorded at another scale than the pegs
    #[arg(long, requires = "pegs", help_heading = "Machine")]
    other_sensor: bool,
}

impl SourceArgs {
    /// Loads what is touched.
    ///
    /// # Errors
    /// A scene without a reach, or datasets that cannot be read or hold no pegs.
    pub fn load(&self) -> Result<Source> {
        let (Some(pegs), Some(holes)) = (&self.pegs, &self.holes) else {
            let scene = Scene::load(&self.scene)?;
            let no_reach = || Error::invalid(&self.scene, "a scene of parts with a reach", "one without");
            let reach = scene.reach.ok_or_else(no_reach)?;
            let simulator = Arc::new(Simulator::new(scene, 1)?);
            return Ok(Source::Scene { simulator, reach, bank_seed: self.bank_seed });
        };
        let (pegs, holes) = (Dataset::open(pegs)?, Arc::new(Dataset::open(holes)?));
        let poses = PegPoses::from_dataset(&pegs)?;
        let steps = RecordedSteps::of(&poses);
        Ok(Source::Recording(Box::new(Recording { pegs, holes, poses, steps, other_sensor: self.other_sensor })))
    }

    /// The files that it is read from.
    pub fn files(&self) -> Vec<PathBuf> {
        let datasets = self.pegs.iter().chain(&self.holes);
        let files: Vec<PathBuf> = datasets.flat_map(|data| store::FILES.map(|file| data.join(file))).collect();
        if files.is_empty() { vec![PathBuf::from(Scene::file_of(&self.scene))] } else { files }
    }
}

/// What pegs and holes are touched, loaded.
pub enum Source {
    /// Touched anew each time by a simulated sensor.
    Scene { simulator: Arc<Simulator>, reach: PoseGrid, bank_seed: u64 },
    /// Touched once, by somebody's sensor.
    Recording(Box<Recording>),
}

/// Recorded pegs and holes.
pub struct Recording {
    pegs: Dataset,
    holes: Arc<Dataset>,
    poses: PegPoses,
    steps: RecordedSteps,
    other_sensor: bool,
}

/// What the figures of a setting depend on, besides the setting and the episodes.
#[derive(PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MeasuredOn {
    Scene { scene: Box<Scene>, bank_seed: u64 },
    Recording { pegs: RecordingId, holes: RecordingId },
}

/// A recording: its name for people, and the checksum of all that it holds.
#[derive(PartialEq, Serialize, Deserialize)]
pub struct RecordingId {
    name: String,
    sha256: String,
}

impl RecordingId {
    fn of(dataset: &Dataset) -> Result<Self> {
        Ok(Self { name: dataset.meta().name.clone(), sha256: dataset.sha256()? })
    }
}

/// A bank and the holes that it is compared with.
pub struct PegsAndHoles {
    pub bank: Bank,
    pub holes: OwnedHoles,
    /// What a person should know of both, a line each.
    pub notes: Vec<String>,
}

impl Source {
    /// Name of the scene, or of the recording of the holes.
    pub fn name(&self) -> &str {
        match self {
            Self::Scene { simulator, .. } => &simulator.scene().name,
            Self::Recording(recording) => &recording.holes.meta().name,
        }
    }

    /// Whether it was recorded.
    pub fn is_recorded(&self) -> bool {
        matches!(self, Self::Recording(_))
    }

    /// Parts to choose from.
    pub fn n_classes(&self) -> usize {
        match self {
            Self::Scene { simulator, .. } => simulator.parts().len(),
            Self::Recording(recording) => recording.poses.parts.len(),
        }
    }

    /// What the figures of a setting depend on.
    pub fn measured_on(&self) -> Result<MeasuredOn> {
        Ok(match self {
            Self::Scene { simulator, bank_seed, .. } => {
                MeasuredOn::Scene { scene: Box::new(simulator.scene().clone()), bank_seed: *bank_seed }
            }
            Self::Recording(recording) => MeasuredOn::Recording {
                pegs: RecordingId::of(&recording.pegs)?,
                holes: RecordingId::of(&recording.holes)?,
            },
        })
    }

    /// The settings among some that can be had, and why where others take their place.
    pub fn plan(&self, planned: Vec<Planned>) -> (Vec<Planned>, Option<String>) {
        let Self::Recording(recording) = self else { return (planned, None) };
        let kept = recording.steps.plan(planned.clone());
        let note = recording.steps.note(&planned, &kept);
        (kept, note)
    }

    /// Makes a bank of a scene again without one of its parts; nothing of recordings, whose banks learn nothing of holes.
    ///
    /// # Errors
    /// A scene that does not give this bank.
    pub fn learner(&self, model: &Model, bank: &Bank) -> Result<Option<Arc<Learner>>> {
        let (Self::Scene { simulator, .. }, Some(_)) = (self, bank.metric()) else { return Ok(None) };
        Ok(Some(Arc::new(Learner::of_bank(model, bank, simulator.scene(), &|_, _| ())?)))
    }

    /// The bank of a setting's steps, and the holes.
    ///
    /// # Errors
    /// Pegs that make no bank, or holes that are not those of its parts.
    pub fn pegs_and_holes(&self, model: &Model, settings: &Setup, poses: Poses) -> Result<PegsAndHoles> {
        match self {
            Self::Scene { simulator, reach, bank_seed } => {
                let Setup { xy_step_mm, theta_step_deg, .. } = *settings;
                let mut scene = simulator.scene().clone();
                scene.reach = Some(PoseGrid { xy_step_mm, theta_step_deg, ..*reach });
                let bank = bank_of_scene(model, &scene, Views::Pegs, *bank_seed, &|_, _| ())?;
                let bank = match model.maps() {
                    Some(maps) => with_maps_of_scene(bank, maps, (&scene, Views::Pegs), *bank_seed, &|_, _| ())?,
                    None => bank,
                };
                Ok(PegsAndHoles {
                    bank,
                    holes: OwnedHoles::Simulated(Arc::clone(simulator), Side::Hole),
                    notes: Vec::new(),
                })
            }
            Self::Recording(recording) => recording.pegs_and_holes(model, settings, poses),
        }
    }
}

impl Recording {
    fn pegs_and_holes(&self, model: &Model, settings: &Setup, poses: Poses) -> Result<PegsAndHoles> {
        let made = bank_of_dataset(model, &self.pegs, self.steps.bank_poses(settings), &|_, _| ())?;
        let bank = match model.maps() {
            Some(maps) => with_maps_of_dataset(made.bank, maps, &self.pegs, &|_, _| ())?,
            None => made.bank,
        };
        let recorded = RecordedHoles::new(Arc::clone(&self.holes), Side::Hole, &bank, self.other_sensor)?;
        let Setup { xy_step_mm, theta_step_deg, .. } = settings;
        let of_bank = |note: &String| format!("note: bank of {xy_step_mm} mm, {theta_step_deg}°: {note}");
        let mut notes: Vec<String> = made.notes.iter().map(of_bank).collect();
        notes.extend(recorded.notes().iter().map(|note| format!("note: {note}")));
        notes.extend(bank.other_light(recorded.lamps()).map(|why| format!("warning: {why}")));
        let between = recorded.between_poses_of(&bank).filter(|_| poses == Poses::OnGrid);
        notes.extend(between.map(|why| format!("warning: {why}")));
        Ok(PegsAndHoles { bank, holes: OwnedHoles::Recorded(Box::new(recorded)), notes })
    }
}

//! What is touched: the holes of a simulated scene or of a recording, or their pegs.

use std::sync::Arc;

use tactile_data::frame::Frame;
use tactile_data::grid::PoseGrid;
use tactile_data::lamps::Lamps;
use tactile_data::se2::Se2;
use tactile_data::simulator::Simulator;
use tactile_data::store::Dataset;
use tactile_data::symmetry::Symmetry;
use tactile_data::touch::Side;
use tactile_filter::Sensor;
use tactile_infer::{Bank, Model};

use crate::error::{Error, Result};

/// The holes of an evaluation; with the side `Peg` its pegs, in all that is said of holes.
#[derive(Clone, Copy)]
pub enum Holes<'a> {
    /// This side of a scene's parts, touched anew each time by a simulated sensor.
    Simulated(&'a Simulator, Side),
    /// Touched once, by somebody's sensor.
    Recorded(&'a RecordedHoles),
}

/// [`Holes`] with what they are of.
#[derive(Debug)]
pub enum OwnedHoles {
    /// As [`Holes::Simulated`].
    Simulated(Arc<Simulator>, Side),
    /// As [`Holes::Recorded`].
    Recorded(Box<RecordedHoles>),
}

impl OwnedHoles {
    /// The same, borrowed.
    pub fn holes(&self) -> Holes<'_> {
        match self {
            Self::Simulated(simulator, side) => Holes::Simulated(simulator, *side),
            Self::Recorded(recorded) => Holes::Recorded(recorded),
        }
    }
}

/// A dataset's holes, of the parts of a bank.
#[derive(Debug)]
pub struct RecordedHoles {
    dataset: Arc<Dataset>,
    side: Side,
    /// The bank's parts.
    parts: Vec<String>,
    /// The frames of each part's hole.
    frames: Vec<Vec<usize>>,
    /// The turns after which each part looks the same, as the bank has it.
    symmetries: Vec<Symmetry>,
    notes: Vec<String>,
}

impl RecordedHoles {
    /// The touches of one side of a dataset whose poses are known, for the parts of a bank. An `Arc` lets several banks
    /// share the dataset.
    ///
    /// # Errors
    /// A dataset of another scale than the bank's, no such touch, a part of the bank without any, or touches of other
    /// parts.
    pub fn new(dataset: impl Into<Arc<Dataset>>, side: Side, bank: &Bank, other_sensor: bool) -> Result<Self> {
        let dataset = dataset.into();
        let name = dataset.meta().name.clone();
        check_scale(&dataset, bank, other_sensor)?;
        let parts = bank.parts().to_vec();
        let mut frames = vec![Vec::new(); parts.len()];
        let mut n_unknown = 0;
        for (frame, touch) in dataset.touches().iter().enumerate().filter(|(_, t)| t.side == Some(side)) {
            let (Some(part), Some(_)) = (&touch.part, touch.part_from_sensor) else {
                n_unknown += 1;
                continue;
            };
            let Some(part) = parts.iter().position(|name| name == part) else {
                let place = format!("{name}: index row {frame}");
                return Err(Error::invalid(place, format!("one of the bank's parts, {}", parts.join(" ")), part));
            };
            frames[part].push(frame);
        }
        if let Some(part) = frames.iter().position(Vec::is_empty) {
            let expected = format!("touches of the {side} of {}, with their poses", parts[part]);
            return Err(Error::invalid(name, expected, "none"));
        }
        let mut notes = Vec::new();
        if n_unknown > 0 {
            notes.push(format!("{n_unknown} touches of {side}s are not used: part or pose is not known"));
        }
        let symmetries = (0..parts.len()).map(|part| bank.symmetry(part)).collect();
        Ok(Self { dataset, side, parts, frames, symmetries, notes })
    }

    /// The recording.
    pub fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// The sensor's lamps, where they are known.
    pub fn lamps(&self) -> Option<&Lamps> {
        self.dataset.meta().lamps.as_ref()
    }

    /// What of it is not used, a line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// A warning where its touches are said to lie at a bank's poses and do not.
    pub fn between_poses_of(&self, bank: &Bank) -> Option<String> {
        let touches =
            self.parts.iter().zip(&self.frames).flat_map(|(part, frames)| frames.iter().map(move |f| (part, *f)));
        let is_between = |(part, frame): &(&String, usize)| bank.row_at(part, &self.pose(*frame)).is_none();
        let (n_all, n_between) = (touches.clone().count(), touches.filter(is_between).count());
        let what = format!("{n_between} of {n_all} touches lie between the bank's poses: use --poses off-grid");
        (n_between > 0).then_some(what)
    }

    /// The frames of a part's hole.
    pub(crate) fn frames(&self, part: usize) -> &[usize] {
        &self.frames[part]
    }

    /// Where a frame of a hole was touched.
    pub(crate) fn pose(&self, frame: usize) -> Se2 {
        self.dataset.touch(frame).part_from_sensor.unwrap_or(Se2::IDENTITY)
    }
}

/// Refuses a recording of another scale than the bank's.
fn check_scale(dataset: &Dataset, bank: &Bank, other_sensor: bool) -> Result<()> {
    let Some(origin) = bank.origin().filter(|_| !other_sensor) else { return Ok(()) };
    let meta = dataset.meta();
    let Some([what, in_bank, here]) = origin.other_scale(meta.field_of_view_mm()) else { return Ok(()) };
    let place = format!("bank of {}: {what}", origin.name);
    Err(Error::invalid(place, format!("{here} as in {}", meta.name), in_bank))
}

impl<'a> Holes<'a> {
    /// Which side is touched.
    pub fn side(&self) -> Side {
        match self {
            Self::Simulated(_, side) => *side,
            Self::Recorded(recorded) => recorded.side,
        }
    }

    /// Name of the scene or of the recording.
    pub fn name(&self) -> &'a str {
        match self {
            Self::Simulated(simulator, _) => &simulator.scene().name,
            Self::Recorded(recorded) => &recorded.dataset.meta().name,
        }
    }

    /// The parts whose holes they are.
    pub fn parts(&self) -> &'a [String] {
        match self {
            Self::Simulated(simulator, _) => simulator.parts(),
            Self::Recorded(recorded) => &recorded.parts,
        }
    }

    /// Whether they were recorded.
    pub fn is_recorded(&self) -> bool {
        matches!(self, Self::Recorded(_))
    }

    /// The turns after which a part looks the same: by its geometry, or of a recording as the bank has it.
    pub fn symmetry(&self, part: usize) -> Symmetry {
        match self {
            Self::Simulated(simulator, _) => simulator.symmetry(part),
            Self::Recorded(recorded) => recorded.symmetries[part],
        }
    }

    /// The poses that a scene says its holes may be touched at; of a recording, those of the bank.
    pub fn reach(&self, bank: &Bank) -> PoseGrid {
        match self {
            Self::Simulated(simulator, _) => simulator.scene().reach.unwrap_or(*bank.grid()),
            Self::Recorded(_) => *bank.grid(),
        }
    }

    /// The sensor at rest in the robot's own session, which is not the bank's.
    pub fn at_rest(&self, seeds: &[u64]) -> Frame {
        match self {
            Self::Simulated(simulator, _) => simulator.no_contact(seeds.first().copied().unwrap_or(0) ^ 0x7265_7374),
            Self::Recorded(recorded) => recorded.dataset.no_contact().clone(),
        }
    }

    /// The sensor that touches them, whose frame at rest is `no_contact`; its lamps are made up for where they are known.
    ///
    /// # Errors
    /// A frame that shows nothing, or lamps that do not show slopes in all directions.
    pub fn sensor(&self, model: &Arc<Model>, no_contact: &Frame) -> Result<Sensor> {
        let lamps = match self {
            Self::Simulated(simulator, _) => simulator.scene().sensor.known_lamps(),
            Self::Recorded(recorded) => recorded.lamps().cloned(),
        };
        Ok(Sensor::new(Arc::clone(model), no_contact)?.of_side(self.side()).lit_by(&lamps)?)
    }

    /// Width and height of what a frame shows, mm.
    pub fn field_of_view_mm(&self) -> [f64; 2] {
        match self {
            Self::Simulated(simulator, _) => simulator.scene().sensor.field_of_view_mm,
            Self::Recorded(recorded) => recorded.dataset.meta().field_of_view_mm(),
        }
    }

    /// Closed contours of a part in its own frame, mm; none of a recorded one.
    pub fn outline_mm(&self, part: usize) -> Result<Vec<Vec<[f64; 2]>>> {
        match self {
            Self::Simulated(simulator, _) => {
                Ok(simulator.scene().shape(part, 0)?.regions.into_iter().flatten().collect())
            }
            Self::Recorded(_) => Ok(Vec::new()),
        }
    }
}

//! What is touched: the holes of a simulated scene or of a recording, or their pegs.

use std::sync::Arc;

use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, instead_of};
use tactile_data::frame::Frame;
use tactile_data::light::lamps::Lamps;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;
use tactile_data::sensor::simulator::Simulator;
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
    /// The frames of each part's hole; none of a part that was not recorded.
    frames: Vec<Vec<usize>>,
    /// The parts of which there are some.
    touched: Vec<usize>,
    /// The turns after which each part looks the same, as the bank has it.
    symmetries: Vec<Symmetry>,
    notes: Vec<String>,
}

impl RecordedHoles {
    /// The touches of one side of a dataset whose poses are known, for all or some of the parts of a bank. An `Arc` lets several
    /// banks share the dataset.
    ///
    /// # Errors
    /// A dataset of another scale than the bank's, no such touch, or touches of other parts.
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
        let touched: Vec<usize> = (0..parts.len()).filter(|part| !frames[*part].is_empty()).collect();
        if touched.is_empty() {
            let got = match n_unknown {
                0 if side.is_hole() => instead_of(side, dataset.touches(), "--side peg names them"),
                0 => instead_of(side, dataset.touches(), "--side hole names them"),
                n => format!("{n} of which part or pose is not known"),
            };
            return Err(Error::invalid(name, format!("touches of {side}s with their parts and poses"), got));
        }
        let mut notes = Vec::new();
        if touched.len() < parts.len() {
            let recorded: Vec<&str> = touched.iter().map(|part| parts[*part].as_str()).collect();
            let (n, of) = (touched.len(), parts.len());
            notes.push(format!(
                "{n} of the bank's {of} parts were recorded, and only they are touched: {}",
                recorded.join(" ")
            ));
        }
        if n_unknown > 0 {
            notes.push(format!("{n_unknown} touches of {side}s are not used: part or pose is not known"));
        }
        let symmetries = (0..parts.len()).map(|part| bank.symmetry(part)).collect();
        Ok(Self { dataset, side, parts, frames, touched, symmetries, notes })
    }

    /// The recording.
    pub fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// The sensor's lamps, where they are known.
    pub fn lamps(&self) -> Option<&Lamps> {
        self.dataset.meta().lamps.as_ref()
    }

    /// The parts of the bank that were recorded, by their names.
    fn recorded_parts(&self) -> Vec<String> {
        self.touched.iter().map(|part| self.parts[*part].clone()).collect()
    }

    /// What of it is not used and which parts were not recorded, a line each.
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

    /// The parts whose holes they are; of a recording those of the bank.
    pub fn parts(&self) -> &'a [String] {
        match self {
            Self::Simulated(simulator, _) => simulator.parts(),
            Self::Recorded(recorded) => &recorded.parts,
        }
    }

    /// The parts whose holes can be touched, by their numbers: all, or of a recording those that it has.
    pub fn touched(&self) -> Vec<usize> {
        match self {
            Self::Simulated(simulator, _) => (0..simulator.parts().len()).collect(),
            Self::Recorded(recorded) => recorded.touched.clone(),
        }
    }

    /// The names of those, where there are others in the bank; else none.
    pub fn some_parts(&self) -> Vec<String> {
        match self {
            Self::Recorded(recorded) if recorded.touched.len() < recorded.parts.len() => recorded.recorded_parts(),
            _ => Vec::new(),
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
            Self::Simulated(simulator, _) => simulator.scene().reach.unwrap_or(*bank.start()),
            Self::Recorded(_) => *bank.start(),
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

    /// Whether the lamps that they are touched under are known: those of a recording where it says them.
    pub fn knows_light(&self) -> bool {
        match self {
            Self::Simulated(simulator, _) => simulator.scene().sensor.light_known,
            Self::Recorded(recorded) => recorded.lamps().is_some(),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hole::Hole;
    use crate::result::Poses;
    use std::path::Path;
    use tactile_data::dataset::store::{DatasetWriter, Meta};
    use tactile_data::dataset::touch::Touch;
    use tactile_infer::bank::rows::Rows;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

    /// Touches of one side of some parts at each pose.
    fn dataset(at: &Path, side: Side, parts: &[&str]) -> Dataset {
        let frame = Frame::new(4, 2, (0..24).collect()).unwrap();
        let meta = Meta::new("some", "a test", [4, 2], [4.65, 7.15]);
        let mut writer = DatasetWriter::create(at, meta, &frame).unwrap();
        for part in parts {
            for cell in 0..GRID.len() {
                let (part, pose) = (Some((*part).to_owned()), Some(GRID.pose(cell)));
                let touch = Touch { part, side: Some(side), part_from_sensor: pose, ..Touch::default() };
                writer.push(&frame, &touch).unwrap();
            }
        }
        writer.finish().unwrap();
        Dataset::open(at).unwrap()
    }

    fn bank(parts: &[&str]) -> Bank {
        let n_rows = parts.len() * GRID.len();
        let rows = Rows::new(2, [1.0, 0.0].repeat(n_rows)).unwrap();
        let parts = parts.iter().map(|part| (*part).to_owned()).collect();
        Bank::from_rows(parts, GRID, rows, vec![0.5; n_rows], "").unwrap()
    }

    #[test]
    fn a_recording_of_some_of_the_parts_is_touched_there_alone() {
        let folder = tempfile::tempdir().unwrap();
        let bank = bank(&["A", "B", "C", "D"]);
        let some = dataset(&folder.path().join("some"), Side::Hole, &["D", "B"]);
        let some = RecordedHoles::new(some, Side::Hole, &bank, false).unwrap();
        assert_eq!(some.notes(), ["2 of the bank's 4 parts were recorded, and only they are touched: B D"]);
        let holes = Holes::Recorded(&some);
        assert_eq!((holes.parts(), holes.some_parts()), (bank.parts(), vec!["B".to_owned(), "D".to_owned()]));
        let parts: Vec<usize> =
            (0..40).map(|episode| Hole::new(holes, &GRID, Poses::OnGrid, 3, episode).part_index()).collect();
        assert!(parts.iter().all(|part| [1, 3].contains(part)) && parts.contains(&1) && parts.contains(&3));
        let all = dataset(&folder.path().join("all"), Side::Hole, &["A", "B", "C", "D"]);
        let all = RecordedHoles::new(all, Side::Hole, &bank, false).unwrap();
        assert!(all.notes().is_empty() && Holes::Recorded(&all).some_parts().is_empty());
    }

    #[test]
    fn touches_of_the_other_side_are_refused_with_the_flag_that_takes_them() {
        let folder = tempfile::tempdir().unwrap();
        let pegs = dataset(&folder.path().join("pegs"), Side::Peg, &["A"]);
        let refused = RecordedHoles::new(pegs, Side::Hole, &bank(&["A", "B"]), false).unwrap_err().to_string();
        let expected = "some: expected touches of holes with their parts and poses, got 9 touches of pegs (--side peg";
        assert!(refused.starts_with(expected), "{refused}");
    }
}

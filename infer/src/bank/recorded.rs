//! A bank from a dataset of recorded or simulated peg touches.

pub mod mosaics;

use rayon::prelude::*;
use tactile_data::dataset::origin::{Origin, PartOrigin, SensorOrigin};
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, instead_of};
use tactile_data::frame::moved_view::moved_view;
use tactile_data::frame::{Background, Frame, TactileImage};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::grid_fit::{self, Tolerance};
use tactile_data::pose::se2::Se2;

use crate::bank::Bank;
pub use crate::bank::nearest_touches::BankPoses;
use crate::bank::nearest_touches::nearest_touches;
use crate::bank::resampling::{Recordings, Resampled};
use crate::bank::rows::Rows;
use crate::embedding::model::Model;
use crate::error::{Error, Result};

/// A bank made of recorded touches, and what a person should know of it.
#[derive(Clone, Debug)]
pub struct RecordedBank {
    /// The bank; views that were not recorded are unknown in it.
    pub bank: Bank,
    /// What it lacks and what was not used, a line each.
    pub notes: Vec<String>,
}

/// A view is moved to its place on the grid where it was touched further from it, mm and degrees.
const SAME: (f64, f64) = (0.02, 0.05);

/// Embeds a dataset of peg touches: each part at each pose of a grid, the touch nearest to it, its view moved to
/// where the pose is.
///
/// What was not recorded at a pose is unknown to the filter; for the interpolation between the views around it, its row
/// is a local linear fit through them. With [`BankPoses::resample`] the poses of the grid are such fits wherever
/// touches lie near enough.
///
/// # Errors
/// A dataset without pegs, with a peg whose part or pose is not known, with poses on no grid, or frames that the
/// model cannot take.
pub fn bank_of_dataset(
    model: &Model,
    dataset: &Dataset,
    poses: BankPoses,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<RecordedBank> {
    let name = &dataset.meta().name;
    let mut pegs = pegs(dataset)?;
    let grid = grid(dataset, &pegs, poses)?;
    pegs.iter_mut().for_each(|peg| peg.snap(&grid, poses.tolerance));
    let background = model.background_of(dataset)?;
    let see = |peg: &Peg<'_>| Ok(background.tactile_image(&peg.view(dataset))?);
    let (mut keys, mut shares) = (Vec::new(), Vec::new());
    for (done, some) in pegs.chunks(256).enumerate() {
        progress(done * 256, pegs.len());
        let images = some.par_iter().map(see).collect::<Result<Vec<TactileImage>>>()?;
        keys.extend(model.embed_pegs(&images)?);
        shares.extend(images.iter().map(|image| image.edge_share));
    }
    progress(pegs.len(), pegs.len());
    let parts = parts(&pegs);
    let (mut rows, mut edge_shares, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    let mut notes = Notes::default();
    for part in &parts {
        let of_part: Vec<usize> = (0..pegs.len()).filter(|i| pegs[*i].part == *part).collect();
        let recordings = Recordings {
            poses: of_part.iter().map(|i| pegs[*i].pose).collect(),
            rows: of_part.iter().flat_map(|i| &keys[i * model.dim()..][..model.dim()]).copied().collect(),
            edge_shares: of_part.iter().map(|i| shares[*i]).collect(),
        };
        let Resampled { touch_of_cell, is_known, .. } = recordings.at_cells(&grid, poses, &mut rows, &mut edge_shares);
        let first = edge_shares.len() - grid.len();
        missing.extend((0..grid.len()).filter(|cell| !is_known[*cell]).map(|cell| first + cell));
        notes.add(part, &is_known, of_part.len() - used(&touch_of_cell), poses);
    }
    let parts: Vec<String> = parts.into_iter().map(str::to_owned).collect();
    let origin = origin(dataset, &parts);
    let bank = Bank::of_rows(parts, grid, Rows::new(model.dim(), rows)?, edge_shares, model.sha256().clone())
        .and_then(|bank| bank.lacking(missing));
    let bank = bank.map_err(|error| error.within(name))?.with_origin(origin);
    Ok(RecordedBank { bank: with_known_parts(model, bank, dataset)?, notes: notes.lines })
}

/// Distinct touches that are taken for a cell.
fn used(touch_of_cell: &[Option<usize>]) -> usize {
    let mut used: Vec<usize> = touch_of_cell.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    used.len()
}

/// What a person should know of a bank.
#[derive(Default)]
struct Notes {
    lines: Vec<String>,
}

impl Notes {
    fn add(&mut self, part: &str, is_known: &[bool], n_unused: usize, poses: BankPoses) {
        let n_missing = is_known.iter().filter(|known| !**known).count();
        if n_missing > 0 {
            self.lines.push(format!("part {part}: {n_missing} of {} poses not recorded; unknown", is_known.len()));
        }
        if n_unused > 0 && poses.resample.is_none() {
            let Tolerance { mm, deg } = poses.tolerance;
            self.lines.push(format!(
                "part {part}: {n_unused} touches not used: further than {mm} mm or {deg} degrees from the grid, or a pose \
                 touched before"
            ));
        }
    }
}

/// A recorded touch of a peg.
struct Peg<'a> {
    frame: usize,
    part: &'a str,
    pose: Se2,
    /// By how much its view is moved.
    moved: Option<Se2>,
}

impl Peg<'_> {
    /// Moves the view to its pose on the grid.
    fn snap(&mut self, grid: &PoseGrid, tolerance: Tolerance) {
        let Some(cell) = grid.exact(&self.pose, tolerance.mm, tolerance.deg) else { return };
        let moved = self.pose.inverse() * grid.pose(cell);
        let is_same = moved.x_mm.hypot(moved.y_mm) <= SAME.0 && moved.theta_deg().abs() <= SAME.1;
        if !is_same {
            (self.pose, self.moved) = (grid.pose(cell), Some(moved));
        }
    }

    fn view(&self, dataset: &Dataset) -> Frame {
        let frame = dataset.frame(self.frame);
        match &self.moved {
            Some(moved) => moved_view(dataset.no_contact(), &frame, moved, dataset.meta().mm_per_px),
            None => frame,
        }
    }
}

fn pegs(dataset: &Dataset) -> Result<Vec<Peg<'_>>> {
    let is_peg = |index: &usize| dataset.touch(*index).side == Some(Side::Peg);
    let known = |frame: usize| {
        let touch = dataset.touch(frame);
        match (&touch.part, touch.part_from_sensor) {
            (Some(part), Some(pose)) => Ok(Peg { frame, part, pose, moved: None }),
            _ => Err(Error::invalid(format!("index row {frame}"), "a part and a pose for each peg", "none")),
        }
    };
    let pegs = (0..dataset.len()).filter(is_peg).map(known).collect::<Result<Vec<_>>>()?;
    if pegs.is_empty() {
        let as_pegs =
            "if they are pegs, import them again as such: --side peg of a bag, side in an index, folders PART/peg";
        let got = instead_of(Side::Peg, dataset.touches(), as_pegs);
        return Err(Error::invalid(dataset.meta().name.clone(), "touches of pegs", got));
    }
    Ok(pegs)
}

/// The parts in order of appearance.
fn parts<'a>(pegs: &[Peg<'a>]) -> Vec<&'a str> {
    let mut parts: Vec<&str> = Vec::new();
    for peg in pegs {
        if !parts.contains(&peg.part) {
            parts.push(peg.part);
        }
    }
    parts
}

/// The poses that the robot was sent to: on a grid of the peg board.
fn stated_poses(dataset: &Dataset, pegs: &[Peg<'_>]) -> Vec<Se2> {
    let stated = dataset.meta().peg_from_hole.unwrap_or(Se2::IDENTITY);
    pegs.iter().map(|peg| stated * peg.pose).collect()
}

fn grid(dataset: &Dataset, pegs: &[Peg<'_>], poses: BankPoses) -> Result<PoseGrid> {
    let all = || stated_poses(dataset, pegs);
    let found = match (poses.resample, dataset.meta().reach) {
        (Some([mm, deg]), _) => grid_fit::covering(&all(), mm, deg),
        (None, Some(reach)) => return Ok(reach),
        (None, None) => {
            // A pose half as far off is a place of its own.
            let Tolerance { mm, deg } = poses.tolerance;
            grid_fit::fit(&all(), Tolerance { mm: 0.5 * mm, deg: 0.5 * deg })
        }
    };
    found.map_err(|error| Error::from(error).within(&dataset.meta().name))
}

/// What a dataset's touches were made of: as its scene says where it was simulated, else only its scale is known.
fn origin(dataset: &Dataset, parts: &[String]) -> Origin {
    let meta = dataset.meta();
    #[cfg(feature = "sim")]
    if let Some(Ok(scene)) = meta.scene.clone().map(serde_json::from_value::<tactile_data::scene::Scene>) {
        return scene.origin();
    }
    let field_of_view_mm = [0, 1].map(|axis| meta.mm_per_px[axis] * meta.frame_px[axis] as f64);
    let part = |name: &String| PartOrigin { name: name.clone(), size_mm: None };
    let sensor = SensorOrigin { field_of_view_mm, light: None, is_relit: meta.lamps.is_some() };
    Origin { name: meta.name.clone(), parts: parts.iter().map(part).collect(), sensor }
}

/// A bank with what its parts' geometry tells where the dataset was simulated, else with the symmetries that its views
/// show.
#[cfg_attr(not(feature = "sim"), expect(unused_variables, reason = "geometry is known to the simulator alone"))]
fn with_known_parts(model: &Model, bank: Bank, dataset: &Dataset) -> Result<Bank> {
    #[cfg(feature = "sim")]
    if let (Some(scene), Some(seed)) = (dataset.meta().scene.clone(), dataset.meta().seed)
        && let Ok(scene) = serde_json::from_value(scene)
    {
        let simulator = tactile_data::sensor::simulator::Simulator::new(scene, seed)?;
        if bank.parts().iter().all(|part| simulator.parts().contains(part)) {
            return crate::bank::simulated::with_geometry(model, bank, (&simulator, seed));
        }
    }
    Ok(bank.with_found_symmetries())
}

/// Where a dataset's pegs were touched.
#[derive(Clone, Debug)]
pub struct PegPoses {
    /// Their parts, in order of appearance.
    pub parts: Vec<String>,
    /// The grid that the poses lie on, as stated or as found from them; `None`: on none.
    pub grid: Option<PoseGrid>,
    /// Touches of the part that has the fewest.
    pub n_touches: usize,
    /// All poses as the robot was sent to them.
    poses: Vec<Se2>,
}

impl PegPoses {
    /// The poses of a dataset's pegs.
    ///
    /// # Errors
    /// No pegs, or one whose part or pose is not known.
    pub fn from_dataset(dataset: &Dataset) -> Result<Self> {
        let pegs = pegs(dataset)?;
        let parts = parts(&pegs);
        let n_touches = |part: &&str| pegs.iter().filter(|peg| peg.part == *part).count();
        Ok(Self {
            n_touches: parts.iter().map(n_touches).min().unwrap_or(0),
            parts: parts.into_iter().map(str::to_owned).collect(),
            grid: grid(dataset, &pegs, BankPoses::default()).ok(),
            poses: stated_poses(dataset, &pegs),
        })
    }

    /// The steps among some, mm and degrees, whose grid over these poses is the finest with two touches of each part
    /// for each place; `None` where each grid has more places. At two, 84 of 100 places of scattered touches have one
    /// within 0.6 steps, as a resampled view needs.
    pub fn densest(&self, offered: &[[f64; 2]]) -> Option<[f64; 2]> {
        let n_places = |[mm, deg]: [f64; 2]| Some(grid_fit::covering(&self.poses, mm, deg).ok()?.len());
        let is_met = |n: &usize| 2 * n <= self.n_touches;
        let held = offered.iter().filter_map(|steps| Some((n_places(*steps).filter(is_met)?, *steps)));
        held.max_by_key(|(n, _)| *n).map(|(_, steps)| steps)
    }
}

/// What the network sees of some frames of a dataset, in their order.
pub fn tactile_images(background: &Background, dataset: &Dataset, frames: &[usize]) -> Result<Vec<TactileImage>> {
    frames.par_iter().map(|frame| Ok(background.tactile_image(&dataset.frame(*frame))?)).collect()
}

/// The parts of a dataset's pegs, in order of appearance.
///
/// # Errors
/// Pegs that make no bank: none, of unknown part or pose, or on no grid.
pub fn parts_on_grid(dataset: &Dataset, poses: BankPoses) -> Result<Vec<String>> {
    let pegs = pegs(dataset)?;
    grid(dataset, &pegs, poses)?;
    Ok(parts(&pegs).into_iter().map(str::to_owned).collect())
}

/// For each row of a bank of a dataset's pegs the frame that recorded it, where one did.
///
/// # Errors
/// A peg whose part or pose is not known, or no pegs.
pub fn frames_by_row(dataset: &Dataset, bank: &Bank) -> Result<Vec<Option<usize>>> {
    let pegs = pegs(dataset)?;
    let mut frames = Vec::new();
    for part in bank.parts() {
        let of_part: Vec<&Peg<'_>> = pegs.iter().filter(|peg| peg.part == part).collect();
        let poses: Vec<Se2> = of_part.iter().map(|peg| peg.pose).collect();
        let touches = nearest_touches(bank.grid(), &poses, Tolerance::default());
        frames.extend(touches.into_iter().map(|touch| touch.map(|at| of_part[at].frame)));
    }
    Ok(frames)
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;
    #[cfg(feature = "burn")]
    use crate::bank::simulated::tests::{by_cosine, scene_and_model, touches};
    use std::path::Path;
    use tactile_data::dataset::store::{DatasetWriter, Meta};
    use tactile_data::dataset::touch::Touch;

    /// Pegs of two parts touched at some poses each, the second at one fewer.
    fn dataset(at: &Path, poses: &[Se2]) -> Dataset {
        let meta = Meta {
            name: "pegs".into(),
            frame_px: [4, 2],
            mm_per_px: [4.65, 7.15],
            reach: None,
            held_out: Vec::new(),
            scene: None,
            seed: None,
            source: "a test".into(),
            recording: None,
            lamps: None,
            peg_from_hole: None,
        };
        let frame = Frame::new(4, 2, (0..24).collect()).unwrap();
        let mut writer = DatasetWriter::create(at, meta, &frame).unwrap();
        for (part, poses) in [("A", poses), ("B", &poses[1..])] {
            for pose in poses {
                let (part, side) = (Some(part.to_owned()), Some(Side::Peg));
                writer.push(&frame, &Touch { part, side, part_from_sensor: Some(*pose), ..Touch::default() }).unwrap();
            }
        }
        writer.finish().unwrap();
        Dataset::open(at).unwrap()
    }

    #[test]
    fn pegs_tell_their_grid_or_how_dense_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let on = PoseGrid { xy_half_mm: 6.0, xy_step_mm: 3.0, theta_half_deg: 40.0, theta_step_deg: 20.0 };
        let poses: Vec<Se2> = (0..on.len()).map(|cell| on.pose(cell)).collect();
        let regular = PegPoses::from_dataset(&dataset(&folder.path().join("regular"), &poses)).unwrap();
        assert_eq!((regular.grid, regular.n_touches), (Some(on), on.len() - 1));
        assert_eq!(regular.parts, ["A", "B"]);
        // 100 touches over 16 mm and 120 degrees: a grid of 4 mm and 30 degrees has 5 x 5 x 5 places, one of 8 mm 45.
        let wave = |i: usize, k: f64| (i as f64 * k).fract() * 2.0 - 1.0;
        let place =
            |i| Se2::from_degrees(8.0 * wave(i, 0.618_033), 8.0 * wave(i, 0.754_877), 60.0 * wave(i, 0.569_840));
        let scattered = PegPoses::from_dataset(&dataset(
            &folder.path().join("scattered"),
            &(0..101).map(place).collect::<Vec<_>>(),
        ));
        let scattered = scattered.unwrap();
        assert_eq!((scattered.grid, scattered.n_touches), (None, 100));
        assert_eq!(scattered.densest(&[[8.0, 60.0], [8.0, 30.0], [4.0, 30.0]]), Some([8.0, 30.0]));
        assert_eq!(scattered.densest(&[[4.0, 30.0], [2.0, 15.0]]), None);
    }

    #[cfg(feature = "burn")]
    #[test]
    fn a_bank_without_a_dataset_is_the_one_of_a_dataset() {
        let (scene, model) = scene_and_model();
        let folder = tempfile::tempdir().unwrap();
        let dataset = touches(&scene, Side::Peg, 5, &folder.path().join("pegs"));
        let recorded = bank_of_dataset(&model, &dataset, BankPoses::default(), &|_, _| ()).unwrap();
        let bank = by_cosine(&model, &scene).make(None, &|_, _| ()).unwrap();
        assert_eq!(bank, recorded.bank);
        // At a recorded pose a peg is its own view but for noise and the place's jitter; a hole is another side.
        for part in 0..2 {
            let of = |side| bank.matches().of(part, side).unwrap();
            let (pegs, holes) = (of(Side::Peg), of(Side::Hole));
            assert!(pegs.matched.mean > 0.9, "{pegs:?}");
            assert!(holes.matched.mean < pegs.matched.mean, "{holes:?}");
        }
        assert!(recorded.notes.is_empty(), "{:?}", recorded.notes);
    }
}

//! A bank without a dataset: the parts of a scene touched and embedded as they come, nothing kept on disk but, where that
//! is asked for, the parts that are done.

pub mod density;
mod expected;
pub mod learner;
mod matches;
pub mod mosaics;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use tactile_data::dataset::generate::{Places, Planned, plan, render};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Background, Frame, TactileImage};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;

use crate::bank::Bank;
use crate::bank::learn_from::{LearnFrom, Learning};
use crate::bank::rows::Rows;
use crate::bank::views::{Views, to_middle};
use crate::calibration::BLANK_SHARE;
use crate::embedding::checkpoint::to_json;
use crate::embedding::model::Model;
use crate::embedding::threads;
use crate::error::{Error, Result};
use crate::safefile::pieces::sha256_of;
use crate::safefile::{NamedTensor, SafeFile};
use learner::Learner;

/// Touches embedded at a time.
const CHUNK: usize = 64;

/// Sets the draws of the holes apart from the draws of the pegs.
const HOLES: u64 = 0x686f_6c65_7300_0000;

/// The version of the layout of a kept part.
const PART_SCHEMA: &str = "tactile-filter/part-of-bank/1";

/// The bank of a scene's parts at the poses of its reach, which learns from simulated holes. Of views of pegs, learning from
/// nothing ([`SceneBank`]), it is to the bit the one that a dataset of them, generated with this seed, gives.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames the model cannot take.
pub fn bank_of_scene(
    model: &Model,
    scene: &Scene,
    views: Views,
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Bank> {
    SceneBank { model, scene, views, learn_from: LearnFrom::default(), seed }.make(None, progress)
}

/// What a simulated bank is made of.
#[derive(Clone, Copy, Debug)]
pub struct SceneBank<'a> {
    /// Embeds the touches.
    pub model: &'a Model,
    /// The parts, and the poses at which each is touched.
    pub scene: &'a Scene,
    /// What each view is of.
    pub views: Views,
    /// Whose touches teach how to compare embeddings.
    pub learn_from: LearnFrom,
    /// Draws jitter and noise.
    pub seed: u64,
}

/// The views of one part.
struct PartViews {
    /// `[n_cells, dim]`.
    rows: Vec<f32>,
    /// `[n_cells]`.
    edge_shares: Vec<f32>,
}

impl SceneBank<'_> {
    /// Makes the bank, as many parts at a time as the caller's pool has threads. Each part that is done is kept as a file in
    /// the folder `kept`, where there is one: a bank begun there before goes on with what it lacks, and a file that is
    /// damaged or was made of something else is made again. `progress` is called with the touches done and all of them.
    ///
    /// # Errors
    /// As [`bank_of_scene`], and a folder that cannot be written.
    pub fn make(&self, kept: Option<&Path>, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Bank> {
        self.learner(kept, progress)?.whole()
    }

    /// The bank before it learns, and its touches, made as [`Self::make`] makes them.
    ///
    /// # Errors
    /// As [`Self::make`].
    pub fn learner(&self, kept: Option<&Path>, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Learner> {
        let Self { model, scene, views, learn_from, seed } = *self;
        let simulator = Simulator::new(scene.clone(), seed)?;
        let (start, reach) = (self.reach()?, self.recorded()?);
        let turned = Scene { reach: Some(reach), ..scene.clone() };
        let planned = plan(&turned, &[Side::Peg], Places::EachPose, seed)?;
        let background = model.background(&simulator.no_contact(seed))?.lit_by(&scene.sensor.known_lamps())?;
        let (n_parts, done) = (simulator.parts().len(), AtomicUsize::new(0));
        let of_part = |part: usize| -> Result<PartViews> {
            let n_done = |more: usize| progress(done.fetch_add(more, Ordering::Relaxed) + more, planned.len());
            let file = kept.map(|folder| self.part_file(folder, part)).transpose()?;
            if let Some(found) = file.as_ref().and_then(|file| file.load(reach.len(), model.dim())) {
                n_done(reach.len());
                return Ok(found);
            }
            let touches = part * reach.len()..(part + 1) * reach.len();
            let made = self.touch_part(&simulator, &background, (&planned, touches), &n_done)?;
            file.map_or(Ok(()), |file| file.save(&made, model.dim()))?;
            Ok(made)
        };
        progress(0, planned.len());
        let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
        for of_part in threads::each(0..n_parts, of_part)? {
            rows.extend_from_slice(&of_part.rows);
            edge_shares.extend_from_slice(&of_part.edge_shares);
        }
        let (parts, rows) = (simulator.parts().to_vec(), Rows::new(model.dim(), rows)?);
        let bank = Bank::of_rows(parts, reach, rows, edge_shares, model.sha256().clone())?.with_start(start)?;
        let bank = bank.with_views(views).with_origin(scene.origin());
        of_geometry(model, bank, &simulator, Learning { from: learn_from, seed })
    }

    /// The poses at which views are recorded. Of pegs alone, as a robot records them, those of the reach. What is simulated is
    /// turned as far as two angles of the reach differ: a first touch at one and a later one at the other are seen by any part.
    fn recorded(&self) -> Result<PoseGrid> {
        let reach = self.reach()?;
        if self.views.is_pegs() {
            return Ok(reach);
        }
        let widest = (2.0 * reach.theta_half_deg).min(180.0);
        // As many steps as there are of a half turn, at most.
        let theta_half_deg = (widest / reach.theta_step_deg + 1e-6).floor() * reach.theta_step_deg;
        Ok(PoseGrid { theta_half_deg: theta_half_deg.max(reach.theta_half_deg), ..reach })
    }

    /// The poses at which each part is touched first.
    fn reach(&self) -> Result<PoseGrid> {
        let expected = "a reach: the poses at which each peg is touched";
        self.scene.reach.ok_or_else(|| Error::invalid(&self.scene.name, expected, "none"))
    }

    /// Removes what [`Self::make`] kept in a folder; anything else in it stays, and then the folder.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn forget(&self, kept: &Path) -> Result<()> {
        for part in 0..self.scene.part_names().len() {
            let path = part_path(kept, part);
            if path.exists() {
                std::fs::remove_file(&path).map_err(Error::io(&path))?;
            }
        }
        let is_empty = std::fs::read_dir(kept).is_ok_and(|mut entries| entries.next().is_none());
        if is_empty { std::fs::remove_dir(kept).map_err(Error::io(kept)) } else { Ok(()) }
    }

    /// Touches one part at each pose: the touches of a range of all that are planned.
    fn touch_part(
        &self,
        simulator: &Simulator,
        background: &Background,
        (planned, range): (&[Planned], Range<usize>),
        n_done: &dyn Fn(usize),
    ) -> Result<PartViews> {
        let (model, seed) = (self.model, self.seed);
        let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
        for first in range.clone().step_by(CHUNK) {
            let touches = &planned[first..(first + CHUNK).min(range.end)];
            let images = see(background, &render(simulator, seed, first, touches)?)?;
            let first_value = rows.len();
            rows.extend(model.embed_pegs(&images)?);
            edge_shares.extend(images.iter().map(|image| image.edge_share));
            if self.views == Views::Both {
                let hole = |touch: &Planned| Planned { side: Side::Hole, ..*touch };
                let of_holes: Vec<Planned> = touches.iter().map(hole).collect();
                let holes = see(background, &render(simulator, seed ^ HOLES, first, &of_holes)?)?;
                let queries = model.embed_holes(&holes)?;
                let keys = rows[first_value..].chunks_exact_mut(model.dim()).zip(queries.chunks_exact(model.dim()));
                // A hole that shows no edge where its peg does tells nothing of what it looks like.
                let edged = keys.zip(&holes).filter(|(_, hole)| hole.edge_share >= BLANK_SHARE);
                edged.for_each(|((key, query), _)| to_middle(key, query));
            }
            n_done(touches.len());
        }
        Ok(PartViews { rows, edge_shares })
    }

    /// The file that keeps a part, and what it is made of.
    fn part_file(&self, folder: &Path, part: usize) -> Result<PartFile> {
        let Self { model, scene, views, seed, .. } = *self;
        // The files of the user's own parts are in the scene by their names only: their geometry tells whether they changed.
        let sides = [Side::Peg, Side::Hole].map(|side| scene.reliefs(part, side, seed));
        let made_of = format!("{} {} {} {seed} {part} {sides:?}", model.sha256(), to_json(scene)?, views.name());
        let made_of = sha256_of(&[env!("CARGO_PKG_VERSION").as_bytes(), made_of.as_bytes()]);
        Ok(PartFile { path: part_path(folder, part), made_of })
    }
}

fn part_path(folder: &Path, part: usize) -> PathBuf {
    folder.join(format!("part-{part}.views"))
}

/// A part that is done, on disk.
struct PartFile {
    path: PathBuf,
    made_of: String,
}

impl PartFile {
    /// What the file keeps; `None` where there is none, or one that is damaged or of something else.
    fn load(&self, n_cells: usize, dim: usize) -> Option<PartViews> {
        let mut file = SafeFile::load(&self.path, PART_SCHEMA).ok()?;
        let mut take = |name: &str, shape: &[usize]| {
            let at = file.tensors.iter().position(|tensor| tensor.name == name && tensor.shape == shape);
            at.map(|at| file.tensors.swap_remove(at).values)
        };
        let (rows, edge_shares) = (take("rows", &[n_cells, dim])?, take("edge_shares", &[n_cells])?);
        file.text("made_of").is_ok_and(|made_of| made_of == self.made_of).then_some(PartViews { rows, edge_shares })
    }

    fn save(&self, views: &PartViews, dim: usize) -> Result<()> {
        let n_cells = views.edge_shares.len();
        let tensor =
            |name: &str, shape, values: &[f32]| NamedTensor { name: name.into(), shape, values: values.into() };
        let rows = tensor("rows", vec![n_cells, dim], &views.rows);
        let tensors = vec![rows, tensor("edge_shares", vec![n_cells], &views.edge_shares)];
        let text = vec![("made_of".into(), self.made_of.clone())];
        SafeFile { tensors, blobs: Vec::new(), text }.save(&self.path, PART_SCHEMA)
    }
}

fn see(background: &Background, frames: &[Frame]) -> Result<Vec<TactileImage>> {
    frames.par_iter().map(|frame| Ok(background.tactile_image(frame)?)).collect()
}

/// A bank of a scene's parts with what only their geometry tells: symmetries, and how well touches made now match the
/// views. It learns nothing else.
///
/// # Errors
/// A touch that cannot be made or seen.
pub(crate) fn with_geometry(model: &Model, bank: Bank, (simulator, seed): (&Simulator, u64)) -> Result<Bank> {
    of_geometry(model, bank, simulator, Learning { from: LearnFrom::Nothing, seed })?.whole()
}

/// A bank of a scene's parts with their symmetries, and touches of these parts: it is to learn from some of the
/// touches.
fn of_geometry(model: &Model, bank: Bank, simulator: &Simulator, learning: Learning) -> Result<Learner> {
    let of_name = |name: &String| simulator.parts().iter().position(|part| part == name).unwrap_or(0);
    let parts: Vec<usize> = bank.parts().iter().map(of_name).collect();
    let symmetries = parts.par_iter().map(|part| simulator.symmetry(*part)).collect();
    Learner::new(model, bank.with_symmetries(symmetries)?, (simulator, &parts), learning)
}

#[cfg(all(test, feature = "burn"))]
pub(crate) mod tests {
    use super::*;
    use crate::bank::similarity::dot;
    use crate::embedding::architecture::NetworkConfig;
    use crate::embedding::checkpoint::{Checkpoint, Provenance};
    use crate::embedding::device::DeviceKind;
    use tactile_data::dataset::generate::{Sampling, generate};
    use tactile_data::dataset::store::Dataset;
    use tactile_data::frame::Preprocessing;
    use tactile_data::pose::grid::PoseGrid;
    use tactile_data::scene::{Kit, Parts};

    /// Two letters at few poses, and a small network that has learnt nothing.
    pub fn scene_and_model() -> (Scene, Model) {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("KL", 12.0, 16.0));
        scene.reach = Some(PoseGrid { xy_half_mm: 8.0, xy_step_mm: 4.0, theta_half_deg: 45.0, theta_step_deg: 45.0 });
        scene.sensor.frame_px = [40, 30];
        let config = NetworkConfig { input_px: [16, 12], width: 8, hidden: 16, dim: 8 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        (scene, Model::new(checkpoint, "ab".into(), DeviceKind::Flex).unwrap())
    }

    /// The dataset of a side, drawn from a seed.
    pub fn touches(scene: &Scene, side: Side, seed: u64, out: &std::path::Path) -> Dataset {
        let sampling = Sampling { sides: &[side], places: Places::EachPose, seed, lab: None };
        generate(scene, &sampling, out, &|_, _| ()).unwrap();
        Dataset::open(out).unwrap()
    }

    /// A bank of pegs that learns nothing.
    pub fn by_cosine<'a>(model: &'a Model, scene: &'a Scene) -> SceneBank<'a> {
        SceneBank { model, scene, views: Views::Pegs, learn_from: LearnFrom::Nothing, seed: 5 }
    }

    #[test]
    fn a_bank_is_as_fine_as_its_parts_ask_for() {
        let (scene, model) = scene_and_model();
        let with_steps = |xy_step_mm, theta_step_deg| {
            let reach = scene.reach.map(|reach| PoseGrid { xy_step_mm, theta_step_deg, ..reach });
            Scene { reach, ..scene.clone() }
        };
        let most = |scene: &Scene| -> f64 {
            let lost = by_cosine(&model, scene).lost().unwrap();
            lost.iter().flatten().map(|lost| lost.along_xy).sum()
        };
        let [wide, fine] = [with_steps(8.0, 45.0), with_steps(0.5, 45.0)].map(|scene| most(&scene));
        assert!(wide > 4.0 * fine && fine >= 0.0, "{wide} {fine}");
        // What is asked for is little lost, unless there is nothing finer; its own steps say the same of it.
        let (grid, lost) = by_cosine(&model, &scene).asked_for().unwrap();
        let again = by_cosine(&model, &with_steps(grid.xy_step_mm, grid.theta_step_deg)).lost().unwrap();
        assert_eq!(again.len(), 2);
        for lost in lost.iter().chain(&again).flatten() {
            assert!(lost.along_xy <= density::ALLOWED || grid.xy_step_mm == 1.0, "{grid:?} {lost:?}");
            assert!(lost.along_theta <= density::ALLOWED || grid.theta_step_deg == 7.5, "{grid:?} {lost:?}");
        }
        let nowhere = Scene { reach: None, ..scene.clone() };
        assert!(by_cosine(&model, &nowhere).asked_for().unwrap_err().to_string().contains("a reach"));
        let odd = Scene {
            reach: scene.reach.map(|reach| PoseGrid { xy_half_mm: 7.3, xy_step_mm: 7.3, ..reach }),
            ..scene.clone()
        };
        assert!(by_cosine(&model, &odd).asked_for().unwrap_err().to_string().contains("steps of [2.0, 1.0] mm"));
    }

    #[test]
    fn what_is_simulated_is_turned_as_far_as_two_angles_of_the_reach_differ() {
        let (scene, model) = scene_and_model();
        let recorded = |theta_half_deg, theta_step_deg| {
            let reach = scene.reach.map(|reach| PoseGrid { theta_half_deg, theta_step_deg, ..reach });
            let scene = Scene { reach, ..scene.clone() };
            let of = |views| SceneBank { views, ..by_cosine(&model, &scene) }.recorded().unwrap();
            assert_eq!(Some(of(Views::Pegs)), reach);
            let turned = of(Views::Both);
            turned.validate().unwrap();
            assert_eq!(Some(PoseGrid { theta_half_deg, ..turned }), reach);
            turned.theta_half_deg
        };
        // No angle twice: 7 steps of 25 degrees are the last below half a turn.
        for (half, step, expected) in [
            (0.0, 15.0, 0.0),
            (20.0, 5.0, 40.0),
            (90.0, 15.0, 180.0),
            (90.0, 7.5, 180.0),
            (180.0, 30.0, 180.0),
            (100.0, 25.0, 175.0),
        ] {
            assert!((recorded(half, step) - expected).abs() < 1e-9, "{half} {step}");
        }
    }

    #[test]
    fn a_bank_that_was_begun_goes_on_with_what_it_lacks() {
        let (scene, model) = scene_and_model();
        let job =
            SceneBank { model: &model, scene: &scene, views: Views::Both, learn_from: LearnFrom::Nothing, seed: 5 };
        let whole = job.make(None, &|_, _| ()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("kept");
        let make = |job: &SceneBank<'_>| job.make(Some(&kept), &|_, _| ()).unwrap();
        assert_eq!(make(&job), whole);
        // Cut short, as no kill leaves it: made again. The other part is taken as it is, which another share of edge shows.
        let [first, second] = [0, 1].map(|part| part_path(&kept, part));
        let content = std::fs::read(&first).unwrap();
        std::fs::write(&first, &content[..content.len() / 2]).unwrap();
        let mut file = SafeFile::load(&second, PART_SCHEMA).unwrap();
        let shares = file.tensors.iter_mut().find(|tensor| tensor.name == "edge_shares").unwrap();
        shares.values[0] = 0.123;
        file.save(&second, PART_SCHEMA).unwrap();
        let again = make(&job);
        let n_cells = whole.grid().len();
        assert_eq!(again.edge_shares()[n_cells], 0.123);
        assert_eq!(again.edge_shares()[..n_cells], whole.edge_shares()[..n_cells]);
        assert_eq!((again.rows(), std::fs::read(&first).unwrap()), (whole.rows(), content));
        // What a bank learns is of its touches, not of its views.
        let learning = SceneBank { learn_from: LearnFrom::Both, ..job };
        let learnt = learning.make(None, &|_, _| ()).unwrap();
        std::fs::write(&second, "").unwrap();
        assert_eq!(make(&learning), learnt);
        let metric = learnt.metric().expect("a metric");
        assert_eq!(*learnt.rows(), metric.rows(whole.rows()).unwrap());
        assert!((0.05..1.5).contains(&metric.measured().error_scale), "{:?}", metric.measured());
        // What was made with another seed, or of other sides, is not taken.
        for other in [SceneBank { seed: 6, ..job }, SceneBank { views: Views::Pegs, ..job }] {
            assert_eq!(make(&other), other.make(None, &|_, _| ()).unwrap());
        }
        std::fs::write(kept.join("mine"), "").unwrap();
        job.forget(&kept).unwrap();
        assert_eq!(std::fs::read_dir(&kept).unwrap().count(), 1);
        std::fs::remove_file(kept.join("mine")).unwrap();
        job.forget(&kept).unwrap();
        assert!(!kept.exists());
    }

    #[test]
    fn a_view_of_both_sides_is_as_near_to_the_peg_as_to_the_hole() {
        let (scene, model) = scene_and_model();
        let by_cosine =
            SceneBank { model: &model, scene: &scene, views: Views::Pegs, learn_from: LearnFrom::Nothing, seed: 5 };
        let [pegs, both] =
            [Views::Pegs, Views::Both].map(|views| SceneBank { views, ..by_cosine }.make(None, &|_, _| ()).unwrap());
        assert_eq!([pegs.views(), both.views()], [Views::Pegs, Views::Both]);
        assert_eq!(both.with_parts(&[1]).unwrap().views(), Views::Both);
        let folder = tempfile::tempdir().unwrap();
        // Pegs as a robot records them, at 45 degrees to either side; what is simulated as far as two of them differ.
        let reach = scene.reach.unwrap();
        let turned = PoseGrid { theta_half_deg: 90.0, ..reach };
        assert_eq!([pegs.grid(), pegs.start(), both.grid(), both.start()], [&reach, &reach, &turned, &reach]);
        let scene = Scene { reach: Some(turned), ..scene.clone() };
        let pegs = SceneBank { scene: &scene, ..by_cosine }.make(None, &|_, _| ()).unwrap();
        let dataset = touches(&scene, Side::Hole, 5 ^ HOLES, &folder.path().join("holes"));
        let background = model.background(&Simulator::new(scene, 5).unwrap().no_contact(5)).unwrap();
        let mut n_middle = 0;
        for row in 0..both.n_rows() {
            let image = background.tactile_image(&dataset.frame(row)).unwrap();
            let hole = model.embed_holes(std::slice::from_ref(&image)).unwrap();
            let [peg, key] = [&pegs, &both].map(|bank| bank.row(row).into_owned());
            if image.edge_share < BLANK_SHARE {
                assert_eq!(key, peg);
                continue;
            }
            n_middle += 1;
            let [to_peg, to_hole] = [&peg, &hole].map(|side| dot(&key, side));
            assert!((to_peg - to_hole).abs() < 1e-5 && to_peg > dot(&peg, &hole) - 1e-5, "{to_peg} {to_hole}");
        }
        assert!(n_middle > both.n_rows() / 2, "{n_middle}");
        // What was simulated matches better.
        let matched = |bank: &Bank| bank.matches().of(0, Side::Hole).unwrap().matched.mean;
        assert!(matched(&both) > matched(&pegs));
        // The file says so, and the checksum tells them apart.
        let path = folder.path().join("both.bank");
        both.save(&path).unwrap();
        assert_eq!(Bank::load(&path, &model).unwrap(), both);
        assert_ne!(both.sha256().unwrap(), pegs.sha256().unwrap());
    }
}

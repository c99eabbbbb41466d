//! Datasets from scenes: pairs of touches all over MAZE boards, or each part at each pose of its reach.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::dataset::needs::Needs;
use crate::dataset::shard::{Fragment, Shard};
use crate::dataset::store::{Dataset, DatasetWriter, Meta};
pub use crate::dataset::touch::Planned;
use crate::dataset::touch::{Side, Touch};
use crate::error::{Error, Result};
use crate::file::output;
use crate::frame::Frame;
use crate::pose::se2::Se2;
use crate::scene::lab::Lab;
use crate::scene::random::{around_zero, frame_rng};
use crate::scene::{MazeBoards, Parts, Scene};
use crate::sensor::simulator::Simulator;

/// Frames rendered between two writes: enough for all threads, little in memory.
const CHUNK: usize = 256;

/// Where the parts of a kit are touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Places {
    /// At each pose of the reach: what a bank is made of.
    EachPose,
    /// At this many poses of each part and side, drawn from the range of the reach, at any angle in it.
    Anywhere(usize),
}

/// Which touches of a scene's parts a dataset holds. MAZE boards are always touched in pairs all over them.
#[derive(Clone, Copy, Debug)]
pub struct Sampling<'a> {
    /// The sides of each part of a kit.
    pub sides: &'a [Side],
    /// The places on each side.
    pub places: Places,
    /// Draws boards, places, jitter and noise.
    pub seed: u64,
    /// What the recording gets wrong; `None`: nothing.
    pub lab: Option<Lab>,
}

/// The most touches of one dataset: each draws from a stream of random numbers of its own.
const MOST_TOUCHES: usize = 1 << 32;

/// The number of touches of a scene's dataset, `usize::MAX` at most. Fails where there is none.
fn n_touches(scene: &Scene, sides: &[Side], places: Places) -> Result<usize> {
    let n = match (&scene.parts, scene.reach, places) {
        (Parts::Maze(boards), ..) => boards.n_pairs.saturating_mul(2),
        (_, Some(reach), Places::EachPose) => scene.part_names().len() * sides.len() * reach.len(),
        (_, Some(_), Places::Anywhere(n)) => (scene.part_names().len() * sides.len()).saturating_mul(n),
        (_, None, _) => return Err(Error::invalid("reach", "a grid of poses for each part", "none")),
    };
    if n == 0 {
        return Err(Error::invalid("--sides, --anywhere", "a side and a place to touch", "none"));
    }
    Ok(n)
}

/// The touches of a scene's dataset, in order: pairs all over MAZE boards, or `sides` of each part of a kit
/// at `places`. Fails where there is none, or more than 2^32.
pub fn plan(scene: &Scene, sides: &[Side], places: Places, seed: u64) -> Result<Vec<Planned>> {
    let n = n_touches(scene, sides, places)?;
    if n > MOST_TOUCHES {
        let expected = format!("at most {MOST_TOUCHES} touches");
        return Err(Error::invalid("--pairs, --anywhere", expected, n.to_string()));
    }
    let reach = match (&scene.parts, scene.reach) {
        (Parts::Maze(boards), _) => return Ok(pairs(scene, boards, seed)),
        (_, Some(reach)) => reach,
        (_, None) => return Err(Error::invalid("reach", "a grid of poses for each part", "none")),
    };
    let n_poses = match places {
        Places::EachPose => reach.len(),
        Places::Anywhere(n) => n,
    };
    let pose = |part: usize, side: Side, i: usize| match places {
        Places::EachPose => reach.pose(i),
        Places::Anywhere(_) => {
            let stream = ((2 * part + usize::from(side == Side::Peg)) << 32) + i;
            reach.draw(&mut frame_rng(seed ^ 0x61_6e_79, stream as u64))
        }
    };
    let mut planned = Vec::new();
    for part in 0..scene.part_names().len() {
        for side in sides {
            let touch = |at: Se2| Planned { part, side: *side, part_from_sensor: at, stated: at };
            planned.extend((0..n_poses).map(|i| touch(pose(part, *side, i))));
        }
    }
    Ok(planned)
}

/// What rendering a scene's dataset, or one shard of it, takes; nothing is rendered yet.
///
/// # Errors
/// A scene without touches, and a disk or a memory that does not have the room.
pub fn needs(scene: &Scene, sampling: &Sampling, shard: Option<Shard>, out: &Path) -> Result<Needs> {
    let n_planned = n_touches(scene, sampling.sides, sampling.places)?;
    let n_touches = shard.map_or(n_planned, |shard| shard.range(n_planned).len());
    // What is there already is either whole or refused.
    if std::fs::symlink_metadata(out).is_err() {
        output::check_room(out, n_touches, scene.sensor.frame_px)?;
    }
    let (n_all, n_sides) = match &scene.parts {
        Parts::Maze(boards) => (boards.n_boards, 2),
        Parts::Kit(_) => (scene.part_names().len(), sampling.sides.len()),
    };
    // Touches are planned part by part: those of a share of them are of as large a share of the parts.
    let n_parts = (n_all as f64 * n_touches as f64 / n_planned as f64).ceil() as usize;
    let mut needs = Needs::of(scene.half_extent_mm(), n_parts, n_sides, n_touches);
    needs.memory_bytes += n_planned as f64 * size_of::<Planned>() as f64;
    needs.check()?;
    Ok(needs)
}

/// Renders a scene into a dataset folder and returns the number of frames. The same seed writes the same bytes,
/// for any number of threads.
///
/// # Errors
/// A scene without touches, a disk or a memory without the room, or a name in use.
pub fn generate(scene: &Scene, sampling: &Sampling, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<usize> {
    needs(scene, sampling, None, out)?;
    let job = Job::new(scene, sampling)?;
    job.write(0..job.planned.len(), None, out, progress)
}

/// What [`generate_shard`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Made {
    /// It rendered this many frames.
    Written(usize),
    /// The shard was there already, whole and of this very job, with this many frames.
    Found(usize),
}

/// Renders the part of [`generate`]'s dataset that is one shard's, as a dataset of its own that states which part it
/// is; [`merge`](crate::dataset::dataset_merge::merge) joins all of them. A frame has the bytes that it has in the whole.
/// A complete shard that is at `out` already is left as it is; anything else there is an error.
pub fn generate_shard(
    scene: &Scene,
    sampling: &Sampling,
    shard: Shard,
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<Made> {
    let n_planned = n_touches(scene, sampling.sides, sampling.places)?;
    if shard.count() > n_planned {
        let expected = format!("at most {n_planned} shards, one for each touch");
        return Err(Error::invalid("shard", expected, shard.to_string()));
    }
    if sampling.lab.is_some() {
        return Err(Error::invalid("shard", "touches without a simulated lab's errors", "a lab"));
    }
    let is_there = std::fs::symlink_metadata(out).is_ok();
    needs(scene, sampling, Some(shard), out)?;
    let job = Job::new(scene, sampling)?;
    let fragment = Fragment { shard, n_planned, plan_sha256: fingerprint(&job.planned) };
    if is_there {
        let found = Dataset::open(out)?;
        if found.meta() == &job.meta && found.fragment() == Some(&fragment) {
            return Ok(Made::Found(found.len()));
        }
        let expected = format!("shard {shard} of this scene, plan and seed, or a name not in use");
        return Err(Error::invalid(out.display().to_string(), expected, "another dataset"));
    }
    job.write(shard.range(n_planned), Some(fragment), out, progress).map(Made::Written)
}

/// All that is to be rendered; a run writes a range of it.
struct Job {
    simulator: Simulator,
    planned: Vec<Planned>,
    seed: u64,
    meta: Meta,
}

impl Job {
    fn new(scene: &Scene, sampling: &Sampling) -> Result<Self> {
        let Sampling { sides, places, seed, lab } = *sampling;
        let simulator = Simulator::new(scene.clone(), seed)?;
        let mut planned = plan(scene, sides, places, seed)?;
        if let Some(lab) = lab {
            lab.validate()?;
            planned = lab.record(planned, seed);
        }
        let held_out = match &scene.parts {
            Parts::Maze(boards) if lab.is_none() => scene.part_names().split_off(boards.n_boards - boards.n_held_out),
            _ => Vec::new(),
        };
        let description = serde_json::to_value(scene).map_err(|e| Error::invalid("scene", "JSON", e.to_string()))?;
        let meta = Meta {
            name: scene.name.clone(),
            frame_px: scene.sensor.frame_px,
            mm_per_px: scene.sensor.mm_per_px(),
            // Nobody tells a lab which grid it touched, or what it holds out.
            reach: scene.reach.filter(|_| lab.is_none()),
            held_out,
            scene: Some(description).filter(|_| lab.is_none()),
            seed: Some(seed),
            source: if lab.is_none() { "simulated".into() } else { "a simulated lab".into() },
            recording: None,
            lamps: scene.sensor.known_lamps().filter(|_| lab.is_none()),
            peg_from_hole: None,
        };
        Ok(Self { simulator, planned, seed, meta })
    }

    /// Writes a range of the touches and returns how many they are.
    fn write(
        &self,
        range: Range<usize>,
        fragment: Option<Fragment>,
        out: &Path,
        progress: &dyn Fn(usize, usize),
    ) -> Result<usize> {
        let n_frames = range.len();
        let writer = DatasetWriter::create(out, self.meta.clone(), &self.simulator.no_contact(self.seed))?;
        let mut writer = writer.fragment(fragment).expecting(n_frames);
        // A chunk is written while the next one is rendered.
        let (mut rendered, mut previous): (Vec<Frame>, &[Planned]) = (Vec::new(), &[]);
        for (chunk, touches) in self.planned[range.clone()].chunks(CHUNK).enumerate() {
            progress(chunk * CHUNK, n_frames);
            let first = range.start + chunk * CHUNK;
            let (frames, written) = rayon::join(
                || render(&self.simulator, self.seed, first, touches),
                || self.push(&mut writer, &rendered, previous),
            );
            written?;
            (rendered, previous) = (frames?, touches);
        }
        self.push(&mut writer, &rendered, previous)?;
        progress(n_frames, n_frames);
        writer.finish()?;
        Ok(n_frames)
    }

    fn push(&self, writer: &mut DatasetWriter, frames: &[Frame], touches: &[Planned]) -> Result<()> {
        frames.iter().zip(touches).try_for_each(|(frame, touch)| {
            let touch = Touch {
                part: Some(self.simulator.parts()[touch.part].clone()),
                side: Some(touch.side),
                part_from_sensor: Some(touch.stated),
                ..Touch::default()
            };
            writer.push(frame, &touch)
        })
    }
}

/// SHA-256 of a plan, 64 hex digits: what is touched, where, in which order.
fn fingerprint(planned: &[Planned]) -> String {
    let mut hash = Sha256::new();
    for Planned { part, side, part_from_sensor: Se2 { x_mm, y_mm, theta_rad }, .. } in planned {
        hash.update((*part as u64).to_le_bytes());
        hash.update([u8::from(*side == Side::Peg)]);
        [x_mm, y_mm, theta_rad].into_iter().for_each(|number| hash.update(number.to_le_bytes()));
    }
    format!("{:x}", hash.finalize())
}

/// The frames of some touches of a plan, from number `first` on, in parallel. A frame draws from the
/// stream of its number, so that it has the same bytes whichever others are rendered with it.
pub fn render(simulator: &Simulator, seed: u64, first: usize, touches: &[Planned]) -> Result<Vec<Frame>> {
    prepare(simulator, touches)?;
    let frame = |(i, touch): (usize, &Planned)| {
        // Streams from 1 000 on: the first ones belong to the sensor at rest.
        let mut rng = frame_rng(seed, 1_000 + (first + i) as u64);
        simulator.touch(touch.part, touch.side, &touch.part_from_sensor, &mut rng)
    };
    touches.par_iter().enumerate().map(frame).collect()
}

/// Computes the sides that some touches need, one a thread: touches that need one and the same would wait
/// for it.
pub fn prepare(simulator: &Simulator, touches: &[Planned]) -> Result<()> {
    let sides: BTreeSet<(usize, bool)> = touches.iter().map(|touch| (touch.part, touch.side == Side::Peg)).collect();
    let sides: Vec<_> = sides.into_iter().collect();
    let side = |is_peg| if is_peg { Side::Peg } else { Side::Hole };
    sides.par_iter().try_for_each(|(part, is_peg)| simulator.prepare(*part, side(*is_peg)))
}

/// Pairs all over the boards, board by board, at any angle.
fn pairs(scene: &Scene, boards: &MazeBoards, seed: u64) -> Vec<Planned> {
    let half = 0.5 * (boards.spec.side_mm - boards.widest_view_mm(&scene.sensor));
    (0..boards.n_pairs)
        .flat_map(|pair| {
            let mut rng = frame_rng(seed ^ 0x70_6f_73_65, pair as u64);
            let mut around = |half| around_zero(&mut rng, half);
            let part_from_sensor = Se2::new(around(half), around(half), around(std::f64::consts::PI));
            let part = pair * boards.n_boards / boards.n_pairs;
            [Side::Hole, Side::Peg].map(|side| Planned { part, side, part_from_sensor, stated: part_from_sensor })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small_maze() -> Scene {
        let mut scene = Scene::preset("maze").unwrap();
        if let Parts::Maze(boards) = &mut scene.parts {
            (boards.n_boards, boards.n_held_out, boards.n_pairs) = (3, 1, 9);
        }
        scene.sensor.frame_px = [40, 30];
        scene
    }

    fn boards(seed: u64) -> Sampling<'static> {
        Sampling { sides: &[], places: Places::EachPose, seed, lab: None }
    }

    #[test]
    fn a_dataset_that_no_disk_holds_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = small_maze();
        let mut refusal = |n_pairs| {
            if let Parts::Maze(boards) = &mut scene.parts {
                boards.n_pairs = n_pairs;
            }
            let error = generate(&scene, &boards(1), &folder.path().join("maze"), &|_, _| ()).unwrap_err().to_string();
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
            error
        };
        assert!(refusal(usize::MAX).contains("room for 18446744073709551615 frames of 3.6 kB"));
        assert!(refusal(1 << 31).contains("room for 4294967296 frames of 3.6 kB, 16.0 TB in all"));
    }

    #[test]
    fn a_maze_gives_pairs_at_one_pose_and_holds_out_its_last_boards() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("maze");
        assert_eq!(generate(&small_maze(), &boards(4), &out, &|_, _| ()).unwrap(), 18);
        let dataset = Dataset::open(&out).unwrap();
        assert_eq!(dataset.meta().held_out, ["maze-002"]);
        for pair in 0..9 {
            let (hole, peg) = (dataset.touch(2 * pair), dataset.touch(2 * pair + 1));
            assert_eq!((hole.side, peg.side), (Some(Side::Hole), Some(Side::Peg)));
            assert!(hole.part == peg.part && hole.part_from_sensor == peg.part_from_sensor);
        }
    }

    #[test]
    fn places_drawn_lie_in_the_reach_and_differ_from_side_to_side() {
        let scene = Scene::preset("alphabet-small").unwrap();
        let touches = plan(&scene, &[Side::Hole, Side::Peg], Places::Anywhere(20), 3).unwrap();
        assert_eq!(touches.len(), 12 * 2 * 20);
        let pose = |i: usize| touches[i].part_from_sensor;
        assert!((0..480).all(|i| pose(i).x_mm.abs() <= 8.0 && pose(i).theta_deg().abs() <= 90.0));
        assert!((0..480).all(|i| (0..i).all(|j| pose(i) != pose(j))));
    }

    #[test]
    fn the_same_seed_writes_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, seed| {
            let out = folder.path().join(name);
            generate(&small_maze(), &boards(seed), &out, &|_, _| ()).unwrap();
            std::fs::read(out.join("frames.npy")).unwrap()
        };
        assert_eq!(write("a", 4), write("b", 4));
        assert_ne!(write("c", 4), write("d", 5));
    }
}

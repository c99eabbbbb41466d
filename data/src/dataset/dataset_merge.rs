//! The shards of a dataset, joined into one.

use std::path::{Path, PathBuf};

use crate::dataset::shard::{Fragment, Shard};
use crate::dataset::store::{self, Dataset, DatasetWriter, Meta};
use crate::error::{Error, Result};
use crate::file::output;
use crate::frame::Frame;

/// Missing shards named in an error before it says only how many there are.
const MAX_NAMES: usize = 8;

/// Joins the shards of one dataset, given in any order, into `out`, and returns the number of frames. The files have
/// the bytes that a single run would have written. One shard is open at a time, its frames on disk.
///
/// Fails where a shard is missing, given twice, damaged, or of another job: another scene, seed, plan, number of
/// shards or sensor at rest. Nothing then takes the name `out`.
pub fn merge(shards: &[PathBuf], out: &Path, progress: &dyn Fn(usize, usize)) -> Result<usize> {
    let heads = shards.iter().map(|path| Head::read(path)).collect::<Result<Vec<_>>>()?;
    let heads = complete(heads)?;
    let Some(first) = heads.first() else {
        return Err(Error::invalid("shards", "the shards of a dataset", "none"));
    };
    let n_planned = first.fragment.n_planned;
    output::check_room(out, n_planned, first.meta.frame_px)?;
    // Poses come out of the shards as they were moved already.
    let meta = Meta { peg_from_hole: None, ..first.meta.clone() };
    let mut writer = DatasetWriter::create(out, meta, &first.no_contact)?.expecting(n_planned);
    let mut n_frames = 0;
    for head in &heads {
        let shard = Dataset::open(head.path)?;
        for i in 0..shard.len() {
            writer.push(&shard.frame(i), shard.touch(i))?;
        }
        n_frames += shard.len();
        progress(n_frames, n_planned);
    }
    writer.finish()?;
    Ok(n_frames)
}

/// What can be said of a shard without a look at its frames.
struct Head<'a> {
    path: &'a Path,
    fragment: Fragment,
    meta: Meta,
    no_contact: Frame,
}

impl<'a> Head<'a> {
    fn read(path: &'a Path) -> Result<Self> {
        let content = store::read_meta(path)?;
        let no_contact = store::read_no_contact(path, &content.meta)?;
        let what = path.display().to_string();
        let Some(fragment) = content.fragment else {
            return Err(Error::invalid(what, "a shard of a dataset", "a whole dataset"));
        };
        let n_frames = fragment.shard.range(fragment.n_planned).len();
        if content.n_frames != n_frames {
            let expected = format!("{n_frames} frames in shard {}", fragment.shard);
            return Err(Error::invalid(what, expected, content.n_frames.to_string()));
        }
        Ok(Self { path, fragment, meta: content.meta, no_contact })
    }

    /// The first thing in which this shard's job differs from the job of `other`: what, here and there.
    fn differs(&self, other: &Self) -> Option<(&'static str, String, String)> {
        let (a, b) = (&self.meta, &other.meta);
        let seed = |meta: &Meta| meta.seed.map_or("none".into(), |seed| seed.to_string());
        let another = |what| (what, "another".to_owned(), "the same".to_owned());
        if a.name != b.name {
            return Some(("scene", a.name.clone(), b.name.clone()));
        }
        if a.seed != b.seed {
            return Some(("seed", seed(a), seed(b)));
        }
        if self.fragment.n_planned != other.fragment.n_planned {
            let [here, there] = [self, other].map(|head| head.fragment.n_planned.to_string());
            return Some(("number of touches", here, there));
        }
        if self.fragment.shard.count() != other.fragment.shard.count() {
            let [here, there] = [self, other].map(|head| head.fragment.shard.count().to_string());
            return Some(("number of shards", here, there));
        }
        if a != b {
            return Some(another("scene"));
        }
        if self.fragment.plan_sha256 != other.fragment.plan_sha256 {
            return Some(another("plan"));
        }
        (self.no_contact != other.no_contact).then(|| another("frame at rest"))
    }
}

/// The shards in order: none is missing, given twice or of another job.
fn complete(mut heads: Vec<Head<'_>>) -> Result<Vec<Head<'_>>> {
    for head in heads.iter().skip(1) {
        if let Some((what, here, there)) = head.differs(&heads[0]) {
            let place = format!("{}: {what}", head.path.display());
            return Err(Error::invalid(place, format!("{there} as in {}", heads[0].path.display()), here));
        }
    }
    // Stable: of two equal ones the one given first stays first.
    heads.sort_by_key(|head| head.fragment.shard.index());
    for pair in heads.windows(2) {
        if pair[0].fragment.shard == pair[1].fragment.shard {
            let (shard, before) = (pair[0].fragment.shard, pair[0].path.display());
            let got = format!("shard {shard} a second time, after {before}");
            return Err(Error::invalid(pair[1].path.display().to_string(), "each shard once", got));
        }
    }
    let Some(count) = heads.first().map(|head| head.fragment.shard.count()) else {
        return Ok(heads);
    };
    let is_there =
        |shard: &Shard| heads.binary_search_by_key(&shard.index(), |head| head.fragment.shard.index()).is_ok();
    let missing: Vec<_> = Shard::all(count).filter(|shard| !is_there(shard)).map(|shard| shard.to_string()).collect();
    if missing.is_empty() {
        return Ok(heads);
    }
    let rest = missing.len().saturating_sub(MAX_NAMES);
    let rest = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    let named = missing[..missing.len().min(MAX_NAMES)].join(", ");
    Err(Error::invalid("shards", format!("all {count}"), format!("{} without {named}{rest}", heads.len())))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::dataset::generate::{Made, Places, Sampling, generate, generate_shard};
    use crate::dataset::touch::Side;
    use crate::scene::{Parts, Scene};
    use crate::sensor::Fidelity;

    /// 140 pairs: more than two chunks of rendering, so that shards begin within one.
    fn maze(fidelity: Fidelity) -> Scene {
        let mut scene = Scene::preset("maze").unwrap();
        if let Parts::Maze(boards) = &mut scene.parts {
            (boards.n_boards, boards.n_held_out, boards.n_pairs) = (2, 1, 140);
        }
        scene.sensor.frame_px = [16, 12];
        scene.fidelity = fidelity;
        scene
    }

    fn letters() -> Scene {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.sensor.frame_px = [16, 12];
        scene.fidelity = Fidelity::Geometry;
        scene
    }

    /// `n` drawn places of each letter.
    fn drawn(sides: &[Side], n: usize, seed: u64) -> Sampling<'_> {
        Sampling { sides, places: Places::Anywhere(n), seed, lab: None }
    }

    /// What is written to `out`: shard `text`.
    fn write(out: &Path, text: &str, scene: &Scene, sampling: &Sampling) -> Result<Made> {
        generate_shard(scene, sampling, text.parse().unwrap(), out, &|_, _| ())
    }

    fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
        let mut files: Vec<_> =
            entries.map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())).collect();
        files.sort();
        files
    }

    #[test]
    fn shards_joined_in_any_order_are_the_bytes_of_a_single_run() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let scene = maze(Fidelity::Camera);
        let sampling = Sampling { sides: &[], places: Places::EachPose, seed: 4, lab: None };
        generate(&scene, &sampling, &at("single"), &|_, _| ()).unwrap();
        let shards = ["3/3", "1/3", "2/3"].map(|text| {
            let out = at(&text.replace('/', "-of-"));
            let made = generate_shard(&scene, &sampling, text.parse().unwrap(), &out, &|_, _| ());
            let n_frames = Dataset::open(&out).unwrap().len();
            assert_eq!(made.unwrap(), Made::Written(n_frames));
            out
        });
        assert_eq!(merge(&shards, &at("merged"), &|_, _| ()).unwrap(), 280);
        assert_eq!(contents(&at("merged")), contents(&at("single")));
        assert_eq!(Dataset::open(&at("merged")).unwrap().fragment(), None);
    }

    #[test]
    fn a_shard_says_which_it_is_and_a_whole_one_is_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("two");
        let made = || write(&out, "2/5", &letters(), &drawn(&[Side::Peg], 3, 1));
        assert_eq!(made().unwrap(), Made::Written(7));
        let json: serde_json::Value = serde_json::from_slice(&fs::read(out.join("meta.json")).unwrap()).unwrap();
        assert_eq!((&json["fragment"]["shard"], &json["fragment"]["n_planned"]), (&"2/5".into(), &36.into()));
        let before = contents(&out);
        assert_eq!(made().unwrap(), Made::Found(7));
        assert_eq!(contents(&out), before);
        for (text, seed) in [("1/5", 1), ("2/5", 2)] {
            let message = write(&out, text, &letters(), &drawn(&[Side::Peg], 3, seed)).unwrap_err().to_string();
            assert!(message.contains(&format!("two: expected shard {text} of this scene")), "{message}");
        }
        fs::write(out.join("frames.npy"), [0; 200]).unwrap();
        assert!(made().unwrap_err().to_string().contains("frames.npy"));
    }

    #[test]
    fn a_shard_cut_off_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("one");
        fs::create_dir(folder.path().join("one.partial")).unwrap();
        fs::write(folder.path().join("one.partial/frames.npy"), "half").unwrap();
        assert_eq!(write(&out, "1/1", &letters(), &drawn(&[Side::Peg], 1, 1)).unwrap(), Made::Written(12));
        assert!(!folder.path().join("one.partial").exists());
    }

    #[test]
    fn more_shards_than_touches_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let message =
            write(&folder.path().join("a"), "1/13", &letters(), &drawn(&[Side::Peg], 1, 1)).unwrap_err().to_string();
        assert_eq!(message, "shard: expected at most 12 shards, one for each touch, got 1/13");
    }

    #[test]
    fn missing_double_foreign_and_damaged_shards_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let pegs: &[Side] = &[Side::Peg];
        let mut small = letters();
        small.sensor.frame_px = [12, 12];
        write(&at("a"), "1/4", &letters(), &drawn(pegs, 2, 1)).unwrap();
        write(&at("b"), "2/4", &letters(), &drawn(pegs, 2, 1)).unwrap();
        write(&at("b-again"), "2/4", &letters(), &drawn(pegs, 2, 1)).unwrap();
        write(&at("c"), "3/4", &letters(), &drawn(pegs, 2, 1)).unwrap();
        write(&at("seed"), "4/4", &letters(), &drawn(pegs, 2, 2)).unwrap();
        write(&at("count"), "4/5", &letters(), &drawn(pegs, 2, 1)).unwrap();
        write(&at("length"), "4/4", &letters(), &drawn(pegs, 3, 1)).unwrap();
        write(&at("sides"), "4/4", &letters(), &drawn(&[Side::Hole], 2, 1)).unwrap();
        write(&at("size"), "4/4", &small, &drawn(pegs, 2, 1)).unwrap();
        let sampling = Sampling { sides: pegs, places: Places::Anywhere(2), seed: 1, lab: None };
        generate(&letters(), &sampling, &at("whole"), &|_, _| ()).unwrap();
        write(&at("cut"), "4/4", &letters(), &drawn(pegs, 2, 1)).unwrap();
        let frames = fs::read(at("cut/frames.npy")).unwrap();
        fs::write(at("cut/frames.npy"), &frames[..frames.len() - 1]).unwrap();

        let refused = |names: &[&str]| {
            let paths: Vec<_> = names.iter().map(|name| at(name)).collect();
            let message = merge(&paths, &at("out"), &|_, _| ()).unwrap_err().to_string();
            assert!(!message.contains('\n') && !at("out").exists(), "{message}");
            message.replace(&format!("{}/", folder.path().display()), "")
        };
        assert_eq!(refused(&["c", "b"]), "shards: expected all 4, got 2 without 1/4, 4/4");
        assert_eq!(refused(&[]), "shards: expected the shards of a dataset, got none");
        assert_eq!(
            refused(&["b", "a", "b-again", "c"]),
            "b-again: expected each shard once, got shard 2/4 a second time, after b"
        );
        assert_eq!(refused(&["a", "b", "c", "seed"]), "seed: seed: expected 1 as in a, got 2");
        assert_eq!(refused(&["a", "count"]), "count: number of shards: expected 4 as in a, got 5");
        assert_eq!(refused(&["a", "length"]), "length: number of touches: expected 24 as in a, got 36");
        assert_eq!(refused(&["a", "sides"]), "sides: plan: expected the same as in a, got another");
        assert_eq!(refused(&["a", "size"]), "size: scene: expected the same as in a, got another");
        assert_eq!(refused(&["a", "whole"]), "whole: expected a shard of a dataset, got a whole dataset");
        assert!(refused(&["a", "b", "c", "cut"]).starts_with("cut/frames.npy: expected"));
    }
}

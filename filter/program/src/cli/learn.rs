//! What was felt of a stranger becomes a part: `tactile-filter replay --learn`.

use std::collections::HashSet;
use std::path::{Path, PathBuf, absolute};

use tactile_data::file::output::prepare_file;
use tactile_data::frame::npy;
use tactile_data::program;
use tactile_data::scene::{PartFile, Parts, Scene};
use tactile_eval::{Error, Result};
use tactile_filter::{Episode, FeltMap};
use tactile_infer::safefile::write_whole;

/// How high a learnt peg is, mm: higher than any gel goes.
const PEG_MM: f32 = 3.0;

/// A pixel of its heights, mm: six to a cell of what was felt.
const PX_MM: f64 = 0.05;

/// Less is a corner of a part, or noise, mm².
const LEAST_MM2: f64 = 4.0;

/// The name of the scene's file.
const SCENE: &str = "scene.toml";

/// A scene, and the parts that are learnt for it.
pub struct LearntParts {
    folder: PathBuf,
    scene: Scene,
    names: HashSet<String>,
    n_learnt: usize,
}

impl LearntParts {
    /// Parts for a scene of parts of its own, into a folder that does not have any yet.
    pub fn new(folder: &Path, preset_or_file: &str) -> Result<Self> {
        let mut scene = Scene::load(preset_or_file)?;
        let names = scene.part_names().into_iter().collect();
        let Parts::Kit(kit) = &mut scene.parts else {
            return Err(Error::invalid("--scene", "a scene of parts", "one of MAZE boards"));
        };
        for file in &mut kit.files {
            for path in std::iter::once(&mut file.peg).chain(&mut file.hole) {
                *path = absolute(&*path)
                    .map_err(|error| Error::invalid(path.display().to_string(), "a path", error.to_string()))?;
            }
        }
        if folder.join(SCENE).exists() {
            return Err(Error::invalid(folder.display().to_string(), "a new folder", "learnt parts"));
        }
        Ok(Self { folder: folder.to_owned(), scene, names, n_learnt: 0 })
    }

    /// Adds what an episode felt; says so, or why not. It is in the middle, as its first touch was turned: where the nearest part would be
    /// may be far off.
    pub fn add(&mut self, number: usize, felt: &FeltMap, episode: &Episode) -> Result<()> {
        let mosaic = felt.mosaic();
        let (n, inside) = mosaic.inside_every(PX_MM, episode.estimate().part_from_first.theta_rad);
        let area = inside.iter().filter(|is| **is).count() as f64 * PX_MM * PX_MM;
        if area < LEAST_MM2 {
            program::warning(format_args!("episode {number}: not learnt: {area:.0} mm2 are inside of what was felt"));
            return Ok(());
        }
        let mut named = (self.n_learnt + 1..).map(|n| format!("learnt-{n}"));
        let Some(name) = named.find(|name| !self.names.contains(name)) else { return Ok(()) };
        let path = self.folder.join(format!("{name}.npy"));
        let _lock = prepare_file(&path, std::iter::empty::<&Path>())?;
        let heights: Vec<f32> = inside.iter().map(|is| if *is { PEG_MM } else { 0.0 }).collect();
        npy::write(&path, &[n, n], &heights)?;
        if let Parts::Kit(kit) = &mut self.scene.parts {
            kit.files.push(PartFile {
                name: name.clone(),
                peg: PathBuf::from(format!("{name}.npy")),
                hole: None,
                mm_per_px: Some([PX_MM; 2]),
                mm_per_level: None,
                full_scale_mm: None,
            });
        }
        program::say(format_args!("episode {number}: {name}, {area:.0} mm2"));
        if mosaic.is_cut() {
            program::warning(format_args!("{name}: its outline leaves what was felt; touch more of it"));
        }
        self.names.insert(name);
        self.n_learnt += 1;
        Ok(())
    }

    /// Writes the scene, where any part was learnt.
    pub fn finish(&self) -> Result<()> {
        if self.n_learnt == 0 {
            program::say(format_args!("no part learnt: no episode ended as none of these"));
            return Ok(());
        }
        let path = self.folder.join(SCENE);
        let _lock = prepare_file(&path, std::iter::empty::<&Path>())?;
        write_whole(&path, self.scene.to_toml()?.as_bytes())?;
        program::say(format_args!("{}: {} more parts; make a bank of it", path.display(), self.n_learnt));
        Ok(())
    }
}

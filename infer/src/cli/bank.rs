//! `tactile-infer bank`.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use tactile_data::dataset::needs::Needs;
use tactile_data::dataset::store::{Dataset, FILES};
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::file::output_lock::with_ending;
use tactile_data::light::calibrate::Calibration;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::symmetry::Symmetry;
use tactile_data::program::progress::reporter;
use tactile_data::program::{self, named};
use tactile_data::scene::Scene;
use tactile_infer::bank::between::is_fine;
use tactile_infer::bank::learn_from::LearnFrom;
use tactile_infer::bank::matches::PartMatch;
use tactile_infer::bank::metric::by_cosine;
use tactile_infer::bank::recorded::mosaics::with_maps_of_dataset;
use tactile_infer::bank::recorded::parts_on_grid;
use tactile_infer::bank::simulated::SceneBank;
use tactile_infer::bank::simulated::density::{ALLOWED, Lost};
use tactile_infer::bank::simulated::mosaics::with_maps_of_scene;
use tactile_infer::maps::Maps;
use tactile_infer::maps::mosaic::CELL_MM;
use tactile_infer::{Bank, Error, Model, Precision, Result, Views};

use super::{ModelArgs, PosesArgs, embed_pegs};

/// What a bank is made of, and where it goes.
#[derive(Args)]
pub struct BankArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Dataset of pegs touched on a grid of poses, simulated or recorded; what was not recorded is unknown
    #[arg(long, value_name = "DIR", required_unless_present = "scene", conflicts_with = "scene")]
    data: Option<PathBuf>,
    /// Simulate the touches of a scene instead, and keep no dataset of them
    #[arg(long, value_name = "PRESET|FILE.toml", conflicts_with = "tolerance")]
    scene: Option<String>,
    /// With --scene: simulate your sensor, as `tactile-data calibrate` measured it, instead of the scene's
    #[arg(long, value_name = "FILE.toml", requires = "scene", conflicts_with = "data")]
    calibration: Option<PathBuf>,
    /// With --scene: views of pegs alone, as a robot records them, or of both sides, with the holes that the scene says
    /// [default: both]
    #[arg(long, value_name = "VIEWS", requires = "scene", conflicts_with = "data", value_parser = named::<Views>(Views::NAMES))]
    views: Option<Views>,
    /// With --scene: the side that will be touched; touches of it are simulated to learn in which directions embeddings differ
    /// by chance; from nothing they are compared by the cosine alone, as in the paper [default: hole]
    #[arg(long, value_name = "SIDE", requires = "scene", conflicts_with = "data", value_parser = named::<LearnFrom>(LearnFrom::NAMES))]
    learn_from: Option<LearnFrom>,
    /// A map of each part, too, stitched from touches of its peg as this network draws them (`tactile-train --maps`): by it
    /// touches are verified
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    /// The bank file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// A part feels the same after N turns, or is round; else its geometry tells, or of recorded touches their likeness
    #[arg(long = "symmetry", value_name = "PART=N|round", value_delimiter = ',')]
    symmetries: Vec<Declared>,
    /// Format of the bank's rows, on disk and in memory: 4, 2, 2 or 1 byte a value
    #[arg(long, value_name = "FORMAT", default_value_t = Precision::I8, value_parser = named::<Precision>(Precision::ROWS))]
    rows: Precision,
    #[command(flatten)]
    poses: PosesArgs,
    /// With --scene: steps as fine as the parts ask for, 2 or 1 mm and 15 or 7.5 degrees: what is lost between poses is
    /// measured first
    #[arg(
        long, requires = "scene", conflicts_with_all = ["data", "xy_step_mm", "theta_step_deg"], help_heading = "Poses"
    )]
    auto_steps: bool,
    /// With --scene: draws jitter and noise
    #[arg(long, default_value_t = 1, requires = "scene", conflicts_with = "data", help_heading = "Poses")]
    seed: u64,
}

/// A symmetry that the user declares.
#[derive(Clone, Debug)]
struct Declared {
    part: String,
    /// `None`: round.
    order: Option<usize>,
}

impl FromStr for Declared {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (part, order) = text.rsplit_once('=').ok_or("expected PART=N or PART=round, as in --symmetry gear=12")?;
        let order = match order {
            "round" => None,
            number => match number.parse() {
                Ok(turns) if (1..=Symmetry::MAX_ORDER).contains(&turns) => Some(turns),
                _ => return Err(format!("expected 1 to {} turns or round, got {number}", Symmetry::MAX_ORDER)),
            },
        };
        Ok(Self { part: part.into(), order })
    }
}

impl BankArgs {
    pub fn run(&self) -> Result<()> {
        let data_files = self.data.iter().flat_map(|data| FILES.map(|file| data.join(file)));
        let scene_file = self.scene.as_ref().map(|scene| PathBuf::from(Scene::file_of(scene)));
        let read = scene_file.into_iter().chain(self.calibration.clone()).chain(self.maps.clone());
        let read = read.chain([self.model.path.clone()]);
        let _lock = output::prepare_file(&self.out, data_files.chain(read))?;
        let model = self.model.load()?;
        let maps = self.maps.as_deref().map(Maps::load).transpose()?;
        let declare = |bank: Bank, declared: &Declared| bank.with_declared(&declared.part, declared.order);
        let finish = |bank: Bank| -> Result<()> {
            let bank = self.symmetries.iter().try_fold(bank.with_precision(self.rows)?, declare)?;
            bank.save(&self.out)?;
            print_bank(&self.out, &bank);
            Ok(())
        };
        let Some(data) = &self.data else {
            let scene = self.touched_scene(&model)?;
            let job = self.job(&model, &scene);
            let kept = with_ending(&self.out, ".parts");
            let bank = job.make(Some(&kept), &reporter("touches"))?;
            finish(match &maps {
                Some(maps) => with_maps_of_scene(bank, maps, (&scene, job.views), self.seed, &reporter("touches"))?,
                None => bank,
            })?;
            return job.forget(&kept);
        };
        let dataset = Dataset::open(data)?;
        check_declared(&self.symmetries, &parts_on_grid(&dataset, self.poses.poses()?)?)?;
        let bank = embed_pegs(&model, &dataset, &self.poses)?;
        finish(match &maps {
            Some(maps) => with_maps_of_dataset(bank, maps, &dataset, &reporter("touches"))?,
            None => bank,
        })
    }

    fn job<'a>(&self, model: &'a Model, scene: &'a Scene) -> SceneBank<'a> {
        let (views, learn_from) = (self.views.unwrap_or(Views::Both), self.learn_from.unwrap_or_default());
        SceneBank { model, scene, views, learn_from, seed: self.seed }
    }

    /// The scene whose parts are touched, at the poses that were asked for; what is lost between them is said.
    fn touched_scene(&self, model: &Model) -> Result<Scene> {
        let mut scene = Scene::load(self.scene.as_deref().unwrap_or_default())?;
        if let Some(path) = &self.calibration {
            scene = scene.under(&Calibration::load(path)?)?;
        }
        if let Some(reach) = &mut scene.reach {
            reach.xy_step_mm = self.poses.xy_step_mm.unwrap_or(reach.xy_step_mm);
            reach.theta_step_deg = self.poses.theta_step_deg.unwrap_or(reach.theta_step_deg);
        }
        scene.validate()?;
        let needs = self.check_needs(model, &scene)?;
        if needs.is_much() {
            program::note(needs);
        }
        check_declared(&self.symmetries, &scene.part_names())?;
        if self.auto_steps {
            let (grid, lost) = self.job(model, &scene).asked_for()?;
            println!("{} mm and {} degrees between poses", grid.xy_step_mm, grid.theta_step_deg);
            note_lost(&scene, &grid, &lost);
            scene.reach = Some(grid);
        } else if let Some(grid) = scene.reach.filter(is_fine) {
            note_lost(&scene, &grid, &self.job(model, &scene).lost()?);
        }
        self.check_needs(model, &scene)?;
        Ok(scene)
    }

    /// What touching a scene and embedding its touches takes; refuses what this machine does not have.
    fn check_needs(&self, model: &Model, scene: &Scene) -> Result<Needs> {
        /// A planned touch, without its row.
        const TOUCH_BYTES: usize = 64;
        let n_parts = scene.part_names().len();
        let n_rows = n_parts * scene.reach.map_or(0, |reach| reach.len());
        // Holes are touched as well: for views of both, and to learn how touches differ from views.
        let mut needs =
            Needs::of(scene.half_extent_mm(), n_parts, 2, n_rows * if self.views == Some(Views::Pegs) { 1 } else { 2 });
        let n_bytes = n_rows as f64 * (4 * model.dim() + TOUCH_BYTES) as f64;
        needs.memory_bytes += n_bytes;
        output::check_memory("--xy-step-mm and --theta-step-deg", format!("{n_rows} touches"), n_bytes)?;
        needs.check()?;
        Ok(needs)
    }
}

/// Parts whose holes match their own views by less than this are worth a word: letters do by 0.9, a stranger by 0.8.
const LOW_MATCH: f32 = 0.8;

/// Says how many parts change fast between the poses of a grid, and which the most.
fn note_lost(scene: &Scene, grid: &PoseGrid, lost: &[Option<Lost>]) {
    let fast =
        |(part, lost): (usize, &Option<Lost>)| lost.filter(|lost| !lost.is_little()).map(|lost| (part, lost.most()));
    let fast: Vec<(usize, f64)> = lost.iter().enumerate().filter_map(fast).collect();
    let Some((part, most)) = fast.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
    program::note(format_args!(
        "views of {} of {} parts change fast between poses {} mm and {} degrees apart, {} the most: a cosine of \
         {most:.3} is lost half way ({ALLOWED} is little, and what --auto-steps looks for)",
        fast.len(),
        lost.len(),
        grid.xy_step_mm,
        grid.theta_step_deg,
        scene.part_names()[part],
    ));
}

/// Says what a bank holds.
fn print_bank(path: &Path, bank: &Bank) {
    let (n_parts, n_poses) = (bank.parts().len(), bank.grid().len());
    program::say(format_args!(
        "{}: {n_parts} parts x {n_poses} poses = {} rows of {} {}, {:.1} MB in memory; views of {}",
        path.display(),
        bank.n_rows(),
        bank.dim(),
        bank.rows().precision(),
        bank.rows().n_bytes() as f64 / 1e6,
        if bank.views().is_pegs() { "pegs" } else { "pegs and their holes" }
    ));
    if let Some(mosaics) = bank.mosaics() {
        let [n_sides, _, n, ..] = mosaics.shape();
        let what = if n_sides == 1 { "part" } else { "peg and of each hole" };
        println!("a map of each {what}, {0:.1} x {0:.1} mm", n as f64 * CELL_MM);
    }
    if let Some(metric) = bank.metric() {
        let share = metric.measured().error_scale;
        println!("learnt from its own touches: they are {share:.2} as far from their views as by the cosine alone");
    }
    let symmetric = |part: usize| {
        let name = &bank.parts()[part];
        match bank.symmetry(part).order {
            Some(1) => None,
            Some(order) => Some(format!("{name} after {:.0} degrees", 360.0 / order as f64)),
            None => Some(format!("{name} after any turn")),
        }
    };
    let symmetric: Vec<_> = (0..n_parts).filter_map(symmetric).collect();
    if !symmetric.is_empty() {
        program::say(format_args!("feels the same turned: {}", symmetric.join(", ")));
    }
    for (part, name) in bank.parts().iter().enumerate() {
        if let Some(PartMatch { matched, .. }) = bank
            .matches()
            .of(part, Side::Hole)
            .filter(|of| by_cosine(bank.metric(), of.matched.mean as f32) < LOW_MATCH)
        {
            let mean = matched.mean;
            program::note(format_args!(
                "part {name}: touches of its hole hardly match its views (cosine {mean:.2} on average); often mistaken"
            ));
        }
    }
}

/// Refuses a symmetry of a part that will not be there, before the work.
fn check_declared(declared: &[Declared], parts: &[String]) -> Result<()> {
    match declared.iter().find(|declared| !parts.contains(&declared.part)) {
        Some(odd) => {
            Err(Error::invalid("--symmetry", format!("one of the parts {}", parts.join(" ")), odd.part.clone()))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clap does not ask for `--scene` where `--data` rules it out.
    #[test]
    fn what_only_a_scene_has_is_refused_with_a_dataset() {
        let parse = |more: &[&str]| {
            let line = ["bank", "--model", "m", "--out", "b"].iter().chain(more);
            BankArgs::augment_args(clap::Command::new("bank")).try_get_matches_from(line).is_ok()
        };
        for option in [["--learn-from", "both"], ["--views", "pegs"], ["--calibration", "sensor.toml"], ["--seed", "2"]]
        {
            assert!(parse(&[&["--scene", "maze"][..], &option].concat()), "{option:?}");
            assert!(!parse(&[&["--data", "pegs"][..], &option].concat()), "{option:?}");
        }
        assert!(parse(&["--data", "pegs"]));
        // A scene's touches lie on its grid.
        assert!(parse(&["--data", "pegs", "--tolerance", "0.2,1"]));
        assert!(!parse(&["--scene", "maze", "--tolerance", "0.2,1"]));
    }

    #[test]
    fn a_symmetry_is_a_number_of_turns_or_round() {
        let order = |text: &str| text.parse::<Declared>().map(|declared| (declared.part, declared.order));
        assert_eq!(order("gear=12"), Ok(("gear".into(), Some(12))));
        assert_eq!(order("a=b=round"), Ok(("a=b".into(), None)));
        for wrong in ["gear", "gear=0", "gear=37", "gear=-1", "gear=", "gear=square"] {
            assert!(order(wrong).unwrap_err().starts_with("expected"), "{wrong}");
        }
    }
}

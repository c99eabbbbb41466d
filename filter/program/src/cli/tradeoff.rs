//! `tactile-filter tradeoff`.

use std::fs;
use std::io::IsTerminal;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Deserialize, Serialize};
use tactile_data::scene::Scene;
use tactile_data::shard::Shard;
use tactile_data::simulator::Simulator;
use tactile_eval::evaluate::{Protocol, at_rest};
use tactile_eval::page::shell::{check_page, write_page};
use tactile_eval::report::tradeoff::{self as page, in_words};
use tactile_eval::result::Poses;
use tactile_eval::sweep::{Bench, Planned, TOUCHES, measure, plan};
use tactile_eval::{Error, Result};
use tactile_filter::budget::{Point, SCHEMA, Settings, Tradeoff};
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::safefile::write_whole;
use tactile_infer::simulated::bank_of_scene;

use super::evaluate::command_line;

/// Measure how speed, memory and touches trade against accuracy; write tradeoff.json, frontier.json and a page.
///
/// Each setting is kept as soon as it is measured: the same command goes on where it was stopped.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-filter tradeoff --model infer/models/maze-small.safetensors --scene alphabet-small-dev --out tradeoff"
)]
pub struct TradeoffArgs {
    /// Checkpoints; the first is turned at every knob, the others are compared with it.
    #[arg(long = "model", required = true, value_name = "FILE")]
    models: Vec<PathBuf>,
    /// Scene preset or TOML file. What is shipped or used must be measured on parts for tuning.
    #[arg(long, default_value = "alphabet-small-dev")]
    scene: String,
    /// Folder for what is found.
    #[arg(long)]
    out: PathBuf,
    /// Episodes of each setting, shared out over the seeds.
    #[arg(long, default_value_t = 300)]
    episodes: usize,
    /// Seeds of holes, poses and frames.
    #[arg(long, value_delimiter = ',', default_value = "1,2,3")]
    seeds: Vec<u64>,
    /// Seed of the touches of pegs.
    #[arg(long, default_value_t = 1)]
    bank_seed: u64,
    /// Where holes are touched.
    #[arg(long, default_value = "off-grid", value_parser = ["on-grid", "off-grid"])]
    poses: String,
    /// Measure only this many settings, evenly chosen [default: all]
    #[arg(long)]
    settings: Option<usize>,
    /// Measure one part of the settings: I/N with I from 1, or env; the command without it puts all together.
    #[arg(long, value_name = "I/N|env")]
    shard: Option<Shard>,
    /// Print tradeoff.json instead of the findings.
    #[arg(long)]
    json: bool,
}

/// A setting as it was measured, with all that its figures depend on.
#[derive(PartialEq, Serialize, Deserialize)]
struct Measured {
    planned: Planned,
    scene: Scene,
    poses: String,
    n_episodes: usize,
    seeds: Vec<u64>,
    bank_seed: u64,
    points: Vec<Point>,
}

impl TradeoffArgs {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let models = self.models.iter().map(|path| Ok(Arc::new(Model::load(path)?))).collect::<Result<Vec<_>>>()?;
        let scene = Scene::load(&self.scene)?;
        let mut planned = plan(&models)?;
        for planned in &mut planned {
            let stem = self.models[planned.model].file_stem().unwrap_or_default();
            planned.settings.model = stem.to_string_lossy().into_owned();
        }
        if let Some(n) = self.settings.filter(|n| *n < planned.len()) {
            planned = (0..n).map(|i| planned[i * planned.len() / n].clone()).collect();
        }
        check_page(&self.out.join("tradeoff.html"))?;
        let folder = self.out.join("settings");
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let mine = self.shard.map_or(0..planned.len(), |shard| shard.range(planned.len()));
        let mut todo = Vec::new();
        for index in mine.clone() {
            if self.read(&folder, index, &planned[index], &scene)?.is_none() {
                todo.push(index);
            }
        }
        self.measure(&folder, &planned, &todo, &models, &scene)?;
        if self.shard.is_some() {
            println!("settings {mine:?} of {} in {}", planned.len(), folder.display());
            return Ok(());
        }
        let tradeoff = self.gather(&folder, &planned, &scene)?;
        self.write(&tradeoff, &models[0])
    }

    fn path(folder: &Path, index: usize) -> PathBuf {
        folder.join(format!("{index:03}.json"))
    }

    /// What is known of a setting; `None` where nothing is, or something of another sweep.
    fn read(&self, folder: &Path, index: usize, planned: &Planned, scene: &Scene) -> Result<Option<Measured>> {
        let path = Self::path(folder, index);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
        let found: Measured = serde_json::from_str(&text)
            .map_err(|e| Error::invalid(path.display().to_string(), "a measured setting", e.to_string()))?;
        let expected = self.measured(planned, scene, found.points.clone());
        Ok((found == expected).then_some(found))
    }

    fn measured(&self, planned: &Planned, scene: &Scene, points: Vec<Point>) -> Measured {
        Measured {
            planned: planned.clone(),
            scene: scene.clone(),
            poses: self.poses.clone(),
            n_episodes: self.episodes,
            seeds: self.seeds.clone(),
            bank_seed: self.bank_seed,
            points,
        }
    }

    /// Measures what is left to do, model by model and bank by bank.
    fn measure(
        &self,
        folder: &Path,
        planned: &[Planned],
        todo: &[usize],
        models: &[Arc<Model>],
        scene: &Scene,
    ) -> Result<()> {
        let Some(reach) = scene.reach else {
            return Err(Error::invalid(&self.scene, "a scene of parts with a reach", "one without"));
        };
        let bank_of = |index: usize| {
            let Settings { xy_step_mm, theta_step_deg, .. } = planned[index].settings;
            (planned[index].model, xy_step_mm.to_bits(), theta_step_deg.to_bits())
        };
        let mut todo = todo.to_vec();
        todo.sort_by_key(|index| bank_of(*index));
        let simulator = Simulator::new(scene.clone(), 1)?;
        let no_contact = at_rest(&simulator, &self.seeds);
        let protocol = self.protocol(0..self.episodes);
        let bar = bar(todo.len());
        for same_bank in todo.chunk_by(|a, b| bank_of(*a) == bank_of(*b)) {
            let Planned { model, settings } = &planned[same_bank[0]];
            let model = &models[*model];
            let mut scene = scene.clone();
            let reach = tactile_data::grid::PoseGrid {
                xy_step_mm: settings.xy_step_mm,
                theta_step_deg: settings.theta_step_deg,
                ..reach
            };
            scene.reach = Some(reach);
            bar.set_message(format!("bank of {} mm, {}°", settings.xy_step_mm, settings.theta_step_deg));
            let bank: Bank = bank_of_scene(model, &scene, self.bank_seed, &|_, _| ())?;
            protocol.validate(&simulator, &bank)?;
            for index in same_bank {
                let settings = &planned[*index].settings;
                bar.set_message(in_words(settings));
                let bench =
                    Bench { simulator: &simulator, model, bank: &bank, no_contact: &no_contact, protocol: &protocol };
                let measured = self.measured(&planned[*index], simulator.scene(), measure(&bench, settings)?);
                write_whole(&Self::path(folder, *index), json(&measured)?.as_bytes())?;
                bar.inc(1);
                if bar.is_hidden() {
                    eprintln!("{}", in_words(settings));
                }
            }
        }
        bar.finish_and_clear();
        Ok(())
    }

    fn protocol(&self, episodes: Range<usize>) -> Protocol {
        Protocol {
            n_episodes: self.episodes,
            episodes,
            seeds: self.seeds.clone(),
            poses: if self.poses == "on-grid" { Poses::OnGrid } else { Poses::OffGrid },
            absent: false,
            n_classes: None,
            choose_ms: None,
            n_touches: TOUCHES[TOUCHES.len() - 1],
        }
    }

    /// All settings' points together.
    fn gather(&self, folder: &Path, planned: &[Planned], scene: &Scene) -> Result<Tradeoff> {
        let mut points = Vec::new();
        for (index, setting) in planned.iter().enumerate() {
            let found = self.read(folder, index, setting, scene)?;
            let missing =
                || Error::invalid(folder.display().to_string(), "every setting", format!("none of {index:03}"));
            points.extend(found.ok_or_else(missing)?.points);
        }
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let mut tradeoff = Tradeoff {
            schema: SCHEMA.into(),
            scene: scene.name.clone(),
            poses: self.poses.clone(),
            n_classes: scene.part_names().len(),
            n_episodes: self.episodes,
            seeds: self.seeds.clone(),
            machine: format!("{}, {threads} threads", std::env::consts::ARCH),
            command: command_line(),
            points,
        };
        tradeoff.mark_dominated();
        Ok(tradeoff)
    }

    fn write(&self, tradeoff: &Tradeoff, model: &Model) -> Result<()> {
        let frontier = self.out.join("frontier.json");
        write_whole(&frontier, json(&tradeoff.frontier(model.sha256()))?.as_bytes())?;
        let html = self.out.join("tradeoff.html");
        write_page(&html, &page::html(tradeoff))?;
        write_whole(&self.out.join("tradeoff.json"), json(tradeoff)?.as_bytes())?;
        if self.json {
            println!("{}", json(tradeoff)?);
            return Ok(());
        }
        if let Some(verdict) = page::verdict(tradeoff) {
            let tell = |name: &str, point: &Point| {
                println!(
                    "{name}: {:.1} % after {} touches, {:.2} ms a decision (99 %: {:.2}), {:.1} MB: {}",
                    100.0 * point.accuracy,
                    point.n_touches,
                    point.decision_ms_p50,
                    point.decision_ms_p99,
                    point.memory_mb,
                    in_words(&point.settings)
                );
            };
            println!(
                "{} settings, {} points on the frontier, spanning {:.0} times in time a decision",
                verdict.n_settings, verdict.n_frontier, verdict.span
            );
            tell("most accurate", verdict.best);
            tell("fastest within 2 points of it", verdict.fast);
        }
        println!("for --frontier: {}", frontier.display());
        println!("{}", html.display());
        Ok(())
    }
}

fn json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string_pretty(value).map_err(|e| Error::invalid("trade-off", "JSON", e.to_string()))
}

/// A bar on a terminal, plain lines elsewhere.
fn bar(n: usize) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {eta} left  {msg}");
    ProgressBar::new(n as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

//! `tactile-filter tradeoff`.

use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::{Deserialize, Serialize};
use tactile_data::dataset::shard::Shard;
use tactile_data::file::bounded_file::{self, Kind};
use tactile_data::file::output_lock::OutputLock;
use tactile_data::program;
use tactile_data::program::progress::Progress;
use tactile_eval::evaluate::Protocol;
use tactile_eval::report::{knobs::in_words, tradeoff as page};
use tactile_eval::result::Poses;
use tactile_eval::sweep::{Bench, Planned, TOUCHES, measure, plan};
use tactile_eval::{Error, Result};
use tactile_filter::budget::{Knob, Point, SCHEMA, Setup, Tradeoff};
use tactile_infer::Model;
use tactile_infer::maps::Maps;
use tactile_infer::safefile::write_whole;

use super::arguments::{Output, Seeds, SpeedArgs, check_episodes, command_line, poses, to_json};
use source::{MeasuredOn, Source, SourceArgs};

mod source;

/// Names of the page and of the figures.
const FILES: [&str; 2] = ["tradeoff.html", "tradeoff.json"];

/// Measure how speed, memory and touches trade against accuracy; write tradeoff.json, frontier.json and a page.
///
/// For each setting and number of touches: how many episodes end sure and right, and how many are right at all.
/// Every second part chooses among the settings, the others say what is promised. Each setting is saved
/// as soon as it is measured: the same command continues where it was stopped.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter tradeoff --model infer/models/maze-small.safetensors \
                        --scene alphabet-small-dev --out tradeoff\n  tactile-filter tradeoff --model \
                        infer/models/maze-small.safetensors --pegs my-pegs --holes my-holes --out tradeoff")]
pub struct TradeoffArgs {
    /// Checkpoint, once or several times: the first is measured with every setting, the others are compared with it
    #[arg(long = "model", required = true, value_name = "FILE")]
    models: Vec<PathBuf>,
    /// Measure the first model with these networks, too, which draw maps of touches and verify parts by them
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    output: Output,
    /// Episodes of each setting, shared out over the seeds; half of them choose
    #[arg(long, value_name = "N", default_value_t = 300, help_heading = "Episodes")]
    episodes: usize,
    #[command(flatten, next_help_heading = "Episodes")]
    seeds: Seeds,
    /// Where holes are touched: at the bank's poses, as in the paper, or anywhere
    #[arg(long, value_name = "POSES", value_parser = poses(), default_value = "off-grid", help_heading = "Episodes")]
    poses: Poses,
    /// Measure only this many settings, evenly chosen [default: all]
    #[arg(long, value_name = "N", help_heading = "Episodes")]
    settings: Option<NonZeroUsize>,
    /// Measure one part of the settings: I/N with I from 1, or env, which reads the array index of Slurm or
    /// Kubernetes; the command without it puts all together
    #[arg(long, value_name = "I/N|env", help_heading = "Machine", conflicts_with = "json")]
    shard: Option<Shard>,
    #[command(flatten)]
    speeds: SpeedArgs,
}

/// A setting as it was measured, with all that its figures depend on.
#[derive(PartialEq, Serialize, Deserialize)]
struct Measured {
    planned: Planned,
    #[serde(flatten)]
    on: MeasuredOn,
    poses: Poses,
    n_episodes: usize,
    seeds: Vec<u64>,
    points: Vec<Point>,
}

/// The settings to measure, and what they are measured on.
struct Sweep {
    models: Vec<Arc<Model>>,
    /// The first one with maps.
    mapped: Option<Arc<Model>>,
    source: Source,
    planned: Vec<Planned>,
    /// Where each setting has its file.
    folder: PathBuf,
    /// Locks what will be written.
    _locks: Vec<OutputLock>,
}

impl TradeoffArgs {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        check_episodes(self.episodes, TOUCHES[TOUCHES.len() - 1], 1)?;
        self.speeds.speeds().validate()?;
        let sweep = self.sweep()?;
        let n_settings = sweep.planned.len();
        let mine = self.shard.map_or(0..n_settings, |shard| shard.range(n_settings));
        let mut todo = Vec::new();
        for index in mine.clone() {
            if self.saved(&sweep, index)?.is_none() {
                todo.push(index);
            }
        }
        self.measure(&sweep, todo)?;
        if self.shard.is_some() {
            program::say(format_args!("settings {mine:?} of {n_settings} in {}", sweep.folder.display()));
            return Ok(());
        }
        let tradeoff = self.gather(&sweep)?;
        self.write(&tradeoff, &sweep.models[0])
    }

    /// Loads what is measured, plans, and checks that the results can be written.
    fn sweep(&self) -> Result<Sweep> {
        let models = self.models.iter().map(|path| Ok(Arc::new(Model::load(path)?))).collect::<Result<Vec<_>>>()?;
        let with_maps = |path: &PathBuf| Ok::<_, Error>(Model::load(&self.models[0])?.with_maps(Maps::load(path)?)?);
        let mapped = self.maps.as_ref().map(with_maps).transpose()?.map(Arc::new);
        let source = self.source.load()?;
        let (mut planned, note) = source.plan(plan(&models, mapped.is_some())?);
        for planned in &mut planned {
            let stem = self.models[planned.model].file_stem().unwrap_or_default();
            planned.settings.model = stem.to_string_lossy().into_owned();
        }
        if let Some(n) = self.settings.map(NonZeroUsize::get).filter(|n| *n < planned.len()) {
            planned = (0..n).map(|i| planned[i * planned.len() / n].clone()).collect();
        }
        let folder = self.output.out.join("settings");
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let locks = if let Some(shard) = self.shard {
            vec![OutputLock::take(&folder.join(format!("shard-{}-of-{}", shard.index() + 1, shard.count())))?]
        } else {
            let of_source = self.source.files();
            let inputs: Vec<&Path> =
                self.models.iter().chain(&self.maps).chain(&of_source).map(PathBuf::as_path).collect();
            self.output.prepare(FILES[0], FILES[1], &inputs)?.into()
        };
        note.iter().for_each(program::note);
        Ok(Sweep { models, mapped, source, planned, folder, _locks: locks })
    }

    /// What is saved of a setting; `None` where nothing is, or something of another sweep.
    fn saved(&self, sweep: &Sweep, index: usize) -> Result<Option<Measured>> {
        let path = sweep.path(index);
        if !path.exists() {
            return Ok(None);
        }
        let text = bounded_file::read_to_string(&path, Kind::FIGURES)?;
        let found: Measured = serde_json::from_str(&text)
            .map_err(|e| Error::invalid(path.display().to_string(), "a measured setting", e.to_string()))?;
        let expected = self.measured(sweep, index, found.points.clone())?;
        Ok((found == expected).then_some(found))
    }

    fn measured(&self, sweep: &Sweep, index: usize, points: Vec<Point>) -> Result<Measured> {
        Ok(Measured {
            planned: sweep.planned[index].clone(),
            on: sweep.source.measured_on()?,
            poses: self.poses,
            n_episodes: self.episodes,
            seeds: self.seeds.seeds.clone(),
            points,
        })
    }

    /// Measures the settings of these numbers, model by model and bank by bank.
    fn measure(&self, sweep: &Sweep, mut todo: Vec<usize>) -> Result<()> {
        todo.sort_by_key(|index| sweep.bank_of(*index));
        let protocol = self.protocol();
        let progress = Progress::new("settings");
        let (mut done, mut said) = (0, Vec::new());
        for same_bank in todo.chunk_by(|a, b| sweep.bank_of(*a) == sweep.bank_of(*b)) {
            let Planned { settings, .. } = &sweep.planned[same_bank[0]];
            let model = sweep.model_of(same_bank[0]);
            progress.on_bar(done, todo.len(), &settings.tell(Knob::BankStep));
            let touched = sweep.source.pegs_and_holes(model, settings, self.poses)?;
            for note in &touched.notes {
                // Another model's bank of the same steps lacks the same.
                if !said.contains(note) {
                    progress.line(note);
                    said.push(note.clone());
                }
            }
            let (bank, holes) = (&touched.bank, touched.holes.holes());
            protocol.validate(holes, bank)?;
            let no_contact = holes.at_rest(&self.seeds.seeds);
            let has_strangers = same_bank.iter().any(|index| sweep.planned[*index].strangers);
            let learner = if has_strangers { sweep.source.learner(model, bank)? } else { None };
            let bench = Bench { holes, model, bank, no_contact: &no_contact, protocol: &protocol, learner };
            for index in same_bank {
                let settings = &sweep.planned[*index].settings;
                progress.on_bar(done, todo.len(), &in_words(settings));
                let measured = self.measured(sweep, *index, measure(&bench, &sweep.planned[*index])?)?;
                write_whole(&sweep.path(*index), to_json("setting", &measured)?.as_bytes())?;
                done += 1;
                progress.line(&format!("{done}/{} settings: {}", todo.len(), in_words(settings)));
            }
        }
        Ok(())
    }

    fn protocol(&self) -> Protocol {
        Protocol {
            n_episodes: self.episodes,
            episodes: 0..self.episodes,
            seeds: self.seeds.seeds.clone(),
            poses: self.poses,
            absent: false,
            n_classes: None,
            choose_ms: None,
            start_known_to: None,
            n_prints: 1,
            n_earlier: 0,
            n_touches: TOUCHES[TOUCHES.len() - 1],
        }
    }

    /// All settings' points together.
    fn gather(&self, sweep: &Sweep) -> Result<Tradeoff> {
        let mut points = Vec::new();
        for index in 0..sweep.planned.len() {
            let missing = || Error::invalid(sweep.path(index).display().to_string(), "a measured setting", "none");
            points.extend(self.saved(sweep, index)?.ok_or_else(missing)?.points);
        }
        let poses = match self.poses {
            Poses::OnGrid => "on-grid",
            Poses::OffGrid => "off-grid",
        };
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let mut tradeoff = Tradeoff {
            schema: SCHEMA.into(),
            scene: sweep.source.name().to_owned(),
            recorded: sweep.source.is_recorded(),
            poses: poses.into(),
            n_classes: sweep.source.n_classes(),
            n_episodes: self.episodes,
            seeds: self.seeds.seeds.clone(),
            machine: format!("{}, {threads} threads", std::env::consts::ARCH),
            command: command_line(),
            speeds: self.speeds.speeds(),
            points,
        };
        tradeoff.mark_dominated();
        Ok(tradeoff)
    }

    fn write(&self, tradeoff: &Tradeoff, model: &Model) -> Result<()> {
        let frontier = to_json("frontier", &tradeoff.frontier(model.sha256()))?;
        let frontier = self.output.write("frontier.json", &frontier)?;
        let html = self.output.write(FILES[0], &page::html(tradeoff))?;
        let json = to_json("trade-off", tradeoff)?;
        self.output.write(FILES[1], &json)?;
        self.output.print(&json, &html, || {
            print_findings(tradeoff);
            program::say(format_args!("  for --frontier: {}", frontier.display()));
        });
        Ok(())
    }
}

impl Sweep {
    /// The file of a setting.
    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("{index:03}.json"))
    }

    /// What the bank of a setting depends on: model, whether that draws maps, and steps.
    fn bank_of(&self, index: usize) -> (usize, bool, u64, u64) {
        let Planned { model, settings: Setup { xy_step_mm, theta_step_deg, verify, .. }, .. } = &self.planned[index];
        (*model, verify.is_some(), xy_step_mm.to_bits(), theta_step_deg.to_bits())
    }

    /// The model of a setting.
    fn model_of(&self, index: usize) -> &Arc<Model> {
        let Planned { model, settings, .. } = &self.planned[index];
        let with_maps = self.mapped.as_ref().filter(|_| settings.verify.is_some());
        with_maps.unwrap_or(&self.models[*model])
    }
}

fn print_findings(tradeoff: &Tradeoff) {
    let Some(verdict) = page::verdict(tradeoff) else { return };
    let print = |name: &str, point: &Point| {
        println!(
            "{name}: {:.1} %{} after {} touches, {:.2} ms a decision (99 %: {:.2}), {:.1} MB: {}",
            100.0 * point.accuracy,
            format_args!(" ({:.1} % and sure)", 100.0 * point.halves.together().decided_and_right()),
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
    print("most accurate", verdict.best);
    print("fastest within 2 points of it", verdict.fast);
    print("most decided and right", verdict.surest);
    if tradeoff.recorded {
        println!("recorded touches: intervals cover which of them are drawn, not other sensors, parts or prints");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use tactile_data::scene::Scene;

    #[test]
    fn a_saved_setting_of_a_scene_has_the_fields_of_before_there_were_recordings() {
        let settings = serde_json::json!({
            "model": "small", "model_sha256": "ab", "xy_step_mm": 2.0, "theta_step_deg": 15.0, "rows": "f32",
            "engine": "exact", "subdivisions": 2, "rule": "information", "n_draws": 8, "n_suppositions": 2,
            "n_finalists": null, "false_accept": 0.01,
        });
        let scene = Scene::preset("alphabet-small").unwrap();
        let saved = serde_json::json!({
            "planned": {"model": 0, "settings": settings}, "scene": scene, "poses": "off-grid", "n_episodes": 4,
            "seeds": [1, 2], "bank_seed": 1, "points": [],
        });
        let read: Measured = serde_json::from_str(&saved.to_string()).unwrap();
        assert!(read.on == MeasuredOn::Scene { scene: Box::new(scene), bank_seed: 1 });
        let keys =
            |value: &serde_json::Value| -> BTreeSet<String> { value.as_object().unwrap().keys().cloned().collect() };
        assert_eq!(keys(&serde_json::to_value(&read).unwrap()), keys(&saved));
        assert!(serde_json::from_str::<Measured>(&serde_json::to_string(&read).unwrap()).unwrap() == read);
    }
}

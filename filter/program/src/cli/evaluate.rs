//! `tactile-filter evaluate`.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use tactile_data::scene::Scene;
use tactile_data::shard::Shard;
use tactile_data::simulator::Simulator;
use tactile_data::store::Dataset;
use tactile_eval::episodes::{EPISODES_SCHEMA, Episodes, RunResult, Setup, Single};
use tactile_eval::evaluate::{Protocol, Run, at_rest, run_all};
use tactile_eval::narrative::episodes::{pick, play_again};
use tactile_eval::narrative::{Board, Narrative};
use tactile_eval::page::shell::check_page;
use tactile_eval::report::write_report;
use tactile_eval::result::{Choice, Evaluation, Inference, Method, ModelRecord, Poses};
use tactile_eval::{Error, Result};
use tactile_eval::{baselines, summary};
use tactile_filter::action::ActionRule;
use tactile_filter::belief::EngineConfig;
use tactile_filter::{EpisodeConfig, Sensor};
use tactile_infer::Bank;
use tactile_infer::safefile::write_whole;
use tactile_infer::{DeviceKind, Model};

use super::budget::{BudgetArgs, Task};
use super::table;
use super::tuning::{Tuning, rule};

/// Run episodes against simulated holes; write evaluation.json and report.html.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-filter evaluate --model infer/models/maze-small.safetensors --bank pegs.bank --scene alphabet-small --out evaluation"
)]
pub struct Evaluate {
    /// Checkpoint written by tactile-train.
    #[arg(long)]
    model: PathBuf,
    /// Bank of the scene's pegs, made by tactile-infer bank with the same model.
    #[arg(long)]
    bank: PathBuf,
    /// Scene preset or TOML file whose holes are touched.
    #[arg(long)]
    scene: String,
    /// Folder for evaluation.json and report.html.
    #[arg(long)]
    out: PathBuf,
    /// Dataset of the bank's pegs: adds the Pixel baselines.
    #[arg(long)]
    pegs: Option<PathBuf>,
    /// Episodes in all, shared out over the seeds.
    #[arg(long, default_value_t = 500)]
    episodes: usize,
    /// Seeds of holes, poses and frames.
    #[arg(long, value_delimiter = ',', default_value = "1,2,3")]
    seeds: Vec<u64>,
    /// Touches of an episode, the first included.
    #[arg(long, default_value_t = 10)]
    touches: usize,
    /// Where holes are touched.
    #[arg(long, default_value = "on-grid", value_parser = ["on-grid", "off-grid"])]
    poses: String,
    /// Take each hole's own part out of the bank: how often is it recognised as none of these?
    #[arg(long)]
    absent: bool,
    /// Tell each hole from K parts only: its own and others drawn at random [default: all of the bank]
    #[arg(long, value_name = "K")]
    classes: Option<usize>,
    /// Run one part of the episodes into a file of its own: I/N with I from 1, or env, which reads the array
    /// index of Slurm or Kubernetes; tactile-filter merge makes one evaluation of all N.
    #[arg(long, value_name = "I/N|env")]
    shard: Option<Shard>,
    /// Milliseconds for each choice of a touch: the best found by then is taken [default: no limit]
    #[arg(long)]
    choose_ms: Option<f64>,
    /// Engines: exact, particle, and paper (Alg. 1 as printed: K = 100, plain cosine, its own action rule).
    #[arg(long, value_delimiter = ',', default_value = "exact,paper", value_parser = ["exact", "particle", "paper"])]
    engines: Vec<String>,
    /// How the next touch is chosen; the first is the one that stopping and latency are told for.
    #[arg(long, value_delimiter = ',', default_value = "information,paper,random", value_parser = ["paper", "information", "random"])]
    actions: Vec<String>,
    /// Episodes told touch by touch in the report: half of them the first, half the wrong and the longest.
    #[arg(long, default_value_t = 6)]
    stories: usize,
    /// Where the network is computed: flex or ndarray.
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Print evaluation.json instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    budget: BudgetArgs,
    #[command(flatten)]
    tuning: Tuning,
}

impl Evaluate {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        check_page(&self.out.join("report.html"))?;
        let model = Arc::new(Model::load_on(&self.model, self.device.parse()?)?);
        let mut bank = Arc::new(Bank::load(&self.bank, &model)?);
        let simulator = Simulator::new(Scene::load(&self.scene)?, 1)?;
        let protocol = self.protocol();
        protocol.validate(&simulator, &bank)?;
        let (mut configs, mut promise) = (self.configs(&model)?, None);
        if self.budget.is_asked() {
            let between_poses = protocol.poses == Poses::OffGrid;
            let reach = simulator.scene().reach.filter(|_| between_poses).unwrap_or(*bank.grid());
            let no_contact = at_rest(&simulator, &self.seeds);
            let (model_path, model, no_contact) = (self.model.as_path(), &model, &no_contact);
            let task = Task { model_path, model, bank: &bank, no_contact, reach, between_poses };
            let base = self.tuning.config("exact", ActionRule::Information, model)?;
            let (kept, config, promised) = self.budget.choose(&task, &base)?;
            (bank, configs, promise) = (kept, vec![("chosen for the budget".into(), config)], Some(promised));
        }
        if let Some(shard) = self.shard {
            return self.run_shard(shard, &simulator, &model, &bank, (&protocol, &configs));
        }
        let episodes = self.run_episodes(&simulator, &model, &bank, (&protocol, &configs))?;
        let evaluation = Evaluation { promise, ..episodes.evaluation()? };
        // An episode without its part has no truth to show, and one of a few parts no map of all.
        let n_stories = if self.absent || self.classes.is_some() { 0 } else { self.stories };
        let sensor = Sensor::new(model.clone(), &at_rest(&simulator, &self.seeds))?;
        let lead = &episodes.runs[0];
        let picks = pick(&lead.outcomes, &lead.config, n_stories);
        let run =
            Run { simulator: &simulator, sensor: &sensor, bank: &bank, config: &lead.config, protocol: &protocol };
        write(&self.out, &evaluation, &Board::new(&simulator, &bank)?, &play_again(&run, &picks)?)?;
        if self.json {
            println!("{}", to_json(&evaluation)?);
        } else {
            table::print(&evaluation, &episodes.single_rows(true));
            println!("  {}", self.out.join("report.html").display());
        }
        Ok(())
    }

    /// Runs the episodes of a shard, unless its file is there already.
    fn run_shard(
        &self,
        shard: Shard,
        simulator: &Simulator,
        model: &Arc<Model>,
        bank: &Arc<Bank>,
        (protocol, configs): (&Protocol, &[(String, EpisodeConfig)]),
    ) -> Result<()> {
        let path = self.out.join(format!("shard-{}-of-{}.json", shard.index() + 1, shard.count()));
        let nothing = Protocol { episodes: 0..0, ..protocol.clone() };
        if path.exists() {
            let there = Episodes::load(&path)?;
            if there.episodes == protocol.episodes
                && there.is_of(&self.run_episodes(simulator, model, bank, (&nothing, configs))?)
            {
                println!("{} is there already", path.display());
                return Ok(());
            }
            let expected = "no file, or this shard of this evaluation";
            return Err(Error::invalid(path.display().to_string(), expected, "one of another evaluation"));
        }
        std::fs::create_dir_all(&self.out).map_err(Error::io(&self.out))?;
        self.run_episodes(simulator, model, bank, (protocol, configs))?.save(&path)?;
        println!("episodes {:?} in {}", protocol.episodes, path.display());
        Ok(())
    }

    fn protocol(&self) -> Protocol {
        Protocol {
            n_episodes: self.episodes,
            episodes: self.shard.map_or(0..self.episodes, |shard| shard.range(self.episodes)),
            seeds: self.seeds.clone(),
            poses: if self.poses == "on-grid" { Poses::OnGrid } else { Poses::OffGrid },
            absent: self.absent,
            n_classes: self.classes,
            choose_ms: self.choose_ms,
            n_touches: self.touches,
        }
    }

    /// Runs every way of inferring on the protocol's episodes.
    fn run_episodes(
        &self,
        simulator: &Simulator,
        model: &Arc<Model>,
        bank: &Arc<Bank>,
        (protocol, configs): (&Protocol, &[(String, EpisodeConfig)]),
    ) -> Result<Episodes> {
        let no_contact = at_rest(simulator, &self.seeds);
        let sensor = Sensor::new(model.clone(), &no_contact)?;
        let mut singles = Vec::new();
        if let Some(path) = &self.pegs {
            let scored = baselines::pixel(simulator, model, bank, &Dataset::open(path)?, &no_contact, protocol)?;
            let single = |(scored, inside_out)| Single { method: Method::Pixel, inside_out, scored };
            singles.extend(scored.into_iter().zip([false, true]).map(single));
        }
        let scored = baselines::moco(simulator, &sensor, bank, protocol)?;
        singles.push(Single { method: Method::Moco, inside_out: false, scored });
        let run_one = |(name, config): &(String, EpisodeConfig)| {
            let bar = progress(name);
            let run = Run { simulator, sensor: &sensor, bank, config, protocol };
            let outcomes = run_all(&run, &|done, total| {
                bar.set_length(total as u64);
                bar.set_position(done as u64);
            })?;
            bar.finish_and_clear();
            Ok(RunResult { label: label(config, protocol.poses), config: *config, outcomes })
        };
        Ok(Episodes {
            schema: EPISODES_SCHEMA.into(),
            setup: Setup {
                scene: simulator.scene().name.clone(),
                parts: simulator.parts().to_vec(),
                n_classes: self.classes.unwrap_or(bank.parts().len()),
                n_episodes: protocol.n_episodes,
                seeds: protocol.seeds.clone(),
                n_touches: protocol.n_touches,
                poses: protocol.poses,
                absent: protocol.absent,
                choose_ms: protocol.choose_ms,
                model: ModelRecord::of(model),
                bank_sha256: bank.sha256()?,
                device: self.device.clone(),
            },
            episodes: protocol.episodes.clone(),
            n_threads: std::thread::available_parallelism().map_or(1, usize::from),
            command: command_line(),
            singles,
            runs: configs.iter().map(run_one).collect::<Result<_>>()?,
        })
    }

    fn config(&self, engine: &str, rule: ActionRule, model: &Model) -> Result<EpisodeConfig> {
        let config = self.tuning.config(engine, rule, model)?;
        let max_touches = self.budget.max_touches.unwrap_or(config.max_touches);
        let config = EpisodeConfig { max_touches, ..config };
        config.validate()?;
        Ok(config)
    }

    /// Each engine with each rule; `paper` is Alg. 1, which brings its own rule.
    fn configs(&self, model: &Model) -> Result<Vec<(String, EpisodeConfig)>> {
        let mut configs = Vec::new();
        for engine in &self.engines {
            if engine == "paper" {
                configs.push(("Alg. 1 as printed".into(), self.config(engine, ActionRule::Paper, model)?));
                continue;
            }
            for action in &self.actions {
                configs.push((format!("{engine}, {action}"), self.config(engine, rule(action)?, model)?));
            }
        }
        Ok(configs)
    }
}

/// Writes the report and the figures into a folder.
pub fn write(out: &Path, evaluation: &Evaluation, board: &Board, episodes: &[Narrative]) -> Result<()> {
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let report = out.join("report.html");
    write_report(&report, evaluation, board, episodes)?;
    // Last: whoever finds the figures finds the report too.
    Ok(write_whole(&out.join("evaluation.json"), to_json(evaluation)?.as_bytes())?)
}

/// The command line as it was typed, without the folder of the program.
pub fn command_line() -> String {
    let words = std::env::args().skip(1);
    std::iter::once("tactile-filter".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

fn label(config: &EpisodeConfig, poses: Poses) -> summary::Label {
    let inference = match config.engine {
        EngineConfig::Exact => Inference::Exact,
        EngineConfig::Particle(_) => Inference::Particle,
    };
    let action = match config.action.rule {
        ActionRule::Paper => Choice::Paper,
        ActionRule::Information => Choice::Information,
        ActionRule::Random => Choice::Random,
    };
    summary::Label { method: Method::Filter, inference, action, poses }
}

pub fn to_json(evaluation: &Evaluation) -> Result<String> {
    serde_json::to_string_pretty(evaluation).map_err(|e| Error::invalid("evaluation", "JSON", e.to_string()))
}

/// A bar on a terminal, one plain line elsewhere.
pub(super) fn progress(what: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        eprintln!("episodes: {what}");
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(&format!("{what:20} {{bar:30}} {{pos}}/{{len}} {{eta}} left"));
    ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

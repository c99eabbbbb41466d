//! `tactile-filter evaluate`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use tactile_data::dataset::shard::Shard;
use tactile_data::dataset::store::{self, Dataset};
use tactile_data::file::output;
use tactile_data::file::output_lock::OutputLock;
use tactile_data::light::calibrate::Calibration;
use tactile_data::program;
use tactile_data::program::drawn::DrawnArgs;
use tactile_data::program::progress::reporter;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_eval::banks::Banks;
use tactile_eval::episodes::{EPISODES_SCHEMA, Episodes, RunResult, Setup, Single};
use tactile_eval::evaluate::{Protocol, Run, run_all};
use tactile_eval::fits::check_bank;
use tactile_eval::holes::{OwnedHoles, RecordedHoles};
use tactile_eval::narrative::episodes::{pick, play_again};
use tactile_eval::narrative::{Board, Narrative};
use tactile_eval::report::write_report;
use tactile_eval::result::{Choice, Evaluation, Inference, Method, ModelRecord, Poses, Promise};
use tactile_eval::{Error, Result};
use tactile_eval::{baselines, summary};
use tactile_filter::belief::EngineConfig;
use tactile_filter::choice::ActionRule;
use tactile_filter::{EpisodeConfig, Sensor};
use tactile_infer::bank::simulated::learner::Learner;
use tactile_infer::{Bank, Model};

use super::arguments::{
    Engine, Inputs, Output, Seeds, SensorArgs, SideArgs, SpeedArgs, check_episodes, command_line, known_to, poses,
    positive, rule, to_json, warn_of_calibration, warn_of_light, warn_of_poses, warn_of_side,
};
use super::budget::{BudgetArgs, Task};
use super::numbers::Numbers;
use super::table;

/// Episodes that a report shows where nothing is said.
const N_STORIES: usize = 6;

mod flags;

/// Names of the page and of the figures.
const FILES: [&str; 2] = ["report.html", "evaluation.json"];

/// Run episodes against simulated or recorded holes, or pegs; write evaluation.json and report.html.
///
/// Memory is linear in the parts: with poses every 2 mm and 15 degrees each takes 0.2 MB in a bank of i8 (0.6 MB in
/// f32), 0.2 MB for each thread, and 0.7 MB once its hole is simulated.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter evaluate --model infer/models/maze-small.safetensors \
                        --bank pegs.bank --scene alphabet-small --out evaluation\n  tactile-filter evaluate --model \
                        infer/models/maze-small.safetensors --bank pegs.bank --holes recorded --out evaluation\n  \
                        tactile-filter evaluate --model infer/models/maze-small.safetensors --bank pegs.bank \
                        --scene alphabet-small --prints 4 --out four-prints")]
pub struct Evaluate {
    #[command(flatten)]
    inputs: Inputs,
    #[command(flatten)]
    other: SensorArgs,
    /// Scene whose holes are simulated: the name of a preset, or a TOML file
    #[arg(long, value_name = "PRESET|FILE.toml", required_unless_present = "holes", conflicts_with = "holes")]
    scene: Option<String>,
    /// With --scene: simulate your sensor, as `tactile-data calibrate` measured it, instead of the scene's
    #[arg(long, value_name = "FILE.toml", requires = "scene")]
    calibration: Option<PathBuf>,
    /// Recorded touches instead: the filter chooses among the touches of this dataset, each at most once
    #[arg(long, value_name = "DIR")]
    holes: Option<PathBuf>,
    #[command(flatten)]
    which: SideArgs,
    #[command(flatten)]
    output: Output,
    /// Episodes in all, shared out over the seeds
    #[arg(long, value_name = "N", default_value_t = 500, help_heading = "Episodes")]
    episodes: usize,
    /// Touches of an episode, the first included
    #[arg(long, value_name = "N", default_value_t = 10, help_heading = "Episodes")]
    touches: usize,
    /// Where holes are touched: at recorded poses, as in the paper, or anywhere
    #[arg(long, value_name = "POSES", value_parser = poses(), default_value = "on-grid", help_heading = "Episodes")]
    poses: Poses,
    #[command(flatten, next_help_heading = "Episodes")]
    drawn: DrawnArgs,
    #[command(flatten, next_help_heading = "Episodes")]
    seeds: Seeds,
    /// Prints of each part that episodes take turns with: they differ in their layer lines, and the first has those of
    /// a bank of the same seed that knows holes; recorded holes have one
    #[arg(long, value_name = "P", default_value_t = 1, help_heading = "Episodes")]
    prints: usize,
    /// Choose each hole's part from K parts only: its own and others drawn at random [default: all of the bank]
    #[arg(long, value_name = "K", help_heading = "Episodes")]
    classes: Option<usize>,
    /// Before each episode let a run of holes of the bank's parts be felt, until N are named with confidence: how well touches of
    /// this sensor match is then known, and its lamps, where nobody knew them
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Episodes")]
    earlier_holes: usize,
    /// A camera or a drawing says where each hole is before it is touched, off by a normal error of these standard deviations: mm
    /// along x and along y, and degrees [default: it may be anywhere in the bank's start]
    #[arg(long, value_name = "MM,DEG", value_parser = known_to, help_heading = "Episodes")]
    start_known_to: Option<[f64; 2]>,
    /// Take each hole's own part out of the bank: how often is it recognised as none of these? A bank that learnt from
    /// its parts learns again without it, from its scene
    #[arg(long, help_heading = "Episodes")]
    absent: bool,
    /// With --absent: the scene that the bank was made of [default: that of --scene]
    #[arg(long, value_name = "PRESET|FILE.toml", requires = "absent", help_heading = "Episodes")]
    bank_scene: Option<String>,
    /// How states are inferred [default: exact,paper]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "Methods")]
    engines: Vec<Engine>,
    /// How the next touch is chosen; stopping and times are reported for the first. The engine paper brings its own
    /// [default: information,paper,random]
    #[arg(long, value_name = "ACTIONS", value_parser = rule(), value_delimiter = ',', help_heading = "Methods")]
    actions: Vec<ActionRule>,
    /// Dataset of the bank's pegs: adds the nearest neighbour by pixels, among all parts
    #[arg(long, value_name = "DIR", conflicts_with = "absent", help_heading = "Methods")]
    pegs: Option<PathBuf>,
    /// Episodes that the report shows touch by touch: half of them the first, half the wrong and the longest [default:
    /// 6; none with --shard, --absent or --classes]
    #[arg(long, value_name = "N", help_heading = "Report")]
    stories: Option<usize>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Time for each choice of a touch, ms: the best found by then is taken [default: no limit]
    #[arg(long, value_name = "MS", value_parser = positive, help_heading = "Budget")]
    choose_ms: Option<f64>,
    #[command(flatten)]
    speeds: SpeedArgs,
    /// Run one part of the episodes into a file of its own: I/N with I from 1, or env, which reads the array
    /// index of Slurm or Kubernetes; tactile-filter merge makes one evaluation of all N
    #[arg(long, value_name = "I/N|env", help_heading = "Machine", conflicts_with = "json")]
    shard: Option<Shard>,
    #[command(flatten)]
    numbers: Numbers,
}

/// All that the episodes depend on.
struct Subject {
    touched: OwnedHoles,
    model: Arc<Model>,
    banks: Banks,
    sensor: Sensor,
    protocol: Protocol,
    /// Each way to infer and choose, with its name.
    ways: Vec<(String, EpisodeConfig)>,
    promise: Option<Promise>,
    /// Locks what will be written.
    _locks: Vec<OutputLock>,
}

impl Evaluate {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        self.check_flags()?;
        let n_ways = self.engines().len() * self.actions().len() + 2;
        check_episodes(self.episodes, self.touches, n_ways)?;
        let subject = self.subject()?;
        if let Some(shard) = self.shard {
            return self.run_shard(shard, &subject);
        }
        let episodes = self.run_episodes(&subject, &subject.protocol)?;
        let Subject { banks, sensor, protocol, .. } = &subject;
        let holes = subject.touched.holes();
        let evaluation = Evaluation { promise: subject.promise.clone(), ..episodes.evaluation()? };
        let n_stories = if self.has_stories() { self.stories.unwrap_or(N_STORIES) } else { 0 };
        let first = &episodes.runs[0];
        let picks = pick(&first.outcomes, &first.config, n_stories);
        let run = Run { holes, sensor, banks, config: &first.config, protocol };
        let board = Board::new(holes, banks.whole())?;
        write(&self.output, &episodes, &evaluation, &board, &play_again(&run, &picks)?)
    }

    /// Loads everything, checks that it belongs together and that the results can be written, and chooses the settings.
    fn subject(&self) -> Result<Subject> {
        let (model, mut bank) = self.inputs.load()?;
        let protocol = self.protocol();
        let touched = self.touched(&bank)?;
        let holes = touched.holes();
        warn_of_poses(holes, &bank, protocol.poses);
        warn_of_side(&bank, self.which.side);
        self.speeds.speeds().validate()?;
        protocol.validate(holes, &bank)?;
        let mut ways = self.ways(&model)?;
        let locks = self.prepare_output()?;
        let no_contact = holes.at_rest(&self.seeds.seeds);
        let mut promise = None;
        if self.budget.is_given() {
            let between_poses = protocol.poses == Poses::OffGrid;
            let reach = if between_poses { holes.reach(&bank) } else { *bank.start() };
            let (model_path, model, no_contact) = (self.inputs.model.as_path(), &model, &no_contact);
            let speeds = self.speeds.speeds();
            let task = Task { model_path, model, bank: &bank, no_contact, reach, between_poses, speeds };
            let base = self.config(Engine::Exact, ActionRule::Information, model)?;
            let (kept, config, promised) = self.budget.choose(&task, &base)?;
            (bank, ways, promise) = (kept, vec![("chosen for the budget".into(), config)], Some(promised));
        }
        let sensor = holes.sensor(&model, &no_contact)?;
        warn_of_calibration(&model, self.which.side);
        let learner = self.learner(&model, &bank)?.map(Arc::new);
        let banks = Banks::new(bank, &protocol, learner)?;
        Ok(Subject { touched, model, banks, sensor, protocol, ways, promise, _locks: locks })
    }

    /// Touches a bank's parts again, where it learnt from them and one of them is to be absent.
    fn learner(&self, model: &Model, bank: &Bank) -> Result<Option<Learner>> {
        if !self.absent || bank.metric().is_none() {
            return Ok(None);
        }
        let scene = match (&self.bank_scene, &self.scene) {
            (Some(scene), _) => Scene::load(scene)?,
            (None, Some(scene)) => self.bank_sensors_scene(scene)?,
            (None, None) => {
                let expected =
                    "--bank-scene, too: the bank learnt from its parts, and learns again without the absent one";
                return Err(Error::invalid("--absent", expected, "recorded holes alone"));
            }
        };
        check_bank(bank, &scene, false)?;
        let again = Learner::of_bank(model, bank, &scene, &reporter("touches of the bank"));
        Ok(Some(again.map_err(|error| error.within("--bank-scene"))?))
    }

    /// A scene under the sensor that its bank was made with.
    fn bank_sensors_scene(&self, scene: &str) -> Result<Scene> {
        let scene = Scene::load(scene)?;
        Ok(match &self.calibration {
            Some(path) => scene.under(&Calibration::load(path)?)?,
            None => scene,
        })
    }

    /// Loads what is touched, and refuses a bank that does not fit it.
    fn touched(&self, bank: &Bank) -> Result<OwnedHoles> {
        if let Some(scene) = &self.scene {
            let mut scene = self.bank_sensors_scene(scene)?;
            scene.sensor = self.drawn.sensor(&scene.sensor);
            // A touched peg is another print than the one that a bank holds by default.
            let print = if self.which.side.is_hole() { 1 } else { 2 };
            let simulator = Simulator::new(scene, print)?;
            let is_other = self.other.other_sensor || self.drawn.flag().is_some();
            check_bank(bank, simulator.scene(), is_other)?;
            return Ok(OwnedHoles::Simulated(Arc::new(simulator), self.which.side));
        }
        let path = self.holes.as_deref().unwrap_or(Path::new(""));
        let recorded = RecordedHoles::new(Dataset::open(path)?, self.which.side, bank, self.other.other_sensor)?;
        warn_of_light(bank, recorded.lamps());
        recorded.notes().iter().for_each(program::note);
        Ok(OwnedHoles::Recorded(Box::new(recorded)))
    }

    /// Checks that the results can be written and are none of the inputs, and locks them.
    fn prepare_output(&self) -> Result<Vec<OutputLock>> {
        let of_holes = self.holes.iter().flat_map(|holes| store::FILES.map(|file| holes.join(file)));
        let of_holes: Vec<PathBuf> = of_holes.collect();
        let scene = self.scene.as_deref().unwrap_or_default();
        let inputs: Vec<&Path> = self
            .inputs
            .files(scene)
            .into_iter()
            .chain(of_holes.iter().chain(&self.calibration).map(PathBuf::as_path))
            .chain(self.bank_scene.iter().map(Path::new))
            .collect();
        match self.shard {
            Some(shard) => Ok(vec![output::prepare_file(&self.shard_file(shard), inputs)?]),
            None => Ok(prepare(&self.output, &inputs)?.into()),
        }
    }

    /// Runs the episodes of a shard, unless its file is there already.
    fn run_shard(&self, shard: Shard, subject: &Subject) -> Result<()> {
        let protocol = &subject.protocol;
        let path = self.shard_file(shard);
        if path.exists() {
            let there = Episodes::load(&path)?;
            let nothing = Protocol { episodes: 0..0, ..protocol.clone() };
            if there.episodes == protocol.episodes && there.is_of(&self.run_episodes(subject, &nothing)?) {
                program::say(format_args!("{} is there already", path.display()));
                return Ok(());
            }
            let expected = "no file, or this shard of this evaluation";
            return Err(Error::invalid(path.display().to_string(), expected, "one of another evaluation"));
        }
        self.run_episodes(subject, protocol)?.save(&path)?;
        program::say(format_args!("episodes {:?} in {}", protocol.episodes, path.display()));
        Ok(())
    }

    fn shard_file(&self, shard: Shard) -> PathBuf {
        self.output.out.join(format!("shard-{}-of-{}.json", shard.index() + 1, shard.count()))
    }

    fn protocol(&self) -> Protocol {
        Protocol {
            n_episodes: self.episodes,
            episodes: self.shard.map_or(0..self.episodes, |shard| shard.range(self.episodes)),
            seeds: self.seeds.seeds.clone(),
            poses: self.poses,
            absent: self.absent,
            n_classes: self.classes,
            choose_ms: self.choose_ms,
            n_prints: self.prints,
            n_touches: self.touches,
            n_earlier: self.earlier_holes,
            start_known_to: self.start_known_to,
        }
    }

    /// The settings of an engine and a rule.
    fn config(&self, engine: Engine, rule: ActionRule, model: &Model) -> Result<EpisodeConfig> {
        self.numbers.applied_to(engine.config(model, self.which.side).changed(|_, _, method| method.rule = rule))
    }

    /// Each engine with each rule; `paper` is Alg. 1, which brings its own rule.
    fn ways(&self, model: &Model) -> Result<Vec<(String, EpisodeConfig)>> {
        let mut ways = Vec::new();
        for engine in self.engines() {
            if *engine == Engine::Paper {
                ways.push(("Alg. 1 as printed".into(), self.config(*engine, ActionRule::Paper, model)?));
                continue;
            }
            for rule in self.actions() {
                let name = format!("{engine:?}, {rule:?}").to_lowercase();
                ways.push((name, self.config(*engine, *rule, model)?));
            }
        }
        Ok(ways)
    }

    /// Runs every way on the protocol's episodes.
    fn run_episodes(&self, subject: &Subject, protocol: &Protocol) -> Result<Episodes> {
        let Subject { touched, model, banks, sensor, .. } = subject;
        let holes = touched.holes();
        let mut singles = Vec::new();
        if let Some(path) = &self.pegs {
            let no_contact = holes.at_rest(&protocol.seeds);
            let scored = baselines::pixel(holes, model, banks.whole(), &Dataset::open(path)?, &no_contact, protocol)?;
            let single = |(scored, inside_out)| Single { method: Method::Pixel, inside_out, scored };
            singles.extend(scored.into_iter().zip([false, true]).map(single));
        }
        let scored = baselines::moco(holes, sensor, banks, protocol)?;
        singles.push(Single { method: Method::Moco, inside_out: false, scored });
        let run_one = |(name, config): &(String, EpisodeConfig)| {
            let progress = reporter(format!("episodes, {name}"));
            let outcomes = run_all(&Run { holes, sensor, banks, config, protocol }, &progress)?;
            Ok(RunResult { label: label(config, protocol.poses), config: *config, outcomes })
        };
        Ok(Episodes {
            schema: EPISODES_SCHEMA.into(),
            setup: self.setup(subject)?,
            episodes: protocol.episodes.clone(),
            n_threads: std::thread::available_parallelism().map_or(1, usize::from),
            command: command_line(),
            speeds: self.speeds.speeds(),
            singles,
            runs: subject.ways.iter().map(run_one).collect::<Result<_>>()?,
        })
    }

    fn setup(&self, subject: &Subject) -> Result<Setup> {
        let Subject { touched, model, banks, protocol, .. } = subject;
        let (holes, bank) = (touched.holes(), banks.whole());
        Ok(Setup {
            scene: holes.name().to_owned(),
            parts: holes.parts().to_vec(),
            n_classes: self.classes.unwrap_or(bank.parts().len()),
            n_episodes: protocol.n_episodes,
            seeds: protocol.seeds.clone(),
            n_prints: protocol.n_prints,
            n_touches: protocol.n_touches,
            poses: protocol.poses,
            absent: protocol.absent,
            n_earlier: protocol.n_earlier,
            start_known_to: protocol.start_known_to,
            recorded: holes.is_recorded(),
            recorded_parts: holes.some_parts(),
            side: holes.side(),
            views: bank.views(),
            choose_ms: protocol.choose_ms,
            model: ModelRecord::of(model),
            bank_sha256: bank.sha256()?,
            verifier_sha256: bank.verifier().map(|verifier| verifier.sha256().to_owned()),
            device: self.inputs.device.to_string(),
        })
    }
}

/// Writes the report and the figures, and prints them.
pub fn write(
    output: &Output,
    episodes: &Episodes,
    evaluation: &Evaluation,
    board: &Board,
    narratives: &[Narrative],
) -> Result<()> {
    let report = output.out.join(FILES[0]);
    write_report(&report, evaluation, board, narratives)?;
    let json = to_json("evaluation", evaluation)?;
    // Last: whoever finds the figures finds the report too.
    output.write(FILES[1], &json)?;
    output.print(&json, &report, || table::print(evaluation, &episodes.single_rows(true)));
    Ok(())
}

/// Checks that an evaluation can be written and that it is none of the inputs, and locks it.
pub fn prepare(output: &Output, inputs: &[&Path]) -> Result<[OutputLock; 2]> {
    output.prepare(FILES[0], FILES[1], inputs)
}

fn label(config: &EpisodeConfig, poses: Poses) -> summary::Label {
    let inference = match config.method().engine {
        EngineConfig::Exact => Inference::Exact,
        EngineConfig::Particle(_) => Inference::Particle,
    };
    let action = match config.method().rule {
        ActionRule::Paper => Choice::Paper,
        ActionRule::Information => Choice::Information,
        ActionRule::Random => Choice::Random,
        ActionRule::RandomEdge => Choice::RandomEdge,
    };
    summary::Label { method: Method::Filter, inference, action, poses }
}

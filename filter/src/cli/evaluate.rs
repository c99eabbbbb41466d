//! `tactile-filter evaluate`.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use tactile_data::scene::Scene;
use tactile_data::simulator::Simulator;
use tactile_data::store::Dataset;
use tactile_filter::action::ActionRule;
use tactile_filter::belief::EngineConfig;
use tactile_filter::episode::{EpisodeConfig, Eye};
use tactile_filter::offline::evaluate::{Outcome, Protocol, Scored, run};
use tactile_filter::offline::report::{Board, EpisodeStory, PaperNumbers, write_report};
use tactile_filter::offline::result::{
    Choice, Evaluation, Inference, Method, ModelRecord, Poses, Row, SCHEMA, Stopping,
};
use tactile_filter::offline::{baselines, story, summary};
use tactile_filter::{Error, Result};
use tactile_infer::bank::Bank;
use tactile_infer::safefile::write_whole;
use tactile_infer::{DeviceKind, Model};

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
    /// Milliseconds for each choice of a touch: the best found by then is taken [default: no limit]
    #[arg(long)]
    choose_ms: Option<f64>,
    /// Engines: exact, particle, and paper (Alg. 1 as printed: K = 100, plain cosine, its own action rule).
    #[arg(long, value_delimiter = ',', default_value = "exact,paper", value_parser = ["exact", "particle", "paper"])]
    engines: Vec<String>,
    /// How the next touch is chosen; the first is the one that stopping and latency are told for.
    #[arg(long, value_delimiter = ',', default_value = "information,paper,random", value_parser = ["paper", "information", "random"])]
    actions: Vec<String>,
    /// Episodes told touch by touch in the report.
    #[arg(long, default_value_t = 6)]
    stories: usize,
    /// Where the network is computed: flex or ndarray.
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Print evaluation.json instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    tuning: Tuning,
}

impl Evaluate {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let model = Model::load(&self.model, self.device.parse()?)?;
        let bank = Bank::load(&self.bank, &model)?;
        let simulator = Simulator::new(Scene::load(&self.scene)?, 1)?;
        // The no-contact frame of the robot's own session, not the bank's.
        let no_contact = simulator.no_contact(self.seeds.first().copied().unwrap_or(0) ^ 0x7265_7374);
        let eye = Eye::new(&model, &no_contact)?;
        let poses = if self.poses == "on-grid" { Poses::OnGrid } else { Poses::OffGrid };
        let (n_episodes, seeds, n_touches) = (self.episodes, self.seeds.clone(), self.touches);
        let protocol = Protocol { n_episodes, seeds, poses, absent: self.absent, choose_ms: self.choose_ms, n_touches };

        let mut rows = Vec::new();
        let single = |method, scored: &[Scored]| {
            summary::row(summary::Label { method, inference: Inference::None, action: Choice::None, poses }, 1, scored)
        };
        let mut flipped = None;
        if let Some(path) = &self.pegs {
            let pegs = Dataset::open(path)?;
            let scored = baselines::pixel(&simulator, &model, &bank, &pegs, &no_contact, &protocol)?;
            let [plain, inside_out] = scored.map(|scored| single(Method::Pixel, &scored));
            rows.push(plain);
            flipped = Some(inside_out);
        }
        rows.push(single(Method::Moco, &baselines::moco(&simulator, &eye, &bank, &protocol)?));

        let runs = self.configs(&model)?;
        let mut stops = Vec::new();
        let mut first: Option<(summary::Label, Vec<Outcome>)> = None;
        let mut comparisons = Vec::new();
        for (name, config) in &runs {
            let bar = progress(name);
            let outcomes = run(&simulator, &eye, &bank, config, &protocol, &|done, total| {
                bar.set_length(total as u64);
                bar.set_position(done as u64);
            })?;
            bar.finish_and_clear();
            let label = label(config, poses);
            rows.extend(summary::rows(label, &outcomes));
            stops.push(summary::stops(label, &outcomes, config));
            match &first {
                None => first = Some((label, outcomes)),
                Some((of, told)) if of.inference == label.inference && of.action != label.action => {
                    comparisons.extend(summary::compare((*of, told), (label, &outcomes)));
                }
                Some(_) => {}
            }
        }
        let Some((_, told)) = first else {
            return Err(Error::invalid("--engines and --actions", "at least one of each", "none"));
        };
        let evaluation = Evaluation {
            schema: SCHEMA.into(),
            scene: simulator.scene().name.clone(),
            n_classes: bank.parts().len(),
            n_episodes: self.episodes,
            seeds: self.seeds.clone(),
            absent: self.absent,
            model: ModelRecord {
                name: model.provenance().name.clone(),
                sha256: model.sha256().into(),
                parameters: model.n_parameters(),
                input_px: model.config().input_px,
            },
            device: self.device.clone(),
            n_threads: std::thread::available_parallelism().map_or(1, usize::from),
            rows,
            stopping: Stopping {
                mean_touches: stops[0].mean_touches,
                confident_and_wrong: stops[0].confident_and_wrong,
            },
            latency_ms: summary::latency(&told),
            stops,
            comparisons,
            reliability: summary::reliability(&told),
            parts: if self.absent { Vec::new() } else { summary::parts(bank.parts(), &told) },
            command: Some(command_line()),
        };
        let (_, config) = &runs[0];
        // An episode without its part has no truth to show.
        let n_stories = if self.absent { 0 } else { self.stories };
        let stories = story::tell(&simulator, &eye, &bank, config, &protocol, n_stories)?;
        self.write(&evaluation, &story::board(&simulator, &bank)?, &stories)?;
        if self.json {
            println!("{}", to_json(&evaluation)?);
        } else {
            print_table(&evaluation, flipped.as_ref(), &self.out);
        }
        Ok(())
    }

    /// Each engine with each rule; `paper` is Alg. 1, which brings its own rule.
    fn configs(&self, model: &Model) -> Result<Vec<(String, EpisodeConfig)>> {
        let mut configs = Vec::new();
        for engine in &self.engines {
            if engine == "paper" {
                configs.push(("Alg. 1 as printed".into(), self.tuning.config(engine, ActionRule::Paper, model)?));
                continue;
            }
            for action in &self.actions {
                configs.push((format!("{engine}, {action}"), self.tuning.config(engine, rule(action)?, model)?));
            }
        }
        Ok(configs)
    }

    fn write(&self, evaluation: &Evaluation, board: &Board, stories: &[EpisodeStory]) -> Result<()> {
        std::fs::create_dir_all(&self.out).map_err(Error::io(&self.out))?;
        let report = self.out.join("report.html");
        let paper = PaperNumbers::of_scene(&evaluation.scene);
        write_report(&report, evaluation, board, stories, &paper).map_err(Error::io(&report))?;
        // Last: whoever finds the figures finds the report too.
        Ok(write_whole(&self.out.join("evaluation.json"), to_json(evaluation)?.as_bytes())?)
    }
}

/// The command line as it was typed, without the folder of the program.
pub(super) fn command_line() -> String {
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

fn to_json(evaluation: &Evaluation) -> Result<String> {
    serde_json::to_string_pretty(evaluation).map_err(|e| Error::invalid("evaluation", "JSON", e.to_string()))
}

fn print_table(evaluation: &Evaluation, flipped: Option<&Row>, out: &Path) {
    println!("{}: {} episodes, {} parts", evaluation.scene, evaluation.n_episodes, evaluation.n_classes);
    println!(
        "  {:28} {:>2} {:>8} {:>15} {:>8} {:>7} {:>7}",
        "method", "n", "right %", "95 % interval", "cell %", "xy mm", "deg"
    );
    let print = |name: &str, row: &Row| {
        println!(
            "  {name:28} {:2} {:8.1} {:7.1}-{:<7.1} {:8.1} {:7.2} {:7.2}",
            row.n_touches,
            100.0 * row.accuracy,
            100.0 * row.accuracy_ci95[0],
            100.0 * row.accuracy_ci95[1],
            100.0 * row.exact_cell,
            row.xy_mm_mean,
            row.theta_deg_mean
        );
    };
    for row in evaluation.rows.iter().filter(|row| [1, 2, 3, 5, 10].contains(&row.n_touches)) {
        print(&format!("{:?}, {:?}, {:?}", row.method, row.inference, row.action).to_lowercase(), row);
    }
    if let Some(row) = flipped {
        print("pixel, sign-flipped", row);
    }
    for stops in &evaluation.stops {
        println!(
            "  {:28} stops after {:.2} touches; confident {:.1} %, of these wrong {:.1} %; none of these {:.1} %; 95 % sure after {:.2}",
            format!("{:?}, {:?}", stops.inference, stops.action).to_lowercase(),
            stops.mean_touches,
            100.0 * stops.confident,
            100.0 * stops.confident_and_wrong,
            100.0 * stops.none_of_these,
            stops.touches_to_95,
        );
    }
    for c in evaluation.comparisons.iter().filter(|c| [1, 2, 3, 5, 10].contains(&c.n_touches)) {
        let name = format!("{:?}, {:?} less {:?}", c.inference, c.action, c.against).to_lowercase();
        let [low, high] = c.ci95.map(|bound| 100.0 * bound);
        println!("  {name:38} n = {:2}: {:+.1} points ({low:+.1} to {high:+.1})", c.n_touches, 100.0 * c.difference);
    }
    for bin in &evaluation.reliability {
        let [low, high] = bin.right_ci95.map(|bound| 100.0 * bound);
        println!(
            "  {:5.1} % sure: {:5.1} % right ({low:.1}-{high:.1}), {} touches",
            100.0 * bin.mean_probability,
            100.0 * bin.right,
            bin.n
        );
    }
    for of in &evaluation.parts {
        let mistaken = of.mistaken_for.as_ref().map_or_else(String::new, |(part, n)| format!(", {n} taken for {part}"));
        let (n, right, part) = (of.n, of.n_right, &of.part);
        let (xy, theta) = (of.xy_mm_mean, of.theta_deg_mean);
        println!("  {part:28} {right} of {n} right{mistaken}; {xy:.2} mm, {theta:.2} degrees");
    }
    let ms = &evaluation.latency_ms;
    println!(
        "  ms p50/p99: encode {:.1}/{:.1}, update {:.2}/{:.2}, choose {:.1}/{:.1}",
        ms.encode.p50, ms.encode.p99, ms.update.p50, ms.update.p99, ms.select.p50, ms.select.p99
    );
    println!("  {}", out.join("report.html").display());
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

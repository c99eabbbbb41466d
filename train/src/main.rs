//! `tactile-train`: trains the part-mating model on a dataset of pairs.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::program;
use tactile_data::program::progress::{Progress, reporter};
use tactile_data::text::printable::printable_json;
use tactile_infer::calibration::touches_of_bank::TouchesOfBank;
use tactile_infer::maps::{MapDrawer, MapFile};
use tactile_infer::{Bank, Checkpoint, DeviceKind, Model};
use tactile_train::config::{Preset, TrainConfig};
use tactile_train::maps::{MapJudgement, MapRun, MapTraining, train_maps};
use tactile_train::output_folder::OutputFolder;
use tactile_train::pairs::{Pairs, n_training};
use tactile_train::run::{Event, Outcome, Run, train};
use tactile_train::settings::{HELP, Settings};
use tactile_train::training::Trained;
use tactile_train::tuning::Tuning;
use tactile_train::validation::Validation;
use tactile_train::verifier::{LaidTouches, VerifierJudgement, VerifierRun, VerifierTraining, train_verifier};
use tactile_train::{Error, Result};

/// Trains the part-mating model on a dataset of hole and peg pairs.
#[derive(Parser)]
#[command(
    version,
    after_help = format!(
        "{HELP}\n\nExamples:\n  tactile-data generate --scene maze --out maze\n  tactile-train --data maze --out model\n  \
         tactile-train --data maze --out wide --set width=48 --set flips=none"
    )
)]
struct Cli {
    /// Dataset of pairs, made by `tactile-data generate --scene maze` or imported.
    #[arg(long, required_unless_present = "verifier")]
    data: Option<PathBuf>,
    /// Folder for model.safetensors, state.safetensors, train.toml, curve.csv and curve.html.
    #[arg(long)]
    out: PathBuf,
    /// How much to train: tiny takes minutes on two cores, small 45 minutes, paper is for a GPU, fine takes ten minutes
    /// and begins with a trained model [default: tiny; with --from fine].
    #[arg(long)]
    preset: Option<Preset>,
    /// Steps of the whole run [default: the preset's].
    #[arg(long)]
    steps: Option<usize>,
    /// Pairs in a batch [default: the preset's].
    #[arg(long)]
    batch: Option<usize>,
    /// Seed of weights, batches and augmentation [default: 1].
    #[arg(long)]
    seed: Option<u64>,
    /// Any setting by its name, such as learning_rate=0.005; replaces the entry of --config. The names are listed
    /// below.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Settings in a TOML file, such as train.toml of an earlier run; flags replace its entries.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where to compute: flex (CPU, default), ndarray (older CPU backend, much slower) or wgpu (graphics card). The
    /// last two only in programs built with the feature of that name.
    #[arg(long, default_value_t, value_parser = program::named::<DeviceKind>(DeviceKind::NAMES))]
    device: DeviceKind,
    /// Fine-tune this trained model instead of beginning with random weights: its sizes and calibration are kept, and the
    /// preset is fine, or with another preset the learning rate a fifth of it, unless they are given.
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// Continue from the state in --out, with the settings it began with.
    #[arg(long)]
    resume: bool,
    /// Train the network that draws maps of touches instead, from pictures as this model sees them, on a simulated dataset:
    /// OUT/maps.safetensors. Of the settings it takes steps, batch, seed, width, input_px, learning_rate and save_every.
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["from", "resume", "tune", "write_batches", "preset"])]
    maps: Option<PathBuf>,
    /// Train the network that judges where touches were made instead, for the network of these maps: OUT/maps.safetensors, with
    /// both. --model and --touches say on what.
    #[arg(long, value_name = "MAPS", requires_all = ["model", "touches"],
          conflicts_with_all = ["data", "maps", "from", "resume", "tune", "write_batches", "preset"])]
    verifier: Option<PathBuf>,
    /// With --verifier: embeds the touches.
    #[arg(long, value_name = "FILE", requires = "verifier")]
    model: Option<PathBuf>,
    /// With --verifier: a bank with maps (tactile-infer bank --maps), and datasets of touches of its parts.
    #[arg(long, value_name = "BANK=DIR,...", num_args = 1.., requires = "verifier")]
    touches: Vec<TouchesOfBank>,
    /// Measure at each save how many holes of parts that are not trained on find their peg: a dataset of pegs on a grid
    /// of poses and one of holes of the same parts.
    #[arg(long, num_args = 2, value_names = ["PEGS", "HOLES"])]
    tune: Vec<PathBuf>,
    /// Print the outcome as JSON.
    #[arg(long)]
    json: bool,
    /// With --device wgpu: write which kernels the card was given in a step, and how long each took by the card's own clock, as
    /// CSV. Counts from step 32 on; the run is slower for it.
    #[cfg(feature = "wgpu")]
    #[arg(long, value_name = "FILE")]
    kernels: Option<PathBuf>,
    /// Train nothing: write the batches of all steps to standard output, for another trainer. Each is its number n of pairs
    /// (u32), then n images of holes and n of pegs (f32, [3, height, width]), little-endian.
    #[arg(long, conflicts_with_all = ["json", "resume", "tune", "device"])]
    write_batches: bool,
}

impl Cli {
    /// The dataset, without which nothing but a verifier is trained.
    fn data(&self) -> &Path {
        self.data.as_deref().unwrap_or(Path::new(""))
    }
}

fn main() -> ExitCode {
    keep_memory();
    let cli = Cli::parse();
    program::run(|| match &cli.maps {
        _ if cli.write_batches => write_batches(&cli).map(|()| ExitCode::SUCCESS),
        Some(model) => run_maps(&cli, model),
        None => match (&cli.verifier, &cli.model) {
            (Some(maps), Some(model)) => run_verifier(&cli, maps, model),
            _ => run(&cli),
        },
    })
}

/// Keeps what a step has freed for the next: given back to the system and asked for again, every page is cleared anew (a
/// tenth of a step's time).
fn keep_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Bytes: more than a step's largest tensor and all of its tensors together.
        const MOST: libc::c_int = 1 << 30;
        #[expect(unsafe_code, reason = "two settings of the allocator, before any thread is started; they cannot fail")]
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, MOST);
            libc::mallopt(libc::M_TRIM_THRESHOLD, MOST);
        }
    }
}

fn run(cli: &Cli) -> Result<ExitCode> {
    let settings = settings(cli)?;
    // Wrong settings, devices and folders are found before the datasets are read.
    let within = settings.resolve(1)?.mating();
    let device = cli.device;
    let config_file = cli.config.as_ref().filter(|_| !cli.resume);
    let inputs = [cli.data.as_ref(), config_file, cli.from.as_ref()].into_iter().flatten().chain(&cli.tune);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    let out = OutputFolder::claim(&cli.out, &inputs)?;
    let from = cli.from.as_deref().map(Checkpoint::load).transpose()?.map(|(checkpoint, _)| checkpoint);
    let dataset = Dataset::open(cli.data())?;
    let config = fine_tuned(settings.resolve(n_training(&dataset, within))?, &settings, from.as_ref());
    let parts = cli.tune.iter().map(|path| Dataset::open(path)).collect::<tactile_data::Result<Vec<Dataset>>>()?;
    let tuning = if let [pegs, holes] = &parts[..] { Some(Tuning::new(pegs, holes)?) } else { None };
    let stop = stop_on_ctrl_c()?;
    let mut display = Display { progress: Progress::new("steps"), last: None };
    let run = Run {
        dataset: &dataset,
        tuning: tuning.as_ref(),
        out: &out,
        config: &config,
        device,
        resume: cli.resume,
        from: from.as_ref(),
    };
    #[cfg(feature = "wgpu")]
    let mut kernels = Kernels::new(cli.kernels.as_deref());
    let mut show = |event: Event<'_>| {
        #[cfg(feature = "wgpu")]
        kernels.note(&event);
        display.show(event);
    };
    let outcome = train(&run, &|| stop.load(Ordering::Relaxed), &mut show)?;
    #[cfg(feature = "wgpu")]
    kernels.write()?;
    print(&outcome, cli.json);
    if outcome.finished {
        return Ok(ExitCode::SUCCESS);
    }
    eprintln!("stopped after step {}; continue with --resume", outcome.step);
    Ok(ExitCode::FAILURE)
}

/// Trains the network that draws maps.
fn run_maps(cli: &Cli, model: &Path) -> Result<ExitCode> {
    let training = &MapTraining::of(&settings(cli)?)?;
    let device = cli.device;
    let inputs = [cli.data.as_deref(), Some(model), cli.config.as_deref()];
    let out = &OutputFolder::claim(&cli.out, &inputs.into_iter().flatten().collect::<Vec<_>>())?;
    let (model, _) = &Checkpoint::load(model)?;
    let dataset = &Dataset::open(cli.data())?;
    let stop = stop_on_ctrl_c()?;
    let mut show = show_steps(training.n_steps, said_of_maps);
    let run = MapRun { dataset, model, training, device, out };
    let trained = train_maps(&run, &|| stop.load(Ordering::Relaxed), &mut show)?;
    Ok(print_trained(cli, &trained, training.n_steps, said_of_maps))
}

/// Shows the steps of a run of so many, and what each save is worth as `said` has it.
fn show_steps<J>(n_steps: usize, said: fn(&J) -> String) -> impl FnMut(usize, f64, Option<J>) {
    let progress = Progress::new("steps");
    move |step, loss, found| {
        progress.on_bar(step, n_steps, &format!("loss {loss:.3}"));
        if let Some(found) = found {
            progress.line(&format!("step {step}: loss {loss:.3}, {}", said(&found)));
        }
    }
}

/// Prints how a run of so many steps ended; a failure where it stopped before.
fn print_trained<J: Serialize>(cli: &Cli, trained: &Trained<J>, n_steps: usize, said: fn(&J) -> String) -> ExitCode {
    let Trained { file, step, judgement } = trained;
    if cli.json {
        let json = serde_json::json!({ "maps": file, "step": step, "judgement": judgement });
        println!("{}", printable_json(&json.to_string()));
    } else {
        program::say(format_args!("{}: {step} steps, {}", file.display(), said(judgement)));
    }
    if *step == n_steps { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// How well maps are drawn, in a line.
fn said_of_maps(found: &MapJudgement) -> String {
    let MapJudgement { distance_mm, inside, contact, nats } = found;
    format!(
        "held-out boards: {distance_mm:.2} mm off the outline, {:.1} % inside or outside, {:.1} % contact, {nats:.3} nats a place",
        100.0 * inside,
        100.0 * contact
    )
}

/// Trains the network that judges where touches were made.
fn run_verifier(cli: &Cli, maps: &Path, model: &Path) -> Result<ExitCode> {
    let training = &VerifierTraining::of(&settings(cli)?)?;
    let device = cli.device;
    let read = cli.touches.iter().flat_map(|of| of.datasets.iter().chain([&of.bank])).map(PathBuf::as_path);
    let out =
        &OutputFolder::claim(&cli.out, &read.chain([maps, model]).chain(cli.config.as_deref()).collect::<Vec<_>>())?;
    // Before the touches are drawn, which takes minutes.
    out.new_maps()?;
    let (model, maps) = (Model::load(model)?, &MapFile::load(maps)?);
    let drawer = MapDrawer::new(maps)?;
    let mut touches = LaidTouches::new(&model, &drawer, training.seed);
    for TouchesOfBank { bank: path, datasets } in &cli.touches {
        let datasets = datasets.iter().map(|path| Dataset::open(path)).collect::<tactile_data::Result<Vec<_>>>()?;
        let bank = Bank::load(path, &model)?;
        touches.add(&bank, &datasets, &reporter("touches"))?;
    }
    let touches = &touches;
    let stop = stop_on_ctrl_c()?;
    let mut show = show_steps(training.n_steps, said_of_verifier);
    let run = VerifierRun { touches, maps, training, device, out };
    let trained = train_verifier(&run, &|| stop.load(Ordering::Relaxed), &mut show)?;
    Ok(print_trained(cli, &trained, training.n_steps, said_of_verifier))
}

/// How well touches are judged, in a line.
fn said_of_verifier(found: &VerifierJudgement) -> String {
    let VerifierJudgement { nats, right, right_by_cosine, told_apart } = found;
    format!(
        "held-out parts: {:.1} % named by one touch (by the cosine {:.1}), told from what is not there {:.3}, {nats:.3} nats",
        100.0 * right,
        100.0 * right_by_cosine,
        told_apart
    )
}

/// Set once ctrl-C is pressed.
fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed))
        .map_err(|e| Error::invalid("ctrl-C handler", "one in this process", e.to_string()))?;
    Ok(stop)
}

/// The kernels of a run's later steps.
#[cfg(feature = "wgpu")]
struct Kernels<'a> {
    file: Option<&'a Path>,
    launches: Option<tactile_train::launches::Launches>,
    table: Option<String>,
}

#[cfg(feature = "wgpu")]
impl<'a> Kernels<'a> {
    /// By then every kernel is chosen and compiled.
    const FIRST_STEP: usize = 32;

    fn new(file: Option<&'a Path>) -> Self {
        Self { file, launches: None, table: None }
    }

    fn note(&mut self, event: &Event<'_>) {
        let Event::Step { step, n_steps, .. } = event else { return };
        if self.file.is_some() && *step == Self::FIRST_STEP {
            self.launches = Some(tactile_train::launches::Launches::count(true));
        }
        if step == n_steps {
            self.table = self.launches.take().map(|launches| launches.table(n_steps - Self::FIRST_STEP));
        }
    }

    fn write(self) -> Result<()> {
        let (Some(file), Some(table)) = (self.file, self.table) else { return Ok(()) };
        std::fs::write(file, table).map_err(Error::io(file))
    }
}

/// The settings of a run that fine-tunes a model: its sizes where none are given, and small steps.
fn fine_tuned(config: TrainConfig, given: &Settings, from: Option<&Checkpoint>) -> TrainConfig {
    /// By how much smaller the steps are: the steps of a fresh network would undo what was learnt.
    const GENTLER: f64 = 5.0;
    let Some(from) = from else { return config };
    let gentler = if config.preset == Preset::Fine { 1.0 } else { GENTLER };
    let has_sizes = [given.width, given.hidden, given.dim].iter().any(Option::is_some) || given.input_px.is_some();
    let network = if has_sizes { config.network } else { from.config };
    let learning_rate = given.learning_rate.unwrap_or(config.learning_rate / gentler);
    TrainConfig { network, learning_rate, ..config }
}

/// Writes the batches of a run to standard output.
fn write_batches(cli: &Cli) -> Result<()> {
    let dataset = Dataset::open(cli.data())?;
    let settings = settings(cli)?;
    let config = settings.resolve(n_training(&dataset, settings.resolve(1)?.mating()))?;
    let pairs = Pairs::new(&dataset, &config)?;
    let mut out = std::io::stdout().lock();
    for step in 0..config.n_steps {
        let batch = pairs.batch(&config, step)?;
        // At most 65,536 pairs are in a batch.
        let mut bytes = (batch.n_pairs as u32).to_le_bytes().to_vec();
        [batch.holes, batch.pegs].iter().flatten().for_each(|value| bytes.extend(value.to_le_bytes()));
        out.write_all(&bytes).map_err(Error::io("standard output"))?;
    }
    out.flush().map_err(Error::io("standard output"))
}

/// Flags over `--set` over the file; the file of a run that is resumed is its own.
fn settings(cli: &Cli) -> Result<Settings> {
    let own = Some(cli.out.join("train.toml")).filter(|path| cli.resume && path.exists());
    let file = cli.config.clone().or(own).map(|path| Settings::load(&path)).transpose()?;
    let set = cli.set.iter().try_fold(Settings::default(), |settings, pair| settings.set(pair))?;
    if cli.steps.is_some() && set.epochs.is_some() {
        return Err(Error::invalid("--steps", "steps or --set epochs", "both"));
    }
    let flags =
        Settings { preset: cli.preset, steps: cli.steps, batch: cli.batch, seed: cli.seed, ..Settings::default() };
    let mut settings = flags.over(&set)?.over(&file.unwrap_or_default())?;
    if cli.from.is_some() {
        settings.preset = settings.preset.or(Some(Preset::Fine));
    } else if settings.preset == Some(Preset::Fine) && !cli.resume {
        return Err(Error::invalid("--preset fine", "a trained model to begin with, --from MODEL", "none"));
    }
    Ok(settings)
}

fn print(outcome: &Outcome, json: bool) {
    let Outcome { model, sha256, step, finished, validation } = outcome;
    if json {
        let json = serde_json::json!({
            "model": model, "sha256": sha256, "step": step, "finished": finished, "validation": validation,
        });
        println!("{}", printable_json(&json.to_string()));
    } else {
        program::say(format_args!("{}: {step} steps, {}", model.display(), measures(validation)));
    }
}

/// How good a model is, in a line.
fn measures(found: &Validation) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let near = found.near_1.zip(found.near_chance).map_or(String::new(), |(near, chance)| {
        format!(", {} among near neighbours (chance {})", percent(near), percent(chance))
    });
    let tuning = found.tuning_accuracy.map_or(String::new(), |share| format!(", tuning parts {}", percent(share)));
    let (first, five) = (percent(found.retrieval_1), percent(found.retrieval_5));
    format!("held-out retrieval@1 {first}, @5 {five} of {}{near}{tuning}", found.n_holes)
}

/// A run as it is shown: a bar on a terminal, and a line for each checkpoint.
struct Display {
    progress: Progress,
    /// Loss, pairs per second and seconds left of the last step.
    last: Option<(f64, f64, f64)>,
}

impl Display {
    fn show(&mut self, event: Event<'_>) {
        match event {
            Event::Step { step, n_steps, loss, pairs_per_second, seconds_left } => {
                self.last = Some((loss, pairs_per_second, seconds_left));
                let words = format!("loss {loss:.3}, {pairs_per_second:.0} pairs/s");
                self.progress.on_bar(step, n_steps, &words);
            }
            Event::Saved { step, validation } => {
                let (loss, speed, left) = self.last.unwrap_or_default();
                let Validation { cosine_gap, spread, .. } = validation;
                self.progress.line(&format!(
                    "step {step}: loss {loss:.3}, {}, cosine gap {cosine_gap:.2}, spread {spread:.2}, {speed:.0} pairs/s, \
                     {} left",
                    measures(validation),
                    duration(left)
                ));
            }
            Event::Note(text) => self.progress.line(&format!("pairs: {text}")),
            Event::Warning { step, text } => self.progress.line(&format!("warning at step {step}: {text}")),
        }
    }
}

/// Seconds as seconds, minutes or hours.
fn duration(seconds: f64) -> String {
    match seconds {
        ..90.0 => format!("{seconds:.0} s"),
        ..5_400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3_600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_that_would_do_nothing_is_refused() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
        let takes = |line: &str| {
            let line = format!("tactile-train --data d --out o {line}");
            Cli::try_parse_from(line.split_whitespace()).is_ok()
        };
        assert!(takes("--json --tune p h --device flex") && takes("--write-batches --batch 8 --set width=4"));
        for flag in ["--json", "--tune p h", "--device flex"] {
            assert!(!takes(&format!("--write-batches {flag}")), "{flag}");
        }
        assert!(!takes("--tune p"));
    }
}

//! The training run: the visible loop, its checkpoints, and resuming.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use tactile_data::dataset::store::Dataset;
use tactile_infer::Model;
use tactile_infer::calibration::Calibration;
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::embedding::checkpoint::Provenance;
use tactile_infer::embedding::network::is_card;
use tactile_infer::safefile::write_whole;
use tactile_infer::{Checkpoint, DeviceKind};

use crate::config::TrainConfig;
use crate::curve_page::{CurvePage, Progress};
use crate::divergence::{self, Divergence};
use crate::error::{Error, Result};
use crate::feed::{Feed, Prepared};
use crate::gradient;
use crate::history::{History, Row};
use crate::output_folder::{CURVE, MODEL, OutputFolder, PAGE, SETTINGS, STATE};
use crate::pairs::Pairs;
use crate::schedule::{encoder_momentum, learning_rate};
use crate::state::State;
use crate::timing::Timing;
use crate::tuning::Tuning;
use crate::validation::{Validation, n_images, validate};

/// A run's inputs and its output folder.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Pairs to train on, with its held-out boards.
    pub dataset: &'a Dataset,
    /// Parts that are not trained on, to measure the accuracy at each save.
    pub tuning: Option<&'a Tuning<'a>>,
    /// Folder for `model.safetensors`, `state.safetensors`, `train.toml`, `curve.csv` and `curve.html`.
    pub out: &'a OutputFolder,
    /// The settings.
    pub config: &'a TrainConfig,
    /// Where to compute.
    pub device: DeviceKind,
    /// Continue from the state in `out`.
    pub resume: bool,
    /// Start from the weights of this trained model instead of random ones; of the settings' sizes. A resumed run has its
    /// own.
    pub from: Option<&'a Checkpoint>,
}

/// What happens during a run.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A step was made.
    Step {
        /// Steps made so far.
        step: usize,
        /// Steps of the whole run.
        n_steps: usize,
        /// Loss of this step.
        loss: f64,
        /// Speed over the last steps, without validation.
        pairs_per_second: f64,
        /// Time until the end at the recent speed, validations included, seconds.
        seconds_left: f64,
    },
    /// A checkpoint was saved.
    Saved {
        /// Steps made so far.
        step: usize,
        /// Measured on the held-out boards.
        validation: &'a Validation,
    },
    /// Something about the pairs that a person should know.
    Note(&'a str),
    /// The run continues, but a person should look at it.
    Warning {
        /// Steps made so far.
        step: usize,
        /// What was seen.
        text: &'a str,
    },
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The checkpoint written last.
    pub model: PathBuf,
    /// Its checksum.
    pub sha256: String,
    /// Steps made.
    pub step: usize,
    /// Whether all steps were made; otherwise the run was asked to stop.
    pub finished: bool,
    /// The last validation.
    pub validation: Validation,
}

/// Trains, and saves every `save_every` steps. `should_stop` is asked before each step; where it returns true the
/// run saves and returns.
///
/// # Errors
/// Settings or data that make no run; a run that diverges ([`Error::Diverged`]) or cannot save
/// ([`Error::NotSaved`]), which keep the last good checkpoint.
pub fn train(run: &Run<'_>, should_stop: &dyn Fn() -> bool, on_event: &mut dyn FnMut(Event<'_>)) -> Result<Outcome> {
    let Run { dataset, config, .. } = *run;
    config.validate()?;
    if let Some(tuning) = run.tuning {
        tuning.check_unseen(dataset)?;
    }
    let device = run.device.open()?.autodiff();
    let pairs = Pairs::new(dataset, config)?;
    config.check_memory(pairs.training.len())?;
    let state = begin(run, &device)?;
    write_whole(&run.out.file(SETTINGS), config.to_toml()?.as_bytes())?;
    for text in &pairs.notes {
        on_event(Event::Note(text));
    }
    if let Some(text) = &pairs.warning {
        on_event(Event::Warning { step: state.step, text });
    }
    let mut results = Results {
        run,
        pairs: &pairs,
        history: History::open(&run.out.file(CURVE), state.step)?,
        kept: run.resume.then_some(state.step),
        calibration: inherited(run)?,
        last: None,
    };
    let state = steps(state, &mut results, should_stop, on_event).inspect_err(|error| {
        // The reason matters more than whether the page could be written.
        drop(results.draw(Progress::Failed(&error.to_string())));
    })?;
    let (sha256, validation) = match results.last.take() {
        Some((step, sha256, validation)) if step == state.step => (sha256, validation),
        _ => {
            let validation = results.measure(&state)?;
            (results.save(&state, &validation)?, validation)
        }
    };
    let finished = state.step == config.n_steps;
    results.draw(if finished { Progress::Finished } else { Progress::Interrupted })?;
    Ok(Outcome { model: run.out.file(MODEL), sha256, step: state.step, finished, validation })
}

/// The state to start from: that in the folder, or a new one where the folder has no model.
fn begin(run: &Run<'_>, device: &Device) -> Result<State> {
    if run.resume {
        return State::load(&run.out.file(STATE), run.config, run.dataset.frames_sha256(), device);
    }
    for (name, got) in [(STATE, "the state of an earlier run"), (MODEL, "the model of an earlier run")] {
        let path = run.out.file(name);
        if path.exists() {
            return Err(Error::invalid(path.display().to_string(), "an empty --out, or --resume to continue", got));
        }
    }
    let state = State::new(run.config, device)?;
    let Some(from) = run.from else { return Ok(state) };
    if from.config != run.config.network {
        let sizes = |of: &NetworkConfig| format!("{of:?}");
        return Err(Error::invalid("sizes of the network", sizes(&from.config), sizes(&run.config.network)));
    }
    Ok(State { moco: state.moco.with_weights(&from.tensors)?, ..state })
}

/// The calibration of the model that is fine-tuned, until the new one has its own; the calibration of the folder's
/// model where a run continues.
fn inherited(run: &Run<'_>) -> Result<Option<Calibration>> {
    let own = run.out.file(MODEL);
    if run.resume && own.exists() {
        return Ok(Checkpoint::load(&own)?.0.calibration);
    }
    Ok(run.from.and_then(|from| from.calibration.clone()))
}

/// The loop: batch, loss, gradient, step, momentum, log.
fn steps(
    mut state: State,
    results: &mut Results<'_>,
    should_stop: &dyn Fn() -> bool,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<State> {
    let (config, pairs) = (results.run.config, results.pairs);
    let device = results.run.device.tensor_device().autodiff();
    let mut timing = Timing::new(config.n_pairs, n_images(pairs) + results.run.tuning.map_or(0, Tuning::n_images));
    let first_step = state.step;
    let feed = Feed::new(pairs, config, &device)?;
    std::thread::scope(|scope| {
        // One batch is made ahead while the step before it runs.
        let (sender, batches) = sync_channel::<Result<Prepared>>(1);
        let feed = &feed;
        scope.spawn(move || {
            for step in first_step..config.n_steps {
                if sender.send(feed.prepare(step)).is_err() {
                    return; // The run stopped early.
                }
            }
        });
        let mut unread = Vec::new();
        while state.step < config.n_steps && !should_stop() {
            let started = Instant::now();
            let Some(batch) = next(&batches) else { break };
            let micro_batches = feed.micro_batches(&batch?, &device);
            let (loss, gradients) = state.moco.gradients(micro_batches, config.temperature);
            let gradient_norm = gradient::norm(&state.moco.online, &gradients);
            let learning_rate = learning_rate(state.step, config.n_warmup, config.n_steps, config.learning_rate);
            let momentum = encoder_momentum(state.step, config.n_steps, config.momentum);
            state.moco.online = state.optimizer.step(learning_rate, state.moco.online, gradients);
            state.moco = state.moco.follow(momentum);
            state.step += 1;
            unread.push(Made { step: state.step, loss, gradient_norm, learning_rate, momentum });

            let is_save = state.step.is_multiple_of(config.save_every) || state.step == config.n_steps;
            if !is_save && unread.len() < steps_between_reads(&device) {
                timing.step(started.elapsed().as_secs_f64());
                continue;
            }
            let read = Made::read(std::mem::take(&mut unread));
            timing.step(started.elapsed().as_secs_f64());
            let pairs_per_second = timing.pairs_per_second();
            for row in read.into_iter().map(|row| Row { pairs_per_second, ..row }) {
                let step = row.step;
                results.check(step, divergence::of_gradient(row.loss, row.gradient_norm))?;
                let seconds_left = timing.seconds_left(step, config.n_steps, config.save_every);
                on_event(Event::Step { step, n_steps: config.n_steps, loss: row.loss, pairs_per_second, seconds_left });
                if is_save && step == state.step {
                    let started = Instant::now();
                    results.checkpoint(&state, row, on_event)?;
                    timing.save(started.elapsed().as_secs_f64());
                } else {
                    results.note(row)?;
                    results.check(step, divergence::of_steps(results.history.rows(), config))?;
                }
            }
        }
        for row in Made::read(unread) {
            results.check(row.step, divergence::of_gradient(row.loss, row.gradient_norm))?;
            results.note(Row { pairs_per_second: timing.pairs_per_second(), ..row })?;
        }
        drop(batches);
        Ok(state)
    })
}

/// A step that was made, its numbers still where they were computed.
struct Made {
    step: usize,
    loss: Tensor<1>,
    gradient_norm: Option<Tensor<1>>,
    learning_rate: f64,
    momentum: f64,
}

impl Made {
    /// The rows of the curve, all read at once; their speed is the caller's.
    fn read(made: Vec<Self>) -> Vec<Row> {
        if made.is_empty() {
            return Vec::new();
        }
        let numbers = made.iter().flat_map(|made| {
            let norm = made.gradient_norm.clone().map_or_else(|| made.loss.zeros_like(), Tensor::inner);
            [made.loss.clone(), norm]
        });
        // f32 by construction.
        let numbers = Tensor::cat(numbers.collect(), 0).into_data().try_into_vec::<f32>().unwrap_or_default();
        let rows = made.iter().zip(numbers.chunks_exact(2)).map(|(made, numbers)| Row {
            step: made.step,
            loss: f64::from(numbers[0]),
            learning_rate: made.learning_rate,
            momentum: made.momentum,
            gradient_norm: f64::from(numbers[1]),
            pairs_per_second: 0.0,
            validation: None,
        });
        rows.collect()
    }
}

/// Steps whose numbers are read together. A graphics card works ahead of the program, and a reading waits for it.
fn steps_between_reads(device: &Device) -> usize {
    const ON_A_CARD: usize = 16;
    if is_card(device) { ON_A_CARD } else { 1 }
}

/// The next batch; `None` after the last. A thread of a rayon pool helps to make it while it waits: a pool of one thread
/// would wait for ever otherwise.
fn next(batches: &Receiver<Result<Prepared>>) -> Option<Result<Prepared>> {
    const PATIENCE: Duration = Duration::from_micros(100);
    loop {
        match batches.recv_timeout(PATIENCE) {
            Ok(batch) => return Some(batch),
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) => while rayon::yield_now() == Some(rayon::Yield::Executed) {},
        }
    }
}

/// What a run writes, and what of it is safe on disk.
struct Results<'a> {
    run: &'a Run<'a>,
    pairs: &'a Pairs<'a>,
    history: History,
    /// Step of the checkpoint in the folder.
    kept: Option<usize>,
    /// What is believed of the model's cosines before it is calibrated.
    calibration: Option<Calibration>,
    /// Step, checksum and validation of the last save.
    last: Option<(usize, String, Validation)>,
}

impl Results<'_> {
    /// Measures and saves the model after a step.
    fn checkpoint(&mut self, state: &State, row: Row, on_event: &mut dyn FnMut(Event<'_>)) -> Result<()> {
        let (step, config) = (state.step, self.run.config);
        let validation = self.measure(state)?;
        self.note(Row { validation: Some(validation.clone()), ..row })?;
        let rows = self.history.rows();
        self.check(step, divergence::of_steps(rows, config).or_else(|| divergence::of_validations(rows, config)))?;
        self.save(state, &validation)?;
        self.draw(Progress::Running)?;
        on_event(Event::Saved { step, validation: &validation });
        if let Some(text) = divergence::concern(self.history.rows(), config) {
            on_event(Event::Warning { step, text: &text });
        }
        Ok(())
    }

    /// How good the model is now.
    fn measure(&self, state: &State) -> Result<Validation> {
        let Run { config, device, .. } = *self.run;
        let network = state.moco.online.valid();
        let mut validation = validate(&network, self.pairs, &device.tensor_device())?;
        if let Some(tuning) = self.run.tuning {
            let preprocessing = self.pairs.preprocessing.clone();
            let checkpoint = Checkpoint::of(&network, config.network, preprocessing, Provenance::default());
            validation.tuning_accuracy = Some(tuning.accuracy(&Model::new(checkpoint, String::new(), device)?)?);
        }
        Ok(validation)
    }

    /// Adds a step to the curve.
    fn note(&mut self, row: Row) -> Result<()> {
        let step = row.step;
        self.history.push(row).map_err(|error| self.not_saved(step, error))
    }

    /// Writes the model, then the state: a stop between the two costs at most the steps between them. A network
    /// with values or embeddings that are not finite is never written.
    fn save(&mut self, state: &State, validation: &Validation) -> Result<String> {
        let Run { dataset, config, out, .. } = *self.run;
        let not_finite = state.first_not_finite().map(divergence::of_tensor);
        self.check(state.step, not_finite.or_else(|| divergence::of_embeddings(validation)))?;
        let provenance = Provenance {
            name: config.preset.to_string(),
            steps: state.step,
            batch: config.n_pairs,
            seed: config.seed,
            dataset: dataset.meta().name.clone(),
            retrieval: validation.retrieval_1,
        };
        let network = state.moco.online.valid();
        let checkpoint = Checkpoint::of(&network, config.network, self.pairs.preprocessing.clone(), provenance);
        let checkpoint = Checkpoint { calibration: self.calibration.clone(), ..checkpoint };
        let model = checkpoint.save(&out.file(MODEL));
        let sha256 = model.map_err(|error| self.not_saved(state.step, error.into()))?;
        self.kept = Some(state.step);
        let saved = state.save(&out.file(STATE), config, dataset.frames_sha256());
        saved.map_err(|error| self.not_saved(state.step, error))?;
        self.last = Some((state.step, sha256.clone(), validation.clone()));
        Ok(sha256)
    }

    /// Draws the curves.
    fn draw(&self, progress: Progress<'_>) -> Result<()> {
        let Run { dataset, config, out, .. } = *self.run;
        let tuning_chance = self.run.tuning.map(Tuning::chance);
        let dataset = &dataset.meta().name;
        let page = CurvePage { dataset, config, pairs: self.pairs, tuning_chance, rows: self.history.rows() };
        Ok(write_whole(&out.file(PAGE), page.render(progress)?.as_bytes())?)
    }

    /// Stops a run that has diverged.
    fn check(&self, step: usize, divergence: Option<Divergence>) -> Result<()> {
        match divergence {
            Some(Divergence { seen, advice }) => Err(Error::Diverged { step, seen, advice, kept: self.kept }),
            None => Ok(()),
        }
    }

    fn not_saved(&self, step: usize, source: Error) -> Error {
        Error::NotSaved { step, kept: self.kept, source: Box::new(source) }
    }
}

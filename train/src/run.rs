//! The training run: the loop in full view, its checkpoints, and how it goes on after a stop.

use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;
use std::time::Instant;

use burn::module::Module;
use tactile_data::store::Dataset;
use tactile_infer::checkpoint::{Model, Provenance};
use tactile_infer::{Checkpoint, DeviceKind};

use crate::batch::Batch;
use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::gradient;
use crate::health::{self, Sickness};
use crate::history::{History, Row};
use crate::letters::Letters;
use crate::pace::Pace;
use crate::page::{self, End};
use crate::pairs::Pairs;
use crate::schedule::{encoder_momentum, learning_rate};
use crate::settings::Settings;
use crate::state::State;
use crate::validate::{Validation, n_images, validate};

/// What is trained on what, and where it goes.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Pairs to train on, with its held-out boards.
    pub dataset: &'a Dataset,
    /// Parts never trained on, to measure on at each save.
    pub letters: Option<&'a Letters<'a>>,
    /// Folder for `model.safetensors`, `state.safetensors`, `train.toml`, `curve.csv` and `curve.html`.
    pub out: &'a Path,
    /// The settings.
    pub config: &'a TrainConfig,
    /// Where to compute.
    pub device: DeviceKind,
    /// Go on from the state in `out`.
    pub resume: bool,
}

/// What a run tells while it goes on.
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
    /// A checkpoint was saved; how good it is.
    Saved {
        /// Steps made so far.
        step: usize,
        /// Measured on the held-out boards.
        validation: &'a Validation,
    },
    /// The run goes on, but somebody should look at it.
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

/// Trains, and saves at each `save_every` steps. `should_stop` is asked before each step; where it says yes the
/// run saves and returns.
///
/// # Errors
/// Settings or data that make no run; a run that falls ill ([`Error::Unwell`]) or cannot save
/// ([`Error::NotSaved`]), which leave the checkpoint before.
pub fn train(run: &Run<'_>, should_stop: &dyn Fn() -> bool, on_event: &mut dyn FnMut(Event<'_>)) -> Result<Outcome> {
    let Run { dataset, config, .. } = *run;
    config.validate()?;
    if let Some(letters) = run.letters {
        letters.check_unseen(dataset)?;
    }
    let device = run.device.open()?.autodiff();
    let pairs = Pairs::new(dataset, config)?;
    std::fs::create_dir_all(run.out).map_err(Error::io(run.out))?;
    let state_path = run.out.join("state.safetensors");
    let state = match (run.resume, state_path.exists()) {
        (true, _) => State::load(&state_path, config, dataset.frames_sha256(), &device)?,
        (false, true) => {
            let what = state_path.display().to_string();
            return Err(Error::invalid(what, "an empty --out, or --resume to go on", "the state of an earlier run"));
        }
        (false, false) => State::new(config, &device)?,
    };
    Settings::save(config, &run.out.join("train.toml"))?;
    if let Some(text) = &pairs.warning {
        on_event(Event::Warning { step: state.step, text });
    }
    let images_a_save = n_images(&pairs) + run.letters.map_or(0, Letters::n_images);
    let mut results = Results {
        run,
        pairs: &pairs,
        history: History::open(&run.out.join("curve.csv"), state.step)?,
        kept: run.resume.then_some(state.step),
        last: None,
    };
    let mut pace = Pace::new(config.n_pairs, images_a_save);
    let ended = steps(state, &mut results, &mut pace, should_stop, on_event);
    let state = match ended {
        Ok(state) => state,
        Err(error) => {
            // What stopped the run matters more than whether the page could be written.
            drop(results.draw(End::Stopped(&error.to_string())));
            return Err(error);
        }
    };
    let (sha256, validation) = match results.last.take() {
        Some((step, sha256, validation)) if step == state.step => (sha256, validation),
        _ => {
            let validation = results.measure(&state)?;
            (results.save(&state, &validation)?, validation)
        }
    };
    let finished = state.step == config.n_steps;
    results.draw(if finished { End::Finished } else { End::Asked })?;
    Ok(Outcome { model: run.out.join("model.safetensors"), sha256, step: state.step, finished, validation })
}

/// The loop: batch, loss, gradient, step, momentum, log.
fn steps(
    mut state: State,
    results: &mut Results<'_>,
    pace: &mut Pace,
    should_stop: &dyn Fn() -> bool,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<State> {
    let (config, pairs) = (results.run.config, results.pairs);
    let device = results.run.device.tensor_device().autodiff();
    let first_step = state.step;
    std::thread::scope(|scope| {
        // One batch is made ahead while the step before it runs.
        let (sender, batches) = sync_channel::<Result<Batch>>(1);
        scope.spawn(move || {
            for step in first_step..config.n_steps {
                if sender.send(pairs.batch(config, step)).is_err() {
                    return; // The run stopped early.
                }
            }
        });
        while state.step < config.n_steps && !should_stop() {
            let started = Instant::now();
            let Ok(batch) = batches.recv() else { break };
            let batch = batch?;
            let shards = batch.shards(config.n_shards, config.network.input_px, &device);
            let (loss, gradients) = state.moco.gradients(shards, config.temperature, batch.mask(&device));
            let gradient_norm = gradient::norm(&state.moco.online, &gradients);
            results.check(state.step + 1, health::of_gradient(loss, gradient_norm))?;
            let rate = learning_rate(state.step, config.n_warmup, config.n_steps, config.learning_rate);
            let momentum = encoder_momentum(state.step, config.n_steps, config.momentum);
            state.moco.online = state.optimizer.step_multi(rate, state.moco.online, gradients);
            state.moco = state.moco.follow(momentum);
            state.step += 1;
            pace.step(started.elapsed().as_secs_f64());

            let step = state.step;
            let pairs_per_second = pace.pairs_per_second();
            let seconds_left = pace.seconds_left(step, config.n_steps, config.save_every);
            on_event(Event::Step { step, n_steps: config.n_steps, loss, pairs_per_second, seconds_left });
            let row =
                Row { step, loss, learning_rate: rate, momentum, gradient_norm, pairs_per_second, validation: None };
            if !step.is_multiple_of(config.save_every) && step != config.n_steps {
                results.note(row)?;
                results.check(step, health::of_steps(results.history.rows(), config))?;
                continue;
            }
            let started = Instant::now();
            let validation = results.measure(&state)?;
            results.note(Row { validation: Some(validation.clone()), ..row })?;
            let rows = results.history.rows();
            let sickness = health::of_steps(rows, config).or_else(|| health::of_validations(rows, config));
            results.check(step, sickness)?;
            results.save(&state, &validation)?;
            results.draw(End::Running)?;
            pace.save(started.elapsed().as_secs_f64());
            on_event(Event::Saved { step, validation: &validation });
            if let Some(text) = health::concern(results.history.rows(), config) {
                on_event(Event::Warning { step, text: &text });
            }
        }
        drop(batches);
        Ok(state)
    })
}

/// What a run writes, and what of it is safe on disk.
struct Results<'a> {
    run: &'a Run<'a>,
    pairs: &'a Pairs<'a>,
    history: History,
    /// Step of the checkpoint in the folder.
    kept: Option<usize>,
    /// Step, checksum and validation of the last save.
    last: Option<(usize, String, Validation)>,
}

impl Results<'_> {
    /// How good the model is now.
    fn measure(&self, state: &State) -> Result<Validation> {
        let Run { config, device, .. } = *self.run;
        let network = state.moco.online.valid();
        let mut validation = validate(&network, self.pairs, &device.tensor_device())?;
        if let Some(letters) = self.run.letters {
            let preprocessing = self.pairs.preprocessing.clone();
            let checkpoint = Checkpoint::of(&network, config.network, preprocessing, Provenance::default());
            validation.letters = Some(letters.accuracy(&Model::new(checkpoint, String::new(), device)?)?);
        }
        Ok(validation)
    }

    /// Adds a step to the curve.
    fn note(&mut self, row: Row) -> Result<()> {
        let step = row.step;
        let noted = self.history.push(row);
        noted.map_err(|error| self.not_saved(step, error))
    }

    /// Writes the model, then the state: a stop between the two costs at most the steps between them. A network
    /// that holds or makes a value that is no number is never written.
    fn save(&mut self, state: &State, validation: &Validation) -> Result<String> {
        let Run { dataset, config, out, .. } = *self.run;
        let sickness = state.unsound().map(|tensor| Sickness {
            seen: format!("'{tensor}' holds values that are no numbers"),
            advice: "a lower --learning-rate",
        });
        self.check(state.step, sickness.or_else(|| health::of_embeddings(validation)))?;
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
        let model = checkpoint.save(&out.join("model.safetensors"));
        let sha256 = model.map_err(|error| self.not_saved(state.step, error.into()))?;
        self.kept = Some(state.step);
        let saved = state.save(&out.join("state.safetensors"), config, dataset.frames_sha256());
        saved.map_err(|error| self.not_saved(state.step, error))?;
        self.last = Some((state.step, sha256.clone(), validation.clone()));
        Ok(sha256)
    }

    /// Draws the curves.
    fn draw(&self, end: End<'_>) -> Result<()> {
        let page = page::render(self.run, self.pairs, self.history.rows(), end);
        Ok(tactile_infer::safefile::write_whole(&self.run.out.join("curve.html"), page.as_bytes())?)
    }

    /// Stops a sick run.
    fn check(&self, step: usize, sickness: Option<Sickness>) -> Result<()> {
        match sickness {
            Some(Sickness { seen, advice }) => Err(Error::Unwell { step, seen, advice, kept: self.kept }),
            None => Ok(()),
        }
    }

    fn not_saved(&self, step: usize, source: Error) -> Error {
        Error::NotSaved { step, kept: self.kept, source: Box::new(source) }
    }
}

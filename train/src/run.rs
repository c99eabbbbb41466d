//! The training run: the loop in full view, its checkpoints, and how it goes on after a stop.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;
use std::time::Instant;

use burn::module::Module;
use burn::optim::{AdamWConfig, ModuleOptimizer};
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device};
use serde::{Deserialize, Serialize};
use tactile_data::store::Dataset;
use tactile_infer::checkpoint::Provenance;
use tactile_infer::encoder::{Encoder, Network, NetworkConfig};
use tactile_infer::safefile::SafeFile;
use tactile_infer::{Checkpoint, DeviceKind};

use crate::batch::Pairs;
use crate::error::{Error, Result};
use crate::moco::{Moco, shard_pools};
use crate::schedule::{encoder_momentum, learning_rate};
use crate::validate::{Validation, validate};

const STATE_SCHEMA: &str = "tactile-filter/train-state/1";

/// Settings of a run; saved beside its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Name of the preset.
    pub preset: String,
    /// Sizes of the network.
    pub network: NetworkConfig,
    /// Steps of the whole run.
    pub n_steps: usize,
    /// Pairs in a batch.
    pub n_pairs: usize,
    /// Parts of a batch, each on a thread of its own. Part of the recipe, not of the machine: batch
    /// statistics are those of a part, so another number trains another network.
    pub n_shards: usize,
    /// InfoNCE's temperature.
    pub temperature: f64,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Steps of linear warm-up.
    pub n_warmup: usize,
    /// AdamW's decoupled weight decay.
    pub weight_decay: f32,
    /// Momentum of the key encoder at the start; it ends at one.
    pub momentum: f64,
    /// Smallest share of each side that a random crop keeps.
    pub min_crop: f32,
    /// Share of a batch that are neighbours of the pair before, a few mm and degrees away.
    pub near_share: f64,
    /// Steps between checkpoints and validations.
    pub save_every: usize,
    /// Seed of weights, batches and augmentation.
    pub seed: u64,
}

impl TrainConfig {
    /// Minutes on two cores.
    pub fn tiny() -> Self {
        Self {
            preset: "tiny".into(),
            network: NetworkConfig::TINY,
            n_steps: 500,
            n_pairs: 192,
            n_shards: 2,
            temperature: 0.1,
            learning_rate: 2e-3,
            n_warmup: 40,
            weight_decay: 0.05,
            momentum: 0.98,
            min_crop: 0.9,
            near_share: 0.5,
            save_every: 50,
            seed: 1,
        }
    }

    fn validate(&self) -> Result<()> {
        self.network.validate()?;
        let smallest = [("steps", self.n_steps, 1), ("save_every", self.save_every, 1), ("n_shards", self.n_shards, 1)];
        let batch = ("batch", self.n_pairs, 2 * self.n_shards);
        if let Some((name, n, least)) = smallest.into_iter().chain([batch]).find(|(_, n, least)| n < least) {
            return Err(Error::invalid(name, format!("at least {least}"), n.to_string()));
        }
        let in_range = self.temperature > 0.0
            && self.learning_rate > 0.0
            && (0.0..=1.0).contains(&self.momentum)
            && (0.1..=1.0).contains(&self.min_crop)
            && (0.0..=1.0).contains(&self.near_share);
        if !in_range {
            return Err(Error::invalid("training settings", "positive rates and shares in 0..=1", format!("{self:?}")));
        }
        Ok(())
    }
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
        /// Speed since the run began, without validation.
        pairs_per_second: f64,
    },
    /// A checkpoint was saved; how good it is.
    Saved {
        /// Steps made so far.
        step: usize,
        /// Measured on the held-out boards.
        validation: &'a Validation,
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

/// Trains on the pairs of a dataset and writes `model.safetensors`, `state.safetensors` and `curve.csv`
/// into `out`.
///
/// `resume` goes on from the state in `out`. `should_stop` is asked before each step; where it says yes
/// the run saves and returns.
pub fn train(
    dataset: &Dataset,
    out: &Path,
    config: &TrainConfig,
    device: DeviceKind,
    resume: bool,
    should_stop: &dyn Fn() -> bool,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<Outcome> {
    config.validate()?;
    let device = device.open()?.autodiff();
    let pairs = Pairs::new(dataset, config.network.input_px)?;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let state_path = out.join("state.safetensors");
    let state = match (resume, state_path.exists()) {
        (true, _) => State::load(&state_path, config, dataset.frames_sha256(), &device)?,
        (false, true) => {
            let what = state_path.display().to_string();
            return Err(Error::invalid(what, "an empty --out, or --resume to go on", "the state of an earlier run"));
        }
        (false, false) => State::new(config, &device)?,
    };
    let pools = shard_pools(config.n_shards)?;
    let mut curve = Curve::open(&out.join("curve.csv"), state.step)?;
    let mut last = None;
    let first_step = state.step;
    let mut trained = std::time::Duration::ZERO;

    let state = std::thread::scope(|scope| -> Result<State> {
        let mut state = state;
        // One batch is made ahead while the step before it runs.
        let (sender, batches) = sync_channel(1);
        let pairs = &pairs;
        scope.spawn(move || {
            for step in first_step..config.n_steps {
                let batch = pairs.batch(config.seed, step, config.n_pairs, config.min_crop, config.near_share);
                if sender.send(batch).is_err() {
                    return; // The run stopped early.
                }
            }
        });
        while state.step < config.n_steps && !should_stop() {
            let started = Instant::now();
            let Ok(batch) = batches.recv() else { break };
            let shards = batch?.shards(config.n_shards, config.network.input_px, &device);
            let (loss, gradients) = state.moco.gradients(shards, config.temperature, &pools);
            if !loss.is_finite() {
                return Err(Error::Diverged { step: state.step, loss });
            }
            let rate = learning_rate(state.step, config.n_warmup, config.n_steps, config.learning_rate);
            state.moco.online = state.optimizer.step_multi(rate, state.moco.online, gradients);
            state.moco = state.moco.follow(encoder_momentum(state.step, config.n_steps, config.momentum));
            state.step += 1;
            trained += started.elapsed();

            let pairs_per_second = ((state.step - first_step) * config.n_pairs) as f64 / trained.as_secs_f64();
            on_event(Event::Step { step: state.step, n_steps: config.n_steps, loss, pairs_per_second });
            let validation = if state.step.is_multiple_of(config.save_every) || state.step == config.n_steps {
                let validation = validate(&state.moco.online.valid(), pairs, &device)?;
                last = Some((save(&state, pairs, dataset, config, out, &validation)?, validation.clone()));
                on_event(Event::Saved { step: state.step, validation: &validation });
                Some(validation)
            } else {
                None
            };
            curve.write(state.step, loss, rate, pairs_per_second, validation.as_ref())?;
        }
        drop(batches);
        Ok(state)
    })?;

    let (sha256, validation) = match last {
        Some(saved) if state.step.is_multiple_of(config.save_every) || state.step == config.n_steps => saved,
        _ => {
            let validation = validate(&state.moco.online.valid(), &pairs, &device)?;
            (save(&state, &pairs, dataset, config, out, &validation)?, validation)
        }
    };
    let finished = state.step == config.n_steps;
    Ok(Outcome { model: out.join("model.safetensors"), sha256, step: state.step, finished, validation })
}

/// Writes the model, then the state: a stop between the two costs at most the steps between them.
fn save(
    state: &State,
    pairs: &Pairs<'_>,
    dataset: &Dataset,
    config: &TrainConfig,
    out: &Path,
    validation: &Validation,
) -> Result<String> {
    let provenance = Provenance {
        name: config.preset.clone(),
        steps: state.step,
        batch: config.n_pairs,
        seed: config.seed,
        dataset: dataset.meta().name.clone(),
        retrieval: validation.retrieval_1,
    };
    let network = state.moco.online.valid();
    let checkpoint = Checkpoint::of(&network, config.network, pairs.preprocessing.clone(), provenance);
    let sha256 = checkpoint.save(&out.join("model.safetensors"))?;
    state.save(&out.join("state.safetensors"), config, dataset.frames_sha256())?;
    Ok(sha256)
}

/// All that a resumed run needs: data order and augmentation follow from the seed and the step.
struct State {
    moco: Moco,
    optimizer: ModuleOptimizer,
    step: usize,
}

impl State {
    fn new(config: &TrainConfig, device: &Device) -> Result<Self> {
        let optimizer = AdamWConfig::new().with_epsilon(1e-8).with_weight_decay(config.weight_decay).init();
        Ok(Self { moco: Moco::new(&config.network, config.seed, device)?, optimizer, step: 0 })
    }

    fn save(&self, path: &Path, config: &TrainConfig, dataset_sha256: &str) -> Result<()> {
        let unwritable = |e| Error::invalid(path.display().to_string(), "a record burn can write", format!("{e}"));
        // `valid` waits for running statistics that are still under way.
        let online = self.moco.online.valid().into_record().into_bytes().map_err(unwritable)?;
        let momentum = self.moco.momentum.valid().into_record().into_bytes().map_err(unwritable)?;
        let optimizer = self.optimizer.into_bytes().map_err(unwritable)?;
        let config = serde_json::to_string(config);
        let config = config.map_err(|e| Error::invalid("settings", "values JSON can hold", e.to_string()))?;
        let file = SafeFile {
            tensors: Vec::new(),
            blobs: vec![
                ("momentum".into(), momentum.to_vec()),
                ("online".into(), online.to_vec()),
                ("optimizer".into(), optimizer.to_vec()),
            ],
            text: vec![
                ("config".into(), config),
                ("dataset_sha256".into(), dataset_sha256.to_owned()),
                ("step".into(), self.step.to_string()),
            ],
        };
        Ok(file.save(path, STATE_SCHEMA)?)
    }

    fn load(path: &Path, config: &TrainConfig, dataset_sha256: &str, device: &Device) -> Result<Self> {
        let name = path.display().to_string();
        let file = SafeFile::load(path, STATE_SCHEMA)?;
        let saved: TrainConfig = serde_json::from_str(file.text(path, "config")?)
            .map_err(|e| Error::invalid(&name, "settings of this version", e.to_string()))?;
        if saved != *config {
            return Err(Error::invalid(name, format!("the settings it began with, {saved:?}"), format!("{config:?}")));
        }
        let saved_data = file.text(path, "dataset_sha256")?;
        if saved_data != dataset_sha256 {
            return Err(Error::invalid(name, format!("the dataset it began with, {saved_data}"), dataset_sha256));
        }
        let step = file.text(path, "step")?;
        let step = step.parse().map_err(|_| Error::invalid(&name, "a number of steps", step))?;
        let blob = |key: &str| {
            let found = file.blobs.iter().find(|(name, _)| name == key);
            let bytes = found.map(|(_, bytes)| Bytes::from_bytes_vec(bytes.clone()));
            bytes.ok_or_else(|| Error::invalid(&name, format!("a block '{key}'"), "none"))
        };
        let broken = |e| Error::invalid(&name, "a record burn can read", format!("{e}"));
        let fresh = Self::new(config, device)?;
        let record = |key: &str| ModuleRecord::from_bytes(blob(key)?).map_err(broken);
        let online: Network = fresh.moco.online.try_load_record(record("online")?).map_err(broken)?;
        let momentum: Encoder = fresh.moco.momentum.try_load_record(record("momentum")?).map_err(broken)?;
        let optimizer = fresh.optimizer.from_bytes(blob("optimizer")?).map_err(broken)?;
        Ok(Self { moco: Moco { online, momentum: momentum.no_grad() }, optimizer, step })
    }
}

/// The curve as CSV: one line a step.
struct Curve {
    file: std::fs::File,
    path: PathBuf,
}

impl Curve {
    /// Opens the curve and drops lines of steps that will be made again.
    fn open(path: &Path, first_step: usize) -> Result<Self> {
        let mut kept =
            String::from("step,loss,learning_rate,pairs_per_second,retrieval_1,retrieval_5,cosine_gap,spread\n");
        if first_step > 0
            && let Ok(old) = std::fs::read_to_string(path)
        {
            for line in old.lines().skip(1).take(first_step) {
                kept.push_str(line);
                kept.push('\n');
            }
        }
        tactile_infer::safefile::write_whole(path, kept.as_bytes())?;
        let file = std::fs::OpenOptions::new().append(true).open(path).map_err(Error::io(path))?;
        Ok(Self { file, path: path.to_path_buf() })
    }

    fn write(&mut self, step: usize, loss: f64, rate: f64, speed: f64, validation: Option<&Validation>) -> Result<()> {
        let held_out = validation.map_or(",,,".to_owned(), |v| {
            format!("{:.4},{:.4},{:.4},{:.4}", v.retrieval_1, v.retrieval_5, v.cosine_gap, v.spread)
        });
        writeln!(self.file, "{step},{loss:.6},{rate:.6e},{speed:.1},{held_out}").map_err(Error::io(&self.path))
    }
}

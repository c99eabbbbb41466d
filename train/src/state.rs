//! All that a resumed run needs, in memory and in `state.safetensors`. Order of the data and augmentation are
//! computed from the seed and the step.

use std::path::Path;

use burn::module::Module;
use burn::optim::{AdamWConfig, LambConfig, ModuleOptimizer};
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device};
use tactile_infer::embedding::network::{Encoder, Network, tensors_of};
use tactile_infer::safefile::SafeFile;

use crate::config::{Optimizer, TrainConfig};
use crate::error::{Error, Result};
use crate::moco::Moco;

const SCHEMA: &str = "tactile-filter/train-state/2";

/// Networks, optimizer and the number of steps made.
pub struct State {
    /// The trained network and its copy.
    pub moco: Moco,
    /// The optimizer with its moments.
    pub optimizer: ModuleOptimizer,
    /// Steps made.
    pub step: usize,
}

impl State {
    /// A state before its first step. `device` carries autodiff.
    pub fn new(config: &TrainConfig, device: &Device) -> Result<Self> {
        let optimizer = match config.optimizer {
            Optimizer::Adamw => AdamWConfig::new().with_epsilon(1e-8).with_weight_decay(config.weight_decay).init(),
            #[cfg(feature = "wgpu")]
            Optimizer::Lamb if tactile_infer::embedding::network::is_card(device) => {
                crate::lamb::CardLamb { weight_decay: config.weight_decay }.into()
            }
            Optimizer::Lamb => LambConfig::new().with_weight_decay(config.weight_decay).init(),
        };
        Ok(Self { moco: Moco::new(&config.network, config.seed, device)?, optimizer, step: 0 })
    }

    /// The first tensor of either network with a value that is not finite, running statistics included.
    pub fn first_not_finite(&self) -> Option<String> {
        // `valid` waits for running statistics that are still being computed.
        let tensors = tensors_of(&self.moco.online.valid()).into_iter().chain(tensors_of(&self.moco.momentum.valid()));
        tensors.filter(|tensor| tensor.values.iter().any(|v| !v.is_finite())).map(|tensor| tensor.name).next()
    }

    /// Writes the state, whole or not at all, with the settings and the dataset it belongs to.
    pub fn save(&self, path: &Path, config: &TrainConfig, dataset_sha256: &str) -> Result<()> {
        let unwritable = |e| Error::invalid(path.display().to_string(), "a record burn can write", format!("{e}"));
        let online = self.moco.online.valid().into_record().into_bytes().map_err(unwritable)?;
        let momentum = self.moco.momentum.valid().into_record().into_bytes().map_err(unwritable)?;
        let optimizer = self.optimizer.into_bytes().map_err(unwritable)?;
        let file = SafeFile {
            tensors: Vec::new(),
            blobs: vec![
                ("momentum".into(), momentum.to_vec()),
                ("online".into(), online.to_vec()),
                ("optimizer".into(), optimizer.to_vec()),
            ],
            text: vec![
                ("config".into(), config.to_toml()?),
                ("dataset_sha256".into(), dataset_sha256.to_owned()),
                ("step".into(), self.step.to_string()),
            ],
        };
        Ok(file.save(path, SCHEMA)?)
    }

    /// Reads a state. The state of a run with other settings or another dataset is an error.
    pub fn load(path: &Path, config: &TrainConfig, dataset_sha256: &str, device: &Device) -> Result<Self> {
        let name = path.display().to_string();
        let file = SafeFile::load(path, SCHEMA)?;
        let text = |name: &str| file.text(name).map_err(|error| error.within(path.display()));
        let (saved, asked) = (text("config")?, config.to_toml()?);
        if saved != asked {
            let expected = format!("the settings it began with, {}", only_in(saved, &asked));
            return Err(Error::invalid(name, expected, only_in(&asked, saved)));
        }
        let saved_data = text("dataset_sha256")?;
        if saved_data != dataset_sha256 {
            return Err(Error::invalid(name, format!("the dataset it began with, {saved_data}"), dataset_sha256));
        }
        let step = text("step")?;
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

/// The lines of one text that the other lacks.
fn only_in(one: &str, other: &str) -> String {
    one.lines().filter(|line| !other.lines().any(|o| o == *line)).collect::<Vec<_>>().join(", ")
}

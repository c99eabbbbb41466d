//! Settings as a person gives them: flags over a file over a preset, under one name each.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tactile_infer::safefile::write_whole;

use crate::config::{FalseNegatives, Flips, Optimizer, Preset, TrainConfig, steps_of};
use crate::error::{Error, Result};

/// Settings that may each be given or left to the preset: the flags of `tactile-train`, and the entries of a
/// TOML file under the same names with `_` for `-`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// How much to train: tiny takes minutes on two cores, small three quarters of an hour, paper is for a GPU [default: tiny].
    #[cfg_attr(feature = "cli", arg(long))]
    pub preset: Option<Preset>,
    /// Steps of the whole run.
    #[cfg_attr(feature = "cli", arg(long, conflicts_with = "epochs"))]
    pub steps: Option<usize>,
    /// Length of the run in epochs, instead of steps.
    #[cfg_attr(feature = "cli", arg(long))]
    pub epochs: Option<f64>,
    /// Pairs in a batch.
    #[cfg_attr(feature = "cli", arg(long))]
    pub batch: Option<usize>,
    /// Parts of a batch, each on a thread of its own with batch statistics of its own.
    #[cfg_attr(feature = "cli", arg(long))]
    pub shards: Option<usize>,
    /// Width and height of the network's input, pixels.
    #[cfg_attr(feature = "cli", arg(long, value_name = "WIDTHxHEIGHT", value_parser = input_px))]
    pub input_px: Option<[usize; 2]>,
    /// Channels of the network's first layer; the others follow.
    #[cfg_attr(feature = "cli", arg(long))]
    pub width: Option<usize>,
    /// Units of the hidden layers of projector and predictor.
    #[cfg_attr(feature = "cli", arg(long))]
    pub hidden: Option<usize>,
    /// Length of an embedding.
    #[cfg_attr(feature = "cli", arg(long))]
    pub dim: Option<usize>,
    /// Temperature of InfoNCE.
    #[cfg_attr(feature = "cli", arg(long))]
    pub temperature: Option<f64>,
    /// What moves the weights.
    #[cfg_attr(feature = "cli", arg(long))]
    pub optimizer: Option<Optimizer>,
    /// Peak learning rate.
    #[cfg_attr(feature = "cli", arg(long))]
    pub learning_rate: Option<f64>,
    /// Steps of linear warm-up [default: the preset's, at most a tenth of the steps].
    #[cfg_attr(feature = "cli", arg(long))]
    pub warmup: Option<usize>,
    /// Decoupled weight decay.
    #[cfg_attr(feature = "cli", arg(long))]
    pub weight_decay: Option<f32>,
    /// Momentum of the key encoder at the start; it ends at one.
    #[cfg_attr(feature = "cli", arg(long))]
    pub momentum: Option<f64>,
    /// Whether pairs are mirrored: under the lamps where they are, as they come, or not at all.
    #[cfg_attr(feature = "cli", arg(long))]
    pub flips: Option<Flips>,
    /// Smallest share of each side that a random crop keeps.
    #[cfg_attr(feature = "cli", arg(long))]
    pub min_crop: Option<f32>,
    /// Share of a batch that are near neighbours.
    #[cfg_attr(feature = "cli", arg(long))]
    pub near_share: Option<f64>,
    /// Largest share of a batch that may be blank pairs; 1 is no limit.
    #[cfg_attr(feature = "cli", arg(long))]
    pub max_blank: Option<f64>,
    /// Whether pairs that no picture can tell apart (same place, or both blank) count as negatives.
    #[cfg_attr(feature = "cli", arg(long))]
    pub false_negatives: Option<FalseNegatives>,
    /// Steps between checkpoints and validations.
    #[cfg_attr(feature = "cli", arg(long))]
    pub save_every: Option<usize>,
    /// Seed of weights, batches and augmentation [default: 1].
    #[cfg_attr(feature = "cli", arg(long))]
    pub seed: Option<u64>,
}

impl Settings {
    /// Reads a TOML file; an unknown entry is an error.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let settings: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(0, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let name = format!("{} line {line}", path.display());
            Error::invalid(name, "settings of tactile-train", e.message().replace('\n', " "))
        })?;
        if settings.steps.is_some() && settings.epochs.is_some() {
            return Err(Error::invalid(path.display().to_string(), "steps or epochs", "both"));
        }
        Ok(settings)
    }

    /// Writes all settings of a run as a file that [`Self::load`] reads.
    pub fn save(config: &TrainConfig, path: &Path) -> Result<()> {
        let text = toml::to_string(&Self::from(config));
        let text = text.map_err(|e| Error::invalid("settings", "values TOML can hold", e.to_string()))?;
        Ok(write_whole(path, text.as_bytes())?)
    }

    /// These settings, and where they say nothing those of `under`.
    pub fn over(self, under: Self) -> Self {
        // A length replaces the other way of giving it.
        let (steps, epochs) = match (self.steps, self.epochs) {
            (None, None) => (under.steps, under.epochs),
            given => given,
        };
        Self {
            preset: self.preset.or(under.preset),
            steps,
            epochs,
            batch: self.batch.or(under.batch),
            shards: self.shards.or(under.shards),
            input_px: self.input_px.or(under.input_px),
            width: self.width.or(under.width),
            hidden: self.hidden.or(under.hidden),
            dim: self.dim.or(under.dim),
            temperature: self.temperature.or(under.temperature),
            optimizer: self.optimizer.or(under.optimizer),
            learning_rate: self.learning_rate.or(under.learning_rate),
            warmup: self.warmup.or(under.warmup),
            weight_decay: self.weight_decay.or(under.weight_decay),
            momentum: self.momentum.or(under.momentum),
            flips: self.flips.or(under.flips),
            min_crop: self.min_crop.or(under.min_crop),
            near_share: self.near_share.or(under.near_share),
            max_blank: self.max_blank.or(under.max_blank),
            false_negatives: self.false_negatives.or(under.false_negatives),
            save_every: self.save_every.or(under.save_every),
            seed: self.seed.or(under.seed),
        }
    }

    /// The settings of a run on `n_training` pairs, checked.
    pub fn resolve(&self, n_training: usize) -> Result<TrainConfig> {
        let preset = TrainConfig::of(self.preset.unwrap_or_default(), n_training);
        let n_pairs = self.batch.unwrap_or(preset.n_pairs);
        if let Some(epochs) = self.epochs.filter(|epochs| !(epochs.is_finite() && *epochs > 0.0)) {
            return Err(Error::invalid("epochs", "a positive number", epochs.to_string()));
        }
        // The paper's length is in epochs, whatever the batch.
        let epochs = self.epochs.or((preset.preset == Preset::Paper).then_some(500.0));
        let by_epochs = epochs.map(|epochs| steps_of(epochs, n_training, n_pairs));
        let n_steps = self.steps.or(by_epochs).unwrap_or(preset.n_steps);
        let mut network = preset.network;
        network.input_px = self.input_px.unwrap_or(network.input_px);
        network.width = self.width.unwrap_or(network.width);
        network.hidden = self.hidden.unwrap_or(network.hidden);
        network.dim = self.dim.unwrap_or(network.dim);
        let optimizer = self.optimizer.unwrap_or(preset.optimizer);
        // A preset's rate is that of its own optimiser.
        let is_own = optimizer == preset.optimizer;
        let learning_rate = if is_own { preset.learning_rate } else { optimizer.learning_rate() };
        let config = TrainConfig {
            preset: preset.preset,
            network,
            n_steps,
            n_pairs,
            n_shards: self.shards.unwrap_or(preset.n_shards),
            temperature: self.temperature.unwrap_or(preset.temperature),
            optimizer,
            learning_rate: self.learning_rate.unwrap_or(learning_rate),
            n_warmup: self.warmup.unwrap_or(preset.n_warmup.min(n_steps / 10)),
            weight_decay: self.weight_decay.unwrap_or(preset.weight_decay),
            momentum: self.momentum.unwrap_or(preset.momentum),
            flips: self.flips.unwrap_or(preset.flips),
            min_crop: self.min_crop.unwrap_or(preset.min_crop),
            near_share: self.near_share.unwrap_or(preset.near_share),
            max_blank: self.max_blank.unwrap_or(preset.max_blank),
            false_negatives: self.false_negatives.unwrap_or(preset.false_negatives),
            save_every: self.save_every.unwrap_or(preset.save_every),
            seed: self.seed.unwrap_or(preset.seed),
        };
        config.validate()?;
        Ok(config)
    }
}

impl From<&TrainConfig> for Settings {
    fn from(config: &TrainConfig) -> Self {
        Self {
            preset: Some(config.preset),
            steps: Some(config.n_steps),
            epochs: None,
            batch: Some(config.n_pairs),
            shards: Some(config.n_shards),
            input_px: Some(config.network.input_px),
            width: Some(config.network.width),
            hidden: Some(config.network.hidden),
            dim: Some(config.network.dim),
            temperature: Some(config.temperature),
            optimizer: Some(config.optimizer),
            learning_rate: Some(config.learning_rate),
            warmup: Some(config.n_warmup),
            weight_decay: Some(config.weight_decay),
            momentum: Some(config.momentum),
            flips: Some(config.flips),
            min_crop: Some(config.min_crop),
            near_share: Some(config.near_share),
            max_blank: Some(config.max_blank),
            false_negatives: Some(config.false_negatives),
            save_every: Some(config.save_every),
            seed: Some(config.seed),
        }
    }
}

/// `40x30` as width and height.
#[cfg(feature = "cli")]
fn input_px(text: &str) -> std::result::Result<[usize; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, like 40x30".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Settings> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.toml");
        std::fs::write(&path, text).unwrap();
        Settings::load(&path)
    }

    #[test]
    fn flags_go_over_the_file_and_the_file_over_the_preset() {
        let file = read("preset = \"small\"\ntemperature = 0.2\nbatch = 64\nflips = \"relit\"").unwrap();
        let flags = Settings { batch: Some(32), ..Settings::default() };
        let config = flags.over(file).resolve(1_000).unwrap();
        let expected = TrainConfig { temperature: 0.2, n_pairs: 32, flips: Flips::Relit, ..TrainConfig::small() };
        assert_eq!(config, expected);
        assert_eq!(Settings::default().resolve(1_000).unwrap(), TrainConfig::tiny());
    }

    #[test]
    fn what_a_run_saves_gives_the_same_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("train.toml");
        for config in [TrainConfig::tiny(), TrainConfig::small(), TrainConfig::paper(999)] {
            Settings::save(&config, &path).unwrap();
            assert_eq!(Settings::load(&path).unwrap().resolve(12).unwrap(), config);
        }
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("min_crop = 0.9\n"), "{text}");
    }

    #[test]
    fn a_length_in_epochs_is_counted_in_steps() {
        let steps = |settings: Settings| settings.resolve(1_000).unwrap().n_steps;
        // 3 x 1,000 / 100
        assert_eq!(steps(Settings { epochs: Some(3.0), batch: Some(100), ..Settings::default() }), 30);
        let file = Settings { epochs: Some(3.0), ..Settings::default() };
        assert_eq!(steps(Settings { steps: Some(7), ..Settings::default() }.over(file)), 7);
        let paper = Settings { preset: Some(Preset::Paper), batch: Some(100), ..Settings::default() };
        assert_eq!(steps(paper), 5_000);
    }

    #[test]
    fn a_wrong_file_is_named_with_its_line() {
        let error = read("batch = 8\nbatchsize = 9").unwrap_err().to_string();
        assert!(error.contains("x.toml line 2") && error.contains("batchsize"), "{error}");
        let error = read("flips = \"twice\"").unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("twice") && !error.contains('\n'), "{error}");
        assert!(read("steps = 1\nepochs = 1.0").unwrap_err().to_string().contains("got both"));
    }
}

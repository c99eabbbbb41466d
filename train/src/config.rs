//! The settings of a run, and the presets: from minutes on two cores to a day on a GPU.

use std::fmt;

use serde::{Deserialize, Serialize};
use tactile_infer::embedding::architecture::NetworkConfig;

use crate::error::{Error, Result};
use crate::mating::Within;

/// How much to train.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Minutes on two cores.
    #[default]
    Tiny,
    /// Three quarters of an hour on two cores: the network of `tiny`, twenty times the pairs.
    Small,
    /// 500 epochs at 160x120 px in batches of 1,024: for a GPU.
    Paper,
    /// Ten minutes on two cores, from a trained model: small steps, so that what it has learnt stays.
    Fine,
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tiny => "tiny",
            Self::Small => "small",
            Self::Paper => "paper",
            Self::Fine => "fine",
        })
    }
}

/// How a gradient changes the weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimizer {
    /// Adam with decoupled weight decay (Loshchilov and Hutter 2019).
    #[default]
    Adamw,
    /// AdamW's step scaled layer by layer to the weights' length, for large batches (You et al. 2020).
    Lamb,
}

impl Optimizer {
    /// The peak learning rate that was best on the tuning letters, for batches of about two hundred pairs.
    pub fn learning_rate(self) -> f64 {
        match self {
            Self::Adamw => 2e-3,
            Self::Lamb => 1e-2,
        }
    }
}

/// Whether pairs are mirrored, and how their light is corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Flips {
    /// Relit where the frames show the lamps, otherwise plain with a warning.
    #[default]
    Auto,
    /// Mirrored shapes as the lamps at their real places would light them.
    Relit,
    /// Mirrored pictures without correction, as in the paper: their light comes from places without a lamp.
    Plain,
    /// Nothing is mirrored.
    None,
}

/// Settings of a run; its TOML file is kept next to the model. Serialised under the names of
/// [`Settings`](crate::settings::Settings).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// The preset that gave what was not set.
    pub preset: Preset,
    /// Sizes of the network.
    #[serde(flatten)]
    pub network: NetworkConfig,
    /// Steps of the whole run.
    #[serde(rename = "steps")]
    pub n_steps: usize,
    /// Pairs in a batch.
    #[serde(rename = "batch")]
    pub n_pairs: usize,
    /// Parts that a batch is embedded in, one after the other. They change the result: batch normalisation uses the
    /// statistics of one micro-batch.
    #[serde(rename = "micro_batches")]
    pub n_micro_batches: usize,
    /// InfoNCE's temperature.
    pub temperature: f64,
    /// The optimizer.
    pub optimizer: Optimizer,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Steps of linear warm-up.
    #[serde(rename = "warmup")]
    pub n_warmup: usize,
    /// Decoupled weight decay.
    pub weight_decay: f32,
    /// Momentum of the key encoder at the start; it ends at 1.
    pub momentum: f64,
    /// Whether pairs are mirrored.
    pub flips: Flips,
    /// Smallest share of each side that a random crop keeps, 0.1..=1.
    pub min_crop: f32,
    /// Share of a batch that are neighbours of the pair before, a few mm and degrees away, 0..=1.
    pub near_share: f64,
    /// Largest share of a batch that may be pairs without an edge in either view, 0..=1; 1 is no limit.
    pub max_blank: f64,
    /// Largest standard deviation of the smooth field that comes with a press, counts at the picture's border.
    pub field_counts: f64,
    /// How far apart a hole and its peg may have been touched, mm ...
    pub mate_mm: f64,
    /// ... and degrees.
    pub mate_deg: f64,
    /// Steps between checkpoints and validations.
    pub save_every: usize,
    /// Seed of weights, batches and augmentation.
    pub seed: u64,
}

/// Largest network, above any that these pictures need; most machines cannot hold it.
const MAX_WEIGHTS: usize = 1 << 30;

/// f32 values of a weight, its gradient, its two moments and its copy in the key encoder.
const BYTES_A_WEIGHT: usize = 5 * size_of::<f32>();

/// The rate at which a trained model is fine-tuned, of LAMB: a fifth of a fresh network's (`NOTES.md`).
const FINE_RATE: f64 = 2e-3;

impl TrainConfig {
    /// Minutes on two cores.
    pub fn tiny() -> Self {
        Self {
            preset: Preset::Tiny,
            network: NetworkConfig::TINY,
            n_steps: 500,
            n_pairs: 192,
            n_micro_batches: 2,
            temperature: 0.1,
            optimizer: Optimizer::Lamb,
            learning_rate: Optimizer::Lamb.learning_rate(),
            n_warmup: 40,
            weight_decay: 0.05,
            momentum: 0.98,
            flips: Flips::Auto,
            min_crop: 0.9,
            near_share: 0.5,
            max_blank: 1.0,
            field_counts: 0.0,
            mate_mm: 1.5,
            mate_deg: 4.0,
            save_every: 50,
            seed: 1,
        }
    }

    /// Three quarters of an hour on two cores: 2,048,000 pairs.
    pub fn small() -> Self {
        Self {
            preset: Preset::Small,
            n_steps: 8_000,
            n_pairs: 256,
            n_warmup: 160,
            momentum: 0.99,
            save_every: 100,
            ..Self::tiny()
        }
    }

    /// Ten minutes on two cores, from a trained model: 384,000 pairs.
    pub fn fine() -> Self {
        Self {
            preset: Preset::Fine,
            n_steps: 1_500,
            n_warmup: 100,
            learning_rate: FINE_RATE,
            save_every: 150,
            ..Self::small()
        }
    }

    /// 500 epochs of `n_training` pairs (paper, Sec. V-A) at 160x120 px. The paper names neither batch nor rates:
    /// these are MoCo-v3's for AdamW, 1.5e-4 a 256 pairs, a twelfth of the steps to warm up.
    pub fn paper(n_training: usize) -> Self {
        let n_pairs = 1_024;
        let n_steps = steps_of(500.0, n_training, n_pairs);
        Self {
            preset: Preset::Paper,
            network: NetworkConfig { input_px: [160, 120], width: 32, hidden: 512, dim: 256 },
            n_steps,
            n_pairs,
            n_micro_batches: 8,
            optimizer: Optimizer::Adamw,
            learning_rate: 6e-4,
            n_warmup: n_steps / 12,
            weight_decay: 0.1,
            momentum: 0.99,
            save_every: 100,
            ..Self::tiny()
        }
    }

    /// The settings of a preset, for a dataset of `n_training` training pairs.
    pub fn of(preset: Preset, n_training: usize) -> Self {
        match preset {
            Preset::Tiny => Self::tiny(),
            Preset::Small => Self::small(),
            Preset::Paper => Self::paper(n_training),
            Preset::Fine => Self::fine(),
        }
    }

    /// The loss of a network that has learned nothing: 4 tau ln N, symmetrised.
    pub fn chance_loss(&self) -> f64 {
        4.0 * self.temperature * (self.n_pairs as f64).ln()
    }

    /// The settings as a TOML file that [`crate::settings::Settings::load`] reads.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|e| Error::invalid("settings", "values that TOML can hold", e.to_string()))
    }

    /// How far apart a hole and its peg may have been touched.
    pub fn mating(&self) -> Within {
        Within { mm: self.mate_mm, deg: self.mate_deg }
    }

    /// Refuses settings out of range, by the name that flags and files give them.
    pub fn validate(&self) -> Result<()> {
        let network = &self.network;
        let counts = [
            ("steps", self.n_steps, 1, 1 << 32),
            ("micro_batches", self.n_micro_batches, 1, 256),
            ("batch", self.n_pairs, 2 * self.n_micro_batches, 1 << 16),
            ("warmup", self.n_warmup, 0, 1 << 32),
            ("save_every", self.save_every, 1, 1 << 32),
            ("input_px width", network.input_px[0], 8, 1_024),
            ("input_px height", network.input_px[1], 8, 1_024),
            ("width", network.width, 1, 4_096),
            ("hidden", network.hidden, 1, 4_096),
            ("dim", network.dim, 1, 4_096),
        ];
        for (name, n, least, most) in counts {
            if !(least..=most).contains(&n) {
                let why = if name == "batch" && n < least { ", two for each micro-batch" } else { "" };
                return Err(Error::invalid(name, format!("{least} to {most}{why}"), n.to_string()));
            }
        }
        // A temperature below a thousandth overflows f32 in the exponent's gradient; those in use are far larger.
        let numbers = [
            ("temperature", self.temperature, 1e-3, 1e3),
            ("learning_rate", self.learning_rate, 1e-12, 1e3),
            ("weight_decay", f64::from(self.weight_decay), 0.0, 1e3),
            ("momentum", self.momentum, 0.0, 1.0),
            ("min_crop", f64::from(self.min_crop), 0.1, 1.0),
            ("near_share", self.near_share, 0.0, 1.0),
            ("max_blank", self.max_blank, 0.0, 1.0),
            ("field_counts", self.field_counts, 0.0, 100.0),
            ("mate_mm", self.mate_mm, 1e-6, 10.0),
            ("mate_deg", self.mate_deg, 1e-6, 45.0),
        ];
        for (name, value, least, most) in numbers {
            // min_crop is an f32, in which 0.1 is rounded.
            if !(least - 1e-6..=most).contains(&value) {
                return Err(Error::invalid(name, format!("{least} to {most}"), value.to_string()));
            }
        }
        let n_weights = network.n_weights_at_least();
        if n_weights > MAX_WEIGHTS {
            let got = format!("{n_weights} or more, which take {} to train", gigabytes(n_weights * BYTES_A_WEIGHT));
            let expected = format!("a network of at most {MAX_WEIGHTS} weights");
            return Err(Error::invalid("input_px, width and hidden", expected, got));
        }
        Ok(network.validate()?)
    }

    /// A lower bound on the memory of a step with batches of `n_pairs`, bytes: weights, two batches of images, the
    /// outputs of the first two layers and two matrices of cosines.
    pub fn bytes_at_least(&self, n_pairs: usize) -> usize {
        let n_pixels: usize = self.network.input_px.iter().product();
        // Of the first two layers one has a quarter of the pixels, the other a sixteenth and four times the channels.
        let values_an_image = 2 * 3 * n_pixels + self.network.width * n_pixels / 2;
        let n_values = 2 * n_pairs * values_an_image + 2 * n_pairs * n_pairs;
        BYTES_A_WEIGHT * self.network.n_weights_at_least() + size_of::<f32>() * n_values
    }

    /// Refuses a run that this machine's memory cannot hold.
    pub(crate) fn check_memory(&self, n_training: usize) -> Result<()> {
        let n_bytes = self.bytes_at_least(self.n_pairs.min(n_training));
        Vec::<u8>::new().try_reserve_exact(n_bytes).map_err(|_| {
            let got = format!("one that takes {} or more", gigabytes(n_bytes));
            Error::invalid("batch, input_px, width and hidden", "a step that fits into the memory", got)
        })
    }
}

fn gigabytes(n_bytes: usize) -> String {
    format!("{:.1} GB", n_bytes as f64 / 1e9)
}

/// Steps that see `n_training` pairs `n_epochs` times in batches of `n_pairs`; at least one.
pub fn steps_of(n_epochs: f64, n_training: usize, n_pairs: usize) -> usize {
    let steps = (n_epochs * n_training as f64 / n_pairs.max(1) as f64).ceil();
    // NaN becomes 0 and what is too large the most that TOML can hold, which `validate` refuses.
    (steps as i64).max(1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_a_run() {
        for config in [TrainConfig::tiny(), TrainConfig::small(), TrainConfig::paper(11_100), TrainConfig::fine()] {
            config.validate().unwrap();
        }
        // 500 x 11,100 / 1,024 = 5,419.9
        assert_eq!(TrainConfig::paper(11_100).n_steps, 5_420);
    }

    #[test]
    fn a_setting_out_of_range_is_named() {
        let refusal = |change: fn(&mut TrainConfig)| {
            let mut config = TrainConfig::tiny();
            change(&mut config);
            config.validate().unwrap_err().to_string()
        };
        assert_eq!(refusal(|c| c.temperature = 0.0), "temperature: expected 0.001 to 1000, got 0");
        assert!(refusal(|c| c.learning_rate = f64::NAN).starts_with("learning_rate: "));
        assert!(refusal(|c| c.momentum = 1.1).starts_with("momentum: "));
        assert!(refusal(|c| c.weight_decay = f32::INFINITY).starts_with("weight_decay: "));
        assert!(refusal(|c| c.network.dim = 0).starts_with("dim: "));
        assert!(refusal(|c| c.network.input_px[1] = 4).starts_with("input_px height: "));
        let huge = refusal(|c| c.network = NetworkConfig { width: 4_096, hidden: 4_096, ..c.network });
        // 9 * 48 * 4096^2 + 8192 * 20 * 4096 weights of 20 bytes
        assert!(huge.ends_with("got 7918845952 or more, which take 158.4 GB to train"), "{huge}");
        assert_eq!(refusal(|c| c.n_pairs = 3), "batch: expected 4 to 65536, two for each micro-batch, got 3");
    }

    #[test]
    fn the_memory_of_a_step_is_below_what_it_takes_and_grows_with_the_batch() {
        let config = TrainConfig::tiny();
        // Images of 40 x 30 px in three channels, twice, and 32 + 4 * 32 / 4 channels at a quarter of the pixels.
        let an_image = 4 * (2 * 3_600 + 32 * 300 + 128 * 75);
        let weights = config.bytes_at_least(0);
        assert_eq!(config.bytes_at_least(192), weights + 2 * 192 * an_image + 2 * 192 * 192 * 4);
        assert_eq!(weights, 20 * config.network.n_weights_at_least());
        config.check_memory(192).unwrap();
    }

    /// Symmetrised MoCo-v3 loss of a network that has learnt nothing (training notes: 4 tau ln N).
    #[test]
    fn chance_is_the_published_value() {
        let config = TrainConfig { n_pairs: 256, temperature: 0.2, ..TrainConfig::tiny() };
        assert!((config.chance_loss() - 4.44).abs() < 0.005);
    }
}

//! The settings of a run, and the presets: how much to train, from minutes to a GPU's day.

use std::fmt;

use serde::{Deserialize, Serialize};
use tactile_infer::encoder::NetworkConfig;

use crate::error::{Error, Result};

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
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tiny => "tiny",
            Self::Small => "small",
            Self::Paper => "paper",
        })
    }
}

/// How gradients move the weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Optimizer {
    /// Adam with decoupled weight decay (Loshchilov and Hutter 2019).
    #[default]
    Adamw,
    /// AdamW's step scaled layer by layer to the weights' length, for large batches (You et al. 2020).
    Lamb,
}

impl Optimizer {
    /// The peak learning rate that was best on letters for tuning, for batches of some two hundred pairs.
    pub fn learning_rate(self) -> f64 {
        match self {
            Self::Adamw => 2e-3,
            Self::Lamb => 1e-2,
        }
    }
}

/// Whether pairs are mirrored, and what becomes of the light then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Flips {
    /// Relit where the frames show the lamps, else plain with a warning.
    #[default]
    Auto,
    /// Mirrored shapes under the lamps where they are: see [`crate::relight`].
    Relit,
    /// Mirrored pictures as they come, which show lamps where none are (the paper's).
    Plain,
    /// Nothing is mirrored.
    None,
}

/// What becomes of two pairs of a batch that no picture can tell apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FalseNegatives {
    /// They are each other's negatives, like any two.
    #[default]
    Keep,
    /// They are left out of each other's loss.
    Mask,
}

/// Settings of a run; saved beside its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The preset that the others were begun from.
    pub preset: Preset,
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
    /// What moves the weights.
    pub optimizer: Optimizer,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Steps of linear warm-up.
    pub n_warmup: usize,
    /// Decoupled weight decay.
    pub weight_decay: f32,
    /// Momentum of the key encoder at the start; it ends at one.
    pub momentum: f64,
    /// Whether pairs are mirrored.
    pub flips: Flips,
    /// Smallest share of each side that a random crop keeps.
    pub min_crop: f32,
    /// Share of a batch that are neighbours of the pair before, a few mm and degrees away.
    pub near_share: f64,
    /// Largest share of a batch that may be pairs without an edge in either view; one: no limit.
    pub max_blank: f64,
    /// What becomes of pairs that no picture can tell apart.
    pub false_negatives: FalseNegatives,
    /// Steps between checkpoints and validations.
    pub save_every: usize,
    /// Seed of weights, batches and augmentation.
    pub seed: u64,
}

impl TrainConfig {
    /// Minutes on two cores.
    pub fn tiny() -> Self {
        Self {
            preset: Preset::Tiny,
            network: NetworkConfig::TINY,
            n_steps: 500,
            n_pairs: 192,
            n_shards: 2,
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
            false_negatives: FalseNegatives::Keep,
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
            n_shards: 8,
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
        }
    }

    /// The loss of a network that has learnt nothing: 4 tau ln N, symmetrised.
    pub fn chance_loss(&self) -> f64 {
        4.0 * self.temperature * (self.n_pairs as f64).ln()
    }

    /// Refuses settings that make no run, by the name that flags and files give them.
    pub fn validate(&self) -> Result<()> {
        let network = &self.network;
        let counts = [
            ("steps", self.n_steps, 1, 1 << 32),
            ("shards", self.n_shards, 1, 256),
            ("batch", self.n_pairs, 2 * self.n_shards, 1 << 16),
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
                let why = if name == "batch" && n < least { ", two for each of the shards" } else { "" };
                return Err(Error::invalid(name, format!("{least} to {most}{why}"), n.to_string()));
            }
        }
        // A temperature below a thousandth overflows f32 in the exponent's gradient, far above any in use.
        let numbers = [
            ("temperature", self.temperature, 1e-3, 1e3),
            ("learning_rate", self.learning_rate, 1e-12, 1e3),
            ("weight_decay", f64::from(self.weight_decay), 0.0, 1e3),
            ("momentum", self.momentum, 0.0, 1.0),
            ("min_crop", f64::from(self.min_crop), 0.1, 1.0),
            ("near_share", self.near_share, 0.0, 1.0),
            ("max_blank", self.max_blank, 0.0, 1.0),
        ];
        for (name, value, least, most) in numbers {
            // min_crop is an f32: 0.1 is not quite 0.1.
            if !(least - 1e-6..=most).contains(&value) {
                return Err(Error::invalid(name, format!("{least} to {most}"), value.to_string()));
            }
        }
        Ok(network.validate()?)
    }
}

/// Steps that see `n_training` pairs `n_epochs` times in batches of `n_pairs`; at least one.
pub fn steps_of(n_epochs: f64, n_training: usize, n_pairs: usize) -> usize {
    let steps = (n_epochs * n_training as f64 / n_pairs.max(1) as f64).ceil();
    // A NaN and what no machine lives to see end as validate's errors.
    (steps as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_a_run() {
        for config in [TrainConfig::tiny(), TrainConfig::small(), TrainConfig::paper(11_100)] {
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
        assert_eq!(refusal(|c| c.n_pairs = 3), "batch: expected 4 to 65536, two for each of the shards, got 3");
    }

    /// Symmetrised MoCo-v3 loss of a network that has learnt nothing (training notes: 4 tau ln N).
    #[test]
    fn chance_is_the_published_value() {
        let config = TrainConfig { n_pairs: 256, temperature: 0.2, ..TrainConfig::tiny() };
        assert!((config.chance_loss() - 4.44).abs() < 0.005);
    }
}

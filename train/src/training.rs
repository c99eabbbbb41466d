//! How much a network is trained that is not the encoder: the one that draws maps, the one that judges by them.

use tactile_infer::maps::MapConfig;
use tactile_infer::maps::verifier::VerifierConfig;

use crate::error::{Error, Result};
use crate::settings::Settings;

/// What is trained, and how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Training<N> {
    /// The network.
    pub network: N,
    /// Steps.
    pub n_steps: usize,
    /// Touches of a step.
    pub batch: usize,
    /// Peak learning rate of AdamW.
    pub learning_rate: f64,
    /// Draws weights and batches.
    pub seed: u64,
    /// Steps between two saves, each after a look at what is held out.
    pub save_every: usize,
}

impl Default for Training<MapConfig> {
    /// A quarter of an hour on two cores.
    fn default() -> Self {
        let network = MapConfig { input_px: [40, 30], width: 16 };
        Self { network, n_steps: 6_000, batch: 64, learning_rate: 3e-3, seed: 1, save_every: 500 }
    }
}

impl Default for Training<VerifierConfig> {
    fn default() -> Self {
        let network = VerifierConfig { width: 16, bound: 8.0 };
        Self { network, n_steps: 4_000, batch: 16, learning_rate: 3e-3, seed: 1, save_every: 500 }
    }
}

impl Training<MapConfig> {
    /// The defaults, but for what the settings say.
    ///
    /// # Errors
    /// A setting that says nothing to a network that draws maps, or is out of range.
    pub fn of(settings: &Settings) -> Result<Self> {
        let of = Self::default();
        let Settings { width, input_px, .. } = *settings;
        let network =
            MapConfig { input_px: input_px.unwrap_or(of.network.input_px), width: width.unwrap_or(of.network.width) };
        network.validate()?;
        let known = Settings { width, input_px, ..Settings::default() };
        Self { network, ..of }.but_for(
            settings,
            known,
            "steps, batch, seed, width, input_px, learning_rate and save_every",
        )
    }
}

impl Training<VerifierConfig> {
    /// The defaults, but for what the settings say.
    ///
    /// # Errors
    /// A setting that says nothing to a network that judges, or is out of range.
    pub fn of(settings: &Settings) -> Result<Self> {
        let of = Self::default();
        let width = settings.width;
        let network = VerifierConfig { width: width.unwrap_or(of.network.width), ..of.network };
        network.validate()?;
        let known = Settings { width, ..Settings::default() };
        Self { network, ..of }.but_for(settings, known, "steps, batch, seed, width, learning_rate and save_every")
    }
}

impl<N> Training<N> {
    /// The same, but for what the settings say; those of the network are known already.
    fn but_for(self, settings: &Settings, known: Settings, names: &str) -> Result<Self> {
        let Settings { steps, batch, seed, learning_rate, save_every, .. } = *settings;
        if *settings != (Settings { steps, batch, seed, learning_rate, save_every, ..known }) {
            return Err(Error::invalid("settings", format!("{names} alone"), "others"));
        }
        let training = Self {
            network: self.network,
            n_steps: steps.unwrap_or(self.n_steps),
            batch: batch.unwrap_or(self.batch),
            learning_rate: learning_rate.unwrap_or(self.learning_rate),
            seed: seed.unwrap_or(self.seed),
            save_every: save_every.unwrap_or(self.save_every),
        };
        for (name, n) in [("steps", training.n_steps), ("save_every", training.save_every)] {
            if n == 0 {
                return Err(Error::invalid(name, "one or more", "0"));
            }
        }
        if !(2..=4_096).contains(&training.batch) {
            return Err(Error::invalid("batch", "2 to 4096 touches", training.batch.to_string()));
        }
        if !(training.learning_rate > 0.0 && training.learning_rate < 1.0) {
            return Err(Error::invalid("learning_rate", "above 0 and below 1", training.learning_rate.to_string()));
        }
        Ok(training)
    }
}

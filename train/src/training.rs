//! How much a network is trained that is not the encoder: the one that draws maps, the one that judges by them.

use std::path::PathBuf;

use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsParams};
use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use tactile_infer::maps::MapConfig;
use tactile_infer::maps::verifier::VerifierConfig;

use crate::error::{Error, Result};
use crate::schedule::learning_rate;
use crate::settings::Settings;

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained<J> {
    /// The file that was written last.
    pub file: PathBuf,
    /// Steps made.
    pub step: usize,
    /// What that file is worth.
    pub judgement: J,
}

/// What a run asks and tells as it goes on.
pub(crate) struct Watch<'a, J> {
    /// Asked before each step; true ends the run, which saves.
    pub should_stop: &'a dyn Fn() -> bool,
    /// Each step's number and loss, and after a save what it is worth.
    pub on_step: &'a mut dyn FnMut(usize, f64, Option<J>),
}

/// `ln(1 + e^x) - share x`: what it costs to say log-odds `x` where a share is right.
pub(crate) fn surprise<const D: usize>(odds: Tensor<D>, share: Tensor<D>) -> Tensor<D> {
    let size = odds.clone().abs();
    relu(odds.clone()) + size.neg().exp().log1p() - share * odds
}

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
    /// Makes the steps by AdamW: `cost` of a network at a step, from 1 on, until it has no more; `save` writes a network after so
    /// many. Returns the steps made and what was saved last.
    pub(crate) fn run<M: Module, J: Copy>(
        &self,
        mut network: M,
        mut cost: impl FnMut(&M, usize) -> Result<Option<Tensor<1>>>,
        save: impl Fn(&M, usize) -> Result<J>,
        watch: Watch<'_, J>,
    ) -> Result<(usize, J)> {
        let mut optimizer = AdamWConfig::new().with_epsilon(1e-8).with_weight_decay(1e-4).init();
        let (mut made, mut last) = (0, None);
        while made < self.n_steps && !(watch.should_stop)() {
            let step = made + 1;
            let Some(cost) = cost(&network, step)? else { break };
            let gradients = GradientsParams::from_grads(cost.backward(), &network);
            let warmup = (self.n_steps / 20).max(1);
            let rate = learning_rate(made, warmup, self.n_steps, self.learning_rate);
            network = optimizer.step(rate, network, gradients);
            let cost = f64::from(cost.into_scalar::<f32>());
            if !cost.is_finite() {
                let (seen, advice) = (format!("a loss of {cost}"), "a smaller learning_rate");
                return Err(Error::Diverged { step, seen, advice, kept: last.map(|(step, _)| step) });
            }
            made = step;
            let is_save = step == self.n_steps || step.is_multiple_of(self.save_every);
            let found = if is_save { Some(save(&network, step)?) } else { None };
            last = found.map(|found| (step, found)).or(last);
            (watch.on_step)(step, cost, found);
        }
        match last {
            Some((step, judgement)) if step == made => Ok((made, judgement)),
            _ => Ok((made, save(&network, made)?)),
        }
    }

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

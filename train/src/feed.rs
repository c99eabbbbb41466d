//! Where the pictures of a step come from: made by the processor, or on a graphics card from pictures that are there.

use burn::tensor::{Device, Tensor};
use tactile_infer::embedding::network::is_card;

use crate::batch::Batch;
#[cfg(feature = "wgpu")]
use crate::card_frames::CardFrames;
use crate::config::TrainConfig;
use crate::error::Result;
use crate::pairs::Pairs;

/// The pairs of a run, and what makes pictures of them.
#[derive(Debug)]
pub struct Feed<'a> {
    pairs: &'a Pairs<'a>,
    config: &'a TrainConfig,
    #[cfg(feature = "wgpu")]
    card: Option<CardFrames>,
}

/// What is prepared of a step before it begins.
#[derive(Debug)]
pub enum Prepared {
    /// The pictures themselves.
    Pictures(Batch),
    /// Which pairs, and how each is changed: the pictures are on the card.
    #[cfg(feature = "wgpu")]
    Drawn(Vec<crate::batch::Drawn>),
}

impl<'a> Feed<'a> {
    /// Pictures for a device.
    ///
    /// # Errors
    /// Frames that cannot be trained on.
    pub fn new(pairs: &'a Pairs<'a>, config: &'a TrainConfig, device: &Device) -> Result<Self> {
        #[cfg(feature = "wgpu")]
        let card = if is_card(device) { Some(CardFrames::new(pairs, device)?) } else { None };
        #[cfg(not(feature = "wgpu"))]
        debug_assert!(!is_card(device));
        Ok(Self {
            pairs,
            config,
            #[cfg(feature = "wgpu")]
            card,
        })
    }

    /// What can be made of a step without its device.
    ///
    /// # Errors
    /// Too few pairs for a batch; frames that cannot be trained on.
    pub fn prepare(&self, step: usize) -> Result<Prepared> {
        #[cfg(feature = "wgpu")]
        if self.card.is_some() {
            return Ok(Prepared::Drawn(self.pairs.draw(self.config, step)?));
        }
        Ok(Prepared::Pictures(self.pairs.batch(self.config, step)?))
    }

    /// The pictures of a step, holes, then pegs: `[2 n_m, 3, height, width]` for each micro-batch.
    pub fn micro_batches(&self, prepared: &Prepared, device: &Device) -> Vec<Tensor<4>> {
        let n = self.config.n_micro_batches;
        match prepared {
            Prepared::Pictures(batch) => batch.micro_batches(n, self.config.network.input_px, device),
            #[cfg(feature = "wgpu")]
            Prepared::Drawn(drawn) => {
                self.card.iter().flat_map(|card| card.micro_batches(self.pairs, drawn, n, device)).collect()
            }
        }
    }
}

//! The camera, the gel and its frame at rest, bound to a model.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Background, Frame};
use tactile_data::light::lamps::Lamps;
use tactile_infer::Model;

use crate::error::Result;
use crate::touch::Observation;

/// Makes observations of frames.
#[derive(Clone, Debug)]
pub struct Sensor {
    model: Arc<Model>,
    background: Background,
    side: Side,
}

impl Sensor {
    /// A sensor that touches holes, and whose frame at rest, without contact, is `no_contact`.
    ///
    /// # Errors
    /// [`Error::Frame`](crate::Error::Frame) where that frame is dark, saturated, uniform or smaller than the model's input.
    pub fn new(model: Arc<Model>, no_contact: &Frame) -> Result<Self> {
        let background = model.background(no_contact)?;
        Ok(Self { model, background, side: Side::default() })
    }

    /// The same sensor, touching this side: holes, or the raised parts that the bank's views are of.
    #[must_use]
    pub fn of_side(self, side: Side) -> Self {
        Self { side, ..self }
    }

    /// The same sensor, whose lamps are known from a calibration (`tactile-data calibrate`): its pictures are brought under
    /// the lamps that the network knows. With `None`, or without this, they are taken to be a GelSight Mini's.
    ///
    /// # Errors
    /// Lamps that do not show slopes in all directions.
    pub fn lit_by<'a>(self, lamps: impl Into<Option<&'a Lamps>>) -> Result<Self> {
        let background = self.background.lit_by(lamps)?;
        Ok(Self { background, ..self })
    }

    /// The same sensor, side and lamps with another frame at rest.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_rest(&self, no_contact: &Frame) -> Result<Self> {
        let background = self.background.with_rest(no_contact)?;
        Ok(Self { background, ..self.clone() })
    }

    /// Which side it touches.
    pub fn side(&self) -> Side {
        self.side
    }

    /// The model that embeds its frames.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// What a frame of a touch shows: of the side that the sensor touches. Runs on the caller's thread, or on the rayon
    /// pool that it runs in.
    ///
    /// # Errors
    /// [`Error::Frame`](crate::Error::Frame) where the frame is dark, saturated, uniform or of another size.
    pub fn observe(&self, frame: &Frame) -> Result<Observation> {
        let image = self.background.tactile_image(frame)?;
        let edge_share = image.edge_share;
        let image = std::slice::from_ref(&image);
        let query = self.model.embed_side(image, self.side)?;
        let map = match self.model.maps() {
            // The episode knows the view: that of its bank.
            Some(maps) => maps.drawer().draw(image, self.side, maps.drawer().view_mm())?.pop().map(Box::new),
            None => None,
        };
        let model_sha256 = Some(self.model.sha256().clone());
        let odds = self.model.match_odds(self.side);
        let rarity = odds.map_or(0.0, |odds| odds.rarity_of(&query, edge_share)) as f32;
        Ok(Observation {
            query,
            edge_share,
            rarity,
            map,
            side: self.side,
            frame_hash: Some(hash(frame.rgb())),
            model_sha256,
        })
    }
}

/// FNV-1a over words of eight bytes: to tell two frames apart, not to withstand forgery.
fn hash(bytes: &[u8]) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let (words, rest) = bytes.as_chunks::<8>();
    let words = words.iter().map(|word| u64::from_le_bytes(*word));
    let all = words.chain(rest.iter().map(|byte| u64::from(*byte)));
    all.fold(0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(PRIME))
}

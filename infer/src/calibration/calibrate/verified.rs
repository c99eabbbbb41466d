//! What a verifier says of touches whose part and pose are known.

use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;
use tactile_data::pose::se2::Se2;

use crate::bank::Bank;
use crate::embedding::model::Model;
use crate::error::Result;
use crate::maps::align::{Drawing, Start, align};
use crate::maps::mosaic::Mosaics;
use crate::maps::verifier::{Verifier, compared};
use crate::maps::{MapDrawer, Maps};

/// How well the stated poses are known: one standard deviation, mm and degrees.
const STATED: [f64; 2] = [0.5, 1.0];

/// Judges touches of a side by a bank's maps.
pub(super) struct Judge<'a> {
    drawer: &'a MapDrawer,
    verifier: &'a Verifier,
    bank: &'a Bank,
    mosaics: &'a Mosaics,
    side: Side,
    view_mm: [f64; 2],
    /// What to expect of a touch on a part that the bank knows nothing of.
    usual: f64,
}

impl<'a> Judge<'a> {
    /// `None` where the model draws no maps, or the bank has none, or nobody fitted what a verifier's words are worth.
    pub(super) fn new(model: &'a Model, bank: &'a Bank, side: Side, view_mm: [f64; 2]) -> Option<Self> {
        let (drawer, mosaics) = (model.maps().map(Maps::drawer)?, bank.mosaics()?);
        let (verifier, usual) = (bank.verifier()?, bank.presence(side)?.usual);
        Some(Self { drawer, verifier, bank, mosaics, side, view_mm, usual })
    }

    pub(super) fn maps_sha256(&self) -> &str {
        self.verifier.sha256()
    }

    /// What it says of a touch near a pose of a part more than is expected there, nats.
    pub(super) fn more_than_expected(&self, image: &TactileImage, part: usize, pose: &Se2) -> Result<f64> {
        let Self { drawer, verifier, bank, mosaics, side, view_mm, usual } = *self;
        let mosaic = mosaics.of(part, side);
        let said = drawer.draw(std::slice::from_ref(image), side, view_mm)?.into_iter().map(|map| {
            let drawing = Drawing { map: &map, first_from_sensor: Se2::IDENTITY };
            let found = align(&[drawing], &mosaic, &Start::known_to(*pose, STATED));
            verifier.log_odds(&compared((&map, side), &mosaic, &found.part_from_first))
        });
        let expected = bank.expected().and_then(|expected| expected.of(part, side));
        Ok(said.sum::<f64>() - expected.map_or(usual, |expected| expected.mean))
    }
}

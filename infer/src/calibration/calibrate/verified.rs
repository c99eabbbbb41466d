//! What a verifier says of touches whose part and pose are known.

use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;
use tactile_data::pose::se2::Se2;

use crate::bank::Bank;
use crate::embedding::model::Model;
use crate::error::Result;
use crate::maps::align::{Drawing, Start, align};
use crate::maps::mosaic::Mosaics;
use crate::maps::strain::Strain;
use crate::maps::verifier::{Verifier, compared};
use crate::maps::{MapDrawer, Maps};

/// How well the stated poses are known: one standard deviation, mm and degrees.
const STATED: [f64; 2] = [0.5, 1.0];

/// What a touch came to, more than touches of its part under a simulated sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Judged {
    /// What the verifier says, nats.
    pub(super) nats: f64,
    /// How much larger the part seems, where the bank knows what is usual.
    pub(super) strain: Option<Strain>,
}

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

    /// What a touch near a pose of a part comes to there, more than is expected.
    pub(super) fn more_than_expected(&self, image: &TactileImage, part: usize, pose: &Se2) -> Result<Vec<Judged>> {
        let Self { drawer, verifier, bank, mosaics, side, view_mm, usual } = *self;
        let mosaic = mosaics.of(part, side);
        let expected = bank.expected().and_then(|expected| expected.of(part, side)).map_or(usual, |spread| spread.mean);
        let usual_strain = bank.expected().and_then(|expected| expected.strain_of(part, side));
        let judged = drawer.draw(std::slice::from_ref(image), side, view_mm)?.into_iter().map(|map| {
            let drawing = Drawing { map: &map, first_from_sensor: Se2::IDENTITY };
            let found = align(&[drawing], &mosaic, &Start::known_to(*pose, STATED)).part_from_first;
            let strain = usual_strain.map(|usual| Strain::of(&[drawing], &mosaic, &found).against(&usual));
            Judged { nats: verifier.log_odds(&compared((&map, side), &mosaic, &found)) - expected, strain }
        });
        Ok(judged.collect())
    }
}

//! What a verifier says of touches whose part and pose are known.

use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;
use tactile_data::pose::se2::Se2;

use crate::bank::Bank;
use crate::calibration::presence::{PresenceOdds, misfit_nats};
use crate::calibration::{OfVerifier, Spread};
use crate::embedding::model::Model;
use crate::error::Result;
use crate::maps::align::{Drawing, Start, align};
use crate::maps::mosaic::Mosaics;
use crate::maps::sensor_offset::SensorOffset;
use crate::maps::strain::Strain;
use crate::maps::verifier::{Verifier, compared};
use crate::maps::{DrawnMap, MapDrawer, Maps};

/// How well the stated poses are known: one standard deviation, mm and degrees.
const STATED: [f64; 2] = [0.5, 1.0];

/// What a touch came to, more than touches of its part under a simulated sensor.
struct Judged {
    map: DrawnMap,
    part: usize,
    part_from_sensor: Se2,
    /// What the verifier says, nats.
    nats: f64,
    /// How the part seems to differ in size, where the bank knows what is usual.
    strain: Option<Strain>,
}

/// Judges a sensor's touches of a side by a bank's maps.
pub(super) struct Judge<'a> {
    drawer: &'a MapDrawer,
    verifier: &'a Verifier,
    bank: &'a Bank,
    mosaics: &'a Mosaics,
    side: Side,
    view_mm: [f64; 2],
    /// What to expect of a touch on a part that the bank knows nothing of.
    usual: f64,
    /// How far the maps of a part that is there are off, nats.
    usual_misfit: f64,
    judged: Vec<Judged>,
}

impl<'a> Judge<'a> {
    /// `None` where the model draws no maps, or the bank has none, or nobody fitted what a verifier's words are worth.
    pub(super) fn new(model: &'a Model, bank: &'a Bank, side: Side, view_mm: [f64; 2]) -> Option<Self> {
        let (drawer, mosaics) = (model.maps().map(Maps::drawer)?, bank.mosaics()?);
        let (verifier, PresenceOdds { usual, usual_misfit, .. }) = (bank.verifier()?, *bank.presence(side)?);
        Some(Self { drawer, verifier, bank, mosaics, side, view_mm, usual, usual_misfit, judged: Vec::new() })
    }

    /// Judges a touch near a pose of a part.
    pub(super) fn judge(&mut self, image: &TactileImage, part: usize, pose: &Se2) -> Result<()> {
        let Self { drawer, verifier, bank, side, view_mm, usual, .. } = *self;
        let mosaic = self.mosaics.of(part, side);
        let expected = bank.expected().and_then(|expected| expected.of(part, side)).map_or(usual, |spread| spread.mean);
        let usual_strain = bank.expected().and_then(|expected| expected.strain_of(part, side));
        self.judged.extend(drawer.draw(std::slice::from_ref(image), side, view_mm)?.into_iter().map(|map| {
            let drawing = Drawing { map: &map, first_from_sensor: Se2::IDENTITY };
            let part_from_sensor = align(&[drawing], &mosaic, &Start::known_to(*pose, STATED)).part_from_first;
            let strain = usual_strain.map(|usual| Strain::of(&[drawing], &mosaic, &part_from_sensor).against(&usual));
            let nats = verifier.log_odds(&compared((&map, side), &mosaic, &part_from_sensor)) - expected;
            Judged { map, part, part_from_sensor, nats, strain }
        }));
        Ok(())
    }

    /// What all the touches show of the sensor; `None` without any.
    pub(super) fn of_sensor(&self) -> Option<OfVerifier> {
        let nats: Vec<f64> = self.judged.iter().map(|touch| touch.nats).collect();
        let strains = self.judged.iter().filter_map(|touch| touch.strain.as_ref());
        let strain = strains.fold(SensorOffset::default(), |known, strain| known.with_strain(strain)).mean;
        let misfits = self.judged.iter().filter_map(|Judged { map, part, part_from_sensor, .. }| {
            let drawing = Drawing { map, first_from_sensor: Se2::IDENTITY };
            let misfit =
                self.mosaics.of(*part, self.side).misfit_of(self.side, &[drawing], part_from_sensor, strain)?;
            Some(misfit_nats(misfit) - self.usual_misfit)
        });
        (!nats.is_empty()).then(|| OfVerifier {
            maps_sha256: self.verifier.sha256().to_owned(),
            nats: Spread::from_values(&nats).mean,
            n_touches: nats.len(),
            strain,
            misfit: misfits.fold(SensorOffset::default(), |known, nats| known.with_misfit(nats)).mean,
        })
    }
}

//! What the maps of an episode's touches say of a part: where it is, and whether it is there at all.
//!
//! In: the bank's map of the part, the maps of the touches, a pose to begin with. Out: the pose at which they fit, and what the
//! verifier says of them there. It must not know thresholds.

use tactile_data::pose::se2::Se2;
use tactile_infer::calibration::presence::Verified;
use tactile_infer::maps::align::Drawing;
use tactile_infer::maps::coverage::outline_mm;
use tactile_infer::maps::mosaic::Mosaics;
use tactile_infer::maps::strain::Strain;
use tactile_infer::maps::verifier::compared;

use crate::belief::Hill;
use crate::decision::verdict::{Asked, Placed};

/// A part's pose by maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Laid {
    pub(super) part_from_first: Se2,
    /// The belief around it.
    pub(super) hill: Hill,
    /// What the verifier says of all touches there, where there is one.
    pub(super) verified: Option<Verified>,
}

/// A touch that was drawn.
pub(super) struct Drawn<'a> {
    pub(super) drawing: Drawing<'a>,
    new_share: f64,
    is_blank: bool,
}

impl<'a> Asked<'a> {
    /// The touches laid over the map of a part, from the pose that is believed; `None` without maps of both.
    pub(super) fn laid(self, part: usize, believed: &Se2) -> Option<Laid> {
        let mosaic = self.bank.mosaics().filter(|_| self.config.method.between_poses)?.of(part, self.side());
        let drawn = self.drawn();
        if drawn.is_empty() {
            return None;
        }
        let symmetry = self.bank.symmetry(part);
        let drawings: Vec<Drawing<'_>> = drawn.iter().map(|touch| touch.drawing).collect();
        let (part_from_first, hill) = self.belief.placed_by_maps((part, believed), &symmetry, &drawings, &mosaic);
        let verifier = self.bank.verifier().filter(|_| self.config.settings.verify > 0);
        let verified = verifier.map(|verifier| {
            // Where no edge was felt the belief knows; a verifier may be sure of the contrary where an outline is just out of view.
            let edged = || drawn.iter().filter(|touch| !touch.is_blank);
            let log_odds = |Drawing { map, first_from_sensor }: &Drawing<'_>| {
                let part_from_sensor = part_from_first * *first_from_sensor;
                verifier.log_odds(&compared((map, self.side()), &mosaic, &part_from_sensor))
            };
            Verified {
                log_odds: edged().map(|touch| touch.new_share * log_odds(&touch.drawing)).sum(),
                n_new: edged().map(|touch| touch.new_share).sum(),
                expected: self.bank.expected().and_then(|expected| expected.of(part, self.side())),
                outline_mm: outline_mm(&mosaic, &drawings, &part_from_first),
                ..Verified::default()
            }
        });
        Some(Laid { part_from_first, hill, verified })
    }

    /// What a verifier says of a place, with how the part that was touched differs in size and in shape from the one that would be there.
    pub(super) fn compared(self, part: usize, placed: Placed) -> Placed {
        let side = self.side();
        let usual = self.bank.expected().and_then(|expected| expected.strain_of(part, side));
        // A hole reads unlike its peg: by how much, only a bank of a scene knows.
        let is_known = |mosaics: &&Mosaics| usual.is_some() || mosaics.side_for(side) == side;
        let Some((verified, mosaics)) = placed.verified.zip(self.bank.mosaics().filter(is_known)) else {
            return placed;
        };
        let (drawn, mosaic) = (self.drawn(), mosaics.of(part, side));
        let all: Vec<Drawing<'_>> = drawn.iter().map(|touch| touch.drawing).collect();
        let edged = drawn.iter().filter(|touch| !touch.is_blank).map(|touch| touch.drawing);
        let edged: Vec<Drawing<'_>> = edged.collect();
        let strain = Strain::of(&edged, &mosaic, &placed.part_from_first);
        let seems = self.config.sensor.strain(self.model);
        let verified = Verified {
            strain: Some(usual.map_or(strain, |usual| strain.against(&usual))),
            misfit: mosaic.misfit_of(side, &all, &placed.part_from_first, seems),
            ..verified
        };
        Placed { verified: Some(verified), ..placed }
    }

    /// The touches that were drawn.
    pub(super) fn drawn(self) -> Vec<Drawn<'a>> {
        let made = self.belief.touches().iter().zip(self.touches);
        let drawn = made.filter_map(|(touched, (_, observation))| {
            let map = observation.map.as_deref()?;
            let drawing = Drawing { map, first_from_sensor: touched.first_from_sensor };
            Some(Drawn { drawing, new_share: touched.weight, is_blank: touched.likelihood.blank })
        });
        drawn.collect()
    }
}

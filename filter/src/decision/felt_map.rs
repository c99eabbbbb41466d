//! What an episode's touches show of what they were made on: their maps, stitched where the named part would be.
//!
//! In: the maps of the touches, the estimated pose, the bank's map of the part. Out: one mosaic, and how it differs from the part's.

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_infer::Bank;
use tactile_infer::maps::align::Drawing;
use tactile_infer::maps::mosaic::{Difference, Mosaic, Mosaics, Stitcher};
use tactile_infer::maps::picture::compared;

use crate::decision::candidates::Candidates;
use crate::decision::verdict::Asked;
use crate::error::Result;

/// What touches show of what they were made on.
#[derive(Clone, Debug, PartialEq)]
pub struct FeltMap {
    /// The part that is named, about whose origin it is.
    pub part: String,
    /// What was touched.
    pub side: Side,
    /// One mosaic, of the touches of the episode.
    pub mosaics: Mosaics,
    /// How it (first) differs from the bank's map of the part (second), where the bank has one.
    pub difference: Option<Difference>,
}

impl FeltMap {
    /// The mosaic.
    pub fn mosaic(&self) -> Mosaic<'_> {
        self.mosaics.of(0, self.side)
    }

    /// A picture of it, each cell of 0.3 mm `cell_px` wide and high: blue inside of what was touched, red outside, paler where it is
    /// less sure; the outline of the bank's part is green, and what differs from it yellow.
    ///
    /// # Errors
    /// None that an episode's bank gives.
    pub fn picture(&self, bank: &Bank, cell_px: usize) -> Result<Frame> {
        let part = bank.parts().iter().position(|name| *name == self.part);
        let of_part = part.zip(bank.mosaics()).map(|(part, mosaics)| mosaics.of(part, self.side));
        Ok(compared(&self.mosaic(), of_part.as_ref(), cell_px)?)
    }
}

impl Asked<'_> {
    /// The maps of the touches stitched at their estimated poses; `None` where none was drawn, or they reach nowhere.
    pub(crate) fn felt_map(self) -> Option<FeltMap> {
        let Candidates { part, placed, .. } = *self.candidates();
        let drawings: Vec<Drawing<'_>> = self.drawn().iter().map(|touch| touch.drawing).collect();
        let mosaics = Mosaics::stitched(&[Stitcher::of_touches(&drawings, &placed.part_from_first)?], None).ok()?;
        let side = self.side();
        let of_part = self.bank.mosaics().map(|mosaics| mosaics.of(part, side));
        let difference = of_part.map(|of_part| mosaics.of(0, side).difference(&of_part));
        Some(FeltMap { part: self.bank.parts()[part].clone(), side, mosaics, difference })
    }
}

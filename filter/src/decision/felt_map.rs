//! What an episode's touches show of what they were made on: their maps, stitched where the named part would be.
//!
//! In: the maps of the touches, the estimated pose, the bank's map of the part. Out: one mosaic, and how it differs from the part's.

use tactile_infer::maps::mosaic::{Difference, Mosaics, Stitcher};

use crate::decision::verdict::Asked;

/// What touches show of what they were made on.
#[derive(Clone, Debug, PartialEq)]
pub struct FeltMap {
    /// The part that is named, about whose origin it is.
    pub part: String,
    /// One mosaic, of the touches of the episode.
    pub mosaic: Mosaics,
    /// How it (first) differs from the bank's map of the part (second), where the bank has one.
    pub difference: Option<Difference>,
}

impl Asked<'_> {
    /// The maps of the touches stitched at their estimated poses; `None` where none was drawn, or they reach nowhere.
    pub(crate) fn felt_map(self) -> Option<FeltMap> {
        let verdict = self.verdict();
        let made = self.belief.touches().iter().zip(self.touches);
        let drawn = made.filter_map(|(touched, (_, observation))| {
            let pose = verdict.placed.part_from_first * touched.first_from_sensor;
            observation.map.as_deref().map(|map| (map, pose))
        });
        let drawn: Vec<_> = drawn.collect();
        let reach = drawn.iter().map(|(map, pose)| {
            let [width, height] = map.view_mm;
            pose.x_mm.abs().max(pose.y_mm.abs()) + 0.5 * width.hypot(height)
        });
        let mut stitcher = Stitcher::new(reach.reduce(f64::max)?);
        drawn.iter().for_each(|(map, pose)| stitcher.add(map, pose));
        let mosaic = Mosaics::stitched(&[stitcher], None).ok()?;
        let part = verdict.part;
        let of_part = self.bank.mosaics().map(|mosaics| mosaics.of(part, self.side()));
        let difference = of_part.map(|of_part| mosaic.of(0, self.side()).difference(&of_part));
        Some(FeltMap { part: self.bank.parts()[part].clone(), mosaic, difference })
    }
}

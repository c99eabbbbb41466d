//! The mosaics of recorded pegs: no drawing of the parts is needed for them.

use rayon::prelude::*;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;

use super::{Peg, pegs};
use crate::bank::Bank;
use crate::error::{Error, Result};
use crate::maps::mosaic::{Mosaics, Stitcher};
use crate::maps::{MapDrawer, Maps};

/// Touches that are drawn at a time.
const AT_ONCE: usize = 64;

/// A bank of a dataset's pegs, with a map of each as these networks draw and judge it. `progress`: touches done, and all.
///
/// # Errors
/// A dataset without pegs, or without one of a part; a peg whose part or pose is not known; frames that cannot be drawn.
pub fn with_maps_of_dataset(
    bank: Bank,
    maps: &Maps,
    dataset: &Dataset,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Bank> {
    let mosaics = mosaics_of_dataset(maps.drawer(), dataset, bank.parts(), progress)?;
    let bank = bank.with_mosaics(mosaics)?;
    match maps.verifier() {
        Some(verifier) => bank.verified_by(verifier.clone()),
        None => Ok(bank),
    }
}

/// Stitches the maps of all touches of a dataset's pegs, for the parts of a bank, in its order. `progress`: touches done, and all.
///
/// # Errors
/// A dataset without pegs, or without one of a part; a peg whose part or pose is not known; frames that cannot be drawn.
fn mosaics_of_dataset(
    drawer: &MapDrawer,
    dataset: &Dataset,
    parts: &[String],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Mosaics> {
    let pegs = pegs(dataset)?;
    let background = dataset.background(drawer.preprocessing())?;
    let farthest = pegs.iter().map(|peg| peg.pose.x_mm.abs().max(peg.pose.y_mm.abs())).fold(0.0, f64::max);
    let view_mm = dataset.meta().field_of_view_mm();
    let mut stitchers = vec![Stitcher::around(farthest, view_mm); parts.len()];
    let mut n_of_part = vec![0; parts.len()];
    for (done, some) in pegs.chunks(AT_ONCE).enumerate() {
        progress(done * AT_ONCE, pegs.len());
        let see = |peg: &Peg<'_>| Ok(background.tactile_image(&dataset.frame(peg.frame))?);
        let images = some.par_iter().map(see).collect::<Result<Vec<TactileImage>>>()?;
        for (map, peg) in drawer.draw(&images, Side::Peg, view_mm)?.iter().zip(some) {
            if let Some(part) = parts.iter().position(|part| part == peg.part) {
                stitchers[part].add(map, &peg.pose);
                n_of_part[part] += 1;
            }
        }
    }
    progress(pegs.len(), pegs.len());
    match n_of_part.iter().position(|n| *n == 0) {
        Some(part) => Err(Error::invalid(&dataset.meta().name, format!("touches of part {}", parts[part]), "none")),
        None => Mosaics::stitched(&stitchers, None),
    }
}

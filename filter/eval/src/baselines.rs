//! What one touch alone finds, by nearest neighbour: the paper's Pixel and MoCo (Sec. V-B).

use tactile_data::dataset::store::Dataset;
use tactile_data::frame::{Background, Frame, Preprocessing};
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::calibration::matching::{best, images_by_row, nearest_by_pixel, recorded_cosines};
use tactile_infer::embedding::threads;

use crate::banks::Banks;
use crate::error::{Error, Result};
use crate::evaluate::{Hole, Protocol, Scored, observe, score_row};
use crate::holes::Holes;
use tactile_filter::Sensor;

/// The nearest recorded embedding to the first touch of each episode.
pub fn moco(holes: Holes<'_>, sensor: &Sensor, banks: &Banks, protocol: &Protocol) -> Result<Vec<Scored>> {
    banks.each(holes, protocol, |index, bank| {
        let (hole, frame) = first_touch(holes, bank, protocol, index)?;
        let cosines = recorded_cosines(bank, &observe(sensor, &frame)?.query);
        Ok(score_row(best(cosines.into_iter()), bank, &hole))
    })
}

/// The nearest recorded frame to the first touch of each episode, by L1 distance of the difference
/// images: to the frames as they are, and to the frames turned inside out. All parts of the bank compete.
#[expect(clippy::too_many_arguments, reason = "the inputs of one baseline, used once")]
pub fn pixel(
    holes: Holes<'_>,
    model: &Model,
    bank: &Bank,
    pegs: &Dataset,
    no_contact: &Frame,
    protocol: &Protocol,
) -> Result<[Vec<Scored>; 2]> {
    let counts = Preprocessing::counts(model.config().input_px);
    let recorded = images_by_row(&Background::new(pegs.no_contact(), &counts)?, pegs, bank)?;
    let rest = Background::new(no_contact, &counts)?;
    let one = |index| {
        let (hole, frame) = first_touch(holes, bank, protocol, index)?;
        let image = rest.tactile_image(&frame)?;
        Ok::<_, Error>([1.0, -1.0].map(|sign| score_row(nearest_by_pixel(&image, &recorded, sign), bank, &hole)))
    };
    let scored = threads::each(protocol.episodes.clone(), one)?;
    Ok([0, 1].map(|sign| scored.iter().map(|both| both[sign]).collect()))
}

/// The hole of an episode and its first touch.
fn first_touch<'a>(holes: Holes<'a>, bank: &Bank, protocol: &Protocol, index: usize) -> Result<(Hole<'a>, Frame)> {
    let mut hole = protocol.hole(holes, bank.start(), index);
    let frame = hole.touch()?;
    Ok((hole, frame))
}

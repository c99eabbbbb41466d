//! What one touch alone tells, by nearest neighbour: the paper's Pixel and MoCo (Sec. V-B).

use rayon::prelude::*;
use tactile_data::frame::{Background, Frame, Preprocessing, TactileImage};
use tactile_data::simulator::Simulator;
use tactile_data::store::Dataset;
use tactile_infer::Model;
use tactile_infer::bank::{Bank, frames_by_row};
use tactile_infer::matching::{best, nearest_by_pixel};
use tactile_infer::similarity::part_mating;

use crate::episode::Eye;
use crate::error::Result;
use crate::offline::evaluate::{Hole, Protocol, Scored, score_row};

/// The nearest recorded embedding to the first touch of each episode.
pub fn moco(simulator: &Simulator, eye: &Eye<'_>, bank: &Bank, protocol: &Protocol) -> Result<Vec<Scored>> {
    first_touches(simulator, bank, protocol, |hole, frame| {
        let observation = eye.observe(&frame)?;
        let mut cosines = Vec::new();
        part_mating(&observation.query, bank, &mut cosines);
        score_row(best(cosines.into_iter()), bank, hole)
    })
}

/// The nearest recorded frame to the first touch of each episode, by L1 distance of the difference
/// images; `sign` -1 compares with the recorded frames turned inside out.
pub fn pixel(
    simulator: &Simulator,
    model: &Model,
    bank: &Bank,
    pegs: &Dataset,
    no_contact: &Frame,
    protocol: &Protocol,
    sign: f32,
) -> Result<Vec<Scored>> {
    let counts = Preprocessing::counts(model.config().input_px);
    let (_, frames) = frames_by_row(pegs, bank.grid())?;
    let rest = Background::new(pegs.no_contact(), &counts)?;
    let recorded = frames
        .par_iter()
        .map(|frame| Ok(rest.tactile_image(&pegs.frame(*frame))?))
        .collect::<Result<Vec<TactileImage>>>()?;
    let rest = Background::new(no_contact, &counts)?;
    first_touches(simulator, bank, protocol, |hole, frame| {
        score_row(nearest_by_pixel(&rest.tactile_image(&frame)?, &recorded, sign), bank, hole)
    })
}

fn first_touches(
    simulator: &Simulator,
    bank: &Bank,
    protocol: &Protocol,
    judge: impl Fn(&Hole<'_>, Frame) -> Result<Scored> + Sync,
) -> Result<Vec<Scored>> {
    (0..protocol.n_episodes)
        .into_par_iter()
        .map(|index| {
            let seed = protocol.seeds[index % protocol.seeds.len()];
            let mut hole = Hole::new(simulator, bank.grid(), protocol.poses, seed, index);
            let frame = hole.touch()?;
            judge(&hole, frame)
        })
        .collect()
}

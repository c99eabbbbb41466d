//! A few episodes told touch by touch, for the report.

use tactile_data::frame::{Background, Preprocessing};
use tactile_data::grid::PoseGrid;
use tactile_data::simulator::Simulator;
use tactile_infer::bank::Bank;

use crate::belief::Belief;
use crate::episode::{EpisodeConfig, Eye, StopReason};
use crate::error::Result;
use crate::offline::evaluate::{Protocol, run_one};
use crate::offline::report::{Board, EpisodeStory, PartPicture, TouchStory};

/// What all episodes of a scene share.
pub fn board(simulator: &Simulator, bank: &Bank) -> Result<Board> {
    let scene = simulator.scene();
    let part = |(index, name): (usize, &String)| {
        let outline_mm = scene.shape(index, 0)?.regions.into_iter().flatten().collect();
        Ok(PartPicture { name: name.clone(), outline_mm })
    };
    Ok(Board {
        parts: simulator.parts().iter().enumerate().map(part).collect::<Result<_>>()?,
        grid: *bank.grid(),
        field_of_view_mm: scene.sensor.field_of_view_mm,
    })
}

/// Plays the first `n` episodes of a protocol again, each until its own stopping rule ends it.
pub fn tell(
    simulator: &Simulator,
    eye: &Eye<'_>,
    bank: &Bank,
    config: &EpisodeConfig,
    protocol: &Protocol,
    n: usize,
) -> Result<Vec<EpisodeStory>> {
    let no_contact = simulator.no_contact(0);
    let rest = Background::new(&no_contact, &Preprocessing::counts([80, 60]))?;
    let tell_one = |index: usize| {
        let mut story = EpisodeStory {
            name: format!("Episode {}", index + 1),
            truth: 0,
            stop: format!("touch limit of {}", protocol.n_touches),
            refused: false,
            touches: Vec::new(),
        };
        let mut failed = Ok(());
        let mut over = false;
        run_one(simulator, eye, (bank, &[]), config, protocol, index, &mut |hole, frame, episode, estimate| {
            if over || failed.is_err() {
                return;
            }
            story.truth = hole.part_index();
            match rest.tactile_image(frame) {
                Ok(difference) => story.touches.push(TouchStory {
                    part_from_sensor: hole.part_from_sensor(),
                    frame: frame.clone(),
                    difference,
                    guess: bank.parts().iter().position(|part| *part == estimate.part).unwrap_or(0),
                    probability: estimate.probability,
                    fit: estimate.fit,
                    fit_needed: fit_needed(config, estimate.n_touches),
                    belief: places(episode.belief(), bank.grid(), bank.parts().len()),
                }),
                Err(error) => failed = Err(error.into()),
            }
            match config.stop(estimate.probability, estimate.fit, estimate.n_touches) {
                Some(StopReason::Confident) => {
                    story.stop = format!("more than {:.0} % sure", 100.0 * config.stop_probability);
                    over = true;
                }
                Some(StopReason::NoneOfThese) => {
                    story.stop = "none of these parts explains the touches".into();
                    story.refused = true;
                    over = true;
                }
                _ => {}
            }
        })?;
        if !over && story.touches.len() < protocol.n_touches {
            story.stop = "nowhere left to touch".into();
        }
        failed.map(|()| story)
    };
    (0..n.min(protocol.n_episodes)).map(tell_one).collect()
}

/// The fit that [`EpisodeConfig::stop`] asks for to be confident, where it asks at all.
pub(super) fn fit_needed(config: &EpisodeConfig, n_touches: usize) -> Option<f64> {
    (config.none_fit > f64::MIN).then(|| config.none_fit + config.fit_margin / n_touches as f64)
}

/// Probability of each recorded place of the first touch, `[part, x, y]`, summed over the angle.
pub(super) fn places(belief: &Belief, grid: &PoseGrid, n_parts: usize) -> Vec<f64> {
    let n_places = grid.n_xy().pow(2);
    let mut places = vec![0.0; n_places * n_parts];
    for (hypothesis, mass) in belief.states() {
        if let Some(cell) = grid.nearest(&belief.grid().pose(hypothesis.cell)) {
            places[hypothesis.part * n_places + cell / grid.n_theta()] += mass;
        }
    }
    places
}

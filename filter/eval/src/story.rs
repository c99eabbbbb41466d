//! A few episodes told touch by touch, for the report.

use std::sync::Arc;

use tactile_data::frame::{Background, Preprocessing};
use tactile_data::grid::PoseGrid;
use tactile_data::simulator::Simulator;
use tactile_infer::Bank;

use crate::error::Result;
use crate::evaluate::{Banks, Outcome, Protocol, run_one};
use crate::report::{Board, EpisodeStory, NextTouch, PartPicture, TouchStory};
use tactile_filter::belief::Belief;
use tactile_filter::{EpisodeConfig, Sensor, StopReason};

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

/// An episode to tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pick {
    /// Its number in the protocol, from 0.
    pub index: usize,
    /// Why it is told, in a few words.
    pub why: &'static str,
}

/// `n` episodes to tell, by their numbers: half of them, rounded up, are the first, which nobody chose; the others
/// are the most instructive by the stopping rule of `config`: those that stopped sure of a wrong part, then those
/// that refused their part, those that ended unsure of a wrong one, and those that took most touches.
pub fn pick(outcomes: &[Outcome], config: &EpisodeConfig, n: usize) -> Vec<Pick> {
    let n_first = n.div_ceil(2).min(outcomes.len());
    let mut others: Vec<_> = outcomes.iter().enumerate().skip(n_first).map(|(i, o)| (lesson(o, config), i)).collect();
    // Stable: the earliest of equals stays first.
    others.sort_by_key(|(lesson, _)| std::cmp::Reverse(*lesson));
    others.truncate(n - n.div_ceil(2));
    let first = (0..n_first).map(|index| Pick { index, why: "as one of the first" });
    let chosen = others.into_iter().map(|((rank, _), index)| {
        let why = match rank {
            3 => "because it was sure of a wrong part",
            2 => "because it refused its part",
            1 => "because it ended at a wrong part",
            _ => "as one of the longest",
        };
        Pick { index, why }
    });
    let mut picks: Vec<Pick> = first.chain(chosen).collect();
    picks.sort_by_key(|pick| pick.index);
    picks
}

/// How much there is to learn from an episode: a rank, then touches until it stops.
fn lesson(outcome: &Outcome, config: &EpisodeConfig) -> (usize, usize) {
    let scored = outcome.scored.iter().zip(1..);
    let stop = scored.clone().find_map(|(s, n)| Some((s, n, config.stop(s.probability, s.fit, n)?)));
    let last = scored.last().map(|(s, n)| (s, n, StopReason::TouchLimit));
    match stop.or(last) {
        Some((s, n, StopReason::Confident)) => (if s.right { 0 } else { 3 }, n),
        Some((_, n, StopReason::NoneOfThese)) => (2, n),
        Some((s, n, _)) => (usize::from(!s.right), n),
        None => (0, 0),
    }
}

/// Plays some episodes of a protocol again, each until its own stopping rule ends it. The choice of a touch
/// takes the time it needs, so that its reasons are whole.
pub fn tell(
    simulator: &Simulator,
    sensor: &Sensor,
    bank: &Arc<Bank>,
    config: &EpisodeConfig,
    protocol: &Protocol,
    picks: &[Pick],
) -> Result<Vec<EpisodeStory>> {
    let protocol = Protocol { choose_ms: None, ..protocol.clone() };
    let no_contact = simulator.no_contact(0);
    let rest = Background::new(&no_contact, &Preprocessing::counts([80, 60]))?;
    let banks = Banks::new(bank, &protocol);
    let tell_one = |Pick { index, why }: &Pick| {
        let mut story = EpisodeStory {
            name: format!("Episode {}", index + 1),
            why: (*why).into(),
            truth: 0,
            stop: format!("touch limit of {}", protocol.n_touches),
            refused: false,
            touches: Vec::new(),
        };
        let mut failed = Ok(());
        let mut over = false;
        run_one(simulator, sensor, &banks, config, &protocol, *index, &mut |hole, frame, episode, estimate| {
            if over || failed.is_err() {
                return;
            }
            story.truth = hole.part_index();
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
            let goes_on = !over && estimate.n_touches < protocol.n_touches;
            let candidates = if goes_on { hole.reach(bank.grid(), protocol.poses) } else { Vec::new() };
            let next = episode.judged(&candidates).map(|judgement| NextTouch {
                rule: config.action.rule,
                n_candidates: candidates.len(),
                judgement,
            });
            match rest.tactile_image(frame) {
                Ok(difference) => story.touches.push(TouchStory {
                    part_from_sensor: hole.part_from_sensor(),
                    frame: frame.clone(),
                    difference,
                    guess: bank.parts().iter().position(|part| *part == estimate.part).unwrap_or(0),
                    probability: estimate.probability,
                    guess_from_sensor: estimate.part_from_sensor,
                    fit: estimate.fit,
                    fit_needed: fit_needed(config, estimate.n_touches),
                    belief: places(episode.belief(), bank.grid(), bank.parts().len()),
                    next,
                }),
                Err(error) => failed = Err(error.into()),
            }
        })?;
        if !over && story.touches.len() < protocol.n_touches {
            story.stop = "nowhere left to touch".into();
        }
        failed.map(|()| story)
    };
    picks.iter().filter(|pick| pick.index < protocol.n_episodes).map(tell_one).collect()
}

/// The fit that [`EpisodeConfig::stop`] asks for to be confident, where it asks at all.
pub(super) fn fit_needed(config: &EpisodeConfig, n_touches: usize) -> Option<f64> {
    config.none_fit.map(|least| least + config.fit_margin / n_touches as f64)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Scored;

    /// An episode of four touches that is sure from `sure_at` on, with a fit, and right or not.
    fn outcome(sure_at: usize, fit: f64, right: bool) -> Outcome {
        let scored = |n: usize| Scored {
            probability: if n >= sure_at { 0.999 } else { 0.5 },
            fit: Some(fit),
            right,
            ..Scored::default()
        };
        Outcome { scored: (1..=4).map(scored).collect(), ..Outcome::default() }
    }

    #[test]
    fn half_are_the_first_and_half_the_most_instructive() {
        let config =
            EpisodeConfig { none_touches: 2, none_fit: Some(-1.0), fit_margin: 0.0, ..EpisodeConfig::default() };
        let outcomes = [
            outcome(1, 0.0, true),
            outcome(1, 0.0, true),
            outcome(1, 0.0, true),
            outcome(3, 0.0, true),  // 3: slower than the next
            outcome(2, 0.0, true),  // 4
            outcome(9, 0.0, false), // 5: ends unsure of a wrong part
            outcome(9, -2.0, true), // 6: refused at touch 2
            outcome(1, 0.0, false), // 7: sure of a wrong part
            outcome(3, 0.0, true),  // 8: as slow as 3
        ];
        let picked = |n| pick(&outcomes, &config, n).iter().map(|pick| pick.index).collect::<Vec<_>>();
        assert_eq!(picked(0), [] as [usize; 0]);
        assert_eq!(picked(1), [0]);
        assert_eq!(picked(2), [0, 7]);
        assert_eq!(picked(5), [0, 1, 2, 6, 7]);
        assert_eq!(picked(7), [0, 1, 2, 3, 5, 6, 7], "the earlier of the two slow ones");
        assert_eq!(picked(30).len(), 9);
        assert_eq!(pick(&outcomes, &config, 2)[1].why, "because it was sure of a wrong part");
    }
}

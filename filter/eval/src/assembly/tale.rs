//! One trial told touch by touch, as the paper's figure of belief maps has it.

use tactile_data::frame::{Background, Preprocessing};

use super::super::report::{EpisodeStory, TouchStory};
use super::super::story::{fit_needed, places};
use super::result::stop_name;
use super::{Attempt, Moment, Workcell};
use crate::error::Result;
use tactile_filter::StopReason;

/// Runs a trial again and tells each of its holes, in the order they were tried.
///
/// # Errors
/// As [`Workcell::trial`].
pub fn tell(workcell: &Workcell<'_>, trial: usize) -> Result<Vec<EpisodeStory>> {
    let rest = Background::new(&workcell.simulator.no_contact(0), &Preprocessing::counts([80, 60]))?;
    // A hole's touches follow each other; with its first touch a new hole begins.
    let mut touches: Vec<Vec<TouchStory>> = Vec::new();
    let attempts = workcell.trial(trial, &mut |moment: &Moment<'_>| {
        let told = touch(workcell, moment, &rest)?;
        match touches.last_mut() {
            Some(of_hole) if moment.episode.belief().touches().len() > 1 => of_hole.push(told),
            _ => touches.push(vec![told]),
        }
        Ok(())
    })?;
    let stories = attempts.iter().zip(touches).enumerate();
    Ok(stories.map(|(hole, (attempt, touches))| story(workcell, hole, attempt, touches)).collect())
}

fn touch(workcell: &Workcell<'_>, moment: &Moment<'_>, rest: &Background) -> Result<TouchStory> {
    let estimate = moment.episode.estimate();
    let (parts, grid) = (workcell.simulator.parts(), workcell.bank.grid());
    let index = |name: &String| parts.iter().position(|part| part == name);
    // Pegs that are in are believed nowhere.
    let n_places = grid.n_xy().pow(2);
    let mut belief = vec![0.0; parts.len() * n_places];
    let in_hand = moment.bank.parts();
    let of_parts = places(moment.episode.belief(), grid, in_hand.len());
    for (name, places) in in_hand.iter().zip(of_parts.chunks_exact(n_places)) {
        if let Some(part) = index(name) {
            belief[part * n_places..][..n_places].copy_from_slice(places);
        }
    }
    Ok(TouchStory {
        part_from_sensor: moment.hole.part_from_sensor(),
        frame: moment.frame.clone(),
        difference: rest.tactile_image(moment.frame)?,
        guess: index(&estimate.part).unwrap_or(0),
        probability: estimate.probability,
        guess_from_sensor: estimate.part_from_sensor,
        fit: estimate.fit,
        fit_needed: fit_needed(workcell.config, estimate.n_touches),
        belief,
        // What told most was judged among the pegs in hand.
        next: None,
    })
}

fn story(workcell: &Workcell<'_>, hole: usize, attempt: &Attempt, touches: Vec<TouchStory>) -> EpisodeStory {
    let parts = workcell.simulator.parts();
    let pegs = if attempt.n_pegs == 1 { "1 peg".into() } else { format!("{} pegs", attempt.n_pegs) };
    let Attempt { xy_mm, theta_deg, .. } = attempt;
    let came = match (attempt.named == attempt.part, attempt.went_in) {
        (true, true) => format!("its peg went in, {xy_mm:.2} mm and {theta_deg:.1}° off"),
        (true, false) => format!("its peg did not go in, {xy_mm:.2} mm and {theta_deg:.1}° off"),
        (false, true) => format!("the wrong peg, {}, went in", parts[attempt.named]),
        (false, false) => format!("the wrong peg, {}, did not go in", parts[attempt.named]),
    };
    EpisodeStory {
        name: format!("Hole {}: {}, with {pegs} in hand", hole + 1, parts[attempt.part]),
        why: "as one of its trial".into(),
        truth: attempt.part,
        stop: format!("{}; {came}", stop_name(attempt.stop)),
        refused: attempt.stop == StopReason::NoneOfThese,
        touches,
    }
}

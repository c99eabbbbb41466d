//! One trial of an assembly touch by touch, as the paper's figure of belief maps has it.

use tactile_data::frame::Background;
use tactile_filter::StopReason;

use super::{Attempt, Moment, Workcell};
use crate::error::Result;
use crate::narrative::{Narrative, NarrativeTouch, felt, places, shown_background};

/// Runs a trial again: each of its holes, in the order they were tried.
///
/// # Errors
/// As [`Workcell::trial`].
pub fn play_again(workcell: &Workcell<'_>, trial: usize) -> Result<Vec<Narrative>> {
    let rest = shown_background(&workcell.simulator().no_contact(0))?;
    // A hole's touches follow each other; with its first touch a new hole begins.
    let mut touches: Vec<Vec<NarrativeTouch>> = Vec::new();
    let attempts = workcell.trial(trial, &mut |moment: &Moment<'_>| {
        let recorded = touch(workcell, moment, &rest)?;
        match touches.last_mut() {
            Some(of_hole) if moment.episode.belief().touches().len() > 1 => of_hole.push(recorded),
            _ => touches.push(vec![recorded]),
        }
        Ok(())
    })?;
    let holes = attempts.iter().zip(touches).enumerate();
    Ok(holes.map(|(hole, (attempt, touches))| narrative(workcell, hole, attempt, touches)).collect())
}

fn touch(workcell: &Workcell<'_>, moment: &Moment<'_>, rest: &Background) -> Result<NarrativeTouch> {
    let estimate = moment.episode.estimate();
    let (parts, in_hand) = (workcell.simulator().parts(), moment.bank);
    let index = |name: &String| parts.iter().position(|part| part == name);
    // Pegs that are in are believed nowhere.
    let n_places = in_hand.start().n_xy().pow(2);
    let mut belief = vec![0.0; parts.len() * n_places];
    let of_parts = places(moment.episode.belief(), in_hand);
    for (name, places) in in_hand.parts().iter().zip(of_parts.chunks_exact(n_places)) {
        if let Some(part) = index(name) {
            belief[part * n_places..][..n_places].copy_from_slice(places);
        }
    }
    Ok(NarrativeTouch {
        part_from_sensor: moment.hole.part_from_sensor(),
        frame: moment.frame.clone(),
        difference: rest.tactile_image(moment.frame)?,
        guess: index(&estimate.part).unwrap_or(0),
        probability: estimate.probability,
        guess_from_sensor: estimate.part_from_sensor,
        presence: estimate.presence,
        belief,
        // The reasons for it name pegs in hand, not parts of the board.
        next: None,
        felt: if estimate.stop.is_some() { felt(moment.episode, in_hand)? } else { None },
    })
}

fn narrative(workcell: &Workcell<'_>, hole: usize, attempt: &Attempt, touches: Vec<NarrativeTouch>) -> Narrative {
    let parts = workcell.simulator().parts();
    let pegs = if attempt.n_pegs == 1 { "1 peg".into() } else { format!("{} pegs", attempt.n_pegs) };
    let Attempt { xy_mm, theta_deg, .. } = attempt;
    let came = match (attempt.named == attempt.part, attempt.went_in) {
        (true, true) => format!("its peg went in, {xy_mm:.2} mm and {theta_deg:.1}° off"),
        (true, false) => format!("its peg did not go in, {xy_mm:.2} mm and {theta_deg:.1}° off"),
        (false, true) => format!("the wrong peg, {}, went in", parts[attempt.named]),
        (false, false) => format!("the wrong peg, {}, did not go in", parts[attempt.named]),
    };
    Narrative {
        name: format!("Hole {}: {}, with {pegs} in hand", hole + 1, parts[attempt.part]),
        why: "as one of its trial".into(),
        truth: attempt.part,
        stop: format!("{}; {came}", attempt.stop_name()),
        refused: attempt.stop == StopReason::NoneOfThese,
        touches,
    }
}

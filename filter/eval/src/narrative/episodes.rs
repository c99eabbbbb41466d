//! Which episodes of an evaluation are shown touch by touch, and what happened in them.

use tactile_data::frame::{Background, Frame};
use tactile_filter::{Episode, EpisodeConfig, Estimate, StopReason};

use super::{Narrative, NarrativeTouch, NextTouch, felt, places, shown_background};
use crate::error::Result;
use crate::evaluate::{Hole, Outcome, Protocol, Run, run_one};

/// An episode to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pick {
    /// Its number in the protocol, from 0.
    pub index: usize,
    /// Why it is shown, in a few words.
    pub why: &'static str,
}

/// `n` episodes to show, by their numbers: half of them, rounded up, are the first, which nobody chose; the others
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
    let stop = scored.clone().find_map(|(s, n)| Some((s, n, config.stop(&s.standing(n))?)));
    let last = scored.last().map(|(s, n)| (s, n, StopReason::TouchLimit));
    match stop.or(last) {
        Some((s, n, StopReason::Confident)) => (if s.right { 0 } else { 3 }, n),
        Some((_, n, StopReason::NoneOfThese)) => (2, n),
        Some((s, n, _)) => (usize::from(!s.right), n),
        None => (0, 0),
    }
}

/// Plays some episodes of a run again, each until its own stopping rule ends it. The choice of a touch takes the time
/// it needs, so that its reasons are whole.
///
/// # Errors
/// A touch that cannot be made or seen.
pub fn play_again(run: &Run<'_>, picks: &[Pick]) -> Result<Vec<Narrative>> {
    let protocol = Protocol { choose_ms: None, ..run.protocol.clone() };
    let run = Run { protocol: &protocol, ..*run };
    let rest = shown_background(&run.holes.at_rest(&run.protocol.seeds))?;
    let play = |pick: &Pick| {
        let bank = run.banks.of(&protocol.hole(run.holes, run.banks.whole().start(), pick.index))?;
        let mut recorder = Recorder::new(run, &rest, pick);
        let mut recorded = Ok(());
        run_one(&run, &bank, pick.index, &mut |hole, frame, episode, estimate| {
            if !recorder.is_over && recorded.is_ok() {
                recorded = recorder.record(hole, frame, episode, estimate);
            }
        })?;
        recorded.map(|()| recorder.narrative())
    };
    picks.iter().filter(|pick| pick.index < protocol.n_episodes).map(play).collect()
}

/// Writes down an episode while it is played.
struct Recorder<'a> {
    run: Run<'a>,
    rest: &'a Background,
    narrative: Narrative,
    is_over: bool,
}

impl<'a> Recorder<'a> {
    fn new(run: Run<'a>, rest: &'a Background, pick: &Pick) -> Self {
        let narrative = Narrative {
            name: format!("Episode {}", pick.index + 1),
            why: pick.why.into(),
            truth: 0,
            stop: format!("touch limit of {}", run.protocol.n_touches),
            refused: false,
            touches: Vec::new(),
        };
        Self { run, rest, narrative, is_over: false }
    }

    /// Takes in a touch.
    fn record(&mut self, hole: &Hole<'_>, frame: &Frame, episode: &Episode, estimate: &Estimate) -> Result<()> {
        let Run { banks, config, protocol, .. } = self.run;
        let bank = banks.whole();
        let stop = config.stop(&estimate.standing());
        self.narrative.truth = hole.part_index();
        self.is_over = matches!(stop, Some(StopReason::Confident | StopReason::NoneOfThese));
        self.narrative.refused = stop == Some(StopReason::NoneOfThese);
        if self.narrative.refused {
            let why: String = estimate.warnings.iter().map(|warning| format!("; {warning}")).collect();
            self.narrative.stop = format!("none of these parts explains the touches{why}");
        } else if self.is_over {
            self.narrative.stop = format!("more than {:.0} % sure", 100.0 * config.settings.stop_probability);
        }
        let goes_on = !self.is_over && estimate.n_touches < protocol.n_touches;
        let candidates = if goes_on { hole.reach(bank.start(), protocol.poses) } else { Vec::new() };
        let (rule, n_candidates) = (config.method().rule, candidates.len());
        self.narrative.touches.push(NarrativeTouch {
            part_from_sensor: hole.part_from_sensor(),
            frame: frame.clone(),
            difference: self.rest.tactile_image(frame)?,
            guess: bank.parts().iter().position(|part| *part == estimate.part).unwrap_or(0),
            probability: estimate.probability,
            guess_from_sensor: estimate.part_from_sensor,
            presence: estimate.presence,
            belief: places(episode.belief(), bank),
            next: episode.explain(&candidates).map(|choice| NextTouch { rule, n_candidates, choice }),
            felt: if goes_on { None } else { felt(episode, bank)? },
        });
        Ok(())
    }

    fn narrative(mut self) -> Narrative {
        if !self.is_over && self.narrative.touches.len() < self.run.protocol.n_touches {
            self.narrative.stop = "nowhere left to touch".into();
        }
        self.narrative
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Scored;
    use tactile_filter::Presence;

    /// An episode of four touches that is sure from `sure_at` on, of a part that is there or one that is refused from the second
    /// touch on, and right or not.
    fn outcome(sure_at: usize, fit: f64, right: bool) -> Outcome {
        let presence = |n: usize| match fit {
            fit if fit >= 0.0 => Presence { log_odds: 9.0, stranger_rate: 0.0, present_rate: 1.0 },
            _ => Presence { log_odds: -9.0, stranger_rate: 1.0, present_rate: if n < 2 { 0.5 } else { 0.0 } },
        };
        let scored = |n: usize| Scored {
            probability: if n >= sure_at { 0.999 } else { 0.5 },
            presence: Some(presence(n)),
            right,
            ..Scored::default()
        };
        Outcome { scored: (1..=4).map(scored).collect(), ..Outcome::default() }
    }

    #[test]
    fn half_are_the_first_and_half_the_most_instructive() {
        let config = EpisodeConfig::default();
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

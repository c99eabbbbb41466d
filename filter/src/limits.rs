//! The most that an episode may be asked for: beyond, a setting is a mistake that takes all time or memory.

use tactile_data::number::short;

use crate::belief::EngineConfig;
use crate::belief::particle::ParticleConfig;
use crate::choice::ActionConfig;
use crate::config::EpisodeConfig;
use crate::error::{Error, Result};

/// The most touches of an episode. Each keeps 5.4 bytes for each view of the bank: its cosine (4), what it shows (1)
/// and the best of each line of places (0.4). In a bank of twelve large letters every 2 mm and 15 degrees, 68,796
/// views, that is 0.37 MB a touch, so that these are 0.4 GB; the hundred touches that a patient robot makes are a tenth
/// of it.
const MAX_TOUCHES: usize = 1_000;

/// The most states between two recorded poses on each axis. States grow with its third power: in the bank of
/// [`MAX_TOUCHES`] taking in one touch took up to 1.3 s with 8, on a busy machine 5.3 s, and 0.2 s with 4 (one core of
/// a cloud machine). More than 2 brought no accuracy (`NOTES.md`).
const MAX_SUBDIVISIONS: usize = 4;

/// The most pairs of a drawn and a supposed state that a decision weighs, over all motions that are judged by all draws
/// and those of the first pass. A pair took 5 to 6 ns (1,000 draws, 1,000 suppositions and 24 finalists: 130 ms), so
/// that a decision among [`MOTIONS`] takes at most 0.6 s. By default there are 2e5 of them.
const MAX_PAIRS: f64 = 1e8;

/// Motions that a robot is taken to offer; how many it really does is not known before.
const MOTIONS: usize = 1_000;

/// The first pass weighs a 36th of the pairs of draws and suppositions: a sixth of either.
const FIRST_PASS: f64 = 36.0;

/// The most particles times moves and one. Within ten touches of twelve small letters 200,000 particles of four moves
/// took up to 0.6 s a touch, a million of them up to 10.5 s (one core of a busy cloud machine): each move weighs all
/// touches again.
const MAX_MOVES: f64 = 1e6;

/// Refuses what takes more than a second for a decision, or more memory than a small computer has.
pub(crate) fn check(config: &EpisodeConfig) -> Result<()> {
    most("max_touches", config.max_touches, MAX_TOUCHES)?;
    most("subdivisions", config.subdivisions, MAX_SUBDIVISIONS)?;
    check_pairs(&config.action)?;
    match config.engine {
        EngineConfig::Particle(particle) => check_moves(&particle),
        EngineConfig::Exact => Ok(()),
    }
}

/// Refuses a number that is none or above the most.
fn most(name: &str, got: usize, most: usize) -> Result<()> {
    if (1..=most).contains(&got) {
        return Ok(());
    }
    Err(Error::config(format!("episode.{name}"), format!("1 to {most}"), got.to_string()))
}

/// The pairs that a decision weighs among [`MOTIONS`].
fn n_pairs(action: &ActionConfig) -> f64 {
    let motions = MOTIONS as f64;
    let judged = action.n_finalists.map_or(motions, |n| (n as f64).min(motions) + motions / FIRST_PASS);
    action.n_draws as f64 * action.n_suppositions as f64 * judged
}

fn check_pairs(action: &ActionConfig) -> Result<()> {
    let ActionConfig { n_draws, n_suppositions, n_finalists, .. } = *action;
    // Each alone: one draw of a million suppositions is as much a mistake.
    most("action.n_draws", n_draws, 100_000)?;
    most("action.n_suppositions", n_suppositions, 10_000)?;
    if n_finalists == Some(0) {
        return Err(Error::config("episode.action.n_finalists", "at least 1", "0"));
    }
    let pairs = n_pairs(action);
    if pairs <= MAX_PAIRS {
        return Ok(());
    }
    let finalists = n_finalists.map_or("all motions".into(), |n| format!("{n} finalists"));
    let got = format!("{n_draws} x {n_suppositions} for {finalists}, {} pairs", short(pairs.round()));
    let expected = format!("at most {MAX_PAIRS:e} pairs of draws and suppositions among {MOTIONS} motions");
    Err(Error::config("episode.action.n_draws, n_suppositions, n_finalists", expected, got))
}

fn check_moves(particle: &ParticleConfig) -> Result<()> {
    let ParticleConfig { n_particles, n_moves, .. } = *particle;
    most("engine.n_particles", n_particles, MAX_MOVES as usize)?;
    let moves = n_particles as f64 * (1.0 + n_moves as f64);
    if moves <= MAX_MOVES {
        return Ok(());
    }
    let expected = format!("at most {MAX_MOVES:e} particles times moves, one more than n_moves");
    Err(Error::config(
        "episode.engine.n_particles, n_moves",
        expected,
        format!("{n_particles} x {}", n_moves as f64 + 1.0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(config: EpisodeConfig) -> String {
        config.validate().map_or_else(|error| error.to_string(), |()| "nothing".into())
    }

    #[test]
    fn what_takes_all_time_or_memory_is_refused_by_name() {
        let good = EpisodeConfig::default();
        let action = |action: ActionConfig| EpisodeConfig { action, ..good };
        let particle = |n_particles, n_moves| EpisodeConfig {
            engine: EngineConfig::Particle(ParticleConfig { n_particles, n_moves, ..ParticleConfig::default() }),
            ..good
        };
        let of = ActionConfig::default();
        for (config, names) in [
            (
                EpisodeConfig { max_touches: MAX_TOUCHES + 1, ..good },
                "episode.max_touches: expected 1 to 1000, got 1001",
            ),
            (EpisodeConfig { max_touches: usize::MAX, ..good }, "episode.max_touches: expected 1 to 1000, got 18446"),
            (EpisodeConfig { max_touches: 0, ..good }, "episode.max_touches: expected 1 to 1000, got 0"),
            (EpisodeConfig { subdivisions: 5, ..good }, "episode.subdivisions: expected 1 to 4, got 5"),
            (action(ActionConfig { n_draws: usize::MAX, ..of }), "episode.action.n_draws: expected 1 to 100000"),
            (action(ActionConfig { n_suppositions: usize::MAX, ..of }), "episode.action.n_suppositions: expected 1 to"),
            (action(ActionConfig { n_finalists: Some(0), ..of }), "episode.action.n_finalists: expected at least 1"),
            (
                action(ActionConfig { n_draws: 100_000, ..of }),
                "episode.action.n_draws, n_suppositions, n_finalists: expected at most 1e8 pairs",
            ),
            (particle(usize::MAX, 0), "episode.engine.n_particles: expected 1 to 1000000"),
            (particle(250_000, 4), "episode.engine.n_particles, n_moves: expected at most 1e6"),
            (particle(1, usize::MAX), "episode.engine.n_particles, n_moves: expected at most 1e6"),
        ] {
            let refused = refused(config);
            assert!(refused.starts_with(names) && refused.len() < 200, "{names}: {refused}");
        }
    }

    #[test]
    fn what_is_used_and_measured_is_far_below() {
        let of = ActionConfig::default();
        assert!(n_pairs(&of) < MAX_PAIRS / 400.0, "{}", n_pairs(&of));
        // The richest settings that a trade-off measures.
        for (n_draws, n_suppositions, n_finalists) in [(320, 48, Some(48)), (160, 24, None)] {
            let action = ActionConfig { n_draws, n_suppositions, n_finalists, ..of };
            assert!(n_pairs(&action) < MAX_PAIRS / 20.0);
            assert_eq!(refused(EpisodeConfig { action, subdivisions: 3, ..EpisodeConfig::default() }), "nothing");
        }
        assert_eq!(refused(EpisodeConfig { max_touches: MAX_TOUCHES, ..EpisodeConfig::paper() }), "nothing");
    }

    #[test]
    fn a_share_of_edge_outside_0_to_1_is_refused() {
        for contact_threshold in [-0.1, 1.5, f32::NAN, f32::INFINITY] {
            let action = ActionConfig { contact_threshold, ..ActionConfig::default() };
            let refused = refused(EpisodeConfig { action, ..EpisodeConfig::default() });
            assert!(refused.starts_with("episode.action.contact_threshold: expected 0..=1"), "{refused}");
        }
    }
}

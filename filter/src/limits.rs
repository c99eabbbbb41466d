//! The most that an episode may be asked for: beyond, a setting is a mistake that takes all time or memory.

use tactile_data::number::short;

use crate::belief::particle::ParticleConfig;
use crate::error::{Error, Result};

/// The most touches of an episode. Each keeps 5.4 bytes for each view of the bank: its cosine (4), what it shows (1)
/// and the best of each line of places (0.4). In a bank of twelve large letters every 2 mm and 15 degrees, 68,796
/// views, that is 0.37 MB a touch, so that these are 0.4 GB; the hundred touches that a patient robot makes are a tenth
/// of it.
pub(crate) const MAX_TOUCHES: f64 = 1_000.0;

/// The most states between two recorded poses on each axis. States grow with its third power: in the bank of
/// [`MAX_TOUCHES`] taking in one touch took up to 1.3 s with 8, on a busy machine 5.3 s, and 0.2 s with 4 (one core of
/// a cloud machine). More than 2 brought no accuracy (`NOTES.md`).
pub(crate) const MAX_SUBDIVISIONS: f64 = 4.0;

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

/// How well motions are judged.
#[derive(Clone, Copy)]
pub(crate) struct Effort {
    /// States drawn, and states supposed true in turn.
    pub n_draws: usize,
    pub n_suppositions: usize,
    /// Motions judged by all draws; `None`: all.
    pub n_finalists: Option<usize>,
}

/// The pairs that a decision weighs among [`MOTIONS`].
fn n_pairs(effort: Effort) -> f64 {
    let motions = MOTIONS as f64;
    let scored = effort.n_finalists.map_or(motions, |n| (n as f64).min(motions) + motions / FIRST_PASS);
    effort.n_draws as f64 * effort.n_suppositions as f64 * scored
}

/// Refuses a choice of the next touch that takes more than a second.
pub(crate) fn check_effort(effort: Effort) -> Result<()> {
    let Effort { n_draws, n_suppositions, n_finalists } = effort;
    let pairs = n_pairs(effort);
    if pairs <= MAX_PAIRS {
        return Ok(());
    }
    let finalists = n_finalists.map_or("all motions".into(), |n| format!("{n} finalists"));
    let got = format!("{n_draws} x {n_suppositions} for {finalists}, {} pairs", short(pairs.round()));
    let expected = format!("at most {MAX_PAIRS:e} pairs of draws and suppositions among {MOTIONS} motions");
    Err(Error::config("episode.n_draws, n_suppositions, n_finalists", expected, got))
}

/// Refuses particles whose moves take more than a second at each touch.
pub(crate) fn check_moves(particle: &ParticleConfig) -> Result<()> {
    let ParticleConfig { n_particles, n_moves, .. } = *particle;
    if !(1..=MAX_MOVES as usize).contains(&n_particles) {
        let expected = format!("1 to {MAX_MOVES}");
        return Err(Error::config("episode.engine.n_particles", expected, n_particles.to_string()));
    }
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
    use crate::belief::EngineConfig;
    use crate::config::EpisodeConfig;
    use crate::settings::Settings;

    fn refused(config: EpisodeConfig) -> String {
        config.validate().map_or_else(|error| error.to_string(), |()| "nothing".into())
    }

    #[test]
    fn what_takes_all_time_or_memory_is_refused_by_name() {
        let set = |settings: Settings| EpisodeConfig { settings, ..EpisodeConfig::default() };
        let particle = |n_particles, n_moves| {
            let particle = ParticleConfig { n_particles, n_moves, ..ParticleConfig::default() };
            EpisodeConfig::default().changed(|_, _, method| method.engine = EngineConfig::Particle(particle))
        };
        let of = Settings::default();
        for (config, names) in [
            (set(Settings { max_touches: 1001, ..of }), "episode.max_touches: expected 1 to 1000, got 1001"),
            (set(Settings { max_touches: usize::MAX, ..of }), "episode.max_touches: expected 1 to 1000, got 18446"),
            (set(Settings { max_touches: 0, ..of }), "episode.max_touches: expected 1 to 1000, got 0"),
            (set(Settings { subdivisions: 5, ..of }), "episode.subdivisions: expected 1 to 4, got 5"),
            (set(Settings { n_draws: usize::MAX, ..of }), "episode.n_draws: expected 1 to 100000"),
            (set(Settings { n_suppositions: usize::MAX, ..of }), "episode.n_suppositions: expected 1 to 10000"),
            (set(Settings { n_finalists: Some(0), ..of }), "episode.n_finalists: expected at least 1"),
            (
                set(Settings { n_draws: 100_000, ..of }),
                "episode.n_draws, n_suppositions, n_finalists: expected at most 1e8 pairs",
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
        let of = Settings::default();
        assert!(n_pairs(of.effort()) < MAX_PAIRS / 400.0, "{}", n_pairs(of.effort()));
        // The richest settings that a trade-off measures.
        for (n_draws, n_suppositions, n_finalists) in [(320, 48, Some(48)), (160, 24, None)] {
            let settings = Settings { n_draws, n_suppositions, n_finalists, subdivisions: 3, ..of };
            assert!(n_pairs(settings.effort()) < MAX_PAIRS / 20.0);
            assert_eq!(refused(EpisodeConfig { settings, ..EpisodeConfig::default() }), "nothing");
        }
        let most = EpisodeConfig::paper().changed(|settings, _, _| settings.max_touches = 1_000);
        assert_eq!(refused(most), "nothing");
    }

    #[test]
    fn a_share_of_edge_outside_0_to_1_is_refused() {
        for contact_threshold in [-0.1, 1.5, f32::NAN, f32::INFINITY] {
            let config = EpisodeConfig::default().changed(|_, model, _| model.contact_threshold = contact_threshold);
            let refused = refused(config);
            assert!(refused.starts_with("touch_model.contact_threshold: expected 0..=1"), "{refused}");
        }
    }
}

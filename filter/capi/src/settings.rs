//! The settings of a program, read and checked.

use tactile_filter::EpisodeConfig;
use tactile_filter::belief::EngineConfig;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::choice::{ActionConfig, ActionRule};
use tactile_filter::likelihood::LikelihoodConfig;
use tactile_filter::likelihood::interpolation::Interpolation;
use tactile_infer::Views;

use crate::config::{check_size, tf_engine, tf_episode_config, tf_interpolation, tf_rule, tf_views};
use crate::pointer::get;
use crate::status::{Failure, tf_status};

/// The settings as the filter takes them, all checked.
fn checked(config: &tf_episode_config) -> Result<EpisodeConfig, Failure> {
    let config = EpisodeConfig {
        engine: engine(config)?,
        action: action(config)?,
        likelihood: likelihood(config)?,
        stop_probability: config.stop_probability,
        stop_place_mm: optional("has_stop_place", config.has_stop_place, config.stop_place_mm)?,
        max_touches: config.max_touches,
        between_poses: flag("between_poses", config.between_poses)?,
        subdivisions: config.subdivisions,
        none_fit: optional("has_none_fit", config.has_none_fit, config.none_fit)?,
        fit_margin: config.fit_margin,
        none_touches: config.none_touches,
        low_similarity: config.low_similarity,
        seed: config.seed,
    };
    config.validate()?;
    Ok(config)
}

fn engine(config: &tf_episode_config) -> Result<EngineConfig, Failure> {
    let particle = ParticleConfig {
        n_particles: config.n_particles,
        resample_share: config.resample_share,
        adaptive: flag("adaptive_particles", config.adaptive_particles)?,
        n_moves: config.n_moves,
    };
    match config.engine {
        value if value == tf_engine::Exact as u32 => Ok(EngineConfig::Exact),
        value if value == tf_engine::Particle as u32 => Ok(EngineConfig::Particle(particle)),
        other => Err(unknown("engine", "tf_engine", other)),
    }
}

fn action(config: &tf_episode_config) -> Result<ActionConfig, Failure> {
    let rule = match config.rule {
        value if value == tf_rule::Information as u32 => ActionRule::Information,
        value if value == tf_rule::Paper as u32 => ActionRule::Paper,
        value if value == tf_rule::Random as u32 => ActionRule::Random,
        value if value == tf_rule::RandomEdge as u32 => ActionRule::RandomEdge,
        other => return Err(unknown("rule", "tf_rule", other)),
    };
    let (has_deg, deg) = (config.has_min_separation_deg, config.min_separation_deg);
    Ok(ActionConfig {
        rule,
        n_draws: config.n_draws,
        n_suppositions: config.n_suppositions,
        n_finalists: optional("has_n_finalists", config.has_n_finalists, config.n_finalists)?,
        contact_threshold: config.contact_threshold,
        min_separation_mm: config.min_separation_mm,
        min_separation_deg: optional("has_min_separation_deg", has_deg, deg)?,
        travel_nats_per_mm: config.travel_nats_per_mm,
    })
}

fn likelihood(config: &tf_episode_config) -> Result<LikelihoodConfig, Failure> {
    let interpolation = match config.interpolation {
        value if value == tf_interpolation::Auto as u32 => Interpolation::Auto,
        value if value == tf_interpolation::Nearest as u32 => Interpolation::Nearest,
        value if value == tf_interpolation::Cubic as u32 => Interpolation::Cubic,
        other => return Err(unknown("interpolation", "tf_interpolation", other)),
    };
    let matched_views = match config.matched_views {
        value if value == tf_views::Pegs as u32 => Views::Pegs,
        value if value == tf_views::Both as u32 => Views::Both,
        other => return Err(unknown("matched_views", "tf_views", other)),
    };
    Ok(LikelihoodConfig {
        temperature: config.temperature,
        outlier_share: config.outlier_share,
        blank_share: config.blank_share,
        blank_agreement: config.blank_agreement,
        nearest_tolerance: config.nearest_tolerance,
        interpolation,
        unknown_similarity: optional(
            "has_unknown_similarity",
            config.has_unknown_similarity,
            config.unknown_similarity,
        )?,
        matched_mean: config.matched_mean,
        matched_sd: config.matched_sd,
        matched_shared: config.matched_shared,
        matched_views,
        shared_error: config.shared_error,
        overlap_mm: config.overlap_mm,
        overlap_deg: config.overlap_deg,
    })
}

fn setting(name: &str, expected: impl std::fmt::Display, got: impl std::fmt::Display) -> Failure {
    Failure::new(tf_status::Config, format!("{name}: expected {expected}, got {got}"))
}

fn unknown(name: &str, list: &str, got: u32) -> Failure {
    setting(name, format!("a value of {list}"), got)
}

fn flag(name: &str, value: u32) -> Result<bool, Failure> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(setting(name, "0 or 1", other)),
    }
}

fn optional<T>(name: &str, has: u32, value: T) -> Result<Option<T>, Failure> {
    Ok(flag(name, has)?.then_some(value))
}

/// Reads the settings of a program that may be older than this library.
///
/// # Safety
/// `config` is null or points to as many bytes as its `size` says.
pub(crate) unsafe fn read(config: *const tf_episode_config) -> Result<EpisodeConfig, Failure> {
    let size = *unsafe { get(config.cast::<usize>(), "config")? };
    check_size("config.size", size)?;
    // What the program does not know has its default.
    let mut whole = tf_episode_config::from(&EpisodeConfig::default());
    unsafe { std::ptr::copy_nonoverlapping(config.cast::<u8>(), (&raw mut whole).cast(), size) };
    checked(&whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{FIRST_SIZE, SECOND_SIZE, THIRD_SIZE};

    #[test]
    fn settings_come_back_as_they_went() {
        let place = EpisodeConfig { stop_place_mm: Some(0.5), seed: u64::MAX, ..EpisodeConfig::default() };
        let turned =
            ActionConfig { min_separation_deg: Some(20.0), rule: ActionRule::Random, ..ActionConfig::default() };
        let cubic = LikelihoodConfig { interpolation: Interpolation::Cubic, ..LikelihoodConfig::default() };
        let cubic = LikelihoodConfig { matched_views: Views::Both, ..cubic };
        let turned = EpisodeConfig { action: turned, likelihood: cubic, ..place };
        let edge = ActionConfig { rule: ActionRule::RandomEdge, ..ActionConfig::default() };
        let edge = EpisodeConfig { action: edge, ..place };
        for config in [EpisodeConfig::default(), EpisodeConfig::paper(), place, turned, edge] {
            let there = tf_episode_config::from(&config);
            let back = unsafe { read(&there) };
            assert_eq!(back.map_err(|failure| failure.message), Ok(config));
        }
    }

    #[test]
    fn a_program_of_an_earlier_version_has_the_later_settings_defaults() {
        // What lies behind its struct is not read.
        let default = tf_episode_config::from(&EpisodeConfig::default());
        let first = tf_episode_config { size: FIRST_SIZE, matched_sd: f64::NAN, matched_views: 9, ..default };
        let second = tf_episode_config { size: SECOND_SIZE, matched_views: 9, ..default };
        let third = tf_episode_config { size: THIRD_SIZE, matched_shared: f64::NAN, ..default };
        for there in [first, second, third] {
            assert_eq!(unsafe { read(&there) }.map_err(|failure| failure.message), Ok(EpisodeConfig::default()));
        }
        let sizes = [SECOND_SIZE, THIRD_SIZE, size_of::<tf_episode_config>()];
        assert_eq!([56, 64, 72].map(|bytes| FIRST_SIZE + bytes), sizes);
    }

    #[test]
    fn settings_that_make_no_sense_are_refused_by_name() {
        let good = tf_episode_config::from(&EpisodeConfig::paper());
        let refused = |config: tf_episode_config| {
            let Failure { status, message } = unsafe { read(&config) }.unwrap_err();
            (status, message.split(':').next().unwrap_or_default().to_owned())
        };
        let config = tf_status::Config;
        for (wrong, status, name) in [
            (tf_episode_config { size: 8, ..good }, tf_status::Argument, "config.size"),
            (tf_episode_config { engine: 2, ..good }, config, "engine"),
            (tf_episode_config { rule: 4, ..good }, config, "rule"),
            (tf_episode_config { interpolation: 9, ..good }, config, "interpolation"),
            (tf_episode_config { matched_views: 2, ..good }, config, "matched_views"),
            (tf_episode_config { between_poses: 7, ..good }, config, "between_poses"),
            (tf_episode_config { stop_probability: f64::NAN, ..good }, config, "episode.stop_probability"),
            (tf_episode_config { n_particles: usize::MAX, ..good }, config, "episode.engine.n_particles"),
            (tf_episode_config { n_draws: usize::MAX, ..good }, config, "episode.action.n_draws"),
            (tf_episode_config { contact_threshold: f32::NAN, ..good }, config, "episode.action.contact_threshold"),
            (tf_episode_config { contact_threshold: 1.5, ..good }, config, "episode.action.contact_threshold"),
            (tf_episode_config { max_touches: usize::MAX, ..good }, config, "episode.max_touches"),
            (tf_episode_config { subdivisions: 5, ..good }, config, "episode.subdivisions"),
        ] {
            assert_eq!(refused(wrong), (status, name.to_owned()));
        }
    }
}

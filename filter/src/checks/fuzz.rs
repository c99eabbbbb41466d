//! Random misuse of an episode: an error or finite numbers, never a panic.
//!
//! Some hundred cases by default; `PROPTEST_CASES` in the environment asks for more.

use std::sync::Arc;

use proptest::prelude::*;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::bank::rows::Rows;

use crate::belief::EngineConfig;
use crate::belief::particle::ParticleConfig;
use crate::choice::ActionRule;
use crate::config::EpisodeConfig;
use crate::decision::Estimate;
use crate::episode::{Decision, Episode};
use crate::error::Error;
use crate::likelihood::interpolation::Interpolation;
use crate::touch::Observation;
use crate::touch_model::TouchModel;

/// Any f64: half the time one near a robot's, else one at an end of the range or none at all.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -30.0..30.0_f64,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![
            0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 1e-320, 180.0,
            -180.0, 1e16,
        ]),
    ]
}

fn motion() -> impl Strategy<Value = Se2> {
    // The fields are public: an angle need not be wrapped.
    let raw = (number(), number(), number()).prop_map(|(x_mm, y_mm, theta_rad)| Se2 { x_mm, y_mm, theta_rad });
    prop_oneof![
        3 => (-12.0..12.0_f64, -12.0..12.0_f64, -180.0..180.0_f64).prop_map(|(x, y, t)| Se2::from_degrees(x, y, t)),
        1 => raw,
    ]
}

fn value() -> impl Strategy<Value = f32> {
    prop_oneof![
        12 => -1.0..1.0_f32,
        1 => prop::sample::select(vec![0.0, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1e-45, 1e30, -1e30]),
    ]
}

/// A value of a query, which nothing has checked.
fn unchecked() -> impl Strategy<Value = f32> {
    prop_oneof![40 => value(), 1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY])]
}

fn share() -> impl Strategy<Value = f32> {
    let odd = prop::sample::select(vec![0.0, 1.0, -0.1, 1.1, f32::NAN, f32::INFINITY, 1e-45]);
    prop_oneof![8 => 0.0..1.0_f32, 1 => odd]
}

/// Grids of one to some hundred poses, coarse and fine, with and without a whole turn.
fn grid() -> impl Strategy<Value = PoseGrid> {
    let step = prop::sample::select(vec![4.0, 2.0, 1e-6, 1e6]);
    let theta_step = prop::sample::select(vec![30.0, 10.0, 60.0, 90.0]);
    (0..=2_u8, step, 0..=6_u8, theta_step).prop_map(|(n_xy, xy_step_mm, n_theta, theta_step_deg)| PoseGrid {
        xy_half_mm: f64::from(n_xy) * xy_step_mm,
        xy_step_mm,
        theta_half_deg: f64::from(n_theta).min(f64::floor(180.0 / theta_step_deg)) * theta_step_deg,
        theta_step_deg,
    })
}

/// Banks of one to four parts; rows of zeros, rows all alike, and values at the ends of f32 among them.
fn bank() -> impl Strategy<Value = Arc<Bank>> {
    (grid(), 1..=4_usize, 1..=20_usize, any::<bool>()).prop_flat_map(|(grid, n_parts, dim, alike)| {
        let n_rows = n_parts * grid.len();
        let n_drawn = if alike { 1 } else { n_rows.min(16) };
        let rows = prop::collection::vec(prop::collection::vec(value(), dim), n_drawn);
        // A bank takes no other shares.
        let shares = prop::collection::vec(prop_oneof![Just(0.0), Just(1.0), 0.0..=1.0_f32], 1..=8);
        (rows, shares).prop_map(move |(rows, shares)| {
            let rows: Vec<f32> = (0..n_rows).flat_map(|row| rows[row * 7 % rows.len()].clone()).collect();
            let shares = (0..n_rows).map(|row| shares[row * 5 % shares.len()]).collect();
            let names = (0..n_parts).map(|part| part.to_string()).collect();
            Arc::new(Bank::from_rows(names, grid, Rows::new(dim, rows).unwrap(), shares, "").unwrap())
        })
    })
}

fn config() -> impl Strategy<Value = EpisodeConfig> {
    let particle = (1..=300_usize, 0.0..=1.0_f64)
        .prop_map(|(n_particles, resample_share)| ParticleConfig { n_particles, resample_share });
    let engine = prop_oneof![Just(EngineConfig::Exact), particle.prop_map(EngineConfig::Particle)];
    let rules = vec![ActionRule::Paper, ActionRule::Information, ActionRule::Random, ActionRule::RandomEdge];
    let rule = prop::sample::select(rules);
    let action = (rule, 1..=20_usize, 1..=6_usize, 1..=8_usize, 0.0..20.0_f64).prop_map(
        |(rule, n_draws, n_suppositions, n_finalists, min_separation_mm)| {
            EpisodeConfig::default().changed(|settings, model, method| {
                settings.n_finalists = Some(n_finalists);
                (settings.n_draws, settings.n_suppositions) = (n_draws, n_suppositions);
                model.min_separation_mm = min_separation_mm;
                method.rule = rule;
            })
        },
    );
    let stop_place_mm = prop::sample::select(vec![None, Some(1e-3), Some(2.0)]);
    (engine, action, touch_model(), any::<bool>(), (0.0..=1.0_f64, stop_place_mm, 0.0..=1.0_f64), any::<u64>())
        .prop_map(|(engine, config, numbers, between_poses, (stop_probability, stop_place_mm, false_refuse), seed)| {
            let min_separation_mm = config.model.min_separation_mm;
            config.changed(|settings, model, method| {
                *model = TouchModel { min_separation_mm, ..numbers };
                (method.engine, method.between_poses) = (engine, between_poses);
                (settings.stop_probability, settings.stop_place_mm) = (stop_probability, stop_place_mm);
                (settings.false_refuse, settings.seed) = (false_refuse, seed);
            })
        })
}

fn touch_model() -> impl Strategy<Value = TouchModel> {
    let any_positive = || prop_oneof![prop::sample::select(vec![1e-300, 1e-4, 1e4, 1e300]), number()];
    let temperature = prop_oneof![
        4 => Just(None), 1 => (0.01..1.0_f64).prop_map(Some), 1 => any_positive().prop_map(Some)
    ];
    let anything = || prop_oneof![prop::sample::select(vec![-1e300, -1e4, 0.0, 1e4, 1e300]), number()];
    let offset = prop_oneof![4 => -5.0..10.0_f64, 1 => anything()];
    let steepness = prop_oneof![4 => 1.0..100.0_f64, 1 => any_positive()];
    let by_edge = prop_oneof![4 => -1.0..1.0_f64, 1 => anything()];
    let own_distance = prop_oneof![4 => 0.05..1.0_f64, 1 => any_positive()];
    let floor = prop::sample::select(vec![0.0, 3e-4, 1e-300, 1.0]);
    let interpolation = prop::sample::select(vec![Interpolation::Auto, Interpolation::Nearest, Interpolation::Cubic]);
    let shared = prop::sample::select(vec![0.0, 3.0, 1e-9, 1e9]);
    let tolerance = prop::sample::select(vec![0.25, 1.0, 1e-9, 1e9]);
    let odds = (offset, steepness, by_edge, own_distance, temperature);
    (odds, floor, interpolation, shared, tolerance, 0.0..0.5_f32).prop_map(
        |(odds, outlier_share, interpolation, shared_mm, nearest_tolerance, blank_share)| TouchModel {
            match_offset: odds.0,
            steepness: odds.1,
            steepness_by_edge: odds.2,
            own_distance: odds.3,
            temperature: odds.4,
            outlier_share,
            interpolation,
            shared_mm,
            nearest_tolerance,
            blank_share,
            ..TouchModel::default()
        },
    )
}

/// Some touches of a bank, a few with a query of another length.
fn touches(dim: usize) -> impl Strategy<Value = Vec<(Se2, Observation)>> {
    let length = prop_oneof![30 => Just(dim), 1 => 0..40_usize];
    let query = prop_oneof![
        8 => length.prop_flat_map(|n| prop::collection::vec(value(), n)),
        2 => prop::collection::vec(unchecked(), dim),
    ];
    let rarity = prop_oneof![8 => -3.0..3.0_f32, 1 => value(), 1 => unchecked()];
    let observation = (query, share(), rarity)
        .prop_map(|(query, edge_share, rarity)| Observation { rarity, ..Observation::new(query, edge_share) });
    prop::collection::vec((motion(), observation), 1..6)
}

/// Finite numbers, a distribution, a pose, and one verdict whoever asks.
fn check(episode: &Episode, config: &EpisodeConfig) -> std::result::Result<(), TestCaseError> {
    let estimate = episode.estimate();
    prop_assert_eq!([estimate.stop, config.stop(&estimate.standing())], [episode.stop_reason(); 2]);
    prop_assert_eq!(&estimate.runner_up, &episode.runner_up());
    check_numbers(&estimate)
}

fn check_numbers(estimate: &Estimate) -> std::result::Result<(), TestCaseError> {
    let sum: f64 = estimate.class_posterior.iter().sum();
    prop_assert!((sum - 1.0).abs() < 1e-6, "{:?}", estimate.class_posterior);
    prop_assert!((0.0..=1.0).contains(&estimate.probability), "{}", estimate.probability);
    prop_assert!(estimate.entropy_nats >= -1e-9 && estimate.entropy_nats.is_finite());
    prop_assert!(estimate.part_from_first.is_finite(), "{:?}", estimate.part_from_first);
    prop_assert!(estimate.part_from_sensor.is_finite(), "{:?}", estimate.part_from_sensor);
    prop_assert!(estimate.covariance.iter().flatten().all(|value| value.is_finite()), "{:?}", estimate.covariance);
    prop_assert!(estimate.fit.is_none_or(|fit| fit.is_finite()), "{:?}", estimate.fit);
    for mode in &estimate.modes {
        prop_assert!(mode.mass > 0.0 && mode.mass <= 1.0 + 1e-9, "{mode:?}");
        let covariance = mode.covariance.iter().flatten();
        prop_assert!(mode.part_from_sensor.is_finite() && covariance.copied().all(f64::is_finite), "{mode:?}");
    }
    Ok(())
}

proptest! {
    #[test]
    fn fuzz_an_episode_errs_or_stays_finite(
        (bank, touches) in bank().prop_flat_map(|bank| {
            let dim = bank.dim();
            (Just(bank), touches(dim))
        }),
        config in config(),
        candidates in prop::collection::vec(motion(), 0..12),
    ) {
        let Ok(mut episode) = Episode::begin(config, bank.clone(), &touches[0].1) else { return Ok(()) };
        check(&episode, &config)?;
        for (moved, touch) in &touches[1..] {
            let before = episode.estimate();
            match episode.decide(&candidates) {
                Ok(Decision::Touch(action)) => prop_assert!(action.sensor_from_next.is_finite()),
                Ok(Decision::Done(estimate, _)) => check_numbers(&estimate)?,
                Err(error) => {
                    prop_assert!(matches!(error, Error::EmptyReach { .. }), "{error}");
                    prop_assert!(!candidates.iter().any(Se2::is_finite));
                }
            }
            match episode.observe(*moved, touch) {
                Ok(_) => check(&episode, &config)?,
                Err(error) => {
                    prop_assert!(!error.to_string().contains('\n'));
                    prop_assert!(episode.estimate() == before, "an error changed the belief");
                }
            }
        }
    }
}

use super::*;
use crate::belief::EngineConfig;
use crate::belief::particle::ParticleConfig;
use crate::checks::synthetic::World;
use crate::config::Method;
use crate::decision::Warning;
use crate::insertion::HeldPeg;
use crate::likelihood::interpolation::Interpolation;
use crate::record::EpisodeRecord;
use crate::settings::Settings;
use crate::touch_model::TouchModel;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::FrameFault;
use tactile_data::frame::{Frame, Preprocessing};
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::bank::learn_from::{LearnFrom, Learning};
use tactile_infer::bank::metric::{Measured, Metric};
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::normalize_rows;
use tactile_infer::bank::views::Views;
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::embedding::checkpoint::{Checkpoint, Provenance};
use tactile_infer::{DeviceKind, Model};

use crate::touch::Sensor;

/// 7 x 7 x 3 = 147 poses on 24 x 24 mm.
const GRID: PoseGrid = PoseGrid { xy_half_mm: 12.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

/// Runs an episode with no stop but the touch limit; whether each touch's estimate named the part, and the last.
fn play(world: &World, config: &EpisodeConfig, part: usize, seed: u64) -> (Vec<bool>, Estimate, Se2) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let start = GRID.pose(rng.random_range(0..GRID.len()));
    let mut pose = start;
    let mut episode = Episode::begin(*config, world.bank.clone(), &world.touch(part, &pose, &mut rng)).unwrap();
    let mut hits = Vec::new();
    loop {
        let estimate = episode.estimate();
        assert_eq!([estimate.stop, config.stop(&estimate.standing())], [episode.stop_reason(); 2]);
        hits.push(estimate.part == world.bank.parts()[part]);
        match episode.decide(&world.reach(&pose)).unwrap() {
            Decision::Touch(action) => {
                pose = pose * action.sensor_from_next;
                episode.observe(action.sensor_from_next, &world.touch(part, &pose, &mut rng)).unwrap();
            }
            Decision::Done(estimate, _) => return (hits, *estimate, start),
        }
    }
}

/// Share of episodes that name the part after each touch.
fn accuracy(world: &World, config: &EpisodeConfig, n_episodes: u64) -> Vec<f64> {
    let mut shares = vec![0.0; config.settings.max_touches];
    for seed in 0..n_episodes {
        let config = EpisodeConfig { settings: Settings { seed, ..config.settings }, ..*config };
        let part = seed as usize % world.bank.parts().len();
        for (share, hit) in shares.iter_mut().zip(play(world, &config, part, seed).0) {
            *share += f64::from(u8::from(hit)) / n_episodes as f64;
        }
    }
    shares
}

fn never_confident(max_touches: usize) -> EpisodeConfig {
    EpisodeConfig {
        settings: Settings { stop_probability: 1.0, false_accept: None, max_touches, ..Settings::default() },
        ..EpisodeConfig::default()
    }
}

#[test]
fn more_touches_find_the_part_and_the_pose() {
    let world = World::new(8, GRID, 0.3, 0.05, 5);
    let config = EpisodeConfig { model: world.model(), ..never_confident(5) };
    let shares = accuracy(&world, &config, 40);
    assert!(shares[4] >= 0.9 && shares[4] > shares[0], "{shares:?}");
    let (_, estimate, start) = play(&world, &config, 2, 2);
    // Between recorded poses: the mean is within half a step of the truth, which is recorded.
    assert!(estimate.part_from_first.distance_mm(&start) < 2.0);
    let recorded = EpisodeConfig { method: Method { between_poses: false, ..config.method }, ..config };
    assert_eq!(play(&world, &recorded, 2, 2).1.part_from_first, start);
    assert!((estimate.class_posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(estimate.modes[0].mass > 0.5 && estimate.warnings.is_empty());
}

#[test]
fn the_paper_as_printed_runs_and_beats_one_touch() {
    let world = World::new(8, GRID, 0.2, 0.03, 5);
    let config = EpisodeConfig {
        settings: Settings { stop_probability: 1.0, max_touches: 5, ..EpisodeConfig::paper().settings },
        ..EpisodeConfig::paper()
    };
    let shares = accuracy(&world, &config, 40);
    assert!(shares[4] > shares[0], "{shares:?}");
}

#[test]
fn the_same_seed_gives_the_same_episode_and_deciding_changes_nothing() {
    let world = World::new(4, GRID, 0.5, 0.1, 2);
    for engine in [EngineConfig::Exact, EngineConfig::Particle(ParticleConfig::default())] {
        let config = EpisodeConfig { method: Method { engine, ..never_confident(4).method }, ..never_confident(4) };
        assert_eq!(play(&world, &config, 1, 9), play(&world, &config, 1, 9));
    }
    let touch = world.touch(0, &Se2::IDENTITY, &mut ChaCha8Rng::seed_from_u64(1));
    let episode = Episode::begin(never_confident(4), world.bank.clone(), &touch).unwrap();
    let reach = world.reach(&Se2::IDENTITY);
    assert_eq!(episode.decide(&reach).unwrap(), episode.decide(&reach).unwrap());
}

#[test]
fn a_saved_episode_goes_on_as_if_it_had_not_stopped() {
    let world = World::new(4, GRID, 0.5, 0.1, 2);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for engine in [EngineConfig::Exact, EngineConfig::Particle(ParticleConfig::default())] {
        let config = EpisodeConfig { method: Method { engine, ..never_confident(6).method }, ..never_confident(6) };
        let reach = world.reach(&Se2::IDENTITY);
        let touch = |rng: &mut ChaCha8Rng| world.touch(1, &Se2::from_degrees(4.0, 0.0, 30.0), rng);
        let mut episode = Episode::begin(config, world.bank.clone(), &touch(&mut rng)).unwrap();
        episode.observe(reach[5], &touch(&mut rng)).unwrap();
        let text = serde_json::to_string(&episode.record().unwrap()).unwrap();
        let record: EpisodeRecord = serde_json::from_str(&text).unwrap();
        let mut restored = Episode::restore(&record, world.bank.clone()).unwrap();
        let last = touch(&mut rng);
        for one in [&mut episode, &mut restored] {
            one.observe(reach[9], &last).unwrap();
        }
        assert_eq!(restored.estimate(), episode.estimate());
        assert_eq!(restored.decide(&reach).unwrap(), episode.decide(&reach).unwrap());
        let other = World::new(3, GRID, 0.5, 0.1, 2);
        assert!(Episode::restore(&record, other.bank.clone()).unwrap_err().to_string().contains("one of bank"));
    }
}

#[test]
fn a_peg_that_did_not_go_in_is_doubted_and_the_doubt_is_saved() {
    let world = World::new(4, GRID, 0.3, 0.05, 2);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let config = never_confident(6);
    let mut episode = Episode::begin(config, world.bank.clone(), &world.touch(1, &Se2::IDENTITY, &mut rng)).unwrap();
    let named = episode.estimate();
    let covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 1e-4]];
    let tried = named.search(&HeldPeg { play_mm: 2.0, radius_mm: 10.0, covariance }, 1000).unwrap().in_vain;
    assert_eq!((&tried.part, tried.part_from_first), (&named.part, named.part_from_first));
    episode.did_not_fit(&tried).unwrap();
    let doubted = episode.estimate();
    let part = world.bank.parts().iter().position(|part| *part == named.part).unwrap();
    assert!(doubted.class_posterior[part] < named.class_posterior[part] && doubted.n_touches == 1);
    episode.observe(Se2::from_degrees(4.0, 0.0, 0.0), &world.touch(1, &Se2::new(4.0, 0.0, 0.0), &mut rng)).unwrap();
    let text = serde_json::to_string(&episode.record().unwrap()).unwrap();
    let record: EpisodeRecord = serde_json::from_str(&text).unwrap();
    assert_eq!(Episode::restore(&record, world.bank.clone()).unwrap().estimate(), episode.estimate());
    let late = EpisodeRecord { tried: vec![(3, tried)], ..record };
    let refused = Episode::restore(&late, world.bank.clone()).unwrap_err().to_string();
    assert!(refused.contains("tries in order"), "{refused}");
}

#[test]
fn what_was_judged_is_what_is_decided() {
    let world = World::new(5, GRID, 0.3, 0.05, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for (rule, n_finalists) in [
        (ActionRule::Information, Some(8)),
        (ActionRule::Information, None),
        (ActionRule::Paper, Some(8)),
        (ActionRule::Random, Some(8)),
    ] {
        let config = never_confident(4).changed(|settings, _, method| {
            (settings.n_finalists, method.rule) = (n_finalists, rule);
        });
        let mut episode =
            Episode::begin(config, world.bank.clone(), &world.touch(1, &Se2::IDENTITY, &mut rng)).unwrap();
        let mut pose = Se2::IDENTITY;
        while let Decision::Touch(action) = episode.decide(&world.reach(&pose)).unwrap() {
            let choice = episode.explain(&world.reach(&pose)).unwrap();
            assert_eq!(choice.action, action, "{rule:?}");
            assert_eq!(choice.scored.is_empty(), rule == ActionRule::Random);
            // Of those that all draws judged none is better; every other one was judged in the first pass.
            let closely: Vec<_> = choice.scored.iter().filter(|judged| judged.by_all_draws).collect();
            assert!(closely.len() <= n_finalists.unwrap_or(GRID.len()) && choice.scored.len() <= GRID.len());
            let best = closely.iter().find(|judged| judged.sensor_from_next == action.sensor_from_next);
            assert!(closely.iter().all(|judged| judged.score <= best.unwrap().score));
            let nats = choice.expected.map(|expected| expected.nats);
            let score = best.filter(|_| rule == ActionRule::Information).and_then(|best| best.score);
            assert!(nats.zip(score).is_none_or(|(nats, score)| (nats - score).abs() < 1e-12));
            assert_eq!(nats.is_some(), score.is_some());
            pose = pose * action.sensor_from_next;
            episode.observe(action.sensor_from_next, &world.touch(1, &pose, &mut rng)).unwrap();
        }
    }
}

#[test]
fn each_reason_to_stop_is_given() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let touch = world.touch(0, &Se2::IDENTITY, &mut ChaCha8Rng::seed_from_u64(1));
    let reason = |config: EpisodeConfig, candidates: &[Se2]| match Episode::begin(config, world.bank.clone(), &touch)
        .unwrap()
        .decide(candidates)
        .unwrap()
    {
        Decision::Touch(_) => None,
        Decision::Done(_, reason) => Some(reason),
    };
    let reach = world.reach(&Se2::IDENTITY);
    let eager = EpisodeConfig {
        settings: Settings { stop_probability: 0.0, ..never_confident(2).settings },
        ..never_confident(2)
    };
    assert_eq!(reason(eager, &reach), Some(StopReason::Confident));
    // Sure of the part, but not of the place to a micrometre; to a metre it is.
    let likelihood = TouchModel { interpolation: Interpolation::Cubic, ..eager.model };
    let placed = |mm, max_touches| EpisodeConfig {
        settings: Settings { stop_place_mm: Some(mm), max_touches, ..eager.settings },
        model: likelihood,
        ..eager
    };
    assert_eq!(reason(placed(1e-3, 2), &reach), None);
    assert_eq!(reason(placed(1e-3, 1), &reach), Some(StopReason::TouchLimit));
    assert_eq!(reason(placed(1e3, 2), &reach), Some(StopReason::Confident));
    assert_eq!(reason(never_confident(1), &reach), Some(StopReason::TouchLimit));
    assert_eq!(reason(never_confident(2), &[Se2::IDENTITY]), Some(StopReason::NothingToLearn));
    assert_eq!(reason(never_confident(2), &reach), None);
    // The best recorded view fits with 0 at most.
    let doubtful = EpisodeConfig {
        settings: Settings { false_accept: Some(0.0), ..never_confident(2).settings },
        ..never_confident(2)
    };
    let strange = EpisodeConfig { method: Method { between_poses: false, ..doubtful.method }, ..doubtful };
    assert_ne!(reason(strange, &reach), Some(StopReason::Confident));
}

#[test]
fn no_place_is_promised_that_the_bank_cannot_tell() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let touch = world.touch(0, &Se2::IDENTITY, &mut ChaCha8Rng::seed_from_u64(1));
    let config = EpisodeConfig {
        settings: Settings { stop_place_mm: Some(0.5), ..Settings::default() },
        ..EpisodeConfig::default()
    };
    let coarse = Episode::begin(config, world.bank.clone(), &touch).unwrap_err().to_string();
    assert!(coarse.contains("stop_place_mm") && coarse.contains("fine enough"), "{coarse}");
    let likelihood = TouchModel { interpolation: Interpolation::Cubic, ..config.model };
    let fine = EpisodeConfig { model: likelihood, ..config };
    assert!(Episode::begin(fine, world.bank.clone(), &touch).is_ok());
    let recorded = EpisodeConfig { method: Method { between_poses: false, ..fine.method }, ..fine };
    assert!(Episode::begin(recorded, world.bank.clone(), &touch).is_err());
}

#[test]
fn a_fit_is_of_the_touches_with_an_edge_in_the_recorded_area() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let touch = world.touch(0, &Se2::IDENTITY, &mut rng);
    let config =
        EpisodeConfig { method: Method { between_poses: false, ..never_confident(9).method }, ..never_confident(9) };
    let mut episode = Episode::begin(config, world.bank.clone(), &touch).unwrap();
    let n_fitted = |episode: &Episode| {
        let estimate = episode.estimate();
        assert_eq!((estimate.part.as_str(), estimate.part_from_first), (world.bank.parts()[0].as_str(), Se2::IDENTITY));
        let touches = episode.belief().touches().iter();
        let scores = touches.filter_map(|touch| touch.standard_score(world.bank.grid(), 0, &Se2::IDENTITY));
        assert_eq!(scores.count(), estimate.n_fitted);
        estimate.n_fitted
    };
    assert_eq!(n_fitted(&episode), 1);
    // Nothing is seen, then something where nothing was recorded.
    let aside = Se2::from_degrees(4.0, 0.0, 0.0);
    episode.observe(aside, &Observation { edge_share: 0.0, ..touch.clone() }).unwrap();
    assert_eq!(n_fitted(&episode), 1);
    episode.observe(Se2::from_degrees(2.0 * GRID.xy_half_mm, 0.0, 0.0), &touch).unwrap();
    assert_eq!(n_fitted(&episode), 1);
    let back = Se2::from_degrees(-2.0 * GRID.xy_half_mm, 4.0, 0.0);
    let again = world.touch(0, &(aside * Se2::from_degrees(0.0, 4.0, 0.0)), &mut rng);
    episode.observe(back, &again).unwrap();
    assert_eq!(n_fitted(&episode), 2);
}

#[test]
fn a_part_that_is_not_in_the_bank_is_none_of_these() {
    let world = World::new(6, GRID, 0.2, 0.02, 3);
    let model = world.model();
    let reason = |bank: &Arc<Bank>, part: usize, seed: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut pose = GRID.pose(rng.random_range(0..GRID.len()));
        // As 200 touches of this world match their own views; they share no error.
        let likelihood = TouchModel { matched_mean: 0.914, matched_sd: 0.035, shared_mm: 0.0, ..model };
        let config = EpisodeConfig {
            model: likelihood,
            method: Method { between_poses: false, ..Method::default() },
            ..EpisodeConfig::default()
        };
        let mut episode = Episode::begin(config, bank.clone(), &world.touch(part, &pose, &mut rng)).unwrap();
        loop {
            let moved = match episode.decide(&world.reach(&pose)).unwrap() {
                Decision::Touch(action) => action.sensor_from_next,
                Decision::Done(_, reason) => return reason,
            };
            pose = pose * moved;
            episode.observe(moved, &world.touch(part, &pose, &mut rng)).unwrap();
        }
    };
    let n_strange = |absent: bool| {
        let is_strange = |seed: &u64| {
            let part = *seed as usize % 6;
            let bank = if absent { Arc::new(world.bank.without(part).unwrap()) } else { world.bank.clone() };
            reason(&bank, part, *seed) == StopReason::NoneOfThese
        };
        (0..24).filter(is_strange).count()
    };
    let (present, absent) = (n_strange(false), n_strange(true));
    assert!(present <= 2 && absent >= 20, "{present} of 24 in the bank, {absent} of 24 not in it");
}

#[test]
fn a_confident_hole_tells_of_the_sensor_and_the_next_is_judged_by_it() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let touches = |n: usize| {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        (0..n).map(|_| world.touch(0, &Se2::IDENTITY, &mut rng)).collect::<Vec<_>>()
    };
    let play = |config: EpisodeConfig, n: usize| {
        let touches = touches(n);
        let mut episode = Episode::begin(config, world.bank.clone(), &touches[0]).unwrap();
        touches[1..].iter().for_each(|touch| episode.observe(Se2::IDENTITY, touch).unwrap());
        episode
    };
    let config = EpisodeConfig {
        model: TouchModel { matched_mean: 0.914, matched_sd: 0.035, ..world.model() },
        method: Method { between_poses: false, ..Method::default() },
        ..EpisodeConfig::default()
    };
    let unsure = config.changed(|settings, _, _| settings.stop_probability = 1.0);
    assert_eq!(play(unsure, 4).learn(), SensorMatch::default());
    let first = play(config, 4);
    assert_eq!(first.stop_reason(), Some(StopReason::Confident));
    let known = first.learn();
    let (fit, n_fitted) = (first.estimate().fit.unwrap(), first.estimate().n_fitted as f64);
    // The mean score lies on the side that the offset moved to.
    assert!(known.n_holes == 1 && known.offset * fit > 0.0 && n_fitted == 4.0, "{known:?} {fit}");
    let next = play(config.with_sensor(known), 4);
    assert!(next.estimate().fit.unwrap().abs() < fit.abs());
    assert_eq!(next.belief().posterior().by_part(), first.belief().posterior().by_part());
    let text = serde_json::to_string(&next.record().unwrap()).unwrap();
    let restored = Episode::restore(&serde_json::from_str(&text).unwrap(), world.bank.clone()).unwrap();
    assert_eq!((restored.estimate(), restored.learn()), (next.estimate(), next.learn()));
    assert_eq!(next.learn().n_holes, 2);
    let wrong = config.with_sensor(SensorMatch { n_holes: 1, offset: f64::NAN, ..known });
    assert!(wrong.validate().unwrap_err().to_string().starts_with("episode.sensor"));
}

#[test]
fn the_next_touch_tells_two_parts_apart_that_look_alike_so_far() {
    // Two parts alike but for the views of one corner; the touch is at the other.
    const DIM: usize = 32;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut unit_row = || {
        let mut row: Vec<f32> = (0..DIM).map(|_| rng.random::<f32>() - 0.5).collect();
        normalize_rows(&mut row, DIM);
        row
    };
    let mut rows: Vec<Vec<f32>> = (0..GRID.len()).map(|_| unit_row()).collect();
    let in_corner = |cell: usize| GRID.pose(cell).x_mm > 6.0 && GRID.pose(cell).y_mm > 6.0;
    rows.extend_from_within(..);
    (0..GRID.len()).filter(|cell| in_corner(*cell)).for_each(|cell| rows[GRID.len() + cell] = unit_row());
    let (names, shares) = (vec!["O".to_string(), "Q".to_string()], vec![0.2; rows.len()]);
    let bank = Bank::from_rows(names, GRID, Rows::new(DIM, rows.concat()).unwrap(), shares, "").unwrap();
    let bank = Arc::new(bank);
    let eager = EpisodeConfig {
        settings: Settings { stop_probability: 0.6, false_accept: None, ..Settings::default() },
        ..EpisodeConfig::default()
    };
    let eager = eager.changed(|settings, model, method| {
        model.interpolation = Interpolation::Nearest;
        // A first pass by few draws may miss it.
        settings.n_finalists = None;
        method.between_poses = false;
    });
    let start = GRID.pose(0);
    let touch = |pose: Se2| Observation::new(bank.row(GRID.len() + GRID.nearest(&pose).unwrap()).into_owned(), 0.2);
    let mut episode = Episode::begin(eager, bank.clone(), &touch(start)).unwrap();
    let estimate = episode.estimate();
    let other = estimate.runner_up.clone().unwrap();
    assert_eq!((estimate.part.as_str(), other.part.as_str()), ("O", "Q"));
    assert!((estimate.probability - 0.5).abs() + (other.probability - 0.5).abs() < 1e-6, "{estimate:?}");
    assert_eq!(episode.stop_reason(), None);
    // It goes where they differ.
    let reach: Vec<Se2> = (0..GRID.len()).map(|cell| start.inverse() * GRID.pose(cell)).collect();
    let Decision::Touch(action) = episode.decide(&reach).unwrap() else { panic!("stopped") };
    let next = start * action.sensor_from_next;
    assert!(in_corner(GRID.nearest(&next).unwrap()), "{next:?}");
    episode.observe(action.sensor_from_next, &touch(next)).unwrap();
    let estimate = episode.estimate();
    assert_eq!((estimate.part.as_str(), episode.stop_reason()), ("Q", Some(StopReason::Confident)));
    assert_eq!(episode.runner_up(), estimate.runner_up);
    // A part that is alone has no rival.
    let alone = Episode::begin(eager, Arc::new(bank.without(0).unwrap()), &touch(start)).unwrap();
    assert_eq!((alone.estimate().runner_up, alone.runner_up()), (None, None));
    assert_eq!(alone.stop_reason(), Some(StopReason::Confident));
}

#[test]
fn what_resembles_no_part_is_named_with_a_warning() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let estimate =
        |touch: &Observation| Episode::begin(EpisodeConfig::default(), world.bank.clone(), touch).unwrap().estimate();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let noise = (0..world.bank.dim()).map(|_| rng.random::<f32>() - 0.5).collect();
    let strange = Observation::new(noise, 0.3);
    assert!(matches!(estimate(&strange).warnings[..], [Warning::LowSimilarity { .. }]));
    let blank = Observation { edge_share: 0.0, ..strange };
    assert_eq!(estimate(&blank).warnings, [Warning::NothingSeen]);
    assert!(estimate(&world.touch(0, &Se2::IDENTITY, &mut rng)).warnings.is_empty());
}

#[test]
fn a_bank_for_the_other_side_is_warned_of() {
    let world = World::new(4, GRID, 0.2, 0.02, 2);
    let touch = world.touch(0, &Se2::IDENTITY, &mut ChaCha8Rng::seed_from_u64(1));
    let warned = |bank: &Bank, side| {
        let touch = Observation { side, ..touch.clone() };
        let episode = Episode::begin(EpisodeConfig::default(), Arc::new(bank.clone()), &touch).unwrap();
        let warnings = episode.estimate().warnings;
        assert!(warnings.iter().all(|warning| !warning.is_of_touches()), "{warnings:?}");
        warnings.first().map(ToString::to_string)
    };
    let bank = &*world.bank;
    let both = bank.clone().with_views(Views::Both);
    let [holes, pegs] = [LearnFrom::Hole, LearnFrom::Peg].map(|from| {
        let dim = bank.dim();
        let unit = (0..dim * dim).map(|at| f32::from(u8::from(at % (dim + 1) == 0))).collect();
        let measured = Measured { error_scale: 1.0 };
        let metric = Metric::new(dim, unit, measured).unwrap().with_learning(Learning { from, seed: 1 });
        bank.clone().with_metric(metric).unwrap()
    });
    // What is not known is not warned of; views of pegs suit holes, as in the paper.
    for (bank, side) in
        [(bank, Side::Hole), (bank, Side::Peg), (&both, Side::Hole), (&holes, Side::Hole), (&pegs, Side::Peg)]
    {
        assert_eq!(warned(bank, side), None);
    }
    for (bank, side, how) in [
        (&both, Side::Peg, "--views pegs --learn-from peg"),
        (&holes, Side::Peg, "--views pegs --learn-from peg"),
        (&pegs, Side::Hole, "--learn-from hole"),
        (&pegs.with_parts(&[0, 1]).unwrap(), Side::Hole, "--learn-from hole"),
    ] {
        let said = warned(bank, side).unwrap();
        assert!(said.starts_with(&format!("{side}s are touched")) && said.contains(how), "{said}");
    }
}

#[test]
fn bad_input_is_refused_and_leaves_the_belief() {
    let world = World::new(2, GRID, 0.2, 0.02, 2);
    let touch = world.touch(0, &Se2::IDENTITY, &mut ChaCha8Rng::seed_from_u64(1));
    let mut episode = Episode::begin(EpisodeConfig::default(), world.bank.clone(), &touch).unwrap();
    let before = episode.estimate();
    let nowhere = episode.observe(Se2 { x_mm: f64::NAN, ..Se2::IDENTITY }, &touch).unwrap_err();
    assert!(matches!(nowhere, Error::Motion { .. }));
    let nothing = Observation::new(vec![f32::NAN; world.bank.dim()], 0.2);
    assert!(matches!(episode.observe(Se2::IDENTITY, &nothing), Err(Error::Observation { .. })));
    for reach in [vec![], vec![Se2 { x_mm: f64::INFINITY, ..Se2::IDENTITY }]] {
        assert!(matches!(episode.decide(&reach), Err(Error::EmptyReach { n_motions }) if n_motions == reach.len()));
    }
    assert_eq!(episode.estimate(), before);
    let never =
        EpisodeConfig { settings: Settings { max_touches: 0, ..Settings::default() }, ..EpisodeConfig::default() };
    let error = Episode::begin(never, world.bank.clone(), &touch).unwrap_err();
    assert_eq!(error.to_string(), "episode.max_touches: expected 1 to 1000, got 0");
}

/// A sensor with a network that has learnt nothing, and a lit frame of it.
fn sensor() -> (Sensor, Frame) {
    let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 64 };
    let network = config.init(3, &DeviceKind::Flex.tensor_device());
    let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
    let model = Model::new(checkpoint, "synthetic".into(), DeviceKind::Flex).unwrap();
    let frame = Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (i % 90) as u8).collect()).unwrap();
    (Sensor::new(Arc::new(model), &frame).unwrap(), frame)
}

#[test]
fn an_observation_of_another_model_is_refused() {
    let (sensor, frame) = sensor();
    let world = World::new(2, GRID, 0.2, 0.02, 2);
    let mine = sensor.observe(&frame).unwrap();
    let foreign = Observation { model_sha256: Some("another".into()), ..mine.clone() };
    let mut episode = Episode::begin(EpisodeConfig::default(), world.bank.clone(), &mine).unwrap();
    let begun = Episode::begin(EpisodeConfig::default(), world.bank.clone(), &foreign);
    for error in [begun.unwrap_err(), episode.observe(Se2::IDENTITY, &foreign).unwrap_err()] {
        assert_eq!(error.to_string(), "observation: expected one of model synthetic, got one of model another");
        assert!(matches!(error, Error::WrongModel { .. }));
    }
}

#[test]
fn an_episode_is_of_one_side_and_is_saved_with_it() {
    let (sensor, frame) = sensor();
    let world = World::new(2, GRID, 0.2, 0.02, 2);
    let touched = Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (7 * i % 90) as u8).collect()).unwrap();
    let image = sensor.model().background(&frame).unwrap().tactile_image(&touched).unwrap();
    let [hole, peg] = [Side::Hole, Side::Peg].map(|side| sensor.clone().of_side(side).observe(&touched).unwrap());
    assert_eq!(hole.query, sensor.model().embed_holes(std::slice::from_ref(&image)).unwrap());
    assert_eq!(peg.query, sensor.model().embed_pegs(&[image]).unwrap());
    assert_ne!(hole.query, peg.query);
    for (first, other) in [(&hole, &peg), (&peg, &hole)] {
        let mut episode = Episode::begin(EpisodeConfig::default(), world.bank.clone(), first).unwrap();
        let before = episode.estimate();
        let error = episode.observe(Se2::IDENTITY, other).unwrap_err();
        assert!(matches!(error, Error::WrongSide { expected, got } if expected == first.side && got == other.side));
        assert_eq!(episode.estimate(), before);
        let saved = serde_json::to_string(&episode.record().unwrap()).unwrap();
        // Files of holes are what they were before pegs could be named.
        assert_eq!(saved.contains("\"side\":\"peg\""), first.side == Side::Peg, "{saved}");
        assert!(!saved.contains("\"hole\""), "{saved}");
        let restored = Episode::restore(&serde_json::from_str(&saved).unwrap(), world.bank.clone()).unwrap();
        assert_eq!(restored.side(), first.side);
    }
}

#[test]
fn the_same_picture_after_a_motion_is_a_frozen_camera() {
    let (sensor, frame) = sensor();
    let world = World::new(2, GRID, 0.2, 0.02, 2);
    let first = sensor.observe(&frame).unwrap();
    let mut episode = Episode::begin(EpisodeConfig::default(), world.bank.clone(), &first).unwrap();
    let before = episode.estimate();
    for moved in [Se2::from_degrees(3.0, 0.0, 0.0), Se2::from_degrees(0.0, 0.0, -5.0)] {
        let error = episode.observe(moved, &sensor.observe(&frame).unwrap()).unwrap_err();
        assert!(matches!(error, Error::FrozenFrame { .. }), "{error}");
    }
    assert_eq!(episode.estimate(), before);
    // One value of one pixel differs; a sensor that stands still; a simulated frame.
    let mut rgb = frame.rgb().to_vec();
    rgb[100] += 1;
    let new = sensor.observe(&Frame::new(16, 12, rgb).unwrap()).unwrap();
    episode.observe(Se2::from_degrees(3.0, 0.0, 0.0), &new).unwrap();
    episode.observe(Se2::IDENTITY, &new).unwrap();
    episode.observe(Se2::from_degrees(3.0, 0.0, 0.0), &new.of_simulation()).unwrap();
}

#[test]
fn a_frame_that_cannot_be_used_says_what_is_wrong() {
    let (sensor, _) = sensor();
    let fault = |frame: Frame| match sensor.observe(&frame) {
        Err(Error::Frame { fault, .. }) => fault,
        other => panic!("{other:?}"),
    };
    let noise = |least: u8, n: usize| (0..3 * n).map(|i| least + (i * 7 % 9) as u8).collect();
    assert!(matches!(fault(Frame::new(16, 12, noise(8, 192)).unwrap()), FrameFault::Dark { .. }));
    assert!(matches!(fault(Frame::new(16, 12, noise(246, 192)).unwrap()), FrameFault::Saturated { .. }));
    assert!(matches!(fault(Frame::new(16, 12, vec![100; 576]).unwrap()), FrameFault::Uniform { .. }));
    assert!(matches!(fault(Frame::new(12, 16, noise(90, 192)).unwrap()), FrameFault::WrongSize { .. }));
}

#[test]
fn an_episode_can_be_held_by_a_thread() {
    fn is_owned<T: Send + Sync + 'static>() {}
    is_owned::<Episode>();
    is_owned::<Sensor>();
    is_owned::<Bank>();
}

#[test]
fn a_config_survives_json() {
    for config in [EpisodeConfig::default(), EpisodeConfig::paper()] {
        let text = serde_json::to_string(&config).unwrap();
        assert_eq!(serde_json::from_str::<EpisodeConfig>(&text).unwrap(), config);
    }
    assert!(serde_json::from_str::<EpisodeConfig>("{\"max_touchs\": 3}").is_err());
}

#[test]
fn expected_information_beats_chance_where_parts_differ_in_few_places() {
    // Eight parts with the same random view at each pose, but for a corner of 2 x 2 x 3 = 12 poses of 147.
    const DIM: usize = 32;
    let n_parts = 8;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut unit_row = || {
        let mut row: Vec<f32> = (0..DIM).map(|_| rng.random::<f32>() - 0.5).collect();
        normalize_rows(&mut row, DIM);
        row
    };
    let shared: Vec<Vec<f32>> = (0..GRID.len()).map(|_| unit_row()).collect();
    let in_corner = |cell: usize| GRID.pose(cell).x_mm > 6.0 && GRID.pose(cell).y_mm > 6.0;
    let rows: Vec<f32> = (0..n_parts * GRID.len())
        .flat_map(|row| if in_corner(row % GRID.len()) { unit_row() } else { shared[row % GRID.len()].clone() })
        .collect();
    let names = (0..n_parts).map(|part| part.to_string()).collect();
    let shares = vec![0.2; n_parts * GRID.len()];
    let bank = Arc::new(Bank::from_rows(names, GRID, Rows::new(DIM, rows).unwrap(), shares, "").unwrap());
    let n_correct = |rule| {
        let n_right = |seed: &u64| {
            let (part, start) = (*seed as usize % n_parts, GRID.pose(70));
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            let mut touch = |pose: Se2| {
                let row = bank.row(part * GRID.len() + GRID.nearest(&pose).unwrap());
                let query = row.iter().map(|value| value + 0.1 * (rng.random::<f32>() - 0.5)).collect();
                Observation::new(query, 0.2)
            };
            let config = never_confident(2).changed(|settings, _, method| {
                (settings.seed, method.rule) = (*seed, rule);
            });
            let mut episode = Episode::begin(config, bank.clone(), &touch(start)).unwrap();
            let reach: Vec<Se2> = (0..GRID.len()).map(|cell| start.inverse() * GRID.pose(cell)).collect();
            let Decision::Touch(action) = episode.decide(&reach).unwrap() else { return false };
            episode.observe(action.sensor_from_next, &touch(start * action.sensor_from_next)).unwrap();
            episode.estimate().part == bank.parts()[part]
        };
        (0..64).filter(n_right).count()
    };
    // By chance 1 in 8 is right without the corner: 64 / 8 = 8, and few random touches land in it.
    let random = n_correct(ActionRule::Random);
    assert!(random < 32, "{random}");
    let informed = n_correct(ActionRule::Information);
    assert!(informed >= 60, "{informed}");
}

//! The posterior against its definition, and what must hold of it.

use super::*;
use crate::belief::KnownStart;
use crate::belief::particle::ParticleConfig;
use crate::insertion::Tried;
use crate::touch::Observation;
use proptest::prelude::*;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::pose::symmetry::Symmetry;
use tactile_infer::bank::rows::Rows;

/// 3 x 3 x 3 = 27 poses.
const GRID: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
const N_CELLS: usize = 27;
const DIM: usize = 4;

fn unit_rows(n_rows: usize, seed: u64) -> Vec<Vec<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut row = || {
        let values: Vec<f32> = (0..DIM).map(|_| rng.random::<f32>() - 0.5).collect();
        let norm = values.iter().map(|value| value * value).sum::<f32>().sqrt();
        values.iter().map(|value| value / norm).collect()
    };
    (0..n_rows).map(|_| row()).collect()
}

fn bank(parts: &[&[Vec<f32>]]) -> Bank {
    let names = (0..parts.len()).map(|part| part.to_string()).collect();
    let rows: Vec<f32> = parts.iter().flat_map(|rows| rows.concat()).collect();
    let shares = (0..parts.len() * N_CELLS).map(|row| if row % 5 == 0 { 0.0 } else { 0.3 }).collect();
    Bank::from_rows(names, GRID, Rows::new(DIM, rows).unwrap(), shares, "").unwrap()
}

fn touches(n: usize, seed: u64) -> Vec<(Se2, Observation)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 1000);
    unit_rows(n, seed + 500)
        .into_iter()
        .map(|query| {
            let mut step = |scale: f64| scale * (rng.random::<f64>() - 0.5);
            let moved = Se2::from_degrees(step(8.0), step(8.0), step(60.0));
            let edge_share = if step(1.0) > 0.3 { 0.0 } else { 0.3 };
            let rarity = step(4.0) as f32;
            (moved, Observation { rarity, ..Observation::new(query, edge_share) })
        })
        .collect()
}

#[test]
fn two_places_that_feel_the_same_are_not_one() {
    let mut rows = unit_rows(N_CELLS, 4);
    let [left, right] = [-4.0, 4.0].map(|x| GRID.nearest(&Se2::new(x, 0.0, 0.0)).unwrap());
    rows[right] = rows[left].clone();
    let bank = bank(&[&rows]);
    let config = TouchModel { steepness: 1e3, outlier_share: 0.0, ..TouchModel::default() };
    let touch = TouchLikelihood::new(&Observation::new(rows[left].clone(), 0.3), &bank, &config).unwrap();
    let belief = Belief::new(&bank, EngineConfig::Exact, 1, 1, touch);
    // In half of all cases it is at the other place, 8 mm away.
    let covariance = belief.covariance(0, &Se2::new(-4.0, 0.0, 0.0), &Symmetry::NONE, false);
    assert!((covariance[0][0] - 32.0).abs() < 0.1 && covariance[1][1] < 0.1, "{covariance:?}");
}

/// The probability of each state, in order.
fn masses_of(belief: &Belief) -> Vec<f64> {
    let mut masses = vec![0.0; belief.posterior().n_states()];
    belief
        .posterior()
        .states()
        .iter()
        .for_each(|(state, mass)| masses[state.part * belief.posterior().grid().len() + state.cell] = *mass);
    masses
}

/// log p(touch | state) of a touch, judged again.
fn log_states(belief: &Belief, touch: usize) -> Vec<f64> {
    let Evidence { first_from_sensor, likelihood, weight, .. } = &belief.touches()[touch];
    let evidence = Evidence::of(&belief.views, *first_from_sensor, *weight, likelihood.clone());
    crate::belief::blocks::log_states([&belief.views, belief.posterior().grid()], &evidence)
}

/// Touches that share no error, wherever they are.
fn independent() -> TouchModel {
    TouchModel { shared_mm: 0.0, ..TouchModel::default() }
}

fn run(bank: &Bank, engine: EngineConfig, touches: &[(Se2, Observation)], config: &TouchModel) -> Belief {
    let likelihood = |touch: &Observation| TouchLikelihood::new(touch, bank, config).unwrap();
    let mut belief = Belief::new(bank, engine, 1, 3, likelihood(&touches[0].1));
    for (moved, touch) in &touches[1..] {
        belief.update(moved, likelihood(touch));
    }
    belief
}

/// The same with all states.
fn run_all(bank: &Bank, touches: &[(Se2, Observation)], config: &TouchModel) -> Belief {
    let likelihood = |touch: &Observation| TouchLikelihood::new(touch, bank, config).unwrap();
    let mut belief = Belief::of_all_states(bank, 1, likelihood(&touches[0].1));
    for (moved, touch) in &touches[1..] {
        belief.update(moved, likelihood(touch));
    }
    belief
}

/// Where a part is touched first is known beforehand; what is recorded beyond is seen by later touches.
#[test]
fn a_narrower_start_is_what_is_believed_of_the_whole_given_that_the_part_is_there() {
    let rows = unit_rows(2 * N_CELLS, 6);
    let whole = bank(&[&rows[..N_CELLS], &rows[N_CELLS..]]);
    let start = PoseGrid { xy_half_mm: 0.0, theta_half_deg: 0.0, ..GRID };
    for start in [start, PoseGrid { theta_half_deg: 30.0, ..start }, PoseGrid { xy_half_mm: 4.0, ..start }] {
        let narrow = whole.clone().with_start(start).unwrap();
        let touches = touches(4, 9);
        let [of_whole, of_narrow] = [&whole, &narrow].map(|bank| run_all(bank, &touches, &TouchModel::default()));
        assert_eq!(of_narrow.posterior().grid(), &start);
        let (masses, given) = (masses_of(&of_whole), masses_of(&of_narrow));
        let cells: Vec<usize> = (0..start.len()).map(|cell| GRID.nearest(&start.pose(cell)).unwrap()).collect();
        let there: Vec<f64> = (0..2)
            .flat_map(|part| cells.iter().map(move |cell| part * N_CELLS + cell))
            .map(|state| masses[state])
            .collect();
        let sum: f64 = there.iter().sum();
        for (given, there) in given.iter().zip(&there) {
            assert!((given - there / sum).abs() < 1e-9, "{given} {there} {sum}");
        }
        // And their evidence: the states there are all there are beforehand.
        let share = sum * (2 * N_CELLS) as f64 / (2 * start.len()) as f64;
        assert!((of_narrow.log_evidence() - of_whole.log_evidence() - share.ln()).abs() < 1e-9);
    }
}

/// The belief without it times what was known, made one again.
#[test]
fn a_known_start_is_bayes_rule_before_the_first_touch() {
    let rows = unit_rows(2 * N_CELLS, 8);
    let bank = bank(&[&rows[..N_CELLS], &rows[N_CELLS..]]);
    let covariance = [[9.0, 2.0, 0.1], [2.0, 6.0, 0.0], [0.1, 0.0, 0.05]];
    let start = KnownStart { part_from_first: Se2::from_degrees(1.0, -3.0, 20.0), covariance };
    let known = start.over(&GRID).unwrap();
    let (config, touches) = (TouchModel::default(), touches(4, 11));
    let likelihood = |touch: &Observation| TouchLikelihood::new(touch, &bank, &config).unwrap();
    let begun = |engine: Start| {
        let mut belief = Belief::begin(&bank, 1, engine, likelihood(&touches[0].1), Some(known));
        touches[1..].iter().for_each(|(moved, touch)| {
            belief.update(moved, likelihood(touch));
        });
        belief
    };
    let without = run_all(&bank, &touches, &config);
    let weight = |state: usize| known.log(&GRID.pose(state % N_CELLS)).exp();
    let product: Vec<f64> = masses_of(&without).iter().enumerate().map(|(state, p)| p * weight(state)).collect();
    let sum: f64 = product.iter().sum();
    for (allowed, most) in [(0.0, 1e-9), (ALLOWED_ERROR, ALLOWED_ERROR)] {
        let found = begun(Start::Exact { allowed });
        for (found, product) in masses_of(&found).iter().zip(&product) {
            assert!((found - product / sum).abs() <= most, "{found} {}", product / sum);
        }
        // States count as one on average, so that its evidence stays what the touches say against chance.
        let expected = without.log_evidence() + sum.ln();
        assert!((found.log_evidence() - expected).abs() < most.max(1e-9) * 2.0, "{expected}");
    }
    // Particles, by their numbers.
    let particles = ParticleConfig { n_particles: 20_000, ..ParticleConfig::default() };
    let found = begun(Start::Particles { config: particles, seed: 5 });
    let by_part: f64 = product[..N_CELLS].iter().sum::<f64>() / sum;
    assert!((found.posterior().by_part()[0] - by_part).abs() < 0.05, "{by_part}");
    // Between the states, too.
    let pose = Se2::from_degrees(0.7, -0.4, 3.0);
    let [log, before] = [begun(Start::Exact { allowed: 0.0 }), without]
        .map(|belief| belief.touches().iter().map(|touch| touch.log_at(&GRID, 1, &pose)).sum::<f64>());
    assert!((log - before - known.log(&pose)).abs() < 1e-9);
}

/// The power of each touch's likelihood, by the earlier touch that shares most with it.
fn powers(touches: &[(Se2, Observation)], c: &TouchModel) -> Vec<f64> {
    let mut at = vec![Se2::IDENTITY];
    for (moved, _) in &touches[1..] {
        at.push(*at.last().unwrap() * *moved);
    }
    let share = |a: &Se2, b: &Se2| {
        let (x, y) = ((a.x_mm - b.x_mm) / c.shared_mm, (a.y_mm - b.y_mm) / c.shared_mm);
        let turn = (a.theta_rad - b.theta_rad).sin().atan2((a.theta_rad - b.theta_rad).cos());
        1.0 - 1.0 / (x * x + y * y + turn * turn).sqrt().exp()
    };
    (0..at.len()).map(|now| at[..now].iter().map(|earlier| share(earlier, &at[now])).fold(1.0, f64::min)).collect()
}

/// The posterior straight from its definition, in f64 probabilities: no logs, no shared interpolation.
fn brute_force(rows: &[Vec<f32>], n_parts: usize, touches: &[(Se2, Observation)], c: &TouchModel) -> Vec<f64> {
    let likelihoods: Vec<Vec<f64>> = touches
        .iter()
        .map(|(_, touch)| {
            let cosine = |row: &Vec<f32>| -> f64 {
                row.iter().zip(&touch.query).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
            };
            let steepness = c.steepness * ((f64::from(touch.edge_share) + 0.003) / 0.05).powf(c.steepness_by_edge);
            let odds = |cosine: f64| {
                let chord = 2.0 * (cosine.clamp(-1.0, 1.0).acos() / 2.0).sin();
                (c.match_offset + f64::from(touch.rarity)).exp() / (steepness * (chord - c.own_distance)).exp()
            };
            let likely = |row: &Vec<f32>| (1.0 - c.outlier_share) * odds(cosine(row)) + c.outlier_share;
            // Against what nobody recorded: the mean view, or the world.
            let mean = rows.iter().map(likely).sum::<f64>() / rows.len() as f64;
            rows.iter().map(|row| likely(row) / mean.max(1.0)).collect()
        })
        .collect();
    let powers = powers(touches, c);
    let mut masses: Vec<f64> = (0..n_parts * N_CELLS)
        .map(|state| {
            let mut pose = GRID.pose(state % N_CELLS);
            let mut product = 1.0;
            for (index, (moved, _)) in touches.iter().enumerate() {
                if index > 0 {
                    pose = pose * *moved;
                }
                let average = 1.0;
                let distance = |cell: usize| {
                    let recorded = GRID.pose(cell);
                    let shift = recorded.distance_mm(&pose) / 4.0;
                    shift.max((recorded.theta_rad - pose.theta_rad).to_degrees().abs() / 30.0)
                };
                let inside = pose.x_mm.abs() <= 6.0 && pose.y_mm.abs() <= 6.0 && pose.theta_deg().abs() <= 45.0;
                let apart = |a: f64, b: f64, step: f64| (a - b).abs() <= step / 2.0;
                let cell = (0..N_CELLS).find(|cell| {
                    let recorded = GRID.pose(*cell);
                    apart(recorded.x_mm, pose.x_mm, 4.0)
                        && apart(recorded.y_mm, pose.y_mm, 4.0)
                        && apart(recorded.theta_deg(), pose.theta_deg(), 30.0)
                });
                let likelihood = match cell.filter(|_| inside) {
                    None => average,
                    Some(cell) => {
                        let excess = (distance(cell) / c.nearest_tolerance - 1.0).max(0.0);
                        let trust = (-excess * excess / 2.0).exp();
                        trust * likelihoods[index][state / N_CELLS * N_CELLS + cell] + (1.0 - trust) * average
                    }
                };
                product *= f64::powf(likelihood, powers[index]);
            }
            product
        })
        .collect();
    let sum: f64 = masses.iter().sum();
    masses.iter_mut().for_each(|mass| *mass /= sum);
    masses
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn the_exact_engine_agrees_with_the_definition(seed in 0..1000_u64, n_touches in 1..6_usize) {
        let rows = unit_rows(3 * N_CELLS, seed);
        let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
        let touches = touches(n_touches, seed);
        let config = TouchModel { shared_mm: 5.0, ..independent() };
        let belief = run_all(&bank, &touches, &config);
        let expected = brute_force(&rows, 3, &touches, &config);
        for (got, expected) in masses_of(&belief).iter().zip(&expected) {
            // Cosines are f32 (error 1e-7), over distances of 0.1 and more, times a steepness of at most 40, over at most 5
            // touches.
            prop_assert!((got - expected).abs() <= 2e-4 * expected + 1e-12, "{got} {expected}");
        }
    }

    /// The touches are drawn at random and contradict each other; asked after each of them.
    #[test]
    fn what_is_left_out_moves_the_posterior_no_more_than_it_says(seed in 0..1000_u64, cubic in any::<bool>()) {
        let rows = unit_rows(3 * N_CELLS, seed);
        let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
        let interpolation =
            if cubic { crate::likelihood::interpolation::Interpolation::Cubic } else { crate::likelihood::interpolation::Interpolation::Nearest };
        let config = TouchModel { interpolation, ..TouchModel::default() };
        let touches = touches(10, seed);
        for n_touches in 1..=10 {
            let belief = run(&bank, EngineConfig::Exact, &touches[..n_touches], &config);
            let all = run_all(&bank, &touches[..n_touches], &config);
            let (belief_masses, all_masses) = (masses_of(&belief), masses_of(&all));
            let apart = belief_masses.iter().zip(&all_masses).map(|(a, b)| (a - b).abs()).sum::<f64>() / 2.0;
            prop_assert!(apart <= belief.posterior().left_out() + 1e-12 && belief.posterior().left_out() <= ALLOWED_ERROR, "{apart}");
            prop_assert_eq!(all.posterior().left_out(), 0.0);
        }
    }

    #[test]
    fn the_posterior_is_normalised(seed in 0..1000_u64, particles in any::<bool>()) {
        let rows = unit_rows(2 * N_CELLS, seed);
        let bank = bank(&[&rows[..27], &rows[27..]]);
        let engine = if particles { EngineConfig::Particle(ParticleConfig::default()) } else { EngineConfig::Exact };
        let belief = run(&bank, engine, &touches(4, seed), &TouchModel::default());
        prop_assert!((belief.posterior().by_part().iter().sum::<f64>() - 1.0).abs() < 1e-9);
        prop_assert!((belief.posterior().states().iter().map(|(_, mass)| mass).sum::<f64>() - 1.0).abs() < 1e-9);
        prop_assert!(belief.posterior().entropy_nats() >= 0.0 && belief.posterior().entropy_nats() <= 54.0_f64.ln() + 1e-9);
    }

    #[test]
    fn permuting_the_parts_permutes_the_posterior(seed in 0..1000_u64) {
        let rows = unit_rows(2 * N_CELLS, seed);
        let posterior = |parts: &[&[Vec<f32>]]| {
            let belief = run(&bank(parts), EngineConfig::Exact, &touches(4, seed), &TouchModel::default());
            belief.posterior().by_part().to_vec()
        };
        let (there, back) = (posterior(&[&rows[..27], &rows[27..]]), posterior(&[&rows[27..], &rows[..27]]));
        prop_assert!((there[0] - back[1]).abs() < 1e-9 && (there[1] - back[0]).abs() < 1e-9);
    }

    #[test]
    fn an_action_and_its_inverse_look_up_the_same_rows(
        x in -30.0..30.0_f64, y in -30.0..30.0_f64, theta in -170.0..170.0_f64,
    ) {
        let rows = unit_rows(N_CELLS, 1);
        let bank = bank(&[&rows]);
        let there = Se2::from_degrees(x, y, theta);
        let mut touches = touches(3, 1);
        touches[1].0 = there;
        touches[2].0 = there.inverse();
        touches[2].1 = touches[0].1.clone();
        let belief = run(&bank, EngineConfig::Exact, &touches, &independent());
        let logs = [2, 0].map(|touch| log_states(&belief, touch));
        let apart = logs[0].iter().zip(&logs[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        prop_assert!(apart < 1e-9);
    }
}

#[test]
fn many_particles_agree_with_the_exact_engine() {
    let rows = unit_rows(3 * N_CELLS, 11);
    let bank = bank(&[&rows[..27], &rows[27..54], &rows[54..]]);
    let (touches, config) = (touches(4, 11), TouchModel::default());
    let exact = run(&bank, EngineConfig::Exact, &touches, &config);
    let engine = ParticleConfig { n_particles: 20_000, ..ParticleConfig::default() };
    let particle = run(&bank, EngineConfig::Particle(engine), &touches, &config);
    for (a, b) in particle.posterior().by_part().iter().zip(exact.posterior().by_part()) {
        // Standard error of a share of 2e4 draws: 0.0035; at an effective size of a tenth: 0.011; four of those.
        assert!((a - b).abs() < 0.045, "{a} {b}");
    }
    assert_eq!(particle.posterior().best(None), exact.posterior().best(None));
}

#[test]
fn one_part_and_one_particle_and_half_a_turn_are_fine() {
    let rows = unit_rows(N_CELLS, 2);
    let bank = bank(&[&rows]);
    let mut touches = touches(3, 2);
    touches[1].0 = Se2::from_degrees(0.0, 0.0, 180.0);
    touches[2].0 = Se2::from_degrees(0.0, 0.0, -180.0);
    let engine = ParticleConfig { n_particles: 1, ..ParticleConfig::default() };
    for engine in [EngineConfig::Exact, EngineConfig::Particle(engine)] {
        let belief = run(&bank, engine, &touches, &TouchModel::default());
        assert!((belief.posterior().by_part()[0] - 1.0).abs() < 1e-12);
        // Half a turn leads out of a reach of 30 degrees: the world, never no contact.
        assert!(log_states(&belief, 1).iter().all(|log| *log == 0.0));
        assert!(log_states(&belief, 0).iter().any(|log| *log != 0.0));
    }
}

#[test]
fn the_same_touch_twice_tells_nothing_new() {
    let rows = unit_rows(2 * N_CELLS, 6);
    let bank = bank(&[&rows[..27], &rows[27..]]);
    let mut touches = touches(2, 6);
    touches[1] = (Se2::IDENTITY, touches[0].1.clone());
    let once = run_all(&bank, &touches[..1], &TouchModel::default());
    let twice = run_all(&bank, &touches, &TouchModel::default());
    assert!(masses_of(&once).iter().zip(masses_of(&twice).iter()).all(|(a, b)| (a - b).abs() < 1e-12));
    let counted_twice = run(&bank, EngineConfig::Exact, &touches, &independent());
    assert!(counted_twice.posterior().entropy_nats() < once.posterior().entropy_nats() - 0.1);
}

#[test]
fn a_finer_grid_of_states_holds_the_coarser_one() {
    let rows = unit_rows(2 * N_CELLS, 8);
    let bank = bank(&[&rows[..27], &rows[27..]]);
    let config = TouchModel { interpolation: crate::likelihood::interpolation::Interpolation::Cubic, ..independent() };
    let (touches, likelihood) = (touches(1, 8), |touch| TouchLikelihood::new(touch, &bank, &config).unwrap());
    let belief = |n| Belief::new(&bank, EngineConfig::Exact, n, 3, likelihood(&touches[0].1));
    let (coarse, fine) = (belief(1), belief(2));
    assert_eq!(fine.posterior().grid().len(), 5 * 5 * 5);
    let logs = [&coarse, &fine].map(|belief| log_states(belief, 0));
    for cell in 0..N_CELLS {
        let same = fine.posterior().grid().nearest(&GRID.pose(cell)).unwrap();
        assert!((logs[0][cell] - logs[1][same]).abs() < 1e-4);
    }
    assert!((fine.posterior().by_part().iter().sum::<f64>() - 1.0).abs() < 1e-9);
}

#[test]
fn a_touch_outside_the_recorded_area_changes_nothing() {
    let rows = unit_rows(2 * N_CELLS, 4);
    let bank = bank(&[&rows[..27], &rows[27..]]);
    let mut touches = touches(2, 4);
    touches[1].0 = Se2::from_degrees(100.0, 0.0, 0.0);
    let config = TouchModel::default();
    let (before, after) = (run_all(&bank, &touches[..1], &config), run_all(&bank, &touches, &config));
    for (a, b) in masses_of(&before).iter().zip(masses_of(&after).iter()) {
        assert!((a - b).abs() < 1e-12);
    }
}

/// Bayes' rule by its definition: of the part and near the pose that were tried, so much less.
#[test]
fn a_peg_tried_in_vain_is_evidence_against_where_it_was_tried() {
    let rows = [unit_rows(N_CELLS, 1), unit_rows(N_CELLS, 2)];
    let bank = bank(&[&rows[0], &rows[1]]);
    let likelihood = |touch: &Observation| TouchLikelihood::new(touch, &bank, &TouchModel::default()).unwrap();
    let made = touches(4, 3);
    let at = Se2::from_degrees(3.6, -0.3, 4.0);
    let tried = Tried {
        part: "1".into(),
        part_from_first: at,
        covariance: [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 1e-4]],
        covered: 0.9,
    };
    for all in [true, false] {
        let first = likelihood(&made[0].1);
        let mut belief = if all {
            Belief::of_all_states(&bank, 1, first)
        } else {
            Belief::new(&bank, EngineConfig::Exact, 1, 1, first)
        };
        belief.update(&made[1].0, likelihood(&made[1].1));
        let mut never = belief.clone();
        let before = belief.log_evidence();
        belief.did_not_fit(tried.over(&bank, belief.posterior().grid()).unwrap());
        let check = |belief: &Belief, never: &Belief| {
            // The nearest state, 4 mm, 0 mm and 0 degrees, is the only one within a cell.
            let nearest = N_CELLS + GRID.nearest(&Se2::new(4.0, 0.0, 0.0)).unwrap();
            let mut expected = masses_of(never);
            expected[nearest] *= 0.1;
            let sum: f64 = expected.iter().sum();
            for (found, expected) in masses_of(belief).iter().zip(&expected) {
                assert!((found - expected / sum).abs() < 2e-3 * (1.0 - f64::from(u8::from(all))) + 1e-12);
            }
            sum.ln()
        };
        let log_sum = check(&belief, &never);
        assert!((belief.log_evidence() - before - log_sum).abs() < 1e-3);
        for (moved, touch) in &made[2..] {
            belief.update(moved, likelihood(touch));
            never.update(moved, likelihood(touch));
            check(&belief, &never);
        }
        // Where views are interpolated, too: by the pose itself.
        let apart = |part: usize, pose: &Se2| {
            let log = |belief: &Belief| -> f64 {
                belief.touches().iter().map(|touch| touch.log_at(&belief.views, part, pose)).sum()
            };
            log(&belief) - log(&never)
        };
        assert!((apart(1, &at) - 0.1_f64.ln()).abs() < 1e-12 && apart(0, &at) == 0.0);
        assert_eq!(apart(1, &Se2::from_degrees(-4.0, 0.0, 0.0)), 0.0);
    }
}

#[test]
fn a_try_that_none_was_is_refused() {
    let rows = unit_rows(N_CELLS, 1);
    let bank = bank(&[&rows]);
    let good = Tried { part: "0".into(), part_from_first: Se2::IDENTITY, covariance: [[0.0; 3]; 3], covered: 0.9 };
    assert!(good.over(&bank, &GRID).is_ok());
    let error = |tried: Tried| tried.over(&bank, &GRID).unwrap_err().to_string();
    assert!(error(Tried { part: "7".into(), ..good.clone() }).contains("expected a part of the bank: 0, got 7"));
    assert!(error(Tried { covered: 1.0, ..good.clone() }).contains("a probability below 1"));
    assert!(error(Tried { part_from_first: Se2::new(f64::NAN, 0.0, 0.0), ..good.clone() }).contains("finite numbers"));
    assert!(error(Tried { covariance: [[-1.0, 0.0, 0.0]; 3], ..good }).contains("a covariance of x, y (mm)"));
}

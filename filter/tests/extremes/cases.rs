//! The cases, group by group.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_data::pose::symmetry::Symmetry;
use tactile_infer::Bank;
use tactile_infer::bank::rows::Rows;

use super::case::{Case, Group};
use super::production::largest;
use super::reference::{Expected, OF_COSINE, Pose, Touch, expected};
use super::sample::Sample;
use super::scene::DIM;
use crate::Result;
use tactile_filter::Observation;
use tactile_filter::TouchModel;
use tactile_filter::belief::modes::modes;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::belief::{Belief, EngineConfig};
use tactile_filter::likelihood::TouchLikelihood;

/// Parts of the paper's boards.
pub const N_PARTS: usize = 12;

/// One pose at thirteen angles, the first and the last the same.
const RING: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 180.0, theta_step_deg: 30.0 };

/// One pose.
pub const POINT: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

/// States of a smaller probability are not compared: f64 ends at 1e-308.
const SMALLEST: f64 = 1e-250;

/// Where bounds come from: the rounding of cosines.
pub const OF_COSINES: &str = "30 roundings of a cosine in f32 (Higham), by what the log-likelihood is at both ends of \
    it, in each of the touches";

/// K from 1 to 1e6 against the exact engine.
pub fn particles(seed: u64, quick: bool) -> Result<Vec<Case>> {
    /// So flat that several parts stay probable.
    const FLAT: f64 = 5.0;
    let config = TouchModel { steepness: FLAT, ..Sample::model() };
    let sample = Sample::draw(N_PARTS, PoseGrid::SMALL, DIM, 3, seed);
    let bank = sample.bank()?;
    let exact = sample.belief(EngineConfig::Exact, seed, &config)?;
    let first = Sample { touches: sample.touches[..1].to_vec(), ..sample.clone() };
    let first = first.belief(EngineConfig::Exact, seed, &config)?;
    let deviation = deviation_of_one(&masses(&first), &masses(&exact), exact.posterior().by_part());
    let mut ranked = exact.posterior().by_part().to_vec();
    ranked.sort_unstable_by(|a, b| b.total_cmp(a));
    let lead = ranked[0] - ranked[1];
    let mut cases = Vec::new();
    for decades in 0..=if quick { 4 } else { 6 } {
        let n_particles = 10_usize.pow(decades);
        // Few particles need many runs for their error to be known; of many, it is small anyway.
        let n_runs = [1_000, 1_000, 100, 8, 8, 2, 2][decades as usize];
        let engine = EngineConfig::Particle(ParticleConfig { n_particles, ..ParticleConfig::default() });
        let mut squares = [0.0; N_PARTS];
        let mut right = 0;
        for run in 0..n_runs {
            let belief = sample.belief_with(&bank, engine, seed + run, &config)?;
            right += u64::from(names_truth(&belief));
            let pairs = belief.posterior().by_part().iter().zip(exact.posterior().by_part());
            for (square, (got, expected)) in squares.iter_mut().zip(pairs) {
                *square += (got - expected).powi(2) / n_runs as f64;
            }
        }
        let error = largest(squares.iter().map(|square| square.sqrt()));
        let by_many = 4.0 * deviation / (n_particles as f64).sqrt();
        let by_few = error_of_few(first.posterior().by_part(), exact.posterior().by_part(), n_runs);
        // Of fewer than a thousand particles one may carry all the weight, and standard errors say nothing.
        let (bound, expected) = if n_particles >= 1000 {
            (by_many.min(by_few), "the exact engine's probability of each part, to four standard errors")
        } else {
            (by_few, "the exact engine's probability of each part, no worse than one particle gives it")
        };
        let case = Case::measured(Group::Particles, "class posterior", expected, error, bound).at(n_particles as f64);
        let case =
            case.by("standard errors of importance sampling (Owen 9.8), or Jensen's and Hoeffding's inequalities");
        // Fewer may miss the part by chance.
        cases.push(if bound < lead { case.right_part(right == n_runs) } else { case });
    }
    Ok(cases)
}

/// The largest root of a mean squared error that any number of particles may have, over some runs.
///
/// The estimate of a part's probability p is the mean of the indicator of a particle drawn by the weights, so that by
/// Jensen's inequality its squared error is at most that of such a particle: r (1 - p)^2 + (1 - r) p^2 where r, the
/// probability to draw that part, is between its probability q after the first touch, from which particles are drawn,
/// and p. The mean of so many squares of 0..=1 exceeds its expectation by more than the last term once in 1000 times
/// over all parts (Hoeffding 1963, Theorem 1).
fn error_of_few(first: &[f64], last: &[f64], n_runs: u64) -> f64 {
    let square = |(q, p): (&f64, &f64)| {
        let with = |r: f64| r * (1.0 - p).powi(2) + (1.0 - r) * p.powi(2);
        with(*q).max(with(*p))
    };
    let by_chance = ((1_000.0 * last.len() as f64).ln() / (2.0 * n_runs as f64)).sqrt();
    (largest(first.iter().zip(last).map(square)) + by_chance).sqrt()
}

/// The largest standard error of a part's probability from one draw of `first` weighed to represent
/// `last` (self-normalised importance sampling, Owen 2013, Eq. 9.8).
fn deviation_of_one(first: &[f64], last: &[f64], class_posterior: &[f64]) -> f64 {
    let n_cells = last.len() / class_posterior.len();
    let of_class = |(class, posterior): (usize, &f64)| {
        let each = first.iter().zip(last).enumerate().filter(|(_, (q, _))| **q > 0.0);
        let inside = |state: usize| f64::from(u8::from(state / n_cells == class));
        each.map(|(state, (q, p))| p * p / q * (inside(state) - posterior).powi(2)).sum::<f64>().sqrt()
    };
    largest(class_posterior.iter().enumerate().map(of_class))
}

/// One part to ten thousand, nine poses each.
pub fn classes(seed: u64, quick: bool) -> Result<Vec<Case>> {
    let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };
    let n_touches = 3;
    let config = Sample::model();
    let mut cases = Vec::new();
    for decades in 0..=if quick { 3 } else { 4 } {
        let n_parts = 10_usize.pow(decades);
        let sample = Sample::draw(n_parts, grid, DIM, n_touches, seed);
        let belief = sample.belief(EngineConfig::Exact, seed, &config)?;
        let case = compared(Group::Classes, "exact engine", &belief, &sample.expected(&config, OF_COSINE));
        cases.push(case.at(n_parts as f64).right_part(names_truth(&belief)));
    }
    Ok(cases)
}

/// Rows and queries that carry no information, that overflow, and that are not numbers.
pub fn similarities() -> Result<Vec<Case>> {
    let unit = |x: f32, y: f32| spread(x, y, 1.0);
    let (east, north, between) = (unit(1.0, 0.0), unit(0.0, 1.0), unit(0.6, 0.8));
    let (zero, huge) = (vec![0.0; DIM], 3e38);
    let usual = [&east, &north, &between].map(Clone::clone);
    let with = |row: Vec<f32>| vec![row, north.clone(), between.clone()];
    let touches = [
        ("all similarities equal", "every part as probable", vec![between.clone(); 3], east.clone(), [0.6; 3]),
        ("all similarities -1", "every part as probable", vec![east.clone(); 3], unit(-1.0, 0.0), [-1.0; 3]),
        ("one similarity +inf", "counts as -1", with(spread(huge, 0.0, 0.25)), unit(0.6, 0.8), [-1.0, 0.8, 1.0]),
        ("one similarity -inf", "counts as -1", with(spread(-huge, 0.0, 0.25)), unit(0.6, 0.8), [-1.0, 0.8, 1.0]),
        ("one similarity NaN", "counts as -1", with(spread(huge, -huge, 0.25)), unit(0.6, 0.8), [-1.0, 0.8, 1.0]),
        ("a row of zeros", "cosine 0", with(zero.clone()), between.clone(), [0.0, 0.8, 1.0]),
        ("every row zeros", "every part as probable", vec![zero.clone(); 3], east.clone(), [0.0; 3]),
        ("a query of zeros", "every part as probable", usual.to_vec(), zero.clone(), [0.0; 3]),
        ("a query of length 1e-15", "its direction counts", usual.to_vec(), spread(1.0, 0.0, 1e-15), [1.0, 0.0, 0.6]),
        ("a query of length 1e15", "its direction counts", usual.to_vec(), spread(1.0, 0.0, 1e15), [1.0, 0.0, 0.6]),
        ("a query of length 1e-30", "its direction counts", usual.to_vec(), spread(1.0, 0.0, 1e-30), [1.0, 0.0, 0.6]),
        ("a query of length 1e30", "its direction counts", usual.to_vec(), spread(1.0, 0.0, 1e30), [1.0, 0.0, 0.6]),
    ];
    let mut cases = Vec::new();
    for (variant, expected, rows, query, cosines) in touches {
        cases.push(by_hand(variant, expected, &rows, query, &cosines)?);
    }
    let bank = point_bank(&usual)?;
    let config = TouchModel::default();
    let touched = |query: Vec<f32>, edge_share: f32| -> Result<()> {
        Ok(TouchLikelihood::new(&Observation::new(query, edge_share), &bank, &config).map(|_| ())?)
    };
    let with_value = |value: f32| {
        let mut row = east.clone();
        row[0] = value;
        row
    };
    let refused = |variant: &str, came: Result<()>| Case::refused(Group::Similarity, variant, came);
    for (name, value) in [("NaN", f32::NAN), ("+inf", f32::INFINITY), ("-inf", f32::NEG_INFINITY)] {
        cases.push(refused(&format!("a row with {name}"), point_bank(&with(with_value(value))).map(|_| ())));
        cases.push(refused(&format!("a query with {name}"), touched(with_value(value), 0.2)));
    }
    cases.push(refused("a query too short", touched(vec![1.0], 0.2)));
    cases.push(refused("an edge share of NaN", touched(east.clone(), f32::NAN)));
    for (name, rarity) in [("NaN", f32::NAN), ("+inf", f32::INFINITY)] {
        let observation = Observation { rarity, ..Observation::new(east.clone(), 0.2) };
        let came = TouchLikelihood::new(&observation, &bank, &config).map(|_| ());
        cases.push(refused(&format!("a rarity of {name}"), came.map_err(Into::into)));
    }
    for (name, value) in [("0", 0.0), ("NaN", f64::NAN), ("+inf", f64::INFINITY)] {
        for (what, config) in [
            ("a steepness", TouchModel { steepness: value, ..config }),
            ("an own distance", TouchModel { own_distance: value, ..config }),
            ("a temperature", TouchModel { temperature: Some(value), ..config }),
        ] {
            cases.push(refused(&format!("{what} of {name}"), config.validate().map_err(Into::into)));
        }
    }
    Ok(cases)
}

/// `x` and `y` as the first two of sixteen values, eight times over, the whole of length `scale * |(x, y)|`: each
/// fills a lane of the inner product.
pub fn spread(x: f32, y: f32, scale: f32) -> Vec<f32> {
    let share = if x.abs().max(y.abs()) > 1e30 { 1.0 } else { scale / 8.0_f32.sqrt() };
    (0..DIM).map(|at| share * [x, y].get(at % 16).copied().unwrap_or(0.0)).collect()
}

fn point_bank(rows: &[Vec<f32>]) -> Result<Bank> {
    let names = (0..rows.len()).map(|part| part.to_string()).collect();
    Ok(Bank::from_rows(names, POINT, Rows::new(DIM, rows.concat())?, vec![0.2; rows.len()], "")?)
}

/// One touch of parts of one row each, against the reference by these cosines.
fn by_hand(variant: &str, expected: &str, rows: &[Vec<f32>], query: Vec<f32>, cosines: &[f64]) -> Result<Case> {
    let observation = Observation::new(query, 0.2);
    let case = of_one_touch((Group::Similarity, variant), rows, &observation, cosines, &TouchModel::default())?;
    Ok(Case { expected: expected.into(), ..case })
}

/// The same of any group, touch and settings.
pub fn of_one_touch(
    (group, variant): (Group, &str),
    rows: &[Vec<f32>],
    observation: &Observation,
    cosines: &[f64],
    config: &TouchModel,
) -> Result<Case> {
    let belief =
        Belief::of_all_states(&point_bank(rows)?, 1, TouchLikelihood::new(observation, &point_bank(rows)?, config)?);
    let &Observation { edge_share, rarity, .. } = observation;
    let touch = Touch { moved: Se2::IDENTITY, edge_share, rarity, cosines: cosines.to_vec() };
    Ok(compared(group, variant, &belief, &expected(&POINT, &[touch], config, OF_COSINE)))
}

/// A belief against the reference: the largest relative error of a state's probability.
pub fn compared(group: Group, variant: impl Into<String>, belief: &Belief, reference: &Expected) -> Case {
    let error = relative_error(belief, &reference.logs);
    let expected = "as in f64, to the rounding of the cosines";
    Case::measured(group, variant, expected, error, reference.relative()).by(OF_COSINES)
}

/// Ten thousand motions one after the other: the pose against whole degrees and a compensated sum, and the
/// belief after as many touches.
pub fn chain(seed: u64, quick: bool) -> Result<Vec<Case>> {
    /// So flat that ten thousand touches leave other states a probability that f64 can hold.
    const FLAT: f64 = 5.0;
    let n_actions = if quick { 1_000 } else { 10_000 };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let steps: Vec<(f64, f64, i32)> = (0..n_actions)
        .map(|_| (8.0 * rng.random::<f64>() - 4.0, 8.0 * rng.random::<f64>() - 4.0, rng.random_range(-180..=180)))
        .collect();
    let composed =
        steps.iter().fold(Se2::IDENTITY, |pose, (x, y, degrees)| pose * Se2::from_degrees(*x, *y, f64::from(*degrees)));
    let (place, degrees) = compensated(&steps);
    let drift_mm = (composed.x_mm - place[0]).hypot(composed.y_mm - place[1]);
    let drift_deg = wrap_angle(composed.theta_rad - f64::from(degrees).to_radians()).to_degrees().abs();
    // Each step rounds the angle by up to an ulp of pi, which turns the 4 mm of each later step.
    let n = n_actions as f64;
    let bound_deg = n * (4.0 * f64::EPSILON).to_degrees();
    let bound_mm = n * bound_deg.to_radians() * 4.0;
    let at = |case: Case| case.at(n).by("each step rounds the angle by an ulp of pi, which turns all later steps");
    let mut cases = vec![
        at(Case::measured(Group::Chain, "drift of the place, mm", "the sum of the steps", drift_mm, bound_mm)),
        at(Case::measured(Group::Chain, "drift of the angle, degrees", "the sum of the turns", drift_deg, bound_deg)),
    ];
    let config = TouchModel { steepness: FLAT, shared_mm: 0.0, ..Sample::model() };
    let sample = Sample::draw(2, RING, 32, n_actions, seed);
    let belief = sample.belief(EngineConfig::Exact, seed, &config)?;
    let reference = sample.expected(&config, OF_COSINE);
    let case = compared(Group::Chain, "belief after as many touches", &belief, &reference);
    cases.push(case.at(n).right_part(names_truth(&belief)));
    Ok(cases)
}

/// Where steps (mm, mm, whole degrees) lead: the degrees are exact, the sum is Kahan's.
fn compensated(steps: &[(f64, f64, i32)]) -> ([f64; 2], i32) {
    let (mut place, mut lost, mut degrees) = ([0.0_f64; 2], [0.0_f64; 2], 0_i32);
    for (x, y, turn) in steps {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        for (axis, step) in [cos * x - sin * y, sin * x + cos * y].into_iter().enumerate() {
            let corrected = step - lost[axis];
            let sum = place[axis] + corrected;
            lost[axis] = (sum - place[axis]) - corrected;
            place[axis] = sum;
        }
        degrees = (degrees + turn).rem_euclid(360);
    }
    (place, degrees)
}

/// Turns of about half a turn either way, and a hole turned by half a turn.
pub fn wrap(seed: u64) -> Result<Vec<Case>> {
    let config = Sample::model();
    let mut cases = Vec::new();
    for degrees in [180.0, -180.0, 540.0, 180.0 - 1e-9, 180.0 + 1e-9, -179.0, 179.0, 360.0, 36_000.0] {
        let first = Se2::from_degrees(0.0, 0.0, 180.0);
        let motions = [Se2::from_degrees(0.0, 0.0, degrees), Se2::from_degrees(0.3, -0.2, 91.0)];
        let sample = Sample::along(N_PARTS, RING, DIM, first, &motions, seed);
        let belief = sample.belief(EngineConfig::Exact, seed, &config)?;
        let case = compared(Group::Wrap, "a turn of the sensor", &belief, &sample.expected(&config, OF_COSINE));
        cases.push(case.at(degrees).right_part(names_truth(&belief)));
        let truth = motions.iter().fold(Pose::from_degrees(0.0, 0.0, 180.0), |pose, moved| pose.then(&Pose::of(moved)));
        let mean = modes(belief.posterior(), &belief.first_from_sensor(), &|_| Symmetry::NONE)
            .first()
            .map_or(f64::NAN, |mode| truth.turned_deg(&Pose::of(&mode.part_from_sensor)));
        // A linear mean of angles on both sides of half a turn would be off by some 180 degrees.
        let case = Case::measured(Group::Wrap, "angle of the first mode, degrees", "the true angle", mean, 1.0);
        cases.push(case.at(degrees).by("noise of the touches; a mean that does not go round is off by 180"));
    }
    Ok(cases)
}

/// The largest relative error of a state's probability.
fn relative_error(belief: &Belief, expected: &[f64]) -> f64 {
    let compared = masses(belief).into_iter().zip(expected.iter().map(|log| log.exp()));
    largest(compared.filter(|(_, expected)| *expected > SMALLEST).map(|(got, expected)| (got / expected - 1.0).abs()))
}

/// The probability of each state, `[n_states]`.
fn masses(belief: &Belief) -> Vec<f64> {
    let n_cells = belief.posterior().grid().len();
    let mut masses = vec![0.0; belief.posterior().by_part().len() * n_cells];
    for (hypothesis, mass) in belief.posterior().states() {
        masses[hypothesis.part * n_cells + hypothesis.cell] = mass;
    }
    masses
}

/// Whether the true part is the most probable, alone.
pub fn names_truth(belief: &Belief) -> bool {
    let posterior = belief.posterior().by_part();
    let truth = posterior[Sample::TRUTH];
    posterior.iter().enumerate().all(|(part, probability)| part == Sample::TRUTH || *probability < truth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_one_draw_is_that_of_a_coin_where_the_weights_are_equal() {
        // Four states, two parts, nothing learned since the first touch: sqrt(p (1 - p)).
        let masses = [0.1, 0.2, 0.3, 0.4];
        assert!((deviation_of_one(&masses, &masses, &[0.3, 0.7]) - 0.21_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn one_particle_is_as_wrong_as_its_draw() {
        // One of two parts, 1/4 probable at first and 3/4 at last: the other is drawn 3 times in 4, and then off by
        // 3/4.
        let square = 0.75 * 0.75_f64.powi(2) + 0.25 * 0.25_f64.powi(2);
        let n_runs = 1_000_000_000_000;
        assert!((error_of_few(&[0.25, 0.75], &[0.75, 0.25], n_runs) - square.sqrt()).abs() < 1e-5);
        // A filter that always answers with a wrong part is outside the bound of a thousand runs.
        assert!(error_of_few(&[0.2, 0.8], &[0.9, 0.1], 1_000) < 0.9);
    }

    #[test]
    fn one_nan_is_not_overlooked() {
        assert!(largest([1.0, f64::NAN, 2.0].into_iter()).is_nan());
        assert_eq!(largest([1.0, 3.0, 2.0].into_iter()), 3.0);
    }

    #[test]
    fn steps_round_a_square_come_home() {
        let (place, degrees) = compensated(&[(4.0, 0.0, 90); 4]);
        assert!(place[0].hypot(place[1]) < 1e-14 && degrees == 0);
    }
}

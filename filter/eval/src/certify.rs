//! Fits the log-odds that a named part is there to episodes with parts that are and with strangers.
//!
//! In: evaluations with `--absent` and without. Out: [`PresenceOdds`]. The weights are those by which the named part is told from
//! a stranger at least cost, a stranger as likely as a part, over the touches after which an episode would name it (logistic
//! regression; Brümmer and du Preez, Application-independent evaluation of speaker detection, 2006). The tails are those of the
//! highest log-odds of an episode with a stranger, and of the lowest of one with a part that is there, until it is named.

use std::collections::BTreeSet;

use tactile_infer::presence::{Felt, N_WEIGHTS, PresenceOdds, Tail, Verified};

use crate::episodes::Episodes;
use crate::error::{Error, Result};
use crate::evaluate::Scored;

/// Fewer episodes tell no rate of one in a hundred.
const FEWEST: usize = 100;

/// Newton's steps; a dozen are usually enough.
const MAX_STEPS: usize = 100;

/// What keeps weights finite where both kinds can be told apart wholly, nats a squared weight.
const RIDGE: f64 = 1e-4;

/// Weights.
const N: usize = N_WEIGHTS;

/// What was fitted, and how well it tells parts from strangers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certified {
    /// The log-odds.
    pub odds: PresenceOdds,
    /// What they cost, bits a touch after which a part would be named; 1 is what knowing nothing costs (C_llr).
    pub cost_bits: f64,
    /// Strangers that differ: parts of different names or scenes.
    pub n_stranger_parts: usize,
}

/// A touch after which an episode would name its part.
struct Row {
    values: [f64; N],
    is_there: bool,
}

/// An episode's touches: what was felt, and whether it would name its part.
struct Course {
    felt: Vec<(Felt, bool)>,
    is_there: bool,
}

/// The log-odds by which evaluations tell strangers from parts that are there, with what a verifier says of them if `judged`.
/// `false_accept`: the rate at which parts are named.
///
/// # Errors
/// Fewer than a hundred episodes of either kind, evaluations of different sides, models or verifiers, and episodes that tell
/// nothing.
pub fn certify(evaluations: &[Episodes], judged: bool, false_accept: f64) -> Result<Certified> {
    check(evaluations, judged)?;
    let courses: Vec<Course> = evaluations.iter().flat_map(|of| courses(of, judged)).collect();
    let [n_strangers, n_present] =
        [false, true].map(|is| courses.iter().filter(|course| course.is_there == is).count());
    if n_strangers.min(n_present) < FEWEST {
        let expected = format!("{FEWEST} or more with strangers (--absent), and as many without");
        return Err(Error::invalid("episodes", expected, format!("{n_strangers} and {n_present}")));
    }
    let usual = usual(&courses);
    let rows = courses.iter().flat_map(|course| {
        let named = course.felt.iter().filter(|(_, is_named)| *is_named);
        named.map(|(felt, _)| Row { values: felt.values(usual), is_there: course.is_there })
    });
    let rows: Vec<Row> = rows.collect();
    let told = || Error::invalid("episodes", "strangers and parts that are named, and differ", "others");
    let (weights, cost) = fit(&rows).ok_or_else(told)?;
    let [offset, by_fit, by_touch, by_verifier, by_expected] = weights;
    let absent = evaluations.iter().filter(|of| of.setup.absent);
    let n_parts: Vec<f64> = absent.clone().map(|of| of.setup.parts.len() as f64 - 1.0).collect();
    let none = Tail { at: 0.0, scale: 1.0 };
    let odds = PresenceOdds {
        offset,
        by_fit,
        by_touch,
        by_verifier,
        by_expected,
        usual,
        strangers: none,
        present: none,
        n_parts: n_parts.iter().sum::<f64>() / n_parts.len() as f64,
        n_strangers,
        n_present,
    };
    let of_strangers = courses.iter().filter(|course| !course.is_there).filter_map(|course| highest(&odds, course));
    let strangers = Tail::of(of_strangers.collect(), n_strangers).ok_or_else(told)?;
    let odds = PresenceOdds { strangers, ..odds };
    let of_present =
        courses.iter().filter(|course| course.is_there).filter_map(|course| lowest(&odds, course, false_accept));
    let present = Tail::of(of_present.map(|value| -value).collect(), n_present).ok_or_else(told)?;
    let parts = absent.flat_map(|of| of.setup.parts.iter().map(|part| (&of.setup.scene, part)));
    let n_stranger_parts = parts.collect::<BTreeSet<_>>().len();
    Ok(Certified { odds: PresenceOdds { present, ..odds }, cost_bits: cost / std::f64::consts::LN_2, n_stranger_parts })
}

/// Refuses evaluations that do not go together.
fn check(evaluations: &[Episodes], judged: bool) -> Result<()> {
    let Some(first) = evaluations.first() else {
        return Err(Error::invalid("episodes", "evaluations with --absent and without", "none"));
    };
    let of = |episodes: &Episodes| {
        let setup = &episodes.setup;
        (setup.side, setup.model.sha256.clone(), setup.verifier_sha256.clone(), judged.then_some(setup.views))
    };
    if let Some(other) = evaluations.iter().find(|episodes| of(episodes) != of(first)) {
        let expected = "evaluations of one side, one model, one verifier and, with maps, one kind of bank";
        return Err(Error::invalid("episodes", expected, format!("{:?} and {:?}", of(first), of(other))));
    }
    Ok(())
}

/// What was felt in each episode of the first way of inferring.
fn courses(of: &Episodes, judged: bool) -> Vec<Course> {
    let Some(run) = of.runs.first() else { return Vec::new() };
    let stop_probability = run.config.settings.stop_probability;
    let felt = |scored: &Scored| {
        let verified = if judged { Some(scored.verified?) } else { None };
        Some((Felt { fit: scored.fit?, n_fitted: scored.n_fitted, verified }, scored.probability > stop_probability))
    };
    let course = |outcome: &crate::evaluate::Outcome| Course {
        felt: outcome.scored.iter().filter_map(felt).collect(),
        is_there: !of.setup.absent,
    };
    run.outcomes.iter().map(course).collect()
}

/// What a verifier says of a touch of a part that is there, nats: the mean of the first touches after which episodes would name it.
fn usual(courses: &[Course]) -> f64 {
    let of_touch = |course: &Course| {
        let (felt, _) = course.felt.iter().find(|(_, is_named)| *is_named)?;
        felt.verified.map(|Verified { log_odds, n_new, .. }| log_odds / n_new.max(1.0))
    };
    let touches: Vec<f64> = courses.iter().filter(|course| course.is_there).filter_map(of_touch).collect();
    touches.iter().sum::<f64>() / touches.len().max(1) as f64
}

/// The highest log-odds of the touches after which an episode names a part.
fn highest(odds: &PresenceOdds, course: &Course) -> Option<f64> {
    course.felt.iter().filter(|(_, is_named)| *is_named).map(|(felt, _)| odds.log_odds(felt)).reduce(f64::max)
}

/// The lowest log-odds of the touches before an episode names its part with confidence.
fn lowest(odds: &PresenceOdds, course: &Course, false_accept: f64) -> Option<f64> {
    let before = course.felt.iter().map(|(felt, is_named)| (odds.log_odds(felt), *is_named));
    before
        .take_while(|(log_odds, is_named)| !(*is_named && odds.strangers.share_beyond(*log_odds) <= false_accept))
        .map(|(log_odds, _)| log_odds)
        .reduce(f64::min)
}

/// The weights of least cost, and the cost, nats: the mean of both kinds' mean costs. `None` where one kind is missing or weights
/// do not exist.
fn fit(rows: &[Row]) -> Option<([f64; N], f64)> {
    let n = [false, true].map(|is_there| rows.iter().filter(|row| row.is_there == is_there).count() as f64);
    if n.contains(&0.0) {
        return None;
    }
    // What is the same in all rows has no weight of its own: no verifier.
    let is_used: [bool; N] =
        std::array::from_fn(|at| at == 0 || rows.iter().any(|row| row.values[at] != rows[0].values[at]));
    let share = |row: &Row| 0.5 / n[usize::from(row.is_there)];
    let margin = |weights: &[f64; N], row: &Row| {
        let log_odds: f64 = weights.iter().zip(&row.values).map(|(weight, value)| weight * value).sum();
        if row.is_there { log_odds } else { -log_odds }
    };
    let cost = |weights: &[f64; N]| {
        let costs = rows.iter().map(|row| share(row) * (-margin(weights, row)).exp().ln_1p().min(1e6));
        costs.sum::<f64>() + 0.5 * RIDGE * weights[1..].iter().map(|weight| weight * weight).sum::<f64>()
    };
    let mut weights = [0.0; N];
    let mut current = cost(&weights);
    for _ in 0..MAX_STEPS {
        let (mut slope, mut curvature) = ([0.0; N], [[0.0; N]; N]);
        for row in rows {
            let wrong = (1.0 + margin(&weights, row).exp()).recip();
            let pull = share(row) * wrong * if row.is_there { 1.0 } else { -1.0 };
            for i in (0..N).filter(|i| is_used[*i]) {
                slope[i] += pull * row.values[i];
                for j in (0..N).filter(|j| is_used[*j]) {
                    curvature[i][j] += share(row) * wrong * (1.0 - wrong) * row.values[i] * row.values[j];
                }
            }
        }
        for at in 0..N {
            let ridge = if at == 0 { 0.0 } else { RIDGE };
            slope[at] -= ridge * weights[at];
            curvature[at][at] += if is_used[at] { ridge + 1e-12 } else { 1.0 };
        }
        let step = solve(curvature, slope)?;
        // Halved until it costs less: far from the minimum a whole step may go beyond it.
        let at = |times: f64| -> [f64; N] { std::array::from_fn(|i| weights[i] + times * step[i]) };
        let found = (0..40).map(|halvings| at(0.5_f64.powi(halvings))).find(|next| cost(next) < current);
        let Some(next) = found else { break };
        let gained = current - cost(&next);
        (weights, current) = (next, current - gained);
        if gained < 1e-13 {
            break;
        }
    }
    weights.iter().all(|weight| weight.is_finite()).then_some((weights, current))
}

/// `x` of `m x = b` for a positive definite `m`, by elimination; `None` for another.
fn solve(mut m: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for at in 0..N {
        if m[at][at] <= 0.0 || !m[at][at].is_finite() {
            return None;
        }
        for row in at + 1..N {
            let times = m[row][at] / m[at][at];
            (at..N).for_each(|column| m[row][column] -= times * m[at][column]);
            b[row] -= times * b[at];
        }
    }
    let mut x = [0.0; N];
    for at in (0..N).rev() {
        let rest: f64 = (at + 1..N).map(|column| m[at][column] * x[column]).sum();
        x[at] = (b[at] - rest) / m[at][at];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Two values of each touch, spread as a normal distribution about opposite means: the log-odds are known in closed form.
    fn rows(n: usize) -> Vec<Row> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let row = |is_there: bool, [a, b]: [f64; 2]| {
            let sign = if is_there { 1.0 } else { -1.0 };
            Row { values: [1.0, 0.4 * sign + 0.25 + a, 0.0, 0.6 * sign + 2.0 * b, 0.0], is_there }
        };
        // Three times as many of one kind: what is asked is even odds.
        (0..n).map(|i| row(i % 4 == 0, [normal(), normal()])).collect()
    }

    #[test]
    fn the_weights_are_the_log_odds_that_made_the_touches() {
        // 2 m / s^2 each: 0.8, and 2 * 0.6 / 4; the offset takes off what both have in common.
        let (weights, cost) = fit(&rows(40_000)).unwrap();
        for (found, expected) in weights.iter().zip([-0.2, 0.8, 0.0, 0.3, 0.0]) {
            assert!((found - expected).abs() < 0.03, "{weights:?}");
        }
        assert!(cost < std::f64::consts::LN_2 && cost > 0.5, "{cost}");
        // Nowhere near does another cost less.
        let mean = |weights: [f64; N]| {
            let rows = rows(40_000);
            let of = |is_there: bool| {
                let costs = rows.iter().filter(|row| row.is_there == is_there).map(|row| {
                    let log_odds: f64 = (0..N).map(|at| weights[at] * row.values[at]).sum();
                    (1.0 + (if is_there { -log_odds } else { log_odds }).exp()).ln()
                });
                let costs: Vec<f64> = costs.collect();
                costs.iter().sum::<f64>() / costs.len() as f64
            };
            0.5 * (of(true) + of(false))
        };
        assert!((mean(weights) - cost).abs() < 1e-3);
        for at in [0, 1, 3] {
            for step in [-0.05, 0.05] {
                let mut moved = weights;
                moved[at] += step;
                assert!(mean(moved) > mean(weights), "{at}");
            }
        }
    }

    #[test]
    fn kinds_that_differ_wholly_have_finite_weights_and_one_kind_none() {
        let row = |is_there: bool| Row { values: [1.0, if is_there { 3.0 } else { -3.0 }, 2.0, 0.0, 0.0], is_there };
        let (weights, cost) = fit(&[row(true), row(false), row(true)]).unwrap();
        assert!(weights.iter().all(|weight| weight.abs() < 50.0) && cost < 0.05 && weights[1] > 0.5, "{weights:?}");
        assert!(fit(&[row(true), row(true)]).is_none());
    }

    #[test]
    fn equations_are_solved() {
        let b = [1.0, -2.0, 0.5, 3.0, -0.25];
        // Heavy on the diagonal, and symmetric.
        let entry = |i: usize, j: usize| if i == j { 2.0 + i as f64 } else { 0.2 / (1 + i.max(j) - i.min(j)) as f64 };
        let m: [[f64; N]; N] = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
        let x = solve(m, b).unwrap();
        for (row, expected) in m.iter().zip(b) {
            let found: f64 = row.iter().zip(&x).map(|(a, b)| a * b).sum();
            assert!((found - expected).abs() < 1e-12);
        }
        assert_eq!(solve([[0.0; N]; N], [1.0; N]), None);
    }
}

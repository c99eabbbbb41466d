//! Fits the log-odds that a named part is there to episodes with parts that are and with strangers.
//!
//! In: evaluations with `--absent` and without. Out: [`PresenceOdds`]. The weights are those by which the named part is told from
//! a stranger at least cost, a stranger as likely as a part, over the touches after which an episode would name it (logistic
//! regression; Brümmer and du Preez, Application-independent evaluation of speaker detection, 2006). The tails are those of the
//! highest log-odds of an episode with a stranger, and of the lowest of one with a part that is there, until it is named. Strangers of
//! a kind are of one scene, whichever of its parts were taken: a rate that all kinds keep together may be broken by one of them, so
//! that the tail is that of the hardest kind.

use std::collections::{BTreeMap, BTreeSet};

use tactile_data::dataset::touch::Side;
use tactile_infer::bank::views::Views;
use tactile_infer::calibration::minimum::minimum;
use tactile_infer::calibration::presence::{
    Felt, N_WEIGHTS, PresenceOdds, Shared, Tail, Verified, against_both, left, misfit_nats,
};

use crate::episodes::Episodes;
use crate::error::{Error, Result};
use crate::evaluate::Scored;

/// Fewer episodes tell no rate of one in a hundred.
const FEWEST: usize = 100;

/// Steps of the search; some fifty are usually enough.
const MAX_STEPS: u64 = 500;

/// What keeps weights finite where both kinds can be told apart wholly, nats a squared weight.
const RIDGE: f64 = 1e-4;

/// Where the search for strangers that share what was felt begins a second time: their offset, and the logarithm of how fast it grows.
const SHARED: [f64; 2] = [0.5, 1.5];

/// Which of the weights is of the number of touches.
const BY_TOUCH: usize = 2;

/// Weights, and what a stranger that shares what was felt is told by: its offset, and the logarithm of how fast it grows.
const N: usize = N_WEIGHTS + 2;

/// What was fitted, and how well it tells parts from strangers.
#[derive(Clone, Debug, PartialEq)]
pub struct Certified {
    /// The log-odds.
    pub odds: PresenceOdds,
    /// What they cost, bits a touch after which a part would be named; 1 is what knowing nothing costs (C_llr).
    pub cost_bits: f64,
    /// The hardest kind of stranger, by its scene; `None` where no kind has enough episodes: the tail is that of all.
    pub hardest: Option<String>,
    /// Strangers of that kind that differ: parts of different names or scenes.
    pub n_stranger_parts: usize,
}

/// A touch after which an episode would name its part.
struct Row {
    values: [f64; N_WEIGHTS],
    /// The share of the outline that was felt, where a verifier knows it.
    felt_share: Option<f64>,
    is_there: bool,
}

/// An episode's touches: what was felt, and whether it would name its part.
struct Course<'a> {
    felt: Vec<(Felt, bool)>,
    is_there: bool,
    kind: &'a str,
}

/// The kind of part: its scene, without which of its parts were taken.
fn kind_of(episodes: &Episodes) -> &str {
    let scene = &episodes.setup.scene;
    scene.split_once('#').map_or(scene, |(kind, _)| kind)
}

/// The log-odds by which evaluations tell strangers from parts that are there, with what a verifier says of them if `judged`.
/// `false_accept`: the rate at which parts are named.
///
/// # Errors
/// Fewer than a hundred episodes of either kind, evaluations of different sides, models or verifiers, and episodes that tell
/// nothing.
pub fn certify(evaluations: &[Episodes], judged: bool, false_accept: f64) -> Result<Certified> {
    check(evaluations, judged)?;
    let courses: Vec<Course<'_>> = evaluations.iter().flat_map(|of| courses(of, judged)).collect();
    let [n_strangers, n_present] =
        [false, true].map(|is| courses.iter().filter(|course| course.is_there == is).count());
    if n_strangers.min(n_present) < FEWEST {
        let expected = format!("{FEWEST} or more with strangers (--absent), and as many without");
        return Err(Error::invalid("episodes", expected, format!("{n_strangers} and {n_present}")));
    }
    let [usual, usual_misfit] = usual(&courses);
    let rows = courses.iter().flat_map(|course| {
        let named = course.felt.iter().filter(|(_, is_named)| *is_named);
        named.map(|(felt, _)| Row {
            values: felt.values([usual, usual_misfit]),
            felt_share: felt.verified.map(|verified| verified.felt_share()),
            is_there: course.is_there,
        })
    });
    let rows: Vec<Row> = rows.collect();
    let told = || Error::invalid("episodes", "strangers and parts that are named, and differ", "others");
    let setup = &evaluations[0].setup;
    let (numbers, cost) =
        fit(&rows, |number| !judged || is_weighed(setup.side, setup.views, number)).ok_or_else(told)?;
    let [offset, by_fit, by_touch, by_verifier, by_expected, by_size, by_strain, by_misfit, ..] = numbers;
    let absent = evaluations.iter().filter(|of| of.setup.absent);
    let n_parts: Vec<f64> = absent.clone().map(|of| of.setup.parts.len() as f64 - 1.0).collect();
    let none = Tail { at: 0.0, scale: 1.0 };
    let odds = PresenceOdds {
        offset,
        by_fit,
        by_touch,
        by_verifier,
        by_expected,
        by_size,
        by_strain,
        by_misfit,
        shared: judged.then(|| shared(&numbers)),
        usual,
        usual_misfit,
        strangers: none,
        present: none,
        n_parts: n_parts.iter().sum::<f64>() / n_parts.len() as f64,
        n_strangers,
        n_present,
    };
    let (hardest, strangers) = hardest(&odds, &courses, false_accept).ok_or_else(told)?;
    let odds = PresenceOdds { strangers, ..odds };
    let of_present =
        courses.iter().filter(|course| course.is_there).filter_map(|course| lowest(&odds, course, false_accept));
    let present = Tail::of(of_present.map(|value| -value).collect(), n_present).ok_or_else(told)?;
    let of_kind = absent.filter(|of| hardest.is_none_or(|kind| kind_of(of) == kind));
    let parts = of_kind.flat_map(|of| of.setup.parts.iter().map(|part| (&of.setup.scene, part)));
    let n_stranger_parts = parts.collect::<BTreeSet<_>>().len();
    let (odds, cost_bits) = (PresenceOdds { present, ..odds }, cost / std::f64::consts::LN_2);
    Ok(Certified { odds, cost_bits, hardest: hardest.map(str::to_owned), n_stranger_parts })
}

/// Whether touches are judged by maps with a weight of this number; cross-validated by bank. Of holes on maps of pegs a verifier says little
/// for some parts, and ten touches that say nothing would make them sure.
fn is_weighed(touched: Side, views: Views, number: usize) -> bool {
    number != BY_TOUCH || !touched.is_hole() || !views.is_pegs()
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
fn courses(of: &Episodes, judged: bool) -> Vec<Course<'_>> {
    let Some(run) = of.runs.first() else { return Vec::new() };
    let stop_probability = run.config.settings.stop_probability;
    let felt = |scored: &Scored| {
        let verified = if judged { Some(scored.verified?) } else { None };
        Some((Felt { fit: scored.fit?, n_fitted: scored.n_fitted, verified }, scored.probability > stop_probability))
    };
    let course = |outcome: &crate::evaluate::Outcome| Course {
        felt: outcome.scored.iter().filter_map(felt).collect(),
        is_there: !of.setup.absent,
        kind: kind_of(of),
    };
    run.outcomes.iter().map(course).collect()
}

/// What a verifier says of a touch of a part that is there, and how far its maps are off, nats: the means of the first touches after which
/// episodes would name it.
fn usual(courses: &[Course<'_>]) -> [f64; 2] {
    let first = |course: &Course<'_>| course.felt.iter().find(|(_, is_named)| *is_named)?.0.verified;
    let first: Vec<Verified> = courses.iter().filter(|course| course.is_there).filter_map(first).collect();
    let said = first.iter().map(|Verified { log_odds, n_new, .. }| log_odds / n_new.max(1.0));
    let misfits: Vec<f64> = first.iter().filter_map(|verified| verified.misfit).map(misfit_nats).collect();
    let mean = |sum: f64, n: usize| sum / n.max(1) as f64;
    [mean(said.sum(), first.len()), mean(misfits.iter().sum(), misfits.len())]
}

/// The highest log-odds of the touches after which an episode names a part.
fn highest(odds: &PresenceOdds, course: &Course<'_>) -> Option<f64> {
    course.felt.iter().filter(|(_, is_named)| *is_named).map(|(felt, _)| odds.log_odds(felt)).reduce(f64::max)
}

/// The kind of strangers of which so large a share comes highest, and its tail; that of all where no kind has enough episodes.
fn hardest<'a>(odds: &PresenceOdds, courses: &[Course<'a>], share: f64) -> Option<(Option<&'a str>, Tail)> {
    let mut kinds: BTreeMap<&str, (usize, Vec<f64>)> = BTreeMap::new();
    for course in courses.iter().filter(|course| !course.is_there) {
        let (n, highests) = kinds.entry(course.kind).or_default();
        *n += 1;
        highests.extend(highest(odds, course));
    }
    let tail = |(kind, (n, highests)): (&&'a str, &(usize, Vec<f64>))| {
        Tail::of(highests.clone(), *n).filter(|_| *n >= FEWEST).map(|tail| (Some(*kind), tail))
    };
    let of_kinds = kinds.iter().filter_map(tail);
    let hardest = of_kinds.max_by(|(_, a), (_, b)| a.reached_by(share).total_cmp(&b.reached_by(share)));
    hardest.or_else(|| {
        let n = kinds.values().map(|(n, _)| n).sum();
        Some((None, Tail::of(kinds.into_values().flat_map(|(_, highests)| highests).collect(), n)?))
    })
}

/// The lowest log-odds of the touches before an episode names its part with confidence.
fn lowest(odds: &PresenceOdds, course: &Course<'_>, false_accept: f64) -> Option<f64> {
    let before = course.felt.iter().map(|(felt, is_named)| (odds.log_odds(felt), *is_named));
    before
        .take_while(|(log_odds, is_named)| !(*is_named && odds.strangers.share_beyond(*log_odds) <= false_accept))
        .map(|(log_odds, _)| log_odds)
        .reduce(f64::min)
}

/// What a stranger that shares what was felt is told by.
fn shared(numbers: &[f64; N]) -> Shared {
    Shared { offset: numbers[N_WEIGHTS], by_felt: numbers[N_WEIGHTS + 1].exp() }
}

/// The touches of both kinds, and which of the numbers they can tell.
struct Cost<'a> {
    rows: &'a [Row],
    /// How much a row of each kind counts: half in all.
    shares: [f64; 2],
    is_used: [bool; N],
}

impl Cost<'_> {
    /// What numbers cost, nats: the mean of both kinds' mean costs; and its slopes.
    fn of(&self, numbers: &[f64]) -> (f64, [f64; N]) {
        let mut numbers: [f64; N] = std::array::from_fn(|at| numbers[at]);
        (0..N).filter(|at| !self.is_used[*at]).for_each(|at| numbers[at] = 0.0);
        let ridge = &numbers[1..N_WEIGHTS];
        let mut cost = 0.5 * RIDGE * ridge.iter().map(|weight| weight * weight).sum::<f64>();
        let mut slopes = [0.0; N];
        (1..N_WEIGHTS).for_each(|at| slopes[at] = RIDGE * numbers[at]);
        for row in self.rows {
            let of_any: f64 = numbers.iter().zip(&row.values).map(|(weight, value)| weight * value).sum();
            let against = row.felt_share.map(|felt| {
                let shared = shared(&numbers);
                (shared.log_odds(felt), shared.by_felt * left(felt))
            });
            // How much of the doubt is about a stranger that differs all over.
            let (log_odds, any) = match against {
                Some((shared, _)) => (against_both(of_any, shared), (1.0 + (of_any - shared).exp()).recip()),
                None => (of_any, 1.0),
            };
            let sign = if row.is_there { 1.0 } else { -1.0 };
            let share = self.shares[usize::from(row.is_there)];
            cost += share * (-sign * log_odds).exp().ln_1p().min(1e6);
            let pull = -share * sign / (1.0 + (sign * log_odds).exp());
            (0..N_WEIGHTS).for_each(|at| slopes[at] += pull * any * row.values[at]);
            if let Some((_, by_felt)) = against {
                slopes[N_WEIGHTS] += pull * (1.0 - any);
                slopes[N_WEIGHTS + 1] += pull * (1.0 - any) * by_felt;
            }
        }
        (0..N).filter(|at| !self.is_used[*at]).for_each(|at| slopes[at] = 0.0);
        (cost, slopes)
    }
}

/// The numbers of least cost (L-BFGS), and the cost, nats. `is_weighed`: which weights there are. `None` where one kind is missing or such
/// numbers do not exist.
fn fit(rows: &[Row], is_weighed: impl Fn(usize) -> bool) -> Option<([f64; N], f64)> {
    let n = [false, true].map(|is_there| rows.iter().filter(|row| row.is_there == is_there).count() as f64);
    if n.contains(&0.0) {
        return None;
    }
    // What is the same in all rows has no weight of its own: no verifier.
    let is_used = std::array::from_fn(|at| match at {
        0 => true,
        at if at < N_WEIGHTS => is_weighed(at) && rows.iter().any(|row| row.values[at] != rows[0].values[at]),
        _ => rows.iter().any(|row| row.felt_share.is_some()),
    });
    let cost = Cost { rows, shares: n.map(|n| 0.5 / n), is_used };
    let at = |numbers: &[f64]| {
        let (cost, slopes) = cost.of(numbers);
        (cost, slopes.to_vec())
    };
    let from = |start: [f64; N]| {
        let (found, least) = minimum(start.to_vec(), MAX_STEPS, at).ok()?;
        let found: [f64; N] = found.try_into().ok()?;
        found.iter().all(|number| number.is_finite()).then_some((found, least))
    };
    let found = from([0.0; N])?;
    // The search may have lost the strangers that share what was felt: far off, nothing leads back to them.
    let mut again = found.0;
    again[N_WEIGHTS..].copy_from_slice(&SHARED);
    Some(from(again).filter(|other| other.1 < found.1).unwrap_or(found))
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
            Row {
                values: [1.0, 0.4 * sign + 0.25 + a, 0.0, 0.6 * sign + 2.0 * b, 0.0, 0.0, 0.0, 0.0],
                felt_share: None,
                is_there,
            }
        };
        // Three times as many of one kind: what is asked is even odds.
        (0..n).map(|i| row(i % 4 == 0, [normal(), normal()])).collect()
    }

    #[test]
    fn the_weights_are_the_log_odds_that_made_the_touches() {
        // 2 m / s^2 each: 0.8, and 2 * 0.6 / 4; the offset takes off what both have in common.
        let (weights, cost) = fit(&rows(40_000), |_| true).unwrap();
        for (found, expected) in weights.iter().zip([-0.2, 0.8, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0]) {
            assert!((found - expected).abs() < 0.03, "{weights:?}");
        }
        assert!(cost < std::f64::consts::LN_2 && cost > 0.5, "{cost}");
        // Nowhere near does another cost less.
        let mean = |weights: [f64; N]| {
            let rows = rows(40_000);
            let of = |is_there: bool| {
                let costs = rows.iter().filter(|row| row.is_there == is_there).map(|row| {
                    let log_odds: f64 = (0..N_WEIGHTS).map(|at| weights[at] * row.values[at]).sum();
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
    fn a_rate_is_kept_for_the_hardest_kind_of_stranger() {
        let none = Tail { at: 0.0, scale: 1.0 };
        let odds = PresenceOdds {
            offset: 0.0,
            by_fit: 1.0,
            by_touch: 0.0,
            by_verifier: 0.0,
            by_expected: 0.0,
            by_size: 0.0,
            by_strain: 0.0,
            by_misfit: 0.0,
            shared: None,
            usual: 0.0,
            usual_misfit: 0.0,
            strangers: none,
            present: none,
            n_parts: 11.0,
            n_strangers: 0,
            n_present: 0,
        };
        // The log-odds of one touch is its fit.
        let course = |kind: &'static str, fit: f64| Course {
            felt: vec![
                (Felt { fit, n_fitted: 1, verified: None }, true),
                (Felt { fit: 9.0, n_fitted: 1, verified: None }, false),
            ],
            is_there: false,
            kind,
        };
        let of = |n: usize| -> Vec<Course<'static>> {
            let fit = |at: usize| 3.0 * at as f64 / n as f64;
            (0..n)
                .flat_map(|at| {
                    [course("alike", fit(at)), course("cut", 1.0 + fit(at)), course("few", 50.0 + fit(at))]
                        .into_iter()
                        .take(if at < 20 { 3 } else { 2 })
                })
                .collect()
        };
        // Twenty are too few for a kind of their own.
        let (kind, tail) = hardest(&odds, &of(200), 0.01).unwrap();
        assert_eq!(kind, Some("cut"));
        // A tenth lies beyond 1 + 2.7, by half of 0.3 on average.
        assert!((tail.at - 3.7).abs() < 0.03 && (tail.scale - 0.15).abs() < 0.02, "{tail:?}");
        assert!((tail.share_beyond(tail.reached_by(0.01)) - 0.01).abs() < 1e-12);
        let (kind, tail) = hardest(&odds, &of(60), 0.01).unwrap();
        assert!(kind.is_none() && tail.at > 3.9, "{tail:?}");
    }

    #[test]
    fn each_map_has_the_weights_that_it_says() {
        let weighed = |side, views| (0..N).filter(|at| is_weighed(side, views, *at)).collect::<Vec<_>>();
        assert_eq!(weighed(Side::Hole, Views::Pegs), [0, 1, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(weighed(Side::Hole, Views::Both), (0..N).collect::<Vec<_>>());
        assert_eq!(weighed(Side::Peg, Views::Pegs), (0..N).collect::<Vec<_>>());
        // Parts that are there were touched more often: a weight, unless touches are not counted.
        let rows: Vec<Row> = rows(4_000)
            .into_iter()
            .map(|mut row| {
                row.values[BY_TOUCH] = if row.is_there { 4.0 } else { 2.0 } + row.values[1].fract();
                row
            })
            .collect();
        let [counted, not] = [true, false].map(|is| fit(&rows, |at| is || at != BY_TOUCH).unwrap());
        assert!(counted.0[BY_TOUCH] > 1.0 && not.0[BY_TOUCH] == 0.0 && counted.1 < not.1, "{counted:?} {not:?}");
    }

    #[test]
    fn kinds_that_differ_wholly_have_finite_weights_and_one_kind_none() {
        let row = |is_there: bool| {
            let values = [1.0, if is_there { 3.0 } else { -3.0 }, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            Row { values, felt_share: None, is_there }
        };
        let (weights, cost) = fit(&[row(true), row(false), row(true)], |_| true).unwrap();
        assert!(weights.iter().all(|weight| weight.abs() < 50.0) && cost < 0.05 && weights[1] > 0.5, "{weights:?}");
        assert!(fit(&[row(true), row(true)], |_| true).is_none());
    }

    /// Strangers of two kinds: one half differs all over, the other only where the outline was not felt.
    #[test]
    fn a_stranger_that_shares_what_was_felt_is_told_by_the_rest_alone() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut rows = Vec::new();
        for i in 0..60_000 {
            let (is_there, felt) = (i % 2 == 0, rng.random::<f64>());
            // What is shared is anything from none of the outline to all of it, each as likely.
            let looks_alike = is_there || i % 4 == 1 && felt < rng.random::<f64>();
            let mean = if looks_alike { 3.0 } else { -3.0 };
            let normal = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            let values = [1.0, mean + 1.5 * normal, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            rows.push(Row { values, felt_share: Some(felt), is_there });
        }
        let (numbers, _) = fit(&rows, |_| true).unwrap();
        let odds =
            |value: f64, felt: f64| against_both(numbers[0] + numbers[1] * value, shared(&numbers).log_odds(felt));
        // A touch that is wholly like the part: one of (1 - c) / 2 strangers is, too.
        for felt in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let expected = -f64::ln(0.5 * (1.0 - felt));
            assert!((odds(6.0, felt) - expected).abs() < 0.25, "{felt}: {} {expected}", odds(6.0, felt));
        }
        // One that is unlike it: 2 * 3 / 1.5^2 a unit, and what half of the strangers that could be alike are fewer.
        assert!((odds(-2.0, 0.5) - odds(-3.0, 0.5) - 2.67).abs() < 0.3, "{numbers:?}");
    }

    #[test]
    fn slopes_are_those_of_the_cost() {
        let rows = rows(50).into_iter().enumerate();
        let rows: Vec<Row> =
            rows.map(|(at, row)| Row { felt_share: (at % 3 > 0).then_some(0.02 * at as f64), ..row }).collect();
        let cost = Cost { rows: &rows, shares: [0.01, 0.02], is_used: [true; N] };
        let at: [f64; N] = std::array::from_fn(|at| 0.3 - 0.1 * at as f64);
        let (_, slopes) = cost.of(&at);
        for (number, slope) in slopes.iter().enumerate() {
            let moved = |step: f64| {
                cost.of(&std::array::from_fn::<f64, N, _>(|i| at[i] + if i == number { step } else { 0.0 })).0
            };
            assert!(((moved(1e-5) - moved(-1e-5)) / 2e-5 - slope).abs() < 1e-8, "{number}");
        }
    }
}

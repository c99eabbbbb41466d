//! Episodes to figures: accuracy with its interval, errors, stopping, latency.

use serde::{Deserialize, Serialize};

use crate::evaluate::{Outcome, Scored, StageTimes};
use crate::origins::Origins;
use crate::result::{
    Choice, Comparison, Inference, Latency, Method, PartFigures, Poses, Quantiles, ReliabilityBin, Row, Stops,
    StrangerFigures,
};
use crate::statistics::bootstrap::clustered_95;
use crate::statistics::mcnemar::Paired;
use crate::statistics::share::{grouped_95, wilson_of};
use crate::statistics::{Z_95, quantile};
use tactile_filter::budget::{Halves, Speeds};
use tactile_filter::{EpisodeConfig, StopReason};

/// What a row is about.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Label {
    /// How the part was named.
    pub method: Method,
    /// How the belief was kept.
    pub inference: Inference,
    /// How touches were chosen.
    pub action: Choice,
    /// Where the true poses were.
    pub poses: Poses,
}

/// One row for each number of touches.
pub fn rows(label: Label, outcomes: &[Outcome]) -> Vec<Row> {
    let n_touches = outcomes.iter().map(|outcome| outcome.scored.len()).min().unwrap_or(0);
    let origins = Origins::of(outcomes);
    let after = |n: usize| -> Vec<Scored> { outcomes.iter().map(|outcome| outcome.scored[n]).collect() };
    let against_one_less = |n: usize| {
        let pairs = outcomes.iter().map(|outcome| (outcome.scored[n].right, outcome.scored[n - 1].right));
        (n > 0).then(|| Paired::of(pairs))
    };
    let with_step = |n| Row { against_one_less: against_one_less(n), ..row(label, n + 1, &after(n), &origins) };
    (0..n_touches).map(with_step).collect()
}

/// The figures of one number of touches, of episodes of some origins. Pose errors are those of the episodes that name the right part.
pub fn row(label: Label, n_touches: usize, scored: &[Scored], origins: &Origins) -> Row {
    let right: Vec<&Scored> = scored.iter().filter(|s| s.right).collect();
    let n = scored.len().max(1) as f64;
    let n_right = right.len().max(1) as f64;
    let mean = |of: fn(&Scored) -> f64| right.iter().map(|s| of(s)).sum::<f64>() / n_right;
    let median = |of: fn(&Scored) -> f64| quantile(right.iter().map(|s| of(s)).collect(), 0.5);
    let errors: Vec<f64> = right.iter().filter_map(|s| s.normalised_error).collect();
    let share_of_poses = |of: &dyn Fn(f64) -> f64| {
        (!errors.is_empty()).then(|| errors.iter().map(|error| of(*error)).sum::<f64>() / errors.len() as f64)
    };
    let accuracy = right.len() as f64 / n;
    // Of one touch, a view that is seen twice says little more than once; later touches go different ways.
    let n_views = origins.distinct_first_views().filter(|n_views| n_touches == 1 && *n_views < scored.len());
    let (calibration_error, calibration_error_ci95) = calibration_of(scored, origins);
    let accuracy_ci95 = wilson_of(accuracy, n_views.unwrap_or(scored.len()) as f64);
    Row {
        method: label.method,
        inference: label.inference,
        action: label.action,
        poses: label.poses,
        n_touches,
        accuracy,
        accuracy_ci95,
        accuracy_ci95_clustered: by_parts(scored, origins, accuracy_ci95),
        against_one_less: None,
        exact_cell: scored.iter().filter(|s| s.exact_cell).count() as f64 / n,
        xy_mm_mean: mean(|s| s.xy_mm),
        theta_deg_mean: mean(|s| s.theta_deg),
        brier: scored.iter().map(|s| s.brier).sum::<f64>() / n,
        xy_mm_median: Some(median(|s| s.xy_mm)),
        theta_deg_median: Some(median(|s| s.theta_deg)),
        n_correct: Some(right.len()),
        calibration_error: Some(calibration_error),
        calibration_error_ci95,
        normalised_pose_error: share_of_poses(&|error| error),
        within_ellipsoid: share_of_poses(&|error| f64::from(u8::from(error <= WITHIN_95))),
    }
}

/// The 95th percentile of chi-square with three degrees of freedom.
const WITHIN_95: f64 = 7.814_727_903;

/// The interval of accuracy over parts, at least as wide as that over episodes.
fn by_parts(scored: &[Scored], origins: &Origins, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    let sums = origins.sums_by_part(scored, |s| [f64::from(u8::from(s.right)), 1.0]);
    let [low_of_parts, high_of_parts] = clustered_95(&sums, |[n_right, n]| n_right / n)?;
    Some([low.min(low_of_parts.max(0.0)), high.max(high_of_parts.min(1.0))])
}

/// Tenths of a probability.
const N_BINS: usize = 10;

/// Probability less right answers in each tenth, and the answers, of one touch each.
fn calibration_sums(s: &Scored) -> [f64; N_BINS + 1] {
    let mut sums = [0.0; N_BINS + 1];
    let bin = ((s.probability * N_BINS as f64) as usize).min(N_BINS - 1);
    sums[bin] = s.probability.min(1.0) - f64::from(u8::from(s.right));
    sums[N_BINS] = 1.0;
    sums
}

/// The expected calibration error over tenths of the probability (Naeini et al. 2015).
fn calibration_error(sums: &[f64; N_BINS + 1]) -> f64 {
    sums[..N_BINS].iter().map(|excess| excess.abs()).sum::<f64>() / sums[N_BINS].max(1.0)
}

/// The same of some touches, with its interval over parts.
fn calibration_of(scored: &[Scored], origins: &Origins) -> (f64, Option<[f64; 2]>) {
    let add = |total: [f64; N_BINS + 1], s: &Scored| {
        let of_one = calibration_sums(s);
        std::array::from_fn(|bin| total[bin] + of_one[bin])
    };
    let error = calibration_error(&scored.iter().fold([0.0; N_BINS + 1], add));
    let by_parts = clustered_95(&origins.sums_by_part(scored, calibration_sums), calibration_error);
    (error, by_parts.map(|[low, high]| [low.min(2.0 * error - high).max(0.0), high.clamp(error, 1.0)]))
}

/// The touch, from 0, at which an episode would have stopped by the rule of `config`, and why; `None` where never.
fn stopped(outcome: &Outcome, config: &EpisodeConfig) -> Option<(usize, StopReason)> {
    let reason = |(at, s): (usize, &Scored)| Some((at, config.stop(&s.standing(at + 1))?));
    outcome.scored.iter().enumerate().find_map(reason)
}

/// After each number of touches the episodes of each half that name the right part, those that the rule of `config` would have
/// ended as confident by then, and what all spent until it ended them. Of several parts every second one to come is of the
/// other half, of a single part every second episode.
pub fn halves(outcomes: &[Outcome], config: &EpisodeConfig) -> Vec<Halves> {
    let n_touches = outcomes.iter().map(|outcome| outcome.scored.len()).min().unwrap_or(0);
    let mut all = vec![Halves::default(); n_touches];
    let mut parts: Vec<usize> = Vec::new();
    for Outcome { part, .. } in outcomes {
        if !parts.contains(part) {
            parts.push(*part);
        }
    }
    for (index, outcome) in outcomes.iter().enumerate() {
        let place = parts.iter().position(|part| *part == outcome.part).filter(|_| parts.len() > 1);
        let chooses = place.unwrap_or(index) % 2 == 0;
        let stopped = stopped(outcome, config);
        let decided = match stopped {
            Some((at, StopReason::Confident)) => Some((at, outcome.scored[at].right)),
            _ => None,
        };
        for (n, (halves, scored)) in all.iter_mut().zip(&outcome.scored).enumerate() {
            let half = if chooses { &mut halves.choosing } else { &mut halves.promising };
            let decided = decided.filter(|(at, _)| *at <= n);
            half.n_episodes += 1;
            half.n_right += usize::from(scored.right);
            half.n_decided += usize::from(decided.is_some());
            half.n_decided_and_right += usize::from(decided.is_some_and(|(_, right)| right));
            let n_touches = stopped.map_or(n, |(at, _)| at.min(n)) + 1;
            half.touches += n_touches;
            half.travel_mm += outcome.travel_mm[..n_touches.min(outcome.travel_mm.len())].last().unwrap_or(&0.0);
        }
    }
    all
}

/// Where each episode would have stopped by the rule of `config`, or at its last touch. The share of
/// confident stops that name the wrong part is of those stops, not of all episodes.
pub fn stops(label: Label, outcomes: &[Outcome], config: &EpisodeConfig, speeds: &Speeds) -> Stops {
    let (mut touches, mut to_95, mut confident, mut wrong, mut none) = (0, 0, 0.0_f64, 0.0, 0.0);
    let mut seconds = Some(0.0);
    for outcome in outcomes {
        let stop = stopped(outcome, config);
        let n_touches = stop.map_or(outcome.scored.len(), |(at, _)| at + 1);
        touches += n_touches;
        // Where nothing was left to touch, no way follows.
        let travel_mm = outcome.travel_mm[..n_touches.min(outcome.travel_mm.len())].last();
        seconds =
            seconds.zip(travel_mm).map(|(sum, mm)| sum + speeds.seconds(n_touches.min(outcome.travel_mm.len()), *mm));
        to_95 += outcome.scored.iter().position(|s| s.probability > 0.95).unwrap_or(outcome.scored.len()) + 1;
        match stop {
            Some((at, StopReason::Confident)) => {
                confident += 1.0;
                wrong += if outcome.scored[at].right { 0.0 } else { 1.0 };
            }
            Some((_, StopReason::NoneOfThese)) => none += 1.0,
            _ => {}
        }
    }
    let n = outcomes.len().max(1) as f64;
    Stops {
        inference: label.inference,
        action: label.action,
        mean_touches: touches as f64 / n,
        confident: confident / n,
        confident_and_wrong: wrong / confident.max(1.0),
        none_of_these: none / n,
        touches_to_95: to_95 as f64 / n,
        seconds: seconds.map(|sum| sum / n),
    }
}

/// Two rules on the same holes after each number of touches: the difference of their accuracies with the
/// normal 95 % interval of the mean of the paired differences, and McNemar's test of them.
pub fn compare(one: (Label, &[Outcome]), other: (Label, &[Outcome])) -> Vec<Comparison> {
    let n_touches = one.1.iter().chain(other.1).map(|outcome| outcome.scored.len()).min().unwrap_or(0);
    let after = |n: usize| {
        let pairs = || one.1.iter().zip(other.1).map(|(a, b)| (a.scored[n].right, b.scored[n].right));
        let right = |is_right| f64::from(u8::from(is_right));
        let differences: Vec<f64> = pairs().map(|(a, b)| right(a) - right(b)).collect();
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let half = Z_95 * (variance / count).sqrt();
        Comparison {
            inference: one.0.inference,
            action: one.0.action,
            against: other.0.action,
            n_touches: n + 1,
            difference: mean,
            ci95: [mean - half, mean + half],
            paired: Some(Paired::of(pairs())),
        }
    };
    (0..n_touches).map(after).collect()
}

/// Bounds of the ranges of probability: finer where it matters.
const RELIABILITY: [f64; 9] = [0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0];

/// How often the most probable part is right, for ranges of its probability, over all touches.
pub fn reliability(outcomes: &[Outcome]) -> Vec<ReliabilityBin> {
    let bin = |bounds: &[f64]| {
        let within = |s: &&Scored| s.probability > bounds[0] && (s.probability <= bounds[1] || bounds[1] == 1.0);
        let all = || outcomes.iter().flat_map(|outcome| &outcome.scored).filter(within);
        let (n, n_right) = (all().count(), all().filter(|s| s.right).count());
        let of_episode = |outcome: &Outcome| {
            let all = || outcome.scored.iter().filter(within);
            [all().filter(|s| s.right).count(), all().count()]
        };
        let by_episode: Vec<_> = outcomes.iter().map(of_episode).filter(|[_, n]| *n > 0).collect();
        (n > 0).then(|| ReliabilityBin {
            probability: [bounds[0], bounds[1]],
            mean_probability: all().map(|s| s.probability.min(1.0)).sum::<f64>() / n as f64,
            right: n_right as f64 / n as f64,
            right_ci95: grouped_95(&by_episode),
            n,
            n_episodes: Some(by_episode.len()),
        })
    };
    RELIABILITY.windows(2).filter_map(bin).collect()
}

/// How the holes of each part that was taken out of the bank fared where they would have stopped by the rule of `config`; parts without a
/// hole are left out.
pub fn strangers(names: &[String], outcomes: &[Outcome], config: &EpisodeConfig) -> Vec<StrangerFigures> {
    let of_part = |(part, name): (usize, &String)| {
        let of: Vec<&Outcome> = outcomes.iter().filter(|outcome| outcome.part == part).collect();
        let stop = |outcome: &&Outcome| stopped(outcome, config).map(|(at, why)| (why, outcome.scored[at].named));
        let stops: Vec<(StopReason, usize)> = of.iter().filter_map(stop).collect();
        let times = |named: usize| stops.iter().filter(|stop| **stop == (StopReason::Confident, named)).count();
        let named = names.iter().enumerate().map(|(named, name)| (name.clone(), times(named)));
        let mut named: Vec<(String, usize)> = named.filter(|(_, n)| *n > 0).collect();
        // Stable: of equals the first in the bank.
        named.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
        let n_none = stops.iter().filter(|(why, _)| *why == StopReason::NoneOfThese).count();
        (!of.is_empty()).then(|| StrangerFigures { part: name.clone(), n: of.len(), n_none, named })
    };
    names.iter().enumerate().filter_map(of_part).collect()
}

/// How the holes of each part fared after their last touch; parts without a hole are left out.
pub fn parts(names: &[String], outcomes: &[Outcome]) -> Vec<PartFigures> {
    let of_part = |(part, name): (usize, &String)| {
        let of = outcomes.iter().filter(|outcome| outcome.part == part);
        let last: Vec<&Scored> = of.filter_map(|outcome| outcome.scored.last()).collect();
        let (right, wrong): (Vec<&Scored>, Vec<&Scored>) = last.iter().partition(|s| s.right);
        let mean = |of: fn(&Scored) -> f64| right.iter().map(|s| of(s)).sum::<f64>() / right.len().max(1) as f64;
        let times = |named: usize| wrong.iter().filter(|s| s.named == named).count();
        // The first of equals.
        let most = (0..names.len()).rev().max_by_key(|named| times(*named)).filter(|named| times(*named) > 0);
        (!last.is_empty()).then(|| PartFigures {
            part: name.clone(),
            n: last.len(),
            n_right: right.len(),
            mistaken_for: most.map(|named| (names[named].clone(), times(named))),
            xy_mm_mean: mean(|s| s.xy_mm),
            theta_deg_mean: mean(|s| s.theta_deg),
        })
    };
    names.iter().enumerate().filter_map(of_part).collect()
}

/// Median and 99th percentile of each stage and of whole decisions.
pub fn latency(outcomes: &[Outcome]) -> Latency {
    let times = || outcomes.iter().flat_map(|outcome| &outcome.times);
    let stage = |of: fn(&StageTimes) -> f64| {
        let values: Vec<f64> = times().map(of).filter(|ms| *ms > 0.0).collect();
        Quantiles { p50: quantile(values.clone(), 0.5), p99: quantile(values, 0.99) }
    };
    let chosen = times().filter(|t| t.select > 0.0);
    let whole: Vec<f64> = chosen.map(StageTimes::whole).collect();
    Latency {
        encode: stage(|t| t.encode),
        update: stage(|t| t.update),
        judge: Some(stage(|t| t.judge)),
        select: stage(|t| t.select),
        decision: Some(Quantiles { p50: quantile(whole.clone(), 0.5), p99: quantile(whole, 0.99) }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use tactile_filter::Presence;

    #[test]
    fn an_episode_stops_when_it_is_sure_and_is_counted_wrong_if_it_is() {
        let presence = Some(Presence { log_odds: 9.0, stranger_rate: 0.0, present_rate: 1.0 });
        let scored = |probability, right| Scored { probability, right, presence, ..Scored::default() };
        // 20 and then 30 mm on; of the last one the second touch was the last that there was.
        let outcome = |scored| Outcome { scored, travel_mm: vec![0.0, 20.0, 50.0], ..Outcome::default() };
        let outcomes = [
            outcome(vec![scored(0.5, true), scored(0.97, true), scored(0.99, false)]),
            outcome(vec![scored(0.99, false), scored(0.2, true), scored(0.2, true)]),
            Outcome {
                travel_mm: vec![0.0, 20.0],
                ..outcome(vec![scored(0.2, true), scored(0.3, true), scored(0.95, true)])
            },
        ];
        let config = EpisodeConfig::default().changed(|settings, _, _| settings.max_touches = 3);
        let stops = stops(LABEL, &outcomes, &config, &Speeds::default());
        assert_eq!(stops.mean_touches, (2 + 1 + 3) as f64 / 3.0);
        assert_eq!((stops.confident, stops.confident_and_wrong, stops.none_of_these), (2.0 / 3.0, 0.5, 0.0));
        assert_eq!(stops.touches_to_95, (2 + 1 + 4) as f64 / 3.0);
        // Of 3 s a touch and 50 mm/s: two touches and 20 mm, one, two and 20 mm.
        assert!((stops.seconds.unwrap() - (6.4 + 3.0 + 6.4) / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_stranger_is_named_or_none_where_its_episode_stops() {
        let scored = |named: usize, stranger_rate: f64, present_rate: f64| Scored {
            named,
            probability: 0.99,
            presence: Some(Presence { log_odds: 0.0, stranger_rate, present_rate }),
            ..Scored::default()
        };
        let [unsure, none, sure] = [(0.5, 0.5), (0.5, 0.0), (0.0, 1.0)];
        let outcome = |part: usize, touches: &[(usize, (f64, f64))]| Outcome {
            part,
            scored: touches.iter().map(|(named, (stranger, present))| scored(*named, *stranger, *present)).collect(),
            ..Outcome::default()
        };
        let outcomes = [
            outcome(0, &[(1, unsure), (2, sure), (1, sure)]),
            outcome(0, &[(1, sure), (1, none)]),
            outcome(0, &[(2, sure)]),
            outcome(2, &[(1, unsure), (1, none), (1, sure)]),
            outcome(2, &[(1, unsure), (1, unsure)]),
        ];
        let names = ["A", "B", "C", "D"].map(String::from);
        let found = strangers(&names, &outcomes, &EpisodeConfig::default());
        let of = |part: &str, n, n_none, named: &[(&str, usize)]| StrangerFigures {
            part: part.into(),
            n,
            n_none,
            named: named.iter().map(|(part, n)| ((*part).into(), *n)).collect(),
        };
        assert_eq!(found, [of("A", 3, 0, &[("C", 2), ("B", 1)]), of("C", 2, 1, &[])]);
        assert_eq!(
            (found[0].n_named(), found[0].named_line().as_str(), found[1].named_line().as_str()),
            (3, "C (2), B (1)", "–")
        );
    }

    /// By another way: an episode cut after n touches, whose stops are counted as those of an evaluation.
    #[test]
    fn halves_count_what_shorter_episodes_would_come_to() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut scored = || Scored {
            right: rng.random_bool(0.7),
            probability: if rng.random_bool(0.4) { 0.99 } else { 0.5 },
            presence: Some(match rng.random_range(0..10) {
                0 | 1 => Presence { log_odds: -9.0, stranger_rate: 1.0, present_rate: 0.0 },
                2 => Presence { log_odds: 0.0, stranger_rate: 0.5, present_rate: 0.5 },
                _ => Presence { log_odds: 9.0, stranger_rate: 0.0, present_rate: 1.0 },
            }),
            ..Scored::default()
        };
        let mut outcome = || Outcome {
            scored: (0..6).map(|_| scored()).collect(),
            travel_mm: (0..6).map(|n| 7.0 * f64::from(n)).collect(),
            ..Outcome::default()
        };
        let outcomes: Vec<Outcome> = (0..101).map(|_| outcome()).collect();
        let config = EpisodeConfig::default();
        let found = halves(&outcomes, &config);
        assert_eq!(found.len(), 6);
        // Parts 7, 2 and 5 in turn: 7 and 5 choose, what 2 comes to is promised.
        let of_parts = outcomes.iter().enumerate().map(|(n, of)| Outcome { part: [7, 2, 5][n % 3], ..of.clone() });
        let of_two = outcomes.iter().skip(1).step_by(3).filter(|of| of.scored[0].right).count();
        let by_parts = halves(&of_parts.collect::<Vec<_>>(), &config)[0];
        assert_eq!((by_parts.promising.n_episodes, by_parts.promising.n_right), (34, of_two));
        assert_eq!(by_parts.together().n_right, found[0].together().n_right);
        for (at, halves) in found.iter().enumerate() {
            for (first, half) in [(0, halves.choosing), (1, halves.promising)] {
                let cut = |o: &Outcome| Outcome {
                    scored: o.scored[..=at].to_vec(),
                    travel_mm: o.travel_mm[..=at].to_vec(),
                    ..o.clone()
                };
                let mine: Vec<Outcome> = outcomes.iter().skip(first).step_by(2).map(cut).collect();
                let config = config.changed(|settings, _, _| settings.max_touches = at + 1);
                let stops = stops(LABEL, &mine, &config, &Speeds::default());
                let n = mine.len() as f64;
                assert_eq!((half.n_episodes, half.n_decided), (mine.len(), (stops.confident * n).round() as usize));
                let right = stops.confident * n * (1.0 - stops.confident_and_wrong);
                assert_eq!(half.n_decided_and_right, right.round() as usize);
                assert_eq!(half.n_right, mine.iter().filter(|o| o.scored[at].right).count());
                assert_eq!(half.touches as f64, (stops.mean_touches * n).round());
                assert!((half.seconds(&Speeds::default()) - stops.seconds.unwrap()).abs() < 1e-9);
            }
        }
        assert!(found[5].choosing.n_decided > found[0].choosing.n_decided);
    }

    const LABEL: Label =
        Label { method: Method::Filter, inference: Inference::Exact, action: Choice::Random, poses: Poses::OnGrid };

    #[test]
    fn a_comparison_is_of_the_same_holes() {
        let outcomes = |rights: [bool; 4]| {
            let scored = |right| vec![Scored { right, ..Scored::default() }];
            rights.map(|right| Outcome { scored: scored(right), ..Outcome::default() })
        };
        let (one, other) = (outcomes([true, true, true, false]), outcomes([true, false, false, false]));
        let [comparison] = compare((LABEL, &one), (LABEL, &other))[..] else { panic!() };
        // Differences 0, 1, 1, 0: mean 1/2, variance 1/3, standard error sqrt(1/12).
        assert_eq!(comparison.difference, 0.5);
        assert!((comparison.ci95[1] - 0.5 - 1.959_963_985 / 12.0_f64.sqrt()).abs() < 1e-12);
        // Two coins, both heads or both tails.
        assert_eq!(comparison.paired, Some(Paired { better: 2, worse: 0, p_value: 0.5 }));
    }

    #[test]
    fn reliability_counts_every_touch_once() {
        let scored = |probability, right| Scored { probability, right, ..Scored::default() };
        let scored = vec![scored(0.3, false), scored(0.96, true), scored(1.0, true)];
        let outcome = Outcome { scored, ..Outcome::default() };
        let bins = reliability(&[outcome]);
        assert_eq!(bins.iter().map(|bin| (bin.n, bin.right)).collect::<Vec<_>>(), [(1, 0.0), (1, 1.0), (1, 1.0)]);
    }

    #[test]
    fn reliability_is_as_sure_as_its_episodes_allow() {
        let scored = |right| vec![Scored { probability: 0.97, right, ..Scored::default() }; 5];
        let outcomes: Vec<_> = (0..40).map(|i| Outcome { scored: scored(i > 3), ..Outcome::default() }).collect();
        let [bin] = reliability(&outcomes)[..] else { panic!() };
        assert_eq!((bin.n, bin.n_episodes, bin.right), (200, Some(40), 0.9));
        // Five touches that are always alike say what one says, to the (m - 1) / m of a variance of m.
        let one = wilson_of(0.9, 40.0);
        assert!((0..2).all(|i| (bin.right_ci95[i] - one[i]).abs() < 3e-3), "{:?} {one:?}", bin.right_ci95);
    }

    /// Episodes of parts 0 to 5, ten each, of which the first so many of each are right.
    fn of_parts(n_right: [usize; 6], first_view: impl Fn(usize) -> Option<usize>) -> Vec<Outcome> {
        let scored = |right| vec![Scored { right, probability: 0.75, ..Scored::default() }];
        let outcome = |i: usize| {
            let (part, at) = (i / 10, i % 10);
            Outcome { part, first_view: first_view(i), scored: scored(at < n_right[part]), ..Outcome::default() }
        };
        (0..60).map(outcome).collect()
    }

    #[test]
    fn an_interval_over_parts_is_never_narrower_than_that_over_episodes() {
        for (n_right, wider) in [([10, 10, 10, 10, 10, 2], true), ([8, 9, 8, 9, 9, 9], false), ([10; 6], false)] {
            let row = &rows(LABEL, &of_parts(n_right, |_| None))[0];
            let (of_parts, of_episodes) = (row.accuracy_ci95_clustered.unwrap(), row.accuracy_ci95);
            assert!(of_parts[0] <= of_episodes[0] && of_parts[1] >= of_episodes[1], "{n_right:?} {of_parts:?}");
            assert_eq!(of_parts[0] < of_episodes[0] - 0.05, wider, "{n_right:?} {of_parts:?} {of_episodes:?}");
        }
        let of_one_part = &of_parts([10; 6], |_| None)[..10];
        assert_eq!(rows(LABEL, of_one_part)[0].accuracy_ci95_clustered, None);
    }

    #[test]
    fn after_one_touch_a_view_counts_once() {
        let twice = of_parts([10; 6], |i| Some(i % 10 / 2));
        assert_eq!(rows(LABEL, &twice)[0].accuracy_ci95, wilson_of(1.0, 30.0));
        let mut longer = twice.clone();
        longer.iter_mut().for_each(|outcome| outcome.scored.push(outcome.scored[0]));
        assert_eq!(
            rows(LABEL, &longer).iter().map(|row| row.accuracy_ci95).collect::<Vec<_>>(),
            [wilson_of(1.0, 30.0), wilson_of(1.0, 60.0)]
        );
        assert_eq!(rows(LABEL, &of_parts([10; 6], Some))[0].accuracy_ci95, wilson_of(1.0, 60.0));
    }

    #[test]
    fn a_step_counts_what_one_touch_more_gains_and_loses() {
        let outcome = |rights: [bool; 3]| {
            let scored = rights.map(|right| Scored { right, ..Scored::default() }).to_vec();
            Outcome { scored, ..Outcome::default() }
        };
        let outcomes = [[true, false, true], [true, true, true], [false, true, true]].map(outcome);
        let steps: Vec<_> = rows(LABEL, &outcomes).iter().map(|row| row.against_one_less).collect();
        let paired = |better, worse| Some(Paired { better, worse, p_value: 1.0 });
        assert_eq!(steps, [None, paired(1, 1), paired(1, 0)]);
    }

    #[test]
    fn an_error_of_calibration_is_within_its_interval() {
        // All of probability 0.75; 51 of 60 are right: off by 0.1.
        let row = &rows(LABEL, &of_parts([10, 10, 10, 10, 9, 2], |_| None))[0];
        let (error, [low, high]) = (row.calibration_error.unwrap(), row.calibration_error_ci95.unwrap());
        assert!((error - 0.1).abs() < 1e-12 && 0.0 <= low && low < error && error < high, "{low} {error} {high}");
        // Parts of equal calibration leave nothing to draw.
        let row = &rows(LABEL, &of_parts([9; 6], |_| None))[0];
        assert!(row.calibration_error_ci95.unwrap().iter().all(|bound| (bound - 0.15).abs() < 1e-12));
    }

    #[test]
    fn a_part_comes_with_what_it_is_mistaken_for() {
        let names = ["A", "B", "C"].map(String::from);
        let outcome = |part, named: usize, xy_mm| {
            let last = Scored { named, right: part == named, xy_mm, ..Scored::default() };
            Outcome { part, scored: vec![Scored::default(), last], ..Outcome::default() }
        };
        let outcomes = [outcome(0, 0, 1.0), outcome(0, 2, 9.0), outcome(0, 0, 2.0), outcome(2, 2, 4.0)];
        let [a, c] = &parts(&names, &outcomes)[..] else { panic!() };
        assert_eq!((a.part.as_str(), a.n, a.n_right, a.xy_mm_mean), ("A", 3, 2, 1.5));
        assert_eq!(a.mistaken_for, Some(("C".into(), 1)));
        assert_eq!((c.n, c.n_right, c.mistaken_for.is_none(), c.xy_mm_mean), (1, 1, true, 4.0));
    }
}

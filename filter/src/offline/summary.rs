//! Episodes to figures: accuracy with its interval, errors, stopping, latency.

use crate::offline::evaluate::{Outcome, Scored, StageTimes};
use crate::offline::result::{Choice, Inference, Latency, Method, Poses, Quantiles, Row, Stopping};

/// What a row is about.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    /// How the part was named.
    pub method: Method,
    /// How the belief was kept.
    pub inference: Inference,
    /// How touches were chosen.
    pub action: Choice,
    /// Where the true poses lay.
    pub poses: Poses,
}

/// One row for each number of touches.
pub fn rows(label: Label, outcomes: &[Outcome]) -> Vec<Row> {
    let n_touches = outcomes.iter().map(|outcome| outcome.scored.len()).min().unwrap_or(0);
    let after = |n: usize| -> Vec<Scored> { outcomes.iter().map(|outcome| outcome.scored[n]).collect() };
    (0..n_touches).map(|n| row(label, n + 1, &after(n))).collect()
}

/// The figures of one number of touches. Pose errors are those of the episodes that name the right part.
pub fn row(label: Label, n_touches: usize, scored: &[Scored]) -> Row {
    let right: Vec<&Scored> = scored.iter().filter(|s| s.right).collect();
    let n = scored.len().max(1) as f64;
    let n_right = right.len().max(1) as f64;
    let mean = |of: fn(&Scored) -> f64| right.iter().map(|s| of(s)).sum::<f64>() / n_right;
    let median = |of: fn(&Scored) -> f64| quantile(right.iter().map(|s| of(s)).collect(), 0.5);
    Row {
        method: label.method,
        inference: label.inference,
        action: label.action,
        poses: label.poses,
        n_touches,
        accuracy: right.len() as f64 / n,
        accuracy_ci95: wilson_95(right.len(), scored.len()),
        exact_cell: scored.iter().filter(|s| s.exact_cell).count() as f64 / n,
        xy_mm_mean: mean(|s| s.xy_mm),
        theta_deg_mean: mean(|s| s.theta_deg),
        brier: scored.iter().map(|s| s.brier).sum::<f64>() / n,
        xy_mm_median: Some(median(|s| s.xy_mm)),
        theta_deg_median: Some(median(|s| s.theta_deg)),
        n_correct: Some(right.len()),
    }
}

/// Where each episode would have stopped: at its first touch after which a part is more probable than
/// `stop_probability`, or at its last. `confident_and_wrong` is the share, of the stops for confidence,
/// that name the wrong part.
pub fn stopping(outcomes: &[Outcome], stop_probability: f64) -> Stopping {
    let (mut touches, mut confident, mut wrong) = (0, 0, 0);
    for outcome in outcomes {
        match outcome.scored.iter().position(|s| s.probability > stop_probability) {
            Some(at) => {
                touches += at + 1;
                confident += 1;
                wrong += usize::from(!outcome.scored[at].right);
            }
            None => touches += outcome.scored.len(),
        }
    }
    Stopping {
        mean_touches: touches as f64 / outcomes.len().max(1) as f64,
        confident_and_wrong: f64::from(wrong as u32) / f64::from(confident.max(1) as u32),
    }
}

/// Median and 99th percentile of each stage.
pub fn latency(outcomes: &[Outcome]) -> Latency {
    let times = || outcomes.iter().flat_map(|outcome| &outcome.times);
    let stage = |of: fn(&StageTimes) -> f64| {
        let values: Vec<f64> = times().map(of).filter(|ms| *ms > 0.0).collect();
        Quantiles { p50: quantile(values.clone(), 0.5), p99: quantile(values, 0.99) }
    };
    Latency { encode: stage(|t| t.encode), update: stage(|t| t.update), select: stage(|t| t.select) }
}

/// Wilson's 95 % interval of a share (Wilson 1927): right at shares near nought and one.
pub fn wilson_95(n_right: usize, n: usize) -> [f64; 2] {
    if n == 0 {
        return [0.0, 1.0];
    }
    let (z, n, share) = (1.959_963_985, n as f64, n_right as f64 / n as f64);
    let centre = share + z * z / (2.0 * n);
    let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    [centre - half, centre + half].map(|bound| (bound / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

/// The value below which a share of the values lies: the nearest rank. Nought for no values.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_agrees_with_published_values() {
        // 81 of 263: (0.2553, 0.3662), Newcombe 1998, Table I, method 3.
        let [low, high] = wilson_95(81, 263);
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5, "{low} {high}");
        // 0 of 20: (0, 0.1611).
        assert!(wilson_95(0, 20)[0] < 1e-12 && (wilson_95(0, 20)[1] - 0.1611).abs() < 5e-5);
    }

    #[test]
    fn an_episode_stops_when_it_is_sure_and_is_counted_wrong_if_it_is() {
        let scored = |probability, right| Scored { probability, right, ..Scored::default() };
        let outcome = |scored| Outcome { scored, times: Vec::new() };
        let outcomes = [
            outcome(vec![scored(0.5, true), scored(0.97, true), scored(0.99, false)]),
            outcome(vec![scored(0.99, false), scored(0.2, true), scored(0.2, true)]),
            outcome(vec![scored(0.2, true), scored(0.3, true), scored(0.95, true)]),
        ];
        let stopping = stopping(&outcomes, 0.95);
        assert_eq!(stopping.mean_touches, (2 + 1 + 3) as f64 / 3.0);
        assert_eq!(stopping.confident_and_wrong, 0.5);
    }

    #[test]
    fn quantiles_are_ranks() {
        let values = || (1..=100).map(f64::from).collect::<Vec<_>>();
        assert_eq!((quantile(values(), 0.5), quantile(values(), 0.99)), (50.0, 99.0));
    }
}

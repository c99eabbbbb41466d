//! Groups of frames that were taken with another exposure than the frame at rest.

use std::ops::Range;

use rayon::prelude::*;

use super::pictures::{LEAST_SAMPLE, light_px, median};
use super::{Finding, Kind};
use crate::dataset::store::Dataset;
use crate::error::Result;
use crate::frame::{EDGE_COUNTS, area_average};
use crate::recording::contact::FrameContact;

/// A group whose exposure differs from the exposure at rest by this is a finding, natural logarithm. Cameras drift by
/// -8..+19 % from frame to frame; the median of many frames of a simulated recording keeps 0 to 2.5 %, in every preset.
const LEAST_LOG: f64 = 0.045;

/// A group more has to fit the frames better by so many squared standard errors: a step of five, which of 10,000 places
/// to part frames at one recording in 200 has by chance, and hardly any together with [`LEAST_LOG`].
const GROUP_COST: f64 = 25.0;

/// Places at which frames may be parted: of more frames, each some behind the one before.
const MOST_PLACES: usize = 2_000;

/// Groups of neighbouring frames that are brighter or darker than the frame at rest, where other frames are not as much so:
/// somebody changed exposure, gain or lamps on the way.
pub(super) fn changed_exposure(dataset: &Dataset, frames: &[Result<FrameContact>]) -> Vec<Finding> {
    let usable: Vec<usize> = (0..frames.len()).filter(|frame| frames[*frame].is_ok()).collect();
    let size = light_px(dataset);
    let rest = area_average(dataset.no_contact(), size);
    let gain = |frame: &usize| gain(&area_average(&dataset.frame(*frame), size), &rest);
    let log_gains: Vec<f64> = usable.par_iter().map(|frame| f64::from(gain(frame)).ln()).collect();
    let groups = groups(&log_gains);
    if groups.len() < 2 {
        return Vec::new();
    }
    let level = |group: &Range<usize>| middle(&log_gains[group.clone()]);
    let odd = joined(groups.iter().filter(|group| level(group).abs() > LEAST_LOG).cloned(), level);
    odd.into_iter().map(|group| finding(&usable[group.clone()], level(&group))).collect()
}

fn finding(frames: &[usize], log_gain: f64) -> Finding {
    let percent = 100.0 * (log_gain.exp() - 1.0);
    let [first, last] = [frames.first(), frames.last()].map(|frame| frame.copied().unwrap_or_default());
    let message = format!(
        "frames {first} to {last} are {:.1} % {} than the frame at rest where nothing touches, and others are not: the \
         exposure was changed",
        percent.abs(),
        if percent > 0.0 { "brighter" } else { "darker" },
    );
    Finding { kind: Kind::ChangedExposure, message, frames: frames.to_vec() }
}

/// Groups that are next to each other and off to one side as one.
fn joined(groups: impl Iterator<Item = Range<usize>>, level: impl Fn(&Range<usize>) -> f64) -> Vec<Range<usize>> {
    let mut all: Vec<Range<usize>> = Vec::new();
    for group in groups {
        match all.last_mut() {
            Some(last) if last.end == group.start && level(last).signum() == level(&group).signum() => {
                last.end = group.end;
            }
            _ => all.push(group),
        }
    }
    all
}

/// By how much brighter than at rest a frame is, far from what touches: of the pixels that are within [`EDGE_COUNTS`] of
/// the frame at rest once the median of their ratios is made up for, the ratio of their sums; the mean over channels.
fn gain(planes: &[f32], rest: &[f32]) -> f32 {
    let n = planes.len() / 3;
    let ratio = |channel: usize, pixel: usize| planes[channel * n + pixel] / rest[channel * n + pixel].max(1.0);
    let medians: [f32; 3] = std::array::from_fn(|c| median((0..n).map(|pixel| ratio(c, pixel)).collect()).max(0.01));
    let left = |c: usize, pixel: usize| planes[c * n + pixel] / medians[c] - rest[c * n + pixel];
    let far: Vec<usize> = (0..n).filter(|pixel| (0..3).all(|c| left(c, *pixel).abs() <= EDGE_COUNTS)).collect();
    let sum = |values: &[f32], c: usize| far.iter().map(|pixel| values[c * n + pixel]).sum::<f32>();
    let of_channel = |c: usize| if far.is_empty() { medians[c] } else { sum(planes, c) / sum(rest, c).max(1.0) };
    ((0..3).map(of_channel).sum::<f32>() / 3.0).max(0.01)
}

/// Parts a series into groups of [`LEAST_SAMPLE`] values or more, each of one mean, such that the squares of what is left
/// and a cost for each group are least (optimal partitioning: Jackson et al. 2005).
fn groups(values: &[f64]) -> Vec<Range<usize>> {
    let n = values.len();
    if n < 2 * LEAST_SAMPLE {
        return vec![Range { start: 0, end: n }];
    }
    let values = without_outliers(values);
    // The noise from one value to the next (von Neumann 1941): that steps are few hardly changes it.
    let squares = values.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>();
    let variance = (0.5 * squares / (n - 1) as f64).max(f64::EPSILON);
    let mut sums = vec![0.0];
    values.iter().for_each(|value| sums.push(sums[sums.len() - 1] + value));
    // What a mean leaves of the squares, less the sum of all squares.
    let left = |from: usize, to: usize| -(sums[to] - sums[from]).powi(2) / ((to - from) as f64 * variance);
    let places: Vec<usize> = (0..n).step_by(n.div_ceil(MOST_PLACES)).chain([n]).collect();
    // For each place the least cost of all before it, and where its last group begins.
    let mut best: Vec<(f64, usize)> = vec![(0.0, 0)];
    for (at, &to) in places.iter().enumerate().skip(1) {
        let from = |start: &usize| places[*start] + LEAST_SAMPLE <= to && (*start == 0 || best[*start].0.is_finite());
        let cost = |start: usize| (best[start].0 + left(places[start], to) + GROUP_COST, start);
        let least = (0..at).filter(from).map(cost).min_by(|a, b| a.0.total_cmp(&b.0));
        best.push(least.unwrap_or((f64::INFINITY, 0)));
    }
    let (mut groups, mut at) = (Vec::new(), places.len() - 1);
    while at > 0 {
        let start = best[at].1;
        groups.push(places[start]..places[at]);
        at = start;
    }
    groups.reverse();
    groups
}

/// The values, with each value far from the middle moved to where far begins: a frame that is hardly lit counts no more
/// than others.
fn without_outliers(values: &[f64]) -> Vec<f64> {
    /// Beyond any drift and any change of exposure, natural logarithm.
    const FAR_LOG: f64 = 0.5;
    let centre = middle(values);
    values.iter().map(|value| value.clamp(centre - FAR_LOG, centre + FAR_LOG)).collect()
}

/// The median of at least one value.
fn middle(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::random::{around_zero, frame_rng};

    /// Noise between -1 and 1, of variance 1/3.
    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = frame_rng(seed, 0);
        (0..n).map(|_| around_zero(&mut rng, 1.0)).collect()
    }

    #[test]
    fn a_series_is_parted_where_its_mean_changes_and_only_there() {
        for seed in 0..200 {
            assert_eq!(groups(&noise(300, seed)).len(), 1, "{seed}");
        }
        let mut steps = noise(300, 1);
        // A step of three deviations, and back, which no single place to part at shows well.
        steps[120..200].iter_mut().for_each(|value| *value += 1.75);
        let found = groups(&steps);
        let [a, b, c] = &found[..] else { panic!("{found:?}") };
        assert!(a.end.abs_diff(120) <= 3 && b.end.abs_diff(200) <= 3, "{found:?}");
        assert_eq!((a.start, a.end, b.end, c.end), (0, b.start, c.start, 300));
        // Without any noise the place is exact.
        let exact: Vec<f64> = (0..40).map(|i| if i < 15 { 0.0 } else { 0.1 }).collect();
        assert_eq!(groups(&exact), [0..15, 15..40]);
        assert_eq!(groups(&exact[..19]).len(), 1);
    }

    #[test]
    fn the_gain_is_that_of_what_is_not_touched() {
        let rest: Vec<f32> = (0..3 * 40).map(|i| 60.0 + (i % 40) as f32).collect();
        let mut planes: Vec<f32> = rest.iter().map(|value| 1.09 * value).collect();
        // A third of the view is touched.
        (0..3).for_each(|c| planes[40 * c..40 * c + 13].iter_mut().for_each(|value| *value += 50.0));
        assert!((gain(&planes, &rest) - 1.09).abs() < 1e-5);
    }
}

//! Where a part is and how sure that is, from the definition, in f64. Only this file says what [`covariance`] is.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;

use super::evidence::Evidence;
use super::reference::{Pose, poses};

/// Values of x in mm, y in mm and theta in radians.
type Three = [f64; 3];

/// The power of the posterior of which a pose is the mean.
const POWER: f64 = 0.3;

/// A covariance is of the posterior as it is: its power by that one.
pub const OF_COVARIANCE: f64 = 1.0 / POWER;

/// How far the log-likelihoods that were asked for, to that power, may be off.
pub fn off(evidence: &Evidence) -> f64 {
    POWER * evidence.largest_off.get()
}

/// The mean pose around one, and the covariance of the posterior to that power there: by lattices of five points
/// along each axis, one step either way, then 2.5 standard deviations around the mean, five times.
pub fn hill(evidence: &Evidence, part: usize, start: &Se2) -> (Three, [Three; 3]) {
    let PoseGrid { xy_step_mm, theta_step_deg, .. } = evidence.recorded.grid;
    let spans = [xy_step_mm, xy_step_mm, theta_step_deg.to_radians()];
    let (mut centre, mut half, mut covariance) = ([start.x_mm, start.y_mm, start.theta_rad], spans, [[0.0; 3]; 3]);
    for _ in 0..5 {
        let mut points: Vec<(Three, f64)> = Vec::new();
        for index in 0..125 {
            let offset = |axis: usize, index: usize| half[axis] * (index as f64 / 2.0 - 1.0);
            let offsets = [offset(0, index / 25), offset(1, index / 5 % 5), offset(2, index % 5)];
            let [x, y, theta] = [0, 1, 2].map(|axis: usize| centre[axis] + offsets[axis]);
            let pose = Pose { x, y, turn: [theta.cos(), theta.sin()] };
            points.push((offsets, POWER * evidence.log_of(part, &pose, &Se2::new(x, y, theta))));
        }
        let largest = points.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        points.iter_mut().for_each(|(_, log)| *log = (*log - largest).exp());
        let (mean, spread) = moments(&points);
        covariance = spread;
        centre = [0, 1, 2].map(|axis: usize| centre[axis] + mean[axis]);
        half = [0, 1, 2].map(|i: usize| (2.5 * spread[i][i].sqrt()).max(0.3 * half[i]).min(spans[i]));
    }
    (centre, covariance)
}

/// The pose that is stated for a part: the mean of [`hill`], or where the posterior goes on beyond a step, as along a
/// straight edge, the middle of it along the axes on which it does.
pub fn stated(evidence: &Evidence, part: usize, start: &Se2) -> Three {
    let PoseGrid { xy_half_mm, xy_step_mm, theta_step_deg, .. } = evidence.recorded.grid;
    let steps = [xy_step_mm, xy_step_mm, theta_step_deg.to_radians()];
    let reach = [2.0 * xy_half_mm, 2.0 * xy_half_mm, std::f64::consts::PI];
    let (mut middle, _) = hill(evidence, part, start);
    if !is_wide(evidence, part, start, steps) {
        return middle;
    }
    let mut half = steps;
    for _ in 0..8 {
        let (mean, moments) = within(evidence, part, &Se2::new(middle[0], middle[1], middle[2]), half);
        half = next_half(half, &moments, steps, reach);
        middle = [0, 1, 2].map(|i: usize| middle[i] + if half[i] > steps[i] { mean[i] } else { 0.0 });
    }
    middle
}

/// Whether 2.5 standard deviations of the posterior on a lattice of five points an axis, one step either way, are more.
fn is_wide(evidence: &Evidence, part: usize, start: &Se2, steps: Three) -> bool {
    let mut points: Vec<(Three, f64)> = Vec::new();
    for index in 0..125 {
        let place = [index / 25, index / 5 % 5, index % 5].map(|at| f64::from(at) / 2.0 - 1.0);
        let offsets = [0, 1, 2].map(|axis: usize| steps[axis] * place[axis]);
        let theta = start.theta_rad + offsets[2];
        let [x, y] = [start.x_mm + offsets[0], start.y_mm + offsets[1]];
        let log = evidence.log_of(part, &Pose { x, y, turn: [theta.cos(), theta.sin()] }, &Se2::new(x, y, theta));
        points.push((offsets, log));
    }
    let largest = points.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
    points.iter_mut().for_each(|(_, log)| *log = (*log - largest).exp());
    let (_, spread) = moments(&points);
    (0..3).any(|i| 2.5 * spread[i][i].sqrt() > steps[i])
}

/// The weighted mean of some offsets and their covariance about it.
fn moments(points: &[(Three, f64)]) -> (Three, [Three; 3]) {
    let total: f64 = points.iter().map(|(_, weight)| weight).sum();
    let mean_of = |value: &dyn Fn(&Three) -> f64| {
        points.iter().map(|(offset, weight)| weight * value(offset)).sum::<f64>() / total
    };
    let mean = [0, 1, 2].map(|axis: usize| mean_of(&|offset| offset[axis]));
    let spread = [0, 1, 2]
        .map(|i: usize| [0, 1, 2].map(|j: usize| mean_of(&|offset| (offset[i] - mean[i]) * (offset[j] - mean[j]))));
    (mean, spread)
}

/// The covariance of a part's pose around the pose that is stated: of the posterior within a box around it, and of
/// how far the states' cells outside the box are from there, each as often as it is believed. `of_states`: the belief
/// in each state of the part, `[n_states]`, of any sum.
pub fn covariance(evidence: &Evidence, part: usize, stated: &Se2, states: &PoseGrid, of_states: &[f64]) -> [Three; 3] {
    let (half, within) = around(evidence, part, stated);
    let steps = [states.xy_step_mm, states.xy_step_mm, states.theta_step_deg.to_radians()];
    let (mut inside, mut whole, mut sums) = (0.0, 0.0, [[0.0; 3]; 3]);
    for (pose, mass) in poses(states).iter().zip(of_states) {
        let (sin, cos) = stated.theta_rad.sin_cos();
        let turned = (pose.turn[1] * cos - pose.turn[0] * sin).atan2(pose.turn[0] * cos + pose.turn[1] * sin);
        let offset = [pose.x - stated.x_mm, pose.y - stated.y_mm, turned];
        let overlap = |i: usize| ((half[i].max(steps[i]) - offset[i].abs()) / steps[i] + 0.5).clamp(0.0, 1.0);
        let share = overlap(0) * overlap(1) * overlap(2);
        inside += mass * share;
        whole += mass;
        (0..3).for_each(|i| (0..3).for_each(|j| sums[i][j] += (1.0 - share) * mass * offset[i] * offset[j]));
        (0..3).for_each(|i| sums[i][i] += (1.0 - share) * mass * within[i][i].min(steps[i].powi(2) / 12.0));
    }
    [0, 1, 2].map(|i: usize| [0, 1, 2].map(|j: usize| (sums[i][j] + inside * within[i][j]) / whole))
}

/// How far to either side of a pose the posterior goes on, at most a step, and its second moments within that.
fn around(evidence: &Evidence, part: usize, stated: &Se2) -> (Three, [Three; 3]) {
    let PoseGrid { xy_step_mm, theta_step_deg, .. } = evidence.recorded.grid;
    let steps = [xy_step_mm, xy_step_mm, theta_step_deg.to_radians()];
    let mut half = steps;
    for _ in 0..7 {
        let (_, moments) = within(evidence, part, stated, half);
        let next = next_half(half, &moments, steps, steps);
        if (0..3).all(|i| (next[i] - half[i]).abs() <= 0.25 * half[i]) {
            return (half, moments);
        }
        half = next;
    }
    (half, within(evidence, part, stated, half).1)
}

/// 2.5 standard deviations, by degrees and within what is asked for.
fn next_half(half: Three, moments: &[Three; 3], steps: Three, reach: Three) -> Three {
    [0, 1, 2].map(|i: usize| {
        let wanted = (2.5 * moments[i][i].sqrt()).max(0.3 * half[i]).min(2.0 * half[i]);
        wanted.max(0.02 * steps[i]).min(reach[i])
    })
}

/// Mean offset and second moments of the posterior from a pose, by eight by eight by eight points within `half` of
/// it; along x and y those of each angle are shifted against those of the angle before.
fn within(evidence: &Evidence, part: usize, stated: &Se2, half: Three) -> (Three, [Three; 3]) {
    let mut points: Vec<(Three, f64)> = Vec::new();
    for index in 0..512 {
        let [theta, x, y] = [index / 64, index / 8 % 8, index % 8].map(f64::from);
        let shifted = |by: f64, place: f64| place + (by * (theta + 1.0)).fract();
        // The powers of the plastic number's inverse: root of t^3 = t + 1.
        let places = [shifted(0.754_877_666_246_692_7, x), shifted(0.569_840_290_998_053_2, y), theta + 0.5];
        let offset = [0, 1, 2].map(|axis: usize| half[axis] * (places[axis] / 4.0 - 1.0));
        let [x, y, theta] = [stated.x_mm + offset[0], stated.y_mm + offset[1], stated.theta_rad + offset[2]];
        let pose = Pose { x, y, turn: [theta.cos(), theta.sin()] };
        points.push((offset, evidence.log_of(part, &pose, &Se2::new(x, y, theta))));
    }
    let largest = points.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = points.iter().map(|(_, log)| (log - largest).exp()).sum();
    let mean_of = |value: &dyn Fn(&Three) -> f64| {
        points.iter().map(|(offset, log)| (log - largest).exp() * value(offset)).sum::<f64>() / total
    };
    let moment = |i: usize, j: usize| mean_of(&|offset| offset[i] * offset[j]);
    let mean = [0, 1, 2].map(|i: usize| mean_of(&|offset| offset[i]));
    (mean, [0, 1, 2].map(|i: usize| [0, 1, 2].map(|j: usize| moment(i, j))))
}

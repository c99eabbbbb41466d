//! Where a part is and how sure that is, from the definition, in f64. What [`covariance`] is lies here alone.

use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use super::between::Evidence;
use super::reference::{Pose, poses};

/// Values of x in mm, y in mm and theta in radians.
type Three = [f64; 3];

/// The power of the posterior of which a pose is the mean, and the share of the variance there that is a pose's error.
const POWER: f64 = 0.3;
const OF_VARIANCE: f64 = 0.4;

/// The variance of a pose by that of the posterior to that power.
pub const SCALE: f64 = POWER * OF_VARIANCE;

/// The power of the posterior of all touches to which a pose is found: what an error of a log-likelihood is taken to.
pub fn power(evidence: &Evidence) -> f64 {
    POWER * evidence.joint
}

/// The mean pose around one, and the covariance of that hill: by lattices of five points along each axis, one step
/// either way, then 2.5 standard deviations around the mean, five times.
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
            points.push((offsets, power(evidence) * evidence.log_of(part, &pose, &Se2::new(x, y, theta))));
        }
        let largest = points.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        points.iter_mut().for_each(|(_, log)| *log = (*log - largest).exp());
        let (mean, spread) = moments(&points);
        covariance = spread;
        centre = [0, 1, 2].map(|axis: usize| centre[axis] + mean[axis]);
        half = [0, 1, 2].map(|i: usize| (2.5 * spread[i][i].sqrt()).max(0.3 * half[i]).min(spans[i]));
    }
    (centre, covariance.map(|row| row.map(|value| SCALE * value)))
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

/// The covariance of a part's pose: of its hill around the middle, and how far the states of other hills, two steps
/// away and more, lie from there, each as often as it is believed. `of_states`: the belief in each state of the part,
/// `[n_states]`, of any sum.
pub fn covariance(
    evidence: &Evidence,
    (middle, of_hill): (Three, [Three; 3]),
    states: &PoseGrid,
    of_states: &[f64],
) -> [Three; 3] {
    let (whole, mut covariance) = (of_states.iter().sum::<f64>(), of_hill);
    let middle = Pose { x: middle[0], y: middle[1], turn: [middle[2].cos(), middle[2].sin()] };
    let PoseGrid { xy_step_mm, theta_step_deg, .. } = evidence.recorded.grid;
    let heavy =
        poses(states).into_iter().zip(of_states.iter().map(|mass| mass / whole)).filter(|(_, mass)| *mass > 1e-7);
    for (pose, mass) in heavy {
        let shift = [pose.x - middle.x, pose.y - middle.y];
        let is_near = shift[0].hypot(shift[1]) <= 2.0 * xy_step_mm;
        if !(is_near && pose.turned_deg(&middle) <= 2.0 * theta_step_deg) {
            let [[c, s], [mc, ms]] = [pose.turn, middle.turn];
            let offset = [shift[0], shift[1], (s * mc - c * ms).atan2(c * mc + s * ms)];
            (0..3).for_each(|i| (0..3).for_each(|j| covariance[i][j] += mass * offset[i] * offset[j]));
        }
    }
    covariance
}

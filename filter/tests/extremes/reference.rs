//! The posterior straight from its definition: f64 throughout, nothing shared with the filter's engines.
//!
//! Rotations are matrices, the nearest view is found by trying all, inner products are f64, and every
//! state's logs are added up touch by touch.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;

use tactile_filter::TouchModel;

/// Half a unit in the last place of f32, of 1.
pub const U: f64 = 1.0 / (1 << 24) as f64;

/// The largest error of a cosine of unit vectors of 128 f32s, by Higham's bound (n + 1) u for a sum of n roundings: 8
/// in a lane, 16 over the lanes, and 6 for length, scale and difference.
pub const OF_COSINE: f64 = 30.0 * U;

/// The filter finds ln(1 + e^z) of one state from a table, to within this.
const OF_TABLE: f64 = 4e-10;

/// A touch as the reference sees it.
pub struct Touch {
    /// The sensor's motion since the touch before.
    pub moved: Se2,
    /// Share of the view that shows an edge.
    pub edge_share: f32,
    /// How rare it is in the world, nats.
    pub rarity: f32,
    /// The cosine with each row of the bank, `[n_rows]`.
    pub cosines: Vec<f64>,
}

/// A pose as a matrix: position in mm, and cosine and sine of its angle.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// x, mm.
    pub x: f64,
    /// y, mm.
    pub y: f64,
    /// Cosine and sine of the angle.
    pub turn: [f64; 2],
}

impl Pose {
    /// A motion written as a matrix.
    pub fn of(motion: &Se2) -> Self {
        Self { x: motion.x_mm, y: motion.y_mm, turn: [motion.theta_rad.cos(), motion.theta_rad.sin()] }
    }

    /// A pose from mm and degrees.
    pub fn from_degrees(x: f64, y: f64, degrees: f64) -> Self {
        Self { x, y, turn: [degrees.to_radians().cos(), degrees.to_radians().sin()] }
    }

    /// The matrix product.
    pub fn then(&self, next: &Self) -> Self {
        let ([c, s], [nc, ns]) = (self.turn, next.turn);
        let turn = [c * nc - s * ns, s * nc + c * ns];
        // A product of rotations stays one only to rounding.
        let length = turn[0].hypot(turn[1]);
        Self {
            x: self.x + c * next.x - s * next.y,
            y: self.y + s * next.x + c * next.y,
            turn: turn.map(|value| value / length),
        }
    }

    /// The angle between two poses, degrees, 0..=180.
    pub fn turned_deg(&self, other: &Self) -> f64 {
        let [c, s] = self.turn;
        let [oc, os] = other.turn;
        (c * os - s * oc).atan2(c * oc + s * os).to_degrees().abs()
    }
}

/// The cosine of a query with each row, `[n_rows]`.
pub fn cosines(rows: &[f32], query: &[f32]) -> Vec<f64> {
    let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let length = inner(query, query).sqrt();
    let scale = if length > 0.0 { length } else { 1.0 };
    rows.chunks_exact(query.len()).map(|row| (inner(query, row) / scale).clamp(-1.0, 1.0)).collect()
}

/// Every pose of a grid, theta fastest.
pub fn poses(grid: &PoseGrid) -> Vec<Pose> {
    let axis = |half: f64, step: f64| -> Vec<f64> {
        let n = (half / step).round() as i32;
        (-n..=n).map(|i| f64::from(i) * step).collect()
    };
    let (places, mut angles) = (axis(grid.xy_half_mm, grid.xy_step_mm), axis(grid.theta_half_deg, grid.theta_step_deg));
    if grid.theta_half_deg == 180.0 {
        // It is -180 degrees.
        angles.pop();
    }
    let at = |x: &f64, y: &f64| angles.iter().map(|a| Pose::from_degrees(*x, *y, *a)).collect::<Vec<_>>();
    places.iter().flat_map(|x| places.iter().flat_map(|y| at(x, y)).collect::<Vec<_>>()).collect()
}

/// The log-likelihood of one touch at a view by their cosine, against that of what nobody recorded.
pub enum Likelihood {
    /// `ln((1 - outliers) e^z + outliers) - unknown` with `z = at_own - steepness (distance - own)`.
    Odds {
        /// The log-odds of a view as far from the touch as touches are from their own.
        at_own: f64,
        /// What a distance of 1 costs, nats.
        steepness: f64,
        /// How far touches are from their own views.
        own: f64,
        /// Share of the touches that are of something else.
        outliers: f64,
        /// The same of what nobody recorded, against the world: the log of the mean over all recorded views, at least 0.
        unknown: f64,
        /// The largest cosine with a recorded view.
        best: f64,
    },
    /// Alg. 1 as printed: the cosine over a temperature, by the mean of its power over all recorded views.
    Paper {
        /// tau.
        temperature: f64,
        /// The cosine of which the power is the mean.
        average: f64,
    },
}

impl Likelihood {
    /// `is_recorded`: whether each row was, `[n_rows]`. `own`: how far the bank's touches are from their own views.
    pub fn of(touch: &Touch, is_recorded: &[bool], config: &TouchModel, own: f64) -> Self {
        let known = || touch.cosines.iter().zip(is_recorded).filter(|(_, is_recorded)| **is_recorded);
        let best = known().map(|(cosine, _)| *cosine).fold(-1.0, f64::max);
        let Some(temperature) = config.temperature else {
            let log_edge = ((f64::from(touch.edge_share) + 0.003) / 0.05).ln();
            let (at_own, outliers) = (config.match_offset + f64::from(touch.rarity), config.outlier_share);
            // Distances count by how far the bank's touches are from their own views, against the usual.
            let counted = (config.own_distance / own).powf(config.distance_by_own);
            let steepness = counted * config.steepness * (config.steepness_by_edge * log_edge).exp();
            let own = config.own_distance / counted;
            let against = |unknown| Self::Odds { at_own, steepness, own, outliers, unknown, best };
            let logs: Vec<f64> = known().map(|(cosine, _)| against(0.0).log(*cosine)).collect();
            let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mean = logs.iter().map(|log| (log - largest).exp()).sum::<f64>() / logs.len() as f64;
            return against(if logs.is_empty() { 0.0 } else { (largest + mean.ln()).max(0.0) });
        };
        let powers: Vec<f64> = known().map(|(cosine, _)| ((cosine - best) / temperature).exp()).collect();
        let mean = if powers.is_empty() { 1.0 } else { powers.iter().sum::<f64>() / powers.len() as f64 };
        Self::Paper { temperature, average: best + temperature * mean.ln() }
    }

    /// At a view of this cosine, which may be out of -1..=1 by an error.
    pub fn log(&self, cosine: f64) -> f64 {
        match self {
            Self::Odds { at_own, steepness, own, outliers, unknown, .. } => {
                let distance = (2.0 - 2.0 * cosine).max(0.0).sqrt();
                log_sum((1.0 - outliers).ln() + at_own - steepness * (distance - own), outliers.ln()) - unknown
            }
            Self::Paper { temperature, average } => (cosine - average) / temperature,
        }
    }

    /// How far the filter's may be off there where its cosine is, by `error`. The log falls with the distance, so
    /// that it is between those at both ends of what the cosine may be: its derivative by the cosine is `steepness /
    /// distance`, and at a distance of 0 an error `u` is a distance of `sqrt(2 u)`.
    pub fn off(&self, cosine: f64, error: f64) -> f64 {
        let log = self.log(cosine);
        let of_cosine = (self.log(cosine + error) - log).max(log - self.log(cosine - error));
        // No mean of powers is off by more than the largest.
        let of_mean = match self {
            Self::Paper { temperature, .. } => error / temperature,
            Self::Odds { outliers, best, .. } => {
                let of_best = self.log(best + error) - self.log(best - error);
                of_best + if *outliers > 0.0 { 2.0 * OF_TABLE } else { 0.0 }
            }
        };
        // A few roundings of numbers as large as any that is added.
        of_cosine + of_mean + 16.0 * f64::EPSILON * self.size()
    }

    /// The sum of the sizes of all that a log is added up from.
    pub fn size(&self) -> f64 {
        match self {
            Self::Odds { at_own, steepness, own, outliers, .. } => {
                let log_outliers = if *outliers > 0.0 { outliers.ln() } else { 0.0 };
                at_own.abs() + steepness * (2.0 + own) - (1.0 - outliers).ln() - log_outliers
            }
            Self::Paper { temperature, average } => (1.0 + average.abs()) / temperature,
        }
    }
}

/// The log of each state's probability, `[n_states]`, and how far the filter's may be off, nats.
pub struct Expected {
    /// The logs of every part at every pose of the first touch; the sum of the powers is 1.
    pub logs: Vec<f64>,
    /// The largest error of any of them.
    pub off: f64,
}

impl Expected {
    /// How far a probability may be off, relative to it.
    pub fn relative(&self) -> f64 {
        self.off.exp_m1() + 1e-11
    }
}

/// What should be believed of a bank all of whose views were recorded, and which knows no matches; the view at a pose
/// is that of the nearest recorded one. `error`: how far a cosine may be off.
///
/// A state's probability is its likelihood over the sum of all: either is off as the logs of the touches are.
pub fn expected(grid: &PoseGrid, touches: &[Touch], config: &TouchModel, error: f64) -> Expected {
    let recorded = poses(grid);
    let n_rows = touches.first().map_or(0, |touch| touch.cosines.len());
    let (mut logs, mut offs, is_recorded) = (vec![0.0; n_rows], vec![0.0; n_rows], vec![true; n_rows]);
    let mut first_from_sensor: Vec<Pose> = Vec::new();
    for touch in touches {
        let moved = Pose::of(&touch.moved);
        let now = first_from_sensor.last().map_or(Pose::from_degrees(0.0, 0.0, 0.0), |before| before.then(&moved));
        let new = first_from_sensor.iter().map(|before| new_share(before, &now, config)).fold(1.0, f64::min);
        let weight = if is_far(&now, config, grid) { 0.0 } else { new };
        first_from_sensor.push(now);
        let likelihood = Likelihood::of(touch, &is_recorded, config, config.own_distance);
        for (cell, first) in recorded.iter().enumerate() {
            // What nobody recorded is at 0.
            let seen = nearest(grid, &recorded, &first.then(&now), config.nearest_tolerance);
            let Some((seen, trust)) = seen else { continue };
            for state in (cell..n_rows).step_by(recorded.len()) {
                let cosine = touch.cosines[state - cell + seen];
                logs[state] += weight * log_sum(trust.ln() + likelihood.log(cosine), (1.0 - trust).ln());
                offs[state] += weight * likelihood.off(cosine, error) + f64::EPSILON * f64::abs(logs[state]);
            }
        }
    }
    let off = 2.0 * offs.iter().copied().fold(0.0, f64::max);
    normalise(&mut logs);
    Expected { logs, off }
}

/// Whether no recorded view is near, wherever the first touch was: the touch does not count.
pub fn is_far(first_from_sensor: &Pose, config: &TouchModel, grid: &PoseGrid) -> bool {
    let rim_mm = grid.xy_step_mm * (8.0 * config.nearest_tolerance).max(2.0);
    first_from_sensor.x.hypot(first_from_sensor.y) > 8.0_f64.sqrt() * grid.xy_half_mm + rim_mm
}

/// Makes exp of the logs sum to 1.
pub fn normalise(logs: &mut [f64]) {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
    logs.iter_mut().for_each(|log| *log -= largest + sum.ln());
}

/// log(exp(a) + exp(b)), either of them -inf.
pub fn log_sum(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if high == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

/// The share of a touch that an earlier one did not tell: the power to which its likelihood is taken.
pub fn new_share(before: &Pose, now: &Pose, config: &TouchModel) -> f64 {
    if config.shared_mm == 0.0 {
        return 1.0;
    }
    let shift = (before.x - now.x).hypot(before.y - now.y) / config.shared_mm;
    let turn = before.turned_deg(now).to_radians();
    1.0 - (-(shift * shift + turn * turn).sqrt()).exp()
}

/// The recorded cell within half a step on each axis, by trying all, and how far it is trusted.
fn nearest(grid: &PoseGrid, recorded: &[Pose], pose: &Pose, tolerance: f64) -> Option<(usize, f64)> {
    let steps = |cell: &Pose| {
        let [x, y] = [cell.x - pose.x, cell.y - pose.y].map(|shift| shift.abs() / grid.xy_step_mm);
        (x, y, cell.turned_deg(pose) / grid.theta_step_deg)
    };
    let cell = recorded.iter().position(|cell| {
        let (x, y, turn) = steps(cell);
        x <= 0.5 && y <= 0.5 && turn <= 0.5
    })?;
    let (x, y, turn) = steps(&recorded[cell]);
    let excess = (x.hypot(y).max(turn) / tolerance - 1.0).max(0.0);
    Some((cell, (-0.5 * excess * excess).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE_POSE: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

    #[test]
    fn two_parts_and_one_touch_by_hand() {
        let config = TouchModel { match_offset: 1.0, steepness: 2.0, outlier_share: 0.01, ..TouchModel::default() };
        let config = TouchModel { steepness_by_edge: 0.5, own_distance: 0.3, ..config };
        let (moved, cosines) = (Se2::IDENTITY, vec![1.0, 0.5]);
        let touch = Touch { moved, edge_share: 0.197, rarity: 0.25, cosines };
        let Expected { logs, .. } = expected(&ONE_POSE, &[touch], &config, 0.0);
        // Four times the usual share: twice as steep. Distances of 0 and 1.
        let likely = |distance: f64| 0.99 * (1.25 - 4.0 * (distance - 0.3)).exp() + 0.01;
        // The share of edge is f32.
        assert!((logs[0] - logs[1] - (likely(0.0) / likely(1.0)).ln()).abs() < 1e-6);
        assert!((logs[0].exp() + logs[1].exp() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn an_error_of_a_cosine_counts_by_steepness_over_distance_and_by_its_root_at_no_distance() {
        let odds = Likelihood::Odds { at_own: 1.0, steepness: 20.0, own: 0.4, outliers: 0.0, unknown: 0.5, best: -1.0 };
        // And both ends of the best view's, here at a distance of 2, by which what nobody recorded is found.
        assert!((odds.off(0.5, 1e-6) / (20.0 * 1e-6 + 10.0 * 2e-6) - 1.0).abs() < 1e-3);
        assert!((odds.off(1.0, 1e-6) / (20.0 * 2e-6_f64.sqrt()) - 1.0).abs() < 1e-3);
        // Of an outlier next to nothing.
        let outlier =
            Likelihood::Odds { at_own: -50.0, steepness: 20.0, own: 0.4, outliers: 0.01, unknown: 0.5, best: -1.0 };
        assert!(outlier.off(0.5, 1e-6) < 3.0 * OF_TABLE);
        let paper = Likelihood::Paper { temperature: 0.1, average: 0.3 };
        assert!((paper.off(0.5, 1e-6) / 2e-5 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_poses_are_those_of_the_grid() {
        let grid = PoseGrid::SMALL;
        for (cell, pose) in poses(&grid).iter().enumerate() {
            let expected = grid.pose(cell);
            assert!((pose.x - expected.x_mm).abs() + (pose.y - expected.y_mm).abs() < 1e-12);
            assert!(pose.turned_deg(&Pose::of(&expected)) < 1e-9);
        }
    }
}

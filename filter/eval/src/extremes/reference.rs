//! The posterior straight from its definition: f64 throughout, nothing shared with the filter's engines.
//!
//! Rotations are matrices, the nearest view is found by trying all, inner products are f64, and every
//! state's logs are added up touch by touch.

use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use tactile_filter::likelihood::LikelihoodConfig;

/// A touch as the reference sees it.
pub struct Touch {
    /// The sensor's motion since the touch before.
    pub moved: Se2,
    /// Share of the view that shows an edge.
    pub edge_share: f32,
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
    let (places, angles) = (axis(grid.xy_half_mm, grid.xy_step_mm), axis(grid.theta_half_deg, grid.theta_step_deg));
    let at = |x: &f64, y: &f64| angles.iter().map(|a| Pose::from_degrees(*x, *y, *a)).collect::<Vec<_>>();
    places.iter().flat_map(|x| places.iter().flat_map(|y| at(x, y)).collect::<Vec<_>>()).collect()
}

/// The probability of each state's log, `[n_states]`, normalised: of every part at every pose of the first touch.
///
/// Views are looked up by the nearest recorded pose. Equal parts of a full turn's grid that meet at half a turn
/// must be recorded alike.
pub fn log_posterior(grid: &PoseGrid, edge_shares: &[f32], touches: &[Touch], config: &LikelihoodConfig) -> Vec<f64> {
    let recorded = poses(grid);
    let mut logs = vec![0.0; edge_shares.len()];
    let mut first_from_sensor: Vec<Pose> = Vec::new();
    for touch in touches {
        let moved = Pose::of(&touch.moved);
        let now = first_from_sensor.last().map_or(Pose::from_degrees(0.0, 0.0, 0.0), |before| before.then(&moved));
        let weight = first_from_sensor.iter().map(|before| new_share(before, &now, config)).fold(1.0, f64::min);
        first_from_sensor.push(now);
        let of_row = log_rows(edge_shares, touch, config);
        let unknown = 0.5_f64.ln();
        for (cell, first) in recorded.iter().enumerate() {
            let pose = first.then(&now);
            let Some((seen, trust)) = nearest(grid, &recorded, &pose, config.nearest_tolerance) else {
                logs.iter_mut().skip(cell).step_by(recorded.len()).for_each(|log| *log += unknown);
                continue;
            };
            for (part, log) in logs.iter_mut().skip(cell).step_by(recorded.len()).enumerate() {
                let row = of_row[part * recorded.len() + seen];
                let mixed = log_sum(trust.ln() + row, (1.0 - trust).ln() + unknown);
                *log += unknown + weight * (mixed - unknown);
            }
        }
    }
    normalise(&mut logs);
    logs
}

/// Makes exp of the logs sum to 1.
pub fn normalise(logs: &mut [f64]) {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
    logs.iter_mut().for_each(|log| *log -= largest + sum.ln());
}

/// The log-likelihood at each row: agreement about blankness, and among edged views the look beside its mean.
fn log_rows(edge_shares: &[f32], touch: &Touch, config: &LikelihoodConfig) -> Vec<f64> {
    let is_blank = |share: f32| share < config.blank_share;
    let best = (0..edge_shares.len())
        .filter(|row| !is_blank(edge_shares[*row]))
        .map(|row| touch.cosines[row])
        .fold(-1.0, f64::max);
    let floor = config.outlier_floor.ln();
    let log_look = |row: usize| log_sum((touch.cosines[row] - best) / config.temperature, floor);
    let edged: Vec<usize> = (0..edge_shares.len()).filter(|row| !is_blank(edge_shares[*row])).collect();
    // No look is above 1 + floor: its plain mean is safe.
    let log_mean = (edged.iter().map(|row| log_look(*row).exp()).sum::<f64>() / edged.len() as f64).ln();
    let agreement = config.blank_agreement;
    (0..edge_shares.len())
        .map(|row| match (is_blank(edge_shares[row]), is_blank(touch.edge_share)) {
            (false, false) => agreement.ln() + log_look(row) - log_mean,
            (true, true) => agreement.ln(),
            _ => (1.0 - agreement).ln(),
        })
        .collect()
}

/// log(exp(a) + exp(b)), either of them -inf.
fn log_sum(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if high == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

fn new_share(before: &Pose, now: &Pose, config: &LikelihoodConfig) -> f64 {
    if config.overlap_mm == 0.0 {
        return 1.0;
    }
    let shift = (before.x - now.x).hypot(before.y - now.y) / config.overlap_mm;
    let turn = before.turned_deg(now) / config.overlap_deg;
    -(-0.5 * (shift * shift + turn * turn)).exp_m1()
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
        let config = LikelihoodConfig { temperature: 0.1, outlier_floor: 0.01, ..LikelihoodConfig::default() };
        let touch = Touch { moved: Se2::IDENTITY, edge_share: 0.2, cosines: vec![1.0, 0.8] };
        let logs = log_posterior(&ONE_POSE, &[0.2, 0.2], &[touch], &config);
        let odds = 1.01 / ((-2.0_f64).exp() + 0.01);
        assert!((logs[0] - logs[1] - odds.ln()).abs() < 1e-12);
        assert!((logs[0].exp() + logs[1].exp() - 1.0).abs() < 1e-12);
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

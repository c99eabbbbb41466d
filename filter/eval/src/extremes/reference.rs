//! The posterior straight from its definition: f64 throughout, nothing shared with the filter's engines.
//!
//! Rotations are matrices, the nearest view is found by trying all, inner products are f64, and every
//! state's logs are added up touch by touch.

use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use tactile_filter::TouchModel;

/// A touch as the reference sees it.
pub struct Touch {
    /// The sensor's motion since the touch before.
    pub moved: Se2,
    /// Share of the view that shows an edge.
    pub edge_share: f32,
    /// The cosine with each row of the bank, `[n_rows]`.
    pub cosines: Vec<f64>,
    /// The same without the bank's metric; `None` where it has none.
    pub plain: Option<Vec<f64>>,
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

/// The probability of each state's log, `[n_states]`, normalised: of every part at every pose of the first touch.
///
/// The view at a pose is that of the nearest recorded one.
pub fn log_posterior(grid: &PoseGrid, edge_shares: &[f32], touches: &[Touch], config: &TouchModel) -> Vec<f64> {
    let recorded = poses(grid);
    let shows: Vec<Option<bool>> = edge_shares.iter().map(|share| Some(*share >= config.blank_share)).collect();
    let mut logs = vec![0.0; edge_shares.len()];
    let (mut first_from_sensor, mut n_touches, mut bests): (Vec<Pose>, f64, Vec<f64>) = (Vec::new(), 0.0, Vec::new());
    for touch in touches {
        let moved = Pose::of(&touch.moved);
        let now = first_from_sensor.last().map_or(Pose::from_degrees(0.0, 0.0, 0.0), |before| before.then(&moved));
        let weight = first_from_sensor.iter().map(|before| new_share(before, &now, config)).fold(1.0, f64::min);
        n_touches += if is_far(&now, config, grid) { 0.0 } else { weight };
        first_from_sensor.push(now);
        let Logs { of_row, unknown, best, .. } = Logs::of(&shows, grid, touch, config, None);
        bests.extend(best);
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
    let joint = joint(n_touches, &bests, config);
    logs.iter_mut().for_each(|log| *log *= joint);
    normalise(&mut logs);
    logs
}

/// Whether no recorded view is near, wherever the first touch was: the touch does not count.
pub fn is_far(first_from_sensor: &Pose, config: &TouchModel, grid: &PoseGrid) -> bool {
    let rim_mm = grid.xy_step_mm * (8.0 * config.nearest_tolerance).max(2.0);
    first_from_sensor.x.hypot(first_from_sensor.y) > 8.0_f64.sqrt() * grid.xy_half_mm + rim_mm
}

/// The power to which the likelihood of each touch is taken: touches that share an error count as fewer, the more so
/// the less the best views of the edged ones are like them. `n_touches`: the sum of what is new in each.
pub fn joint(n_touches: f64, bests: &[f64], config: &TouchModel) -> f64 {
    (1.0 + (config.shared_error * (1.0 + 5.0 * doubt(bests))).min(1.0) * (n_touches - 1.0).max(0.0)).recip()
}

/// How far the best cosines of the edged touches say that the network does not know what it is shown, 0..=1.
pub fn doubt(bests: &[f64]) -> f64 {
    let mean = bests.iter().sum::<f64>() / bests.len() as f64;
    if bests.is_empty() { 0.0 } else { ((0.92 - mean) / 0.22).clamp(0.0, 1.0) }
}

/// The probability that a view beyond the grid is blank: as its recorded border, at least a half.
pub fn beyond_is_blank(shows: &[Option<bool>], grid: &PoseGrid, config: &TouchModel) -> f64 {
    let poses = poses(grid);
    let is_border = |pose: &Pose| (pose.x.abs().max(pose.y.abs()) - grid.xy_half_mm).abs() < 1e-9;
    let border = shows.chunks_exact(poses.len()).flat_map(|of_part| of_part.iter().zip(&poses));
    let border: Vec<bool> = border.filter(|(_, pose)| is_border(pose)).filter_map(|(is_edged, _)| *is_edged).collect();
    let n_blank = border.iter().filter(|is_edged| !**is_edged).count();
    (n_blank as f64 / (border.len() as f64).max(1.0)).min(config.blank_agreement).max(0.5)
}

/// Makes exp of the logs sum to 1.
pub fn normalise(logs: &mut [f64]) {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
    logs.iter_mut().for_each(|log| *log -= largest + sum.ln());
}

/// The log-likelihoods of a touch.
pub struct Logs {
    /// At each row: agreement about blankness, and among edged views the match relative to its mean; unknown where the
    /// row was not recorded.
    pub of_row: Vec<f64>,
    /// Where the view is unknown: blank or not, and if not as an average row or as one of a given cosine.
    pub unknown: f64,
    /// The plain cosine with the edged row that is most like it, of a touch that shows an edge.
    pub best: Option<f64>,
    /// The cosine from which matches are measured.
    pub reference: f64,
    /// The log of the mean match.
    pub log_mean: f64,
}

impl Logs {
    /// `shows`: whether each row shows an edge, `[n_rows]`; `None` where it was not recorded.
    pub fn of(
        shows: &[Option<bool>],
        grid: &PoseGrid,
        touch: &Touch,
        config: &TouchModel,
        unknown: Option<f64>,
    ) -> Self {
        let is_edged = touch.edge_share >= config.blank_share;
        let edged: Vec<f64> =
            shows.iter().zip(&touch.cosines).filter(|(shows, _)| **shows == Some(true)).map(|(_, cos)| *cos).collect();
        let best = edged.iter().copied().fold(-1.0, f64::max);
        // Cosines are in f32.
        let unknown = unknown.map(|cosine| f64::from(cosine as f32));
        let reference = unknown.map_or(best, |unknown| unknown.max(best));
        // No cosine is above the reference: the plain mean is safe. An unknown view is one more.
        let alike = edged.into_iter().chain(unknown);
        let powers: Vec<f64> = alike.map(|cosine| ((cosine - reference) / config.temperature).exp()).collect();
        let log_mean = (powers.iter().sum::<f64>() / powers.len() as f64).ln();
        let beyond_is_blank = beyond_is_blank(shows, grid, config);
        let plain = touch.plain.as_ref().unwrap_or(&touch.cosines);
        let is_best = |row: &usize| shows[*row] == Some(true) && touch.cosines[*row] == best;
        let best = is_edged.then(|| (0..shows.len()).find(is_best).map_or(-1.0, |row| plain[row]));
        let mut logs = Self { of_row: Vec::new(), unknown: 0.0, best, reference, log_mean };
        logs.unknown = match is_edged {
            false => beyond_is_blank.ln(),
            // Four in five as an average row.
            true => {
                let likely = unknown.map_or(0.0, |one| (0.8 + 0.2 * logs.of_match(one, config).exp()).ln());
                (1.0 - beyond_is_blank).ln() + likely
            }
        };
        let agreement = config.blank_agreement;
        let of_row = |(shows, cosine): (&Option<bool>, &f64)| match (shows, is_edged) {
            (None, _) => logs.unknown,
            (Some(true), true) => agreement.ln() + logs.of_match(*cosine, config),
            (Some(false), false) => agreement.ln(),
            _ => (1.0 - agreement).ln(),
        };
        logs.of_row = shows.iter().zip(&touch.cosines).map(of_row).collect();
        logs
    }

    /// The log-likelihood of an edged touch at an edged view of this cosine, but for their agreement.
    pub fn of_match(&self, cosine: f64, config: &TouchModel) -> f64 {
        let share = config.outlier_share;
        log_sum((1.0 - share).ln() + (cosine - self.reference) / config.temperature - self.log_mean, share.ln())
    }
}

/// log(exp(a) + exp(b)), either of them -inf.
pub fn log_sum(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if high == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

/// The share of a touch's evidence that an earlier one did not give.
pub fn new_share(before: &Pose, now: &Pose, config: &TouchModel) -> f64 {
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
        let config = TouchModel { temperature: 0.1, outlier_share: 0.01, ..TouchModel::default() };
        let touch = Touch { moved: Se2::IDENTITY, edge_share: 0.2, cosines: vec![1.0, 0.8], plain: None };
        let logs = log_posterior(&ONE_POSE, &[0.2, 0.2], &[touch], &config);
        let (best, other) = (1.0, (-2.0_f64).exp());
        let look = |alike: f64| 0.99 * alike / ((best + other) / 2.0) + 0.01;
        let odds = look(best) / look(other);
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

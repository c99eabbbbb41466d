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
/// The view at a pose is that of the nearest recorded one. Equal parts of a full turn's grid that meet at half a turn
/// must be recorded alike.
pub fn log_posterior(grid: &PoseGrid, edge_shares: &[f32], touches: &[Touch], config: &LikelihoodConfig) -> Vec<f64> {
    let recorded = poses(grid);
    let mut logs = vec![0.0; edge_shares.len()];
    let (mut first_from_sensor, mut n_touches, mut bests): (Vec<Pose>, f64, Vec<f64>) = (Vec::new(), 0.0, Vec::new());
    for touch in touches {
        let moved = Pose::of(&touch.moved);
        let now = first_from_sensor.last().map_or(Pose::from_degrees(0.0, 0.0, 0.0), |before| before.then(&moved));
        let weight = first_from_sensor.iter().map(|before| new_share(before, &now, config)).fold(1.0, f64::min);
        n_touches += if is_far(&now, config, grid) { 0.0 } else { weight };
        first_from_sensor.push(now);
        let Logs { of_row, unknown, best, .. } = Logs::of(edge_shares, grid, touch, config, None);
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
    weigh_together(&mut logs, n_touches, &bests, config);
    normalise(&mut logs);
    logs
}

/// Whether no recorded view is near, wherever the first touch was: the touch does not count.
fn is_far(first_from_sensor: &Pose, config: &LikelihoodConfig, grid: &PoseGrid) -> bool {
    let rim_mm = grid.xy_step_mm * (8.0 * config.nearest_tolerance).max(2.0);
    first_from_sensor.x.hypot(first_from_sensor.y) > 8.0_f64.sqrt() * grid.xy_half_mm + rim_mm
}

/// Touches that share an error count as fewer, the more so the less the best views of the edged ones are like them.
fn weigh_together(logs: &mut [f64], n_touches: f64, bests: &[f64], config: &LikelihoodConfig) {
    let mean = bests.iter().sum::<f64>() / bests.len() as f64;
    let doubt = if bests.is_empty() { 0.0 } else { (0.95 - mean).clamp(0.0, 0.25) / 0.25 };
    let n_alike = 1.0 + (config.shared_error * (1.0 + 5.0 * doubt)).min(1.0) * (n_touches - 1.0).max(0.0);
    logs.iter_mut().for_each(|log| *log /= n_alike);
}

/// The probability that a view beyond the grid is blank: as its border, at least a half.
fn beyond_is_blank(edge_shares: &[f32], grid: &PoseGrid, config: &LikelihoodConfig) -> f64 {
    let poses = poses(grid);
    let is_border = |pose: &Pose| (pose.x.abs().max(pose.y.abs()) - grid.xy_half_mm).abs() < 1e-9;
    let border = edge_shares.chunks_exact(poses.len()).flat_map(|of_part| of_part.iter().zip(&poses));
    let border: Vec<f32> = border.filter(|(_, pose)| is_border(pose)).map(|(share, _)| *share).collect();
    let n_blank = border.iter().filter(|share| **share < config.blank_share).count();
    (n_blank as f64 / border.len() as f64).min(config.blank_agreement).max(0.5)
}

/// Makes exp of the logs sum to 1.
pub fn normalise(logs: &mut [f64]) {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
    logs.iter_mut().for_each(|log| *log -= largest + sum.ln());
}

/// The log-likelihoods of a touch.
struct Logs {
    /// At each row: agreement about blankness, and among edged views the match relative to its mean.
    of_row: Vec<f64>,
    /// Where the view is unknown: blank or not, and if not as an average row or as one of a given cosine.
    unknown: f64,
    /// The largest cosine with an edged row, of a touch that shows an edge.
    best: Option<f64>,
    /// The cosine from which matches are measured, and the log-likelihood there.
    #[cfg(test)]
    reference: [f64; 2],
}

impl Logs {
    fn of(
        edge_shares: &[f32],
        grid: &PoseGrid,
        touch: &Touch,
        config: &LikelihoodConfig,
        unknown: Option<f64>,
    ) -> Self {
        let is_blank = |share: f32| share < config.blank_share;
        let best = (0..edge_shares.len())
            .filter(|row| !is_blank(edge_shares[*row]))
            .map(|row| touch.cosines[row])
            .fold(-1.0, f64::max);
        // Cosines are in f32.
        let unknown = unknown.map(|cosine| f64::from(cosine as f32));
        let reference = unknown.map_or(best, |unknown| unknown.max(best));
        let edged: Vec<usize> = (0..edge_shares.len()).filter(|row| !is_blank(edge_shares[*row])).collect();
        // No cosine is above the reference: the plain mean is safe. An unknown view is one more.
        let alike = edged.iter().map(|row| touch.cosines[*row]).chain(unknown);
        let powers: Vec<f64> = alike.map(|cosine| ((cosine - reference) / config.temperature).exp()).collect();
        let log_mean = (powers.iter().sum::<f64>() / powers.len() as f64).ln();
        let share = config.outlier_share;
        let log_of = |cosine: f64| {
            log_sum((1.0 - share).ln() + (cosine - reference) / config.temperature - log_mean, share.ln())
        };
        let log_match = |row: usize| log_of(touch.cosines[row]);
        let agreement = config.blank_agreement;
        let of_row = (0..edge_shares.len())
            .map(|row| match (is_blank(edge_shares[row]), is_blank(touch.edge_share)) {
                (false, false) => agreement.ln() + log_match(row),
                (true, true) => agreement.ln(),
                _ => (1.0 - agreement).ln(),
            })
            .collect();
        let beyond_is_blank = beyond_is_blank(edge_shares, grid, config);
        let unknown = match is_blank(touch.edge_share) {
            true => beyond_is_blank.ln(),
            // Four in five as an average row.
            false => (1.0 - beyond_is_blank).ln() + unknown.map_or(0.0, |one| (0.8 + 0.2 * log_of(one).exp()).ln()),
        };
        Self {
            of_row,
            unknown,
            best: (!is_blank(touch.edge_share)).then_some(best),
            #[cfg(test)]
            reference: [reference, log_mean],
        }
    }
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
    use super::super::sample::Sample;
    use super::*;
    use tactile_filter::Observation;
    use tactile_filter::belief::Belief;
    use tactile_filter::interpolation::Interpolation;
    use tactile_filter::likelihood::TouchLikelihood;

    const ONE_POSE: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

    #[test]
    fn two_parts_and_one_touch_by_hand() {
        let config = LikelihoodConfig { temperature: 0.1, outlier_share: 0.01, ..LikelihoodConfig::default() };
        let touch = Touch { moved: Se2::IDENTITY, edge_share: 0.2, cosines: vec![1.0, 0.8] };
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

    /// Fine enough for views to be interpolated between its poses.
    const FINE: PoseGrid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };

    /// Where a value is among the recorded ones of an axis.
    struct Place {
        /// How much each recorded value counts, `[n]`.
        weights: Vec<f64>,
        nearest: usize,
        /// Steps outside the recorded range.
        outside: f64,
    }

    /// Catmull and Rom's spline from its definition: Hermite's cubic between two points, whose slopes are half the
    /// difference of their neighbours; beyond a border the parabola through the last three points goes on.
    fn spline(value: f64, half: f64, step: f64) -> Place {
        let n = (2.0 * half / step).round() as usize + 1;
        let place = (value + half) / step;
        let inside = place.clamp(0.0, (n - 1) as f64);
        let low = (inside.floor() as usize).min(n - 2);
        let t = inside - low as f64;
        let weight = |of: usize| {
            let at = |index: usize| f64::from(u8::from(index == of));
            let before = if low == 0 { 3.0 * at(0) - 3.0 * at(1) + at(2) } else { at(low - 1) };
            let after = if low + 2 == n { 3.0 * at(n - 1) - 3.0 * at(n - 2) + at(n - 3) } else { at(low + 2) };
            let (from, to) = (at(low), at(low + 1));
            let (from_slope, to_slope) = ((to - before) / 2.0, (after - from) / 2.0);
            (2.0 * t.powi(3) - 3.0 * t * t + 1.0) * from
                + (t.powi(3) - 2.0 * t * t + t) * from_slope
                + (3.0 * t * t - 2.0 * t.powi(3)) * to
                + (t.powi(3) - t * t) * to_slope
        };
        Place {
            weights: (0..n).map(weight).collect(),
            nearest: (inside + 0.5).floor() as usize,
            outside: place - inside,
        }
    }

    /// The embedding at a pose, from weights of the recorded ones of one part along x, y and theta.
    fn embedding(rows: &[f32], dim: usize, [x, y, theta]: [&[f64]; 3]) -> Vec<f64> {
        let mut sum = vec![0.0; dim];
        for (cell, row) in rows.chunks_exact(dim).enumerate() {
            let (place, k) = (cell / theta.len(), cell % theta.len());
            let weight = x[place / y.len()] * y[place % y.len()] * theta[k];
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * f64::from(*value));
        }
        sum
    }

    /// What a view may count with: 0.1 above the best of the recorded ones of its part with an x that counts, and of those with
    /// such a y, at the angles that count.
    fn most_on_lines(cosines: &[f64], [x, y, theta]: [&Place; 3]) -> f64 {
        let counts = |place: &Place, index: usize| place.weights[index].abs() > 1e-6;
        let best = |is_on_line: &dyn Fn(usize, usize) -> bool| {
            let n = theta.weights.len();
            let on_line = |cell: &usize| is_on_line(cell / n / y.weights.len(), cell / n % y.weights.len());
            let around = (0..cosines.len()).filter(|cell| counts(theta, cell % n)).filter(on_line);
            around.map(|cell| cosines[cell]).fold(-1.0, f64::max)
        };
        (best(&|of_x, _| counts(x, of_x)).min(best(&|_, of_y| counts(y, of_y))) + 0.1).min(1.0)
    }

    fn length(vector: &[f64]) -> f64 {
        vector.iter().map(|value| value * value).sum::<f64>().sqrt()
    }

    /// The log-posterior of each state where views are interpolated: the cosine with the interpolated embedding, whose
    /// length is the product of its lengths along each axis through the nearest recorded pose.
    fn log_posterior_between(sample: &Sample, states: &PoseGrid, config: &LikelihoodConfig) -> Vec<f64> {
        let n_views = sample.grid.len();
        let mut logs = vec![0.0; sample.n_parts * states.len()];
        let (mut first_from_sensor, mut n_touches, mut bests) = (Vec::<Pose>::new(), 0.0, Vec::new());
        for (moved, observation) in &sample.touches {
            let now = first_from_sensor.last().map_or(Pose::of(moved), |before| before.then(&Pose::of(moved)));
            let weight = first_from_sensor.iter().map(|before| new_share(before, &now, config)).fold(1.0, f64::min);
            n_touches += if is_far(&now, config, &sample.grid) { 0.0 } else { weight };
            first_from_sensor.push(now);
            let query: Vec<f64> = observation.query.iter().map(|value| f64::from(*value)).collect();
            let (edge_share, recorded) = (observation.edge_share, cosines(&sample.rows, &observation.query));
            let touch = Touch { moved: *moved, edge_share, cosines: recorded };
            let Logs { of_row, unknown, best, reference: [reference, log_mean] } =
                Logs::of(&sample.edge_shares, &sample.grid, &touch, config, config.unknown_similarity);
            bests.extend(best);
            let share = config.outlier_share;
            for (cell, first) in poses(states).iter().enumerate() {
                let pose = first.then(&now);
                let degrees = pose.turn[1].atan2(pose.turn[0]).to_degrees();
                let [x, y] = [pose.x, pose.y].map(|mm| spline(mm, sample.grid.xy_half_mm, sample.grid.xy_step_mm));
                let theta = spline(degrees, sample.grid.theta_half_deg, sample.grid.theta_step_deg);
                let steps = (x.outside.powi(2) + y.outside.powi(2) + theta.outside.powi(2)).sqrt();
                let trust = if steps > 1.0 { 0.0 } else { (-0.5 * (steps / 0.5).powi(2)).exp() };
                let row = (x.nearest * y.weights.len() + y.nearest) * theta.weights.len() + theta.nearest;
                for part in 0..sample.n_parts {
                    let rows = &sample.rows[part * n_views * sample.dim..][..n_views * sample.dim];
                    let mut log = of_row[part * n_views + row];
                    let is_edged = sample.edge_shares[part * n_views + row] >= config.blank_share;
                    if is_edged && edge_share >= config.blank_share {
                        let one = |of: &Place| -> Vec<f64> {
                            (0..of.weights.len()).map(|index| f64::from(u8::from(index == of.nearest))).collect()
                        };
                        let of = |weights| embedding(rows, sample.dim, weights);
                        let (w, ones) = ([&x.weights[..], &y.weights, &theta.weights], [one(&x), one(&y), one(&theta)]);
                        let along_x = length(&of([w[0], &ones[1], &ones[2]]));
                        let along_y = length(&of([&ones[0], w[1], &ones[2]]));
                        let along_theta = length(&of([&ones[0], &ones[1], w[2]]));
                        let inner: f64 = of(w).iter().zip(&query).map(|(a, b)| a * b).sum();
                        let cosine = inner / length(&query) / (along_x * along_y * along_theta).max(0.3);
                        let most = most_on_lines(&touch.cosines[part * n_views..][..n_views], [&x, &y, &theta]);
                        let above = (cosine.clamp(-1.0, most) - reference) / config.temperature - log_mean;
                        log = config.blank_agreement.ln() + log_sum((1.0 - share).ln() + above, share.ln());
                    }
                    let mixed =
                        if trust > 0.0 { log_sum(trust.ln() + log, (1.0 - trust).ln() + unknown) } else { unknown };
                    logs[part * states.len() + cell] += unknown + weight * (mixed - unknown);
                }
            }
        }
        weigh_together(&mut logs, n_touches, &bests, config);
        normalise(&mut logs);
        logs
    }

    /// The largest relative error of the library's probabilities against the reference with another configuration.
    fn error_between(config: &LikelihoodConfig) -> f64 {
        let first = Se2::from_degrees(0.7, -1.1, 4.0);
        let motions = [Se2::from_degrees(1.9, 0.8, -7.0), Se2::from_degrees(-2.3, 1.7, 12.0)];
        let sample = Sample::along(2, FINE, 32, first, &motions, 5);
        let bank = sample.bank().unwrap();
        let likelihood = |touch: &Observation| TouchLikelihood::new(touch, &bank, config).unwrap();
        // Thirds of a step: no state is as near to one recorded pose as to the next.
        let mut belief = Belief::of_all_states(&bank, 3, likelihood(&sample.touches[0].1));
        sample.touches[1..].iter().for_each(|(moved, touch)| {
            belief.update(moved, likelihood(touch));
        });
        let expected = log_posterior_between(&sample, belief.grid(), config);
        let mut masses = vec![0.0; expected.len()];
        for (state, mass) in belief.states() {
            masses[state.part * belief.grid().len() + state.cell] = mass;
        }
        masses.iter().zip(expected).map(|(got, log)| (got / log.exp() - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn between_recorded_poses_the_posterior_is_that_of_the_spline() {
        // A cosine of 32 values is good to 2^-20; the spline's weights, whose sizes sum to 1.5 along an axis at most, make
        // that 1.5^3 times as much, and the three lengths, of 0.7 and more each, are as uncertain: 16 times 2^-20 in all.
        // Each of three touches divides twice and takes part in the sum of states.
        let config =
            LikelihoodConfig { temperature: 0.1, interpolation: Interpolation::Cubic, ..LikelihoodConfig::default() };
        let bound = (4.0 * 3.0 * 16.0 / (1 << 20) as f64 / config.temperature).exp_m1();
        let error = error_between(&config);
        assert!(error <= bound, "{error} > {bound}");
        let nearest = LikelihoodConfig { interpolation: Interpolation::Nearest, ..config };
        assert!(error_between(&nearest) > 100.0 * bound, "the nearest view is something else");
    }

    #[test]
    fn the_spline_goes_through_its_points_and_follows_parabolas() {
        for at in 0..=40 {
            let place = 0.1 * f64::from(at) - 2.0;
            let weights = spline(place, 2.0, 1.0).weights;
            let value: f64 = weights.iter().enumerate().map(|(k, weight)| weight * (k as f64 - 1.3).powi(2)).sum();
            assert!((value - (place + 0.7).powi(2)).abs() < 1e-12, "{place}");
        }
    }
}

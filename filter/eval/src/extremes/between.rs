//! Views between recorded ones from their definition, in f64 throughout: what users run, since banks are fine enough to
//! be interpolated.
//!
//! The cosine is that with the embedding that splines make of the recorded ones, whose length is the product of its
//! lengths along each axis through the nearest recorded pose. All four are found from cosines with the recorded views
//! and between them, which are f64: of a sum of embeddings, sums of inner products.

use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;
use tactile_filter::TouchModel;
use tactile_infer::between::Around;

use super::reference::{Logs, Pose, Touch, is_far, joint, log_sum, new_share, normalise, poses};

/// Along an axis, how far views count between which a spline runs: its four points.
const STEPS: usize = 3;

/// Parts of which nothing is known match with so much more variance than those calibrated on, a standard deviation.
pub const OTHER_PARTS: f64 = 0.0325;

/// The recorded views, and the settings that matches with them are judged by.
pub struct Recorded {
    /// Where they were recorded, of each part.
    pub grid: PoseGrid,
    /// Number of parts.
    pub n_parts: usize,
    /// Whether each row shows an edge, `[n_rows]`; `None` where it was not recorded.
    pub shows: Vec<Option<bool>>,
    /// As they are in the bank's metric.
    pub config: TouchModel,
    /// The cosine of each row with the one that is 1 to 3 steps further along each axis, `[axis][steps - 1][n_rows]`.
    further: [[Vec<f64>; STEPS]; 3],
}

impl Recorded {
    /// Rows, `[n_rows, dim]`, of which those of each part are in the order of the grid's cells.
    pub fn new(grid: PoseGrid, rows: &[f32], dim: usize, shows: Vec<Option<bool>>, config: TouchModel) -> Self {
        let row = |at: usize| &rows[at * dim..(at + 1) * dim];
        let products = |a: usize, b: usize| row(a).iter().zip(row(b)).map(|(a, b)| f64::from(*a) * f64::from(*b));
        let inner = |a: usize, b: usize| products(a, b).sum::<f64>();
        let lengths: Vec<f64> = (0..shows.len()).map(|at| inner(at, at).sqrt()).collect();
        let (n, strides) = ([grid.n_xy(), grid.n_xy(), grid.n_theta()], strides(&grid));
        let cosine = |at: usize, axis: usize, k: usize| {
            let is_inside = at / strides[axis] % n[axis] + k < n[axis];
            let further = at + k * strides[axis];
            if is_inside { inner(at, further) / (lengths[at] * lengths[further]) } else { f64::NAN }
        };
        let further = [0, 1, 2].map(|axis: usize| {
            [1, 2, 3].map(|k: usize| (0..shows.len()).map(|at| cosine(at, axis, k)).collect::<Vec<f64>>())
        });
        Self { grid, n_parts: shows.len() / grid.len(), shows, config, further }
    }

    /// The row of a part nearest to a place.
    pub fn row(&self, part: usize, [x, y, theta]: &[Place; 3]) -> usize {
        let of = strides(&self.grid);
        part * self.grid.len() + x.nearest * of[0] + y.nearest * of[1] + theta.nearest * of[2]
    }

    /// The cosine with the view of a part between the recorded ones, -1..=1, from those with all rows.
    pub fn cosine(&self, cosines: &[f64], part: usize, at: &[Place; 3]) -> f64 {
        let (first, of) = (part * self.grid.len(), strides(&self.grid));
        let mut inner = 0.0;
        for (x, wx) in &at[0].weights {
            for (y, wy) in &at[1].weights {
                for (theta, wt) in &at[2].weights {
                    inner += wx * wy * wt * cosines[first + x * of[0] + y * of[1] + theta * of[2]];
                }
            }
        }
        (inner / self.length(part, at).max(0.3)).clamp(-1.0, 1.0)
    }

    /// The length of the interpolated embedding.
    pub fn length(&self, part: usize, at: &[Place; 3]) -> f64 {
        let (row, of) = (self.row(part, at), strides(&self.grid));
        let along = |axis: usize| {
            let place = &at[axis];
            let base = row - place.nearest * of[axis];
            let cosine = |a: usize, b: usize| match a.abs_diff(b) {
                0 => 1.0,
                k => self.further[axis][k - 1][base + a.min(b) * of[axis]],
            };
            let pairs = place.weights.iter().flat_map(|a| place.weights.iter().map(move |b| (a, b)));
            pairs.map(|((a, wa), (b, wb))| wa * wb * cosine(*a, *b)).sum::<f64>().sqrt()
        };
        along(0) * along(1) * along(2)
    }

    /// What a view may count with where all states are judged at once: 0.1 above the best of the recorded ones of its
    /// part with an x that counts, and of those with such a y, at the angles that count.
    fn most(&self, cosines: &[f64], part: usize, at: &[Place; 3]) -> f64 {
        let (first, of, n) = (part * self.grid.len(), strides(&self.grid), self.grid.n_xy());
        let on_lines = |axis: usize, other: usize| {
            let mut best = -1.0_f64;
            for line in at[axis].counting() {
                for theta in at[2].counting() {
                    let start = first + line * of[axis] + theta * of[2];
                    (0..n).for_each(|place| best = best.max(cosines[start + place * of[other]]));
                }
            }
            best
        };
        (on_lines(0, 1).min(on_lines(1, 0)) + 0.1).min(1.0)
    }
}

/// How many rows apart neighbours along x, y and theta are.
fn strides(grid: &PoseGrid) -> [usize; 3] {
    [grid.n_xy() * grid.n_theta(), grid.n_theta(), 1]
}

/// Where a value is among the recorded ones of an axis.
#[derive(Clone, Debug)]
pub struct Place {
    /// The rows that count, and how much each does.
    pub weights: Vec<(usize, f64)>,
    /// The nearest.
    pub nearest: usize,
    /// Steps outside the recorded range.
    pub outside: f64,
}

impl Place {
    /// Catmull and Rom's spline from its definition: Hermite's cubic between two points, whose slopes are half the
    /// difference of their neighbours; beyond a border the parabola through the last three points goes on, through two
    /// a line. At the border of a full turn too: where such a grid is to go round, `before` and `after` are its other
    /// end's.
    ///
    /// `library`: the value as the library computes it. Where two recorded values are equally near, which is the
    /// nearest is a matter of rounding, and either is right: its choice counts.
    fn new([value, library]: [f64; 2], half: f64, step: f64) -> Self {
        let n = (2.0 * half / step).round() as usize + 1;
        let place = (value + half) / step;
        let inside = place.clamp(0.0, (n - 1) as f64);
        let is_tie = (inside.fract() - 0.5).abs() < 1e-9;
        let nearest = if is_tie { Around::new(library, half, step, n).nearest } else { inside.round() as usize };
        let outside = place - inside;
        if n == 1 {
            return Self { weights: vec![(0, 1.0)], nearest, outside };
        }
        let low = (inside.floor() as usize).min(n - 2);
        let t = inside - low as f64;
        let weight = |of: usize| {
            let at = |index: usize| f64::from(u8::from(index == of));
            let beyond = |edge: usize, next: usize, last: usize| match n {
                2 => 2.0 * at(edge) - at(next),
                _ => 3.0 * at(edge) - 3.0 * at(next) + at(last),
            };
            let before = if low == 0 { beyond(0, 1, 2) } else { at(low - 1) };
            let after = if low + 2 == n { beyond(n - 1, n - 2, n.saturating_sub(3)) } else { at(low + 2) };
            let (from, to) = (at(low), at(low + 1));
            let (from_slope, to_slope) = ((to - before) / 2.0, (after - from) / 2.0);
            (2.0 * t.powi(3) - 3.0 * t * t + 1.0) * from
                + (t.powi(3) - 2.0 * t * t + t) * from_slope
                + (3.0 * t * t - 2.0 * t.powi(3)) * to
                + (t.powi(3) - t * t) * to_slope
        };
        let around = low.saturating_sub(1)..(low + 3).min(n);
        let weights = around.map(|index| (index, weight(index))).filter(|(_, weight)| *weight != 0.0).collect();
        Self { weights, nearest, outside }
    }

    /// Along x, y and theta.
    pub fn of_pose(grid: &PoseGrid, pose: &Pose, library: &Se2) -> [Self; 3] {
        let degrees = pose.turn[1].atan2(pose.turn[0]).to_degrees();
        let (half, step) = (grid.xy_half_mm, grid.xy_step_mm);
        let [x, y] = [[pose.x, library.x_mm], [pose.y, library.y_mm]].map(|values| Self::new(values, half, step));
        [x, y, Self::new([degrees, library.theta_deg()], grid.theta_half_deg, grid.theta_step_deg)]
    }

    /// The recorded values with more than a millionth of the weight; the nearest is one of them.
    fn counting(&self) -> impl Iterator<Item = usize> + '_ {
        let others = self.weights.iter().filter(|(index, weight)| weight.abs() > 1e-6 && *index != self.nearest);
        others.map(|(index, _)| *index).chain([self.nearest])
    }
}

/// How far a view is trusted: less and less outside the recorded area, and from one step on not at all.
fn trust(at: &[Place; 3]) -> f64 {
    let steps = at.iter().map(|place| place.outside.powi(2)).sum::<f64>().sqrt();
    if steps > 1.0 { 0.0 } else { (-0.5 * (steps / 0.5).powi(2)).exp() }
}

/// A touch, judged by the recorded views.
pub struct Judged {
    /// The sensor's motion since the first touch.
    now: Pose,
    /// The same as the library composes it, for [`Place::new`].
    moved: Se2,
    /// What is new in it, 0..=1.
    pub weight: f64,
    /// The cosine with each row, `[n_rows]`.
    pub cosines: Vec<f64>,
    /// Whether it shows an edge.
    pub is_edged: bool,
    /// What matches are measured by.
    pub logs: Logs,
}

/// All touches of an episode, judged.
pub struct Evidence<'a> {
    /// The recorded views.
    pub recorded: &'a Recorded,
    /// In order.
    pub touches: Vec<Judged>,
    /// The power to which the likelihood of each is taken.
    pub joint: f64,
}

impl<'a> Evidence<'a> {
    /// Judges touches.
    pub fn new(recorded: &'a Recorded, touches: &[Touch]) -> Self {
        let Recorded { grid, shows, config, .. } = recorded;
        let mut judged: Vec<Judged> = Vec::new();
        for touch in touches {
            let last = judged.last();
            let now = last.map_or(Pose::of(&touch.moved), |last| last.now.then(&Pose::of(&touch.moved)));
            let moved = last.map_or(touch.moved, |last| last.moved * touch.moved);
            let new = judged.iter().map(|before| new_share(&before.now, &now, config)).fold(1.0, f64::min);
            let weight = if is_far(&now, config, grid) { 0.0 } else { new };
            let logs = Logs::of(shows, grid, touch, config, config.unknown_similarity);
            let is_edged = touch.edge_share >= config.blank_share;
            judged.push(Judged { now, moved, weight, cosines: touch.cosines.clone(), is_edged, logs });
        }
        let bests: Vec<f64> = judged.iter().filter_map(|touch| touch.logs.best).collect();
        let joint = joint(judged.iter().map(|touch| touch.weight).sum(), &bests, config);
        Self { recorded, touches: judged, joint }
    }

    /// Where a touch was made on a part whose first touch was at a pose.
    fn places(&self, touch: &Judged, first: &Pose, library: &Se2) -> [Place; 3] {
        Place::of_pose(&self.recorded.grid, &first.then(&touch.now), &(*library * touch.moved))
    }

    /// The log-likelihood of a touch there. `is_capped`: where all states are judged at once a view counts no more than
    /// its neighbours allow.
    fn log_at(&self, touch: &Judged, part: usize, at: &[Place; 3], is_capped: bool) -> f64 {
        let Recorded { shows, config, .. } = self.recorded;
        let (row, trust, unknown) = (self.recorded.row(part, at), trust(at), touch.logs.unknown);
        if trust == 0.0 || touch.weight == 0.0 {
            return unknown;
        }
        let log = if shows[row] == Some(true) && touch.is_edged {
            let cosine = self.recorded.cosine(&touch.cosines, part, at);
            let most = if is_capped { self.recorded.most(&touch.cosines, part, at) } else { 1.0 };
            config.blank_agreement.ln() + touch.logs.of_match(cosine.min(most), config)
        } else {
            touch.logs.of_row[row]
        };
        let mixed = log_sum(trust.ln() + log, (1.0 - trust).ln() + unknown);
        unknown + touch.weight * (mixed - unknown)
    }

    /// The sum of the log-likelihoods of all touches, at any pose of the first.
    pub fn log_of(&self, part: usize, first: &Pose, library: &Se2) -> f64 {
        let log = |touch| self.log_at(touch, part, &self.places(touch, first, library), false);
        self.touches.iter().map(log).sum()
    }

    /// The belief in all states.
    pub fn posterior(&self, states: &PoseGrid) -> Posterior {
        let mut logs = vec![0.0; self.recorded.n_parts * states.len()];
        for (cell, first) in poses(states).iter().enumerate() {
            for touch in &self.touches {
                let at = self.places(touch, first, &states.pose(cell));
                for (part, log) in logs.iter_mut().skip(cell).step_by(states.len()).enumerate() {
                    *log += self.log_at(touch, part, &at, true);
                }
            }
        }
        logs.iter_mut().for_each(|log| *log *= self.joint);
        let (first, n) = (logs[0], logs.len() as f64);
        normalise(&mut logs);
        // What normalising took off, and the mean over the states.
        Posterior { log_evidence: first - logs[0] - n.ln(), logs, n_cells: states.len() }
    }

    /// How well a part at a pose of the first touch explains the edged ones: the mean of how many standard deviations
    /// the cosine is above that of a true view, in standard deviations of such a mean.
    pub fn fit(&self, part: usize, first: &Se2) -> Option<f64> {
        let TouchModel { matched_mean, matched_sd, matched_shared, .. } = self.recorded.config;
        let score = |touch: &Judged| {
            let at = self.places(touch, &Pose::of(first), first);
            let is_inside = at.iter().all(|place| place.outside.abs() < 1e-6);
            let cosine = || self.recorded.cosine(&touch.cosines, part, &at);
            let is_edged = self.recorded.shows[self.recorded.row(part, &at)].filter(|_| touch.is_edged && is_inside)?;
            let score = if is_edged { (cosine() - matched_mean) / matched_sd.hypot(OTHER_PARTS) } else { -3.0 };
            Some(score.max(-6.0))
        };
        let scores: Vec<f64> = self.touches.iter().filter_map(score).collect();
        let n = scores.len() as f64;
        let of_mean = (matched_shared + (1.0 - matched_shared) / n).sqrt();
        (n > 0.0).then(|| scores.iter().sum::<f64>() / n / of_mean)
    }
}

/// The probability of each state, and of all touches.
pub struct Posterior {
    /// Logs of the probabilities, `[n_parts, n_cells]`.
    pub logs: Vec<f64>,
    /// The log of the mean likelihood of all touches, as they count together, over all states.
    pub log_evidence: f64,
    n_cells: usize,
}

impl Posterior {
    /// The probability of each part, `[n_parts]`.
    pub fn of_parts(&self) -> Vec<f64> {
        self.logs.chunks_exact(self.n_cells).map(|logs| logs.iter().map(|log| log.exp()).sum()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_goes_through_its_points_and_follows_parabolas() {
        for at in 0..=40 {
            let place = 0.1 * f64::from(at) - 2.0;
            let weights = Place::new([place; 2], 2.0, 1.0).weights;
            let value: f64 = weights.iter().map(|(k, weight)| weight * (*k as f64 - 1.3).powi(2)).sum();
            assert!((value - (place + 0.7).powi(2)).abs() < 1e-12, "{place}");
        }
    }

    /// By the embeddings themselves: summed with their weights, and measured.
    #[test]
    fn cosines_are_those_with_interpolated_embeddings() {
        const DIM: usize = 6;
        let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let mut rows: Vec<f32> = (0..2 * grid.len() * DIM).map(|i| ((i * i % 997) as f32 * 0.37).sin()).collect();
        for row in rows.chunks_exact_mut(DIM) {
            let length = row.iter().map(|value| value * value).sum::<f32>().sqrt();
            row.iter_mut().for_each(|value| *value /= length);
        }
        let query: Vec<f64> = (0..DIM).map(|i| (0.9 * i as f64).cos()).collect();
        let length = |vector: &[f64]| vector.iter().map(|value| value * value).sum::<f64>().sqrt();
        let inner = |row: &[f32]| row.iter().zip(&query).map(|(a, b)| f64::from(*a) * b).sum::<f64>() / length(&query);
        let cosines: Vec<f64> = rows.chunks_exact(DIM).map(inner).collect();
        let shows = vec![Some(true); 2 * grid.len()];
        let recorded = Recorded::new(grid, &rows, DIM, shows, TouchModel::default());
        for (x, y, theta) in [(0.7, -1.1, 4.0), (3.9, 0.2, -28.0), (-4.0, 2.0, 0.0), (-3.1, -3.7, 22.0)] {
            let pose = Pose::from_degrees(x, y, theta);
            let at = Place::of_pose(&grid, &pose, &Se2::from_degrees(x, y, theta));
            let one = |place: &Place| vec![(place.nearest, 1.0)];
            let embedding = |[x, y, theta]: [&[(usize, f64)]; 3]| {
                let mut sum = vec![0.0; DIM];
                for (x, wx) in x {
                    for (y, wy) in y {
                        for (theta, wt) in theta {
                            let row = &rows[(grid.len() + (x * 5 + y) * 5 + theta) * DIM..][..DIM];
                            let weight = wx * wy * wt;
                            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * f64::from(*value));
                        }
                    }
                }
                sum
            };
            let [ones_x, ones_y, ones_theta] = [0, 1, 2].map(|axis: usize| one(&at[axis]));
            let [wx, wy, wt] = [0, 1, 2].map(|axis: usize| at[axis].weights.as_slice());
            let lengths = [[wx, &ones_y, &ones_theta], [&ones_x, wy, &ones_theta], [&ones_x, &ones_y, wt]];
            let expected_length: f64 = lengths.into_iter().map(|weights| length(&embedding(weights))).product();
            let sum: f64 = embedding([wx, wy, wt]).iter().zip(&query).map(|(a, b)| a * b).sum();
            let expected = (sum / length(&query) / expected_length.max(0.3)).clamp(-1.0, 1.0);
            assert!((recorded.cosine(&cosines, 1, &at) - expected).abs() < 1e-6, "{x} {y} {theta}");
        }
    }
}

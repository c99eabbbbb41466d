//! The touches of an episode, judged by the recorded views and between them: the belief in all states.

use std::cell::Cell;

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;

use super::between::Recorded;
use super::place::{Place, trust};
use super::reference::{Likelihood, Pose, Touch, U, is_far, log_sum, new_share, normalise, poses};

/// A match that is no more than so many nats likelier than an outlier is taken for one, where all states are judged at
/// once.
const OF_OUTLIERS: f64 = 2e-3;

/// A touch, judged by the recorded views.
pub struct Judged {
    /// The sensor's motion since the first touch.
    pub now: Pose,
    /// The same as the library composes it, for [`Place::new`].
    moved: Se2,
    /// How much of it is new, 0..=1: the power to which its likelihood is taken.
    pub weight: f64,
    /// The cosine with each row, `[n_rows]`.
    pub cosines: Vec<f64>,
    /// Whether it shows an edge.
    pub is_edged: bool,
    /// How rare it is, nats.
    pub rarity: f64,
    /// How likely it is at a view.
    pub likelihood: Likelihood,
}

/// All touches of an episode, judged.
pub struct Evidence<'a> {
    /// The recorded views.
    pub recorded: &'a Recorded,
    /// In order.
    pub touches: Vec<Judged>,
    /// How far a cosine between recorded views may be off.
    pub between_off: f64,
    /// The largest error of the sums that [`Self::log_of`] was asked for, nats.
    pub largest_off: Cell<f64>,
}

/// A log-likelihood, and how far the filter's may be off.
#[derive(Clone, Copy, Default)]
struct Log {
    log: f64,
    off: f64,
}

impl<'a> Evidence<'a> {
    /// Judges touches. `errors`: how far a cosine with a recorded view may be off, and one between two of them.
    pub fn new(recorded: &'a Recorded, touches: &[Touch], errors: [f64; 2]) -> Self {
        let Recorded { grid, is_recorded, config, .. } = recorded;
        let mut judged: Vec<Judged> = Vec::new();
        for touch in touches {
            let last = judged.last();
            let now = last.map_or(Pose::of(&touch.moved), |last| last.now.then(&Pose::of(&touch.moved)));
            let moved = last.map_or(touch.moved, |last| last.moved * touch.moved);
            let new = judged.iter().map(|before| new_share(&before.now, &now, config)).fold(1.0, f64::min);
            let weight = if is_far(&now, config, grid) { 0.0 } else { new };
            let likelihood = Likelihood::of(touch, is_recorded, config, recorded.own_distance());
            let (is_edged, rarity) = (touch.edge_share >= config.blank_share, f64::from(touch.rarity));
            judged.push(Judged { now, moved, weight, cosines: touch.cosines.clone(), is_edged, rarity, likelihood });
        }
        let (between_off, largest_off) = (recorded.error_between(errors), Cell::default());
        Self { recorded, touches: judged, between_off, largest_off }
    }

    /// Where a touch was made on a part whose first touch was at a pose.
    fn places(&self, touch: &Judged, first: &Pose, library: &Se2) -> [Place; 3] {
        Place::of_pose(&self.recorded.grid, &first.then(&touch.now), &(*library * touch.moved))
    }

    /// The log-likelihood of a touch there. `of_all`: where all states are judged at once a view counts no more than
    /// its neighbours allow, logs are f32, and a match that is hardly likelier than an outlier is one.
    fn log_at(&self, touch: &Judged, part: usize, at: &[Place; 3], of_all: bool) -> Log {
        let (row, trust) = (self.recorded.row(part, at), trust(at));
        if trust == 0.0 || touch.weight == 0.0 || !self.recorded.is_recorded[row] {
            return Log::default();
        }
        let Judged { likelihood, cosines, weight, .. } = touch;
        let cosine = self.recorded.cosine(cosines, part, at);
        let cosine = if of_all { cosine.min(self.recorded.most(cosines, part, at)) } else { cosine };
        let of_f32 = match likelihood {
            // A few roundings of all that is added, of the root and of the function.
            Likelihood::Odds { outliers, .. } if of_all && *outliers > 0.0 => {
                U * (7.0 * likelihood.size() + 5.0) + OF_OUTLIERS
            }
            _ => 0.0,
        };
        let mixed = log_sum(trust.ln() + likelihood.log(cosine), (1.0 - trust).ln());
        let off = likelihood.off(cosine, self.between_off + U) + of_f32;
        Log { log: weight * mixed, off: weight * off }
    }

    /// The sum of the log-likelihoods of all touches, at any pose of the first.
    pub fn log_of(&self, part: usize, first: &Pose, library: &Se2) -> f64 {
        let log = |touch| self.log_at(touch, part, &self.places(touch, first, library), false);
        let (sum, off) =
            self.touches.iter().map(log).fold((0.0, 0.0), |(sum, all), Log { log, off }| (sum + log, all + off));
        self.largest_off.set(self.largest_off.get().max(off));
        sum
    }

    /// The belief in all states.
    pub fn posterior(&self, states: &PoseGrid) -> Posterior {
        let mut logs = vec![Log::default(); self.recorded.n_parts * states.len()];
        for (cell, first) in poses(states).iter().enumerate() {
            for touch in &self.touches {
                let at = self.places(touch, first, &states.pose(cell));
                for (part, sum) in logs.iter_mut().skip(cell).step_by(states.len()).enumerate() {
                    let Log { log, off } = self.log_at(touch, part, &at, true);
                    *sum = Log { log: sum.log + log, off: sum.off + off };
                }
            }
        }
        let off = logs.iter().map(|log| log.off).fold(0.0, f64::max);
        let mut logs: Vec<f64> = logs.into_iter().map(|Log { log, .. }| log).collect();
        let (first, n) = (logs[0], logs.len() as f64);
        normalise(&mut logs);
        // What normalising took off, and the mean over the states.
        Posterior { log_evidence: first - logs[0] - n.ln(), logs, off, n_cells: states.len() }
    }

    /// How well a part at a pose of the first touch explains the edged ones: the mean of how many standard deviations
    /// the cosine is above that of a true view, in standard deviations of such a mean; and how far that may be off.
    pub fn fit(&self, part: usize, first: &Se2) -> Option<[f64; 2]> {
        let [mean, sd] = self.recorded.expected(part);
        let score = |touch: &Judged| {
            let at = self.places(touch, &Pose::of(first), first);
            let is_inside = at.iter().all(|place| place.outside.abs() < 1e-6);
            let is_scored = touch.is_edged && is_inside && self.recorded.is_recorded[self.recorded.row(part, &at)];
            is_scored.then(|| ((self.recorded.cosine(&touch.cosines, part, &at) - mean) / sd).max(-6.0))
        };
        let scores: Vec<f64> = self.touches.iter().filter_map(score).collect();
        let (n, shared) = (scores.len() as f64, self.recorded.config.matched_shared);
        let of_mean = (shared + (1.0 - shared) / n).sqrt();
        (n > 0.0).then(|| [scores.iter().sum::<f64>() / n / of_mean, self.between_off / sd / of_mean])
    }
}

/// The probability of each state, and of all touches.
pub struct Posterior {
    /// Logs of the probabilities, `[n_parts, n_cells]`.
    pub logs: Vec<f64>,
    /// How far the log-likelihood of a state may be off, nats.
    pub off: f64,
    /// The log of the mean likelihood of all touches, as far as each counts, over all states.
    pub log_evidence: f64,
    n_cells: usize,
}

impl Posterior {
    /// The probability of each part, `[n_parts]`.
    pub fn of_parts(&self) -> Vec<f64> {
        self.logs.chunks_exact(self.n_cells).map(|logs| logs.iter().map(|log| log.exp()).sum()).collect()
    }
}

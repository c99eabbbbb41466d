//! One touch of an episode: where it was relative to the first, and how likely it is from each state.

use tactile_data::grid::{NearestCell, PoseGrid};
use tactile_data::se2::Se2;
use tactile_infer::calibration::Spread;

use crate::interpolation::{LatticeWeights, ViewWeights, in_planes};
use crate::likelihood::TouchLikelihood;
use crate::nearest::{Nearest, nearest_view, trusted};

/// A touch, judged from every state.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// The sensor's motion since the first touch.
    pub first_from_sensor: Se2,
    /// The touch's likelihood at each row of the bank.
    pub likelihood: TouchLikelihood,
    /// Share of its evidence that counts, 0..=1: less than 1 where it overlaps an earlier touch.
    pub weight: f64,
    cubic: bool,
    tolerance: f64,
}

impl Evidence {
    /// Judges a touch, with the share of its evidence that counts, from every state: each part at each pose of `states`,
    /// with the views of a bank whose grid is `grid`. `take` is given log p(touch | state) of one part after the other,
    /// `[n_cells]`.
    pub fn new(
        [grid, states]: [&PoseGrid; 2],
        first_from_sensor: Se2,
        weight: f64,
        likelihood: TouchLikelihood,
        take: &mut dyn FnMut(&[f64]),
    ) -> Self {
        let config = likelihood.config();
        let (cubic, tolerance) = (config.interpolation.is_cubic(grid), config.nearest_tolerance);
        let evidence = Self { first_from_sensor, likelihood, weight, cubic, tolerance };
        if cubic {
            evidence.judge_between(grid, states, take);
        } else {
            evidence.judge_nearest(grid, states, take);
        }
        evidence
    }

    /// Does what [`Self::new`] says by the nearest recorded views.
    fn judge_nearest(&self, grid: &PoseGrid, states: &PoseGrid, take: &mut dyn FnMut(&[f64])) {
        let cells = NearestCell::on(grid);
        let nearest = |cell| trusted(grid, &cells, &(states.pose(cell) * self.first_from_sensor), self.tolerance);
        let nearest: Vec<Option<Nearest>> = (0..states.len()).map(nearest).collect();
        for start in (0..self.likelihood.similarities.len()).step_by(grid.len()) {
            let log_of = |nearest: &Option<Nearest>| match nearest {
                Some(Nearest { cell, trust }) => self.log_trusted(self.likelihood.log_row(start + cell), *trust),
                None => self.likelihood.log_unknown,
            };
            take(&nearest.iter().map(log_of).collect::<Vec<_>>());
        }
    }

    /// Does what [`Self::new`] says between the recorded views.
    fn judge_between(&self, grid: &PoseGrid, states: &PoseGrid, take: &mut dyn FnMut(&[f64])) {
        let (n_views, n_angles) = (grid.len(), states.n_theta());
        // Which views are known is the same for every part.
        let lattices =
            (0..n_angles).map(|angle| (angle, LatticeWeights::of_states(grid, states, angle, &self.first_from_sensor)));
        let lattices: Vec<(usize, LatticeWeights)> = lattices.filter(|(_, lattice)| lattice.has_known()).collect();
        let n_places = states.len() / n_angles;
        // Angle slowest, as they are found.
        let mut log_lattices = vec![self.likelihood.log_unknown; states.len()];
        let mut log_part = log_lattices.clone();
        for (part, similarities) in self.likelihood.similarities.chunks_exact(n_views).enumerate() {
            // A blank touch is like every blank view.
            let planes = (!self.likelihood.blank).then(|| in_planes(similarities, grid));
            for (angle, lattice) in &lattices {
                let log_lattice = &mut log_lattices[angle * n_places..][..n_places];
                let matches = planes
                    .as_ref()
                    .map(|planes| self.likelihood.match_logs(&self.likelihood.on_lattice(lattice, part, planes)));
                lattice.for_each_known(|place, Nearest { cell, trust }| {
                    let row = part * n_views + cell;
                    let log = match &matches {
                        Some(logs) if self.likelihood.is_edged(row) => logs[place],
                        _ => self.likelihood.log_row(row),
                    };
                    log_lattice[place] = self.log_trusted(log, trust);
                });
            }
            for (place, logs) in log_part.chunks_exact_mut(n_angles).enumerate() {
                let of_place = log_lattices[place..].iter().step_by(n_places);
                logs.iter_mut().zip(of_place).for_each(|(log, found)| *log = *found);
            }
            take(&log_part);
        }
    }

    /// Adds log p(touch | part and pose of the first touch) at every pose of a lattice, any x and y in mm and angles in
    /// radians, to `sums`, `[n_x, n_y, n_theta]`.
    pub fn add_logs(&self, grid: &PoseGrid, part: usize, [xs, ys, thetas]: [&[f64]; 3], sums: &mut [f64]) {
        for (k, theta) in thetas.iter().enumerate() {
            let turned = Se2::new(0.0, 0.0, *theta) * self.first_from_sensor;
            let shifted = |places: &[f64], by: f64| places.iter().map(|mm| by + mm).collect::<Vec<_>>();
            let (xs, ys) = (shifted(xs, turned.x_mm), shifted(ys, turned.y_mm));
            let lattice = self.cubic.then(|| LatticeWeights::at(grid, turned.theta_rad, &xs, &ys));
            for (place, sum) in sums[k..].iter_mut().step_by(thetas.len()).enumerate() {
                let (x, y) = (place / ys.len(), place % ys.len());
                let seen = match &lattice {
                    Some(lattice) => lattice.weights(x, y).map(|weights| self.seen_between(grid, part, &weights)),
                    None => self.seen(grid, part, &Se2::new(xs[x], ys[y], turned.theta_rad)),
                };
                *sum += seen.map_or(self.likelihood.log_unknown, |seen| self.log_seen(seen));
            }
        }
    }

    /// How well the view at a pose matches an edged touch: how many standard deviations its cosine is above that of the
    /// view which a touch was made at, and above what the best view of any part lets one expect; each at least -6, so that
    /// one spoilt touch does not outweigh all others. `None` where the touch is blank or the view unknown.
    pub fn standard_scores(&self, grid: &PoseGrid, part: usize, part_from_first: &Se2) -> Option<[f64; 2]> {
        /// The worst match.
        const LEAST: f64 = -6.0;
        /// A blank view where an edge was felt: as bad as a wrong part's views are on average.
        const MISMATCH: f64 = -3.0;
        if self.likelihood.blank {
            return None;
        }
        let seen = self.seen(grid, part, &(*part_from_first * self.first_from_sensor))?;
        let is_known = self.likelihood.is_recorded(seen.row) && (!self.cubic || seen.trust == 1.0);
        let best = f64::from(self.likelihood.best_similarity);
        let scores = || {
            let (matched, gap) = self.likelihood.expected(part);
            let expected = [matched, Spread { mean: best - gap.mean, sd: gap.sd }];
            expected.map(|Spread { mean, sd }| ((f64::from(seen.similarity) - mean) / sd).max(LEAST))
        };
        is_known.then(|| if self.likelihood.is_edged(seen.row) { scores() } else { [MISMATCH; 2] })
    }

    /// The view of a part from the sensor's pose; `None` where it is unknown.
    fn seen(&self, grid: &PoseGrid, part: usize, part_from_sensor: &Se2) -> Option<Seen> {
        if self.cubic {
            return Some(self.seen_between(grid, part, &ViewWeights::new(grid, part_from_sensor)?));
        }
        let Nearest { cell, trust } = nearest_view(grid, part_from_sensor, self.tolerance)?;
        let row = part * grid.len() + cell;
        Some(Seen { row, similarity: self.likelihood.similarities[row], trust })
    }

    fn seen_between(&self, grid: &PoseGrid, part: usize, weights: &ViewWeights) -> Seen {
        let start = part * grid.len();
        let similarity = self.likelihood.between(weights, start, grid.len());
        Seen { row: start + weights.cell, similarity, trust: weights.trust }
    }

    fn log_seen(&self, Seen { row, similarity, trust }: Seen) -> f64 {
        self.log_trusted(self.likelihood.log_between(similarity, row), trust)
    }

    /// The log-likelihood of a view, or of a mix of it and an unknown one where it is trusted only in part.
    fn log_trusted(&self, log: f64, trust: f64) -> f64 {
        let unknown = self.likelihood.log_unknown;
        let log = if trust == 1.0 { log } else { log_mix(trust, log, unknown) };
        // What does not count says nothing, as an unknown view does.
        unknown + self.weight * (log - unknown)
    }
}

/// log(trust e^a + (1 - trust) e^b), however far apart they are.
fn log_mix(trust: f64, a: f64, b: f64) -> f64 {
    let most = a.max(b);
    most + (trust * (a - most).exp() + (1.0 - trust) * (b - most).exp()).ln()
}

/// The view of one part at a pose.
#[derive(Clone, Copy)]
struct Seen {
    /// The bank's row nearest to it.
    row: usize,
    /// Cosine of the touch with it.
    similarity: f32,
    /// How far it is known, 0..=1.
    trust: f64,
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    use super::*;
    use crate::interpolation::Interpolation;
    use crate::likelihood::LikelihoodConfig;
    use crate::overlap::Overlap;
    use crate::synthetic::World;

    #[test]
    fn a_mix_is_finite_however_cold() {
        assert!((log_mix(0.25, 1.0, -0.5) - (0.25 * 1.0_f64.exp() + 0.75 * (-0.5_f64).exp()).ln()).abs() < 1e-12);
        assert!((log_mix(0.25, 2e4, -0.5) - (2e4 + 0.25_f64.ln())).abs() < 1e-9);
        assert!((log_mix(0.25, -2e4, -0.5) - (0.75_f64.ln() - 0.5)).abs() < 1e-9);
    }

    /// All states of a part at once, as pose by pose.
    #[test]
    fn a_lattice_of_poses_is_the_states_there() {
        let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let world = World::new(2, grid, 0.1, 0.02, 4);
        let states = grid.subdivided(2);
        let observation = world.touch(1, &Se2::from_degrees(1.2, -0.7, 9.0), &mut ChaCha8Rng::seed_from_u64(2));
        for interpolation in [Interpolation::Nearest, Interpolation::Cubic] {
            let config = LikelihoodConfig { interpolation, ..LikelihoodConfig::default() };
            let likelihood = TouchLikelihood::new(&observation, &world.bank, &config).unwrap();
            let moved = Se2::from_degrees(1.7, -0.9, 21.0);
            let mut judged = Vec::new();
            let evidence =
                Evidence::new([&grid, &states], moved, 0.7, likelihood, &mut |part| judged.extend_from_slice(part));
            let at = |cells: usize, stride: usize, value: &dyn Fn(Se2) -> f64| -> Vec<f64> {
                (0..cells).map(|index| value(states.pose(index * stride))).collect()
            };
            let (n, n_theta) = (states.n_xy(), states.n_theta());
            let xs = at(n, n * n_theta, &|pose| pose.x_mm);
            let ys = at(n, n_theta, &|pose| pose.y_mm);
            let thetas = at(n_theta, 1, &|pose| pose.theta_rad);
            for (part, judged) in judged.chunks_exact(states.len()).enumerate() {
                let mut sums = vec![10.0; states.len()];
                evidence.add_logs(&grid, part, [&xs, &ys, &thetas], &mut sums);
                for (sum, log) in sums.iter().zip(judged) {
                    // Looks of all states are in f32.
                    assert!((sum - 10.0 - log).abs() < 1e-4, "{interpolation:?}: {sum} {log}");
                }
            }
        }
    }

    #[test]
    fn what_is_new_of_a_touch_grows_with_its_distance() {
        let overlap = Overlap { mm: 3.0, deg: 15.0 };
        let share = |x: f64, deg: f64| overlap.new_share(&Se2::IDENTITY, &Se2::from_degrees(x, 0.0, deg));
        assert_eq!(share(0.0, 0.0), 0.0);
        // One width away on either axis: 1 - exp(-1/2).
        assert!((share(3.0, 0.0) - 0.393_469_340).abs() < 1e-9 && (share(0.0, 15.0) - 0.393_469_340).abs() < 1e-9);
        assert!(share(12.0, 0.0) > 0.999 && share(0.0, 180.0) > 0.999);
        assert_eq!(Overlap { mm: 0.0, deg: 15.0 }.new_share(&Se2::IDENTITY, &Se2::IDENTITY), 1.0);
    }
}

//! One touch of an episode: where it was relative to the first, and how likely it is from each state.

use tactile_data::pose::grid::{NearestCell, PoseGrid};
use tactile_data::pose::se2::Se2;
use tactile_infer::calibration::Spread;

use crate::belief::StartBelief;
use crate::insertion::TriedStates;
use crate::likelihood::interpolation::ViewWeights;
use crate::likelihood::lattice::{LatticeWeights, in_planes};
use crate::likelihood::nearest::{Nearest, nearest_view, trusted};
use crate::likelihood::touch_likelihood::{OnLattice, TouchLikelihood};
use crate::simd;

/// A touch, judged from every state.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// The sensor's motion since the first touch.
    pub first_from_sensor: Se2,
    /// The touch's likelihood at each row of the bank.
    pub likelihood: TouchLikelihood,
    /// The power to which its likelihood is taken, 0..=1: how much of it was new after the touches before it.
    pub weight: f64,
    /// What is known of the first touch's pose before it: part of its evidence alone.
    pub(crate) start: Option<StartBelief>,
    /// The pegs that were tried in vain after it and before the next touch.
    pub(crate) tried: Vec<TriedStates>,
    cubic: bool,
    tolerance: f64,
}

/// How the states of one angle see a touch, the same for every part.
#[derive(Debug)]
pub(crate) enum AngleViews {
    /// The nearest recorded view of each, `[n_places]`; `None` where it is unknown.
    Nearest(Vec<Option<Nearest>>),
    /// The recorded views around each.
    Between(Box<LatticeWeights>),
}

impl Evidence {
    /// A touch that no state was asked about, with the views of a bank whose grid is `grid`.
    pub(crate) fn of(grid: &PoseGrid, first_from_sensor: Se2, weight: f64, likelihood: TouchLikelihood) -> Self {
        let config = likelihood.config();
        let (cubic, tolerance) = (config.interpolation.is_cubic(grid), config.nearest_tolerance);
        Self { first_from_sensor, likelihood, weight, start: None, tried: Vec::new(), cubic, tolerance }
    }

    /// How the states of an angle see it.
    pub(crate) fn views_of_angle(&self, [grid, states]: [&PoseGrid; 2], angle: usize) -> AngleViews {
        if self.cubic {
            let lattice = LatticeWeights::of_states(grid, states, angle, &self.first_from_sensor);
            return AngleViews::Between(Box::new(lattice));
        }
        let cells = NearestCell::on(grid);
        let nearest = |cell| trusted(grid, &cells, &(states.pose(cell) * self.first_from_sensor), self.tolerance);
        AngleViews::Nearest((angle..states.len()).step_by(states.n_theta()).map(nearest).collect())
    }

    /// log p(touch | state) is at most this for the states of a part at an angle.
    pub(crate) fn highest(&self, part: usize, views: &AngleViews) -> f64 {
        let best_of_angles = self.likelihood.bounds(part).of_angles;
        let most = match views {
            AngleViews::Between(lattice) if !lattice.has_known() => return 0.0,
            AngleViews::Between(lattice) => lattice.most(best_of_angles),
            AngleViews::Nearest(_) => best_of_angles.iter().copied().fold(-1.0, f32::max),
        };
        self.counted(self.likelihood.highest(most))
    }

    /// Adds log p(touch | state) of the states of a part at an angle, `[n_places]`. `planes`: where views are interpolated
    /// its cosines with the part's views, [`in_planes`].
    pub(crate) fn add_block(
        &self,
        grid: &PoseGrid,
        part: usize,
        seen: (&AngleViews, Option<&[f32]>),
        sums: &mut [f64],
    ) {
        let first_row = part * grid.len();
        match seen {
            (AngleViews::Nearest(nearest), _) => {
                for (sum, nearest) in sums.iter_mut().zip(nearest) {
                    *sum += nearest.map_or(0.0, |Nearest { cell, trust }| {
                        self.log_trusted(self.likelihood.log_row(first_row + cell), trust)
                    });
                }
            }
            (AngleViews::Between(lattice), Some(planes)) if lattice.has_known() && self.weight > 0.0 => {
                let matches = self.likelihood.on_lattice(lattice, part, planes);
                self.add_between(first_row, lattice, &matches, sums);
            }
            // Nothing is known there.
            (AngleViews::Between(_), _) => {}
        }
    }

    /// Adds log p(touch | state) of the states of a lattice, for the part whose rows start at `first_row`, to which
    /// `matches` is.
    fn add_between(&self, first_row: usize, lattice: &LatticeWeights, matches: &OnLattice, sums: &mut [f64]) {
        let ([xs, ys], n_ys) = (lattice.inside(), lattice.n_ys());
        let is_recorded = |place: usize| {
            let cell = lattice.cell(place / n_ys, place % n_ys);
            self.likelihood.is_recorded(first_row + cell)
        };
        let (outliers, weights) = (vec![self.weight * matches.log_outlier; ys.len()], vec![self.weight; ys.len()]);
        for x in xs {
            let line = x * n_ys..(x + 1) * n_ys;
            if self.likelihood.lacks_views() {
                let known = ys.clone().map(|y| x * n_ys + y).filter(|place| is_recorded(*place));
                known.for_each(|place| sums[place] += self.weight * matches.at(place));
                continue;
            }
            simd::add(&outliers, &mut sums[line.clone()][ys.clone()]);
            if let Some(above) = matches.above_outlier(x) {
                let window = matches.window[1].start.max(ys.start)..matches.window[1].end.min(ys.end);
                if !window.is_empty() {
                    let above = &above[window.start - matches.window[1].start..][..window.len()];
                    simd::add_weighted(above, &weights[..window.len()], &mut sums[line][window]);
                }
            }
        }
        for faded in lattice.faded() {
            if self.likelihood.is_recorded(first_row + faded.nearest.cell) {
                sums[faded.place] += self.weight * faded.mixed(matches.at(faded.place));
            }
        }
    }

    /// The cosines with a part's views as [`Self::add_block`] needs them.
    pub(crate) fn planes(&self, grid: &PoseGrid, part: usize) -> Option<Vec<f32>> {
        self.cubic.then(|| in_planes(&self.likelihood.similarities[part * grid.len()..][..grid.len()], grid))
    }

    /// Adds log p(touch | part and pose of the first touch) at every pose of a lattice, any x and y in mm and angles in
    /// radians, to `sums`, `[n_x, n_y, n_theta]`; with what is known of it without a touch.
    pub fn add_logs(&self, grid: &PoseGrid, part: usize, axes: [&[f64]; 3], sums: &mut [f64]) {
        let [xs, ys, thetas] = axes;
        if self.start.is_some() || !self.tried.is_empty() {
            let places = xs.iter().flat_map(|x| ys.iter().map(move |y| [*x, *y]));
            let poses = places.flat_map(|[x, y]| thetas.iter().map(move |theta| Se2::new(x, y, *theta)));
            sums.iter_mut().zip(poses).for_each(|(sum, pose)| *sum += self.log_untouched(part, &pose));
        }
        for (k, theta) in thetas.iter().enumerate() {
            let turned = Se2::new(0.0, 0.0, *theta) * self.first_from_sensor;
            let shifted = |places: &[f64], by: f64| places.iter().map(|mm| by + mm).collect::<Vec<_>>();
            let (xs, ys) = (shifted(xs, turned.x_mm), shifted(ys, turned.y_mm));
            let sums = sums[k..].iter_mut().step_by(thetas.len());
            if self.cubic {
                let lattice = LatticeWeights::at(grid, turned.theta_rad, &xs, &ys);
                for (sum, seen) in sums.zip(self.likelihood.on_few(&lattice, part, grid.len())) {
                    *sum += seen.map_or(0.0, |(Nearest { cell, trust }, similarity)| {
                        self.log_seen(Seen { row: part * grid.len() + cell, similarity, trust })
                    });
                }
            } else {
                for (place, sum) in sums.enumerate() {
                    let pose = Se2::new(xs[place / ys.len()], ys[place % ys.len()], turned.theta_rad);
                    *sum += self.seen(grid, part, &pose).map_or(0.0, |seen| self.log_seen(seen));
                }
            }
        }
    }

    /// log p(touch | part and pose of the first touch), as far as the touch counts, with what is known of it without a touch.
    pub fn log_at(&self, grid: &PoseGrid, part: usize, part_from_first: &Se2) -> f64 {
        let seen = self.seen(grid, part, &(*part_from_first * self.first_from_sensor));
        self.log_untouched(part, part_from_first) + seen.map_or(0.0, |seen| self.log_seen(seen))
    }

    /// What is known of a state without the touch: before the first one, and by pegs that were tried after this one.
    fn log_untouched(&self, part: usize, part_from_first: &Se2) -> f64 {
        let of_start = self.start.map_or(0.0, |start| start.log(part_from_first));
        of_start + self.tried.iter().map(|tried| tried.log(part, part_from_first)).sum::<f64>()
    }

    /// How well the view at a pose matches an edged touch: how many standard deviations its cosine is above the
    /// expected one of the view that is touched; at least -6, so that one spoilt touch does not outweigh all others. `None` where the
    /// touch is blank or the view unknown.
    pub fn standard_score(&self, grid: &PoseGrid, part: usize, part_from_first: &Se2) -> Option<f64> {
        /// The worst match.
        const LEAST: f64 = -6.0;
        if self.likelihood.blank {
            return None;
        }
        let seen = self.seen(grid, part, &(*part_from_first * self.first_from_sensor))?;
        let is_known = self.likelihood.is_recorded(seen.row) && (!self.cubic || seen.trust == 1.0);
        let score = || {
            let Spread { mean, sd } = self.likelihood.expected(part);
            ((f64::from(seen.similarity) - mean) / sd).max(LEAST)
        };
        is_known.then(score)
    }

    /// The view of a part from the sensor's pose; `None` where it is unknown.
    fn seen(&self, grid: &PoseGrid, part: usize, part_from_sensor: &Se2) -> Option<Seen> {
        if self.cubic {
            let (weights, start) = (ViewWeights::new(grid, part_from_sensor)?, part * grid.len());
            let similarity = self.likelihood.between(&weights, start, grid.len());
            return Some(Seen { row: start + weights.cell, similarity, trust: weights.trust });
        }
        let Nearest { cell, trust } = nearest_view(grid, part_from_sensor, self.tolerance)?;
        let row = part * grid.len() + cell;
        Some(Seen { row, similarity: self.likelihood.similarities[row], trust })
    }

    fn log_seen(&self, Seen { row, similarity, trust }: Seen) -> f64 {
        self.log_trusted(self.likelihood.log_between(similarity, row), trust)
    }

    /// The log-likelihood of a view, or of a mix of it and an unknown one where it is trusted only in part.
    fn log_trusted(&self, log: f64, trust: f64) -> f64 {
        self.counted(if trust == 1.0 { log } else { log_mix(trust, log, 0.0) })
    }

    /// A log-likelihood as far as the touch counts: what does not count says nothing, as an unknown view does.
    fn counted(&self, log: f64) -> f64 {
        self.weight * log
    }
}

/// log(trust e^a + (1 - trust) e^b), however far apart they are.
fn log_mix(trust: f64, a: f64, b: f64) -> f64 {
    // Weighed first: what is not trusted at all must not hide the other, however likely it is.
    let (a, b) = (trust.ln() + a, (1.0 - trust).ln() + b);
    let most = a.max(b);
    most + ((a - most).exp() + (b - most).exp()).ln()
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
    use crate::checks::synthetic::World;
    use crate::likelihood::interpolation::Interpolation;
    use crate::touch_model::TouchModel;

    #[test]
    fn a_mix_is_finite_however_cold() {
        assert!((log_mix(0.25, 1.0, -0.5) - (0.25 * 1.0_f64.exp() + 0.75 * (-0.5_f64).exp()).ln()).abs() < 1e-12);
        assert!((log_mix(0.25, 2e4, -0.5) - (2e4 + 0.25_f64.ln())).abs() < 1e-9);
        assert!((log_mix(0.25, -2e4, -0.5) - (0.75_f64.ln() - 0.5)).abs() < 1e-9);
        assert_eq!([log_mix(0.0, 1e4, 0.0), log_mix(1.0, 0.0, 1e4)], [0.0; 2]);
    }

    /// Where a distance costs so much that a touch matches few views, it is an outlier where it cannot match.
    #[test]
    fn what_no_view_on_a_line_resembles_is_an_outlier_there() {
        let grid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let world = World::new(3, grid, 0.1, 0.02, 4);
        let states = grid.subdivided(2, 2);
        let observation = world.touch(1, &Se2::from_degrees(5.2, -4.7, 9.0), &mut ChaCha8Rng::seed_from_u64(2));
        let config = TouchModel { steepness: 30.0, interpolation: Interpolation::Cubic, ..world.model() };
        let likelihood = TouchLikelihood::new(&observation, &world.bank, &config).unwrap();
        let moved = Se2::from_degrees(1.7, -0.9, 21.0);
        let evidence = Evidence::of(&grid, moved, 1.0, likelihood);
        let (mut n_outliers, mut n_matches) = (0, 0);
        for (part, angle) in (0..3).flat_map(|part| (0..states.n_theta()).map(move |angle| (part, angle))) {
            let AngleViews::Between(lattice) = evidence.views_of_angle([&grid, &states], angle) else { panic!() };
            let planes = evidence.planes(&grid, part).unwrap();
            let found = evidence.likelihood.on_lattice(&lattice, part, &planes);
            let floor = found.log_outlier;
            let most = lattice.most_on_lines(evidence.likelihood.bounds(part));
            for (place, log) in (0..states.n_xy() * states.n_xy()).map(|place| (place, found.at(place))) {
                let pose = states.pose(place * states.n_theta() + angle) * moved;
                let Some(weights) = ViewWeights::new(&grid, &pose) else { continue };
                let most = most[0][place / lattice.n_ys()].min(most[1][place % lattice.n_ys()]);
                let cosine = evidence.likelihood.between(&weights, part * grid.len(), grid.len()).min(most);
                let exact = evidence.likelihood.log_between(cosine, part * grid.len());
                if log == floor {
                    assert!(exact < floor + 2.1e-3, "{exact} {floor}");
                    n_outliers += 1;
                } else {
                    assert!((log - exact).abs() < 1e-3, "{log} {exact}");
                    n_matches += usize::from(exact > floor + 5.0);
                }
            }
        }
        assert!(n_outliers > 100 && n_matches > 10, "{n_outliers} {n_matches}");
    }
}

//! How sure a part's pose is: how far, by all that is believed of that part, it is from the pose that is stated.

use std::f64::consts::PI;

use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_data::pose::symmetry::Symmetry;
use tactile_infer::maps::align::{Drawing, Start, align};
use tactile_infer::maps::mosaic::Mosaic;

use super::bayes::Belief;
use crate::belief::refine::{N_DEVIATIONS, moved, steps_of};

/// Points of a box along each axis.
const N_POINTS: usize = 8;

/// Boxes, each as wide as the one before found the belief to be; that is right to within a quarter.
const MAX_ROUNDS: usize = 8;

/// How the points along x and along y are shifted from one angle to the next, in distances between two of them: so that no
/// edge of the belief is between all of them (the R2 sequence of quasirandom points).
const SHIFTS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

/// Second moments of (x mm, y mm, theta rad).
type Moments = [[f64; 3]; 3];

/// The belief in a part around the pose that is stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hill {
    /// How far it goes on to either side along x, y (mm) and theta (rad).
    half: [f64; 3],
    /// Around the pose.
    moments: Moments,
}

impl Belief {
    /// Covariance of a part's pose at the first touch, (x mm, y mm, theta rad), around a pose that is stated: the mean of its
    /// squared error over all that is believed of that part. Around the pose the belief is found between the states, too, if
    /// `between_states`; farther away each state counts as often as it is believed. Of poses that the part's symmetry turns
    /// into each other the nearest counts. Zeros where the part is ruled out.
    pub fn covariance(&self, part: usize, pose: &Se2, symmetry: &Symmetry, between_states: bool) -> Moments {
        let hill = between_states.then(|| self.hill(part, pose, symmetry));
        self.covariance_of(part, pose, symmetry, hill)
    }

    /// The pose of the first touch at which the maps of touches are a part's, from one that the belief has, and the hill around it
    /// as well known as maps and belief say together.
    pub(crate) fn placed_by_maps(
        &self,
        (part, pose): (usize, &Se2),
        symmetry: &Symmetry,
        drawn: &[Drawing<'_>],
        mosaic: &Mosaic<'_>,
    ) -> (Se2, Hill) {
        let hill = self.hill(part, pose, symmetry);
        let found = align(drawn, mosaic, &Start { part_from_first: *pose, covariance: hill.moments });
        (found.part_from_first, Hill { moments: found.covariance, ..hill })
    }

    /// [`Self::covariance`], where the hill around the pose is known: other hills as they are believed.
    pub(crate) fn covariance_of(&self, part: usize, pose: &Se2, symmetry: &Symmetry, hill: Option<Hill>) -> Moments {
        let steps = steps_of(self.posterior.grid());
        let (mut of_hill, mut all, mut moments) = (0.0, 0.0, [[0.0; 3]; 3]);
        for (state, mass) in self.posterior.states_of(part) {
            let off = deviation(&self.posterior.grid().pose(state.cell), pose, symmetry);
            let share = hill.as_ref().map_or(0.0, |hill| hill.share_of_cell(off, steps));
            (of_hill, all) = (of_hill + share * mass, all + mass);
            add_square(&mut moments, off, (1.0 - share) * mass);
        }
        if let Some(hill) = hill {
            (0..3).for_each(|i| (0..3).for_each(|j| moments[i][j] += of_hill * hill.moments[i][j]));
            // Within the cell of a state farther away the belief is as wide as here, or as the cell.
            let within = |axis: usize| hill.moments[axis][axis].min(steps[axis] * steps[axis] / 12.0);
            (0..3).for_each(|axis| moments[axis][axis] += (all - of_hill) * within(axis));
        }
        if all > 0.0 { moments.map(|row| row.map(|moment| moment / all)) } else { moments }
    }

    /// The middle of the belief in a part around a pose, along the axes on which it goes on for more than a step.
    pub(super) fn middle(&self, part: usize, pose: &Se2, symmetry: &Symmetry) -> Se2 {
        let steps = steps_of(&self.views);
        let (mut middle, mut half, across) = (*pose, steps, 2.0 * self.views.xy_half_mm);
        for _ in 0..MAX_ROUNDS {
            let (mean, moments) = self.moments_within(part, &middle, half, symmetry);
            half = self.next_half(half, &moments, [across, across, PI]);
            middle = moved(&middle, [0, 1, 2].map(|axis| if half[axis] > steps[axis] { mean[axis] } else { 0.0 }));
        }
        middle
    }

    /// The belief in a part around a pose, as far as it goes on from there, at most one step of the recorded views.
    fn hill(&self, part: usize, pose: &Se2, symmetry: &Symmetry) -> Hill {
        let mut half = steps_of(&self.views);
        for _ in 1..MAX_ROUNDS {
            let (_, moments) = self.moments_within(part, pose, half, symmetry);
            let next = self.next_half(half, &moments, steps_of(&self.views));
            if (0..3).all(|axis| (next[axis] - half[axis]).abs() <= 0.25 * half[axis]) {
                return Hill { half, moments };
            }
            half = next;
        }
        Hill { half, moments: self.moments_within(part, pose, half, symmetry).1 }
    }

    /// How far to either side of a pose the belief goes on that has these moments within `half` of it, at most `reach`.
    fn next_half(&self, half: [f64; 3], moments: &Moments, reach: [f64; 3]) -> [f64; 3] {
        let steps = steps_of(&self.views);
        [0, 1, 2].map(|axis| {
            let wanted = N_DEVIATIONS * moments[axis][axis].sqrt();
            // A few points may lose a peak between them, so a box shrinks by degrees.
            wanted.clamp(0.3 * half[axis], 2.0 * half[axis]).max(0.02 * steps[axis]).min(reach[axis])
        })
    }

    /// Mean offset and second moments, both from a pose, of the belief in a part within `half` of it.
    fn moments_within(&self, part: usize, pose: &Se2, half: [f64; 3], symmetry: &Symmetry) -> ([f64; 3], Moments) {
        let at = |axis: usize, place: f64| half[axis] * (2.0 * place / N_POINTS as f64 - 1.0);
        let mut scored: Vec<([f64; 3], f64)> = Vec::with_capacity(N_POINTS.pow(3));
        for slice in 0..N_POINTS {
            let theta = at(2, slice as f64 + 0.5);
            let [xs, ys]: [[f64; N_POINTS]; 2] = [0, 1].map(|axis| {
                let shift = (SHIFTS[axis] * (slice + 1) as f64).fract();
                std::array::from_fn(|point| at(axis, point as f64 + shift))
            });
            let [at_xs, at_ys] = [xs.map(|x| pose.x_mm + x), ys.map(|y| pose.y_mm + y)];
            let mut sums = [0.0; N_POINTS * N_POINTS];
            for touch in &self.touches {
                touch.add_logs(&self.views, part, [&at_xs, &at_ys, &[pose.theta_rad + theta]], &mut sums);
            }
            scored.extend(sums.iter().enumerate().map(|(i, sum)| ([xs[i / N_POINTS], ys[i % N_POINTS], theta], *sum)));
        }
        let best = scored.iter().map(|(_, sum)| *sum).fold(f64::NEG_INFINITY, f64::max);
        let (mut all, mut mean, mut moments) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for (offset, sum) in scored {
            let (mass, off) = ((sum - best).exp(), deviation(&moved(pose, offset), pose, symmetry));
            all += mass;
            (0..3).for_each(|axis| mean[axis] += mass * off[axis]);
            add_square(&mut moments, off, mass);
        }
        (mean.map(|sum| sum / all), moments.map(|row| row.map(|moment| moment / all)))
    }
}

impl Hill {
    /// The share of a state's cell that belongs to it, 0..=1; all of one around the pose, and half of the next: a peak between
    /// two states is in both. `off`: the cell's middle from the pose; `steps`: its widths, zero on an axis of one state.
    fn share_of_cell(&self, off: [f64; 3], steps: [f64; 3]) -> f64 {
        let share = |axis: usize| {
            let (half, step) = (self.half[axis].max(steps[axis]), steps[axis]);
            if step > 0.0 { ((half - off[axis].abs()) / step + 0.5).clamp(0.0, 1.0) } else { 1.0 }
        };
        share(0) * share(1) * share(2)
    }
}

/// How far a pose, or the nearest that feels the same, is from another: x and y in mm, angle in radians.
fn deviation(pose: &Se2, from: &Se2, symmetry: &Symmetry) -> [f64; 3] {
    let twin = if symmetry.is_any() { symmetry.nearest_twin(pose, from) } else { *pose };
    [twin.x_mm - from.x_mm, twin.y_mm - from.y_mm, wrap_angle(twin.theta_rad - from.theta_rad)]
}

fn add_square(moments: &mut Moments, off: [f64; 3], mass: f64) {
    (0..3).for_each(|i| (0..3).for_each(|j| moments[i][j] += mass * off[i] * off[j]));
}

#[cfg(test)]
mod tests {
    use tactile_data::pose::grid::PoseGrid;
    use tactile_infer::Bank;
    use tactile_infer::bank::rows::Rows;

    use super::*;
    use crate::belief::engine::EngineConfig;
    use crate::likelihood::TouchLikelihood;
    use crate::likelihood::interpolation::Interpolation;
    use crate::touch::Observation;
    use crate::touch_model::TouchModel;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };

    /// A part whose views are alike where `x_of` says the same of two places along x, after a touch of it at the middle, which
    /// is as far from the view there as touches are.
    fn touched(x_of: impl Fn(f64) -> usize) -> Belief {
        const DIM: usize = 49;
        let row = |cell: usize| {
            let pose = GRID.pose(cell);
            let mut row = vec![0.0_f32; DIM];
            let at =
                [x_of(pose.x_mm), 20 + (pose.y_mm / 2.0 + 4.0) as usize, 40 + (pose.theta_deg() / 15.0 + 3.5) as usize];
            at.iter().for_each(|at| row[*at] = 3.0_f32.sqrt().recip());
            row
        };
        let rows: Vec<f32> = (0..GRID.len()).flat_map(row).collect();
        let bank =
            Bank::from_rows(vec!["a".into()], GRID, Rows::new(DIM, rows).unwrap(), vec![0.3; GRID.len()], "").unwrap();
        let config = TouchModel {
            match_offset: 3.0,
            steepness: 24.0,
            steepness_by_edge: 0.27,
            own_distance: 0.38,
            outlier_share: 1e-9,
            interpolation: Interpolation::Cubic,
            ..TouchModel::default()
        };
        let mut query = row(GRID.nearest(&Se2::IDENTITY).unwrap());
        // At right angles to all views: a distance of d is a tangent of d sqrt(1 - d^2 / 4) / (1 - d^2 / 2).
        let square = config.own_distance.powi(2);
        query[DIM - 1] = ((square * (1.0 - square / 4.0)).sqrt() / (1.0 - square / 2.0)) as f32;
        let touch = Observation::new(query, 0.3);
        Belief::new(&bank, EngineConfig::Exact, 2, 1, TouchLikelihood::new(&touch, &bank, &config).unwrap())
    }

    /// Mean of the belief within the bank and its second moments around a pose, by a sum over a fine lattice.
    fn by_brute_force(belief: &Belief, pose: &Se2, symmetry: &Symmetry) -> ([f64; 3], Moments) {
        let along = |half: f64, n: i32| (-n..=n).map(move |i| half * f64::from(i) / f64::from(n));
        let log = |pose: &Se2| belief.touches().iter().map(|touch| touch.log_at(&belief.views, 0, pose)).sum::<f64>();
        let mut weighed = Vec::new();
        for x in along(8.0, 64) {
            for y in along(4.0, 32) {
                weighed.extend(along(0.4, 20).map(|theta| ([x, y, theta], log(&Se2::new(x, y, theta)).exp())));
            }
        }
        let all: f64 = weighed.iter().map(|(_, mass)| mass).sum();
        let mean = [0, 1, 2].map(|axis| weighed.iter().map(|(at, mass)| mass * at[axis]).sum::<f64>() / all);
        let mut moments = [[0.0; 3]; 3];
        for ([x, y, theta], mass) in &weighed {
            add_square(&mut moments, deviation(&Se2::new(*x, *y, *theta), pose, symmetry), *mass);
        }
        (mean, moments.map(|row| row.map(|moment| moment / all)))
    }

    /// A straight edge: for some millimetres all places along it look the same.
    #[test]
    fn how_far_a_ridge_goes_is_stated() {
        for (from, to) in [(0.0, 0.0), (-2.0, 2.0), (-2.0, 4.0), (-4.0, 4.0)] {
            let belief = touched(|x| if x >= from && x <= to { 9 } else { (x / 2.0 + 4.0) as usize });
            let pose = belief.refine(belief.posterior().best(None).unwrap(), &Symmetry::NONE);
            let found = belief.covariance(0, &pose, &Symmetry::NONE, true);
            let (mean, expected) = by_brute_force(&belief, &pose, &Symmetry::NONE);
            let sd = |moments: &Moments| [0, 1, 2].map(|axis| moments[axis][axis].sqrt());
            let (found_sd, expected_sd) = (sd(&found), sd(&expected));
            assert!((pose.x_mm - mean[0]).abs() < 0.15 * expected_sd[0], "{from} to {to}: {pose:?}, {mean:?}");
            for axis in 0..3 {
                let ratio = found_sd[axis] / expected_sd[axis];
                assert!((ratio - 1.0).abs() < 0.15, "{from} to {to}: {found_sd:?}, by brute force {expected_sd:?}");
            }
        }
    }

    #[test]
    fn places_far_from_each_other_count_as_often_as_they_are_believed() {
        // At -6, 0 and 6 mm it looks the same.
        let belief = touched(|x| if x.abs() == 6.0 || x == 0.0 { 9 } else { (x / 2.0 + 4.0) as usize });
        let half_turn = Symmetry { order: Some(2), centre_mm: [0.0; 2] };
        let round = Symmetry { order: None, centre_mm: [0.0; 2] };
        for (x, symmetry) in
            [(0.0, Symmetry::NONE), (6.0, Symmetry::NONE), (0.0, half_turn), (6.0, half_turn), (0.0, round)]
        {
            let pose = Se2::new(x, 0.0, 0.0);
            let found = belief.covariance(0, &pose, &symmetry, true);
            let (_, expected) = by_brute_force(&belief, &pose, &symmetry);
            // Turned about the middle, what a round part's places are wide along one axis is along the other.
            let axes = if symmetry.order.is_none() { 0..1 } else { 0..3 };
            for axis in axes {
                let [found, expected] = [found, expected].map(|moments| moments[axis][axis]);
                assert!(
                    (found - expected).abs() <= 0.15 * expected,
                    "{symmetry:?} at {x}: {found}, by brute force {expected}"
                );
            }
        }
    }
}

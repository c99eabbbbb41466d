//! Where a pose is among the recorded ones: splines along each axis, and how far a view is trusted.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::bank::between::Around;

use super::reference::Pose;

/// Where a value is among the recorded ones of an axis.
#[derive(Clone, Debug)]
pub struct Place {
    /// The rows that count, and how much each does.
    pub weights: Vec<(usize, f64)>,
    /// The nearest.
    pub nearest: usize,
    /// The recorded value before it.
    pub low: usize,
    /// How far it is from there to the next, 0..=1.
    pub share: f64,
    /// Steps outside the recorded range.
    pub outside: f64,
}

impl Place {
    /// `library`: the value as the library computes it. Where two recorded values are equally near, which is the
    /// nearest is a matter of rounding, and either is right: its choice counts.
    fn new([value, library]: [f64; 2], half: f64, step: f64) -> Self {
        let n = (2.0 * half / step).round() as usize + 1;
        let place = Self::at((value + half) / step, n);
        let is_tie = (place.share - 0.5).abs() < 1e-9;
        Self { nearest: if is_tie { Around::new(library, half, step, n).nearest } else { place.nearest }, ..place }
    }

    /// Catmull and Rom's spline from its definition, so many steps from the first of `n` recorded values: Hermite's
    /// cubic between two points, whose slopes are half the difference of their neighbours; beyond a border the
    /// parabola through the last three points goes on, through two a line. At the border of a full turn too: where
    /// such a grid is to go round, `before` and `after` are its other end's.
    pub fn at(place: f64, n: usize) -> Self {
        let inside = place.clamp(0.0, (n - 1) as f64);
        let (nearest, outside) = (inside.round() as usize, place - inside);
        if n == 1 {
            return Self { weights: vec![(0, 1.0)], nearest, low: 0, share: 0.0, outside };
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
        Self { weights, nearest, low, share: t, outside }
    }

    /// The value between those at the two recorded ones around, on a line.
    pub fn between(&self, at: impl Fn(usize) -> f64) -> f64 {
        let Self { low, share, .. } = *self;
        let next = if share > 0.0 { share * at(low + 1) } else { 0.0 };
        (1.0 - share) * at(low) + next
    }

    /// Along x, y and theta.
    pub fn of_pose(grid: &PoseGrid, pose: &Pose, library: &Se2) -> [Self; 3] {
        let degrees = pose.turn[1].atan2(pose.turn[0]).to_degrees();
        let (half, step) = (grid.xy_half_mm, grid.xy_step_mm);
        let [x, y] = [[pose.x, library.x_mm], [pose.y, library.y_mm]].map(|values| Self::new(values, half, step));
        [x, y, Self::new([degrees, library.theta_deg()], grid.theta_half_deg, grid.theta_step_deg)]
    }

    /// The recorded values with more than a millionth of the weight; the nearest is one of them.
    pub fn counting(&self) -> impl Iterator<Item = usize> + '_ {
        let others = self.weights.iter().filter(|(index, weight)| weight.abs() > 1e-6 && *index != self.nearest);
        others.map(|(index, _)| *index).chain([self.nearest])
    }
}

/// How far a view is trusted: less and less outside the recorded area, and from one step on not at all.
pub fn trust(at: &[Place; 3]) -> f64 {
    let steps = at.iter().map(|place| place.outside.powi(2)).sum::<f64>().sqrt();
    if steps > 1.0 { 0.0 } else { (-0.5 * (steps / 0.5).powi(2)).exp() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_goes_through_its_points_and_follows_parabolas() {
        for at in 0..=40 {
            let place = 0.1 * f64::from(at) - 2.0;
            let weights = Place::at(place + 2.0, 5).weights;
            let value: f64 = weights.iter().map(|(k, weight)| weight * (*k as f64 - 1.3).powi(2)).sum();
            assert!((value - (place + 0.7).powi(2)).abs() < 1e-12, "{place}");
        }
    }
}

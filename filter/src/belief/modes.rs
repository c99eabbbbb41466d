//! The belief in a few numbers: its modes, each with a mean pose and a covariance.

use tactile_data::pose::grid::{NearestCell, PoseGrid};
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_data::pose::symmetry::Symmetry;

use crate::belief::hypothesis::Hypothesis;
use crate::belief::posterior::Posterior;

/// A peak of the belief with the states that lead up to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Index of the part in the bank.
    pub part: usize,
    /// Probability of the mode's states, 0..=1; of its twins' too, where the part is symmetric.
    pub mass: f64,
    /// Mean pose of the sensor at its latest touch; the angle is the circular mean.
    pub part_from_sensor: Se2,
    /// Covariance of (x mm, y mm, theta rad), angles taken as deviations from the circular mean.
    pub covariance: [[f64; 3]; 3],
}

/// Modes below this probability are not worth naming to a person.
const MIN_MASS: f64 = 0.01;

/// The heaviest states that hold less than this together are left out: of many parts most states are what outliers leave.
const NEGLIGIBLE: f64 = 1e-3;

/// The heaviest states, among which modes are looked for: half a million would take a second.
const MAX_STATES: usize = 10_000;

/// The modes of a belief, the heaviest first: each state belongs to the peak that it reaches by going
/// from neighbour to likeliest neighbour (one grid step in x, y and theta). Modes below 1 % are left out, and so are
/// a thousandth of the belief at most in its lightest states and what is lighter than the heaviest ten thousand. Modes that a
/// part's `symmetry` turns into each other are one, with the pose of the heaviest. `first_from_sensor`: the motion from
/// the first touch to the latest.
pub fn modes(posterior: &Posterior, first_from_sensor: &Se2, symmetry: &dyn Fn(usize) -> Symmetry) -> Vec<Mode> {
    let least = NEGLIGIBLE / MAX_STATES.min(posterior.n_states()) as f64;
    let mut states = posterior.heaviest_states(least, MAX_STATES);
    // At the coldest temperatures, logs of 1e12 and more, their rounding lets masses sum to a little over one.
    let whole: f64 = states.iter().map(|(_, mass)| mass).sum();
    if whole > 1.0 + 1e-9 {
        states.iter_mut().for_each(|(_, mass)| *mass /= whole);
    }
    let uphill = likeliest_neighbours(posterior.grid(), &states);
    let mut peaks: Vec<(usize, Vec<usize>)> = Vec::new();
    let mut peak_of: Vec<Option<usize>> = vec![None; states.len()];
    for at in 0..states.len() {
        let mut top = at;
        while uphill[top] != top {
            top = uphill[top];
        }
        let peak = *peak_of[top].get_or_insert_with(|| {
            peaks.push((states[top].0.part, Vec::new()));
            peaks.len() - 1
        });
        peaks[peak].1.push(at);
    }
    let pose = |at: usize| (posterior.grid().pose(states[at].0.cell) * *first_from_sensor, states[at].1);
    let mut modes: Vec<Mode> = peaks
        .into_iter()
        .filter(|(_, members)| members.iter().map(|at| states[*at].1).sum::<f64>() >= MIN_MASS)
        .map(|(part, members)| summarise(part, &members.into_iter().map(pose).collect::<Vec<_>>()))
        .collect();
    modes.sort_by(|a, b| b.mass.total_cmp(&a.mass));
    merge_twins(modes, posterior.grid(), symmetry)
}

/// Whether two poses are so near that their hills are one.
pub(crate) fn is_one_hill(grid: &PoseGrid, a: &Se2, b: &Se2) -> bool {
    let turned = wrap_angle(a.theta_rad - b.theta_rad).to_degrees().abs();
    a.distance_mm(b) <= 2.0 * grid.xy_step_mm && turned <= 2.0 * grid.theta_step_deg
}

/// The same modes, each with the mass of its twins: modes that its part's symmetry turns into it. `modes`: the heaviest first.
fn merge_twins(modes: Vec<Mode>, grid: &PoseGrid, symmetry: &dyn Fn(usize) -> Symmetry) -> Vec<Mode> {
    let are_twins = |a: &Mode, b: &Mode| {
        let near = |twin: &Se2| is_one_hill(grid, twin, &b.part_from_sensor);
        let symmetry = symmetry(a.part);
        let is_turned = || match symmetry.order {
            None => near(&symmetry.nearest_twin(&a.part_from_sensor, &b.part_from_sensor)),
            Some(_) => symmetry.twins(&a.part_from_sensor)[1..].iter().any(near),
        };
        a.part == b.part && is_turned()
    };
    let mut merged: Vec<Mode> = Vec::new();
    for mode in modes {
        match merged.iter_mut().find(|heavier| are_twins(heavier, &mode)) {
            Some(heavier) => heavier.mass += mode.mass,
            None => merged.push(mode),
        }
    }
    merged.sort_by(|a, b| b.mass.total_cmp(&a.mass));
    merged
}

/// For each state, the likeliest among it and its up to 26 neighbours; of equals the lowest, so that a
/// plateau has one top. `states` in ascending order.
fn likeliest_neighbours(grid: &PoseGrid, states: &[(Hypothesis, f64)]) -> Vec<usize> {
    // The states of one part by their cells: of many parts few hold any.
    let mut index_of: Vec<Option<u32>> = vec![None; grid.len()];
    let neighbours = NeighbourCells::on(grid);
    let higher = |a: usize, b: usize| states[b].1 > states[a].1 || (states[b].1 == states[a].1 && b < a);
    let mut likeliest = Vec::with_capacity(states.len());
    for of_part in states.chunk_by(|a, b| a.0.part == b.0.part) {
        let first = likeliest.len();
        for (index, (hypothesis, _)) in (first..).zip(of_part) {
            index_of[hypothesis.cell] = u32::try_from(index).ok();
        }
        for (at, (hypothesis, _)) in (first..).zip(of_part) {
            let held = neighbours.of(hypothesis.cell).filter_map(|cell| index_of[cell]).map(|index| index as usize);
            likeliest.push(held.fold(at, |best, next| if higher(best, next) { next } else { best }));
        }
        of_part.iter().for_each(|(hypothesis, _)| index_of[hypothesis.cell] = None);
    }
    likeliest
}

/// The cells within one step of a cell in x, y and theta.
struct NeighbourCells {
    n_xy: usize,
    /// The angles one step below, at and above each angle, across half a turn too; `None` outside the grid.
    angles: Vec<[Option<usize>; 3]>,
}

impl NeighbourCells {
    fn on(grid: &PoseGrid) -> Self {
        let nearest = NearestCell::on(grid);
        let at = |index: usize, steps: f64| {
            let Se2 { x_mm, y_mm, theta_rad } = grid.pose(index);
            let turned = Se2::new(x_mm, y_mm, theta_rad + steps * grid.theta_step_deg.to_radians());
            nearest.of(&turned).map(|cell| cell % grid.n_theta())
        };
        let angles = (0..grid.n_theta()).map(|index| [-1.0, 0.0, 1.0].map(|steps| at(index, steps))).collect();
        Self { n_xy: grid.n_xy(), angles }
    }

    /// Its own among them.
    fn of(&self, cell: usize) -> impl Iterator<Item = usize> {
        let (n, n_theta) = (self.n_xy, self.angles.len());
        let (x, y, angles) = (cell / n_theta / n, cell / n_theta % n, self.angles[cell % n_theta]);
        let within = move |at: usize| at.saturating_sub(1)..(at + 2).min(n);
        let places = within(x).flat_map(move |x| within(y).map(move |y| (x * n + y) * n_theta));
        places.flat_map(move |place| angles.into_iter().flatten().map(move |angle| place + angle))
    }
}

/// Mean and covariance of poses with probabilities.
fn summarise(part: usize, poses: &[(Se2, f64)]) -> Mode {
    let mass: f64 = poses.iter().map(|(_, mass)| mass).sum();
    let mean = |value: &dyn Fn(&Se2) -> f64| poses.iter().map(|(pose, m)| m * value(pose)).sum::<f64>() / mass;
    let part_from_sensor = Se2::new(
        mean(&|pose| pose.x_mm),
        mean(&|pose| pose.y_mm),
        mean(&|pose| pose.theta_rad.sin()).atan2(mean(&|pose| pose.theta_rad.cos())),
    );
    let deviation = |pose: &Se2| {
        let turn = wrap_angle(pose.theta_rad - part_from_sensor.theta_rad);
        [pose.x_mm - part_from_sensor.x_mm, pose.y_mm - part_from_sensor.y_mm, turn]
    };
    let axes = [0, 1, 2];
    let covariance = axes.map(|i| axes.map(|j| mean(&|pose| deviation(pose)[i] * deviation(pose)[j])));
    Mode { part, mass, part_from_sensor, covariance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn twins_are_one_mode_and_strangers_are_not() {
        let mode = |part, mass, degrees| Mode {
            part,
            mass,
            part_from_sensor: Se2::from_degrees(1.0, 2.0, degrees),
            covariance: [[0.0; 3]; 3],
        };
        let turned = |mode: Mode| Mode { part_from_sensor: Se2::new(0.0, 0.0, PI) * mode.part_from_sensor, ..mode };
        let modes =
            || vec![mode(0, 0.4, 80.0), mode(1, 0.25, 80.0), turned(mode(0, 0.2, 82.0)), turned(mode(1, 0.15, 0.0))];
        let half_turn =
            |part| if part == 0 { Symmetry { order: Some(2), centre_mm: [0.0; 2] } } else { Symmetry::NONE };
        let merged = merge_twins(modes(), &PoseGrid::SMALL, &half_turn);
        assert_eq!(
            merged.iter().map(|mode| (mode.part, mode.mass)).collect::<Vec<_>>(),
            [(0, 0.4 + 0.2), (1, 0.25), (1, 0.15)]
        );
        assert_eq!(merged[0].part_from_sensor, modes()[0].part_from_sensor);
        assert_eq!(merge_twins(modes(), &PoseGrid::SMALL, &|_| Symmetry::NONE), modes());
    }

    #[test]
    fn neighbour_cells_are_one_step_away_across_half_a_turn_too() {
        let half = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 4.0, theta_half_deg: 90.0, theta_step_deg: 30.0 };
        let ring = PoseGrid { theta_half_deg: 180.0, ..half };
        for grid in [half, ring] {
            let neighbours = NeighbourCells::on(&grid);
            for cell in 0..grid.len() {
                let (here, nearest) = (grid.pose(cell), NearestCell::on(&grid));
                let steps = [-1.0, 0.0, 1.0];
                let mut expected = Vec::new();
                for [x, y, turn] in
                    steps.iter().flat_map(|x| steps.iter().flat_map(move |y| steps.map(|t| [*x, *y, t])))
                {
                    let theta = here.theta_rad + 30.0_f64.to_radians() * turn;
                    expected.extend(nearest.of(&Se2::new(here.x_mm + 4.0 * x, here.y_mm + 4.0 * y, theta)));
                }
                let mut found: Vec<usize> = neighbours.of(cell).collect();
                found.sort_unstable();
                expected.sort_unstable();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn angles_across_half_a_turn_average_to_half_a_turn() {
        // navigation#1161: a linear covariance of +-180 degrees is huge.
        let poses = [(Se2::new(1.0, 0.0, PI - 0.1), 0.2), (Se2::new(3.0, 0.0, -PI + 0.1), 0.2)];
        let mode = summarise(0, &poses);
        assert!((mode.part_from_sensor.theta_rad.abs() - PI).abs() < 1e-12);
        assert!((mode.covariance[2][2] - 0.01).abs() < 1e-12);
        // x: mean 2, variance 1; x and angle rise together by 1 and 0.1.
        assert!((mode.part_from_sensor.x_mm - 2.0).abs() < 1e-12 && (mode.covariance[0][0] - 1.0).abs() < 1e-12);
        assert!((mode.covariance[0][2] - 0.1).abs() < 1e-12 && (mode.mass - 0.4).abs() < 1e-12);
    }
}

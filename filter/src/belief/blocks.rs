//! The states of one part at one angle, which are judged together: one motion takes them all to poses of one angle.

use tactile_data::pose::grid::PoseGrid;

use crate::likelihood::evidence::{AngleViews, Evidence};

/// Judges the touches of an episode block by block; what blocks share is found once.
pub(crate) struct Blocks<'a> {
    /// The bank's grid and the states' grid.
    grids: [&'a PoseGrid; 2],
    touches: &'a [Evidence],
    /// How each angle sees each touch, as far as was asked.
    views: Vec<Vec<Option<AngleViews>>>,
    /// What [`Evidence::planes`] is for each touch and each part, as far as was asked.
    planes: Vec<Vec<Option<Option<Vec<f32>>>>>,
}

impl<'a> Blocks<'a> {
    /// With the bank's grid and the states' grid.
    pub fn of(grids: [&'a PoseGrid; 2], touches: &'a [Evidence]) -> Self {
        let n_parts = |touch: &Evidence| touch.likelihood.similarities.len() / grids[0].len();
        let views = touches.iter().map(|_| (0..grids[1].n_theta()).map(|_| None).collect()).collect();
        let planes = touches.iter().map(|touch| vec![None; n_parts(touch)]).collect();
        Self { grids, touches, views, planes }
    }

    /// log p(last touch | state) is at most this in each block, `[n_blocks]`.
    pub fn highest(&mut self) -> Vec<f64> {
        let (grids, n_angles) = (self.grids, self.grids[1].n_theta());
        let (Some(touch), Some(views), Some(planes)) = (self.touches.last(), self.views.last_mut(), self.planes.last())
        else {
            return Vec::new();
        };
        let find = |(angle, views): (usize, &mut Option<AngleViews>)| {
            *views = Some(touch.views_of_angle(grids, angle));
        };
        views.iter_mut().enumerate().for_each(find);
        // An angle's first state has the angle of all.
        let of_start = |angle| touch.start.map_or(0.0, |start| start.highest(grids[1].pose(angle).theta_rad));
        let of_block = |block: usize| {
            let (part, angle) = (block / n_angles, block % n_angles);
            let views = views[angle].as_ref();
            of_start(angle) + views.map_or(f64::INFINITY, |views| touch.highest(part, views))
        };
        (0..planes.len() * n_angles).map(of_block).collect()
    }

    /// Adds log p(touch | state) of the states of a block.
    pub fn add(&mut self, block: usize, touch: usize, sums: &mut [f64]) {
        let n_angles = self.grids[1].n_theta();
        let (part, angle) = (block / n_angles, block % n_angles);
        let evidence = &self.touches[touch];
        let views = self.views[touch][angle].get_or_insert_with(|| evidence.views_of_angle(self.grids, angle));
        let planes = self.planes[touch][part].get_or_insert_with(|| evidence.planes(self.grids[0], part));
        evidence.add_block(self.grids[0], part, (views, planes.as_deref()), sums);
        if let Some(start) = &evidence.start {
            start.add_angle(self.grids[1], angle, sums);
        }
        evidence.tried.iter().for_each(|tried| tried.add_block(self.grids[1], part, angle, sums));
    }
}

/// log p(last touch | state) of every state, `[n_parts, n_cells]`: each part at each pose of the second grid, with the views
/// of a bank whose grid is the first.
pub(crate) fn log_states(grids: [&PoseGrid; 2], touch: &Evidence) -> Vec<f64> {
    let n_cells = grids[1].len();
    let n_angles = grids[1].n_theta();
    let n_parts = touch.likelihood.similarities.len() / grids[0].len();
    let mut blocks = Blocks::of(grids, std::slice::from_ref(touch));
    let mut log_states = vec![0.0; n_parts * n_cells];
    for (part, log_part) in log_states.chunks_exact_mut(n_cells).enumerate() {
        for angle in 0..n_angles {
            let mut log_block = vec![0.0; n_cells / n_angles];
            blocks.add(part * n_angles + angle, 0, &mut log_block);
            let of_angle = log_part[angle..].iter_mut().step_by(n_angles);
            of_angle.zip(log_block).for_each(|(log, found)| *log = found);
        }
    }
    log_states
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;
    use tactile_data::pose::se2::Se2;

    use super::*;
    use crate::checks::synthetic::World;
    use crate::likelihood::TouchLikelihood;
    use crate::likelihood::interpolation::Interpolation;
    use crate::touch_model::TouchModel;

    /// All states of a part at once, as pose by pose.
    #[test]
    fn a_lattice_of_poses_is_the_states_there() {
        let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let world = World::new(2, grid, 0.1, 0.02, 4);
        let states = grid.subdivided(2, 2);
        let observation = world.touch(1, &Se2::from_degrees(1.2, -0.7, 9.0), &mut ChaCha8Rng::seed_from_u64(2));
        // Looks of all states are in f32, and where there are outliers, to 0.002 nats.
        for (interpolation, outlier_share, most) in [
            (Interpolation::Nearest, 0.02, 1e-4),
            (Interpolation::Cubic, 0.0, 1e-4),
            (Interpolation::Cubic, 0.02, 2.1e-3),
        ] {
            let config = TouchModel { interpolation, outlier_share, ..TouchModel::default() };
            let likelihood = TouchLikelihood::new(&observation, &world.bank, &config).unwrap();
            let moved = Se2::from_degrees(1.7, -0.9, 21.0);
            let evidence = Evidence::of(&grid, moved, 0.7, likelihood);
            let judged = log_states([&grid, &states], &evidence);
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
                    assert!((sum - 10.0 - log).abs() < most, "{interpolation:?}: {sum} {log}");
                }
            }
        }
    }
}

//! What is known of an episode, as messages in the robot's base frame.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{
    Header, OccupancyGrid, PointCloud2, Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped, TFMessage, Text, Time,
    TransformStamped, to_cdr,
};
use tactile_data::recording::ros::rigid::Rigid;
use tactile_filter::belief::Hypothesis;
use tactile_filter::{Episode, FeltMap};
use tactile_infer::maps::mosaic::{CELL_MM, Mosaic, Place};

use crate::decision::DecisionReport;
use crate::error::{Error, Result};
use crate::event::{Output, Topic};
use crate::parameters::FrameParameters;

/// States that hold less are not published.
const LEAST_MASS: f64 = 1e-4;

/// At most so many of the heaviest states are published.
const MAX_PARTICLES: usize = 500;

/// Metres to millimetres.
pub(crate) const MM_PER_M: f64 = 1000.0;

/// An episode where it is in space.
pub struct Scene<'a> {
    /// When the touch was taken in.
    pub time: Time,
    /// The robot's base frame.
    pub base: &'a str,
    /// Names of the other frames.
    pub frames: &'a FrameParameters,
    /// The sensor at the first touch.
    pub base_from_first: Rigid,
    /// The sensor now.
    pub base_from_sensor: Rigid,
    /// The tool's pose for one of the sensor.
    pub base_from_tool: &'a dyn Fn(&Rigid) -> Rigid,
    /// The episode.
    pub episode: &'a Episode,
    /// Its latest touch.
    pub report: &'a DecisionReport,
}

impl Scene<'_> {
    /// Everything that is published after a touch.
    ///
    /// # Errors
    /// None that an episode could have; JSON may fail in principle.
    pub fn outputs(&self) -> Result<Vec<Output>> {
        let json = serde_json::to_string(self.report)
            .map_err(|error| Error::invalid("decision", "numbers that JSON has", error.to_string()))?;
        let publish = |topic, cdr| Output::Publish { topic, cdr };
        let states = self.episode.belief().posterior().states_from(f64::MIN_POSITIVE);
        let particles = particles(&states);
        let mut outputs = vec![
            publish(Topic::Decision, to_cdr(&Text { data: json })),
            publish(Topic::Label, to_cdr(&Text { data: self.report.label() })),
        ];
        if let Some(next) = self.report.next {
            outputs.push(publish(Topic::NextAction, self.next_action(&next)));
            outputs.push(publish(Topic::NextPose, self.next_pose(&next)));
        }
        let pose = self.pose();
        outputs.push(publish(Topic::Pose, to_cdr(&pose)));
        outputs.push(publish(Topic::Frame, to_cdr(&self.frame(pose))));
        outputs.push(publish(Topic::Particles, self.pose_array(&particles)));
        outputs.push(publish(Topic::ParticleCloud, self.point_cloud(&particles)));
        outputs.push(publish(Topic::Belief, to_cdr(&self.belief(&states))));
        let felt = self.episode.felt_map();
        outputs.extend(felt.map(|felt| publish(Topic::Felt, to_cdr(&self.felt(&felt)))));
        Ok(outputs)
    }

    fn header(&self, frame_id: &str) -> Header {
        Header { stamp: self.time, frame_id: frame_id.to_owned() }
    }

    fn next_action(&self, sensor_from_next: &Se2) -> Vec<u8> {
        to_cdr(&TransformStamped {
            header: self.header(&self.frames.sensor),
            child_frame_id: format!("{}_next", self.frames.sensor),
            transform: Rigid::from_plane(sensor_from_next).to_pose(),
        })
    }

    fn next_pose(&self, sensor_from_next: &Se2) -> Vec<u8> {
        let goal = self.base_from_sensor * Rigid::from_plane(sensor_from_next);
        to_cdr(&PoseStamped { header: self.header(self.base), pose: (self.base_from_tool)(&goal).to_pose() })
    }

    /// The likeliest part in the base frame, with the covariance of its place in the plane of touch; along the press and
    /// for tilts, of which nothing is estimated, it is zero.
    fn pose(&self) -> PoseWithCovarianceStamped {
        let estimate = &self.report.estimate;
        let part_from_first = estimate.part_from_sensor * self.episode.belief().first_from_sensor().inverse();
        PoseWithCovarianceStamped {
            header: self.header(self.base),
            pose: self.base_from_part(&estimate.part_from_sensor),
            covariance: covariance(&self.base_from_first, &part_from_first, &estimate.covariance),
        }
    }

    /// A pose of the part as its frame. It is a static one: it holds until the next touch, and who comes late gets it.
    fn frame(&self, of: PoseWithCovarianceStamped) -> TFMessage {
        let PoseWithCovarianceStamped { header, pose, .. } = of;
        let child_frame_id = self.frames.part.clone();
        TFMessage { transforms: vec![TransformStamped { header, child_frame_id, transform: pose }] }
    }

    fn base_from_part(&self, part_from_sensor: &Se2) -> Pose {
        (self.base_from_sensor * Rigid::from_plane(&part_from_sensor.inverse())).to_pose()
    }

    fn part_from_sensor(&self, state: &Hypothesis) -> Se2 {
        let belief = self.episode.belief();
        belief.posterior().grid().pose(state.cell) * belief.first_from_sensor()
    }

    fn pose_array(&self, particles: &[(Hypothesis, f64)]) -> Vec<u8> {
        let poses = particles.iter().map(|(state, _)| self.base_from_part(&self.part_from_sensor(state)));
        to_cdr(&PoseArray { header: self.header(self.base), poses: poses.collect() })
    }

    fn point_cloud(&self, particles: &[(Hypothesis, f64)]) -> Vec<u8> {
        let point = |(state, mass): &(Hypothesis, f64)| {
            let part_from_sensor = self.part_from_sensor(state);
            let [x, y, z] = self.base_from_part(&part_from_sensor).position.map(|m| m as f32);
            [x, y, z, -part_from_sensor.theta_rad as f32, *mass as f32, state.part as f32]
        };
        let points: Vec<[f32; 6]> = particles.iter().map(point).collect();
        let names = ["x", "y", "z", "theta", "weight", "part"];
        to_cdr(&PointCloud2::of_floats(self.header(self.base), names, &points))
    }

    /// Where on the likeliest part the sensor is, at any angle: 100 at the likeliest place. What is outside the
    /// bank's area is left out.
    fn belief(&self, states: &[(Hypothesis, f64)]) -> OccupancyGrid {
        let grid = self.episode.belief().posterior().grid();
        let part = self.report.posterior.iter().position(|(name, _)| *name == self.report.estimate.part);
        let of_part = states.iter().filter(|(state, _)| Some(state.part) == part);
        let masses = places(grid, of_part.map(|(state, mass)| (self.part_from_sensor(state), *mass)));
        let most = masses.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let corner = -(grid.xy_half_mm + grid.xy_step_mm / 2.0);
        let n_xy = grid.n_xy() as u32;
        OccupancyGrid {
            header: self.header(&self.frames.part),
            map_load_time: self.time,
            resolution: (grid.xy_step_mm / MM_PER_M) as f32,
            width: n_xy,
            height: n_xy,
            origin: Rigid::from_plane(&Se2::new(corner, corner, 0.0)).to_pose(),
            data: masses.iter().map(|mass| (100.0 * mass / most).round() as i8).collect(),
        }
    }

    /// Where it is inside of what was touched, on the likeliest part.
    fn felt(&self, felt: &FeltMap) -> OccupancyGrid {
        let mosaic = felt.mosaic();
        let n = mosaic.n() as u32;
        let corner = -0.5 * f64::from(n) * CELL_MM;
        OccupancyGrid {
            header: self.header(&self.frames.part),
            map_load_time: self.time,
            resolution: (CELL_MM / MM_PER_M) as f32,
            width: n,
            height: n,
            origin: Rigid::from_plane(&Se2::new(corner, corner, 0.0)).to_pose(),
            data: insides(&mosaic),
        }
    }
}

/// The probability that each cell is inside of what was touched, %, rows from the top; -1 where no touch showed it.
fn insides(mosaic: &Mosaic<'_>) -> Vec<i8> {
    let n = mosaic.n();
    let of_cell = |at: usize| match mosaic.cell(at % n, at / n).1 {
        Place { n_seen: 0.0, .. } => -1,
        Place { inside, .. } => (100.0 * inside).round() as i8,
    };
    (0..n * n).map(of_cell).collect()
}

/// The heaviest of some states, the heaviest first.
fn particles(states: &[(Hypothesis, f64)]) -> Vec<(Hypothesis, f64)> {
    let mut heavy: Vec<(Hypothesis, f64)> = states.iter().filter(|(_, mass)| *mass >= LEAST_MASS).copied().collect();
    // Stable: of equals the first stays first.
    heavy.sort_by(|a, b| b.1.total_cmp(&a.1));
    heavy.truncate(MAX_PARTICLES);
    heavy
}

/// The mass at each place of a grid, rows of equal y, angles summed.
fn places(grid: &PoseGrid, poses: impl Iterator<Item = (Se2, f64)>) -> Vec<f64> {
    let n_xy = grid.n_xy();
    let mut masses = vec![0.0; n_xy * n_xy];
    let index = |mm: f64| {
        let steps = ((mm + grid.xy_half_mm) / grid.xy_step_mm).round();
        (0.0..n_xy as f64).contains(&steps).then_some(steps as usize)
    };
    for (pose, mass) in poses {
        if let (Some(row), Some(column)) = (index(pose.y_mm), index(pose.x_mm)) {
            masses[row * n_xy + column] += mass;
        }
    }
    masses
}

/// The covariance of the part in the base frame, `base_from_first * part_from_first^-1`, as ROS has it: row by row, x, y
/// and z in metres, then rotations about the base's axes in radians. First order.
pub(crate) fn covariance(
    base_from_first: &Rigid,
    part_from_first: &Se2,
    of_part_from_first: &[[f64; 3]; 3],
) -> [f64; 36] {
    let Se2 { x_mm, y_mm, theta_rad } = *part_from_first;
    let (sin, cos) = theta_rad.sin_cos();
    // The inverse is (-R^T t, -theta): its derivatives by x, y (mm) and theta.
    let by = [
        [-cos / MM_PER_M, -sin / MM_PER_M, (sin * x_mm - cos * y_mm) / MM_PER_M],
        [sin / MM_PER_M, -cos / MM_PER_M, (cos * x_mm + sin * y_mm) / MM_PER_M],
    ];
    let axes = base_from_first.matrix();
    let row = |i: usize, column: usize| match i {
        0..3 => axes[i][0] * by[0][column] + axes[i][1] * by[1][column],
        _ if column == 2 => -axes[i - 3][2],
        _ => 0.0,
    };
    let mut whole = [0.0; 36];
    for (at, value) in whole.iter_mut().enumerate() {
        let (i, j) = (at / 6, at % 6);
        for (k, l) in (0..9).map(|kl| (kl / 3, kl % 3)) {
            *value += row(i, k) * of_part_from_first[k][l] * row(j, l);
        }
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::dataset::touch::Side;
    use tactile_infer::maps::mosaic::Mosaics;

    #[test]
    fn what_was_felt_is_a_grid_of_percents_with_rows_from_the_top() {
        // Two by two cells: inside, outside; not seen, in doubt.
        let cell = |inside: f32, n_seen: f32| [0.0, inside, 0.0, 0.1, n_seen];
        let values = [cell(1.0, 2.0), cell(0.0, 1.0), cell(0.5, 0.0), cell(0.625, 1.0)].concat();
        let mosaics = Mosaics::new([1, 1, 2, 2, 5], values).unwrap();
        assert_eq!(insides(&mosaics.of(0, Side::Peg)), [100, 0, -1, 63]);
    }

    /// The covariance against differences of poses composed in space.
    #[test]
    fn the_covariance_in_the_base_frame_is_that_of_poses_that_are_shaken() {
        let base_from_first = Rigid::from_xyz_rpy([0.3, -0.2, 0.5], [3.0, 0.2, 0.7], "here").unwrap();
        let mean = Se2::new(3.0, -5.0, 0.8);
        let part_in_base = |pose: &Se2| base_from_first * Rigid::from_plane(&pose.inverse());
        let there = part_in_base(&mean);
        // One axis at a time: variance h^2 gives the outer product of the shifts.
        for (axis, h) in [(0, 1e-3), (1, 1e-3), (2, 1e-6)] {
            let mut of_part = [[0.0; 3]; 3];
            of_part[axis][axis] = h * h;
            let got = covariance(&base_from_first, &mean, &of_part);
            let mut shaken = mean;
            match axis {
                0 => shaken.x_mm += h,
                1 => shaken.y_mm += h,
                _ => shaken.theta_rad += h,
            }
            let moved = part_in_base(&shaken);
            let shift: [f64; 3] = std::array::from_fn(|i| moved.to_pose().position[i] - there.to_pose().position[i]);
            // A small rotation about fixed axes: twice the vector part of the quaternion.
            let turn = moved * there.inverse();
            let q = turn.to_pose().orientation;
            let change: [f64; 6] =
                std::array::from_fn(|i| if i < 3 { shift[i] } else { 2.0 * q[i - 3] * q[3].signum() });
            for (at, value) in got.iter().enumerate() {
                let expected = change[at / 6] * change[at % 6];
                assert!((value - expected).abs() < 2e-3 * h * h, "axis {axis}, {at}: {value} {expected}");
            }
        }
    }

    #[test]
    fn places_sum_the_angles_and_rows_are_of_equal_y() {
        let grid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
        let at = Se2::from_degrees;
        let poses = [(at(2.0, -2.0, 30.0), 0.5), (at(2.4, -2.0, -30.0), 0.25), (at(-2.0, 2.0, 0.0), 0.25)];
        let outside = (at(3.1, 0.0, 0.0), 0.5);
        assert_eq!(places(&grid, poses.into_iter().chain([outside])), [0.0, 0.0, 0.75, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0]);
    }
}

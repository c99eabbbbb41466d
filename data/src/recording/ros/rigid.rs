//! Rigid motions in space, as ROS gives them, and their projection on a part's plane.

use std::ops::Mul;

use crate::error::{Error, Result};
use crate::pose::se2::Se2;
use crate::recording::ros::messages::Pose;

/// Metres to millimetres.
const MM_PER_M: f64 = 1000.0;

/// No robot reaches further, metres: poses beyond it are most likely in mm.
const FARTHEST_M: f64 = 10.0;

/// How far a quaternion's length may be from 1.
const LENGTH_TOLERANCE: f64 = 0.01;

/// A rotation, then a shift. A value named `a_from_b` takes coordinates in frame `b` to frame `a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// x, y and z, metres.
    shift_m: [f64; 3],
    /// x, y, z and w of a unit quaternion.
    rotation: [f64; 4],
}

/// A pose in space as a pose in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// The pose in the plane, mm and radians.
    pub pose: Se2,
    /// Height over the plane, mm.
    pub z_mm: f64,
    /// Angle between the sensor's plane and the part's, degrees.
    pub tilt_deg: f64,
    /// Whether the two z axes point against each other. The part's frame was then turned by 180 degrees about its x
    /// axis, so that x, y and angles are as a picture shows them.
    pub is_turned: bool,
}

impl Rigid {
    /// The motion that moves nothing.
    pub const IDENTITY: Self = Self { shift_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// A pose from a message; `place` names it in errors.
    ///
    /// # Errors
    /// Numbers that are not finite, more than 10 m, a quaternion that is not of length 1.
    pub fn from_pose(pose: &Pose, place: &str) -> Result<Self> {
        let Pose { position, orientation } = pose;
        if !position.iter().all(|m| m.abs() <= FARTHEST_M) {
            let expected = format!("a position within {FARTHEST_M} m (ROS counts in metres)");
            return Err(Error::invalid(place, expected, format!("{position:?}")));
        }
        let length = orientation.iter().map(|q| q * q).sum::<f64>().sqrt();
        // Not a number is not near 1 either.
        let is_unit = (length - 1.0).abs() <= LENGTH_TOLERANCE;
        if !is_unit {
            return Err(Error::invalid(place, "a quaternion of length 1", format!("{orientation:?}")));
        }
        Ok(Self { shift_m: *position, rotation: orientation.map(|q| q / length) })
    }

    /// A pose in the plane z = 0.
    pub fn from_plane(pose: &Se2) -> Self {
        let (sin, cos) = (pose.theta_rad / 2.0).sin_cos();
        Self { shift_m: [pose.x_mm / MM_PER_M, pose.y_mm / MM_PER_M, 0.0], rotation: [0.0, 0.0, sin, cos] }
    }

    /// A shift in metres, then rotations about the fixed axes x, y and z (roll, pitch and yaw of REP 103), radians.
    ///
    /// # Errors
    /// Numbers that are not finite, more than 10 m; `place` names them.
    pub fn from_xyz_rpy(xyz_m: [f64; 3], rpy_rad: [f64; 3], place: &str) -> Result<Self> {
        let about = |axis: usize| {
            let (sin, cos) = (rpy_rad[axis] / 2.0).sin_cos();
            let mut rotation = [0.0, 0.0, 0.0, cos];
            rotation[axis] = sin;
            rotation
        };
        let orientation = product(about(2), product(about(1), about(0)));
        Self::from_pose(&Pose { position: xyz_m, orientation }, place)
    }

    /// A shift in metres.
    pub fn from_shift(shift_m: [f64; 3]) -> Self {
        Self { shift_m, ..Self::IDENTITY }
    }

    /// How far the origin is moved, mm.
    pub fn length_mm(&self) -> f64 {
        self.shift_m.iter().map(|m| m * m).sum::<f64>().sqrt() * MM_PER_M
    }

    /// By how much it turns, degrees, 0..=180.
    pub fn angle_deg(&self) -> f64 {
        let [x, y, z, w] = self.rotation;
        2.0 * (x * x + y * y + z * z).sqrt().atan2(w.abs()).to_degrees()
    }

    /// The rotation as a matrix, row by row.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| rotate(self.rotation, axis));
        std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row]))
    }

    /// The same as a message has it.
    pub fn to_pose(self) -> Pose {
        Pose { position: self.shift_m, orientation: self.rotation }
    }

    /// `b_from_a` for this `a_from_b`.
    pub fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation;
        let rotation = [-x, -y, -z, w];
        Self { shift_m: rotate(rotation, self.shift_m).map(|m| -m), rotation }
    }

    /// The motion at `share`, 0 to 1, of the way to `other`: the shift along a line, the rotation at constant speed
    /// (Shoemake 1985, "Animating rotation with quaternion curves").
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        let dot: f64 = self.rotation.iter().zip(other.rotation).map(|(a, b)| a * b).sum();
        // A quaternion and its negative are one rotation: the nearer one is the way to go.
        let (dot, sign) = if dot < 0.0 { (-dot, -1.0) } else { (dot, 1.0) };
        let angle = dot.min(1.0).acos();
        let [a, b] = match angle.sin() {
            // Nearly the same: the line is the arc, to 1e-12.
            sin if sin < 1e-6 => [1.0 - share, share],
            sin => [((1.0 - share) * angle).sin() / sin, (share * angle).sin() / sin],
        };
        let mix = |from: f64, to: f64, a: f64, b: f64| a * from + b * to;
        let rotation: [f64; 4] = std::array::from_fn(|i| mix(self.rotation[i], sign * other.rotation[i], a, b));
        let length = rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        Self {
            shift_m: std::array::from_fn(|i| mix(self.shift_m[i], other.shift_m[i], 1.0 - share, share)),
            rotation: rotation.map(|q| q / length),
        }
    }

    /// The pose of a sensor in the plane of a part, for this `part_from_sensor`.
    pub fn project(&self) -> Projected {
        let [x, y, ..] = self.rotation;
        let is_turned = x * x + y * y > 0.5;
        let half_turn_about_x = Self { shift_m: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0] };
        let Self { shift_m, rotation: [x, y, z, w] } = if is_turned { half_turn_about_x * *self } else { *self };
        Projected {
            pose: Se2::new(shift_m[0] * MM_PER_M, shift_m[1] * MM_PER_M, 2.0 * z.atan2(w)),
            z_mm: self.shift_m[2] * MM_PER_M,
            tilt_deg: 2.0 * x.hypot(y).min(1.0).asin().to_degrees(),
            is_turned,
        }
    }
}

impl Mul for Rigid {
    type Output = Self;

    fn mul(self, b_from_c: Self) -> Self {
        let shift = rotate(self.rotation, b_from_c.shift_m);
        Self {
            shift_m: std::array::from_fn(|i| self.shift_m[i] + shift[i]),
            rotation: product(self.rotation, b_from_c.rotation),
        }
    }
}

/// Hamilton's product.
fn product([x1, y1, z1, w1]: [f64; 4], [x2, y2, z2, w2]: [f64; 4]) -> [f64; 4] {
    [
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    ]
}

fn rotate(rotation: [f64; 4], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [qx, qy, qz, w] = rotation;
    let [x, y, z, _] = product(product(rotation, [x, y, z, 0.0]), [-qx, -qy, -qz, w]);
    [x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn roll_pitch_and_yaw_are_rep_103s() {
        // Yaw is made last: a quarter turn about x, then one about z, brings z to x.
        let quarter = std::f64::consts::FRAC_PI_2;
        let turned = Rigid::from_xyz_rpy([0.003, 0.004, 0.0], [quarter, 0.0, quarter], "here").unwrap();
        let [[xz, ..], [..], [..]] = turned.matrix().map(|[_, _, z]| [z]);
        assert!((xz - 1.0).abs() < 1e-12 && (turned.length_mm() - 5.0).abs() < 1e-12);
        assert!((turned.angle_deg() - 120.0).abs() < 1e-9, "{}", turned.angle_deg());
        assert!(Rigid::from_xyz_rpy([f64::NAN, 0.0, 0.0], [0.0; 3], "here").is_err());
    }

    fn rigid() -> impl Strategy<Value = Rigid> {
        let unit = prop::array::uniform4(-1.0..1.0_f64).prop_filter("not zero", |q| q.iter().any(|v| v.abs() > 0.1));
        (prop::array::uniform3(-1.0..1.0_f64), unit).prop_map(|(position, q)| {
            let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            Rigid { shift_m: position, rotation: q.map(|v| v / length) }
        })
    }

    /// The rotation as a matrix, from the textbook.
    fn matrix(Rigid { rotation: [x, y, z, w], .. }: Rigid) -> [[f64; 3]; 3] {
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    proptest! {
        #[test]
        fn composing_is_the_product_of_matrices(a in rigid(), b in rigid()) {
            let (ma, mb, mab) = (matrix(a), matrix(b), matrix(a * b));
            for i in 0..3 {
                let shift: f64 = (0..3).map(|k| ma[i][k] * b.shift_m[k]).sum::<f64>() + a.shift_m[i];
                prop_assert!(near((a * b).shift_m[i], shift));
                for j in 0..3 {
                    prop_assert!(near(mab[i][j], (0..3).map(|k| ma[i][k] * mb[k][j]).sum()));
                }
            }
            let back = a * a.inverse();
            prop_assert!(back.shift_m.iter().all(|m| near(*m, 0.0)) && near(back.rotation[3].abs(), 1.0));
        }

        #[test]
        fn the_plane_comes_back_and_composes_as_in_the_plane(
            x in -50.0..50.0_f64, y in -50.0..50.0_f64, t in -3.1..3.1_f64, u in -3.1..3.1_f64,
        ) {
            let (a, b) = (Se2::new(x, y, t), Se2::new(y, x, u));
            let Projected { pose, z_mm, tilt_deg, is_turned } = (Rigid::from_plane(&a) * Rigid::from_plane(&b)).project();
            prop_assert!(pose.distance_mm(&(a * b)) < 1e-9 && z_mm == 0.0 && tilt_deg == 0.0 && !is_turned);
            prop_assert!(near((pose.theta_rad - (a * b).theta_rad).sin(), 0.0));
        }

        #[test]
        fn a_sensor_that_looks_down_moves_as_its_picture_does(
            x in -0.05..0.05_f64, y in -0.05..0.05_f64, t in -3.1..3.1_f64, dx in -5.0..5.0_f64, dy in -5.0..5.0_f64,
        ) {
            // The part's z points up, the sensor's down; it then moves by dx, dy in its own frame.
            let (sin, cos) = (t / 2.0_f64).sin_cos();
            let down = Rigid { shift_m: [x, y, 0.1], rotation: [cos, sin, 0.0, 0.0] };
            let moved = Se2::new(dx, dy, 0.3);
            let [before, after] = [down, down * Rigid::from_plane(&moved)].map(|pose| pose.project());
            prop_assert!(before.is_turned && after.is_turned && before.tilt_deg < 1e-5);
            let found = before.pose.inverse() * after.pose;
            prop_assert!(found.distance_mm(&moved) < 1e-9 && near(found.theta_rad, 0.3), "{found:?}");
        }
    }

    #[test]
    fn half_the_way_is_half_the_angle_on_the_short_side() {
        let a = Rigid::from_plane(&Se2::from_degrees(0.0, 10.0, 170.0));
        let b = Rigid::from_plane(&Se2::from_degrees(4.0, 20.0, -170.0));
        for b in [b, Rigid { rotation: b.rotation.map(|q| -q), ..b }] {
            let pose = a.towards(&b, 0.25).project().pose;
            assert!(near(pose.x_mm, 1.0) && near(pose.y_mm, 12.5) && near(pose.theta_deg(), 175.0), "{pose:?}");
        }
        assert_eq!(a.towards(&a, 0.5).shift_m, a.shift_m);
    }

    #[test]
    fn the_tilt_is_the_angle_between_the_planes() {
        let (sin, cos) = (10.0_f64.to_radians() / 2.0).sin_cos();
        let tilted = Rigid { shift_m: [0.0, 0.0, 0.002], rotation: [0.0, sin, 0.0, cos] };
        let Projected { tilt_deg, z_mm, .. } =
            (Rigid::from_plane(&Se2::from_degrees(1.0, 2.0, 40.0)) * tilted).project();
        assert!(near(tilt_deg, 10.0) && near(z_mm, 2.0));
    }

    #[test]
    fn poses_that_make_no_sense_are_refused() {
        let pose = |x, w| Pose { position: [x, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, w] };
        for (bad, reason) in [
            (pose(120.0, 1.0), "in metres"),
            (pose(f64::NAN, 1.0), "in metres"),
            (pose(0.0, 0.0), "length 1"),
            (pose(0.0, f64::INFINITY), "length 1"),
        ] {
            let message = Rigid::from_pose(&bad, "here").unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        }
        assert_eq!(Rigid::from_pose(&pose(1.0, 1.009), "here").unwrap().rotation[3], 1.0);
    }
}

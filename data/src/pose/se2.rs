//! Rigid motions of the plane. A value named `a_from_b` takes coordinates in frame `b` to frame `a`.

use std::f64::consts::{PI, TAU};
use std::ops::Mul;

use serde::{Deserialize, Serialize};

/// A rigid motion of the plane, SE(2): a rotation by `theta_rad`, then a shift.
///
/// Frames have x to the right, y downwards and angles from x towards y, as images do.
/// `a_from_b * b_from_c` is `a_from_c`, so a robot's motion, made in the sensor's own frame,
/// composes on the right: `part_from_next = part_from_sensor * sensor_from_next` (paper, Sec. IV-B).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Se2 {
    /// Shift along x, mm.
    pub x_mm: f64,
    /// Shift along y, mm.
    pub y_mm: f64,
    /// Rotation in radians, in (-pi, pi].
    pub theta_rad: f64,
}

impl Se2 {
    /// The motion that moves nothing.
    pub const IDENTITY: Self = Self { x_mm: 0.0, y_mm: 0.0, theta_rad: 0.0 };

    /// A motion from a shift in mm and an angle in radians (any finite angle; it is wrapped).
    pub fn new(x_mm: f64, y_mm: f64, theta_rad: f64) -> Self {
        Self { x_mm, y_mm, theta_rad: wrap_angle(theta_rad) }
    }

    /// A motion from a shift in mm and an angle in degrees.
    pub fn from_degrees(x_mm: f64, y_mm: f64, theta_deg: f64) -> Self {
        Self::new(x_mm, y_mm, theta_deg.to_radians())
    }

    /// The angle in degrees, for people.
    pub fn theta_deg(&self) -> f64 {
        self.theta_rad.to_degrees()
    }

    /// `b_from_a` for this `a_from_b`.
    pub fn inverse(&self) -> Self {
        let (sin, cos) = self.theta_rad.sin_cos();
        Self::new(-cos * self.x_mm - sin * self.y_mm, sin * self.x_mm - cos * self.y_mm, -self.theta_rad)
    }

    /// Takes a point of frame `b` to frame `a`, mm.
    pub fn apply(&self, [x_mm, y_mm]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.theta_rad.sin_cos();
        [cos * x_mm - sin * y_mm + self.x_mm, sin * x_mm + cos * y_mm + self.y_mm]
    }

    /// Distance between the origins of two poses, mm.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        (self.x_mm - other.x_mm).hypot(self.y_mm - other.y_mm)
    }

    /// Whether all three numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.x_mm.is_finite() && self.y_mm.is_finite() && self.theta_rad.is_finite()
    }
}

impl Mul for Se2 {
    type Output = Self;

    #[allow(clippy::suspicious_arithmetic_impl)] // angles of composed rotations add
    fn mul(self, b_from_c: Self) -> Self {
        let [x_mm, y_mm] = self.apply([b_from_c.x_mm, b_from_c.y_mm]);
        Self::new(x_mm, y_mm, self.theta_rad + b_from_c.theta_rad)
    }
}

/// The same angle in (-pi, pi].
pub fn wrap_angle(theta_rad: f64) -> f64 {
    if -PI < theta_rad && theta_rad <= PI {
        return theta_rad;
    }
    let wrapped = theta_rad - TAU * (theta_rad / TAU).round();
    if wrapped <= -PI { wrapped + TAU } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Se2> {
        (-50.0..50.0, -50.0..50.0, -10.0..10.0).prop_map(|(x, y, t)| Se2::new(x, y, t))
    }

    proptest! {
        #[test]
        fn a_motion_and_its_inverse_cancel(pose in pose()) {
            let back = pose * pose.inverse();
            prop_assert!(back.x_mm.abs() < 1e-12 * 100.0 && back.y_mm.abs() < 1e-12 * 100.0);
            prop_assert!(back.theta_rad.abs() < 1e-12);
        }

        #[test]
        fn composing_moves_points_one_after_the_other(a in pose(), b in pose(), x in -9.0..9.0, y in -9.0..9.0) {
            let together = (a * b).apply([x, y]);
            let in_turn = a.apply(b.apply([x, y]));
            prop_assert!((together[0] - in_turn[0]).abs() < 1e-10);
            prop_assert!((together[1] - in_turn[1]).abs() < 1e-10);
        }
    }

    #[test]
    fn half_a_turn_has_one_name() {
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(3.0 * PI), PI);
        assert!((wrap_angle(TAU + 0.25) - 0.25).abs() < 1e-15);
    }

    #[test]
    fn ten_thousand_chained_actions_come_home() {
        let step = Se2::from_degrees(4.0, 0.0, 36.0);
        let end = (0..10_000).fold(Se2::IDENTITY, |pose, _| pose * step);
        // Ten steps of 36 degrees close a decagon; rounding grows no faster than steps * epsilon * reach.
        assert!(end.distance_mm(&Se2::IDENTITY) < 10_000.0 * f64::EPSILON * 100.0);
        assert!(end.theta_rad.abs() < 10_000.0 * f64::EPSILON * 10.0);
    }
}

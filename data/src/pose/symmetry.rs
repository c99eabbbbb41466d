//! Which turns of a part change nothing that can be felt.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::pose::se2::{Se2, wrap_angle};

/// The turns about a centre after which a part feels the same.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Symmetry {
    /// How many turns, by equal angles, the turn by 0 degrees among them: 1 for a part without symmetry. `None`: any
    /// turn, of a round part.
    pub order: Option<usize>,
    /// The point that stays where it is, in the part's frame, mm.
    pub centre_mm: [f64; 2],
}

impl Symmetry {
    /// A part without symmetry.
    pub const NONE: Self = Self { order: Some(1), centre_mm: [0.0; 2] };

    /// The most turns of a part that is not round.
    pub const MAX_ORDER: usize = 36;

    /// Whether some turn changes nothing.
    pub fn is_any(&self) -> bool {
        self.order != Some(1)
    }

    /// Whether a part could have it: 1 to 36 turns, or any, about a finite centre.
    pub fn is_valid(&self) -> bool {
        self.order.is_none_or(|order| (1..=Self::MAX_ORDER).contains(&order))
            && self.centre_mm.iter().all(|mm| mm.is_finite())
    }

    /// The poses that feel the same as this one, itself first, `[order]`; of a round part 36 of them.
    pub fn twins(&self, part_from_sensor: &Se2) -> Vec<Se2> {
        let order = self.order.unwrap_or(Self::MAX_ORDER);
        (0..order).map(|k| self.turn(TAU * k as f64 / order as f64) * *part_from_sensor).collect()
    }

    /// The pose nearest to another among the poses that feel the same as `pose`, by millimetres and degrees together;
    /// of a round part the one at the same angle.
    pub fn nearest_twin(&self, pose: &Se2, to: &Se2) -> Se2 {
        if self.order.is_none() {
            return self.turn(to.theta_rad - pose.theta_rad) * *pose;
        }
        let off = |twin: &Se2| twin.distance_mm(to) + wrap_angle(twin.theta_rad - to.theta_rad).to_degrees().abs();
        self.twins(pose).into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(*pose)
    }

    /// A turn about the centre, to the left of a pose.
    pub fn turn(&self, theta_rad: f64) -> Se2 {
        let [x, y] = self.centre_mm;
        Se2::new(x, y, 0.0) * Se2::new(0.0, 0.0, theta_rad) * Se2::new(-x, -y, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twins_are_turned_about_the_centre() {
        let symmetry = Symmetry { order: Some(4), centre_mm: [1.0, 2.0] };
        let twins = symmetry.twins(&Se2::from_degrees(2.0, 2.0, 10.0));
        let expected = [[2.0, 2.0, 10.0], [1.0, 3.0, 100.0], [0.0, 2.0, -170.0], [1.0, 1.0, -80.0]];
        assert_eq!(twins.len(), 4);
        for (twin, [x, y, theta]) in twins.iter().zip(expected) {
            let turned = wrap_angle(twin.theta_rad - f64::to_radians(theta)).abs();
            assert!((twin.x_mm - x).hypot(twin.y_mm - y) < 1e-12 && turned < 1e-12, "{twins:?}");
        }
    }

    #[test]
    fn the_nearest_twin_is_found_whatever_the_order() {
        let (pose, to) = (Se2::from_degrees(2.0, 2.0, 10.0), Se2::from_degrees(0.1, 2.0, -165.0));
        let of = |order| Symmetry { order, centre_mm: [1.0, 2.0] }.nearest_twin(&pose, &to);
        assert_eq!(of(Some(1)), pose);
        let half = of(Some(4));
        assert!(half.distance_mm(&Se2::from_degrees(0.0, 2.0, 0.0)) < 1e-12 && (half.theta_deg() + 170.0).abs() < 1e-9);
        // A round part: the same angle, as far from the centre as before and in the same direction from it as felt.
        let round = of(None);
        let seen = |pose: &Se2| pose.inverse().apply([1.0, 2.0]);
        assert!((round.theta_deg() + 165.0).abs() < 1e-9);
        assert!(seen(&round).iter().zip(seen(&pose)).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

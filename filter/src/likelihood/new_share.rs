//! How much of a touch is new after an earlier one.

use tactile_data::pose::se2::{Se2, wrap_angle};

/// The share of a touch that an earlier one did not tell, 0..=1: `1 - exp(-sqrt((d / shared_mm)^2 + turn^2))` where the sensor
/// moved by `d` and turned by `turn` radians. What makes one touch match a wrong part, the same print and the same play under the
/// same sensor, does so to a touch near it, too.
///
/// `shared_mm` of 0: all of it is new.
pub(crate) fn new_share(shared_mm: f64, earlier: &Se2, now: &Se2) -> f64 {
    if shared_mm <= 0.0 {
        return 1.0;
    }
    let (shift, turn) = (earlier.distance_mm(now) / shared_mm, wrap_angle(earlier.theta_rad - now.theta_rad));
    -(-shift.hypot(turn)).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_new_of_a_touch_grows_with_its_distance_and_its_turn() {
        let share = |x: f64, radians: f64| new_share(8.0, &Se2::IDENTITY, &Se2::new(x, 0.0, radians));
        assert_eq!(share(0.0, 0.0), 0.0);
        // 1 - 1 / e on either axis, 1 - 1 / e^5 by a shift of three and a turn of four.
        let by_hand = 1.0 - 1.0 / std::f64::consts::E;
        assert!((share(8.0, 0.0) - by_hand).abs() < 1e-12 && (share(0.0, -1.0) - by_hand).abs() < 1e-12);
        let both = new_share(1.0, &Se2::IDENTITY, &Se2::new(4.0, 0.0, 3.0));
        assert!((both - (1.0 - (-5.0_f64).exp())).abs() < 1e-12);
        // The way that is shorter round the circle.
        let [a, b] = [3.0, -3.0].map(|radians| Se2::new(0.0, 0.0, radians));
        assert!((new_share(8.0, &a, &b) - (1.0 - (6.0 - std::f64::consts::TAU).exp())).abs() < 1e-12);
        assert_eq!(new_share(0.0, &Se2::IDENTITY, &Se2::IDENTITY), 1.0);
    }
}

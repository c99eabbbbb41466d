//! How much of a touch is new when it repeats an earlier one.

use tactile_data::se2::{Se2, wrap_angle};

/// How little is left of a touch's evidence where it repeats an earlier one: views that overlap share
/// what they show and most of their error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Distance at which views count as apart, mm; zero counts all touches as independent.
    pub mm: f64,
    /// Turn at which views count as apart, degrees.
    pub deg: f64,
}

impl Overlap {
    /// Share of a touch's evidence that an earlier touch did not give, 0..=1:
    /// `1 - exp(-(d^2 / mm^2 + turn^2 / deg^2) / 2)`.
    pub fn new_share(&self, earlier: &Se2, now: &Se2) -> f64 {
        if self.mm <= 0.0 {
            return 1.0;
        }
        let turn = wrap_angle(earlier.theta_rad - now.theta_rad).to_degrees() / self.deg;
        let shift = earlier.distance_mm(now) / self.mm;
        1.0 - (-0.5 * (shift * shift + turn * turn)).exp()
    }
}

//! What a robot spends: seconds of touches and of the ways between them.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// How long what a robot does takes. A decision takes milliseconds, which are left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Speeds {
    /// A touch: down, press and up again, seconds.
    pub touch_s: f64,
    /// From touch to touch, mm a second.
    pub mm_s: f64,
}

impl Default for Speeds {
    fn default() -> Self {
        Self { touch_s: 3.0, mm_s: 50.0 }
    }
}

impl Speeds {
    /// Seconds of so many touches and so long a way, mm.
    pub fn seconds(&self, n_touches: usize, travel_mm: f64) -> f64 {
        n_touches as f64 * self.touch_s + travel_mm / self.mm_s
    }

    /// # Errors
    /// A touch that takes less than no time, a speed that is not above zero.
    pub fn validate(&self) -> Result<()> {
        let Self { touch_s, mm_s } = *self;
        if touch_s >= 0.0 && touch_s.is_finite() && mm_s > 0.0 && mm_s.is_finite() {
            return Ok(());
        }
        let expected = "seconds of a touch and a speed above zero";
        Err(Error::config("--touch-s, --mm-s", expected, format!("{touch_s} s, {mm_s} mm a second")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_of_touches_and_ways() {
        assert_eq!(Speeds { touch_s: 2.0, mm_s: 40.0 }.seconds(3, 100.0), 8.5);
        for (touch_s, mm_s, is_ok) in [
            (0.0, 1.0, true),
            (-0.1, 1.0, false),
            (1.0, 0.0, false),
            (f64::NAN, 1.0, false),
            (1.0, f64::INFINITY, false),
        ] {
            assert_eq!(Speeds { touch_s, mm_s }.validate().is_ok(), is_ok, "{touch_s} {mm_s}");
        }
    }
}

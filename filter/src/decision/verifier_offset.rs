//! What a verifier says of this sensor's touches, less than of simulated ones: learnt from the holes of a run that were named with
//! confidence.
//!
//! A verifier knows what it says of touches of a part under a simulated sensor ([`Verified::expected`]). Of those of another sensor it
//! says as much less for every part, and for a stranger, too: an offset, normal with its conjugate prior.

use serde::{Deserialize, Serialize};
use tactile_infer::calibration::presence::Verified;

use crate::decision::sensor_match::{MOST, independent};

/// Standard deviation of what is said of one touch about the mean of a sensor, nats: MAZE parts under six drawn sensors.
const SD: f64 = 2.0;

/// How far that mean may be from what is expected, nats: drawn sensors pressed 2.5 mm deep are so far off, pressed as usual 0.5.
const REACH: f64 = 4.0;

/// Touches that an offset of zero counts as.
const PRIOR: f64 = (SD / REACH) * (SD / REACH);

/// What was learnt of a sensor by a verifier; nothing at first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerifierOffset {
    /// What is said of a touch more than expected, nats.
    pub nats: f64,
    /// Touches that this is known from, counted as independent ones.
    pub weight: f64,
}

/// What is said of a hole's touches more than is expected of each, the mean, nats, and how many they are, each as much as it is new.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Said {
    mean: f64,
    n_new: f64,
}

impl Said {
    /// `None` where nobody knows what to expect of the part, or no edge was felt.
    fn of(verified: &Verified) -> Option<Self> {
        let Verified { log_odds, n_new, expected, .. } = *verified;
        (n_new > 0.0).then_some(Self { mean: log_odds / n_new - expected?.mean, n_new })
    }
}

impl VerifierOffset {
    /// What is said, without what is this sensor's.
    pub(crate) fn taken_off(&self, verified: Verified) -> Verified {
        Verified { log_odds: verified.log_odds - verified.n_new * self.nats, ..verified }
    }

    /// With what one more confident hole tells, if it tells anything.
    pub(crate) fn with(&self, verified: &Verified) -> Self {
        let Some(Said { mean, n_new }) = Said::of(verified) else { return *self };
        let (weight, known) = (independent(n_new), PRIOR + self.weight);
        let most = MOST * SD * (weight.recip() + known.recip()).sqrt();
        let apart = (mean - self.nats).clamp(-most, most);
        Self { nats: self.nats + apart * weight / (known + weight), weight: self.weight + weight }
    }

    /// Whether holes may have told this.
    pub(crate) fn is_told(&self) -> bool {
        self.nats.abs() < 1e6 && (0.0..1e12).contains(&self.weight) && (self.weight > 0.0 || self.nats == 0.0)
    }

    pub(crate) fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_infer::calibration::Spread;

    fn said(mean: f64, n_new: f64) -> Verified {
        let expected = Some(Spread { mean: 5.0, sd: 2.0 });
        Verified { log_odds: n_new * (5.0 + mean), n_new, expected, outline_mm: [40.0, 10.0] }
    }

    /// The posterior on a grid of offsets, from the density of each hole's mean.
    #[test]
    fn holes_tell_what_the_posterior_on_a_grid_has() {
        let holes = [(-3.0, 2.5), (-4.2, 1.0), (-2.8, 4.0)];
        let learnt = holes.iter().fold(VerifierOffset::default(), |known, (mean, n)| known.with(&said(*mean, *n)));
        let density = |offset: f64| {
            let of_holes = holes.iter().map(|(mean, n)| {
                // A tenth of the variance is common to a hole's touches.
                let variance = 4.0 * (0.1 + 0.9 / n);
                (mean - offset) * (mean - offset) / variance
            });
            (-0.5 * (of_holes.sum::<f64>() + offset * offset / 16.0)).exp()
        };
        let grid = (-4_000..4_000).map(|at| 0.005 * f64::from(at));
        let (total, sum) = grid.fold((0.0, 0.0), |(total, sum), x| (total + density(x), sum + x * density(x)));
        assert!((learnt.nats - sum / total).abs() < 1e-6, "{learnt:?} {}", sum / total);
        let taken = learnt.taken_off(said(-3.0, 2.0));
        assert!((taken.log_odds - (4.0 - 2.0 * learnt.nats)).abs() < 1e-12 && taken.n_new == 2.0);
    }

    #[test]
    fn a_wrong_name_moves_little_and_what_nobody_expects_nothing() {
        let many = (0..20).fold(VerifierOffset::default(), |known, _| known.with(&said(-3.0, 3.0)));
        assert!((many.nats + 3.0).abs() < 0.02, "{many:?}");
        let wrong = many.with(&said(-80.0, 3.0));
        assert!(many.nats - wrong.nats < 0.25, "{wrong:?}");
        let unknown = Verified { expected: None, ..said(-3.0, 3.0) };
        assert_eq!([many.with(&unknown), many.with(&said(-3.0, 0.0))], [many; 2]);
    }
}

//! What a verifier says of this sensor's touches, less than of simulated ones: learnt from the holes of a run that were named with
//! confidence.
//!
//! A verifier knows what it says of touches of a part under a simulated sensor ([`Verified::expected`]). Of those of another sensor it
//! says more or less, as much of every part: an offset, normal with its conjugate prior.

use serde::{Deserialize, Serialize};
use tactile_infer::calibration::presence::Verified;
use tactile_infer::maps::sensor_offset::SensorOffset;

use crate::decision::sensor_match::independent;
use crate::touch_model::TouchModel;

/// Standard deviation of what is said of one touch about the mean of a sensor, nats: MAZE parts under six drawn sensors.
const SD: f64 = 2.0;

/// How much of the offset is taken off: of parts a verifier says less by all of it, of strangers by nothing as far as anyone knows, and
/// halfway between them it cannot tell. All of it names a tenth of the look-alikes where bank and touches are pressed 2 mm apart in depth.
const SHARE: f64 = 0.5;

/// What was learnt of a sensor by a verifier; nothing at first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerifierOffset {
    /// What is said of a touch more than expected and than [`TouchModel::verifier_offset`], nats.
    pub nats: f64,
    /// Touches that this is known from, counted as independent ones.
    pub weight: f64,
}

impl VerifierOffset {
    /// What is said, less what is this sensor's.
    pub(super) fn taken_off(&self, model: &TouchModel, verified: Verified) -> Verified {
        let nats = SHARE * (model.verifier_offset + self.nats);
        Verified { log_odds: verified.log_odds - verified.n_new * nats, ..verified }
    }

    /// With what one more confident hole tells, if it tells anything. `usual`: what is said of a touch on a part that the bank does not
    /// know.
    pub(crate) fn with(&self, model: &TouchModel, verified: &Verified, usual: f64) -> Self {
        let n_new = verified.n_new;
        // No edge was felt.
        if n_new <= 0.0 {
            return *self;
        }
        let mean = verified.log_odds / n_new - verified.expected_mean(usual);
        let (weight, of_one) = (independent(n_new), SD * SD);
        let known = SensorOffset { mean: self.nats, information: self.weight / of_one };
        let known = known.with([mean - model.verifier_offset, of_one / weight], model.verifier_touches / of_one);
        Self { nats: known.mean, weight: self.weight + weight }
    }

    /// Whether these are numbers that holes can give.
    pub(crate) fn is_valid(&self) -> bool {
        SensorOffset { mean: self.nats, information: self.weight }.is_within(1e6)
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
        Verified { log_odds: n_new * (5.0 + mean), n_new, expected, outline_mm: [40.0, 10.0], ..Verified::default() }
    }

    /// The posterior on a grid of offsets, from the density of each hole's mean.
    #[test]
    fn holes_tell_what_the_posterior_on_a_grid_has() {
        let holes = [(-3.0, 2.5), (-4.2, 1.0), (-2.8, 4.0)];
        let learnt = holes.iter().fold(VerifierOffset::default(), |known, (mean, n)| {
            known.with(&TouchModel::default(), &said(*mean, *n), 3.0)
        });
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
        let taken = learnt.taken_off(&TouchModel::default(), said(-3.0, 2.0));
        assert!((taken.log_odds - (4.0 - learnt.nats)).abs() < 1e-12 && taken.n_new == 2.0);
    }

    #[test]
    fn a_wrong_name_moves_little_and_a_calibration_counts_as_its_touches() {
        let model = TouchModel::default();
        let many = (0..20).fold(VerifierOffset::default(), |known, _| known.with(&model, &said(-3.0, 3.0), 3.0));
        assert!((many.nats + 3.0).abs() < 0.02, "{many:?}");
        let wrong = many.with(&model, &said(-80.0, 3.0), 3.0);
        assert!(many.nats - wrong.nats < 0.25, "{wrong:?}");
        // Without an edge nothing is said.
        assert_eq!(many.with(&model, &said(-3.0, 0.0), 3.0), many);
        // What the bank does not know is as usual: 3 instead of 5 nats.
        let unknown = Verified { expected: None, ..said(-3.0, 1.0) };
        let [first, same] = [(unknown, 3.0), (said(-1.0, 1.0), 9.0)]
            .map(|(verified, usual)| VerifierOffset::default().with(&model, &verified, usual));
        assert_eq!(first, same);
        let calibrated = TouchModel { verifier_offset: -3.0, verifier_touches: 9.0, ..model };
        let next = VerifierOffset::default().with(&calibrated, &said(-4.0, 1.0), 3.0);
        assert!((next.nats + 0.1).abs() < 1e-12, "{next:?}");
        assert!((next.taken_off(&calibrated, said(0.0, 1.0)).log_odds - 6.55).abs() < 1e-12);
    }
}

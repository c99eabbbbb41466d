//! Whether the part that is named is there at all, against a stranger: a part that the bank does not hold.
//!
//! For `n` touches with an edge, whose fit is `F` standard deviations and of which a verifier says `V`, where it says `E`
//! of as many that were made on the part, by which the part's size is known to `K` nats and off by `S`, whose maps together are off by `D` nats more than usual,
//! and which showed a share `c` of its outline, the log-odds that the named part is there, before which a stranger was as likely, are
//!
//! ```text
//! L = -ln(exp(-A) + exp(-B))
//! A = offset + by_fit sqrt(n) F + by_touch n + by_verifier V + by_expected E + by_size K + by_strain S + by_misfit D
//! B = shared.offset - shared.by_felt ln(1 - c)
//! ```
//!
//! `A` is against a stranger that differs all over: the sum of what each touch says, and what so many say of a part that is there. `B` is
//! against one that has all that was felt in common with the part, as an F has its arms with an E: no touch of these tells it, and the
//! less of the outline is left the fewer there are. How often a stranger comes to `L` or more at any touch of an episode is an exponential
//! tail (peaks over a threshold; Coles, An Introduction to Statistical Modeling of Extreme Values, 4), in proportion to the parts of the
//! bank, the best of which it looks like; how often a part that is there comes to `L` or less is another.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;

use crate::calibration::{Spread, check};
use crate::error::Result;
use crate::maps::strain::Strain;

/// The share of the episodes that a tail is fitted to.
pub const TAIL_SHARE: f64 = 0.1;

/// Weights of the log-odds.
pub const N_WEIGHTS: usize = 8;

/// A misfit of less is no better fit: touches of a part that is there come to 0.01 to 0.08.
const LEAST_MISFIT: f64 = 0.02;

/// The entries in a file: where holes are touched, where pegs are, and where holes are touched and judged by maps of holes.
pub(crate) const ENTRIES: [&str; 3] = ["presence", "peg_presence", "hole_presence"];

/// Which of the entries is of touches of a side that are laid over mosaics of a side.
pub(crate) fn entry_of(touched: Side, on: Side) -> usize {
    match (touched, on) {
        (Side::Hole, Side::Peg) => 0,
        (Side::Peg, _) => 1,
        (Side::Hole, Side::Hole) => 2,
    }
}

/// How far the extremes of episodes go: beyond `at` lie [`TAIL_SHARE`] of them, by `scale` on average.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tail {
    /// Where it begins, nats.
    pub at: f64,
    /// Mean excess, nats.
    pub scale: f64,
}

impl Tail {
    /// The tail of some episodes' extremes: where the highest [`TAIL_SHARE`] of `n` begin, and their mean excess. `extremes` may be
    /// fewer: of the others none was as high. `None` where fewer than two lie in it.
    pub fn of(mut extremes: Vec<f64>, n: usize) -> Option<Self> {
        extremes.sort_unstable_by(|a, b| b.total_cmp(a));
        let n_tail = ((TAIL_SHARE * n as f64) as usize).min(extremes.len().saturating_sub(1));
        let at = *extremes.get(n_tail)?;
        let scale = extremes[..n_tail].iter().map(|value| value - at).sum::<f64>() / n_tail as f64;
        (n_tail > 1 && scale > 0.0).then_some(Self { at, scale })
    }

    /// How far a share of the episodes goes, nats.
    pub fn reached_by(&self, share: f64) -> f64 {
        self.at + self.scale * (TAIL_SHARE / share).ln()
    }

    /// The share of the episodes that goes as far as a value, 0..=1.
    pub fn share_beyond(&self, value: f64) -> f64 {
        (TAIL_SHARE * ((self.at - value) / self.scale).exp()).min(1.0)
    }
}

/// What a verifier says of touches where a part would be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verified {
    /// The sum of their log-odds, each as much as it is new, nats.
    pub log_odds: f64,
    /// Touches with an edge, each as much as it is new.
    pub n_new: f64,
    /// What the verifier says of a touch with an edge that was made on that part, where the bank knows it.
    pub expected: Option<Spread>,
    /// The length of the part's outline, and of what is in view of the touches, mm.
    #[serde(default)]
    pub outline_mm: [f64; 2],
    /// How the part that was touched differs in size, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strain: Option<Strain>,
    /// How far all touches, stitched, are from the part's map, nats, where that was asked for
    /// ([`Mosaic::misfit`](crate::maps::mosaic::Mosaic::misfit)).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<f64>,
}

/// How far maps are off, nats: the logarithm of their misfit.
pub fn misfit_nats(misfit: f64) -> f64 {
    (misfit + LEAST_MISFIT).ln()
}

impl Verified {
    /// The log-odds, and those of as many touches that were made on the part, both by the root of their number. `usual`: what to expect
    /// of one on a part that the bank does not know.
    pub fn values(&self, usual: f64) -> [f64; 2] {
        [self.log_odds, self.n_new * self.expected_mean(usual)].map(|sum| sum / self.n_new.max(1.0).sqrt())
    }

    /// What the verifier says of a touch that was made on the part, or as usual where the bank does not know it, nats.
    pub fn expected_mean(&self, usual: f64) -> f64 {
        self.expected.map_or(usual, |expected| expected.mean)
    }

    /// How well the part's size is known, and how far off it is, nats; 0 where that was not asked for.
    pub fn size(&self) -> [f64; 2] {
        let side_mm = self.outline_mm[0] / 4.0;
        self.strain.map_or([0.0; 2], |strain| [strain.known_nats(side_mm), strain.off_nats()])
    }

    /// The same with maps that are so much less off, nats: what is a sensor's.
    #[must_use]
    pub fn with_misfit_less(self, nats: f64) -> Self {
        let less = |misfit: f64| (misfit + LEAST_MISFIT) * (-nats).exp() - LEAST_MISFIT;
        Self { misfit: self.misfit.map(less), ..self }
    }

    /// How far the maps are off beyond what is usual, nats; 0 where that was not asked for.
    pub fn misfit_nats(&self, usual: f64) -> f64 {
        self.misfit.map_or(0.0, |misfit| misfit_nats(misfit) - usual)
    }

    /// The share of the outline that is in view of the touches, 0..=1.
    pub fn felt_share(&self) -> f64 {
        let [all, felt] = self.outline_mm;
        if all > 0.0 { felt / all } else { 0.0 }
    }
}

/// What the touches of an episode come to where the named part would be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Felt {
    /// How well they fit, standard deviations.
    pub fit: f64,
    /// Touches that this is of.
    pub n_fitted: usize,
    /// What a verifier says of them, where there is one.
    pub verified: Option<Verified>,
}

impl Felt {
    /// What the weights are of, [`PresenceOdds::weights`]. `usual`: what a verifier says of a touch on a part that the bank does not know, and
    /// how far its maps are off.
    pub fn values(&self, [usual, usual_misfit]: [f64; 2]) -> [f64; N_WEIGHTS] {
        let n = self.n_fitted as f64;
        let [verified, expected] = self.verified.map_or([0.0; 2], |verified| verified.values(usual));
        let [known, off] = self.verified.map_or([0.0; 2], |verified| verified.size());
        let misfit = self.verified.map_or(0.0, |verified| verified.misfit_nats(usual_misfit));
        [1.0, n.sqrt() * self.fit, n, verified, expected, known, off, misfit]
    }
}

/// The log-odds against a stranger that has all that was felt in common with the named part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shared {
    /// Where nothing of the outline was felt, nats.
    pub offset: f64,
    /// How fast it grows with the logarithm of what is left: 1 where strangers share anything from nothing to all, each as likely.
    pub by_felt: f64,
}

/// The share of an outline of which a map never says whether it was felt.
const UNKNOWN: f64 = 0.02;

impl Shared {
    /// The log-odds where a share of the outline was felt, nats.
    pub fn log_odds(&self, felt_share: f64) -> f64 {
        self.offset + self.by_felt * left(felt_share)
    }
}

/// Minus the logarithm of the share of an outline that is left to feel.
pub fn left(felt_share: f64) -> f64 {
    -(1.0 - felt_share).max(UNKNOWN).ln()
}

/// The log-odds that the named part is there, fitted to parts that are and to strangers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PresenceOdds {
    /// What holds before any touch, nats.
    pub offset: f64,
    /// What the fit adds, nats a standard deviation of one touch.
    pub by_fit: f64,
    /// What each touch adds; 0 where holes are laid over maps of pegs.
    pub by_touch: f64,
    /// What a verifier's words add, a share of them; 0 where there is none.
    pub by_verifier: f64,
    /// What its words of touches that were made on the part add, a share of them.
    pub by_expected: f64,
    /// What a size that is known adds, a share of its nats ([`Verified::size`]); 0 where it was not fitted.
    #[serde(default)]
    pub by_size: f64,
    /// What one that is off adds, a share of its nats.
    #[serde(default)]
    pub by_strain: f64,
    /// What maps that are off add, a share of their nats; 0 where it was not fitted.
    #[serde(default)]
    pub by_misfit: f64,
    /// Against a stranger that shares what was felt; `None` where nobody knows how much of the outline that is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared: Option<Shared>,
    /// What it says of a touch that was made on a part of which no more is known, nats.
    pub usual: f64,
    /// How far the maps of such a part are off, nats ([`misfit_nats`]).
    #[serde(default)]
    pub usual_misfit: f64,
    /// How high strangers come.
    pub strangers: Tail,
    /// How far below zero parts come that are there: of `-L`.
    pub present: Tail,
    /// Parts of the banks that strangers were compared with.
    pub n_parts: f64,
    /// Episodes with strangers that this was fitted to.
    pub n_strangers: usize,
    /// Episodes with parts that were there.
    pub n_present: usize,
}

/// Whether the part that an estimate names is there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Presence {
    /// The log-odds of that against a stranger, which were even before the first touch, nats.
    pub log_odds: f64,
    /// How often a part that is not in this bank comes to so much or more at any touch of an episode, 0..=1.
    pub stranger_rate: f64,
    /// How often a part that is there comes to so little or less, 0..=1.
    pub present_rate: f64,
}

impl Presence {
    /// The probability of a stranger, 0..=1, which was even before the first touch.
    pub fn none(&self) -> f64 {
        (1.0 + self.log_odds.exp()).recip()
    }
}

/// `-ln(exp(-a) + exp(-b))`: log-odds against two kinds of stranger.
pub fn against_both(a: f64, b: f64) -> f64 {
    a.min(b) - (-(a - b).abs()).exp().ln_1p()
}

impl PresenceOdds {
    /// The weights: offset, by fit, by touch, by verifier, by what is expected of it, by size, by strain, by misfit.
    pub fn weights(&self) -> [f64; N_WEIGHTS] {
        let Self { offset, by_fit, by_touch, by_verifier, by_expected, by_size, by_strain, by_misfit, .. } = *self;
        [offset, by_fit, by_touch, by_verifier, by_expected, by_size, by_strain, by_misfit]
    }

    /// The log-odds by what was felt, nats.
    pub fn log_odds(&self, felt: &Felt) -> f64 {
        let of_any: f64 = self
            .weights()
            .iter()
            .zip(felt.values([self.usual, self.usual_misfit]))
            .map(|(weight, value)| weight * value)
            .sum();
        match self.shared.zip(felt.verified) {
            Some((shared, verified)) => against_both(of_any, shared.log_odds(verified.felt_share())),
            None => of_any,
        }
    }

    /// The same, with how often strangers of a bank of so many parts and parts that are there come to it.
    pub fn presence(&self, felt: &Felt, n_parts: usize) -> Presence {
        let log_odds = self.log_odds(felt);
        let times = n_parts as f64 / self.n_parts;
        let stranger_rate = (times * self.strangers.share_beyond(log_odds)).min(1.0);
        Presence { log_odds, stranger_rate, present_rate: self.present.share_beyond(-log_odds) }
    }

    /// Refuses numbers that no episodes give, naming the field.
    ///
    /// # Errors
    /// Numbers that are not finite, a scale or a number of parts that is not positive.
    pub fn validate(&self) -> Result<()> {
        let shared = self.shared.unwrap_or(Shared { offset: 0.0, by_felt: 0.0 });
        let finite = [
            ("offset", self.offset),
            ("by_fit", self.by_fit),
            ("by_touch", self.by_touch),
            ("by_verifier", self.by_verifier),
            ("by_expected", self.by_expected),
            ("by_size", self.by_size),
            ("by_strain", self.by_strain),
            ("by_misfit", self.by_misfit),
            ("shared.offset", shared.offset),
            ("shared.by_felt", shared.by_felt),
            ("usual", self.usual),
            ("usual_misfit", self.usual_misfit),
            ("strangers.at", self.strangers.at),
            ("present.at", self.present.at),
        ];
        let positive = [
            ("strangers.scale", self.strangers.scale),
            ("present.scale", self.present.scale),
            ("n_parts", self.n_parts),
        ];
        for (field, value) in finite {
            check(field, "a finite number", value, value.is_finite())?;
        }
        for (field, value) in positive {
            check(field, "a positive number", value, value.is_finite() && value > 0.0)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn odds() -> PresenceOdds {
        PresenceOdds {
            offset: -0.5,
            by_fit: 1.25,
            by_touch: 0.75,
            by_verifier: 0.5,
            by_expected: -0.25,
            by_size: 0.5,
            by_strain: -2.0,
            by_misfit: -0.5,
            shared: None,
            usual: 2.0,
            usual_misfit: 0.0,
            strangers: Tail { at: 1.0, scale: 2.0 },
            present: Tail { at: 0.5, scale: 1.5 },
            n_parts: 12.0,
            n_strangers: 300,
            n_present: 200,
        }
    }

    #[test]
    fn rates_are_those_of_tails_and_grow_with_the_bank() {
        // -0.5 + 1.25 * 2 * 0.4 + 0.75 * 4 + 0.5 * 10 / 2 - 0.25 * 4 * 2 / 2 = 5.
        let verified = Some(Verified { log_odds: 10.0, n_new: 4.0, ..Verified::default() });
        let felt = Felt { fit: 0.4, n_fitted: 4, verified };
        let found = odds().presence(&felt, 12);
        assert!((found.log_odds - 5.0).abs() < 1e-12);
        // Two scales beyond where a tenth begins.
        assert!((found.stranger_rate - 0.1 * (-2.0_f64).exp()).abs() < 1e-12, "{found:?}");
        assert!((odds().presence(&felt, 120).stranger_rate - (-2.0_f64).exp()).abs() < 1e-12);
        assert_eq!(odds().presence(&felt, 12_000).stranger_rate, 1.0);
        assert_eq!(found.present_rate, 1.0);
        assert!((found.none() - 1.0 / (1.0 + 5.0_f64.exp())).abs() < 1e-12);
        let bad = odds().presence(&Felt { fit: -3.0, n_fitted: 4, verified: None }, 12);
        // -0.5 - 7.5 + 3 = -5: three scales beyond.
        assert!((bad.present_rate - 0.1 * (-3.0_f64).exp()).abs() < 1e-12 && bad.stranger_rate == 1.0, "{bad:?}");
    }

    #[test]
    fn a_verifier_is_judged_by_what_it_says_of_the_parts_own_touches() {
        let of = |log_odds, n_new, expected| Verified { log_odds, n_new, expected, ..Verified::default() }.values(2.0);
        let socket = Some(Spread { mean: -1.0, sd: 3.0 });
        assert_eq!([of(8.0, 4.0, None), of(-4.0, 4.0, socket)], [[4.0, 4.0], [-2.0, -2.0]]);
        // Blank touches alone: what speaks against the part counts as of one touch.
        assert_eq!(of(-3.0, 0.0, None), [-3.0, 0.0]);
    }

    #[test]
    fn a_size_that_is_known_speaks_for_the_part_and_one_that_is_off_against_it() {
        let (sd, mm) = (0.01_f64, 10.0);
        let covariance = [[sd * sd, 0.0, 0.0], [0.0, sd * sd, 0.0], [0.0, 0.0, sd * sd]];
        let of = |mean| {
            let verified = Verified { log_odds: 10.0, n_new: 4.0, outline_mm: [4.0 * mm, 0.0], ..Verified::default() };
            let strain = Some(Strain { mean, covariance });
            odds().log_odds(&Felt { fit: 0.4, n_fitted: 4, verified: Some(Verified { strain, ..verified }) })
        };
        // A tenth of a millimetre along each of three, of a quarter that was open before.
        let known = 3.0 * 0.5 * (1.0 + (0.25 / (sd * mm)).powi(2)).ln();
        assert!((of([0.0; 3]) - (5.0 + 0.5 * known)).abs() < 1e-9);
        // Three standard deviations along one, four along another.
        let off = (1.0 + 25.0 / 3.0_f64).ln();
        assert!((of([0.03, -0.04, 0.0]) - (5.0 + 0.5 * known - 2.0 * off)).abs() < 1e-9);
    }

    #[test]
    fn maps_that_are_off_speak_against_the_part_by_their_powers() {
        let odds = PresenceOdds { usual_misfit: 0.5_f64.ln(), ..odds() };
        let of = |misfit| {
            let verified = Verified { log_odds: 10.0, n_new: 4.0, misfit, ..Verified::default() };
            odds.log_odds(&Felt { fit: 0.4, n_fitted: 4, verified: Some(verified) })
        };
        // As far off as usual, twice as far, and half; and none that was asked for.
        let two = 2.0_f64.ln();
        for (misfit, expected) in
            [(Some(0.48), 5.0), (Some(0.98), 5.0 - 0.5 * two), (Some(0.23), 5.0 + 0.5 * two), (None, 5.0)]
        {
            assert!((of(misfit) - expected).abs() < 1e-9, "{misfit:?}");
        }
        // What is a sensor's: twice as far off.
        let verified = Verified { log_odds: 10.0, n_new: 4.0, misfit: Some(0.98), ..Verified::default() };
        let felt = Felt { fit: 0.4, n_fitted: 4, verified: Some(verified.with_misfit_less(two)) };
        assert!((odds.log_odds(&felt) - 5.0).abs() < 1e-9);
    }

    #[test]
    fn what_was_not_felt_bounds_how_sure_it_is() {
        let odds = PresenceOdds { shared: Some(Shared { offset: 0.5, by_felt: 3.0 }), ..odds() };
        let felt = |felt_mm: f64| {
            let verified = Verified { log_odds: 10.0, n_new: 4.0, outline_mm: [40.0, felt_mm], ..Verified::default() };
            odds.log_odds(&Felt { fit: 0.4, n_fitted: 4, verified: Some(verified) })
        };
        // 5 as without; three times the logarithm of 4 where a quarter is left.
        let odds_of = |a: f64, b: f64| 1.0 / (1.0 / a.exp() + 1.0 / b.exp());
        for (felt_mm, left) in [(30.0, 4.0_f64), (40.0, 50.0), (0.0, 1.0)] {
            let b = 0.5 + 3.0 * left.ln();
            assert!((felt(felt_mm) - odds_of(5.0, b).ln()).abs() < 1e-12, "{felt_mm}");
        }
        // Far beyond what an exponential holds.
        assert_eq!([against_both(2_000.0, 3.0), against_both(-2_000.0, 3.0)], [3.0, -2_000.0]);
    }

    #[test]
    fn a_tail_is_that_of_the_exponential_it_is_drawn_from() {
        // The quantiles of an exponential of scale 2 about -3; of another hundred nothing is known.
        let n = 1_000;
        let value = |i: usize| -3.0 - 2.0 * ((i as f64 + 0.5) / n as f64).ln();
        let tail = Tail::of((0..n - 100).map(value).collect(), n).unwrap();
        assert!((tail.at - value(100)).abs() < 1e-12 && (tail.scale - 2.0).abs() < 0.02, "{tail:?}");
        for share in [0.1, 0.01, 0.001] {
            let beyond = -3.0 - 2.0 * f64::ln(share);
            assert!((tail.share_beyond(beyond) / share - 1.0).abs() < 0.03, "{share}");
        }
        assert_eq!((Tail::of(vec![1.0, 2.0], 2), Tail::of(vec![1.0; 100], 100)), (None, None));
    }

    #[test]
    fn numbers_that_no_episodes_give_are_refused_with_their_field() {
        odds().validate().unwrap();
        let none = Tail { at: 0.0, scale: 0.0 };
        for (odd, named) in [
            (PresenceOdds { by_fit: f64::NAN, ..odds() }, "by_fit: expected a finite number, got NaN"),
            (PresenceOdds { strangers: none, ..odds() }, "strangers.scale: expected a positive number, got 0"),
            (PresenceOdds { n_parts: -1.0, ..odds() }, "n_parts: expected a positive number, got -1"),
        ] {
            assert_eq!(odd.validate().unwrap_err().to_string(), named);
        }
    }
}

//! What the touches so far come to: which part, where, how sure, the second part, none of these, when to stop, what to doubt.
//!
//! In: the settings, the bank, the belief. Out: a [`Verdict`]. One rule decides ([`EpisodeConfig::stop`]), and everything that
//! shows a decision or acts on one asks it. It does not know which engine made the belief, nor how the next touch is chosen.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::calibration::presence::{Felt, Presence, Verified};
use tactile_infer::maps::strain::Strain;

use crate::belief::{Belief, Hill, Hypothesis};
use crate::config::EpisodeConfig;
use crate::decision::Scores;
use crate::decision::by_maps::Laid;
use crate::decision::candidates::{Candidates, likeliest};
use crate::settings::Settings;
use crate::touch::Observation;
use crate::touch_model::TouchModel;

/// So many standard deviations along an axis make another size: after five touches of parts that are there one in a hundred comes as far,
/// of parts a millimetre longer half to nine in ten (MAZE parts of the fit).
const OTHER_SIZE: f64 = 4.0;

/// Why an episode is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// A part is more probable than `stop_probability`, explains the touches, and its place is known as well as `stop_place_mm` asks.
    Confident,
    /// No part explains the touches: this one is not in the bank.
    NoneOfThese,
    /// `max_touches` touches were made.
    TouchLimit,
    /// No candidate leads anywhere that was not touched.
    NothingToLearn,
}

/// What is known of the likeliest part when it is asked whether to stop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Standing {
    /// Its probability, 0..=1.
    pub probability: f64,
    /// Whether it is there at all ([`crate::Estimate::presence`]).
    pub presence: Option<Presence>,
    /// The larger variance of its place along x and along y, mm²; `None` where it was not asked for.
    pub place_mm2: Option<f64>,
    /// Touches made.
    pub n_touches: usize,
}

impl EpisodeConfig {
    /// Why to stop where this is known of the likeliest part; `None` to go on.
    pub fn stop(&self, standing: &Standing) -> Option<StopReason> {
        let Standing { probability, presence, place_mm2, n_touches } = *standing;
        let Settings { stop_probability, stop_place_mm, false_accept, false_refuse, max_touches, .. } = self.settings;
        // Without an edge nothing speaks against any part, nor for it: even the only one left is unknown in its pose.
        let is_there = |rate: f64| presence.is_some_and(|presence| presence.stranger_rate <= rate);
        let is_there = false_accept.is_none_or(is_there);
        let is_none = false_accept.is_some() && presence.is_some_and(|presence| presence.present_rate < false_refuse);
        let is_placed = stop_place_mm.is_none_or(|mm| place_mm2.is_some_and(|variance| variance <= mm * mm));
        if is_none && !is_there {
            Some(StopReason::NoneOfThese)
        } else if probability.min(1.0) > stop_probability && is_there && is_placed {
            Some(StopReason::Confident)
        } else if n_touches >= max_touches {
            Some(StopReason::TouchLimit)
        } else {
            None
        }
    }
}

/// The second most probable part.
#[derive(Clone, Debug, PartialEq)]
pub struct RunnerUp {
    /// Its name; the first of equals.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
}

impl RunnerUp {
    /// Whether a second part is named next to the first: the answer is neither that one part nor none of these, and the second
    /// is more probable than 5 %.
    pub fn is_named(stop: Option<StopReason>, probability: f64) -> bool {
        !matches!(stop, Some(StopReason::Confident | StopReason::NoneOfThese)) && probability > 0.05
    }
}

/// A reason to doubt an estimate, however probable it is: the filter only weighs the parts of its bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// No edged touch looks like any recorded view: perhaps none of these parts.
    LowSimilarity {
        /// The largest cosine of any edged touch with any recorded view.
        best: f32,
        /// What [`crate::TouchModel::low_similarity`] asks for.
        floor: f32,
    },
    /// Every touch was blank: no edge was ever seen.
    NothingSeen,
    /// What was felt is not of the size of the named part, which is not named with confidence.
    OtherSize {
        /// How much longer it is along x and along y, 1 for twice as long.
        longer: [f64; 2],
        /// Their standard deviations.
        sd: [f64; 2],
    },
    /// The bank, or the fit of its maps, is for the other side than the one that is touched.
    OtherSide {
        /// What is touched, what the bank is made for, and what to do ([`Bank::other_side`]).
        why: &'static str,
    },
}

impl Warning {
    /// Whether it is about these touches; else it is about the bank alone.
    pub fn is_of_touches(&self) -> bool {
        !matches!(self, Self::OtherSide { .. })
    }
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::LowSimilarity { best, floor } => {
                write!(f, "no touch looks like any recorded view (best cosine {best:.2}, expected {floor:.2} or more)")
            }
            Self::NothingSeen => write!(f, "no touch showed an edge"),
            Self::OtherSize { longer: [x, y], sd: [x_sd, y_sd] } => write!(
                f,
                "what was felt is not of that part's size: {:+.1} ± {:.1} % along x, {:+.1} ± {:.1} % along y",
                100.0 * x,
                100.0 * x_sd,
                100.0 * y,
                100.0 * y_sd
            ),
            Self::OtherSide { why } => f.write_str(why),
        }
    }
}

/// What the touches so far come to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Verdict {
    /// Index of the most probable part; the first of equals.
    pub(crate) part: usize,
    /// Its probability: a rounding above 1 at most.
    pub(crate) probability: f64,
    /// The next likeliest; `None` where no other part is left.
    pub(crate) runner_up: Option<RunnerUp>,
    /// Where it is, and how well it explains the touches there.
    pub(crate) placed: Placed,
    /// Whether it is there at all.
    pub(crate) presence: Option<Presence>,
    /// Covariance of that pose, (x mm, y mm, theta rad).
    pub(crate) covariance: [[f64; 3]; 3],
    /// Why to stop now; `None` to go on.
    pub(crate) stop: Option<StopReason>,
    /// Reasons to doubt all this.
    pub(crate) warnings: Vec<Warning>,
}

/// A part's pose at the first touch and its fit there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placed {
    pub(crate) part_from_first: Se2,
    /// The belief around that, where maps tell it.
    pub(crate) hill: Option<Hill>,
    /// What a verifier says of the touches there, where there is one.
    pub(crate) verified: Option<Verified>,
    /// How its touches match, where any shows an edge ...
    pub(crate) scores: Option<Scores>,
    /// ... and that in standard deviations, as the sensor is known.
    pub(crate) fit: Option<f64>,
}

impl Placed {
    /// Touches that the fit is of.
    pub(crate) fn n_fitted(&self) -> usize {
        self.scores.map_or(0, |scores| scores.n)
    }
}

/// What a verdict is about.
#[derive(Clone, Copy)]
pub(crate) struct Asked<'a> {
    pub(crate) config: &'a EpisodeConfig,
    /// What is measured or fixed, in the metric of the bank.
    pub(crate) model: &'a TouchModel,
    pub(crate) bank: &'a Bank,
    pub(crate) belief: &'a Belief,
    /// The touches made, each with the motion since the one before.
    pub(crate) touches: &'a [(Se2, Observation)],
    /// The parts that may be named after these touches, once that was asked for.
    pub(crate) candidates: &'a OnceLock<Candidates>,
}

impl<'a> Asked<'a> {
    /// The verdict.
    pub(crate) fn verdict(self) -> Verdict {
        let Candidates { part, probability, placed, presence, .. } = *self.candidates();
        let covariance = self.covariance(part, &placed);
        let stop = self.config.stop(&self.standing(probability, presence, || covariance));
        Verdict {
            part,
            probability,
            runner_up: self.runner_up(),
            placed,
            presence,
            covariance,
            stop,
            warnings: self.warnings(&placed, stop),
        }
    }

    /// Why to stop, as the verdict has it, without the rest of it.
    pub(crate) fn stop(self) -> Option<StopReason> {
        let (_, probability) = likeliest(self.belief.posterior().by_part());
        let Settings { stop_probability, false_accept, false_refuse, .. } = self.config.settings;
        // A place costs hundreds of interpolations a touch: it is found only where something depends on it.
        let is_asked = false_accept.is_some() && false_refuse > 0.0 || self.are_verified();
        if probability <= stop_probability && !is_asked {
            let n_touches = self.belief.touches().len();
            return self.config.stop(&Standing { probability, n_touches, ..Standing::default() });
        }
        let Candidates { part, probability, placed, presence, .. } = *self.candidates();
        self.config.stop(&self.standing(probability, presence, || self.covariance(part, &placed)))
    }

    /// Where the part is that is named with confidence, and how its touches match there; `None` where none is.
    pub(crate) fn confident(self) -> Option<Placed> {
        let verdict = self.verdict();
        (verdict.stop == Some(StopReason::Confident)).then_some(verdict.placed)
    }

    /// The second most probable part, as the verdict has it.
    pub(crate) fn runner_up(self) -> Option<RunnerUp> {
        let by_part = self.class_posterior();
        let (likeliest, _) = likeliest(by_part);
        let left = by_part.iter().copied().enumerate();
        let left = left.filter(|(part, p)| *part != likeliest && *p > 0.0);
        let (part, probability) = left.reduce(|best, next| if next.1 > best.1 { next } else { best })?;
        Some(RunnerUp { part: self.bank.parts()[part].clone(), probability })
    }

    /// The side that is touched.
    pub(crate) fn side(self) -> Side {
        self.touches.first().map_or(Side::default(), |(_, first)| first.side)
    }

    /// The parts that may be named.
    pub(crate) fn candidates(self) -> &'a Candidates {
        self.candidates.get_or_init(|| self.find_candidates())
    }

    /// Where a part would be, and how well it explains the touches there.
    pub(crate) fn find_place(self, part: usize) -> Placed {
        let state = self.belief.posterior().best(Some(part)).unwrap_or(Hypothesis { part, cell: 0 });
        let refined = || self.belief.refine(state, &self.bank.symmetry(part));
        let is_between = self.config.method.between_poses;
        let believed = if is_between { refined() } else { self.belief.posterior().grid().pose(state.cell) };
        self.place_at(part, &believed)
    }

    /// The same around a pose that is believed.
    pub(crate) fn place_at(self, part: usize, believed: &Se2) -> Placed {
        let scores = self.belief.scores(part, believed);
        let fit = scores.map(|scores| self.config.sensor.fit(&self.config.model, scores));
        match self.laid(part, believed) {
            Some(Laid { part_from_first, hill, verified }) => {
                Placed { part_from_first, hill: Some(hill), verified, scores, fit }
            }
            None => Placed { part_from_first: *believed, hill: None, verified: None, scores, fit },
        }
    }

    fn covariance(self, part: usize, placed: &Placed) -> [[f64; 3]; 3] {
        let symmetry = self.bank.symmetry(part);
        if placed.hill.is_some() {
            return self.belief.covariance_of(part, &placed.part_from_first, &symmetry, placed.hill);
        }
        self.belief.covariance(part, &placed.part_from_first, &symmetry, self.config.method.between_poses)
    }

    /// Whether the part is there at all; `None` where no edge was felt.
    pub(crate) fn presence(self, placed: &Placed) -> Option<Presence> {
        let (fit, n_fitted) = (placed.fit?, placed.n_fitted());
        let (odds, verified) = match placed.verified.zip(self.bank.presence(self.side())) {
            Some((verified, odds)) => (*odds, Some(self.config.sensor.taken_off(self.model, verified))),
            None => (self.model.presence(), None),
        };
        Some(odds.presence(&Felt { fit, n_fitted, verified }, self.bank.parts().len()))
    }

    fn standing(
        self,
        probability: f64,
        presence: Option<Presence>,
        covariance: impl FnOnce() -> [[f64; 3]; 3],
    ) -> Standing {
        let place_mm2 = self.config.settings.stop_place_mm.map(|_| place_mm2(&covariance()));
        Standing { probability, presence, place_mm2, n_touches: self.belief.touches().len() }
    }

    /// The size of what was felt, where that is not the part's and the part is not named for it.
    fn other_size(self, placed: &Placed, stop: Option<StopReason>) -> Option<Warning> {
        let verified = placed.verified.filter(|_| stop != Some(StopReason::Confident))?;
        let Strain { mean, covariance } = self.config.sensor.taken_off(self.model, verified).strain?;
        let (longer, sd) = ([mean[0], mean[1]], [covariance[0][0].sqrt(), covariance[1][1].sqrt()]);
        (0..2).any(|axis| longer[axis].abs() > OTHER_SIZE * sd[axis]).then_some(Warning::OtherSize { longer, sd })
    }

    fn warnings(self, placed: &Placed, stop: Option<StopReason>) -> Vec<Warning> {
        let edged = self.belief.touches().iter().map(|touched| &touched.likelihood).filter(|touch| !touch.blank);
        let best = edged.map(|touch| touch.best_cosine).reduce(f32::max);
        let floor = self.config.model.low_similarity;
        let of_touches = match best {
            None => Some(Warning::NothingSeen),
            Some(best) if best < floor => Some(Warning::LowSimilarity { best, floor }),
            Some(_) => None,
        };
        let of_bank = self.bank.other_side(self.side()).map(|why| Warning::OtherSide { why });
        of_touches.into_iter().chain(self.other_size(placed, stop)).chain(of_bank).collect()
    }
}

/// The larger variance along x and along y, mm².
pub(crate) fn place_mm2([[x, ..], [_, y, _], _]: &[[f64; 3]; 3]) -> f64 {
    x.max(*y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_named_or_refused_as_often_as_the_settings_allow() {
        let config = |false_accept, false_refuse| EpisodeConfig {
            settings: Settings { false_accept, false_refuse, ..Settings::default() },
            ..Default::default()
        };
        let presence = |stranger_rate, present_rate| Some(Presence { log_odds: 0.0, stranger_rate, present_rate });
        let stop = |config: EpisodeConfig, presence| {
            config.stop(&Standing { probability: 0.99, presence, place_mm2: None, n_touches: 3 })
        };
        let one_in_a_hundred = config(Some(0.01), 0.01);
        assert_eq!(stop(one_in_a_hundred, presence(0.01, 1.0)), Some(StopReason::Confident));
        assert_eq!(stop(one_in_a_hundred, presence(0.011, 1.0)), None);
        assert_eq!(stop(one_in_a_hundred, presence(0.5, 0.01)), None);
        assert_eq!(stop(one_in_a_hundred, presence(0.5, 0.009)), Some(StopReason::NoneOfThese));
        // As unlike a stranger as a part that is there: it is named.
        assert_eq!(stop(one_in_a_hundred, presence(0.001, 0.001)), Some(StopReason::Confident));
        // At 0 nothing is refused; without a rate any part explains the touches.
        assert_eq!(stop(config(Some(0.01), 0.0), presence(1.0, 0.0)), None);
        assert_eq!(stop(config(None, 0.01), presence(1.0, 0.0)), Some(StopReason::Confident));
        // Without an edge nothing is confident.
        assert_eq!(stop(one_in_a_hundred, None), None);
        assert_eq!(stop(config(None, 0.01), None), Some(StopReason::Confident));
    }

    #[test]
    fn a_place_that_is_asked_for_must_be_known() {
        let config = EpisodeConfig {
            settings: Settings { stop_place_mm: Some(0.5), false_accept: None, ..Settings::default() },
            ..EpisodeConfig::default()
        };
        let stop = |place_mm2, n_touches| {
            config.stop(&Standing { probability: 0.99, place_mm2, n_touches, ..Standing::default() })
        };
        assert_eq!(
            [stop(Some(0.25), 2), stop(Some(0.26), 2), stop(None, 2)],
            [Some(StopReason::Confident), None, None]
        );
        assert_eq!([stop(Some(0.26), 10), stop(None, 10)], [Some(StopReason::TouchLimit); 2]);
        assert_eq!(place_mm2(&[[0.1, 9.0, 9.0], [9.0, 0.2, 9.0], [9.0; 3]]), 0.2);
    }

    #[test]
    fn a_second_part_is_named_only_while_it_may_be_that_one() {
        let of = |stop| [0.06, 0.05].map(|probability| RunnerUp::is_named(stop, probability));
        for stop in [None, Some(StopReason::TouchLimit), Some(StopReason::NothingToLearn)] {
            assert_eq!(of(stop), [true, false], "{stop:?}");
        }
        for stop in [StopReason::Confident, StopReason::NoneOfThese] {
            assert_eq!(of(Some(stop)), [false; 2], "{stop:?}");
        }
    }
}

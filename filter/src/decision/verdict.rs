//! What the touches so far come to: which part, where, how sure, the second part, none of these, when to stop, what to doubt.
//!
//! In: the settings, the bank, the belief. Out: a [`Verdict`]. One rule decides ([`EpisodeConfig::stop`]), and everything that
//! shows a decision or acts on one asks it. It does not know which engine made the belief, nor how the next touch is chosen.

use serde::{Deserialize, Serialize};
use tactile_data::se2::Se2;
use tactile_data::touch::Side;
use tactile_infer::Bank;

use crate::belief::{Belief, Hypothesis};
use crate::config::EpisodeConfig;
use crate::decision::Scores;

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
    /// How well it explains the touches ([`crate::Estimate::fit`]).
    pub fit: Option<f64>,
    /// Touches that this is of ([`crate::Estimate::n_fitted`]).
    pub n_fitted: usize,
    /// The larger variance of its place along x and along y, mm²; `None` where it was not asked for.
    pub place_mm2: Option<f64>,
    /// Touches made.
    pub n_touches: usize,
}

/// The fewest touches whose fit may refuse a part. After several blank ones the likeliest pose is hardly likelier than others, so
/// that the first edge may fit badly there (`NOTES.md`, "When to stop").
const FEWEST_FITTED: usize = 2;

impl EpisodeConfig {
    /// The least fit of `n_fitted` touches with which to be confident; `None` where any will do. What a few touches say of
    /// how well a part matches is uncertain by the root of their number, and touches without an edge say nothing of it.
    pub fn fit_needed(&self, n_fitted: usize) -> Option<f64> {
        self.settings.none_fit.map(|least| least + self.model.fit_margin / (n_fitted.max(1) as f64).sqrt())
    }

    /// Why to stop where this is known of the likeliest part; `None` to go on.
    pub fn stop(&self, standing: &Standing) -> Option<StopReason> {
        let Standing { probability, fit, n_fitted, place_mm2, n_touches } = *standing;
        // Without an edge nothing speaks against any part, nor for it: even the only one left is unknown in its pose.
        let explains = match (self.fit_needed(n_fitted), fit) {
            (Some(least), Some(fit)) => fit >= least,
            (Some(_), None) => false,
            (None, _) => true,
        };
        let is_placed =
            self.settings.stop_place_mm.is_none_or(|mm| place_mm2.is_some_and(|variance| variance <= mm * mm));
        let is_none = self.settings.none_fit.zip(fit).is_some_and(|(least, fit)| fit < least);
        let are_enough = n_touches >= self.model.none_touches && n_fitted >= self.model.none_touches.min(FEWEST_FITTED);
        if are_enough && is_none {
            Some(StopReason::NoneOfThese)
        } else if probability.min(1.0) > self.settings.stop_probability && explains && is_placed {
            Some(StopReason::Confident)
        } else if n_touches >= self.settings.max_touches {
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
    /// The bank is made for the other side than the one that is touched.
    OtherSide {
        /// What is touched, what the bank is made for, and how to make one that suits ([`Bank::other_side`]).
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
            Self::OtherSide { why } => f.write_str(why),
        }
    }
}

/// What the touches so far come to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Verdict {
    /// Index of the most probable part; the first of equals.
    pub(crate) part: usize,
    /// Its probability as the belief sums it: a rounding above 1 at most.
    pub(crate) probability: f64,
    /// The next likeliest; `None` where no other part is left.
    pub(crate) runner_up: Option<RunnerUp>,
    /// Where it is, and how well it explains the touches there.
    pub(crate) placed: Placed,
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
    pub(crate) bank: &'a Bank,
    pub(crate) belief: &'a Belief,
    /// The side that is touched.
    pub(crate) side: Side,
}

impl Asked<'_> {
    /// The verdict.
    pub(crate) fn verdict(self) -> Verdict {
        let (part, probability) = self.likeliest();
        let placed = self.place(part);
        let covariance = self.covariance(part, &placed);
        let standing = self.standing(probability, &placed, || covariance);
        Verdict {
            part,
            probability,
            runner_up: self.runner_up(),
            placed,
            covariance,
            stop: self.config.stop(&standing),
            warnings: self.warnings(),
        }
    }

    /// Why to stop, as the verdict has it, without the rest of it.
    pub(crate) fn stop(self) -> Option<StopReason> {
        let ((part, probability), n_touches) = (self.likeliest(), self.belief.touches().len());
        // A place costs hundreds of interpolations a touch: it is found only where something depends on it.
        if probability <= self.config.settings.stop_probability && n_touches < self.config.model.none_touches {
            return self.config.stop(&Standing { probability, n_touches, ..Standing::default() });
        }
        let placed = self.place(part);
        self.config.stop(&self.standing(probability, &placed, || self.covariance(part, &placed)))
    }

    /// How the touches of the part match that is named with confidence; `None` where none is.
    pub(crate) fn confident(self) -> Option<Scores> {
        let verdict = self.verdict();
        verdict.placed.scores.filter(|_| verdict.stop == Some(StopReason::Confident))
    }

    /// The second most probable part, as the verdict has it.
    pub(crate) fn runner_up(self) -> Option<RunnerUp> {
        let (likeliest, _) = self.likeliest();
        let left = self.belief.posterior().by_part().iter().copied().enumerate();
        let left = left.filter(|(part, p)| *part != likeliest && *p > 0.0);
        let (part, probability) = left.reduce(|best, next| if next.1 > best.1 { next } else { best })?;
        Some(RunnerUp { part: self.bank.parts()[part].clone(), probability })
    }

    /// The most probable part, the first of equals, and its probability.
    fn likeliest(self) -> (usize, f64) {
        let most = |best: (usize, f64), next: (usize, f64)| if next.1 > best.1 { next } else { best };
        self.belief.posterior().by_part().iter().copied().enumerate().fold((0, 0.0), most)
    }

    /// Where a part would be, and how well it explains the touches there.
    fn place(self, part: usize) -> Placed {
        let state = self.belief.posterior().best(Some(part)).unwrap_or(Hypothesis { part, cell: 0 });
        let refined = || self.belief.refine(state, &self.bank.symmetry(part));
        let is_between = self.config.method.between_poses;
        let part_from_first = if is_between { refined() } else { self.belief.posterior().grid().pose(state.cell) };
        let scores = self.belief.scores(part, &part_from_first);
        let fit = scores.map(|scores| self.config.sensor.fit(&self.config.model, scores));
        Placed { part_from_first, scores, fit }
    }

    fn covariance(self, part: usize, placed: &Placed) -> [[f64; 3]; 3] {
        let symmetry = self.bank.symmetry(part);
        self.belief.covariance(part, &placed.part_from_first, &symmetry, self.config.method.between_poses)
    }

    fn standing(self, probability: f64, placed: &Placed, covariance: impl FnOnce() -> [[f64; 3]; 3]) -> Standing {
        let place_mm2 = self.config.settings.stop_place_mm.map(|_| place_mm2(&covariance()));
        let (fit, n_fitted) = (placed.fit, placed.n_fitted());
        Standing { probability, fit, n_fitted, place_mm2, n_touches: self.belief.touches().len() }
    }

    fn warnings(self) -> Vec<Warning> {
        let edged = self.belief.touches().iter().map(|touched| &touched.likelihood).filter(|touch| !touch.blank);
        let best = edged.map(|touch| touch.best_cosine).reduce(f32::max);
        let floor = self.config.model.low_similarity;
        let of_touches = match best {
            None => Some(Warning::NothingSeen),
            Some(best) if best < floor => Some(Warning::LowSimilarity { best, floor }),
            Some(_) => None,
        };
        let of_bank = self.bank.other_side(self.side).map(|why| Warning::OtherSide { why });
        of_touches.into_iter().chain(of_bank).collect()
    }
}

/// The larger variance along x and along y, mm².
pub(crate) fn place_mm2([[x, ..], [_, y, _], _]: &[[f64; 3]; 3]) -> f64 {
    x.max(*y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use crate::touch_model::TouchModel;

    #[test]
    fn a_fit_is_asked_for_less_the_more_touches_there_are() {
        let config = EpisodeConfig {
            settings: Settings { none_fit: Some(-0.9), ..Settings::default() },
            model: TouchModel { fit_margin: 1.2, none_touches: 4, ..TouchModel::default() },
            ..Default::default()
        };
        let standing =
            |fit, n_touches| Standing { probability: 0.99, fit, n_fitted: n_touches, place_mm2: None, n_touches };
        let stop = |fit: Option<f64>, n: usize| config.stop(&standing(fit, n));
        // -0.9 + 1.2 / sqrt(n): 0.3 after one touch; -0.051 after two; -0.207 after three; -0.3 after four.
        assert_eq!([stop(Some(0.29), 1), stop(Some(0.31), 1)], [None, Some(StopReason::Confident)]);
        assert_eq!([stop(Some(-0.05), 2), stop(Some(-0.06), 2)], [Some(StopReason::Confident), None]);
        assert_eq!([stop(Some(-0.29), 4), stop(Some(-0.31), 4)], [Some(StopReason::Confident), None]);
        // Below the threshold no part explains the touches, from the fourth on, where the fit is of two of them.
        assert_eq!([stop(Some(-0.91), 3), stop(Some(-0.91), 4)], [None, Some(StopReason::NoneOfThese)]);
        let of = |n_fitted| config.stop(&Standing { n_fitted, ..standing(Some(-0.91), 9) });
        assert_eq!([of(1), of(2)], [None, Some(StopReason::NoneOfThese)]);
        let hasty = EpisodeConfig { model: TouchModel { none_touches: 1, ..config.model }, ..config };
        assert_eq!(hasty.stop(&standing(Some(-0.91), 1)), Some(StopReason::NoneOfThese));
        // Blank touches say nothing of how well a part matches: one edge among ten touches must fit as one alone must.
        let of_one = |fit| config.stop(&Standing { n_fitted: 1, ..standing(Some(fit), 9) });
        assert_eq!([of_one(0.29), of_one(0.31)], [None, Some(StopReason::Confident)]);
        // Without an edge nothing is confident; without a threshold everything may be.
        assert_eq!(stop(None, 5), None);
        let any = EpisodeConfig { settings: Settings { none_fit: None, ..config.settings }, ..config };
        assert_eq!(any.stop(&standing(None, 1)), Some(StopReason::Confident));
    }

    #[test]
    fn a_place_that_is_asked_for_must_be_known() {
        let config = EpisodeConfig {
            settings: Settings { stop_place_mm: Some(0.5), none_fit: None, ..Settings::default() },
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

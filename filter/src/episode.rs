//! One hole, touch by touch: what a robot embeds.

use std::sync::{Arc, OnceLock};

use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;

use crate::belief::{Belief, Start, states_between};
use crate::choice::{Action, ActionRule, Choice, ChoiceInputs, choose, explain};
use crate::config::EpisodeConfig;
use crate::decision::{Asked, Candidates, Estimate, FeltMap, RunnerUp, SensorMatch, StopReason};
use crate::error::{Error, Result};
use crate::insertion::Tried;
use crate::likelihood::TouchLikelihood;
use crate::touch::{Observation, check_motion};
use crate::touch_model::TouchModel;

/// What to do next.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    /// Move like this, touch, and report with [`Episode::observe`].
    Touch(Action),
    /// Stop.
    Done(Box<Estimate>, StopReason),
}

/// One hole being identified. Exists from the first touch on; owns what it needs, so that a thread, a node or a handle
/// can hold it.
#[derive(Clone, Debug)]
pub struct Episode {
    pub(crate) config: EpisodeConfig,
    /// What is measured or fixed, in the metric of the bank.
    model: TouchModel,
    pub(crate) bank: Arc<Bank>,
    belief: Belief,
    pub(crate) touches: Vec<(Se2, Observation)>,
    /// Each peg that was tried in vain, with the number of touches before it.
    pub(crate) tried: Vec<(usize, Tried)>,
    /// Where the likeliest part is, once that was asked for after the last touch.
    candidates: OnceLock<Candidates>,
}

impl Episode {
    /// Begins with the first touch.
    ///
    /// # Errors
    /// A config out of range, a stop for the place with a bank that does not tell places between its poses, a known start
    /// ([`EpisodeConfig::start`]) far from where the bank's parts may be touched first, an observation of another model than the bank's, or
    /// one that no sensor makes.
    pub fn begin(config: EpisodeConfig, bank: Arc<Bank>, observation: &Observation) -> Result<Self> {
        config.validate()?;
        observation.check_model(bank.model_sha256())?;
        observation.check_map()?;
        let model = config.model.in_metric_of(&bank);
        let first = TouchLikelihood::new(observation, &bank, &model)?;
        let between = config.method.between_poses && config.model.interpolation.is_cubic(bank.grid());
        if let (Some(mm), false) = (config.settings.stop_place_mm, between) {
            let expected =
                "poses between recorded ones and a bank fine enough to be interpolated: no other place is known";
            return Err(Error::config("episode.stop_place_mm", expected, format!("{mm}")));
        }
        let subdivisions = if between { config.settings.subdivisions } else { 1 };
        let known = config.start.map(|start| start.over(&states_between(bank.start(), subdivisions))).transpose()?;
        let start = Start::of(config.method.engine, config.settings.seed);
        let belief = Belief::begin(&bank, subdivisions, start, first, known);
        let touches = vec![(Se2::IDENTITY, observation.seen_as(&bank))];
        Ok(Self { config, model, bank, belief, touches, tried: Vec::new(), candidates: OnceLock::new() })
    }

    /// Takes in a touch: `moved` is the motion actually made since the last touch that was taken in, in the sensor's
    /// frame at that touch. After an error the belief is as before; the motion then counts towards the next touch.
    ///
    /// # Errors
    /// A frozen picture, a motion that is not finite, a touch of the other side, or an observation as [`Self::begin`]
    /// refuses it.
    pub fn observe(&mut self, moved: Se2, observation: &Observation) -> Result<()> {
        check_motion(&moved)?;
        observation.check_model(self.bank.model_sha256())?;
        observation.check_map()?;
        if let Some((_, before)) = self.touches.last() {
            observation.check_follows(before, &moved)?;
        }
        let likelihood = TouchLikelihood::new(observation, &self.bank, &self.model)?;
        self.belief.update(&moved, likelihood);
        self.touches.push((moved, observation.seen_as(&self.bank)));
        self.candidates = OnceLock::new();
        Ok(())
    }

    /// Takes in that a peg was tried in vain ([`Search::in_vain`](crate::insertion::Search)): the hole is another part's, or
    /// elsewhere, or was missed. Exact, as all touches are weighed again. The next decision, and the estimate, know of it.
    ///
    /// # Errors
    /// A part that the bank does not have, a pose or a covariance that is none.
    pub fn did_not_fit(&mut self, tried: &Tried) -> Result<()> {
        let states = tried.over(&self.bank, self.belief.posterior().grid())?;
        self.belief.did_not_fit(states);
        self.tried.push((self.touches.len(), tried.clone()));
        self.candidates = OnceLock::new();
        Ok(())
    }

    /// Which side is touched: the side of the first touch.
    pub fn side(&self) -> Side {
        self.asked().side()
    }

    /// Whether to stop, and if not, which motion of `reach` (what the robot can do from here, in the sensor's frame) to
    /// make. Changes nothing: asked again, it answers the same.
    ///
    /// # Errors
    /// [`Error::EmptyReach`] where the episode should go on and no motion of finite numbers is offered.
    pub fn decide(&self, reach: &[Se2]) -> Result<Decision> {
        self.decide_while(reach, &mut || true)
    }

    /// Like [`Self::decide`], with a limit on the effort: `keep_going` is asked before each candidate is
    /// judged, and once it says no the best found so far is taken. With a clock it is a time budget.
    ///
    /// ```no_run
    /// # fn choose(episode: &tactile_filter::Episode, reach: &[tactile_data::pose::se2::Se2]) {
    /// let start = std::time::Instant::now();
    /// let decision = episode.decide_while(reach, &mut || start.elapsed().as_micros() < 1_500);
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Self::decide`].
    pub fn decide_while(&self, reach: &[Se2], keep_going: &mut dyn FnMut() -> bool) -> Result<Decision> {
        let done = |reason| Decision::Done(Box::new(self.estimate()), reason);
        if let Some(reason) = self.stop_reason() {
            return Ok(done(reason));
        }
        if !reach.iter().any(Se2::is_finite) {
            return Err(Error::EmptyReach { n_motions: reach.len() });
        }
        let chosen = self.next_touch(reach, keep_going);
        Ok(chosen.map_or_else(|| done(StopReason::NothingToLearn), Decision::Touch))
    }

    /// The motion of `reach` that [`Self::decide_while`] makes where it does not stop, without asking whether to stop; `None` where nothing is
    /// left to touch.
    pub fn next_touch(&self, reach: &[Se2], keep_going: &mut dyn FnMut() -> bool) -> Option<Action> {
        choose(&self.choice_inputs(reach), self.choice_seed(), keep_going)
    }

    /// Why [`Self::decide`] chooses as it does: each of `candidates` as the rule judges it now, the one chosen and what
    /// it is expected to tell; for reports. Asks neither whether to stop nor for the time. `None` where nothing
    /// is left to touch.
    pub fn explain(&self, candidates: &[Se2]) -> Option<Choice> {
        explain(&self.choice_inputs(candidates), self.choice_seed())
    }

    fn choice_inputs<'s>(&'s self, candidates: &'s [Se2]) -> ChoiceInputs<'s> {
        let Self { config, model, bank, belief, .. } = self;
        // No other rule asks for it.
        let unfelt = if config.method.rule == ActionRule::Information { self.asked().unfelt() } else { None };
        ChoiceInputs { config, model, belief, bank, candidates, unfelt }
    }

    /// A stream of draws of its own for each touch.
    fn choice_seed(&self) -> u64 {
        let n_touches = self.belief.touches().len() as u64;
        self.config.settings.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(n_touches)
    }

    /// Why to stop now, however much could still be touched, as [`Self::estimate`] has it; `None` to go on.
    pub fn stop_reason(&self) -> Option<StopReason> {
        self.asked().stop()
    }

    /// What is known now. Where the bank has maps of its parts and the sensor drew the touches', the place is found by them.
    pub fn estimate(&self) -> Estimate {
        self.asked().estimate()
    }

    /// The second most probable part now, as [`Self::estimate`] has it, without the rest of it; `None` where no other part is
    /// left.
    pub fn runner_up(&self) -> Option<RunnerUp> {
        self.asked().runner_up()
    }

    /// Probability of each part now, `[n_parts]`, as [`Self::estimate`] has it: with maps the likeliest ones as the verifier judges them.
    pub fn class_posterior(&self) -> &[f64] {
        self.asked().class_posterior()
    }

    /// What is known of the sensor with this hole, where it is named with confidence now; else as it was. Give it to the next
    /// episode of the run ([`EpisodeConfig::sensor`]), as long as gel and camera stay.
    pub fn learn(&self) -> SensorMatch {
        let (sensor, odds) = (self.config.sensor, self.bank.presence(self.side()));
        self.asked().confident().map_or(sensor, |placed| sensor.with_hole(&self.config.model, &placed, odds))
    }

    /// What the touches so far show of what they were made on, about the named part's origin; `None` where the model draws no maps.
    pub fn felt_map(&self) -> Option<FeltMap> {
        self.asked().felt_map()
    }

    fn asked(&self) -> Asked<'_> {
        let Self { config, model, bank, belief, touches, candidates, .. } = self;
        Asked { config, model, bank, belief, touches, candidates }
    }

    /// The belief, for maps and reports.
    pub fn belief(&self) -> &Belief {
        &self.belief
    }
}

#[cfg(test)]
mod tests;

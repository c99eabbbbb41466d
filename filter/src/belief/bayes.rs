//! Where the sensor may have evidence first, and on which part: the belief over all hypotheses.
//!
//! A state is a part and the grid cell of the FIRST touch; later touches follow from the motions the
//! controller reports, `part_from_sensor = part_from_first * first_from_sensor` (paper, Sec. IV-D). The
//! likelihood of each touch is kept, so that any state can be scored again over all touches.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;

use crate::belief::engine::{Engine, EngineConfig, Start};
use crate::belief::hypothesis::states_between;
use crate::belief::known_start::StartBelief;
use crate::belief::posterior::Posterior;
use crate::insertion::TriedStates;
use crate::likelihood::TouchLikelihood;
use crate::likelihood::evidence::Evidence;
use crate::likelihood::new_share;
use crate::touch_model::TouchModel;

/// The share of the belief that the exact engine may leave out after each touch, in states that cannot hold more of it
/// together: the total variation from the posterior over all states is at most this, however many touches were made.
/// [`Belief::of_all_states`] leaves none out.
pub const ALLOWED_ERROR: f64 = 5e-4;

/// What is known of part and pose after the touches so far, at least one, and what the next touch needs to change it.
#[derive(Clone, Debug)]
pub struct Belief {
    /// The bank's grid.
    pub(super) views: PoseGrid,
    pub(super) touches: Vec<Evidence>,
    start: Start,
    engine: Engine,
    pub(super) posterior: Posterior,
    log_evidence: f64,
}

impl Belief {
    /// The belief after the first touch; every state was equally likely before it (paper, Eq. 3).
    ///
    /// `subdivisions`: parts of a step of 2 mm and 15 degrees between two states, at least 1; a finer bank has at least
    /// the states of its views. More than 1 only where views are interpolated between the bank's poses: a state may
    /// then lie between them.
    pub fn new(bank: &Bank, engine: EngineConfig, subdivisions: usize, seed: u64, first: TouchLikelihood) -> Self {
        Self::begin(bank, subdivisions, Start::of(engine, seed), first, None)
    }

    /// Like [`Self::new`] with the exact engine, which here leaves no state out: slower, and for comparison.
    pub fn of_all_states(bank: &Bank, subdivisions: usize, first: TouchLikelihood) -> Self {
        Self::begin(bank, subdivisions, Start::Exact { allowed: 0.0 }, first, None)
    }

    /// Like [`Self::new`], where the pose of the first touch may be known before it.
    pub(crate) fn begin(
        bank: &Bank,
        subdivisions: usize,
        start: Start,
        first: TouchLikelihood,
        known: Option<StartBelief>,
    ) -> Self {
        let (views, states, n_parts) = (*bank.grid(), states_between(bank.start(), subdivisions), bank.parts().len());
        let mut first = Evidence::of(&views, Se2::IDENTITY, 1.0, first);
        first.start = known;
        let (engine, log_evidence) = Engine::begin([&views, &states], n_parts, start, &first);
        let posterior = engine.posterior(&states, n_parts);
        Self { views, touches: vec![first], start, engine, posterior, log_evidence }
    }

    /// The settings that the first touch was judged with.
    pub(super) fn config(&self) -> &TouchModel {
        self.touches[0].likelihood.config()
    }

    /// Takes in a touch after the motion `sensor_from_next`, and returns its log-evidence
    /// log p(touch | touches before), up to the constant of [`TouchLikelihood`].
    pub fn update(&mut self, sensor_from_next: &Se2, likelihood: TouchLikelihood) -> f64 {
        // Predict: each state moves by the motion that was made.
        let first_from_sensor = self.first_from_sensor() * *sensor_from_next;
        // Weigh by the touch, as far as it is new.
        let weight = self.new_share(&first_from_sensor);
        self.touches.push(Evidence::of(&self.views, first_from_sensor, weight, likelihood));
        let (states, n_parts) = (*self.posterior.grid(), self.posterior.by_part().len());
        self.posterior.release();
        let log_evidence = self.engine.weigh([&self.views, &states], &self.touches);
        // Summarise.
        self.posterior = self.engine.posterior(&states, n_parts);
        self.log_evidence += log_evidence;
        log_evidence
    }

    /// Takes in that a peg was tried in vain after the last touch. All touches are weighed again: this is as rare as it is slow to try.
    pub(crate) fn did_not_fit(&mut self, tried: TriedStates) {
        let Some(last) = self.touches.last_mut() else { return };
        last.tried.push(tried);
        let (states, n_parts) = (*self.posterior.grid(), self.posterior.by_part().len());
        let grids = [&self.views, &states];
        let (mut engine, mut log_evidence) = Engine::begin(grids, n_parts, self.start, &self.touches[0]);
        for n_touches in 2..=self.touches.len() {
            log_evidence += engine.weigh(grids, &self.touches[..n_touches]);
        }
        self.posterior = engine.posterior(&states, n_parts);
        (self.engine, self.log_evidence) = (engine, log_evidence);
    }

    /// How much of a touch there is new after the touches made, 0..=1, the power to which its likelihood is taken; none where
    /// no recorded view can be seen.
    pub(crate) fn new_share(&self, first_from_sensor: &Se2) -> f64 {
        if self.is_beyond(first_from_sensor) {
            return 0.0;
        }
        let shared_mm = self.config().shared_mm;
        let of = |earlier: &Evidence| new_share(shared_mm, &earlier.first_from_sensor, first_from_sensor);
        self.touches.iter().map(of).fold(1.0, f64::min)
    }

    /// Whether no state sees a recorded view after a motion since the first touch: such a touch says nothing.
    fn is_beyond(&self, first_from_sensor: &Se2) -> bool {
        let PoseGrid { xy_half_mm, xy_step_mm, .. } = self.views;
        // From one corner of the recorded area to the other, and what is trusted beyond its rim.
        let tolerance = self.config().nearest_tolerance;
        let diagonal_mm = 2.0 * std::f64::consts::SQRT_2 * xy_half_mm;
        let rim_mm = xy_step_mm * (8.0 * tolerance).max(2.0);
        first_from_sensor.x_mm.hypot(first_from_sensor.y_mm) > diagonal_mm + rim_mm
    }

    /// log p(all touches), up to the constants of [`TouchLikelihood`]: 0 says no more than chance, -inf
    /// that no state explains a touch.
    pub fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// S: the probability of each hypothesis.
    pub fn posterior(&self) -> &Posterior {
        &self.posterior
    }

    /// All touches, in order.
    pub fn touches(&self) -> &[Evidence] {
        &self.touches
    }

    /// The sensor's motion since the first touch.
    pub fn first_from_sensor(&self) -> Se2 {
        self.touches.last().map_or(Se2::IDENTITY, |evidence| evidence.first_from_sensor)
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;

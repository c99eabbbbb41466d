//! Many episodes against a simulated or recorded robot, each driven as a robot would drive it.
//!
//! The estimator is given frames and the motions actually made; true poses stay in [`Hole`], on this
//! side of the episode's API.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_filter::{Episode, EpisodeConfig, Estimate, Presence, Sensor, Standing, Verified};
use tactile_infer::Bank;

use crate::banks::Banks;
use crate::earlier_holes::EarlierHoles;
use crate::error::{Error, Result};
pub use crate::hole::{Hole, observe};
use crate::holes::Holes;
pub use crate::protocol::Protocol;
use crate::result::{Poses, is_zero};

/// What an episode knew after one of its touches, against the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Whether the most probable part is the right one.
    pub right: bool,
    /// The part named, an index into the scene's parts.
    pub named: usize,
    /// Whether the first touch's pose was found to the cell as well.
    pub exact_cell: bool,
    /// Distance of the first touch's pose, mm.
    pub xy_mm: f64,
    /// Angle of the first touch's pose, degrees, modulo the part's symmetry.
    pub theta_deg: f64,
    /// Squared error of the first touch's pose, normalised by the covariance stated; `None` where none was.
    pub normalised_error: Option<f64>,
    /// Probability of the most probable part.
    pub probability: f64,
    /// How well that part explains what was felt.
    pub fit: Option<f64>,
    /// Touches that this is of.
    pub n_fitted: usize,
    /// What a verifier says of them where that part would be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verified: Option<Verified>,
    /// Whether that part is there at all.
    pub presence: Option<Presence>,
    /// The larger variance of its place along x and along y, mm², where a stop asks for the place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_mm2: Option<f64>,
    /// Squared difference of the class posterior from the truth, 0..=2.
    pub brier: f64,
}

impl Scored {
    /// What is asked of it before it is believed, after `n_touches`.
    pub fn standing(&self, n_touches: usize) -> Standing {
        let Self { probability, presence, place_mm2, .. } = *self;
        Standing { probability, presence, place_mm2, n_touches }
    }
}

/// Milliseconds of each stage of one touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Frame to query.
    pub encode: f64,
    /// Query to posterior.
    pub update: f64,
    /// Posterior to what is said of part and place, with maps what they verify.
    #[serde(default)]
    pub judge: f64,
    /// From there to the next action; zero after the last touch.
    pub select: f64,
}

impl StageTimes {
    /// All of them: from a frame to the next action.
    pub fn whole(&self) -> f64 {
        self.encode + self.update + self.judge + self.select
    }
}

/// One episode, touch by touch.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The hole's own part, an index into the scene's parts.
    pub part: usize,
    /// Print of that part that was touched.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub print: usize,
    /// Which recorded pose or frame was touched first: [`Hole::first_view`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_view: Option<usize>,
    /// After touch 1, 2, ...
    pub scored: Vec<Scored>,
    /// Stage times of touch 1, 2, ...
    pub times: Vec<StageTimes>,
    /// How far the sensor had gone at touch 1, 2, ..., mm.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub travel_mm: Vec<f64>,
}

impl Outcome {
    /// The outcome of a hole that was not touched yet.
    fn of(hole: &Hole<'_>) -> Self {
        let (part, print, first_view) = (hole.part_index(), hole.print(), hole.first_view());
        Self { part, print, first_view, ..Self::default() }
    }
}

/// Who watches an episode: called after each touch with what was touched, seen and believed.
pub type Watch<'w> = &'w mut dyn FnMut(&Hole<'_>, &Frame, &Episode, &Estimate);

/// One configuration on one scene.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// What is touched.
    pub holes: Holes<'a>,
    /// The sensor, as the filter knows it: it touches the same side.
    pub sensor: &'a Sensor,
    /// The pegs.
    pub banks: &'a Banks,
    /// How the filter infers and chooses.
    pub config: &'a EpisodeConfig,
    /// The episodes.
    pub protocol: &'a Protocol,
}

/// Runs all episodes of one configuration, as many at a time as the pool has threads; outcomes in order of the
/// episodes. `progress` is called with the episodes done and all of them.
///
/// # Errors
/// A protocol that does not fit scene and bank, a sensor of the other side, a touch that cannot be made or seen.
pub fn run_all(run: &Run<'_>, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Vec<Outcome>> {
    let protocol = run.protocol;
    let (touched, seen) = (run.holes.side(), run.sensor.side());
    if touched != seen {
        return Err(Error::invalid("sensor", format!("one that touches {touched}s"), format!("one of {seen}s")));
    }
    protocol.validate(run.holes, run.banks.whole())?;
    let (done, earlier) = (AtomicUsize::new(0), EarlierHoles::default());
    let one = |index, bank: &Arc<Bank>| {
        let learnt = earlier.before(run, bank, index)?;
        let (config, sensor) = (run.config.with_sensor(learnt.matches), &learnt.sensor);
        let outcome = run_one(&Run { config: &config, sensor, ..*run }, bank, index, &mut |_, _, _, _| ());
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, protocol.episodes.len());
        outcome
    };
    run.banks.each(run.holes, protocol, one)
}

/// Runs one episode of a protocol with the bank of its hole. The same index gives the same hole, poses and frames,
/// whichever others run.
///
/// # Errors
/// A touch that cannot be made or seen.
pub fn run_one(run: &Run<'_>, bank: &Arc<Bank>, index: usize, watch: Watch<'_>) -> Result<Outcome> {
    let Run { holes, sensor, config, protocol, .. } = *run;
    let mut hole = protocol.hole(holes, bank.start(), index);
    let config = config.changed(|settings, _, method| {
        settings.seed = protocol.seed(index).wrapping_add(index as u64);
        method.between_poses = protocol.poses == Poses::OffGrid;
    });
    let config = protocol.known_start(&hole, index).map_or(config, |start| config.with_start(start));
    let mut frame = hole.touch()?;
    let mut outcome = Outcome::of(&hole);
    let (observation, encode) = timed(|| observe(sensor, &frame));
    let observation = observation?;
    let (episode, update) = timed(|| Episode::begin(config, bank.clone(), &observation));
    let mut episode = episode?;
    let mut times = StageTimes { encode, update, ..StageTimes::default() };
    let mut travel_mm = 0.0;
    loop {
        outcome.travel_mm.push(travel_mm);
        let (estimate, judge) = timed(|| episode.estimate());
        let place_mm2 = config.settings.stop_place_mm.and(estimate.standing().place_mm2);
        outcome.scored.push(Scored { place_mm2, ..score(&estimate, bank, &hole) });
        watch(&hole, &frame, &episode, &estimate);
        let reach = hole.reach(bank.start(), protocol.poses);
        let started = Instant::now();
        let in_time = || protocol.choose_ms.is_none_or(|ms| started.elapsed().as_secs_f64() * 1e3 < ms);
        // The curve goes on to the last touch; where the episode would have stopped is read off it.
        let is_last = outcome.scored.len() == protocol.n_touches;
        let (next, select) = timed(|| episode.next_touch(&reach, &mut { in_time }).filter(|_| !is_last));
        times = StageTimes { judge, select: if is_last { 0.0 } else { select }, ..times };
        outcome.times.push(times);
        let Some(action) = next else { break };
        let moved = hole.go(&action);
        travel_mm += moved.x_mm.hypot(moved.y_mm);
        frame = hole.touch()?;
        let (observation, encode) = timed(|| observe(sensor, &frame));
        let observation = observation?;
        let (taken, update) = timed(|| episode.observe(moved, &observation));
        taken?;
        times = StageTimes { encode, update, ..StageTimes::default() };
    }
    // Nothing left to touch: what is known stays known.
    while let (Some(last), true) = (outcome.scored.last().copied(), outcome.scored.len() < protocol.n_touches) {
        outcome.scored.push(last);
    }
    Ok(outcome)
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started = Instant::now();
    let result = work();
    (result, started.elapsed().as_secs_f64() * 1e3)
}

fn score(estimate: &Estimate, bank: &Bank, hole: &Hole<'_>) -> Scored {
    let brier = |(part, p): (&String, &f64)| (p - f64::from(u8::from(part == hole.part()))).powi(2);
    Scored {
        probability: estimate.probability,
        fit: estimate.fit,
        n_fitted: estimate.n_fitted,
        verified: estimate.verified,
        presence: estimate.presence,
        brier: bank.parts().iter().zip(&estimate.class_posterior).map(brier).sum(),
        named: hole.index_of(&estimate.part),
        normalised_error: normalised_error(estimate, hole),
        ..score_pose(&estimate.part, estimate.part_from_first, bank.start(), hole)
    }
}

/// How far the true pose of the first touch, or the nearest that feels the same, is from a pose: x and y in mm, angle
/// in radians.
fn pose_error(found: &Se2, hole: &Hole<'_>) -> [f64; 3] {
    let truth = hole.symmetry().nearest_twin(&hole.part_from_first(), found);
    [truth.x_mm - found.x_mm, truth.y_mm - found.y_mm, wrap_angle(truth.theta_rad - found.theta_rad)]
}

/// `e^T C^-1 e` of the pose's error `e` in x, y and angle and its covariance `C`, by a Cholesky factor of that; `None`
/// where `C` is of a pose that cannot vary.
fn normalised_error(estimate: &Estimate, hole: &Hole<'_>) -> Option<f64> {
    let error = pose_error(&estimate.part_from_first, hole);
    let (mut factor, mut solved) = ([[0.0; 3]; 3], [0.0; 3]);
    for i in 0..3 {
        for j in 0..=i {
            let rest = estimate.covariance[i][j] - (0..j).map(|k| factor[i][k] * factor[j][k]).sum::<f64>();
            factor[i][j] = if i == j { rest.sqrt() } else { rest / factor[j][j] };
        }
        solved[i] = (error[i] - (0..i).map(|k| factor[i][k] * solved[k]).sum::<f64>()) / factor[i][i];
    }
    let square: f64 = solved.iter().map(|value| value * value).sum();
    square.is_finite().then_some(square)
}

/// How good it is to name one row of the bank, with certainty, after the first touch.
pub fn score_row(row: usize, bank: &Bank, hole: &Hole<'_>) -> Scored {
    let (part, cell) = (row / bank.grid().len(), row % bank.grid().len());
    let scored = score_pose(&bank.parts()[part], bank.grid().pose(cell), bank.grid(), hole);
    let named = hole.index_of(&bank.parts()[part]);
    Scored { named, probability: 1.0, brier: if scored.right { 0.0 } else { 2.0 }, ..scored }
}

fn score_pose(part: &str, part_from_first: Se2, grid: &PoseGrid, hole: &Hole<'_>) -> Scored {
    let [x_mm, y_mm, theta_rad] = pose_error(&part_from_first, hole);
    let (xy_mm, theta_deg) = (x_mm.hypot(y_mm), theta_rad.to_degrees().abs());
    let right = part == hole.part();
    let same_cell = xy_mm < 0.5 * grid.xy_step_mm && theta_deg < 0.5 * grid.theta_step_deg;
    Scored { right, exact_cell: right && same_cell, xy_mm, theta_deg, ..Scored::default() }
}

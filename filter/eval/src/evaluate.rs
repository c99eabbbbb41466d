//! Many episodes against a simulated or recorded robot, each driven as a robot would drive it.
//!
//! The estimator is given frames and the motions actually made; true poses stay in [`Hole`], on this
//! side of the episode's API.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use tactile_data::frame::Frame;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_filter::{Decision, Episode, EpisodeConfig, Estimate, Sensor, Standing};
use tactile_infer::Bank;

use crate::banks::Banks;
use crate::error::{Error, Result};
pub use crate::hole::{Hole, observe};
use crate::holes::Holes;
use crate::result::Poses;

/// What is run, how often.
#[derive(Clone, Debug)]
pub struct Protocol {
    /// Episodes in all, shared out over the seeds.
    pub n_episodes: usize,
    /// Which of them are run here: all, or a shard.
    pub episodes: Range<usize>,
    /// Seeds of holes, poses and frames.
    pub seeds: Vec<u64>,
    /// On the grid, as the paper has it: the first touch is at a recorded pose and the motions offered lead
    /// to recorded poses. Off it: the first touch is anywhere in the recorded range, and the motions
    /// offered are those of the grid, seen from the first touch.
    pub poses: Poses,
    /// Whether the hole's own part is taken out of the bank, and of all that the bank learnt: what is felt is then none
    /// of these.
    pub absent: bool,
    /// Parts that each hole may be of: its own and others drawn with the episode; `None`: all of the bank.
    pub n_classes: Option<usize>,
    /// Milliseconds for each choice of a touch; `None`: as many as it takes, the same on every machine.
    pub choose_ms: Option<f64>,
    /// Prints of each part that holes are touched on, 1 or more; episodes take turns with them.
    pub n_prints: usize,
    /// Touches of each episode; the stopping rule is recorded and not obeyed, so that every curve is whole.
    pub n_touches: usize,
}

impl Protocol {
    /// Refuses what cannot be run on a scene with a bank.
    pub fn validate(&self, holes: Holes<'_>, bank: &Bank) -> Result<()> {
        if self.seeds.is_empty() || self.n_episodes == 0 || self.n_touches == 0 {
            let got = format!("{} episodes of {} seeds", self.n_episodes, self.seeds.len());
            return Err(Error::invalid("evaluation", "episodes, touches and seeds", got));
        }
        if self.episodes.end > self.n_episodes {
            let got = format!("{:?}", self.episodes);
            return Err(Error::invalid("evaluation", format!("some of {} episodes", self.n_episodes), got));
        }
        if holes.parts() != bank.parts() {
            let got = bank.parts().join(" ");
            return Err(Error::invalid("bank", format!("the scene's parts {}", holes.parts().join(" ")), got));
        }
        self.validate_prints(holes)?;
        let n_parts = bank.parts().len();
        match self.n_classes {
            Some(_) if self.absent => Err(Error::invalid("evaluation", "classes or an absent part", "both")),
            Some(n) if !(1..=n_parts).contains(&n) => {
                Err(Error::invalid("classes", format!("1 to the bank's {n_parts}"), n.to_string()))
            }
            _ => Ok(()),
        }
    }

    /// Refuses prints where there is one, or where all look alike.
    fn validate_prints(&self, holes: Holes<'_>) -> Result<()> {
        let expected = match holes {
            _ if self.n_prints == 0 => "1 or more",
            Holes::Recorded(_) if self.n_prints > 1 => "1: recorded holes have one print",
            Holes::Simulated(simulator, _) if self.n_prints > 1 && !simulator.prints_differ() => {
                "1: this scene has no layer lines, by which prints differ"
            }
            _ => return Ok(()),
        };
        Err(Error::invalid("prints", expected, self.n_prints.to_string()))
    }

    /// Seed of an episode.
    pub(crate) fn seed(&self, index: usize) -> u64 {
        self.seeds[index % self.seeds.len()]
    }

    /// The hole of an episode. Part, pose and frames follow from its number and are the same for any number of prints;
    /// the seeds take turns, and once around them the prints do.
    pub fn hole<'a>(&self, holes: Holes<'a>, grid: &PoseGrid, index: usize) -> Hole<'a> {
        let print = index / self.seeds.len() % self.n_prints;
        Hole::new(holes, grid, self.poses, self.seed(index), index).of_print(print)
    }
}

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
    /// The larger variance of its place along x and along y, mm², where a stop asks for the place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_mm2: Option<f64>,
    /// Squared difference of the class posterior from the truth, 0..=2.
    pub brier: f64,
}

impl Scored {
    /// What is asked of it before it is believed, after `n_touches`.
    pub fn standing(&self, n_touches: usize) -> Standing {
        let Self { probability, fit, n_fitted, place_mm2, .. } = *self;
        Standing { probability, fit, n_fitted, place_mm2, n_touches }
    }
}

/// Milliseconds of each stage of one touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Frame to query.
    pub encode: f64,
    /// Query to posterior.
    pub update: f64,
    /// Posterior to the next action; zero after the last touch.
    pub select: f64,
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
}

impl Outcome {
    /// The outcome of a hole that was not touched yet.
    fn of(hole: &Hole<'_>) -> Self {
        let (part, print, first_view) = (hole.part_index(), hole.print(), hole.first_view());
        Self { part, print, first_view, ..Self::default() }
    }
}

fn is_zero(n: &usize) -> bool {
    *n == 0
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
    let done = AtomicUsize::new(0);
    let one = |index, bank: &Arc<Bank>| {
        let outcome = run_one(run, bank, index, &mut |_, _, _, _| ());
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
    let mut hole = protocol.hole(holes, bank.grid(), index);
    // The curve goes on to the last touch; where the episode would have stopped is read off it.
    let config = config.changed(|settings, _, method| {
        settings.stop_probability = 1.0;
        settings.none_fit = None;
        settings.max_touches = protocol.n_touches;
        settings.seed = protocol.seed(index).wrapping_add(index as u64);
        method.between_poses = protocol.poses == Poses::OffGrid;
    });
    let mut frame = hole.touch()?;
    let mut outcome = Outcome::of(&hole);
    let (observation, encode) = timed(|| observe(sensor, &frame));
    let observation = observation?;
    let (episode, update) = timed(|| Episode::begin(config, bank.clone(), &observation));
    let mut episode = episode?;
    let mut times = StageTimes { encode, update, select: 0.0 };
    loop {
        let estimate = episode.estimate();
        let place_mm2 = config.settings.stop_place_mm.and(estimate.standing().place_mm2);
        outcome.scored.push(Scored { place_mm2, ..score(&estimate, bank, &hole) });
        watch(&hole, &frame, &episode, &estimate);
        let reach = hole.reach(bank.grid(), protocol.poses);
        let started = Instant::now();
        let in_time = || protocol.choose_ms.is_none_or(|ms| started.elapsed().as_secs_f64() * 1e3 < ms);
        let (decision, select) = timed(|| episode.decide_while(&reach, &mut { in_time }));
        times.select = select;
        outcome.times.push(times);
        let Decision::Touch(action) = decision? else { break };
        let moved = hole.go(&action);
        frame = hole.touch()?;
        let (observation, encode) = timed(|| observe(sensor, &frame));
        let observation = observation?;
        let (taken, update) = timed(|| episode.observe(moved, &observation));
        taken?;
        times = StageTimes { encode, update, select: 0.0 };
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
        brier: bank.parts().iter().zip(&estimate.class_posterior).map(brier).sum(),
        named: hole.index_of(&estimate.part),
        normalised_error: normalised_error(estimate, hole),
        ..score_pose(&estimate.part, estimate.part_from_first, bank.grid(), hole)
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

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::scene::Scene;
    use tactile_data::simulator::Simulator;
    use tactile_data::touch::Side;

    fn protocol(n_prints: usize, poses: Poses) -> Protocol {
        let (seeds, episodes) = (vec![1, 2], 0..12);
        let (absent, n_classes, choose_ms) = (false, None, None);
        Protocol { n_episodes: 12, episodes, seeds, poses, absent, n_classes, choose_ms, n_prints, n_touches: 2 }
    }

    #[test]
    fn prints_take_turns_and_change_nothing_but_the_touch() {
        let simulator = Simulator::new(Scene::preset("alphabet-small").unwrap(), 1).unwrap();
        let holes = Holes::Simulated(&simulator, Side::Hole);
        let hole = |n_prints, index| protocol(n_prints, Poses::OnGrid).hole(holes, &PoseGrid::SMALL, index);
        let prints = |n_prints| (0..12).map(|index| hole(n_prints, index).print()).collect::<Vec<_>>();
        assert_eq!(prints(1), [0; 12]);
        assert_eq!(prints(3), [0, 0, 1, 1, 2, 2, 0, 0, 1, 1, 2, 2]);
        let mut n_changed = 0;
        for index in 0..12 {
            let [mut one, mut other] = [1, 3].map(|n_prints| hole(n_prints, index));
            assert_eq!((one.part(), one.part_from_first()), (other.part(), other.part_from_first()));
            assert_eq!(PoseGrid::SMALL.pose(one.first_view().unwrap()), one.part_from_first());
            let changed = one.touch().unwrap() != other.touch().unwrap();
            assert!(!changed || other.print() > 0, "{index}");
            n_changed += usize::from(changed);
        }
        // Lines show where something is in contact, and where the camera resolves them.
        assert!(n_changed > 0);
        assert_eq!(protocol(1, Poses::OffGrid).hole(holes, &PoseGrid::SMALL, 5).first_view(), None);
    }

    #[test]
    fn prints_that_look_alike_are_refused() {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.sensor.texture_mm = [0.0; 2];
        let smooth = Simulator::new(scene, 1).unwrap();
        let check = |n_prints| {
            let checked = protocol(n_prints, Poses::OnGrid).validate_prints(Holes::Simulated(&smooth, Side::Hole));
            checked.map_err(|e| e.to_string())
        };
        assert_eq!(check(1), Ok(()));
        assert!(check(2).unwrap_err().contains("this scene has no layer lines"));
        assert!(check(0).unwrap_err().contains("prints: expected 1 or more, got 0"));
    }
}

//! Where the sensor may have touched first, and on which part: the belief over all hypotheses.
//!
//! A state is a part and the grid cell of the FIRST touch; later touches follow from the motions the
//! controller reports, `part_from_sensor = part_from_first * first_from_sensor` (paper, Sec. IV-D). The
//! likelihood of each touch is kept, so that any state can be re-scored over all touches by look-ups.

use rand::rngs::ChaCha8Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_infer::bank::Bank;

use crate::exact::Exact;
use crate::likelihood::TouchLikelihood;
use crate::particle::{Particle, ParticleConfig};
use crate::resample::systematic;

/// One state: which part, and where on it the first touch was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hypothesis {
    /// Index of the part in the bank.
    pub part: usize,
    /// Cell of the bank's grid that holds `part_from_first_sensor`.
    pub cell: usize,
}

/// The recorded view that stands for a pose, and how far it is trusted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// The nearest cell of the grid.
    pub cell: usize,
    /// 1 within the tolerance, falling towards 0 with the distance to the cell's pose.
    pub trust: f64,
}

/// The recorded view nearest to a pose; `None` outside the recorded area, where the view is unknown.
///
/// With the distance `d` from the recorded pose, in grid steps (the larger of shift and turn), the trust is
/// 1 up to `tolerance` and `exp(-((d - tolerance) / tolerance)^2 / 2)` beyond it.
pub fn look_up(grid: &PoseGrid, part_from_sensor: &Se2, tolerance: f64) -> Option<Seen> {
    let cell = grid.nearest(part_from_sensor)?;
    let recorded = grid.pose(cell);
    let shift = recorded.distance_mm(part_from_sensor) / grid.xy_step_mm;
    let turn = wrap_angle(recorded.theta_rad - part_from_sensor.theta_rad).to_degrees().abs() / grid.theta_step_deg;
    let excess = (shift.max(turn) - tolerance) / tolerance;
    // A millionth of a step is rounding of the composed pose, not distance.
    let trust = if excess <= 1e-6 { 1.0 } else { (-0.5 * excess * excess).exp() };
    Some(Seen { cell, trust })
}

/// One touch: where it was relative to the first, and how likely it is at each view.
#[derive(Clone, Debug)]
pub struct Touched {
    /// The sensor's motion since the first touch.
    pub first_from_sensor: Se2,
    /// The touch's likelihood at each row of the bank.
    pub likelihood: TouchLikelihood,
    /// For the cell of a first touch, the view recorded where this touch was: the same for every part.
    seen: Vec<Option<Seen>>,
}

impl Touched {
    fn new(grid: &PoseGrid, first_from_sensor: Se2, likelihood: TouchLikelihood, tolerance: f64) -> Self {
        let seen = |cell| look_up(grid, &(grid.pose(cell) * first_from_sensor), tolerance);
        Self { first_from_sensor, likelihood, seen: (0..grid.len()).map(seen).collect() }
    }

    /// log p(touch | hypothesis): that of the view recorded there, or of an unknown view, or of a mix
    /// of both where the nearest view is trusted only in part.
    pub fn log_likelihood(&self, hypothesis: Hypothesis) -> f64 {
        let unknown = self.likelihood.log_unknown;
        match self.seen[hypothesis.cell] {
            None => unknown,
            Some(Seen { cell, trust }) => {
                let log = self.likelihood.log_rows[hypothesis.part * self.seen.len() + cell];
                if trust == 1.0 { log } else { unknown + (trust * (log - unknown).exp() + 1.0 - trust).ln() }
            }
        }
    }
}

/// Which inference runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EngineConfig {
    /// All states: exact on the grid.
    #[default]
    Exact,
    /// The paper's particle filter.
    Particle(ParticleConfig),
}

#[derive(Clone, Debug)]
enum Engine {
    Exact(Exact),
    Particle(Particle),
}

/// S: the probability of each hypothesis given all touches so far, of which there is at least one.
#[derive(Clone, Debug)]
pub struct Belief {
    grid: PoseGrid,
    n_parts: usize,
    lookup_tolerance: f64,
    touches: Vec<Touched>,
    engine: Engine,
}

impl Belief {
    /// The belief after the first touch; every state was equally likely before it (paper, Eq. 3).
    pub fn new(bank: &Bank, engine: EngineConfig, lookup_tolerance: f64, seed: u64, first: TouchLikelihood) -> Self {
        let (grid, n_parts) = (*bank.grid(), bank.parts().len());
        let touched = Touched::new(&grid, Se2::IDENTITY, first, lookup_tolerance);
        let mut exact = Exact::uniform(n_parts * grid.len());
        exact.update(|state| touched.log_likelihood(hypothesis(state, grid.len())));
        let engine = match engine {
            EngineConfig::Exact => Engine::Exact(exact),
            EngineConfig::Particle(config) => Engine::Particle(Particle::draw(config, exact.log_posterior(), seed)),
        };
        Self { grid, n_parts, lookup_tolerance, touches: vec![touched], engine }
    }

    /// Takes in a touch after the motion `sensor_from_next`, and returns its log-evidence
    /// log p(touch | touches before), up to the constant of [`TouchLikelihood`].
    pub fn update(&mut self, sensor_from_next: &Se2, likelihood: TouchLikelihood) -> f64 {
        let first_from_sensor = self.first_from_sensor() * *sensor_from_next;
        let touched = Touched::new(&self.grid, first_from_sensor, likelihood, self.lookup_tolerance);
        let n_cells = self.grid.len();
        let newest = |state| touched.log_likelihood(hypothesis(state, n_cells));
        let log_evidence = match &mut self.engine {
            Engine::Exact(exact) => exact.update(newest),
            Engine::Particle(particle) => particle.update(newest),
        };
        self.touches.push(touched);
        if let Engine::Particle(particle) = &mut self.engine {
            let (grid, touches) = (&self.grid, &self.touches);
            particle.rejuvenate(
                |state, direction| {
                    let cell = neighbour(grid, state % n_cells, direction)?;
                    Some(state - state % n_cells + cell)
                },
                |state| log_score(touches, hypothesis(state, n_cells)),
                |state| log_score(&touches[1..], hypothesis(state, n_cells)),
            );
        }
        log_evidence
    }

    /// All touches, in order.
    pub fn touches(&self) -> &[Touched] {
        &self.touches
    }

    /// The grid of the states.
    pub fn grid(&self) -> &PoseGrid {
        &self.grid
    }

    /// The sensor's motion since the first touch.
    pub fn first_from_sensor(&self) -> Se2 {
        self.touches.last().map_or(Se2::IDENTITY, |touched| touched.first_from_sensor)
    }

    /// The distinct states of positive probability in ascending order, with their probabilities, which sum to 1.
    pub fn states(&self) -> Vec<(Hypothesis, f64)> {
        let masses = self.masses().into_iter().enumerate().filter(|(_, mass)| *mass > 0.0);
        masses.map(|(state, mass)| (hypothesis(state, self.grid.len()), mass)).collect()
    }

    /// The probability of each part, `[n_parts]`, which sum to 1 (paper, Eq. 7).
    pub fn class_posterior(&self) -> Vec<f64> {
        self.masses().chunks_exact(self.grid.len()).map(|part| part.iter().sum()).collect()
    }

    /// Shannon entropy over the states, nats.
    pub fn entropy_nats(&self) -> f64 {
        self.masses().iter().filter(|mass| **mass > 0.0).map(|mass| -mass * mass.ln()).sum()
    }

    /// The state of largest log-posterior accumulated over all touches, among the states that the engine
    /// holds and, where `part` is given, among those of that part. The lowest of equals.
    ///
    /// `None` only where no state of `part` is held.
    pub fn best(&self, part: Option<usize>) -> Option<Hypothesis> {
        let score = |hypothesis: Hypothesis| match &self.engine {
            Engine::Exact(exact) => exact.log_posterior()[hypothesis.part * self.grid.len() + hypothesis.cell],
            Engine::Particle(_) => log_score(&self.touches, hypothesis),
        };
        let held = self.states().into_iter().map(|(hypothesis, _)| hypothesis);
        held.filter(|hypothesis| part.is_none_or(|part| part == hypothesis.part))
            .map(|hypothesis| (score(hypothesis), hypothesis))
            .reduce(|best, next| if next.0 > best.0 { next } else { best })
            .map(|(_, hypothesis)| hypothesis)
    }

    /// `n` states drawn from the belief, ascending, each about as often as it is probable.
    pub fn draw(&self, n: usize, rng: &mut ChaCha8Rng) -> Vec<Hypothesis> {
        let drawn = systematic(&self.masses(), n, rng.random());
        drawn.into_iter().map(|state| hypothesis(state, self.grid.len())).collect()
    }

    /// The probability of each state, `[n_parts * n_cells]`.
    fn masses(&self) -> Vec<f64> {
        match &self.engine {
            Engine::Exact(exact) => exact.log_posterior().iter().map(|log| log.exp()).collect(),
            Engine::Particle(particle) => {
                let mut masses = vec![0.0; self.n_parts * self.grid.len()];
                particle.weighted().for_each(|(state, weight)| masses[state] += weight);
                masses
            }
        }
    }
}

fn hypothesis(state: usize, n_cells: usize) -> Hypothesis {
    Hypothesis { part: state / n_cells, cell: state % n_cells }
}

fn log_score(touches: &[Touched], hypothesis: Hypothesis) -> f64 {
    touches.iter().map(|touched| touched.log_likelihood(hypothesis)).sum()
}

/// The cell one step along x (directions 0, 1), y (2, 3) or theta (4, 5); `None` off the grid.
fn neighbour(grid: &PoseGrid, cell: usize, direction: usize) -> Option<usize> {
    let (n_xy, n_theta) = (grid.n_xy(), grid.n_theta());
    let (stride, length) = [(n_xy * n_theta, n_xy), (n_theta, n_xy), (1, n_theta)][direction / 2];
    let index = cell / stride % length;
    if direction % 2 == 0 { (index > 0).then(|| cell - stride) } else { (index + 1 < length).then(|| cell + stride) }
}

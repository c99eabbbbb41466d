//! A simulated hole that a person touches by hand: where to press is theirs, what is felt and believed is the filter's.
//!
//! In: poses of the sensor on a plate, in which a hole of one of the bank's parts lies hidden. Out: a [`State`] that a page draws. It
//! must not know how the page is served.

mod state;

use std::sync::Arc;

use rand::RngExt;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Background, Frame};
use tactile_data::pose::se2::Se2;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::{Action, Episode, EpisodeConfig, Estimate, Sensor};
use tactile_infer::Bank;

use crate::error::{Error, Result};
use crate::hole::observe;
use crate::holes::Holes;
use crate::narrative::{Board, shown_background};

pub use state::{Named, Placed, State};

/// The hole's middle is no farther from the plate's along x and along y, as a share of how far the filter lets a part be from its first touch;
/// what is left is for the first touch.
const HIDDEN: f64 = 0.5;

/// A person, a simulated sensor and a plate.
#[derive(Debug)]
pub struct ByHand {
    simulator: Simulator,
    sensor: Sensor,
    bank: Arc<Bank>,
    config: EpisodeConfig,
    board: Board,
    shown: Background,
    at_rest: Frame,
    seed: u64,
    n_holes: u64,
    hole: Hidden,
}

/// The hole under the sensor.
#[derive(Debug)]
struct Hidden {
    part: usize,
    plate_from_part: Se2,
    /// Where the sensor was, on the plate.
    touches: Vec<Se2>,
    frame: Option<Frame>,
    episode: Option<Episode>,
    /// The next touch that the filter would make, on the plate.
    next: Option<Se2>,
    is_shown: bool,
}

impl ByHand {
    /// A plate with a first hole.
    ///
    /// # Errors
    /// A bank of other parts than the scene's, a frame at rest that the model refuses, a part whose shape cannot be made.
    pub fn new(
        simulator: Simulator,
        sensor: Sensor,
        bank: Arc<Bank>,
        config: EpisodeConfig,
        seed: u64,
    ) -> Result<Self> {
        if simulator.parts() != bank.parts() {
            let expected = format!("the scene's parts {}", simulator.parts().join(" "));
            return Err(Error::invalid("bank", expected, bank.parts().join(" ")));
        }
        config.validate()?;
        let board = Board::new(Holes::Simulated(&simulator, Side::Hole), &bank)?;
        let at_rest = simulator.no_contact(seed);
        let shown = shown_background(&at_rest)?;
        let hole = Hidden::drawn(&bank, seed, 0);
        Ok(Self { simulator, sensor, bank, config, board, shown, at_rest, seed, n_holes: 1, hole })
    }

    /// Another hole; the one before is forgotten.
    pub fn renew(&mut self) {
        self.hole = Hidden::drawn(&self.bank, self.seed, self.n_holes);
        self.n_holes += 1;
    }

    /// Shows what was hidden.
    pub fn show(&mut self) {
        self.hole.is_shown = true;
    }

    /// How far from the plate's middle the first touch may be along x and along y, mm, and how far it may be turned, degrees.
    pub fn first_reach(&self) -> [f64; 2] {
        let start = self.bank.start();
        [start.xy_half_mm, start.theta_half_deg].map(|half| (1.0 - HIDDEN) * half)
    }

    /// How far the sensor may be from the plate's middle along x and along y, mm.
    pub fn reach_mm(&self) -> f64 {
        (1.0 + HIDDEN) * self.bank.start().xy_half_mm
    }

    /// Presses the sensor on the plate.
    ///
    /// # Errors
    /// A pose off the plate, or a first one where the filter would not look for the hole; a frame that the model refuses. Nothing is
    /// changed then.
    pub fn touch(&mut self, plate_from_sensor: Se2) -> Result<()> {
        let Se2 { x_mm, y_mm, .. } = plate_from_sensor;
        let ([mm, deg], is_first) = (self.first_reach(), self.hole.episode.is_none());
        let within = |most: f64| x_mm.abs() <= most && y_mm.abs() <= most;
        if !plate_from_sensor.is_finite() || !within(self.reach_mm()) {
            let expected = format!("a pose within {} mm of the plate's middle", self.reach_mm());
            return Err(Error::invalid("touch", expected, format!("{x_mm} mm, {y_mm} mm")));
        }
        if is_first && !(within(mm) && plate_from_sensor.theta_deg().abs() <= deg + 1e-9) {
            let expected = format!("a first touch within {mm} mm and {deg} degrees of the plate's middle");
            let got = format!("{x_mm:.1} mm, {y_mm:.1} mm, {:.0} degrees", plate_from_sensor.theta_deg());
            return Err(Error::invalid("touch", expected, got));
        }
        let part_from_sensor = self.hole.plate_from_part.inverse() * plate_from_sensor;
        let stream = (self.n_holes << 20) + self.hole.touches.len() as u64 + 1;
        let frame =
            self.simulator.touch(self.hole.part, Side::Hole, &part_from_sensor, &mut frame_rng(self.seed, stream))?;
        let observation = observe(&self.sensor, &frame)?;
        match (&mut self.hole.episode, self.hole.touches.last()) {
            (Some(episode), Some(last)) => episode.observe(last.inverse() * plate_from_sensor, &observation)?,
            _ => self.hole.episode = Some(Episode::begin(self.config, self.bank.clone(), &observation)?),
        }
        self.hole.touches.push(plate_from_sensor);
        self.hole.frame = Some(frame);
        self.hole.next = self.advised();
        Ok(())
    }

    /// Where the filter would touch next.
    fn advised(&self) -> Option<Se2> {
        let (episode, first, last) =
            (self.hole.episode.as_ref()?, self.hole.touches.first()?, self.hole.touches.last()?);
        if episode.stop_reason().is_some() {
            return None;
        }
        let (grid, sensor_from_first) = (self.bank.start(), last.inverse() * *first);
        let on_plate = |motion: &Se2| {
            let to = *last * *motion;
            to.x_mm.abs() <= self.reach_mm() && to.y_mm.abs() <= self.reach_mm()
        };
        let reach: Vec<Se2> =
            (0..grid.len()).map(|cell| sensor_from_first * grid.pose(cell)).filter(on_plate).collect();
        let Action { sensor_from_next } = episode.next_touch(&reach, &mut || true)?;
        Some(*last * sensor_from_next)
    }

    /// Where the named part's frame is on the plate.
    fn plate_from_named(&self, estimate: &Estimate) -> Se2 {
        let first = self.hole.touches.first().copied().unwrap_or(Se2::IDENTITY);
        first * estimate.part_from_first.inverse()
    }
}

impl Hidden {
    /// A hole of any part, anywhere near the plate's middle and turned.
    fn drawn(bank: &Bank, seed: u64, number: u64) -> Self {
        let mut rng = frame_rng(seed ^ 0x6861_6e64, number);
        let part = rng.random_range(0..bank.parts().len());
        let start = bank.start();
        let mut around = |half: f64| HIDDEN * half * (2.0 * rng.random::<f64>() - 1.0);
        let (mm, deg) = (start.xy_half_mm, start.theta_half_deg);
        let plate_from_part = Se2::from_degrees(around(mm), around(mm), around(deg));
        let touches = Vec::new();
        Self { part, plate_from_part, touches, frame: None, episode: None, next: None, is_shown: false }
    }
}

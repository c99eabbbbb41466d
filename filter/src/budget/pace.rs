//! How fast settings are on this machine with this bank: made-up episodes against a clock.

use std::sync::Arc;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::Bank;

use crate::config::EpisodeConfig;
use crate::episode::{Decision, Episode};
use crate::error::Result;
use crate::settings::Settings;
use crate::touch::Observation;
use crate::touch::Sensor;

/// Touches of a made-up episode: later ones cost as much as these.
const TOUCHES: usize = 5;

/// Times decisions. Libraries have no clock of their own: the caller lends one.
pub struct Pace<'a> {
    /// The sensor.
    pub sensor: &'a Sensor,
    /// A frame of the size the sensor gives; what it shows does not matter.
    pub frame: &'a Frame,
    /// What the touches are held against.
    pub bank: &'a Arc<Bank>,
    /// The motions offered: the poses of this grid, seen from where the first touch was.
    pub reach: &'a PoseGrid,
}

impl Pace<'_> {
    /// Median time of a decision: encode, update and choose the next touch. Runs episodes whose touches are the
    /// bank's own rows, at least one and until `seconds` are over. `clock_s` gives seconds since any moment.
    pub fn decision_ms(&self, config: &EpisodeConfig, seconds: f64, clock_s: &mut dyn FnMut() -> f64) -> Result<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let begun = clock_s();
        let mut decisions = Vec::new();
        while decisions.is_empty() || clock_s() - begun < seconds {
            self.episode(config, &mut rng, clock_s, &mut decisions)?;
        }
        decisions.sort_by(f64::total_cmp);
        Ok(1e3 * decisions[decisions.len() / 2])
    }

    fn episode(
        &self,
        config: &EpisodeConfig,
        rng: &mut ChaCha8Rng,
        clock_s: &mut dyn FnMut() -> f64,
        decisions: &mut Vec<f64>,
    ) -> Result<()> {
        // An episode that stops early would leave out the costly touches.
        let config = EpisodeConfig {
            settings: Settings {
                stop_probability: 1.0,
                false_accept: None,
                max_touches: TOUCHES + 1,
                ..config.settings
            },
            ..*config
        };
        let grid = self.bank.grid();
        let part = rng.random_range(0..self.bank.parts().len());
        let start = self.bank.start();
        let first = start.pose(rng.random_range(0..start.len()));
        let mut part_from_sensor = first;
        let mut episode: Option<Episode> = None;
        let mut moved = None;
        for _ in 0..TOUCHES {
            // Outside the recorded poses: the nearest of them.
            let cell = grid.nearest(&part_from_sensor).unwrap_or(0);
            let row = part * grid.len() + cell;
            let start = clock_s();
            let map = self.sensor.observe(self.frame)?.map;
            let touch = Observation::new(self.bank.row(row).into_owned(), self.bank.edge_shares()[row]);
            let touch = Observation { map, ..touch };
            match (&mut episode, moved) {
                (Some(episode), Some(moved)) => episode.observe(moved, &touch)?,
                _ => episode = Some(Episode::begin(config, self.bank.clone(), &touch)?),
            }
            let Some(episode) = &episode else { break };
            let sensor_from_part = part_from_sensor.inverse();
            let reach: Vec<_> =
                (0..self.reach.len()).map(|pose| sensor_from_part * first * self.reach.pose(pose)).collect();
            let decision = episode.decide(&reach)?;
            decisions.push(clock_s() - start);
            let Decision::Touch(action) = decision else { break };
            part_from_sensor = part_from_sensor * action.sensor_from_next;
            moved = Some(action.sensor_from_next);
        }
        Ok(())
    }
}

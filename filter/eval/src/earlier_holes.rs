//! What earlier holes of a run have told of its sensor: simulated before an episode, as a robot would have felt them.

use std::sync::{Arc, Mutex, PoisonError};

use tactile_filter::{Decision, Episode, SensorMatch};
use tactile_infer::Bank;

use crate::error::{Error, Result};
use crate::evaluate::Run;
use crate::protocol::Protocol;
use crate::result::Poses;

/// Runs of earlier holes for each bank; episodes take turns with them.
const RUNS: usize = 4;

/// Holes that are tried for each that must be named with confidence.
const TRIES: usize = 20;

/// Told apart from the episodes' own seeds.
const SEEDS: u64 = 0x6561_726c_6965_7200;

/// What runs of earlier holes have told, bank by bank.
#[derive(Debug, Default)]
pub struct EarlierHoles {
    known: Mutex<Vec<(Vec<String>, Vec<SensorMatch>)>>,
}

impl EarlierHoles {
    /// What was learnt before an episode with this bank, from as many confident holes of its parts as the protocol asks for.
    ///
    /// # Errors
    /// Too few holes that are named with confidence; a touch that cannot be made or seen.
    pub fn before(&self, run: &Run<'_>, bank: &Arc<Bank>, index: usize) -> Result<SensorMatch> {
        if run.protocol.n_earlier == 0 {
            return Ok(run.config.sensor);
        }
        // Others wait: banks without a part come one after the other, and all of their episodes need this.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known.iter().find(|(parts, _)| parts == bank.parts()).map(|(_, sensors)| sensors[index % RUNS]);
        if let Some(sensor) = found {
            return Ok(sensor);
        }
        let sensors = (0..RUNS).map(|of_run| learnt(run, bank, of_run)).collect::<Result<Vec<_>>>()?;
        let sensor = sensors[index % RUNS];
        known.push((bank.parts().to_vec(), sensors));
        Ok(sensor)
    }
}

/// A run of holes of the bank's parts, until enough are named with confidence.
fn learnt(run: &Run<'_>, bank: &Arc<Bank>, of_run: usize) -> Result<SensorMatch> {
    let n = run.protocol.n_earlier;
    let seed = SEEDS.wrapping_add(run.protocol.seeds[0]).wrapping_add(of_run as u64);
    let protocol = Protocol { seeds: vec![seed], n_prints: 1, ..run.protocol.clone() };
    let mut sensor = run.config.sensor;
    let end = sensor.n_holes as usize + n;
    for index in 0..TRIES * n {
        let mut hole = protocol.hole(run.holes, bank.start(), index);
        if !bank.parts().iter().any(|part| part == hole.part()) {
            continue;
        }
        let config = run
            .config
            .with_sensor(sensor)
            .changed(|_, _, method| method.between_poses = protocol.poses == Poses::OffGrid);
        let mut episode = Episode::begin(config, bank.clone(), &run.sensor.observe(&hole.touch()?)?)?;
        while let Decision::Touch(action) = episode.decide(&hole.reach(bank.start(), protocol.poses))? {
            let moved = hole.go(&action);
            episode.observe(moved, &run.sensor.observe(&hole.touch()?)?)?;
        }
        sensor = episode.learn();
        if sensor.n_holes as usize == end {
            return Ok(sensor);
        }
    }
    let got = format!("{} of {} holes", sensor.n_holes as usize + n - end, TRIES * n);
    Err(Error::invalid("earlier holes", format!("{n} that are named with confidence"), got))
}

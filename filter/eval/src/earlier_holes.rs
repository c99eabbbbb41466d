//! What earlier holes of a run have told of its sensor: simulated before an episode, as a robot would have felt them. Where its lamps are
//! not known, all of them tell the light, too.

use std::sync::{Arc, Mutex, PoisonError};

use tactile_data::frame::Frame;
use tactile_data::light::touch_light::SensorLight;
use tactile_data::pose::se2::Se2;
use tactile_filter::{Decision, Episode, EpisodeConfig, Sensor, SensorMatch};
use tactile_infer::Bank;

use crate::error::{Error, Result};
use crate::evaluate::Run;
use crate::hole::Hole;
use crate::protocol::Protocol;
use crate::result::Poses;

/// Runs of earlier holes for each bank; episodes take turns with them.
const RUNS: usize = 4;

/// Holes that are tried for each that must be named with confidence.
const TRIES: usize = 20;

/// Told apart from the episodes' own seeds.
const SEEDS: u64 = 0x6561_726c_6965_7200;

/// What a run of earlier holes has told.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// How well touches match.
    pub matches: SensorMatch,
    /// The sensor, under the lamps that were learnt.
    pub sensor: Sensor,
}

/// What runs of earlier holes have told, bank by bank.
#[derive(Debug, Default)]
pub struct EarlierHoles {
    known: Mutex<Vec<(Vec<String>, Vec<Learnt>)>>,
}

impl EarlierHoles {
    /// What was learnt before an episode with this bank, from as many confident holes of its parts as the protocol asks for.
    ///
    /// # Errors
    /// Too few holes that are named with confidence; a touch that cannot be made or seen.
    pub fn before(&self, run: &Run<'_>, bank: &Arc<Bank>, index: usize) -> Result<Learnt> {
        if run.protocol.n_earlier == 0 {
            return Ok(Learnt { matches: run.config.sensor, sensor: run.sensor.clone() });
        }
        // Others wait: banks without a part come one after the other, and all of their episodes need this.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known.iter().find(|(parts, _)| parts == bank.parts());
        if let Some((_, learnt)) = found {
            return Ok(learnt[index % RUNS].clone());
        }
        let all = (0..RUNS).map(|of_run| learnt(run, bank, of_run)).collect::<Result<Vec<_>>>()?;
        let learnt = all[index % RUNS].clone();
        known.push((bank.parts().to_vec(), all));
        Ok(learnt)
    }
}

/// A run of holes of the bank's parts, until enough are named with confidence.
fn learnt(run: &Run<'_>, bank: &Arc<Bank>, of_run: usize) -> Result<Learnt> {
    let n = run.protocol.n_earlier;
    let seed = SEEDS.wrapping_add(run.protocol.seeds[0]).wrapping_add(of_run as u64);
    let protocol = Protocol { seeds: vec![seed], n_prints: 1, ..run.protocol.clone() };
    let at_rest = run.holes.at_rest(&protocol.seeds);
    let is_unknown = !run.holes.knows_light();
    let mut light = is_unknown.then(|| SensorLight::new(&at_rest, run.holes.field_of_view_mm())).transpose()?;
    let mut known = Learnt { matches: run.config.sensor, sensor: run.sensor.clone() };
    let (mut n_sure, mut n_felt) = (0, 0);
    while n_sure < n && n_felt < TRIES * n {
        let mut hole = protocol.hole(run.holes, bank.start(), n_felt);
        n_felt += 1;
        if !bank.parts().iter().any(|part| part == hole.part()) {
            continue;
        }
        let config = run
            .config
            .with_sensor(known.matches)
            .changed(|_, _, method| method.between_poses = protocol.poses == Poses::OffGrid);
        let reach = hole.reach(bank.start(), protocol.poses);
        let (episode, frames) = feel(&known.sensor, config, bank, &mut hole, &reach)?;
        let matches = episode.learn();
        n_sure += usize::from(matches != known.matches);
        known.matches = matches;
        let Some(light) = &mut light else { continue };
        frames.iter().try_for_each(|frame| light.add(frame))?;
        if light.learn().is_some() {
            // Its touches will match otherwise.
            known = Learnt { matches: run.config.sensor, sensor: known.sensor.lit_by(light.lamps())? };
        }
    }
    if n_sure == n {
        return Ok(known);
    }
    let got = format!("{n_sure} of {n_felt} holes");
    Err(Error::invalid("earlier holes", format!("{n} that are named with confidence"), got))
}

/// An episode to its end, with the frames of its touches.
fn feel(
    sensor: &Sensor,
    config: EpisodeConfig,
    bank: &Arc<Bank>,
    hole: &mut Hole<'_>,
    reach: &[Se2],
) -> Result<(Episode, Vec<Frame>)> {
    let mut frames = vec![hole.touch()?];
    let mut episode = Episode::begin(config, bank.clone(), &sensor.observe(&frames[0])?)?;
    while let Decision::Touch(action) = episode.decide(reach)? {
        let moved = hole.go(&action);
        let frame = hole.touch()?;
        episode.observe(moved, &sensor.observe(&frame)?)?;
        frames.push(frame);
    }
    Ok((episode, frames))
}

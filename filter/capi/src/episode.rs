//! One hole being identified, on the caller's thread.

use std::sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::{Duration, Instant};

use tactile_data::pose::se2::Se2;
use tactile_filter::{Decision, Episode, EpisodeRecord};

use crate::config::{checked, tf_config};
use crate::model::{Parts, tf_bank};
use crate::pointer::{fill, free, get, give, out, slice};
use crate::sensor::tf_observation;
use crate::status::{Failure, call, tf_status};
use crate::value::{tf_decision, tf_estimate, tf_mode, tf_pose, tf_runner_up, tf_state, tf_stop};

/// One hole being identified. Several threads may ask at once, but only one may use it while a touch is taken in: the others
/// get TF_STATUS_BUSY.
pub struct tf_episode {
    parts: Arc<Parts>,
    episode: RwLock<Episode>,
}

impl tf_episode {
    pub(crate) fn read(&self) -> Result<RwLockReadGuard<'_, Episode>, Failure> {
        Ok(self.episode.try_read()?)
    }

    pub(crate) fn write(&self) -> Result<RwLockWriteGuard<'_, Episode>, Failure> {
        Ok(self.episode.try_write()?)
    }
}

/// Motions of C's.
///
/// # Safety
/// As for [`slice`].
pub(crate) unsafe fn motions(reach: *const tf_pose, n_reach: usize) -> Result<Vec<Se2>, Failure> {
    Ok(unsafe { slice(reach, n_reach, "reach")? }.iter().map(|pose| (*pose).into()).collect())
}

/// Begins with the first touch.
/// \param out  where the handle goes, to be freed by tf_episode_free(); null after an error
/// TF_STATUS_CONFIG: the settings together ask for too much effort. TF_STATUS_WRONG_MODEL: the observation is of another
/// model than the bank.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_begin(
    config: *const tf_config,
    bank: *const tf_bank,
    observation: *const tf_observation,
    out: *mut *mut tf_episode,
) -> tf_status {
    let begin = || {
        let (config, parts) = unsafe { (checked(config)?, get(bank, "bank")?.parts.clone()) };
        let observation = unsafe { get(observation, "observation")? };
        let episode = RwLock::new(Episode::begin(config, parts.bank.clone(), &observation.observation)?);
        Ok(tf_episode { parts, episode })
    };
    call(|| unsafe { give(out, begin) })
}

/// Frees an episode; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_free(episode: *mut tf_episode) {
    unsafe { free(episode) }
}

/// Takes in a touch.
/// \param moved  the motion really made since the last touch that was taken in, in the sensor's frame at that touch
/// After an error the episode is as before, and the motion counts towards the next touch.
/// TF_STATUS_FROZEN_FRAME, TF_STATUS_MOTION, TF_STATUS_WRONG_MODEL, TF_STATUS_OBSERVATION.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_observe(
    episode: *mut tf_episode,
    moved: tf_pose,
    observation: *const tf_observation,
) -> tf_status {
    call(|| {
        let (episode, observation) = unsafe { (get(episode, "episode")?, get(observation, "observation")?) };
        Ok(episode.write()?.observe(moved.into(), &observation.observation)?)
    })
}

/// Whether to stop, and if not, which motion to make. Changes nothing: asked again, it answers the same.
/// \param reach  the motions that the robot can make from here, in the sensor's frame
/// TF_STATUS_EMPTY_REACH: the episode should go on, and no motion of finite numbers was offered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_decide(
    episode: *const tf_episode,
    reach: *const tf_pose,
    n_reach: usize,
    decision: *mut tf_decision,
) -> tf_status {
    call(|| unsafe { decide(episode, motions(reach, n_reach), decision, None) })
}

/// Like tf_episode_decide(), with a limit on the time to choose the motion: once it is over, the best motion found so far is
/// taken. The answer then depends on the machine's speed.
/// \param limit_us  the limit, microseconds
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_decide_within(
    episode: *const tf_episode,
    reach: *const tf_pose,
    n_reach: usize,
    limit_us: u64,
    decision: *mut tf_decision,
) -> tf_status {
    let limit = Duration::from_micros(limit_us);
    call(|| unsafe { decide(episode, motions(reach, n_reach), decision, Some(limit)) })
}

/// # Safety
/// `episode` and `decision` are null or valid.
unsafe fn decide(
    episode: *const tf_episode,
    reach: Result<Vec<Se2>, Failure>,
    decision: *mut tf_decision,
    limit: Option<Duration>,
) -> Result<(), Failure> {
    let start = Instant::now();
    let (episode, place, reach) = (unsafe { get(episode, "episode")? }, out(decision, "decision")?, reach?);
    let mut keep_going = || limit.is_none_or(|limit| start.elapsed() < limit);
    let decided: Decision = episode.read()?.decide_while(&reach, &mut keep_going)?;
    unsafe { place.put(tf_decision::of(&decided, &episode.parts)?) };
    Ok(())
}

/// What is known now.
/// \param stop  where the reason to stop now goes, TF_STOP_NONE to go on; null is allowed
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_estimate(
    episode: *const tf_episode,
    estimate: *mut tf_estimate,
    stop: *mut tf_stop,
) -> tf_status {
    call(|| unsafe {
        let (handle, place) = (get(episode, "episode")?, out(estimate, "estimate")?);
        let episode = handle.read()?;
        place.put(tf_estimate::of(&episode.estimate(), &handle.parts)?);
        if !stop.is_null() {
            out(stop, "stop")?.put(episode.stop_reason().map_or(tf_stop::None, Into::into));
        }
        Ok(())
    })
}

/// Takes what this hole tells of the sensor into a config, where its part is named with confidence now: how well touches of
/// this sensor match. Begin the next hole of the run with that config, as long as gel and camera stay;
/// tf_config_forget_sensor() begins anew.
/// \param n_holes  where the number of holes goes that have told so far; null is allowed
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_learn(
    episode: *const tf_episode,
    config: *mut tf_config,
    n_holes: *mut u32,
) -> tf_status {
    call(|| unsafe {
        let (episode, config) = (get(episode, "episode")?, get(config.cast_const(), "config")?);
        let sensor = episode.read()?.learn();
        config.know(sensor)?;
        if !n_holes.is_null() {
            out(n_holes, "n_holes")?.put(sensor.n_holes);
        }
        Ok(())
    })
}

/// The second most probable part now. Ask for it after TF_STOP_TOUCH_LIMIT and TF_STOP_NOTHING_TO_LEARN: the hole may
/// be that of either.
/// \param runner_up  where it goes; its has_part is 0 where no other part is left
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_runner_up(episode: *const tf_episode, runner_up: *mut tf_runner_up) -> tf_status {
    call(|| unsafe {
        let (handle, place) = (get(episode, "episode")?, out(runner_up, "runner_up")?);
        let runner_up = handle.read()?.runner_up();
        place.put(tf_runner_up::of(runner_up.as_ref(), &handle.parts)?);
        Ok(())
    })
}

/// The probability of each part, in the bank's order; they sum to 1.
/// \param required  where the number of parts goes; with a capacity of 0 nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_class_posterior(
    episode: *const tf_episode,
    buffer: *mut f64,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let episode = get(episode, "episode")?.read()?;
        fill(episode.class_posterior(), buffer, capacity, required)
    })
}

/// The belief over one part: each pose of the grid and its probability, those of no probability too.
/// \param required  where the number of poses goes, the same for each part; with a capacity of 0 nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_belief(
    episode: *const tf_episode,
    part: usize,
    buffer: *mut tf_state,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let handle = get(episode, "episode")?;
        handle.parts.name(part)?;
        let episode = handle.read()?;
        let (grid, moved) = (episode.belief().posterior().grid(), episode.belief().first_from_sensor());
        let pose = |cell| tf_state { part_from_sensor: (grid.pose(cell) * moved).into(), probability: 0.0 };
        let mut states: Vec<tf_state> = (0..grid.len()).map(pose).collect();
        if capacity > 0 {
            let held = episode.belief().posterior().states().into_iter();
            let of_part = held.filter(|(hypothesis, _)| hypothesis.part == part);
            of_part.for_each(|(hypothesis, mass)| states[hypothesis.cell].probability = mass);
        }
        fill(&states, buffer, capacity, required)
    })
}

/// The peaks of the belief, the heaviest first; those below 1 % are left out.
/// \param required  where their number goes; with a capacity of 0 nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_modes(
    episode: *const tf_episode,
    buffer: *mut tf_mode,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let estimate = get(episode, "episode")?.read()?.estimate();
        let modes: Vec<tf_mode> = estimate.modes.iter().map(Into::into).collect();
        fill(&modes, buffer, capacity, required)
    })
}

/// The episode as JSON in UTF-8, without a zero at the end: what is needed to go on later, or elsewhere.
/// \param required  where the number of bytes goes; with a capacity of 0 nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_record(
    episode: *const tf_episode,
    buffer: *mut u8,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let record = get(episode, "episode")?.read()?.record()?;
        let text = serde_json::to_vec(&record).map_err(|error| Failure::new(tf_status::Other, error.to_string()))?;
        fill(&text, buffer, capacity, required)
    })
}

/// An episode as it was when recorded, to the bit.
/// \param json    what tf_episode_record() wrote
/// \param length  its length, bytes
/// TF_STATUS_ARGUMENT: no record. TF_STATUS_WRONG_BANK: one of another bank or version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_restore(
    bank: *const tf_bank,
    json: *const u8,
    length: usize,
    out: *mut *mut tf_episode,
) -> tf_status {
    let restore = || {
        let (bank, json) = unsafe { (get(bank, "bank")?, slice(json, length, "json")?) };
        let record: EpisodeRecord =
            serde_json::from_slice(json).map_err(|error| Failure::argument("json", "a saved episode", error))?;
        let parts = bank.parts.clone();
        let episode = RwLock::new(Episode::restore(&record, parts.bank.clone())?);
        Ok(tf_episode { parts, episode })
    };
    call(|| unsafe { give(out, restore) })
}

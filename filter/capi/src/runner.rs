//! An episode on a thread of its own.

use std::sync::{Arc, Mutex, MutexGuard};

use tactile_filter::runner::{Answer, Job, Outcome, Runner};
use tactile_filter::{Decision, Estimate};

use crate::config::{checked, tf_config};
use crate::episode::motions;
use crate::model::{Parts, tf_bank};
use crate::pointer::{free, get, give, out};
use crate::sensor::{self, tf_frame, tf_sensor};
use crate::status::{Failure, call, remember, tf_status};
use crate::value::{tf_decision, tf_estimate, tf_pose, tf_runner_up};

/// An episode on a thread of its own, for callers that must never wait. tf_runner_submit_...() and tf_runner_poll() never
/// wait for the thread. Use it from one thread at a time: a call that meets another gets TF_STATUS_BUSY.
pub struct tf_runner {
    parts: Arc<Parts>,
    runner: Mutex<Polled>,
}

/// A runner, and what its latest polled outcome knew besides what [`tf_outcome`] holds.
struct Polled {
    runner: Runner,
    runner_up: tf_runner_up,
}

impl tf_runner {
    fn lock(&self) -> Result<MutexGuard<'_, Polled>, Failure> {
        Ok(self.runner.try_lock()?)
    }
}

/// What an outcome is of.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum tf_outcome_kind {
    /// Nothing: no job is done that was not polled yet.
    #[default]
    None = 0,
    /// A touch, by tf_runner_submit_touch(): `decision` says what to do next.
    Decision = 1,
    /// An estimate, by tf_runner_submit_estimate(): `decision.estimate` holds it.
    Estimate = 2,
    /// A new episode, by tf_runner_submit_new_episode().
    NewEpisode = 3,
    /// A frame at rest, by tf_runner_submit_rest().
    Rest = 4,
    /// A job that was not done: `status` says why, and tf_last_error() in words.
    Error = 5,
}

/// What came of a job.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_outcome {
    /// What it is of.
    pub kind: tf_outcome_kind,
    /// TF_STATUS_OK, or why the job was not done.
    pub status: tf_status,
    /// The number that the job was given when it was submitted.
    pub ticket: u64,
    /// What to do next, or what is known.
    pub decision: tf_decision,
}

impl Default for tf_outcome {
    fn default() -> Self {
        Self { kind: tf_outcome_kind::None, status: tf_status::Ok, ticket: 0, decision: tf_decision::default() }
    }
}

impl tf_outcome {
    /// An outcome as C sees it; names belong to `parts`.
    fn of(outcome: Outcome, parts: &Parts) -> Result<Self, Failure> {
        let nothing = Self { ticket: outcome.ticket, ..Self::default() };
        let done = |kind| Self { kind, ..nothing };
        Ok(match outcome.answer {
            Ok(Answer::Decision(decision)) => {
                Self { decision: tf_decision::of(&decision, parts)?, ..done(tf_outcome_kind::Decision) }
            }
            Ok(Answer::Estimate(estimate)) => {
                let decision = tf_decision { estimate: tf_estimate::of(&estimate, parts)?, ..nothing.decision };
                Self { decision, ..done(tf_outcome_kind::Estimate) }
            }
            Ok(Answer::NewEpisode) => done(tf_outcome_kind::NewEpisode),
            Ok(Answer::Rest) => done(tf_outcome_kind::Rest),
            Err(fault) => {
                let Failure { status, message } = fault.into();
                remember(message);
                Self { status, ..done(tf_outcome_kind::Error) }
            }
        })
    }
}

/// Starts a thread that takes in touches and decides. It keeps what it needs of sensor and bank: both may be freed.
/// \param capacity  the most jobs without a polled outcome, 1 to 1024
/// \param out       where the handle goes, to be freed by tf_runner_free(); null after an error
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_start(
    sensor: *const tf_sensor,
    bank: *const tf_bank,
    config: *const tf_config,
    capacity: usize,
    out: *mut *mut tf_runner,
) -> tf_status {
    let start = || {
        let (sensor, parts) = unsafe { (get(sensor, "sensor")?, get(bank, "bank")?.parts.clone()) };
        let config = unsafe { checked(config)? };
        let runner = Runner::start((*sensor.sensor).clone(), parts.bank.clone(), config, capacity)?;
        Ok(tf_runner { parts, runner: Mutex::new(Polled { runner, runner_up: tf_runner_up::default() }) })
    };
    call(|| unsafe { give(out, start) })
}

/// Stops the thread and frees the runner; null is allowed. Waits for the job that is being done, some milliseconds; those
/// that wait are not done.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_free(runner: *mut tf_runner) {
    unsafe { free(runner) }
}

/// Hands in a touch; the first one begins the episode. Copies the frame and the reach, and never waits.
/// \param moved   the motion really made since the touch submitted before, in the sensor's frame at that touch. The runner
///                itself adds up the motions of touches that were refused
/// \param reach   the motions that the robot can make from here, in the sensor's frame at this touch
/// \param ticket  where the number of the job goes: 0, then 1, 2 ...; null is allowed
/// TF_STATUS_QUEUE_FULL: the runner has as many jobs without a polled outcome as it may have; poll, and try again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_submit_touch(
    runner: *mut tf_runner,
    frame: *const tf_frame,
    moved: tf_pose,
    reach: *const tf_pose,
    n_reach: usize,
    ticket: *mut u64,
) -> tf_status {
    let touch = || {
        let (frame, reach) = unsafe { (sensor::read(frame)?, motions(reach, n_reach)?) };
        Ok(Job::Touch { frame, moved: moved.into(), reach })
    };
    call(|| unsafe { submit(runner, ticket, touch) })
}

/// Asks for the estimate after the touches submitted so far.
/// \param ticket  as for tf_runner_submit_touch()
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_submit_estimate(runner: *mut tf_runner, ticket: *mut u64) -> tf_status {
    call(|| unsafe { submit(runner, ticket, || Ok(Job::Estimate)) })
}

/// Forgets the touches: the next one begins an episode.
/// \param config  what it runs with; null: as before
/// \param ticket  as for tf_runner_submit_touch()
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_submit_new_episode(
    runner: *mut tf_runner,
    config: *const tf_config,
    ticket: *mut u64,
) -> tf_status {
    let new_episode = || {
        let config = if config.is_null() { None } else { Some(Box::new(unsafe { checked(config)? })) };
        Ok(Job::NewEpisode(config))
    };
    call(|| unsafe { submit(runner, ticket, new_episode) })
}

/// A new frame at rest, for all touches submitted from now on. After an error the one before stays.
/// \param ticket  as for tf_runner_submit_touch()
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_submit_rest(
    runner: *mut tf_runner,
    at_rest: *const tf_frame,
    ticket: *mut u64,
) -> tf_status {
    call(|| unsafe { submit(runner, ticket, || Ok(Job::Rest(sensor::read(at_rest)?))) })
}

/// # Safety
/// `runner` and `ticket` are null or valid.
unsafe fn submit(
    runner: *mut tf_runner,
    ticket: *mut u64,
    job: impl FnOnce() -> Result<Job, Failure>,
) -> Result<(), Failure> {
    let runner = unsafe { get(runner, "runner")? };
    let place = if ticket.is_null() { None } else { Some(out(ticket, "ticket")?) };
    let number = runner.lock()?.runner.submit(job()?)?;
    if let Some(place) = place {
        unsafe { place.put(number) };
    }
    Ok(())
}

/// The outcome of the earliest job that has none yet, where it is done; else one of the kind TF_OUTCOME_KIND_NONE. Never
/// waits. Every job gets exactly one outcome, in the order in which they were submitted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_poll(runner: *mut tf_runner, outcome: *mut tf_outcome) -> tf_status {
    call(|| unsafe {
        let (runner, place) = (get(runner, "runner")?, out(outcome, "outcome")?);
        let mut polled = runner.lock()?;
        let Some(next) = polled.runner.poll() else {
            place.put(tf_outcome::default());
            return Ok(());
        };
        let runner_up = estimate_of(&next).and_then(|estimate| estimate.runner_up.as_ref());
        polled.runner_up = tf_runner_up::of(runner_up, &runner.parts)?;
        place.put(tf_outcome::of(next, &runner.parts)?);
        Ok(())
    })
}

/// What was found, where an outcome says so.
fn estimate_of(outcome: &Outcome) -> Option<&Estimate> {
    match &outcome.answer {
        Ok(Answer::Estimate(estimate) | Answer::Decision(Decision::Done(estimate, _))) => Some(estimate),
        _ => None,
    }
}

/// The second most probable part of the latest outcome that tf_runner_poll() gave, where that holds an estimate: see
/// tf_episode_runner_up().
/// \param runner_up  where it goes; its has_part is 0 where that outcome holds no estimate, or no other part is left
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_runner_runner_up(runner: *const tf_runner, runner_up: *mut tf_runner_up) -> tf_status {
    call(|| unsafe {
        let (runner, place) = (get(runner, "runner")?, out(runner_up, "runner_up")?);
        place.put(runner.lock()?.runner_up);
        Ok(())
    })
}

//! An episode on a thread of its own, for callers that must never wait: a control loop of 1 kHz hands in a touch and
//! goes on; the decision is there some milliseconds later.
//!
//! [`Runner::submit`] and [`Runner::poll`] never wait for the thread. Every job gets a ticket, in order, and one outcome
//! with that ticket, in the same order; none is lost. At most `capacity` jobs are without a polled outcome; one more
//! is refused, and given back.
//!
//! The runner keeps account of the motion: after a touch that was refused (a dark frame, a frozen camera) the belief is
//! as before, and that touch's motion is put in front of the next one's. The caller always gives the motion since the
//! touch that it submitted before, whether that was taken in or not.

mod worker;

use std::sync::Arc;

use tactile_data::frame::Frame;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;

use crate::config::EpisodeConfig;
use crate::decision::Estimate;
use crate::episode::{Decision, Episode};
use crate::error::{Error, Result};
use crate::touch::{Sensor, check_motion};
use worker::{Refused, Worker};

/// The largest capacity of a runner: at ten touches a second, more than a minute and a half of work.
pub const MAX_CAPACITY: usize = 1024;

/// Something for the runner to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Job {
    /// Take in a touch and decide; the first one begins the episode.
    Touch {
        /// What the camera saw, in contact.
        frame: Frame,
        /// The motion really made since the touch submitted before, in the sensor's frame at that touch. Not used for the
        /// touches up to the first one that is taken in.
        moved: Se2,
        /// What the robot can do from here, in the sensor's frame at this touch.
        reach: Vec<Se2>,
    },
    /// Give the estimate after the touches so far.
    Estimate,
    /// Forget the touches: the next one begins an episode, with these settings, or with those before.
    NewEpisode(Option<Box<EpisodeConfig>>),
    /// A new frame at rest, for all touches from now on. After an error the one before stays.
    Rest(Frame),
}

/// What came of a job.
#[derive(Debug)]
pub struct Outcome {
    /// The number that [`Runner::submit`] gave the job: 0, 1, 2 ...
    pub ticket: u64,
    /// Its answer.
    pub answer: std::result::Result<Answer, Fault>,
}

/// The answer to a job that was done.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// To [`Job::Touch`]: the touch was taken in, and this is to be done next.
    Decision(Decision),
    /// To [`Job::Estimate`].
    Estimate(Box<Estimate>),
    /// To [`Job::NewEpisode`].
    NewEpisode,
    /// To [`Job::Rest`].
    Rest,
}

/// Why a job was not done. The belief is as before it, but for [`Fault::Panic`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// What an episode or a sensor refuses. A touch's motion, where it is one that a robot makes, counts towards the next.
    #[error(transparent)]
    Filter(#[from] Error),
    /// There is no touch to estimate from, or the episode was lost in a panic: submit [`Job::NewEpisode`].
    #[error("episode: expected one with a touch, got {got}")]
    NoEpisode {
        /// What there is instead.
        got: &'static str,
    },
    /// This library is at fault. The episode is lost; [`Job::NewEpisode`] makes the runner usable again.
    #[error("the runner panicked: {message}")]
    Panic {
        /// What the panic said.
        message: String,
    },
}

/// Why a job was not accepted; the job is given back.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    /// As many jobs as the runner's capacity have no polled outcome yet.
    #[error("runner: expected at most {capacity} jobs without a polled outcome, got one more")]
    Full {
        /// The job, not done.
        job: Job,
        /// The runner's capacity.
        capacity: usize,
    },
    /// The thread has ended, which it does only where a panic could not be caught.
    #[error("runner: expected a running thread, got one that has ended")]
    Stopped {
        /// The job, not done.
        job: Job,
    },
}

/// A thread that takes in touches and decides. Dropping it stops and joins the thread: a job that has begun is finished
/// first, those that wait are not done.
#[derive(Debug)]
pub struct Runner {
    worker: Worker<Job, Outcome>,
}

impl Runner {
    /// Starts the thread. `capacity`: the most jobs without a polled outcome, 1 to [`MAX_CAPACITY`].
    ///
    /// # Errors
    /// A setting or capacity out of range, a sensor of another model than the bank, no thread to be had.
    pub fn start(sensor: Sensor, bank: Arc<Bank>, config: EpisodeConfig, capacity: usize) -> Result<Self> {
        config.validate()?;
        if sensor.model().sha256() != bank.model_sha256() {
            let (expected, got) = (bank.model_sha256().to_string(), sensor.model().sha256().to_string());
            return Err(Error::WrongModel { what: "sensor", expected, got });
        }
        if !(1..=MAX_CAPACITY).contains(&capacity) {
            return Err(Error::config("runner.capacity", format!("1 to {MAX_CAPACITY}"), capacity.to_string()));
        }
        let mut state = State { sensor, bank, config, phase: Phase::Begins, refused: None };
        let work = move |ticket, job| Outcome { ticket, answer: state.answer(job) };
        let panicked = |ticket, message| Outcome { ticket, answer: Err(Fault::Panic { message }) };
        let worker = Worker::start("tactile-runner", capacity, work, panicked);
        Ok(Self { worker: worker.map_err(tactile_data::Error::io("thread tactile-runner"))? })
    }

    /// Hands in a job and returns its ticket: 0 for the first, then 1, 2 ... Never waits.
    ///
    /// # Errors
    /// [`SubmitError`] with the job in it; it got no ticket.
    pub fn submit(&mut self, job: Job) -> std::result::Result<u64, SubmitError> {
        let capacity = self.worker.capacity();
        self.worker.submit(job).map_err(|refused| match refused {
            Refused::Full(job) => SubmitError::Full { job, capacity },
            Refused::Stopped(job) => SubmitError::Stopped { job },
        })
    }

    /// The outcome of the earliest job that has none yet, where it is done. Never waits.
    pub fn poll(&mut self) -> Option<Outcome> {
        self.worker.poll()
    }

    /// How many jobs have no polled outcome yet.
    pub fn n_pending(&self) -> usize {
        self.worker.n_pending()
    }
}

/// What the thread holds.
struct State {
    sensor: Sensor,
    bank: Arc<Bank>,
    config: EpisodeConfig,
    phase: Phase,
    /// The motions of the touches refused since the last one that was taken in.
    refused: Option<Se2>,
}

enum Phase {
    /// The next touch is the first.
    Begins,
    Runs(Box<Episode>),
    /// A job is under way, or panicked.
    Lost,
}

impl State {
    fn answer(&mut self, job: Job) -> std::result::Result<Answer, Fault> {
        match job {
            Job::Touch { frame, moved, reach } => self.touch(&frame, moved, &reach).map(Answer::Decision),
            Job::Estimate => match &self.phase {
                Phase::Runs(episode) => Ok(Answer::Estimate(Box::new(episode.estimate()))),
                Phase::Begins => Err(Fault::NoEpisode { got: "none yet" }),
                Phase::Lost => Err(LOST),
            },
            Job::NewEpisode(config) => {
                if let Some(config) = config {
                    config.validate()?;
                    self.config = *config;
                }
                (self.phase, self.refused) = (Phase::Begins, None);
                Ok(Answer::NewEpisode)
            }
            Job::Rest(frame) => {
                self.sensor = self.sensor.with_rest(&frame).map_err(Fault::Filter)?;
                Ok(Answer::Rest)
            }
        }
    }

    fn touch(&mut self, frame: &Frame, moved: Se2, reach: &[Se2]) -> std::result::Result<Decision, Fault> {
        // A panic on the way leaves the phase lost.
        match std::mem::replace(&mut self.phase, Phase::Lost) {
            Phase::Lost => Err(LOST),
            Phase::Begins => {
                self.phase = Phase::Begins;
                check_reach(reach)?;
                let episode = Episode::begin(self.config, self.bank.clone(), &self.sensor.observe(frame)?)?;
                self.phase = Phase::Runs(Box::new(episode));
                self.decide(reach)
            }
            Phase::Runs(mut episode) => {
                let taken_in = self.take_in(&mut episode, frame, moved, reach);
                self.phase = Phase::Runs(episode);
                taken_in?;
                self.decide(reach)
            }
        }
    }

    /// Takes in a touch of a running episode, with the motions of the refused ones before it.
    fn take_in(&mut self, episode: &mut Episode, frame: &Frame, moved: Se2, reach: &[Se2]) -> Result<()> {
        check_motion(&moved)?;
        let moved = self.refused.map_or(moved, |refused| refused * moved);
        self.refused = Some(moved);
        check_reach(reach)?;
        episode.observe(moved, &self.sensor.observe(frame)?)?;
        self.refused = None;
        Ok(())
    }

    fn decide(&self, reach: &[Se2]) -> std::result::Result<Decision, Fault> {
        match &self.phase {
            Phase::Runs(episode) => Ok(episode.decide(reach)?),
            Phase::Begins | Phase::Lost => Err(LOST),
        }
    }
}

const LOST: Fault = Fault::NoEpisode { got: "one that was lost in a panic" };

/// Refuses a reach in which no decision can be made before the touch is taken in, so that an error always leaves the
/// belief as it was.
fn check_reach(reach: &[Se2]) -> Result<()> {
    if reach.iter().any(Se2::is_finite) { Ok(()) } else { Err(Error::EmptyReach { n_motions: reach.len() }) }
}

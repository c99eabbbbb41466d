//! A simulated robot in the same process.

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::robot::{Outcome, Robot};
use crate::session::Session;
use crate::shell::{Spoken, is_asked, pair};

/// Seconds of the joined clock after which a hole counts as not found.
const LIMIT_S: f64 = 120.0;

/// Runs until the robot's holes are done or a stop is asked for, as fast as it goes, or with the pace of a clock. `tell` gets what a
/// person should see.
///
/// # Errors
/// A hole that cannot be touched, a robot that does not come to an end, a log that cannot be ended.
pub fn run(
    mut session: Session,
    mut robot: Robot,
    is_paced: bool,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<Vec<Outcome>> {
    let started = Instant::now();
    let limit_s = LIMIT_S * robot.n_episodes() as f64;
    let mut goes_on = |seconds: f64| {
        if is_paced {
            std::thread::sleep(Duration::from_secs_f64(seconds).saturating_sub(started.elapsed()));
        }
        !is_asked(stop)
    };
    pair::run(&mut session, &mut robot, limit_s, &mut goes_on, tell)?;
    session.finish()?;
    Ok(robot.outcomes().to_vec())
}

//! A node and a robot joined in one process, on a clock that runs as fast as they do.

use crate::error::{Error, Result};
use crate::event::{Event, Input, Output, Topic};
use crate::robot::{Heard, Robot, Sent};
use crate::session::Session;
use crate::shell::{Spoken, spoken};

/// Between two ticks, nanoseconds.
const TICK_NS: i64 = 20_000_000;

/// When it begins: a stamp of zero would mean none.
const START_NS: i64 = 1_700_000_000_000_000_000;

/// Runs until the robot's holes are done, or `goes_on`, asked at each tick with the seconds since the start, says no;
/// `tell` gets what a person should see.
///
/// # Errors
/// A hole that cannot be touched; more than `limit_s` seconds of the joined clock.
pub fn run(
    session: &mut Session,
    robot: &mut Robot,
    limit_s: f64,
    goes_on: &mut dyn FnMut(f64) -> bool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    session.handle(&Event { time_ns: START_NS, input: Input::Cameras(1) });
    let mut n_calls = 0;
    for tick in 0.. {
        let time_ns = START_NS + tick * TICK_NS;
        let seconds = (tick * TICK_NS) as f64 * 1e-9;
        if robot.is_finished() || !goes_on(seconds) {
            return Ok(());
        }
        if seconds > limit_s {
            let got = format!("{} of the holes done", robot.outcomes().len());
            return Err(Error::invalid("simulated robot", format!("an end within {limit_s} s"), got));
        }
        let mut heard = vec![Heard::Tick];
        let mut outputs = session.handle(&Event { time_ns, input: Input::Tick });
        loop {
            spoken(&outputs).into_iter().for_each(&mut *tell);
            heard.extend(outputs.drain(..).filter_map(|output| heard_of(&output)));
            if heard.is_empty() {
                break;
            }
            for heard in std::mem::take(&mut heard) {
                for sent in robot.step(time_ns, &heard)? {
                    let Some(input) = input_of(sent, &mut n_calls, &mut |line| tell(Spoken::Line(line))) else {
                        continue;
                    };
                    outputs.extend(session.handle(&Event { time_ns, input }));
                }
            }
        }
    }
    Ok(())
}

fn input_of(sent: Sent, n_calls: &mut u64, say: &mut dyn FnMut(String)) -> Option<Input> {
    Some(match sent {
        Sent::Given(given, cdr) => Input::Given(given, cdr),
        Sent::Call(request) => {
            *n_calls += 1;
            Input::Called { request, id: *n_calls }
        }
        Sent::Say(text) => {
            say(text);
            return None;
        }
    })
}

fn heard_of(output: &Output) -> Option<Heard> {
    match output {
        Output::Publish { topic: Topic::NextPose, cdr } => Some(Heard::NextPose(cdr.clone())),
        Output::Publish { topic: Topic::Decision, cdr } => Some(Heard::Decision(cdr.clone())),
        Output::Publish { .. } => None,
        Output::Answer { success, message, .. } => Some(Heard::Answer { success: *success, message: message.clone() }),
    }
}

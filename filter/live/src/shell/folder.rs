//! A folder that pictures are put into.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use crate::error::Result;
use crate::event::{Event, Input, Output};
use crate::session::Session;
use crate::shell::{Spoken, TICK, is_asked, spoken};
use crate::sources::NodeClock;
use crate::sources::folder::{Folder, Ready};

/// Between two looks at the folder.
const LOOK: Duration = Duration::from_millis(100);

/// How long a picture's answer is waited for; the node gives one up sooner.
const PATIENCE: Duration = Duration::from_secs(15);

/// Looks at the folder until a stop is asked for, or, with `once`, until nothing more is ready.
///
/// # Errors
/// A folder that cannot be read, an answer that cannot be written.
pub fn run(
    mut session: Session,
    mut folder: Folder,
    once: bool,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    let clock = NodeClock::start();
    let mut id = 0;
    while !is_asked(stop) {
        id += 1;
        match folder.next(id) {
            Ok(Some(ready)) => touch(&mut session, &folder, &clock, &ready, tell)?,
            Ok(None) if once => break,
            Ok(None) => {
                session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick });
                std::thread::sleep(LOOK);
            }
            Err(error) => tell(Spoken::Line(error.to_string())),
        }
    }
    session.finish()
}

/// Gives the session a picture; what follows from a touch is written to its answer.
fn touch(
    session: &mut Session,
    folder: &Folder,
    clock: &NodeClock,
    ready: &Ready,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    let time_ns = clock.now_ns();
    let mut outputs: Vec<Output> = Vec::new();
    for input in &ready.events {
        outputs.extend(session.handle(&Event { time_ns, input: input.clone() }));
    }
    let is_answered = |output: &Output| matches!(output, Output::Answer { .. });
    let started = std::time::Instant::now();
    // What a picture lacks is said once its time is over.
    while !outputs.iter().any(is_answered) && started.elapsed() < PATIENCE {
        std::thread::sleep(TICK);
        outputs.extend(session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick }));
    }
    for spoken in spoken(&outputs) {
        if let Spoken::Decision(report) = &spoken {
            let json = serde_json::to_string_pretty(report)
                .map_err(|error| crate::Error::invalid("decision", "numbers that JSON has", error.to_string()))?;
            folder.answer(&ready.path, &json)?;
        }
        tell(spoken);
    }
    Ok(())
}

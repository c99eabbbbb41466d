//! A folder that pictures are put into.

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::decision::DecisionReport;
use crate::error::{Error, Result};
use crate::event::{Event, Input, Output};
use crate::session::Session;
use crate::shell::failures::Failures;
use crate::shell::{Spoken, TICK, is_asked, spoken};
use crate::sources::NodeClock;
use crate::sources::folder::{Folder, Ready};

/// Between two looks at the folder.
const LOOK: Duration = Duration::from_millis(100);

/// How long a picture's answer is waited for; the node gives one up sooner.
const PATIENCE: Duration = Duration::from_secs(15);

/// Looks at the folder until a stop is asked for, or, with `once`, until nothing more is ready. A folder that cannot be
/// read and an answer that cannot be written are said, and it goes on.
///
/// # Errors
/// A log that cannot be ended.
pub fn run(
    mut session: Session,
    mut folder: Folder,
    once: bool,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    let clock = NodeClock::start();
    let mut failures = Failures::default();
    let mut id = 0;
    while !is_asked(stop) {
        id += 1;
        let failed = match folder.next(id) {
            Ok(Some(ready)) => {
                let said = take(&mut session, &clock, &ready, stop);
                let answered = answer(&folder, &ready, &said);
                said.spoken.into_iter().for_each(&mut *tell);
                answered.err()
            }
            Ok(None) if once => break,
            looked => {
                session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick });
                std::thread::sleep(LOOK);
                looked.err()
            }
        };
        if let Some(line) = failed.and_then(|error| failures.line(&error.to_string(), Instant::now())) {
            tell(Spoken::Line(line));
        }
    }
    session.finish()
}

/// What came of a picture.
struct Said {
    spoken: Vec<Spoken>,
    /// Why it was refused.
    refused: Option<String>,
}

impl Said {
    fn decision(&self) -> Option<&DecisionReport> {
        self.spoken.iter().find_map(|spoken| match spoken {
            Spoken::Decision(report) => Some(&**report),
            Spoken::Line(_) => None,
        })
    }
}

/// Gives the session a picture and waits for its answer.
fn take(session: &mut Session, clock: &NodeClock, ready: &Ready, stop: &AtomicBool) -> Said {
    let events = match &ready.events {
        Ok(events) => events,
        Err(reason) => return Said { spoken: vec![Spoken::Line(reason.clone())], refused: Some(reason.clone()) },
    };
    let time_ns = clock.now_ns();
    let mut outputs: Vec<Output> = Vec::new();
    for input in events {
        outputs.extend(session.handle(&Event { time_ns, input: input.clone() }));
    }
    let is_answered = |output: &Output| matches!(output, Output::Answer { .. });
    let started = Instant::now();
    // What a picture lacks is said once its time is over.
    while !outputs.iter().any(is_answered) && started.elapsed() < PATIENCE && !is_asked(stop) {
        std::thread::sleep(TICK);
        outputs.extend(session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick }));
    }
    let refused = outputs.iter().find_map(|output| match output {
        Output::Answer { success: false, message, .. } => Some(message.clone()),
        _ => None,
    });
    Said { spoken: spoken(&outputs), refused }
}

/// Writes the answer to a touch: what was decided, or why it was refused.
fn answer(folder: &Folder, ready: &Ready, said: &Said) -> Result<()> {
    let json = match (said.decision(), &said.refused) {
        (Some(report), _) => serde_json::to_string_pretty(report),
        (None, Some(reason)) if ready.is_touch => serde_json::to_string_pretty(&json!({ "error": reason })),
        (None, _) => return Ok(()),
    };
    let json = json.map_err(|error| Error::invalid("decision", "numbers that JSON has", error.to_string()))?;
    folder.answer(&ready.path, &json)
}

//! A film of JPEGs and lines of commands.

use std::io::Read;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::event::{Event, Input, Output};
use crate::session::Session;
use crate::shell::{Spoken, TICK, is_asked, spoken};
use crate::sources::commands::{Command, Place};
use crate::sources::lines::Lines;
use crate::sources::mjpeg::Splitter;
use crate::sources::{NodeClock, picture};

/// Pictures that wait at most; more than that and new ones are left out.
const MAX_WAITING: usize = 32;

/// Bytes read at once.
const READ_BYTES: usize = 1 << 16;

/// Commands that cannot be read and follow one another within less are one flood, of which the first is said.
const FLOOD: Duration = Duration::from_secs(1);

/// From the readers to the session.
enum Arrived {
    Picture(Instant, Vec<u8>),
    Line(std::result::Result<Vec<u8>, String>),
    FilmEnds(String),
}

/// What the commands so far came to.
#[derive(Default)]
struct Commands {
    place: Place,
    n_calls: u64,
    /// When the latest one could not be read; `None` where it could.
    bad: Option<Instant>,
}

/// Runs until the film ends, `quit` is said, or a stop is asked for. `tell` gets what a person should see.
///
/// # Errors
/// A log that cannot be ended.
pub fn run(
    mut session: Session,
    film: impl Read + Send + 'static,
    commands: Lines,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    let clock = NodeClock::start();
    let (sender, receiver) = sync_channel(MAX_WAITING);
    let of_commands = sender.clone();
    std::thread::spawn(move || read_film(film, &sender));
    std::thread::spawn(move || commands.each(|line| of_commands.send(Arrived::Line(line)).is_ok()));
    let mut commands = Commands::default();
    session.handle(&Event { time_ns: clock.now_ns(), input: Input::Cameras(1) });
    let mut last_tick = Instant::now();
    while !is_asked(stop) {
        let (moment, inputs, end) = next(&receiver, &mut commands, tell);
        for input in inputs {
            let outputs = session.handle(&Event { time_ns: clock.at_ns(moment), input });
            pass_on(&outputs, &mut commands.place, tell);
        }
        if last_tick.elapsed() >= TICK {
            last_tick = Instant::now();
            let outputs = session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick });
            pass_on(&outputs, &mut commands.place, tell);
        }
        if let Some(end) = end {
            tell(Spoken::Line(end));
            break;
        }
    }
    session.finish()
}

/// The next moment with its inputs, and why it is the end, where it is.
fn next(
    receiver: &Receiver<Arrived>,
    commands: &mut Commands,
    tell: &mut dyn FnMut(Spoken),
) -> (Instant, Vec<Input>, Option<String>) {
    let (mut inputs, mut end, mut moment) = (Vec::new(), None, Instant::now());
    match receiver.recv_timeout(TICK) {
        Ok(Arrived::Picture(arrived, data)) => {
            inputs.push(picture(data));
            moment = arrived;
        }
        Ok(Arrived::Line(Ok(line))) => match commands.read(&line, moment) {
            Ok(Some(Command::Quit)) => end = Some("quit".to_owned()),
            Ok(command) => inputs = command.map(|command| commands.events(command)).unwrap_or_default(),
            Err(error) => tell(Spoken::Line(error.to_string())),
        },
        Ok(Arrived::Line(Err(reason))) => tell(Spoken::Line(format!("commands: {reason}"))),
        Ok(Arrived::FilmEnds(why)) => end = Some(why),
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => end = Some("film and commands have ended".to_owned()),
    }
    (moment, inputs, end)
}

impl Commands {
    /// The command in a line; `None` for one of a flood of lines that hold none.
    fn read(&mut self, line: &[u8], now: Instant) -> Result<Option<Command>> {
        match Command::read(line) {
            Ok(command) => {
                self.bad = None;
                Ok(Some(command))
            }
            Err(error) => {
                let before = self.bad.replace(now);
                let is_new = before.is_none_or(|before| now.saturating_duration_since(before) >= FLOOD);
                if is_new { Err(error) } else { Ok(None) }
            }
        }
    }

    fn events(&mut self, command: Command) -> Vec<Input> {
        self.n_calls += 1;
        self.place.events(command, self.n_calls)
    }
}

fn pass_on(outputs: &[Output], place: &mut Place, tell: &mut dyn FnMut(Spoken)) {
    let said = spoken(outputs);
    for output in outputs {
        if let Output::Answer { message, .. } = output {
            let line = Spoken::Line(message.clone());
            // A touch is said as its decision, and what went wrong, or was taken at rest, as an event.
            if !message.starts_with("touch") && !said.contains(&line) {
                tell(line);
            }
        }
    }
    for spoken in said {
        if let Spoken::Decision(report) = &spoken {
            place.asked(report.next);
        }
        tell(spoken);
    }
}

fn read_film(mut film: impl Read, sender: &SyncSender<Arrived>) {
    let mut splitter = Splitter::default();
    let mut bytes = vec![0; READ_BYTES];
    loop {
        let n_read = match film.read(&mut bytes) {
            Ok(0) => break,
            Ok(n_read) => n_read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(error) => return drop(sender.send(Arrived::FilmEnds(format!("the film cannot be read: {error}")))),
        };
        for data in splitter.push(&bytes[..n_read]) {
            // A session that is late must see the newest pictures, not the oldest: what does not fit is left out.
            if let Err(TrySendError::Disconnected(_)) = sender.try_send(Arrived::Picture(Instant::now(), data)) {
                return;
            }
        }
    }
    let skipped = splitter.n_skipped();
    let why = if skipped > 0 {
        format!("the film has ended; {skipped} bytes were no picture")
    } else {
        "the film has ended".into()
    };
    drop(sender.send(Arrived::FilmEnds(why)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Topic;
    use tactile_data::recording::ros::messages::{Text, to_cdr};

    fn said(outputs: &[Output]) -> Vec<Spoken> {
        let mut said = Vec::new();
        pass_on(outputs, &mut Place::default(), &mut |spoken| said.push(spoken));
        said
    }

    #[test]
    fn a_line_that_is_event_and_answer_is_said_once() {
        let line = "at rest: 160x120 pixels, the median of 9 pictures";
        let event = Output::Publish { topic: Topic::Events, cdr: to_cdr(&Text { data: line.into() }) };
        let answer = |success, message: &str| Output::Answer { id: 1, success, message: message.into() };
        assert_eq!(said(&[event, answer(true, line)]), [Spoken::Line(line.into())]);
        assert_eq!(said(&[answer(true, "the next touch is the first")]).len(), 1);
        assert_eq!(said(&[answer(false, "a touch is being observed")]).len(), 1);
        assert_eq!(said(&[answer(true, "touch 1: perhaps A")]).len(), 0);
    }

    #[test]
    fn of_a_flood_of_bad_commands_the_first_is_said_and_a_flood_after_a_good_one_again() {
        let (mut commands, start) = (Commands::default(), Instant::now());
        let mut at = |ms: u64, line: &[u8]| commands.read(line, start + Duration::from_millis(ms)).is_err();
        assert!(at(0, b"\xff\xfe"));
        assert!((1..5000).all(|i| !at(10 * i, b"noise") && !at(10 * i, b"\x80")));
        assert!(!at(50_000, b"rest") && at(50_001, b"noise"));
        // A person who mistypes twice is told twice.
        assert!(at(52_000, b"tuch"));
    }
}

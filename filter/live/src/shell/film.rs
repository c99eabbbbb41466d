//! A film of JPEGs and lines of commands.

use std::io::{BufRead, Read};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Instant;

use crate::error::Result;
use crate::event::{Event, Input, Output};
use crate::session::Session;
use crate::shell::{Spoken, TICK, is_asked, spoken};
use crate::sources::commands::{Command, Place};
use crate::sources::mjpeg::Splitter;
use crate::sources::{NodeClock, picture};

/// Pictures that wait at most; more than that and new ones are left out.
const MAX_WAITING: usize = 32;

/// Bytes read at once.
const READ_BYTES: usize = 1 << 16;

/// From the readers to the session.
enum Arrived {
    Picture(Instant, Vec<u8>),
    Line(String),
    FilmEnds(String),
}

/// Runs until the film ends, `quit` is said, or a stop is asked for. `tell` gets what a person should see.
///
/// # Errors
/// A log that cannot be ended.
pub fn run(
    mut session: Session,
    film: impl Read + Send + 'static,
    commands: impl BufRead + Send + 'static,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(Spoken),
) -> Result<()> {
    let clock = NodeClock::start();
    let (sender, receiver) = sync_channel(MAX_WAITING);
    let of_commands = sender.clone();
    std::thread::spawn(move || read_film(film, &sender));
    std::thread::spawn(move || read_commands(commands, &of_commands));
    let mut place = Place::default();
    let mut n_calls = 0;
    session.handle(&Event { time_ns: clock.now_ns(), input: Input::Cameras(1) });
    let mut last_tick = Instant::now();
    while !is_asked(stop) {
        let (moment, inputs, end) = next(&receiver, &mut place, &mut n_calls, tell);
        for input in inputs {
            let outputs = session.handle(&Event { time_ns: clock.at_ns(moment), input });
            pass_on(&outputs, &mut place, tell);
        }
        if last_tick.elapsed() >= TICK {
            last_tick = Instant::now();
            let outputs = session.handle(&Event { time_ns: clock.now_ns(), input: Input::Tick });
            pass_on(&outputs, &mut place, tell);
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
    place: &mut Place,
    n_calls: &mut u64,
    tell: &mut dyn FnMut(Spoken),
) -> (Instant, Vec<Input>, Option<String>) {
    let (mut inputs, mut end, mut moment) = (Vec::new(), None, Instant::now());
    match receiver.recv_timeout(TICK) {
        Ok(Arrived::Picture(arrived, data)) => {
            inputs.push(picture(data));
            moment = arrived;
        }
        Ok(Arrived::Line(line)) => match line.parse() {
            Ok(Command::Quit) => end = Some("quit".to_owned()),
            Ok(command) => {
                *n_calls += 1;
                inputs = place.events(command, *n_calls);
            }
            Err(error) => tell(Spoken::Line(error.to_string())),
        },
        Ok(Arrived::FilmEnds(why)) => end = Some(why),
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => end = Some("film and commands have ended".to_owned()),
    }
    (moment, inputs, end)
}

fn pass_on(outputs: &[Output], place: &mut Place, tell: &mut dyn FnMut(Spoken)) {
    for output in outputs {
        if let Output::Answer { success: true, message, .. } = output
            && !message.starts_with("touch")
        {
            tell(Spoken::Line(message.clone()));
        }
    }
    for spoken in spoken(outputs) {
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

fn read_commands(commands: impl BufRead, sender: &SyncSender<Arrived>) {
    for line in commands.lines() {
        let Ok(line) = line else { return };
        if !line.trim().is_empty() && sender.send(Arrived::Line(line)).is_err() {
            return;
        }
    }
}

//! What a person and a program see of a node: lines on one stream, decisions on another.

use std::io::{self, Write};

use tactile_data::text::printable::{printable, printable_json};

use crate::shell::Spoken;

/// Writes what a node says. A stream that cannot be written, because a pipe is closed or a disk is full, ends no node:
/// that is said once, and what comes later is tried again.
pub struct Speaker<Out, Lines> {
    out: Out,
    lines: Lines,
    is_json: bool,
    /// The latest decision could not be written.
    has_failed: bool,
}

impl Speaker<io::Stdout, io::Stderr> {
    /// Decisions go to the standard output, as JSON or as lines for a person, lines to the standard error.
    pub fn new(is_json: bool) -> Self {
        Self::of(io::stdout(), io::stderr(), is_json)
    }
}

impl<Out: Write, Lines: Write> Speaker<Out, Lines> {
    /// Decisions go to `out`, lines to `lines`.
    pub fn of(out: Out, lines: Lines, is_json: bool) -> Self {
        Self { out, lines, is_json, has_failed: false }
    }

    /// Writes what was said.
    pub fn tell(&mut self, spoken: &Spoken) {
        match spoken {
            Spoken::Line(line) => self.line(line),
            Spoken::Decision(report) if self.is_json => match serde_json::to_string(report) {
                Ok(json) => self.print(&printable_json(&json)),
                Err(error) => self.line(&format!("the decision of touch {} is no JSON: {error}", report.touch)),
            },
            Spoken::Decision(report) => self.print(&printable(&report.line())),
        }
    }

    /// Writes a line that programs read.
    pub fn print(&mut self, line: &str) {
        let written = writeln!(self.out, "{line}").and_then(|()| self.out.flush());
        let had_failed = std::mem::replace(&mut self.has_failed, written.is_err());
        if let Some(error) = written.err().filter(|_| !had_failed) {
            self.line(&format!("standard output: decisions cannot be written, the node goes on: {error}"));
        }
    }

    fn line(&mut self, line: &str) {
        // There is nowhere left to say that this failed.
        drop(writeln!(self.lines, "{}", printable(line)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{DecisionReport, EstimateReport, Motion};

    /// A pipe whose reader comes and goes.
    #[derive(Default)]
    struct Pipe {
        is_closed: bool,
        read: Vec<u8>,
    }

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.is_closed {
                return Err(io::ErrorKind::BrokenPipe.into());
            }
            self.read.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn decision(part: &str) -> Spoken {
        let estimate = EstimateReport {
            part: part.into(),
            probability: 0.5,
            runner_up: None,
            part_from_sensor: Motion::IDENTITY,
            covariance: [[0.0; 3]; 3],
            fit: None,
            none_probability: None,
            stranger_rate: None,
            entropy_nats: 0.5,
            warnings: Vec::new(),
        };
        let report = DecisionReport {
            episode: 1,
            touch: 1,
            moved: None,
            edge_share: 0.5,
            next: None,
            stop: None,
            estimate,
            posterior: Vec::new(),
        };
        Spoken::Decision(Box::new(report))
    }

    fn text(bytes: &[u8]) -> String {
        String::from_utf8(bytes.to_vec()).unwrap()
    }

    #[test]
    fn a_closed_pipe_is_said_once_and_the_rest_is_written_when_it_opens() {
        let mut speaker = Speaker::of(Pipe::default(), Vec::new(), false);
        speaker.out.is_closed = true;
        (0..3).for_each(|_| speaker.tell(&decision("A")));
        let said = text(&speaker.lines);
        assert!(
            said.starts_with("standard output: decisions cannot be written") && said.lines().count() == 1,
            "{said}"
        );
        speaker.out.is_closed = false;
        speaker.tell(&decision("B"));
        assert_eq!(text(&speaker.out.read), "touch 1: perhaps B, 50.0 %\n");
        speaker.out.is_closed = true;
        speaker.tell(&decision("A"));
        assert_eq!(text(&speaker.lines).lines().count(), 2);
        // A closed terminal has nobody to tell.
        let mut alone =
            Speaker::of(Pipe { is_closed: true, ..Pipe::default() }, Pipe { is_closed: true, ..Pipe::default() }, true);
        alone.tell(&decision("A"));
        alone.tell(&Spoken::Line("hello".into()));
    }

    #[test]
    fn no_control_character_of_a_name_reaches_a_terminal() {
        let name = "A\u{1b}[2J\u{9b}1m\u{7f}\n";
        for is_json in [false, true] {
            let mut speaker = Speaker::of(Vec::new(), Vec::new(), is_json);
            speaker.tell(&decision(name));
            speaker.tell(&Spoken::Line(name.into()));
            for written in [text(&speaker.out), text(&speaker.lines)] {
                assert!(!written.trim_end_matches('\n').contains(char::is_control), "{written:?}");
            }
            if is_json {
                let read: DecisionReport = serde_json::from_slice(&speaker.out).unwrap();
                assert_eq!(read.estimate.part, name);
            }
        }
    }
}

//! What a person or a program without ROS says to the node: a line each.

use std::str::FromStr;

use tactile_data::pose::se2::Se2;

use crate::error::{Error, Result};
use crate::event::{Input, Request};
use crate::sources::placed;

/// The commands, for a person.
pub const HELP: &str = "rest | touch [X_MM Y_MM DEG] | reset | quit";

/// A command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// The sensor touches nothing: take pictures of it at rest.
    Rest,
    /// The sensor touches: where, in a plane that does not move, or where the node asked for.
    Touch(Option<Se2>),
    /// The next touch is the first of another hole.
    Reset,
    /// The end.
    Quit,
}

/// What is shown of a line that holds no command.
const MAX_SHOWN: usize = 60;

impl Command {
    /// The command in a line of bytes.
    ///
    /// # Errors
    /// A line that holds none, or bytes that are no text.
    pub fn read(line: &[u8]) -> Result<Self> {
        let shown = || line.get(..MAX_SHOWN).unwrap_or(line).escape_ascii();
        let wrong = |_| Error::invalid("command", HELP, format!("bytes that are no text: {}", shown()));
        std::str::from_utf8(line).map_err(wrong)?.parse()
    }
}

impl FromStr for Command {
    type Err = Error;

    fn from_str(line: &str) -> Result<Self> {
        let shown = || line.trim().chars().take(MAX_SHOWN).collect::<String>();
        let wrong = || Error::invalid("command", HELP, format!("{:?}", shown()));
        let words: Vec<&str> = line.split([' ', ',', '\t']).map(str::trim).filter(|word| !word.is_empty()).collect();
        match words[..] {
            ["rest"] => Ok(Self::Rest),
            ["touch"] => Ok(Self::Touch(None)),
            ["touch", x, y, deg] => {
                let number = |word: &str| word.parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(wrong);
                Ok(Self::Touch(Some(Se2::from_degrees(number(x)?, number(y)?, number(deg)?))))
            }
            ["reset"] => Ok(Self::Reset),
            ["quit" | "exit"] => Ok(Self::Quit),
            _ => Err(wrong()),
        }
    }
}

/// Where the sensor is, for a robot that says nothing but "done".
#[derive(Clone, Copy, Debug)]
pub struct Place {
    plane_from_sensor: Se2,
    sensor_from_next: Option<Se2>,
}

impl Default for Place {
    fn default() -> Self {
        Self { plane_from_sensor: Se2::IDENTITY, sensor_from_next: None }
    }
}

impl Place {
    /// The node asks for a motion.
    pub fn asked(&mut self, sensor_from_next: Option<Se2>) {
        self.sensor_from_next = sensor_from_next;
    }

    /// The events of a command; `id` is the number of its answer. Nothing for [`Command::Quit`].
    pub fn events(&mut self, command: Command, id: u64) -> Vec<Input> {
        let called = |request| Input::Called { request, id };
        match command {
            Command::Rest => vec![called(Request::Calibrate)],
            Command::Reset => {
                self.sensor_from_next = None;
                vec![called(Request::Reset)]
            }
            Command::Touch(place) => {
                let moved = self.sensor_from_next.take().unwrap_or(Se2::IDENTITY);
                self.plane_from_sensor = place.unwrap_or(self.plane_from_sensor * moved);
                vec![placed(&self.plane_from_sensor), called(Request::Observe)]
            }
            Command::Quit => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_as_people_write_them() {
        let touch = Command::Touch(Some(Se2::from_degrees(1.5, -2.0, 30.0)));
        for line in ["touch 1.5 -2 30", " touch 1.5, -2, 30\r\n", "touch\t1.5\t-2\t30"] {
            assert_eq!(line.parse::<Command>().unwrap(), touch);
        }
        assert_eq!("rest\n".parse::<Command>().unwrap(), Command::Rest);
        for line in ["", "touch 1 2", "touch 1 2 nan", "Touch", "touch a b c"] {
            let error = line.parse::<Command>().unwrap_err().to_string();
            assert!(error.starts_with("command: expected rest | touch") && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_are_one_short_line() {
        let said = Command::read(b"to\xffuch\n").unwrap_err().to_string();
        assert!(said.ends_with(r"got bytes that are no text: to\xffuch\n") && !said.contains('\n'), "{said}");
        assert!(Command::read(&[0xff; 4000]).unwrap_err().to_string().len() < 400);
        assert!(Command::read(&[b'x'; 4000]).unwrap_err().to_string().len() < 200);
        assert_eq!(Command::read(b"touch 1 2 3").unwrap(), "touch 1 2 3".parse().unwrap());
    }

    #[test]
    fn a_touch_without_a_place_is_where_the_node_asked_for() {
        let mut place = Place::default();
        let start = Se2::from_degrees(5.0, 0.0, 90.0);
        place.events(Command::Touch(Some(start)), 1);
        place.asked(Some(Se2::from_degrees(2.0, 0.0, 0.0)));
        let events = place.events(Command::Touch(None), 2);
        assert_eq!(events[0], placed(&(start * Se2::from_degrees(2.0, 0.0, 0.0))));
        assert!(matches!(events[1], Input::Called { request: Request::Observe, id: 2 }));
        // Asked once, moved once.
        assert_eq!(place.events(Command::Touch(None), 3)[0], events[0]);
    }
}

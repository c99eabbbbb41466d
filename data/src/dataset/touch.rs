//! One touch: where, on what, by which side.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::pose::se2::Se2;
#[cfg(feature = "datasets")]
use crate::text::printable::is_printable;

/// How far maps of touches and of parts give distances to an outline, mm: the reach of a letter's stroke, and a third of what a
/// Mini shows.
pub const OUTLINE_REACH_MM: f64 = 3.0;

/// Which half of a mating pair was touched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The female half: a recess in a plate.
    #[default]
    Hole,
    /// The male half: a raised face.
    Peg,
}

impl Side {
    /// The names of both, as flags and files have them.
    pub const NAMES: [&str; 2] = ["hole", "peg"];

    /// Whether it is the hole: what is left out of files, as before pegs could be named.
    pub fn is_hole(&self) -> bool {
        *self == Self::Hole
    }
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Self::NAMES[usize::from(*self == Self::Peg)])
    }
}

impl FromStr for Side {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        let found = [Self::Hole, Self::Peg].into_iter().find(|side| side.to_string() == name);
        found.ok_or_else(|| Error::invalid("side", Self::NAMES.join(" or "), name))
    }
}

/// What there is where touches of a side are looked for and none is found, for an error: touches of the other side
/// alone, with what takes them (`other`), or none that can be used.
pub fn instead_of(side: Side, touches: &[Touch], other: &str) -> String {
    if touches.iter().any(|touch| touch.side == Some(side)) {
        return "none".into();
    }
    let n_other = touches.iter().filter(|touch| touch.side.is_some_and(|of| of != side)).count();
    let n_unknown = touches.iter().filter(|touch| touch.side.is_none()).count();
    let opposite = if side.is_hole() { Side::Peg } else { Side::Hole };
    match (n_other, n_unknown) {
        (0, 0) => "none".into(),
        (0, n) => format!("{n} touches of which the side is not known"),
        (n, _) => format!("{n} touches of {opposite}s ({other})"),
    }
}

/// What is known of one frame of a dataset: a line of its index.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    /// Name of the part (a letter, a board, a connector); `None` where nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Which half was touched; `None` for a frame of the sensor at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Where the sensor was on the part; `None` where nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_from_sensor: Option<Se2>,
    /// The motion actually made since the touch before, in the sensor's frame at that touch; `None`
    /// for a first touch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<Se2>,
    /// The mating pair that this touch is one of: the hole and the peg of one name were touched at one place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair: Option<String>,
    /// The episode that this touch is of: touches of one hole, in order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub episode: Option<String>,
    /// When the frame was taken, seconds on the recording's clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

impl Touch {
    /// Refuses names of part, pair and episode that would not be printed as they are.
    #[cfg(feature = "datasets")]
    pub(crate) fn check_names(&self) -> Result<(), Error> {
        for (field, name) in [("part", &self.part), ("pair", &self.pair), ("episode", &self.episode)] {
            if let Some(name) = name.as_ref().filter(|name| !is_printable(name)) {
                return Err(Error::invalid(field, "a name without control characters", format!("{name:?}")));
            }
        }
        Ok(())
    }
}

/// One touch to be simulated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// Number of the part in its scene.
    pub part: usize,
    /// What is touched of it.
    pub side: Side,
    /// Where the sensor is.
    pub part_from_sensor: Se2,
    /// Where the recording says that it is: the same, but in a simulated lab.
    pub stated: Se2,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_instead_of_a_side_is_named() {
        let touch = |side| Touch { side, ..Touch::default() };
        let pegs = [touch(Some(Side::Peg)), touch(Some(Side::Peg)), touch(None)];
        assert_eq!(
            instead_of(Side::Hole, &pegs, "take them with --side peg"),
            "2 touches of pegs (take them with --side peg)"
        );
        assert_eq!(instead_of(Side::Peg, &pegs[2..], ""), "1 touches of which the side is not known");
        assert_eq!(instead_of(Side::Hole, &[], ""), "none");
        // There are some, which cannot be used for another reason.
        assert_eq!(instead_of(Side::Peg, &pegs, ""), "none");
    }
}

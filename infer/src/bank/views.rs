//! What the views of a bank are of: pegs alone, as a robot can record them, or pegs and their holes, where a scene says
//! what a hole looks like.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// What each view of a bank is of.
///
/// The distance of a hole's embedding from its peg's is an error of the network that belongs to the view: the same
/// hole, touched there again under the same sensor, has the same distance. Where the hole can be simulated, the middle
/// of both keys is nearer to either side than one of them is to the other, as a prototype is the mean of what is known
/// of its class (Snell et al. 2017). The holes then are as the scene has them: its clearance, and no wear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Views {
    /// Views of the peg, as in the paper.
    #[default]
    Pegs,
    /// Views of the peg and of its hole: the middle of their keys.
    Both,
}

impl Views {
    /// The names of all.
    pub const NAMES: [&str; 2] = ["pegs", "both"];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// Whether they are of pegs alone.
    pub fn is_pegs(&self) -> bool {
        *self == Self::Pegs
    }
}

impl FromStr for Views {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = [Self::Pegs, Self::Both].into_iter().find(|views| views.name() == name);
        known.ok_or_else(|| Error::invalid("views", Self::NAMES.join(" or "), name))
    }
}

/// Moves keys of unit length, `[n, dim]`, to the middle between them and others; opposite ones stay.
#[cfg(feature = "sim")]
pub(crate) fn to_middle(keys: &mut [f32], others: &[f32]) {
    let sum: Vec<f32> = keys.iter().zip(others).map(|(key, other)| key + other).collect();
    let norm = crate::bank::similarity::dot(&sum, &sum).sqrt();
    if norm > f32::EPSILON {
        keys.iter_mut().zip(sum).for_each(|(key, sum)| *key = sum / norm);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_files() {
        for (views, name) in [Views::Pegs, Views::Both].into_iter().zip(Views::NAMES) {
            assert_eq!((views.name(), name.parse::<Views>().unwrap()), (name, views));
            assert_eq!(serde_json::to_string(&views).unwrap(), format!("\"{name}\""));
        }
        let error = "holes".parse::<Views>().unwrap_err().to_string();
        assert_eq!(error, "views: expected pegs or both, got holes");
    }

    #[cfg(feature = "sim")]
    #[test]
    fn the_middle_is_as_near_to_either_and_of_unit_length() {
        let (peg, hole) = ([0.6, 0.8, 0.0], [0.0, 0.8, -0.6]);
        let mut middle = peg;
        to_middle(&mut middle, &hole);
        let dot = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        assert!((dot(&middle, &middle) - 1.0).abs() < 1e-6);
        // Half the angle between the two, whose cosine is 0.64: cos(a / 2) = sqrt((1 + cos a) / 2).
        let half = ((1.0_f32 + 0.64) / 2.0).sqrt();
        assert!([peg, hole].iter().all(|side| (dot(&middle, side) - half).abs() < 1e-6));
        let mut opposite = peg;
        to_middle(&mut opposite, &peg.map(|value| -value));
        assert_eq!(opposite, peg);
    }
}

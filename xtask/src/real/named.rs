//! How episodes of real presses came out.

use std::fmt;

use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::json::{entries, number};

/// What the filter said at the end of one episode.
pub struct Named {
    /// The part that was pressed, where it is one of the bank's.
    truth: Option<String>,
    /// The likeliest part.
    part: String,
    probability: f64,
    /// Why it stopped; none where the presses ended first.
    stop: Option<String>,
    /// Whether the filter warned that no press looked like any view of the bank.
    is_warned: bool,
    n_touches: usize,
}

/// Episodes by how they came out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    n: usize,
    /// The likeliest part was the pressed one, sure or not.
    named_right: usize,
    confident_right: usize,
    confident_wrong: usize,
    none_of_these: usize,
    unsure: usize,
    /// The filter warned that no press looked like any view of the bank, however it came out.
    warned: usize,
    /// Episodes of parts that are not in the bank.
    strangers: usize,
}

impl Named {
    /// Reads a line of `tactile-filter replay --json`. Its truth is a part that was pressed; `stranger` is no part's name.
    pub fn read(line: &Value) -> Result<Self> {
        let text = |name: &str| line[name].as_str().map(str::to_owned);
        let part = text("part").ok_or_else(|| Error::invalid("replay", "the name of a part", line.to_string()))?;
        Ok(Self {
            truth: text("truth").filter(|truth| truth != STRANGER),
            part,
            probability: number(line, "/probability")?,
            stop: text("stop"),
            is_warned: !entries(line, "/warnings")?.is_empty(),
            n_touches: entries(line, "/frames")?.len(),
        })
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let Self { truth, part, probability, stop, is_warned, n_touches } = self;
        json!({
            "truth": truth, "part": part, "probability": probability, "stop": stop, "warned": is_warned,
            "n_touches": n_touches,
        })
    }
}

/// The part of a recording that no bank holds.
pub const STRANGER: &str = "stranger";

impl Counts {
    /// Counts episodes.
    pub fn of(named: &[Named]) -> Self {
        let mut counts = Self { n: named.len(), ..Self::default() };
        for Named { truth, part, stop, is_warned, .. } in named {
            let is_right = truth.as_ref() == Some(part);
            counts.warned += usize::from(*is_warned);
            counts.named_right += usize::from(is_right);
            counts.strangers += usize::from(truth.is_none());
            match stop.as_deref() {
                Some("confident") if is_right => counts.confident_right += 1,
                Some("confident") => counts.confident_wrong += 1,
                Some("none-of-these") => counts.none_of_these += 1,
                _ => counts.unsure += 1,
            }
        }
        counts
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({
            "n": self.n, "named_right": self.named_right, "confident_right": self.confident_right,
            "confident_wrong": self.confident_wrong, "none_of_these": self.none_of_these, "unsure": self.unsure,
            "warned": self.warned, "strangers": self.strangers,
        })
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n, named_right, confident_right, confident_wrong, none_of_these, unsure, warned, strangers } = self;
        if strangers < n {
            write!(f, "{named_right} of {} named right; ", n - strangers)?;
        }
        write!(
            f,
            "confident and right {confident_right}, confident and wrong {confident_wrong}, none of these \
             {none_of_these}, unsure {unsure}; unlike any view {warned}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_episode_counts_once_and_a_stranger_is_never_named_right() {
        let line = |truth: &str, part: &str, stop: Option<&str>| {
            let line = json!({ "truth": truth, "part": part, "probability": 0.9, "stop": stop, "frames": [0, 1], "warnings": [] });
            Named::read(&line).unwrap()
        };
        let named = [
            line("a", "a", Some("confident")),
            line("a", "b", Some("confident")),
            line("a", "a", None),
            line("a", "a", Some("touch-limit")),
            line("a", "b", Some("none-of-these")),
            line(STRANGER, "a", Some("confident")),
            line(STRANGER, "a", Some("none-of-these")),
        ];
        let expected = Counts {
            n: 7,
            named_right: 3,
            confident_right: 1,
            confident_wrong: 2,
            none_of_these: 2,
            unsure: 2,
            warned: 0,
            strangers: 2,
        };
        assert_eq!(Counts::of(&named), expected);
        assert!(expected.to_string().starts_with("3 of 5 named right; confident and right 1"));
        assert!(Named::read(&json!({ "probability": 1.0, "frames": [] })).is_err());
    }
}

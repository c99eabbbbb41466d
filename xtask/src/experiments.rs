//! What `cargo xtask reproduce` runs: `filter/eval/experiments.toml`.

use std::collections::BTreeMap;
use std::fs;

use clap::ValueEnum;
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::error::{Error, Result};
use crate::figures::table::Table;
use crate::workspace::Workspace;

/// A part that can be made on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Tables I and II, and informed against random touches.
    Tables,
    /// Table III.
    Connectors,
    /// Touches anywhere, at any angle.
    Anywhere,
    /// Letters searched in an area four times as large, at every angle.
    Wide,
    /// Fewer classes.
    Classes,
    /// A part that is not in the bank.
    Absent,
    /// The same anywhere with banks that know the holes, and with look-alikes; as the model comes and after ten touches.
    Strangers,
    /// Belief maps and assembly of M, L, T and F.
    Assembly,
    /// Scenes where one touch says as little as in the paper.
    Hard,
    /// Banks that know what the holes look like, not only the pegs.
    KnownHoles,
    /// Banks that know the holes and have maps of pegs and holes, with parts that are in them and strangers.
    Maps,
    /// Other lamps, gels, cameras, presses, and what does not belong to a part.
    Robust,
    /// The table of sensors, as it comes and calibrated, touched anywhere; and parts of other kinds.
    Sensors,
    /// Speed against accuracy.
    Tradeoff,
}

/// The file, relative to the workspace.
pub const FILE: &str = "filter/eval/experiments.toml";

/// The file's content; the file itself says what each entry is.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiments {
    words: BTreeMap<String, String>,
    pub whole: Amount,
    pub smoke: Amount,
    banks: Vec<Bank>,
    calibrations: Vec<Calibration>,
    pub evaluations: Vec<Evaluation>,
    pub sensors: Vec<Sensor>,
    pub models: Vec<Trained>,
    /// The documents' tables.
    pub tables: Vec<Table>,
    /// Curves of a picture that the page's program draws.
    #[serde(rename = "picture")]
    _picture: IgnoredAny,
    /// Sections of the page, which the page reads.
    #[serde(rename = "sections")]
    _sections: IgnoredAny,
}

/// How much of everything.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Amount {
    pub episodes: usize,
    pub fewer: usize,
    pub trials: usize,
    pub of_settings: usize,
    pub settings: Option<usize>,
    pub trains: bool,
}

/// A bank.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bank {
    pub name: String,
    pub scene: String,
    pub flags: Option<String>,
}

/// How a model is calibrated.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    pub name: String,
    pub scene: String,
    pub dataset: Option<String>,
    pub holes: String,
    pub bank: String,
    pub flags: String,
}

/// An evaluation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    pub part: Part,
    pub name: String,
    pub bank: String,
    pub scene: Option<String>,
    pub flags: String,
    pub calibration: Option<String>,
    #[serde(default)]
    pub episodes: Episodes,
}

/// Which number of episodes an evaluation has.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Episodes {
    #[default]
    All,
    Fewer,
}

/// A sensor.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    pub name: String,
    /// What the page calls it.
    #[serde(rename = "label")]
    _label: String,
    pub scene: String,
    pub real: Option<String>,
}

/// A model that is trained.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trained {
    pub name: String,
    pub data: String,
    #[serde(default)]
    pub flags: String,
}

impl Experiments {
    /// Reads the workspace's file.
    pub fn read(workspace: &Workspace) -> Result<Self> {
        let path = workspace.root.join(FILE);
        Self::parse(&fs::read_to_string(&path).map_err(Error::io(&path))?)
    }

    /// Parses the file's text, and checks that each name in it leads somewhere.
    pub fn parse(text: &str) -> Result<Self> {
        let read: Self = toml::from_str(text).map_err(|error| {
            let line = text[..error.span().map_or(0, |span| span.start)].lines().count();
            Error::invalid(format!("{FILE}:{line}"), "experiments", error.message())
        })?;
        let evaluations = read.evaluations.iter();
        let flags = evaluations.clone().map(|of| &of.flags).chain(read.banks.iter().filter_map(|of| of.flags.as_ref()));
        let flags = flags.chain(read.calibrations.iter().flat_map(|of| [&of.bank, &of.flags]));
        flags.into_iter().try_for_each(|flags| read.expand(flags).map(|_| ()))?;
        for evaluation in evaluations {
            read.bank(&evaluation.bank)?;
            evaluation.calibration.iter().try_for_each(|name| read.calibration(name).map(|_| ()))?;
        }
        Ok(read)
    }

    /// Words of a command line, those that begin with `$` written out.
    pub fn expand(&self, flags: &str) -> Result<String> {
        let word = |word: &str| match word.strip_prefix('$') {
            Some(name) => self.words.get(name).cloned().ok_or_else(|| unknown("a word", word)),
            None => Ok(word.into()),
        };
        Ok(flags.split_whitespace().map(word).collect::<Result<Vec<_>>>()?.join(" "))
    }

    /// The bank of this name.
    pub fn bank(&self, name: &str) -> Result<&Bank> {
        self.banks.iter().find(|bank| bank.name == name).ok_or_else(|| unknown("a bank", name))
    }

    /// The calibration of this name.
    pub fn calibration(&self, name: &str) -> Result<&Calibration> {
        self.calibrations.iter().find(|of| of.name == name).ok_or_else(|| unknown("a calibration", name))
    }

    /// The table of this name.
    pub fn table(&self, name: &str) -> Result<&Table> {
        self.tables.iter().find(|table| table.name == name).ok_or_else(|| unknown("a table", name))
    }

    /// The number of episodes of an evaluation.
    pub fn n_episodes(of: Episodes, amount: Amount) -> usize {
        match of {
            Episodes::All => amount.episodes,
            Episodes::Fewer => amount.fewer,
        }
    }
}

fn unknown(what: &str, got: &str) -> Error {
    Error::invalid(FILE, format!("{what} that is in it"), got)
}

#[cfg(test)]
impl Experiments {
    /// The project's own.
    pub fn of_the_project() -> Self {
        Self::parse(include_str!("../../filter/eval/experiments.toml")).unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_leads_nowhere_is_refused_where_it_is() {
        let text = include_str!("../../filter/eval/experiments.toml");
        for (from, to, expected) in [
            (r#"bank = "small-fine""#, r#"bank = "smal""#, "expected a bank that is in it, got smal"),
            (r#"flags = "$default"#, r#"flags = "$defalt"#, "expected a word that is in it, got $defalt"),
            (r#"calibration = "own""#, r#"calibration = "mine""#, "expected a calibration that is in it, got mine"),
        ] {
            let error = Experiments::parse(&text.replacen(from, to, 1)).unwrap_err().to_string();
            assert_eq!(error, format!("{FILE}: {expected}"));
        }
        let at = 1 + text.lines().position(|line| line.contains("name = \"large-4\"")).unwrap();
        let error = Experiments::parse(&text.replacen("name = \"large-4\"", "nam = \"large-4\"", 1)).unwrap_err();
        assert!(error.to_string().starts_with(&format!("{FILE}:{at}: ")), "{error}");
    }
}

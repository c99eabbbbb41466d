//! What the page shows: the sections that `experiments.toml` lists, which is also what `cargo xtask reproduce` runs.

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::page::curves::Marker;

/// The file's name in messages, and its text.
const FILE: (&str, &str) = ("filter/eval/experiments.toml", include_str!("../../experiments.toml"));

/// What of the file the page needs; the file says what each entry is.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Experiments {
    evaluations: Vec<Named>,
    /// The sensors, in the order of their table.
    pub sensors: Vec<Sensor>,
    /// The curves of README's picture.
    pub picture: Vec<Row>,
    /// The sections, in the order of the page.
    pub sections: Vec<Section>,
}

/// An evaluation.
#[derive(Clone, Debug, Deserialize)]
struct Named {
    name: String,
}

/// A sensor.
#[derive(Clone, Debug, Deserialize)]
pub struct Sensor {
    /// Its name in the names of folders.
    pub name: String,
    /// What the page calls it.
    pub label: String,
}

/// A section of the page.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Section {
    /// Its shape.
    pub kind: Kind,
    /// Its entry in the contents.
    pub short: String,
    /// Its heading.
    pub title: String,
    /// What is said below its figure.
    #[serde(default)]
    pub caption: String,
    /// Whether a table of the paper has one touch alone.
    #[serde(default)]
    pub one_touch: bool,
    /// Its evaluations.
    #[serde(default)]
    pub rows: Vec<Row>,
    /// Its tables, where it is a list.
    #[serde(default)]
    pub lists: Vec<List>,
}

/// The shape of a section, which is the file that makes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A table of the paper.
    Paper,
    /// Accuracy against touches.
    Classes,
    /// Informed against random touches.
    Informed,
    /// The assembly.
    Assembly,
    /// The gain over one touch.
    Hard,
    /// A row for each evaluation.
    List,
    /// Speed against accuracy.
    Speed,
    /// Every step.
    Steps,
}

/// A table with a row for each evaluation.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct List {
    /// Heads of what is said of a row.
    pub text: Vec<String>,
    /// Which of these leads to the evaluation's report.
    #[serde(default)]
    pub link: usize,
    /// The figures.
    pub columns: Vec<Column>,
    /// The evaluations.
    #[serde(default)]
    pub rows: Vec<Row>,
    /// Whether the rows are every sensor's.
    #[serde(default)]
    pub sensors: bool,
    /// The evaluation that the others are compared with.
    pub baseline: Option<String>,
    /// Figures that the line for a terminal has.
    #[serde(default)]
    pub summary: Vec<Figure>,
    /// What is said below the table.
    pub caption: String,
}

/// A column of a [`List`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Its head.
    pub head: String,
    /// Its figure.
    pub figure: Figure,
}

/// An evaluation on the page.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Its folder.
    pub of: String,
    /// What is said of it.
    #[serde(default)]
    pub text: Vec<String>,
    /// The same with all parts in the bank.
    pub known: Option<String>,
    /// Class of its curve's style.
    #[serde(default)]
    pub style: String,
    /// Mark of its curve.
    pub marker: Option<Marker>,
}

/// A figure of an evaluation's leading filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    /// Right parts after so many touches.
    Right(usize),
    /// Mean error of the place after the last touch, mm.
    Place,
    /// Mean error of the angle after the last touch, degrees.
    Angle,
    /// Episodes that stopped sure of a part.
    Sure,
    /// The same with its interval.
    SureWithin,
    /// Wrong of the episodes that stopped sure.
    Wrong,
    /// Episodes that ended as none of these.
    None,
    /// The same with its interval.
    NoneWithin,
    /// Episodes that ended as none of these where all parts are in the bank.
    KnownNone,
    /// Mean number of touches.
    Touches,
    /// Episodes.
    Episodes,
}

impl Experiments {
    /// The project's own.
    ///
    /// # Errors
    /// A file that says something else.
    pub fn read() -> Result<Self> {
        let (name, text) = FILE;
        toml::from_str(text).map_err(|error| Error::invalid(name, "experiments", error.message()))
    }

    /// The folders of the evaluations, in the order of the file; then those of the sensors.
    pub fn folders(&self) -> Vec<String> {
        let sensors = self.sensors.iter().flat_map(|sensor| super::way::folders(&sensor.name));
        self.evaluations.iter().map(|of| of.name.clone()).chain(sensors).collect()
    }

    /// The tables of the paper.
    pub fn papers(&self) -> impl Iterator<Item = &Section> {
        self.sections.iter().filter(|section| section.kind == Kind::Paper)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The section of this entry in the contents.
    pub fn section(short: &str) -> Section {
        Experiments::read().unwrap().sections.into_iter().find(|section| section.short == short).unwrap()
    }

    #[test]
    fn every_row_of_the_page_is_an_evaluation_that_is_run() {
        let experiments = Experiments::read().unwrap();
        let folders = experiments.folders();
        let lists = experiments.sections.iter().flat_map(|section| &section.lists);
        let rows = experiments
            .sections
            .iter()
            .flat_map(|section| &section.rows)
            .chain(lists.clone().flat_map(|list| &list.rows));
        let named = rows.chain(&experiments.picture).flat_map(|row| [Some(&row.of), row.known.as_ref()]);
        let named: Vec<&String> = named.chain(lists.map(|list| list.baseline.as_ref())).flatten().collect();
        assert!(named.len() > 60 && named.iter().all(|name| folders.contains(name)), "{named:?}");
    }
}

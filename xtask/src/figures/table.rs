//! A table of the documents: which figures are in it, and its Markdown.

use serde::Deserialize;

use super::file::{Figure, Figures};
use crate::error::{Error, Result};

/// A table; the experiments' file says what each entry is.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    pub name: String,
    /// The first commit whose figures it may have; without one it claims nothing of the code that made them.
    pub since: Option<String>,
    #[serde(default = "of_shipped")]
    pub is_of_shipped_model: bool,
    #[serde(default)]
    join: String,
    text: Vec<String>,
    columns: Vec<Column>,
    rows: Vec<Row>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    head: String,
    cell: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    text: Vec<String>,
    figure: Option<String>,
    #[serde(default)]
    of: Vec<String>,
    #[serde(default)]
    cells: Vec<String>,
}

/// A figure that a table has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selected {
    /// The evaluation.
    pub evaluation: String,
    /// The way of naming the part.
    pub way: String,
    /// The figure.
    pub figure: String,
}

fn of_shipped() -> bool {
    true
}

/// A value as tables show it.
pub fn shown(value: f64) -> String {
    format!("{value:.1}")
}

impl Table {
    /// Every figure that it has.
    pub fn selected(&self) -> Result<Vec<Selected>> {
        let mut all = Vec::new();
        let mut select = |selected| {
            all.push(selected);
            Ok(String::new())
        };
        for row in &self.rows {
            self.cells(row, &mut select)?;
        }
        Ok(all)
    }

    /// Its lines.
    pub fn markdown(&self, figures: &Figures) -> Result<Vec<String>> {
        let mut show = |selected: Selected| {
            let Selected { evaluation, way, figure } = &selected;
            let found = figures.evaluations.get(evaluation).and_then(|of| of.ways.get(way)?.get(figure));
            let what = || format!("{}: {evaluation}: {way}: {figure}", super::FILE);
            let Figure { value, .. } = found.ok_or_else(|| Error::invalid(what(), "a figure", "none"))?;
            Ok(value.map_or("–".into(), shown))
        };
        let heads = self.columns.iter().map(|column| column.head.clone());
        let heads: Vec<String> = self.text.iter().cloned().chain(heads).collect();
        let mut lines = vec![line(&heads), format!("|{}", "---|".repeat(heads.len()))];
        for row in &self.rows {
            lines.push(line(&[row.text.clone(), self.cells(row, &mut show)?].concat()));
        }
        Ok(lines)
    }

    fn cells(&self, row: &Row, figure: &mut dyn FnMut(Selected) -> Result<String>) -> Result<Vec<String>> {
        if !row.cells.is_empty() {
            return Ok(row.cells.clone());
        }
        self.columns.iter().map(|column| self.cell(&column.cell, row, figure)).collect()
    }

    /// A cell: of the evaluations that its places number, or else of each evaluation of the row, joined.
    fn cell(&self, cell: &str, row: &Row, figure: &mut dyn FnMut(Selected) -> Result<String>) -> Result<String> {
        if places(cell).any(|place| numbered(place).is_some()) {
            let cell = row.figure.as_ref().map_or(cell.to_owned(), |of_row| cell.replace('}', &format!(" {of_row}}}")));
            return Ok(fill(&cell, &row.of, figure)?.unwrap_or_default());
        }
        let each = row.of.chunks(1).map(|of| fill(cell, of, figure));
        Ok(each.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect::<Vec<_>>().join(&self.join))
    }
}

/// What is between braces.
fn places(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('{').skip(1).filter_map(|rest| rest.split('}').next())
}

/// A place that begins with the number of an evaluation of the row, and the figure after it.
fn numbered(place: &str) -> Option<(usize, &str)> {
    let (number, figure) = place.split_once(' ').unwrap_or((place, ""));
    Some((number.parse().ok()?, figure))
}

/// A cell with its figures in place; nothing where an evaluation is not there.
fn fill(cell: &str, of: &[String], figure: &mut dyn FnMut(Selected) -> Result<String>) -> Result<Option<String>> {
    let mut filled = cell.to_owned();
    for place in places(cell) {
        let (at, name) = numbered(place).unwrap_or((0, place));
        let Some(of) = of.get(at).filter(|of| !of.is_empty()) else { return Ok(None) };
        let (evaluation, way) = of.split_once(' ').unwrap_or((of, "information"));
        let selected = Selected { evaluation: evaluation.into(), way: way.into(), figure: name.into() };
        filled = filled.replacen(&format!("{{{place}}}"), &figure(selected)?, 1);
    }
    Ok(Some(filled))
}

fn line(cells: &[String]) -> String {
    let cells = cells.iter().map(|cell| if cell.is_empty() { " |".to_owned() } else { format!(" {cell} |") });
    format!("|{}", cells.collect::<String>())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::Evaluated;
    use super::*;
    use crate::code::Code;
    use std::collections::BTreeMap;

    /// Figures of two evaluations.
    pub fn figures(code: &Code) -> Figures {
        let evaluation = |right: f64| {
            let figure = |value| Figure { value: Some(value), ci95: None };
            let way = BTreeMap::from([
                ("right 1".to_owned(), figure(right)),
                ("touches".into(), figure(3.0)),
                ("wrong".into(), Figure { value: None, ci95: None }),
            ]);
            let ways = BTreeMap::from([("information".to_owned(), way.clone()), ("random".into(), way)]);
            let (checksum, model) = ("c".into(), "m".into());
            Evaluated { n_episodes: 500, checksum, model, code: code.clone(), ways }
        };
        Figures::new(BTreeMap::from([("small".to_owned(), evaluation(88.4)), ("large".into(), evaluation(100.0))]))
    }

    /// A table of them.
    pub fn table() -> Table {
        let text = r#"
            name = "reach"
            since = "bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb"
            join = "; "
            text = ["parts"]
            columns = [
                { head = "1", cell = "{right 1}" },
                { head = "of two", cell = "{0 touches}, {1 wrong}" },
            ]
            rows = [
                { text = ["both"], of = ["small", "large random"] },
                { text = ["one"], of = ["small", ""] },
                { text = ["*the paper*"], cells = ["*39.6*", ""] },
            ]
        "#;
        toml::from_str(text).unwrap()
    }

    #[test]
    fn a_cell_joins_its_evaluations_or_numbers_them_and_is_empty_where_one_is_missing() {
        let lines = table().markdown(&figures(&Code::unknown("none"))).unwrap();
        let expected = [
            "| parts | 1 | of two |",
            "|---|---|---|",
            "| both | 88.4; 100.0 | 3.0, – |",
            "| one | 88.4 | |",
            "| *the paper* | *39.6* | |",
        ];
        assert_eq!(lines, expected);
    }

    #[test]
    fn what_is_selected_is_what_is_shown_and_a_missing_figure_is_named() {
        let all: Vec<_> = table().selected().unwrap().into_iter().map(|s| (s.evaluation, s.way, s.figure)).collect();
        let of = |evaluation: &str, way: &str, figure: &str| (evaluation.into(), way.into(), figure.into());
        assert_eq!(all[..2], [of("small", "information", "right 1"), of("large", "random", "right 1")]);
        assert_eq!(all[2..4], [of("small", "information", "touches"), of("large", "random", "wrong")]);
        let mut figures = figures(&Code::unknown("none"));
        figures.evaluations.remove("large");
        let error = table().markdown(&figures).unwrap_err().to_string();
        assert_eq!(error, "filter/eval/figures.json: large: random: right 1: expected a figure, got none");
    }
}

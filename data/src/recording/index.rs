//! The index of a recording: what is known of each of its pictures, as CSV or JSON lines.

use std::fmt::{self, Display, Formatter};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Deserializer};
use serde_json::{Map, Number, Value};

use crate::dataset::touch::{Side, Touch};
use crate::error::{Error, Result};
use crate::pose::se2::Se2;
use crate::recording::spreadsheet::text_of;
use crate::text::suggest::with_closest;

/// Columns of an index; all are optional but `file`.
pub const COLUMNS: [&str; 12] = [
    "file",
    "part",
    "side",
    "x_mm",
    "y_mm",
    "theta_deg",
    "moved_x_mm",
    "moved_y_mm",
    "moved_theta_deg",
    "pair",
    "episode",
    "time_s",
];

/// The columns that hold text; the others hold numbers.
pub const TEXT: [&str; 5] = ["file", "part", "side", "pair", "episode"];

/// No robot reaches further, mm.
const FARTHEST_MM: f64 = 10_000.0;

/// Ten turns, degrees.
const MOST_TURNED_DEG: f64 = 3_600.0;

/// More than 300 years, seconds: what is above was milliseconds or nanoseconds.
const LATEST_S: f64 = 1e10;

/// One row of an index or of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Where it is.
    pub place: Place,
    /// The picture, its folder in front; `None` where the row itself holds the picture.
    pub file: Option<PathBuf>,
    /// What is known of it.
    pub touch: Touch,
}

/// Where a row is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The index or the table.
    pub file: Arc<Path>,
    /// What is counted: "line" of a text, "row" of a table.
    pub unit: &'static str,
    /// The line in which the row begins, or the row, from 1.
    pub number: u64,
}

impl Display for Place {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        write!(f, "{} {} {}", self.file.display(), self.unit, self.number)
    }
}

impl Place {
    /// The place as a text about `file` names it: without the file where it is that one.
    pub fn in_text_about(&self, file: &Path) -> String {
        if *self.file == *file { format!("{} {}", self.unit, self.number) } else { self.to_string() }
    }
}

/// What a row says, before it is checked. A cell that is empty or not there says nothing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Cells {
    #[serde(default, deserialize_with = "text")]
    file: Option<String>,
    #[serde(default, deserialize_with = "text")]
    part: Option<String>,
    #[serde(default, deserialize_with = "text")]
    side: Option<String>,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    theta_deg: Option<f64>,
    moved_x_mm: Option<f64>,
    moved_y_mm: Option<f64>,
    moved_theta_deg: Option<f64>,
    #[serde(default, deserialize_with = "text")]
    pair: Option<String>,
    #[serde(default, deserialize_with = "text")]
    episode: Option<String>,
    time_s: Option<f64>,
}

/// A name, which JSON may also hold as a number.
fn text<'a, D: Deserializer<'a>>(json: D) -> std::result::Result<Option<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Name {
        Text(String),
        Number(i64),
    }
    let text = Option::<Name>::deserialize(json)?.map(|name| match name {
        Name::Text(text) => text.trim().to_owned(),
        Name::Number(number) => number.to_string(),
    });
    Ok(text.filter(|text| !text.is_empty()))
}

/// The rows of the index that `bytes` hold; `index` names it in errors, its files are relative to `folder`.
///
/// JSON lines where the first letter is `{`, else CSV with a header. CSV is parted by the comma, semicolon or tab of
/// which its header holds most; with semicolons a number may have a decimal comma. The apostrophe in front of a name that a
/// spreadsheet would run ([`crate::recording::spreadsheet`]) is no part of it.
///
/// # Errors
/// The row, its line and the cell: an unknown column, a value that is no pose, side or time, a file that is not there.
pub fn read(index: &Path, bytes: &[u8], folder: &Path) -> Result<Vec<Row>> {
    let text = as_text(index, bytes)?;
    let rows = if text.trim_start().starts_with('{') { json_rows(text, index)? } else { csv_rows(text, index)? };
    if rows.is_empty() {
        return Err(Error::invalid(index.display().to_string(), "at least one row that names a file", "none"));
    }
    let index: Arc<Path> = index.into();
    let row = |(number, mut cells): (u64, Cells)| {
        let place = Place { file: Arc::clone(&index), unit: "line", number };
        let named = cells.file.take();
        check_name("file", named.as_deref(), &place)?;
        let touch = touch(cells, &place)?;
        let Some(named) = named else {
            return Err(Error::invalid(place.to_string(), "the name of a file", "none"));
        };
        let file = Some(existing(&named, folder, &place)?);
        Ok(Row { place, file, touch })
    };
    rows.into_iter().map(row).collect()
}

/// What the cells of a table's row say; a column that is not there, or null, says nothing.
///
/// # Errors
/// The row's place and the cell: a value that is no pose, side or time.
pub fn touch_of(cells: Map<String, Value>, place: &Place) -> Result<Touch> {
    let cells = serde_json::from_value(Value::Object(cells));
    touch(cells.map_err(|error| bad_row(place.to_string(), error))?, place)
}

fn line_place(index: &Path, number: u64) -> String {
    Place { file: index.into(), unit: "line", number }.to_string()
}

fn as_text<'a>(index: &Path, bytes: &'a [u8]) -> Result<&'a str> {
    let what = || index.display().to_string();
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(Error::invalid(what(), "text in UTF-8", "UTF-16 (a spreadsheet saves it as CSV UTF-8)"));
    }
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let number = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        Error::invalid(line_place(index, number as u64), "text in UTF-8", "bytes of another encoding")
    })?;
    Ok(text.trim_start_matches('\u{feff}'))
}

fn touch(cells: Cells, place: &Place) -> Result<Touch> {
    let names = [("part", &cells.part), ("pair", &cells.pair), ("episode", &cells.episode)];
    for (column, name) in names {
        check_name(column, name.as_deref(), place)?;
    }
    let side = cells.side.as_deref().map(|name| {
        let other =
            |_| Error::invalid(format!("{place}: side"), Side::NAMES.join(" or "), name.escape_debug().to_string());
        name.parse().map_err(other)
    });
    let side = side.transpose()?;
    if let Some(time_s) = cells.time_s.filter(|time_s| !(time_s.is_finite() && time_s.abs() <= LATEST_S)) {
        let expected = format!("seconds, at most {LATEST_S} from zero");
        return Err(Error::invalid(format!("{place}: time_s"), expected, format!("{time_s:?}")));
    }
    Ok(Touch {
        part_from_sensor: pose(place, "x_mm, y_mm, theta_deg", [cells.x_mm, cells.y_mm, cells.theta_deg])?,
        moved: pose(place, "moved_*", [cells.moved_x_mm, cells.moved_y_mm, cells.moved_theta_deg])?,
        part: cells.part,
        side,
        pair: cells.pair,
        episode: cells.episode,
        time_s: cells.time_s,
    })
}

/// A quote that is never closed takes in all rows after it.
fn check_name(column: &str, name: Option<&str>, place: &Place) -> Result<()> {
    let Some(name) = name.filter(|name| name.chars().any(char::is_control)) else { return Ok(()) };
    let got: String = format!("{name:?} (a quote that is not closed?)").chars().take(80).collect();
    Err(Error::invalid(format!("{place}: {column}"), "a name on one line", got))
}

/// The file that a row names.
fn existing(named: &str, folder: &Path, place: &Place) -> Result<PathBuf> {
    let file = plain(&folder.join(named));
    if file.is_file() {
        return Ok(file);
    }
    // Written on Windows.
    let with_slashes = plain(&folder.join(named.replace('\\', "/")));
    if with_slashes.is_file() {
        return Ok(with_slashes);
    }
    Err(Error::invalid(place.to_string(), format!("the file {}", file.display()), "no such file"))
}

/// A path without `.`, and without `..` after a folder: a file then has one name.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir if matches!(plain.components().next_back(), Some(Component::Normal(_))) => {
                plain.pop();
            }
            other => plain.push(other),
        }
    }
    plain
}

fn pose(place: &Place, columns: &str, values: [Option<f64>; 3]) -> Result<Option<Se2>> {
    match values {
        [None, None, None] => Ok(None),
        [Some(x_mm), Some(y_mm), Some(theta_deg)] => {
            // A comparison with NaN is false.
            let is_near = x_mm.abs() <= FARTHEST_MM && y_mm.abs() <= FARTHEST_MM && theta_deg.abs() <= MOST_TURNED_DEG;
            if !is_near {
                let expected = format!("at most {FARTHEST_MM} mm and {MOST_TURNED_DEG} degrees from zero");
                let got = format!("{x_mm:?}, {y_mm:?}, {theta_deg:?}");
                return Err(Error::invalid(format!("{place}: {columns}"), expected, got));
            }
            Ok(Some(Se2::from_degrees(x_mm, y_mm, theta_deg)))
        }
        _ => Err(Error::invalid(format!("{place}: {columns}"), "all three numbers or none", "some of them")),
    }
}

/// Rows of JSON lines, each with its line's number.
fn json_rows(text: &str, index: &Path) -> Result<Vec<(u64, Cells)>> {
    let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let row = |(number, line): (u64, &str)| match serde_json::from_str(line) {
        Ok(row) => Ok((number, row)),
        // The line that serde_json names is the only one that it was given.
        Err(error) => Err(bad_row(line_place(index, number), error.to_string().replace("line 1 ", ""))),
    };
    lines.map(row).collect()
}

/// Rows of a CSV file with a header, each with its line's number.
fn csv_rows(text: &str, index: &Path) -> Result<Vec<(u64, Cells)>> {
    // Excel's own way to name the separator.
    let (separator, text, skipped) = match text.strip_prefix("sep=").and_then(|rest| rest.split_once('\n')) {
        Some((separator, rest)) => (separator.as_bytes().first().copied().unwrap_or(b','), rest, 1),
        None => (separator(text), text, 0),
    };
    let mut reader = csv::ReaderBuilder::new().delimiter(separator).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| bad_row(line_place(index, 1), error))?.clone();
    check_header(&header, &line_place(index, 1 + skipped))?;
    let mut rows = Vec::new();
    let mut lines = Lines { text: text.as_bytes(), at: 0, line: 1 + skipped };
    for record in reader.records() {
        let mut line_of = |position: Option<&csv::Position>| lines.line_of(position);
        let record = record.map_err(|error| match error.kind() {
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => bad_row(
                line_place(index, line_of(error.position())),
                format!("{len} cells under {expected_len} columns"),
            ),
            _ => bad_row(line_place(index, line_of(error.position())), &error),
        })?;
        let number = line_of(record.position());
        let mut cells = Map::new();
        for (column, cell) in header.iter().zip(&record).filter(|(_, cell)| !cell.is_empty()) {
            cells.insert(column.to_owned(), value(column, cell, separator == b';', &line_place(index, number))?);
        }
        let cells =
            serde_json::from_value(Value::Object(cells)).map_err(|error| bad_row(line_place(index, number), error))?;
        rows.push((number, cells));
    }
    Ok(rows)
}

/// Counts lines: the reader's own count is one too low after a carriage return.
struct Lines<'a> {
    text: &'a [u8],
    at: usize,
    line: u64,
}

impl Lines<'_> {
    /// The line in which the record at a position begins; positions come in order.
    fn line_of(&mut self, position: Option<&csv::Position>) -> u64 {
        let begin = position.map_or(self.at, |position| usize::try_from(position.byte()).unwrap_or(usize::MAX));
        while let Some(byte) = self.text.get(self.at).filter(|b| self.at < begin || matches!(b, b'\r' | b'\n')) {
            self.line += u64::from(*byte == b'\n');
            self.at += 1;
        }
        self.line
    }
}

/// The character between the cells of a CSV file: comma, semicolon or tab, whichever its header has most often.
fn separator(text: &str) -> u8 {
    let header = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let mut is_quoted = false;
    let mut counts = [(b',', 0), (b';', 0), (b'\t', 0)];
    for byte in header.bytes() {
        is_quoted ^= byte == b'"';
        counts.iter_mut().filter(|(separator, _)| *separator == byte && !is_quoted).for_each(|(_, n)| *n += 1);
    }
    // The first of equal ones.
    counts.into_iter().rev().max_by_key(|(_, n)| *n).map_or(b',', |(separator, _)| separator)
}

fn check_header(header: &csv::StringRecord, place: &str) -> Result<()> {
    if let Some(unknown) = header.iter().find(|column| !COLUMNS.contains(column)) {
        return Err(Error::invalid(place, COLUMNS.join(", "), with_closest(unknown, COLUMNS)));
    }
    if let Some((_, twice)) =
        header.iter().enumerate().find(|(at, column)| header.iter().take(*at).any(|c| c == *column))
    {
        return Err(Error::invalid(place, "each column once", format!("{twice} twice")));
    }
    if header.iter().all(|column| column != "file") {
        let got = if header.is_empty() { "none".to_owned() } else { header.iter().collect::<Vec<_>>().join(", ") };
        return Err(Error::invalid(place, "a column file", got));
    }
    Ok(())
}

/// What a cell that is not empty says.
fn value(column: &str, cell: &str, has_decimal_comma: bool, place: &str) -> Result<Value> {
    if TEXT.contains(&column) {
        // A file is named as it is.
        return Ok(Value::String(if column == "file" { cell } else { text_of(cell) }.to_owned()));
    }
    let is_comma = has_decimal_comma && cell.matches(',').count() == 1 && !cell.contains('.');
    let number = if is_comma { cell.replace(',', ".").parse() } else { cell.parse::<f64>() };
    let number = number.ok().and_then(Number::from_f64).map(Value::Number);
    number.ok_or_else(|| Error::invalid(format!("{place}: {column}"), "a number", cell))
}

fn bad_row(place: String, error: impl Display) -> Error {
    // A reason may quote a cell of several lines.
    Error::invalid(place, "a row of an index", error.to_string().replace(['\n', '\r'], " "))
}

#[cfg(test)]
#[path = "index_tests.rs"]
mod tests;

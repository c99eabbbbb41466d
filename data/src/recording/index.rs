//! The index of a recording: what is known of each of its pictures, as CSV or JSON lines.

use std::fmt::Display;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Deserializer};
use serde_json::{Map, Number, Value};

use crate::error::{Error, Result};
use crate::se2::Se2;
use crate::suggest::with_closest;
use crate::touch::{Side, Touch};

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
const TEXT: [&str; 5] = ["file", "part", "side", "pair", "episode"];

/// No robot reaches further, mm.
const FARTHEST_MM: f64 = 10_000.0;

/// Ten turns, degrees.
const MOST_TURNED_DEG: f64 = 3_600.0;

/// More than 300 years, seconds: what is above was milliseconds or nanoseconds.
const LATEST_S: f64 = 1e10;

/// One row of an index.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The line it begins in, from 1.
    pub line: u64,
    /// The picture, its folder in front.
    pub file: PathBuf,
    /// What is known of it.
    pub touch: Touch,
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
/// which its header holds most; with semicolons a number may have a decimal comma.
///
/// # Errors
/// The row, its line and the cell: an unknown column, a value that is no pose, side or time, a file that is not there.
pub fn read(index: &Path, bytes: &[u8], folder: &Path) -> Result<Vec<Row>> {
    let text = as_text(index, bytes)?;
    let rows = if text.trim_start().starts_with('{') { json_rows(text, index)? } else { csv_rows(text, index)? };
    if rows.is_empty() {
        return Err(Error::invalid(index.display().to_string(), "at least one row that names a file", "none"));
    }
    rows.into_iter().map(|(line, cells)| row(line, cells, &place(index, line), folder)).collect()
}

/// The place of a row, for errors.
pub fn place(index: &Path, line: u64) -> String {
    format!("{} line {line}", index.display())
}

fn as_text<'a>(index: &Path, bytes: &'a [u8]) -> Result<&'a str> {
    let what = || index.display().to_string();
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(Error::invalid(what(), "text in UTF-8", "UTF-16 (a spreadsheet saves it as CSV UTF-8)"));
    }
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        Error::invalid(place(index, line as u64), "text in UTF-8", "bytes of another encoding")
    })?;
    Ok(text.trim_start_matches('\u{feff}'))
}

fn row(line: u64, cells: Cells, place: &str, folder: &Path) -> Result<Row> {
    let names = [("file", &cells.file), ("part", &cells.part), ("pair", &cells.pair), ("episode", &cells.episode)];
    for (column, name) in names {
        // A quote that is never closed takes in all rows after it.
        if name.as_ref().is_some_and(|name| name.chars().any(char::is_control)) {
            let got = format!("{:?} (a quote that is not closed?)", name.as_deref().unwrap_or_default());
            let got: String = got.chars().take(80).collect();
            return Err(Error::invalid(format!("{place}: {column}"), "a name on one line", got));
        }
    }
    let Some(named) = cells.file else { return Err(Error::invalid(place, "the name of a file", "none")) };
    let side = match cells.side.as_deref() {
        None => None,
        Some("hole") => Some(Side::Hole),
        Some("peg") => Some(Side::Peg),
        Some(other) => {
            return Err(Error::invalid(format!("{place}: side"), "hole or peg", other.escape_debug().to_string()));
        }
    };
    if let Some(time_s) = cells.time_s.filter(|time_s| !(time_s.is_finite() && time_s.abs() <= LATEST_S)) {
        let expected = format!("seconds, at most {LATEST_S} from zero");
        return Err(Error::invalid(format!("{place}: time_s"), expected, time_s.to_string()));
    }
    let touch = Touch {
        part_from_sensor: pose(place, "x_mm, y_mm, theta_deg", [cells.x_mm, cells.y_mm, cells.theta_deg])?,
        moved: pose(place, "moved_*", [cells.moved_x_mm, cells.moved_y_mm, cells.moved_theta_deg])?,
        part: cells.part,
        side,
        pair: cells.pair,
        episode: cells.episode,
        time_s: cells.time_s,
    };
    let mut file = plain(&folder.join(&named));
    if !file.is_file() {
        // Written on Windows.
        let with_slashes = plain(&folder.join(named.replace('\\', "/")));
        if !with_slashes.is_file() {
            return Err(Error::invalid(place, format!("the file {}", file.display()), "no such file"));
        }
        file = with_slashes;
    }
    Ok(Row { line, file, touch })
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

fn pose(place: &str, columns: &str, values: [Option<f64>; 3]) -> Result<Option<Se2>> {
    match values {
        [None, None, None] => Ok(None),
        [Some(x_mm), Some(y_mm), Some(theta_deg)] => {
            // A comparison with NaN is false.
            let is_near = x_mm.abs() <= FARTHEST_MM && y_mm.abs() <= FARTHEST_MM && theta_deg.abs() <= MOST_TURNED_DEG;
            if !is_near {
                let expected = format!("at most {FARTHEST_MM} mm and {MOST_TURNED_DEG} degrees from zero");
                let got = format!("{x_mm}, {y_mm}, {theta_deg}");
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
        Err(error) => Err(bad_row(index, number, error.to_string().replace("line 1 ", ""))),
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
    let header = reader.headers().map_err(|error| bad_row(index, 1, error))?.clone();
    check_header(&header, &place(index, 1 + skipped))?;
    let mut rows = Vec::new();
    let mut lines = Lines { text: text.as_bytes(), at: 0, line: 1 + skipped };
    for record in reader.records() {
        let mut line = |position: Option<&csv::Position>| lines.line_of(position);
        let record = record.map_err(|error| match error.kind() {
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                bad_row(index, line(error.position()), format!("{len} cells under {expected_len} columns"))
            }
            _ => bad_row(index, line(error.position()), &error),
        })?;
        let number = line(record.position());
        let mut cells = Map::new();
        for (column, cell) in header.iter().zip(&record).filter(|(_, cell)| !cell.is_empty()) {
            cells.insert(column.to_owned(), value(column, cell, separator == b';', &place(index, number))?);
        }
        let cells = serde_json::from_value(Value::Object(cells)).map_err(|error| bad_row(index, number, error))?;
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

/// What parts the cells of a CSV file: the one of comma, semicolon and tab of which its header has most.
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
        return Err(Error::invalid(place, "a column file", header.iter().collect::<Vec<_>>().join(", ")));
    }
    Ok(())
}

/// What a cell that is not empty says.
fn value(column: &str, cell: &str, has_decimal_comma: bool, place: &str) -> Result<Value> {
    if TEXT.contains(&column) {
        return Ok(Value::String(cell.to_owned()));
    }
    let is_comma = has_decimal_comma && cell.matches(',').count() == 1 && !cell.contains('.');
    let number = if is_comma { cell.replace(',', ".").parse() } else { cell.parse::<f64>() };
    let number = number.ok().and_then(Number::from_f64).map(Value::Number);
    number.ok_or_else(|| Error::invalid(format!("{place}: {column}"), "a number", cell))
}

fn bad_row(index: &Path, line: u64, error: impl Display) -> Error {
    // A reason may quote a cell of several lines.
    Error::invalid(place(index, line), "a row of an index", error.to_string().replace(['\n', '\r'], " "))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with the pictures that the tests name; their content is not looked at.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("A/hole")).unwrap();
        for file in ["1.png", "2.png", "a, b.png", "A/hole/3.png"] {
            std::fs::write(folder.path().join(file), "").unwrap();
        }
        folder
    }

    fn rows(bytes: &[u8]) -> Result<Vec<Row>> {
        let folder = folder();
        let rows = read(Path::new("index.csv"), bytes, folder.path())?;
        let relative = |row: Row| Row { file: row.file.strip_prefix(folder.path()).unwrap().to_path_buf(), ..row };
        Ok(rows.into_iter().map(relative).collect())
    }

    fn refusal(bytes: &[u8]) -> String {
        let message = rows(bytes).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn commas_semicolons_tabs_and_json_lines_say_the_same() {
        let header = COLUMNS.join(",");
        let comma = format!("{header}\n1.png,A,hole,1.5,-2,30,0.5,0,1e1,p1,7,12.25\n2.png,,,,,,,,,,,\n");
        let semicolon = comma.replace(',', ";").replace("1.5;", "1,5;").replace("12.25", "12,25");
        let tab = comma.replace(',', "\t").replace('\n', "\r\n");
        let json = r#"{"file": "1.png", "part": "A", "side": "hole", "x_mm": 1.5, "y_mm": -2, "theta_deg": 30,
            "moved_x_mm": 0.5, "moved_y_mm": 0, "moved_theta_deg": 10, "pair": "p1", "episode": 7, "time_s": 12.25}"#;
        let json = format!("{}\n{{\"file\": \"2.png\", \"part\": \"\", \"x_mm\": null}}\n", json.replace('\n', " "));
        let touch = Touch {
            part: Some("A".into()),
            side: Some(Side::Hole),
            part_from_sensor: Some(Se2::from_degrees(1.5, -2.0, 30.0)),
            moved: Some(Se2::from_degrees(0.5, 0.0, 10.0)),
            pair: Some("p1".into()),
            episode: Some("7".into()),
            time_s: Some(12.25),
        };
        for (text, first_line) in [(&comma, 2), (&semicolon, 2), (&tab, 2), (&json, 1)] {
            let row = |line, file: &str, touch: &Touch| Row { line, file: file.into(), touch: touch.clone() };
            let expected = [row(first_line, "1.png", &touch), row(first_line + 1, "2.png", &Touch::default())];
            assert_eq!(rows(text.as_bytes()).unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn byte_order_marks_quotes_blank_lines_and_a_named_separator_are_read() {
        let text = "\u{feff}\"file\",\"part\"\r\n\"a, b.png\",\"say \"\"A\"\"\"\r\n\r\n1.png,\r\n";
        let got = rows(text.as_bytes()).unwrap();
        assert_eq!((got[0].file.to_str(), got[0].touch.part.as_deref()), (Some("a, b.png"), Some("say \"A\"")));
        assert_eq!((got[1].line, &got[1].touch.part), (4, &None));
        let got = rows(b"sep=;\nfile;x_mm;y_mm;theta_deg\n1.png;1,5;2;3\n").unwrap();
        assert_eq!((got[0].line, got[0].touch.part_from_sensor.unwrap().x_mm), (3, 1.5));
        assert!(refusal(b"file\na\\b.png\n").contains("no such file"));
        assert_eq!(rows(b"file\nA\\hole\\3.png\n").unwrap()[0].file, Path::new("A/hole/3.png"));
        assert_eq!(rows(b"file\n./A/../1.png\n").unwrap()[0].file, Path::new("1.png"));
    }

    #[test]
    fn bad_rows_are_named_with_their_cell() {
        for (row, expected) in [
            ("9.png,1,2,3,", "9.png, got no such file"),
            (",1,2,3,", "the name of a file"),
            ("1.png,1,,3,", "x_mm, y_mm, theta_deg: expected all three numbers or none"),
            ("1.png,1,2", "3 cells under 5 columns"),
            ("1.png,1,2,east,", "theta_deg: expected a number, got east"),
            ("1.png,\"1,5\",2,3,", "x_mm: expected a number, got 1,5"),
            ("1.png,nan,1,1,", "x_mm: expected a number, got nan"),
            ("1.png,inf,1,1,", "x_mm: expected a number, got inf"),
            ("1.png,1e300,0,0,", "at most 10000 mm"),
            ("1.png,1,2,1e9,", "3600 degrees"),
            ("1.png,,,,1e300", "time_s: expected seconds"),
            ("1.png,,,,nan", "time_s: expected a number"),
            ("1.png,,,,1.7e18", "time_s: expected seconds, at most 10000000000 from zero"),
        ] {
            let message = refusal(format!("file,x_mm,y_mm,theta_deg,time_s\n2.png,0,0,0,\n{row}\n").as_bytes());
            assert!(message.contains(expected) && message.starts_with("index.csv line 3"), "{message}");
        }
        for (row, expected) in [
            (r#"{"file": "1.png", "x_mm": 1e999}"#, "number out of range"),
            (r#"{"file": "1.png", "x_mm": NaN}"#, "expected value at column"),
            (r#"{"file": "1.png", "file": "2.png"}"#, "duplicate field"),
            (r#"{"file": "1.png", "angle": 3}"#, "unknown field `angle`"),
            (r#"{"file": "1.png", "side": "left"}"#, "side: expected hole or peg, got left"),
            (r#"{"file": "1.png""#, "EOF"),
            (r#"[1]"#, "line 2"),
        ] {
            let message = refusal(format!("{{\"file\": \"2.png\"}}\n{row}\n").as_bytes());
            assert!(message.contains(expected) && message.starts_with("index.csv line 2"), "{message}");
        }
    }

    #[test]
    fn bad_headers_and_encodings_are_named() {
        for (text, expected) in [
            (&b"file,angle\n1.png,3\n"[..], "line 1: expected file, part"),
            (b"file,theta_dg\n1.png,3\n", "did you mean theta_deg?"),
            (b"part,side\nA,hole\n", "a column file"),
            (b"file,part,part\n1.png,A,B\n", "part twice"),
            (b"file\n", "at least one row that names a file"),
            (b"", "file"),
            (b"\xff\xfef\0i\0", "UTF-16"),
            (b"file\n\xe4.png\n", "line 2: expected text in UTF-8"),
            (b"file;x_mm;y_mm;theta_deg\n1.png;1.234,5;0;0\n", "got 1.234,5"),
        ] {
            let message = refusal(text);
            assert!(message.contains(expected), "{message}");
        }
    }
}

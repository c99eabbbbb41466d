//! Rows of an index that cannot all be true.

use std::collections::HashMap;
use std::path::Path;

use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::pose::se2::wrap_angle;
use crate::recording::index::Row;

/// A motion may differ from the two poses around it by this much, mm: an arm that touches repeats to a tenth of it.
const MOTION_MM: f64 = 1.0;

/// And by this much, degrees.
const MOTION_DEG: f64 = 3.0;

/// Checks the rows of the index or the tables at `source` against each other. What is odd but not wrong is added to
/// `warnings`.
///
/// # Errors
/// The first row that contradicts an earlier one, with the places of both: a file twice; a pair with two holes, two
/// pegs or two parts; an episode with two parts, or whose times go back; a motion that is not the one between the two
/// poses of its episode.
pub fn check(source: &Path, rows: &[Row], warnings: &mut Vec<String>) -> Result<()> {
    let mut files: HashMap<&Path, &Row> = HashMap::new();
    let mut pairs: HashMap<&str, Vec<&Row>> = HashMap::new();
    let mut episodes: HashMap<&str, Episode> = HashMap::new();
    for row in rows {
        if let Some(file) = &row.file
            && let Some(before) = files.insert(file, row)
        {
            let got = format!("{} a second time, after {}", file.display(), at(before, row));
            return Err(Error::invalid(row.place.to_string(), "each file once", got));
        }
        if let Some(pair) = &row.touch.pair {
            let of_pair = pairs.entry(pair).or_default();
            check_pair(of_pair, row).map_err(|e| e.within(format!("{}: pair {pair}", row.place)))?;
            of_pair.push(row);
        }
        if let Some(name) = &row.touch.episode {
            let episode = episodes.entry(name).or_default();
            episode.take(row).map_err(|e| e.within(format!("{}: episode {name}", row.place)))?;
        }
    }
    let is_alone = |row: &&Row| row.touch.pair.as_deref().is_some_and(|pair| pairs[pair].len() == 1);
    if let Some(first) = rows.iter().find(is_alone) {
        let pair = first.touch.pair.as_deref().unwrap_or_default();
        let n = rows.iter().filter(is_alone).count();
        warnings.push(format!(
            "{}: {n} pair(s) are named on one row only, first {pair} in {}: a pair is a hole and a peg",
            source.display(),
            first.place.in_text_about(source)
        ));
    }
    Ok(())
}

/// Where an earlier row is, in a text about a later one.
fn at(before: &Row, row: &Row) -> String {
    before.place.in_text_about(&row.place.file)
}

/// Checks a row against the earlier ones of its pair.
fn check_pair(earlier: &[&Row], row: &Row) -> Result<()> {
    for before in earlier {
        let after = |what: &str| format!("{what}, after {}", at(before, row));
        match (before.touch.side, row.touch.side) {
            (Some(Side::Hole), Some(Side::Hole)) => return Err(contradiction("side", "a peg", after("a second hole"))),
            (Some(Side::Peg), Some(Side::Peg)) => return Err(contradiction("side", "a hole", after("a second peg"))),
            _ => {}
        }
        check_part(before, row)?;
    }
    match earlier {
        [first, second, ..] => {
            let got = format!("a third row, after {} and {}", at(first, row), at(second, row));
            Err(contradiction("rows", "a hole and a peg", got))
        }
        _ => Ok(()),
    }
}

fn check_part(before: &Row, row: &Row) -> Result<()> {
    match (&before.touch.part, &row.touch.part) {
        (Some(expected), Some(got)) if expected != got => {
            Err(contradiction("part", format!("{expected}, as in {}", at(before, row)), got))
        }
        _ => Ok(()),
    }
}

/// What the rows of an episode have said so far.
#[derive(Default)]
struct Episode<'a> {
    part: Option<&'a Row>,
    time: Option<&'a Row>,
    last: Option<&'a Row>,
}

impl<'a> Episode<'a> {
    /// Checks the next row and takes it in.
    fn take(&mut self, row: &'a Row) -> Result<()> {
        self.part.map_or(Ok(()), |before| check_part(before, row))?;
        if let Some((before, then_s, now_s)) = self.time.and_then(|b| Some((b, b.touch.time_s?, row.touch.time_s?)))
            && now_s < then_s
        {
            let expected = format!("{then_s} s or later, after {}", at(before, row));
            return Err(contradiction("time_s", expected, format!("{now_s} s")));
        }
        self.last.map_or(Ok(()), |before| check_motion(before, row))?;
        if row.touch.part.is_some() {
            self.part = Some(row);
        }
        if row.touch.time_s.is_some() {
            self.time = Some(row);
        }
        self.last = Some(row);
        Ok(())
    }
}

/// Checks the motion to a row from the one before it in its episode, where all three are known.
fn check_motion(before: &Row, row: &Row) -> Result<()> {
    let (Some(from), Some(to), Some(moved)) =
        (before.touch.part_from_sensor, row.touch.part_from_sensor, row.touch.moved)
    else {
        return Ok(());
    };
    let expected = from.inverse() * to;
    let turned_deg = wrap_angle(moved.theta_rad - expected.theta_rad).abs().to_degrees();
    if moved.distance_mm(&expected) <= MOTION_MM && turned_deg <= MOTION_DEG {
        return Ok(());
    }
    let show = |motion: crate::pose::se2::Se2| {
        format!("{:.2}, {:.2} mm and {:.1} degrees", motion.x_mm, motion.y_mm, motion.theta_deg())
    };
    let between =
        format!("{} in the sensor's frame, from the pose in {} to this row's", show(expected), at(before, row));
    Err(contradiction("moved_*", between, show(moved)))
}

fn contradiction(what: &str, expected: impl Into<String>, got: impl Into<String>) -> Error {
    Error::invalid(what, expected, got)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::index;

    const HEADER: &str = "file,part,side,x_mm,y_mm,theta_deg,moved_x_mm,moved_y_mm,moved_theta_deg,pair,episode,time_s";

    /// What the rows of an index lead to; picture `a` is in each, `b`, `c` and `d` are there to be named.
    fn checked(rows: &str) -> Result<Vec<String>> {
        let folder = tempfile::tempdir().unwrap();
        ["a", "b", "c", "d"].iter().for_each(|file| std::fs::write(folder.path().join(file), "").unwrap());
        let name = Path::new("index.csv");
        let rows = index::read(name, format!("{HEADER}\n{rows}").as_bytes(), folder.path())?;
        let mut warnings = Vec::new();
        check(name, &rows, &mut warnings).map(|()| warnings)
    }

    #[test]
    fn rows_that_agree_pass() {
        // Turned by 90 degrees the sensor moves along its own x to go along the part's y.
        let rows = "a,A,hole,0,0,90,,,,p,e,1\nb,A,hole,0,4,100,4.5,0,12,,e,1\nc,A,peg,0,0,90,,,,p,f,0.5\n\
                    d,B,hole,9,9,0,3,3,3,,,0\n";
        assert_eq!(checked(rows).unwrap(), [""; 0]);
    }

    #[test]
    fn rows_that_contradict_each_other_are_both_named() {
        for (rows, expected) in [
            ("a,,,,,,,,,,,\nb,,,,,,,,,,,\n./a,,,,,,,,,,,\n", "a second time, after line 2"),
            (
                "a,,hole,,,,,,,p,,\nb,,,,,,,,,,,\nc,,hole,,,,,,,p,,\n",
                "pair p: side: expected a peg, got a second hole, after line 2",
            ),
            ("a,,peg,,,,,,,p,,\nb,,,,,,,,,,,\nc,,peg,,,,,,,p,,\n", "got a second peg, after line 2"),
            ("a,A,hole,,,,,,,p,,\nb,,,,,,,,,,,\nc,B,peg,,,,,,,p,,\n", "pair p: part: expected A, as in line 2, got B"),
            ("a,A,hole,,,,,,,p,,\nb,A,peg,,,,,,,p,,\nc,A,,,,,,,,p,,\n", "a third row, after line 2 and line 3"),
            ("a,A,,,,,,,,,e,\nb,,,,,,,,,,e,\nc,B,,,,,,,,,e,\n", "episode e: part: expected A, as in line 2, got B"),
            (
                "a,,,,,,,,,,e,5\nb,,,,,,,,,,e,\nc,,,,,,,,,,e,4.5\n",
                "time_s: expected 5 s or later, after line 2, got 4.5 s",
            ),
            ("a,,,0,0,0,,,,,e,\nb,,,0,0,0,,,,,f,\nc,,,4,0,0,2.9,0,0,,e,\n", "from the pose in line 2"),
            ("a,,,0,0,0,,,,,e,\nb,,,0,0,0,,,,,f,\nc,,,4,0,10,4,0,6.9,,e,\n", "got 4.00, 0.00 mm and 6.9 degrees"),
            ("a,,,0,0,90,,,,,e,\nb,,,0,0,0,,,,,f,\nc,,,4,0,90,4,0,0,,e,\n", "expected 0.00, -4.00 mm and"),
        ] {
            let message = checked(rows).unwrap_err().to_string();
            assert!(message.contains(expected) && message.starts_with("index.csv line 4"), "{message}");
            assert!(!message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn pairs_on_one_row_are_counted() {
        let rows = "a,,hole,,,,,,,p,,\nb,,hole,,,,,,,q,,\nc,,hole,,,,,,,r,,\nd,,peg,,,,,,,q,,\n";
        let warnings = checked(rows).unwrap();
        assert!(warnings[0].contains("2 pair(s) are named on one row only, first p in line 2"), "{warnings:?}");
    }
}

//! Tables of numbers that programs write as CSV.

use std::fs;
use std::path::Path;

use crate::error::{Error, Result};

/// A file with a head and a line for each row.
pub(super) struct Table {
    name: String,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads a file without quoted cells.
    pub(super) fn read(path: &Path) -> Result<Self> {
        Ok(Self::of(path.display().to_string(), &fs::read_to_string(path).map_err(Error::io(path))?))
    }

    fn of(name: String, text: &str) -> Self {
        let cells = |line: &str| line.split(',').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
        let mut lines = text.lines().map(cells);
        Self { name, head: lines.next().unwrap_or_default(), rows: lines.collect() }
    }

    /// A column where it has numbers, top down; at least one.
    pub(super) fn numbers(&self, column: &str) -> Result<Vec<f64>> {
        Ok(self.pairs(column, column)?.into_iter().map(|[number, _]| number).collect())
    }

    /// The rows where both columns have numbers, top down; at least one.
    pub(super) fn pairs(&self, one: &str, other: &str) -> Result<Vec<[f64; 2]>> {
        let at = |column: &str| self.head.iter().position(|name| name == column);
        let missing = || Error::invalid(&self.name, format!("numbers under '{one}' and '{other}'"), "none");
        let (one, other) = (at(one).ok_or_else(missing)?, at(other).ok_or_else(missing)?);
        let number = |row: &Vec<String>, at: usize| row.get(at)?.parse::<f64>().ok();
        let pairs = self.rows.iter().filter_map(|row| Some([number(row, one)?, number(row, other)?]));
        let pairs: Vec<[f64; 2]> = pairs.collect();
        if pairs.is_empty() { Err(missing()) } else { Ok(pairs) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_without_a_number_are_left_out_and_a_missing_column_is_named() {
        let table = Table::of("curve.csv".into(), "step,loss,share\n1,2.5,\n2,1.5,0.25\n");
        assert_eq!(table.numbers("loss").unwrap(), [2.5, 1.5]);
        assert_eq!(table.pairs("step", "share").unwrap(), [[2.0, 0.25]]);
        let error = table.numbers("speed").unwrap_err().to_string();
        assert!(error.starts_with("curve.csv: expected numbers under 'speed'"), "{error}");
    }
}

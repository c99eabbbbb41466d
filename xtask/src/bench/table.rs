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

    /// The rows where all of some columns have numbers, top down; at least one.
    pub(super) fn numbers<const N: usize>(&self, columns: [&str; N]) -> Result<Vec<[f64; N]>> {
        let missing = || Error::invalid(&self.name, format!("numbers under '{}'", columns.join("' and '")), "none");
        let at = columns.map(|column| self.head.iter().position(|name| name == column));
        let number = |row: &[String], at: Option<usize>| row.get(at?)?.parse::<f64>().ok();
        let of_row = |row: &Vec<String>| {
            let found = at.map(|at| number(row, at));
            found.iter().all(Option::is_some).then(|| found.map(Option::unwrap_or_default))
        };
        let rows: Vec<[f64; N]> = self.rows.iter().filter_map(of_row).collect();
        if rows.is_empty() { Err(missing()) } else { Ok(rows) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_without_a_number_are_left_out_and_a_missing_column_is_named() {
        let table = Table::of("curve.csv".into(), "step,loss,share\n1,2.5,\n2,1.5,0.25\n");
        assert_eq!(table.numbers(["loss"]).unwrap(), [[2.5], [1.5]]);
        assert_eq!(table.numbers(["step", "share"]).unwrap(), [[2.0, 0.25]]);
        let error = table.numbers(["speed"]).unwrap_err().to_string();
        assert!(error.starts_with("curve.csv: expected numbers under 'speed'"), "{error}");
    }
}

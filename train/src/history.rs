//! The measurements of a run: `curve.csv`, a line for each step, and the same in memory.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};
use tactile_data::file::bounded_file::{self, Kind};
use tactile_infer::safefile::write_whole;

use crate::error::{Error, Result};
use crate::validation::Validation;

/// The curve of a run: three million steps of 150 bytes.
const CURVE: Kind = Kind { name: "a curve of a run", most_bytes: 512 << 20 };

/// The columns before the columns of a validation.
const STEP_COLUMNS: &str = "step,loss,learning_rate,momentum,gradient_norm,pairs_per_second";

/// One step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Steps made, this one included.
    pub step: usize,
    /// The symmetrised loss.
    pub loss: f64,
    /// Learning rate of the step.
    pub learning_rate: f64,
    /// Momentum of the key encoder.
    pub momentum: f64,
    /// Length of the gradient.
    pub gradient_norm: f64,
    /// Speed over the last 50 steps.
    pub pairs_per_second: f64,
    /// The measurements at steps with a validation.
    pub validation: Option<Validation>,
}

/// The rows of a run, each appended to its file at once.
#[derive(Debug)]
pub struct History {
    rows: Vec<Row>,
    file: File,
    path: PathBuf,
}

impl History {
    /// Opens the curve for a run that continues after `first_step`: later rows, and one cut short by a crash, are
    /// dropped, because those steps will be made again.
    pub fn open(path: &Path, first_step: usize) -> Result<Self> {
        let old =
            if first_step > 0 && path.exists() { bounded_file::read_to_string(path, CURVE)? } else { String::new() };
        let rows: Vec<Row> = old.lines().skip(1).filter_map(parse).filter(|row| row.step <= first_step).collect();
        let mut kept = format!("{STEP_COLUMNS},{}\n", columns().join(","));
        rows.iter().for_each(|row| kept.push_str(&line(row)));
        write_whole(path, kept.as_bytes())?;
        let file = OpenOptions::new().append(true).open(path).map_err(Error::io(path))?;
        Ok(Self { rows, file, path: path.to_path_buf() })
    }

    /// Adds a step.
    pub fn push(&mut self, row: Row) -> Result<()> {
        self.file.write_all(line(&row).as_bytes()).map_err(Error::io(&self.path))?;
        self.rows.push(row);
        Ok(())
    }

    /// All steps so far, ascending.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }
}

/// The columns of a validation.
fn columns() -> Vec<String> {
    measures(&Validation::default()).into_iter().map(|(name, _)| name).collect()
}

/// The measurements by name, each a number or null.
fn measures(validation: &Validation) -> Map<String, Value> {
    match serde_json::to_value(validation) {
        Ok(Value::Object(measures)) => measures,
        _ => Map::new(),
    }
}

fn line(row: &Row) -> String {
    // Losses and norms are f32: their shortest form reads back as they were.
    let (loss, norm) = (row.loss as f32, row.gradient_norm as f32);
    let Row { step, learning_rate, momentum, pairs_per_second, .. } = row;
    let measures = row.validation.as_ref().map(measures).unwrap_or_default();
    let rounded = |value: f64| ((value * 1e5).round() / 1e5).to_string();
    let cell = |name: &String| measures.get(name).and_then(Value::as_f64).map(rounded).unwrap_or_default();
    let values: Vec<_> = columns().iter().map(cell).collect();
    format!("{step},{loss},{learning_rate:.6e},{momentum:.8},{norm},{pairs_per_second:.1},{}\n", values.join(","))
}

/// A row from its line; `None` for one cut short.
fn parse(line: &str) -> Option<Row> {
    let fields: Vec<&str> = line.split(',').collect();
    let (step, rest) = fields.split_first()?;
    let (numbers, values) = rest.split_at_checked(5)?;
    let numbers: Vec<f64> = numbers.iter().map(|field| field.parse().ok()).collect::<Option<_>>()?;
    let single = |value: f64| f64::from(value as f32);
    let columns = Some(columns()).filter(|columns| columns.len() == values.len())?;
    let measured = columns.into_iter().zip(values).filter(|(_, field)| !field.is_empty());
    let measured: Map<_, _> = measured.map(|(name, field)| Some((name, field.parse().ok()?))).collect::<Option<_>>()?;
    Some(Row {
        step: step.parse().ok()?,
        loss: single(numbers[0]),
        learning_rate: numbers[1],
        momentum: numbers[2],
        gradient_norm: single(numbers[3]),
        pairs_per_second: numbers[4],
        validation: serde_json::from_value(Value::Object(measured)).ok(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: usize) -> Row {
        let validation = Validation {
            retrieval_1: 0.5,
            near_rank: Some(2.25),
            tuning_accuracy: (step == 2).then_some(0.625),
            n_holes: 900,
            ..Validation::default()
        };
        Row {
            step,
            loss: f64::from(2.260_928_4_f32 / step as f32),
            learning_rate: 2e-3,
            momentum: 0.98,
            gradient_norm: f64::from(0.1_f32),
            pairs_per_second: 150.5,
            validation: step.is_multiple_of(2).then_some(validation),
        }
    }

    #[test]
    fn a_history_read_again_is_the_same_up_to_the_step() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        let mut history = History::open(&path, 0).unwrap();
        (1..=6).for_each(|step| history.push(row(step)).unwrap());
        drop(history);
        // A crash cuts the last line short.
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 9]).unwrap();
        let again = History::open(&path, 4).unwrap();
        assert_eq!(again.rows(), (1..=4).map(row).collect::<Vec<_>>());
        let lines: Vec<_> = text.lines().take(5).collect();
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().collect::<Vec<_>>(), lines);
        assert!(History::open(&path, 0).unwrap().rows().is_empty());
    }
}

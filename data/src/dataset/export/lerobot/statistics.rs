//! What `meta/stats.json` says of each feature: least, greatest, mean and standard deviation.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::recording::lerobot::format::PICTURES;
use crate::recording::lerobot::format::columns::{Column, Values};

/// What was seen of all frames.
#[derive(Default)]
pub(super) struct Statistics {
    pub(super) pixels: Pixels,
    numbers: BTreeMap<String, Vec<Numbers>>,
}

/// Sums over the pixels of pictures, for each colour.
#[derive(Clone, Copy, Default)]
pub(super) struct Pixels {
    n: u64,
    least: [u8; 3],
    greatest: [u8; 3],
    sum: [u64; 3],
    squares: [u64; 3],
}

/// Sums over the values of a feature that are known.
#[derive(Clone, Copy)]
struct Numbers {
    n: usize,
    least: f64,
    greatest: f64,
    mean: f64,
    /// Squared differences from the mean, summed (Welford 1962).
    squares: f64,
}

impl Pixels {
    /// The pixels of one picture, RGB.
    pub(super) fn of(rgb: &[u8]) -> Self {
        let mut all = Self { least: [255; 3], ..Self::default() };
        for pixel in rgb.chunks_exact(3) {
            all.n += 1;
            for (colour, value) in pixel.iter().enumerate() {
                all.least[colour] = all.least[colour].min(*value);
                all.greatest[colour] = all.greatest[colour].max(*value);
                all.sum[colour] += u64::from(*value);
                all.squares[colour] += u64::from(*value).pow(2);
            }
        }
        all
    }

    pub(super) fn add(&mut self, other: &Self) {
        if self.n == 0 {
            *self = *other;
            return;
        }
        self.n += other.n;
        for colour in 0..3 {
            self.least[colour] = self.least[colour].min(other.least[colour]);
            self.greatest[colour] = self.greatest[colour].max(other.greatest[colour]);
            self.sum[colour] += other.sum[colour];
            self.squares[colour] += other.squares[colour];
        }
    }

    /// In shares of 255, a colour in a plane of its own.
    fn json(&self, n_frames: usize) -> Value {
        let n = self.n.max(1) as f64;
        let mean = |colour: usize| self.sum[colour] as f64 / n / 255.0;
        let sd =
            |colour: usize| (self.squares[colour] as f64 / n / 255.0 / 255.0 - mean(colour).powi(2)).max(0.0).sqrt();
        let planes = |of: &dyn Fn(usize) -> f64| json!([0, 1, 2].map(|colour| [[of(colour)]]));
        json!({
            "min": planes(&|colour| f64::from(self.least[colour]) / 255.0),
            "max": planes(&|colour| f64::from(self.greatest[colour]) / 255.0),
            "mean": planes(&mean),
            "std": planes(&sd),
            "count": [n_frames],
        })
    }
}

impl Numbers {
    const NONE: Self = Self { n: 0, least: f64::INFINITY, greatest: f64::NEG_INFINITY, mean: 0.0, squares: 0.0 };

    fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.n += 1;
        self.least = self.least.min(value);
        self.greatest = self.greatest.max(value);
        let off = value - self.mean;
        self.mean += off / self.n as f64;
        self.squares += off * (value - self.mean);
    }

    fn sd(&self) -> f64 {
        (self.squares / self.n.max(1) as f64).sqrt()
    }
}

impl Statistics {
    /// Adds some rows of a column; text has no statistics.
    pub(super) fn add(&mut self, column: &Column) {
        let (len, values): (usize, Vec<f64>) = match column.values() {
            Values::Longs(values) => (1, values.iter().map(|value| *value as f64).collect()),
            Values::Floats(values) => (1, values.iter().map(|value| f64::from(*value)).collect()),
            Values::Doubles(values) => (1, values.clone()),
            Values::Lists(len, values) => (*len, values.iter().map(|value| f64::from(*value)).collect()),
            Values::Texts(_) | Values::Named(_) | Values::Pictures(..) => return,
        };
        let numbers = self.numbers.entry(column.name().to_owned()).or_insert_with(|| vec![Numbers::NONE; len]);
        for row in values.chunks(len) {
            numbers.iter_mut().zip(row).for_each(|(numbers, value)| numbers.add(*value));
        }
    }

    /// The file's content.
    pub(super) fn json(&self, n_frames: usize) -> Value {
        let all = |numbers: &[Numbers], of: fn(&Numbers) -> f64| json!(numbers.iter().map(of).collect::<Vec<_>>());
        let of_feature = |numbers: &Vec<Numbers>| {
            json!({
                "min": all(numbers, |of| of.least),
                "max": all(numbers, |of| of.greatest),
                "mean": all(numbers, |of| of.mean),
                "std": all(numbers, Numbers::sd),
                "count": [numbers[0].n],
            })
        };
        let known = self.numbers.iter().filter(|(_, numbers)| numbers.iter().all(|of| of.n > 0));
        let mut json: serde_json::Map<String, Value> = known.map(|(name, of)| (name.clone(), of_feature(of))).collect();
        json.insert(PICTURES.into(), self.pixels.json(n_frames));
        Value::Object(json)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_pixels_and_numbers_come_to_means_and_deviations() {
        let mut statistics = Statistics::default();
        for rgb in [[0, 10, 255, 100, 10, 255], [200, 10, 255, 100, 10, 0]] {
            statistics.pixels.add(&Pixels::of(&rgb));
        }
        let rows = |values: [f64; 3]| Column::new("x_mm", Values::Doubles(values.to_vec()));
        statistics.add(&rows([1.0, f64::NAN, 3.0]));
        statistics.add(&rows([5.0, 7.0, f64::NAN]));
        statistics.add(&Column::new("time_s", Values::Doubles(vec![f64::NAN])));
        let json = statistics.json(2);
        let at = |path: &str| json.pointer(path).unwrap().as_f64().unwrap();
        // Red: 0, 100, 200, 100.
        let red = |of: &str| 255.0 * at(&format!("/{PICTURES}/{of}/0/0/0"));
        assert_eq!([red("min"), red("max"), red("mean")], [0.0, 200.0, 100.0]);
        assert!((red("std") - 5000.0_f64.sqrt()).abs() < 1e-9);
        // 1, 3, 5 and 7.
        assert_eq!(["min", "max", "mean"].map(|of| at(&format!("/x_mm/{of}/0"))), [1.0, 7.0, 4.0]);
        assert!((at("/x_mm/std/0") - 5.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(json.pointer("/x_mm/count/0").unwrap(), 4);
        assert!(json.get("time_s").is_none());
    }
}

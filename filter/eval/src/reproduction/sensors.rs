//! The table of sensors: what a model is worth under another sensor, as it comes and after each step of making it one's
//! own.

use maud::{Markup, html};
use serde::{Deserialize, Serialize};

use super::experiments::Row;
use super::folder::Reproduction;
use super::way::{Way, folders};
use crate::report::series::{leading_filter, leading_stops};
use crate::result::{Evaluation, Poses};

/// The value of [`SensorTable::schema`].
pub const SENSORS_SCHEMA: &str = "tactile-filter/sensors/1";

/// The numbers of touches of the table for programs.
const TOUCHES: [usize; 3] = [1, 3, 10];

/// The table for programs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorTable {
    /// `tactile-filter/sensors/1`.
    pub schema: String,
    /// A row for each sensor and way that was run.
    pub rows: Vec<SensorRow>,
}

/// A sensor in one way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorRow {
    /// Name of the sensor.
    pub sensor: String,
    /// What was done for it.
    pub way: Way,
    /// Name of the scene.
    pub scene: String,
    /// SHA-256 of the model's weights, hexadecimal.
    pub model_sha256: String,
    /// Episodes behind the row.
    pub n_episodes: usize,
    /// Right parts after 1, 3 and 10 touches.
    pub right: Vec<Right>,
    /// Share of episodes that stopped sure of a part, 0..=1.
    pub confident: f64,
    /// Share of those that were wrong, 0..=1; 0 where none was sure.
    pub confident_and_wrong: f64,
    /// Share of episodes that ended as none of these, 0..=1.
    pub refused: f64,
    /// Mean number of touches when an episode stopped.
    pub mean_touches: f64,
}

/// Right parts after so many touches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Right {
    /// Touches, the first included.
    pub n_touches: usize,
    /// Share of episodes, 0..=1.
    pub share: f64,
    /// Bounds of its 95 % interval.
    pub ci95: [f64; 2],
}

/// The table of a folder; `None` where no sensor was run.
pub fn table(found: &Reproduction) -> Option<SensorTable> {
    let row = |(sensor, way, evaluation): (&str, Way, &Evaluation)| row(sensor, way, evaluation);
    let rows: Vec<SensorRow> = runs(found).filter_map(row).collect();
    (!rows.is_empty()).then(|| SensorTable { schema: SENSORS_SCHEMA.into(), rows })
}

/// The evaluations of sensors: in the experiments' order, each in the order of the ways.
fn runs(found: &Reproduction) -> impl Iterator<Item = (&str, Way, &Evaluation)> {
    let of_sensor = |name: &str| Way::ALL.into_iter().zip(folders(name));
    let all =
        found.experiments.sensors.iter().flat_map(move |of| of_sensor(&of.name).map(|way| (of.name.as_str(), way)));
    all.filter_map(|(name, (way, folder))| Some((name, way, found.evaluation(&folder)?)))
}

fn row(sensor: &str, way: Way, evaluation: &Evaluation) -> Option<SensorRow> {
    let stops = leading_stops(evaluation)?;
    let right = |n_touches: usize| {
        let row = leading_filter(evaluation, Poses::OffGrid)?.at(n_touches)?;
        Some(Right { n_touches, share: row.accuracy, ci95: row.accuracy_ci95 })
    };
    let wrong = stops.confident_and_wrong;
    Some(SensorRow {
        sensor: sensor.into(),
        way,
        scene: evaluation.scene.clone(),
        model_sha256: evaluation.model.sha256.clone(),
        n_episodes: evaluation.n_episodes,
        right: TOUCHES.into_iter().filter_map(right).collect(),
        confident: stops.confident,
        confident_and_wrong: if wrong.is_finite() { wrong } else { 0.0 },
        refused: stops.none_of_these,
        mean_touches: stops.mean_touches,
    })
}

/// A row of the page for each evaluation of a sensor that was run.
pub fn rows(found: &Reproduction) -> Vec<Row> {
    let label = |name: &str| found.experiments.sensors.iter().find(|of| of.name == name).map(|of| of.label.clone());
    let row = |(sensor, way, _): (&str, Way, &Evaluation)| Row {
        of: way.folder_of(sensor),
        text: vec![label(sensor).unwrap_or_default(), way.label().into()],
        known: None,
        style: String::new(),
        marker: None,
    };
    runs(found).map(row).collect()
}

/// What is shown of sensors that were not run.
pub fn missing(found: &Reproduction) -> Markup {
    let is_missing = |name: &str| runs(found).all(|(sensor, ..)| sensor != name);
    let missing = found.experiments.sensors.iter().filter(|of| is_missing(&of.name));
    let missing: Vec<&str> = missing.map(|of| of.label.as_str()).collect();
    html! { @if !missing.is_empty() { p.note { "Not run: " (missing.join("; ")) "." } } }
}

/// The caption with the letters that were touched in place of `{letters}`.
pub fn caption(found: &Reproduction, caption: &str) -> String {
    let is_tuning = runs(found).any(|(.., evaluation)| evaluation.scene.ends_with("-tuning"));
    let letters =
        if is_tuning { "M to X, which settings may be chosen on" } else { "A to L, which informed no choice" };
    caption.replace("{letters}", letters)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::{Choice, Inference, Stops};

    /// An evaluation anywhere with these shares right after three touches and refused.
    pub fn made(three: f64, refused: f64) -> Evaluation {
        let mut made = evaluation("sensor-x", 0.5, &[(1, 0.5), (3, three), (10, 0.99)]);
        made.rows.iter_mut().for_each(|row| row.poses = Poses::OffGrid);
        made.stops = vec![Stops {
            seconds: None,
            inference: Inference::Exact,
            action: Choice::Information,
            mean_touches: 4.25,
            confident: 1.0 - refused,
            confident_and_wrong: 0.04,
            none_of_these: refused,
            touches_to_95: 4.0,
        }];
        made
    }

    #[test]
    fn each_sensor_has_its_ways_in_order() {
        let found = of(&[
            ("sensor-cmu-lamps-calibrated", made(0.98, 0.03)),
            ("sensor-cmu-lamps-own-bank", made(0.93, 0.94)),
            ("sensor-default-shipped", made(0.99, 0.004)),
        ]);
        let table = table(&found).unwrap();
        let order: Vec<_> = table.rows.iter().map(|row| (row.sensor.as_str(), row.way)).collect();
        let expected = [("default", Way::Shipped), ("cmu-lamps", Way::OwnBank), ("cmu-lamps", Way::Calibrated)];
        assert_eq!(order, expected);
        assert_eq!((table.rows[1].refused, table.rows[1].right[1].share), (0.94, 0.93));
        let texts: Vec<_> = rows(&found).into_iter().map(|row| row.text.join(", ")).collect();
        assert_eq!(texts[1], "the lamps of an older GelSight (cmu), own bank");
        assert!(missing(&found).0.contains("Not run: a Mini’s lamps in closed form; light, gel and scale"));
    }

    #[test]
    fn the_table_is_read_back_by_programs() {
        let table = table(&of(&[("sensor-soft-gel-own-bank", made(0.9, 0.1))])).unwrap();
        let json = serde_json::to_value(&table).unwrap();
        assert_eq!((&json["schema"], &json["rows"][0]["way"]), (&SENSORS_SCHEMA.into(), &"own-bank".into()));
        assert_eq!(serde_json::from_value::<SensorTable>(json).unwrap(), table);
        assert_eq!(super::table(&of(&[("small", made(0.9, 0.1))])), None);
    }
}

//! The table of sensors: what a model is worth under another sensor, as it comes and after each step of making it one's
//! own.

use maud::{Markup, html};
use serde::{Deserialize, Serialize};

use super::folder::{PARTS, Reproduction, SENSOR};
use super::section::Finding;
use crate::page::numbers::{number, percent, share};
use crate::page::shell::figure;
use crate::page::table::sortable;
use crate::report::series::{leading_filter, leading_stops};
use crate::result::{Evaluation, Poses, Row};

/// Its entry in the contents.
const SHORT: &str = "Sensors";

/// The value of [`SensorTable::schema`].
pub const SENSORS_SCHEMA: &str = "tactile-filter/sensors/1";

/// The numbers of touches shown.
const TOUCHES: [usize; 3] = [1, 3, 10];

/// The sensors in the order of the table, with what each is; others follow by name.
const SENSORS: [(&str, &str); 12] = [
    ("default", "the default sensor, a GelSight Mini"),
    ("cmu-lamps", "the lamps of an older GelSight (cmu)"),
    ("fots-balls", "light, gel and scale calibrated on 42 real presses of a ball (FOTS)"),
    ("mini-sdk", "a Mini under its maker’s driver, 20.3 x 15.2 mm"),
    ("mini-taxim", "a Mini as Taxim has it, 18.9 x 14.2 mm"),
    ("closer-view", "a view of 15.8 x 12.2 mm"),
    ("hard-gel", "a gel that comes back over 0.7 mm"),
    ("soft-gel", "a gel that comes back over 2.0 mm"),
    ("noisy-camera", "three times the noise, harder compression"),
    ("half-exposure", "half the exposure"),
    ("strong-light-field", "the frame’s light moves twice as much under contact as measured"),
    ("worn-gel", "120 specks of dust, layer lines of 0.02 to 0.08 mm"),
];

/// Parts of other kinds.
const KINDS: [(&str, &str); 6] = [
    ("serif-letters", "letters A to L of another font"),
    ("digits", "ten digits"),
    ("look-alikes", "twelve shapes, two and two alike"),
    ("new-outlines", "twelve new outlines drawn at random"),
    ("outlines", "twelve outlines drawn at random, for tuning"),
    ("wide", "small letters, within 16 mm and at every angle"),
];

/// How much was done for a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// Nothing: the model as shipped, and a bank rendered under the default sensor; nothing is known of its light.
    Shipped,
    /// Its light is known, where it is another than the default's: pictures are brought under the lamps that the model
    /// knows.
    LightKnown,
    /// A bank rendered under this sensor.
    OwnBank,
    /// The same, and the confidence calibrated on letters for tuning under this sensor.
    Calibrated,
}

impl Way {
    const ALL: [Self; 4] = [Self::Shipped, Self::LightKnown, Self::OwnBank, Self::Calibrated];

    /// The end of its folder's name.
    fn folder(self) -> &'static str {
        match self {
            Self::Shipped => "shipped",
            Self::LightKnown => "light-known",
            Self::OwnBank => "own-bank",
            Self::Calibrated => "calibrated",
        }
    }

    fn label(self) -> &'static str {
        match self {
            Self::Shipped => "as it comes",
            Self::LightKnown => "its light known",
            Self::OwnBank => "own bank",
            Self::Calibrated => "calibrated",
        }
    }
}

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
    let rows: Vec<SensorRow> = runs(found).into_iter().filter_map(|run| row(&run)).collect();
    (!rows.is_empty()).then(|| SensorTable { schema: SENSORS_SCHEMA.into(), rows })
}

/// One evaluation of a sensor.
struct Run<'a> {
    sensor: &'a str,
    way: Way,
    /// Its folder.
    name: &'a str,
    evaluation: &'a Evaluation,
}

/// The evaluations of sensors: in the table's order, others by name, each in the order of the ways.
fn runs(found: &Reproduction) -> Vec<Run<'_>> {
    let of = |(name, evaluation)| -> Option<Run<'_>> {
        let name: &str = name;
        let rest = name.strip_prefix(SENSOR)?;
        let way = Way::ALL.into_iter().find(|way| rest.ends_with(way.folder()))?;
        let sensor = rest.strip_suffix(way.folder())?.strip_suffix('-')?;
        Some(Run { sensor, way, name, evaluation })
    };
    let mut runs: Vec<Run<'_>> = found.evaluations.iter().filter_map(|(name, of_it)| of((name, of_it))).collect();
    let place = |run: &Run<'_>| SENSORS.iter().position(|(name, _)| *name == run.sensor).unwrap_or(SENSORS.len());
    let way = |run: &Run<'_>| Way::ALL.iter().position(|way| *way == run.way);
    runs.sort_by_key(|run| (place(run), run.sensor, way(run)));
    runs
}

fn row(run: &Run<'_>) -> Option<SensorRow> {
    let stops = leading_stops(run.evaluation)?;
    let right = |n_touches: usize| {
        let row = at(run.evaluation, n_touches)?;
        Some(Right { n_touches, share: row.accuracy, ci95: row.accuracy_ci95 })
    };
    let wrong = stops.confident_and_wrong;
    Some(SensorRow {
        sensor: run.sensor.into(),
        way: run.way,
        scene: run.evaluation.scene.clone(),
        model_sha256: run.evaluation.model.sha256.clone(),
        n_episodes: run.evaluation.n_episodes,
        right: TOUCHES.into_iter().filter_map(right).collect(),
        confident: stops.confident,
        confident_and_wrong: if wrong.is_finite() { wrong } else { 0.0 },
        refused: stops.none_of_these,
        mean_touches: stops.mean_touches,
    })
}

fn at(evaluation: &Evaluation, n_touches: usize) -> Option<&Row> {
    leading_filter(evaluation, Poses::OffGrid)?.at(n_touches)
}

/// The section.
pub fn finding(found: &Reproduction) -> Finding {
    let title = "Other sensors, as it comes and made one’s own";
    let runs = runs(found);
    let Some(table) = table(found) else { return Finding::not_run(SHORT, title, "sensor-NAME-WAY") };
    let own = runs.iter().find(|run| run.sensor == SENSORS[0].0);
    let label = |name: &str| SENSORS.iter().find(|(known, _)| *known == name).map_or(name.to_owned(), |of| of.1.into());
    let rows = runs.iter().map(|run| {
        let first = [html! { (label(run.sensor)) }, found.report(run.name, run.way.label())];
        cells(first.into(), run.evaluation, own.map_or(run.evaluation, |own| own.evaluation))
    });
    let missing: Vec<&str> =
        SENSORS.iter().filter(|(name, _)| runs.iter().all(|run| run.sensor != *name)).map(|of| of.1).collect();
    let is_tuning = table.rows.iter().any(|row| row.scene.ends_with("-tuning"));
    let letters =
        if is_tuning { "M to X, which settings may be chosen on" } else { "A to L, which informed no choice" };
    let caption = html! {
        "Small letters " (letters) ", touched anywhere, banks of 2\u{a0}mm and 15 degrees. As it comes: the model as shipped and a bank "
        "rendered under the default sensor, nothing known of the light. Its light known: as after a calibration on presses of a ball, where "
        "the light differs. Own bank: its light known, and a bank rendered under the sensor of the row. Calibrated: that bank, and the confidence "
        "calibrated on 480 touches of letters M to X under that sensor. Refused: ended as none of these. Wrong: of the stops that were "
        "sure. Marked in red: clearly below the default sensor as it comes (the intervals do not meet). All of it is simulated."
    };
    let body = html! {
        (figure(sortable(&heads(&["Sensor", "What was done"]), &rows.collect::<Vec<_>>()), caption))
        @if !missing.is_empty() { p.note { "Not run: " (missing.join("; ")) "." } }
        (kinds(found))
    };
    Finding::new(SHORT, title, body, &line(&table))
}

fn line(table: &SensorTable) -> String {
    let of = |way: Way| table.rows.iter().filter(move |row| row.way == way);
    let three = |row: &SensorRow| row.right.iter().find(|right| right.n_touches == 3).map_or(f64::NAN, |of| of.share);
    let in_words = |way: Way| {
        let lowest = of(way).map(|row| (three(row), row)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let refused = of(way).map(|row| (row.refused, row)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(format!(
            "{}, after 3 touches {} % or more ({}), refused {} % or fewer ({})",
            way.label(),
            percent(lowest.0),
            lowest.1.sensor,
            percent(refused.0),
            refused.1.sensor
        ))
    };
    Way::ALL.into_iter().filter_map(in_words).collect::<Vec<_>>().join("; ")
}

fn heads<'a>(first: &[&'a str]) -> Vec<&'a str> {
    let others =
        ["1 touch, %", "3 touches", "10", "sure of a part, %", "wrong, %", "refused, %", "touches", "episodes"];
    first.iter().copied().chain(others).collect()
}

/// The cells of a row behind its first ones; `own` is what it is compared with.
fn cells(first: Vec<Markup>, evaluation: &Evaluation, own: &Evaluation) -> Vec<Markup> {
    let right = |n: usize| {
        html! {
            @if let Some(row) = at(evaluation, n) {
                @let is_below = at(own, n).is_some_and(|own| row.accuracy_ci95[1] < own.accuracy_ci95[0]);
                span.wrong[is_below] { (share(row.accuracy, row.accuracy_ci95)) }
            }
        }
    };
    let stops = leading_stops(evaluation);
    let of = |value: Option<f64>| html! { (value.map_or("–".into(), percent)) };
    let behind = [
        of(stops.map(|stops| stops.confident)),
        of(stops.map(|stops| stops.confident_and_wrong)),
        of(stops.map(|stops| stops.none_of_these)),
        html! { (stops.map_or("–".into(), |stops| number(stops.mean_touches, 1))) },
        html! { (evaluation.n_episodes) },
    ];
    first.into_iter().chain(TOUCHES.into_iter().map(right)).chain(behind).collect()
}

/// The table of parts of other kinds; nothing where none was run.
fn kinds(found: &Reproduction) -> Markup {
    let there = KINDS.iter().filter_map(|(name, label)| {
        let folder = format!("{PARTS}{name}");
        let evaluation = found.evaluation(&folder)?;
        Some(cells(vec![found.report(&folder, label)], evaluation, evaluation))
    });
    let rows: Vec<Vec<Markup>> = there.collect();
    html! {
        @if !rows.is_empty() {
            (figure(sortable(&heads(&["Parts"]), &rows), "Parts of other kinds under the default sensor, touched anywhere, with the model \
                as shipped and a bank of their own. Those that are not said to be for tuning informed no choice, but for the digits 1, 4 and \
                7 (how many states between two poses)."))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::{Choice, Inference, Stops};
    use maud::Render;

    fn made(three: f64, refused: f64) -> Evaluation {
        let mut made = evaluation("sensor-x", 0.5, &[(1, 0.5), (3, three), (10, 0.99)]);
        made.rows.iter_mut().for_each(|row| row.poses = Poses::OffGrid);
        made.stops = vec![Stops {
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
    fn each_sensor_has_its_ways_in_order_and_what_is_clearly_worse_is_marked() {
        let found = of(&[
            ("sensor-cmu-lamps-calibrated", made(0.98, 0.03)),
            ("sensor-cmu-lamps-own-bank", made(0.93, 0.94)),
            ("sensor-default-shipped", made(0.99, 0.004)),
            ("sensor-mine-shipped", made(0.98, 0.01)),
        ]);
        let table = table(&found).unwrap();
        let order: Vec<_> = table.rows.iter().map(|row| (row.sensor.as_str(), row.way)).collect();
        let expected = [
            ("default", Way::Shipped),
            ("cmu-lamps", Way::OwnBank),
            ("cmu-lamps", Way::Calibrated),
            ("mine", Way::Shipped),
        ];
        assert_eq!(order, expected);
        assert_eq!((table.rows[1].refused, table.rows[1].right[1].share), (0.94, 0.93));
        let finding = finding(&found);
        let line = "Sensors: as it comes, after 3 touches 98.0 % or more (mine), refused 1.0 % or fewer (mine); own bank, after 3 \
                    touches 93.0 % or more (cmu-lamps), refused 94.0 % or fewer (cmu-lamps); calibrated, after 3 touches 98.0 % or \
                    more (cmu-lamps), refused 3.0 % or fewer (cmu-lamps)";
        assert_eq!(finding.line, line);
        let html = finding.section.render().0;
        assert_eq!(html.matches(r#"<span class="wrong">"#).count(), 1);
        assert!(html.contains(r#"<span class="wrong">93.0"#) && html.contains("Not run: light, gel and scale"));
    }

    #[test]
    fn the_table_is_read_back_by_programs() {
        let table = table(&of(&[("sensor-soft-gel-own-bank", made(0.9, 0.1))])).unwrap();
        let json = serde_json::to_value(&table).unwrap();
        assert_eq!((&json["schema"], &json["rows"][0]["way"]), (&SENSORS_SCHEMA.into(), &"own-bank".into()));
        assert_eq!(serde_json::from_value::<SensorTable>(json).unwrap(), table);
        assert_eq!(super::table(&of(&[("small", made(0.9, 0.1))])), None);
    }

    #[test]
    fn letters_for_tuning_are_said_to_be_so_and_other_kinds_have_their_own_table() {
        let tuning = Evaluation { scene: "sensor-default-tuning".into(), ..made(0.99, 0.0) };
        let html = super::finding(&of(&[("sensor-default-shipped", tuning), ("parts-digits", made(0.97, 0.02))]));
        let html = html.section.render().0;
        assert!(html.contains("M to X, which settings may be chosen on") && html.contains("ten digits"));
        assert_eq!(html.matches("<table").count(), 2);
    }
}

//! A scene's `[sensor]`: a known sensor by name, and its scale in more than one way.

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::sensor::SensorSpec;
use crate::text::suggest;

/// Width and height in mm of what sensors of the same kind show under different drivers.
const VIEWS: [(&str, [f64; 2]); 3] = [
    // The paper, Sec. V-A.
    ("gelsight-mini", [18.6, 14.3]),
    // The maker's SDK: 0.0634 mm/px at 320 x 240.
    ("gelsight-mini-sdk", [20.3, 15.2]),
    // Taxim's Mini in TacEx: 0.0590 mm/px at 320 x 240.
    ("gelsight-mini-taxim", [18.88, 14.16]),
];

/// Two fields of view are the same to this share: scales are given with three digits.
const SAME_VIEW: f64 = 0.005;

/// Reads a sensor whose table may have, in addition to the fields of [`SensorSpec`], `preset = "gelsight-mini"` and
/// `mm_per_px = [x, y]`. All that give the field of view must agree.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<SensorSpec, D::Error> {
    let mut table = Map::deserialize(deserializer)?;
    set_view(&mut table).map_err(D::Error::custom)?;
    SensorSpec::deserialize(Value::Object(table)).map_err(|e| D::Error::custom(format!("sensor: {e}")))
}

/// Replaces `preset` and `mm_per_px` by the field of view that they mean.
fn set_view(table: &mut Map<String, Value>) -> Result<()> {
    if table.contains_key("light") && table.contains_key("calibration") {
        return Err(Error::invalid("sensor", "light or calibration", "both"));
    }
    let mut views: Vec<(&str, [f64; 2])> = Vec::new();
    if let Some(view) = field(table, "field_of_view_mm", "two positive lengths")? {
        views.push(("field_of_view_mm", view));
    }
    if let Some(mm_per_px) = field::<[f64; 2]>(table, "mm_per_px", "two positive lengths")? {
        let frame_px: [usize; 2] =
            field(table, "frame_px", "two numbers of pixels")?.unwrap_or(SensorSpec::default().frame_px);
        views.push(("mm_per_px", [0, 1].map(|axis| mm_per_px[axis] * frame_px[axis] as f64)));
    }
    if let Some(name) = field::<String>(table, "preset", "a name")? {
        views.push(("preset", suggest::named("sensor.preset", &name, &VIEWS, |(known, _)| known)?.1));
    }
    if let Some((name, [x, y])) = views.iter().find(|(_, view)| !view.iter().all(|mm| mm.is_finite() && *mm > 0.0)) {
        return Err(Error::invalid(format!("sensor.{name}"), "positive lengths", format!("a view of {x} x {y} mm")));
    }
    let Some((first, view)) = views.first().copied() else { return Ok(()) };
    for (name, other) in &views[1..] {
        if [0, 1].iter().any(|axis| (other[*axis] / view[*axis] - 1.0).abs() > SAME_VIEW) {
            let expected = format!("the view of {first}, {:.2} x {:.2} mm", view[0], view[1]);
            let got = format!("{:.2} x {:.2} mm", other[0], other[1]);
            return Err(Error::invalid(format!("sensor.{name}"), expected, got));
        }
    }
    table.remove("preset");
    table.remove("mm_per_px");
    table.insert("field_of_view_mm".into(), Value::from(view.to_vec()));
    Ok(())
}

fn field<T: DeserializeOwned>(table: &Map<String, Value>, name: &str, expected: &str) -> Result<Option<T>> {
    let parse = |value: &Value| {
        T::deserialize(value).map_err(|e| Error::invalid(format!("sensor.{name}"), expected, e.to_string()))
    };
    table.get(name).map(parse).transpose()
}

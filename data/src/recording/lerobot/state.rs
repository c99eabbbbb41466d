//! Where a robot's state has the pose of the sensor.

use serde_json::Value;

use crate::error::{Error, Result};
use crate::recording::lerobot::format::{Feature, STATE};
use crate::recording::parquet::State;

/// The names of an export.
const OWN: &str = "x_mm,y_mm,theta_deg";

/// Units of lengths and of angles, and what brings them to mm and to degrees.
const LENGTHS: [(&str, f64); 3] = [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)];
const ANGLES: [(&str, f64); 2] = [("deg", 1.0), ("rad", 180.0 / std::f64::consts::PI)];

/// Finds x, y and the angle among the names of a state: `asked`, or those of an export; `None` where nothing was asked for and
/// the state has no such names.
///
/// # Errors
/// Not three names, a name without a unit, one that the state does not have.
pub(super) fn find(feature: Option<&Feature>, asked: Option<&str>) -> Result<Option<State>> {
    let names = feature.map(names).unwrap_or_default();
    if asked.is_none() && !OWN.split(',').all(|name| names.iter().any(|own| own == name)) {
        return Ok(None);
    }
    let refused = |expected: &str, got: &str| Error::invalid("--state", expected, got);
    let text = asked.unwrap_or(OWN);
    let split: Vec<&str> = text.split(',').map(str::trim).collect();
    let [x, y, theta] = split[..] else {
        return Err(refused("three names, of x, y and the angle: x:m,y:m,yaw:rad", text));
    };
    let (mut axes, mut factors) = ([0; 3], [0.0; 3]);
    for (axis, (named, units)) in [(x, &LENGTHS[..]), (y, &LENGTHS), (theta, &ANGLES)].into_iter().enumerate() {
        let (name, unit) = named.split_once(':').unwrap_or((named, named.rsplit(['_', '.']).next().unwrap_or(named)));
        let known = units.iter().find(|(known, _)| *known == unit);
        let listed = || units.iter().map(|(known, _)| format!("{name}:{known}")).collect::<Vec<_>>().join(", ");
        factors[axis] = known.ok_or_else(|| refused(&format!("a unit, {}", listed()), named))?.1;
        let at = names.iter().position(|own| own == name);
        axes[axis] = at.ok_or_else(|| refused(&format!("names of {STATE}: {}", names.join(", ")), name))?;
    }
    Ok(Some(State { column: STATE.into(), len: names.len(), axes, units: factors }))
}

/// The names of a feature's values, which some sets nest under the name of an axis.
fn names(feature: &Feature) -> Vec<String> {
    let list = match &feature.names {
        Value::Object(named) if named.len() == 1 => named.values().next(),
        names => Some(names),
    };
    let texts =
        list.and_then(Value::as_array).map(|list| list.iter().filter_map(Value::as_str).map(str::to_owned).collect());
    texts.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn feature(names: Value) -> Feature {
        Feature { dtype: "float32".into(), shape: vec![4], names, info: None }
    }

    #[test]
    fn names_and_units_are_found_where_they_stand() {
        let arm = feature(json!({"axes": ["x", "y", "z", "yaw"]}));
        let state = find(Some(&arm), Some("x:m, y:cm, yaw:rad")).unwrap().unwrap();
        assert_eq!((state.axes, state.len), ([0, 1, 3], 4));
        assert_eq!((state.units[0], state.units[1]), (1000.0, 10.0));
        assert!((state.units[2] - 57.295_779_513).abs() < 1e-9);
        assert_eq!(find(Some(&arm), None).unwrap(), None);
        let own = feature(json!(["theta_deg", "x_mm", "y_mm"]));
        assert_eq!(find(Some(&own), None).unwrap().unwrap().axes, [1, 2, 0]);
        assert_eq!(find(None, None).unwrap(), None);
    }

    #[test]
    fn what_is_not_there_or_has_no_unit_is_named() {
        let arm = feature(json!(["x", "y", "yaw_deg"]));
        let refused = |text: &str| find(Some(&arm), Some(text)).unwrap_err().to_string();
        assert!(refused("x:m,y:m").contains("three names"));
        assert_eq!(refused("x,y:m,yaw_deg"), "--state: expected a unit, x:mm, x:cm, x:m, got x");
        assert_eq!(refused("x:m,y:m,yaw:deg"), "--state: expected names of observation.state: x, y, yaw_deg, got yaw");
    }
}

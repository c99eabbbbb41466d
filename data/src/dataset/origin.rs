//! What touches were made of: parts and sensor, so that a bank can refuse a scene that does not fit it.

use serde::{Deserialize, Serialize};

/// Where recorded or simulated touches come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Name of the scene or dataset, for people.
    pub name: String,
    /// The parts, in order.
    pub parts: Vec<PartOrigin>,
    /// The sensor.
    pub sensor: SensorOrigin,
}

/// A part that was touched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartOrigin {
    /// Its name.
    pub name: String,
    /// Width and height of its outline, mm; `None` where it was not measured.
    pub size_mm: Option<[f64; 2]>,
}

/// A sensor that touched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorOrigin {
    /// Width and height of what a frame shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// What identifies its lamps: the start of the SHA-256 of their description; `None` where it is not known.
    pub light: Option<String>,
    /// Whether its pictures were brought under the lamps that the network knows: then other lamps are no difference.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_relit: bool,
}

/// The name of the lamps that the network knows.
const KNOWN_LAMPS: &str = "mini-table";

impl SensorOrigin {
    /// Whether the network saw its pictures under the lamps that it knows.
    fn is_as_known(&self) -> bool {
        self.is_relit || self.light.as_deref() == Some(KNOWN_LAMPS)
    }
}

/// Sizes that differ by less are equal, mm: the rounding of outlines.
const SIZE_TOLERANCE_MM: f64 = 0.02;

/// Fields of view that differ by less than this share are equal: another driver's crop differs by more.
const SCALE_TOLERANCE: f64 = 0.01;

impl Origin {
    /// The first thing in which the parts differ from the parts of `other`: what it is, here and there. What is unknown
    /// differs from nothing.
    pub fn other_parts(&self, other: &Self) -> Option<[String; 3]> {
        let names = |origin: &Self| origin.parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>().join(" ");
        if names(self) != names(other) {
            return Some(["parts".into(), names(self), names(other)]);
        }
        let sizes = self.parts.iter().zip(&other.parts).filter_map(|(a, b)| Some((a, a.size_mm?, b.size_mm?)));
        let is_other = |(a, b): (&f64, &f64)| (a - b).abs() > SIZE_TOLERANCE_MM;
        let differing = sizes.into_iter().find(|(_, a, b)| a.iter().zip(b).any(is_other));
        let mm = |[width, height]: [f64; 2]| format!("{width:.2} x {height:.2} mm");
        differing.map(|(part, a, b)| [format!("size of part {}", part.name), mm(a), mm(b)])
    }

    /// How a field of view differs from the sensor's, as [`Self::other_parts`].
    pub fn other_scale(&self, field_of_view_mm: [f64; 2]) -> Option<[String; 3]> {
        let sensor = SensorOrigin { field_of_view_mm, light: None, is_relit: false };
        self.other_sensor(&Self { sensor, ..self.clone() })
    }

    /// The first thing in which the sensor differs from the sensor of `other`, as [`Self::other_parts`].
    pub fn other_sensor(&self, other: &Self) -> Option<[String; 3]> {
        let (a, b) = (&self.sensor, &other.sensor);
        let is_other = |(a, b): (&f64, &f64)| (a / b - 1.0).abs() > SCALE_TOLERANCE;
        if a.field_of_view_mm.iter().zip(&b.field_of_view_mm).any(is_other) {
            let mm = |[width, height]: [f64; 2]| format!("{width} x {height} mm");
            return Some(["field of view".into(), mm(a.field_of_view_mm), mm(b.field_of_view_mm)]);
        }
        match (&a.light, &b.light) {
            (Some(here), Some(there))
                if (here != there || a.is_relit != b.is_relit) && !(a.is_as_known() && b.is_as_known()) =>
            {
                Some(["lamps".into(), here.clone(), there.clone()])
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(names: &str, size_mm: Option<[f64; 2]>, field_of_view_mm: [f64; 2], light: Option<&str>) -> Origin {
        let part = |name: char| PartOrigin { name: name.into(), size_mm };
        let sensor = SensorOrigin { field_of_view_mm, light: light.map(Into::into), is_relit: false };
        Origin { name: "any".into(), parts: names.chars().map(part).collect(), sensor }
    }

    #[test]
    fn what_differs_is_named_with_both_values() {
        let mine = origin("AB", Some([10.0, 12.0]), [18.6, 14.3], Some("mini-table"));
        assert_eq!((mine.other_parts(&mine), mine.other_sensor(&mine)), (None, None));
        let others = [
            (origin("AC", Some([10.0, 12.0]), [18.6, 14.3], None), ["parts", "A B", "A C"]),
            (
                origin("AB", Some([10.0, 12.5]), [18.6, 14.3], None),
                ["size of part A", "10.00 x 12.00 mm", "10.00 x 12.50 mm"],
            ),
        ];
        for (other, expected) in others {
            assert_eq!(mine.other_parts(&other).unwrap(), expected);
        }
        let wide = origin("AB", None, [20.3, 15.2], Some("mini-table"));
        assert_eq!(mine.other_sensor(&wide).unwrap(), ["field of view", "18.6 x 14.3 mm", "20.3 x 15.2 mm"]);
        let lit = origin("AB", None, [18.6, 14.3], Some("cmu"));
        assert_eq!(mine.other_sensor(&lit).unwrap(), ["lamps", "mini-table", "cmu"]);
        let relit = Origin { sensor: SensorOrigin { is_relit: true, ..lit.sensor.clone() }, ..lit.clone() };
        assert_eq!((mine.other_sensor(&relit), lit.other_sensor(&relit).is_some()), (None, true));
    }

    #[test]
    fn what_is_unknown_differs_from_nothing() {
        let mine = origin("AB", Some([10.0, 12.0]), [18.6, 14.3], Some("mini-table"));
        let unknown = origin("AB", None, [18.61, 14.3], None);
        assert_eq!((mine.other_parts(&unknown), mine.other_sensor(&unknown)), (None, None));
    }
}

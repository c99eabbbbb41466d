//! What every drawing on a part shares: its outline, its frame, lengths and poses.

use maud::{Markup, PreEscaped};
use tactile_data::pose::se2::Se2;

/// A reference to the outline of a part, which `rows::outlines` defines.
pub fn outline(part: usize) -> Markup {
    PreEscaped(format!(r##"<use href="#part-{part}" class="part"></use>"##))
}

/// A square view around the part's origin.
pub fn view_box(half_mm: f64) -> String {
    format!("{0:.1} {0:.1} {1:.1} {1:.1}", -half_mm, 2.0 * half_mm)
}

/// Where something of the sensor is drawn on the part.
pub fn transform(part_from_sensor: &Se2) -> String {
    let Se2 { x_mm, y_mm, .. } = part_from_sensor;
    format!("translate({x_mm:.2} {y_mm:.2}) rotate({:.1})", part_from_sensor.theta_deg())
}

/// A length on a part, mm.
pub fn mm(value: f64) -> String {
    format!("{value:.2}")
}

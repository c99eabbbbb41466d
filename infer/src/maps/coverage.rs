//! How much of a part's outline touches showed: a stranger may have all of that in common with it, and differ in the rest.

use tactile_data::pose::se2::Se2;

use super::align::Drawing;
use super::mosaic::{CELL_MM, Mosaic};

/// What is as near as this to the edge of a touch's view counts as not in view, mm: a piece that begins there shows too little to differ
/// from a part that ends there.
const MARGIN_MM: f64 = 2.0;

/// The view of a touch: where it was made, and how far to either side of that it shows what is there.
#[derive(Clone, Copy, Debug)]
pub struct View {
    sensor_from_frame: Se2,
    half_mm: [f64; 2],
}

impl View {
    /// The view of a sensor at a pose in some frame, whose pictures show `view_mm`.
    pub fn of(frame_from_sensor: &Se2, view_mm: [f64; 2]) -> Self {
        Self { sensor_from_frame: frame_from_sensor.inverse(), half_mm: view_mm.map(|mm| 0.5 * mm - MARGIN_MM) }
    }

    /// Whether a place of that frame, mm, is in view.
    pub fn shows(&self, place_mm: [f64; 2]) -> bool {
        let seen = self.sensor_from_frame.apply(place_mm);
        (0..2).all(|axis| seen[axis].abs() <= self.half_mm[axis])
    }
}

/// The views of touches, in a frame in which the first one was made at a pose.
pub fn views(touches: &[Drawing<'_>], frame_from_first: &Se2) -> Vec<View> {
    let view = |touch: &Drawing<'_>| View::of(&(*frame_from_first * touch.first_from_sensor), touch.map.view_mm);
    touches.iter().map(view).collect()
}

/// The length of the outline on a mosaic, mm: in all, and of that what is in view of touches. `part_from_first`: where the first touch
/// was made.
pub fn outline_mm(mosaic: &Mosaic<'_>, touches: &[Drawing<'_>], part_from_first: &Se2) -> [f64; 2] {
    let (views, outline_mm) = (views(touches, part_from_first), mosaic.outline_mm());
    let is_felt = |place_mm: &&[f64; 2]| views.iter().any(|view| view.shows(**place_mm));
    [outline_mm.len(), outline_mm.iter().filter(is_felt).count()].map(|n| n as f64 * CELL_MM)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use tactile_data::dataset::touch::Side;

    use super::super::mosaic::tests::{map, mosaics, outline};
    use super::{Drawing, Se2, outline_mm};

    /// The length of the outline itself, and of what is within boxes, by a walk round it. Where the test's distance changes faster
    /// than one does, the strip is narrower.
    fn walked(boxes: &[Se2]) -> [f64; 2] {
        let at = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / 2_000.0).sin_cos();
            // From the middle outwards the distance grows: halve.
            let (mut low, mut high) = (0.0, 12.0);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                *if outline([cos * middle, sin * middle]) < 0.0 { &mut low } else { &mut high } = middle;
            }
            [cos * low, sin * low]
        };
        let mut sums = [0.0; 2];
        for k in 0..2_000 {
            let ([x, y], [to_x, to_y]) = (at(k), at(k + 1));
            let slope =
                [[0.01, 0.0], [0.0, 0.01]].map(|[u, v]| (outline([x + u, y + v]) - outline([x - u, y - v])) / 0.02);
            let mm = (to_x - x).hypot(to_y - y) / slope[0].hypot(slope[1]);
            sums[0] += mm;
            let is_felt = boxes.iter().any(|pose| {
                let [u, v] = pose.inverse().apply([x, y]);
                u.abs() <= 9.3 - 2.0 && v.abs() <= 7.15 - 2.0
            });
            sums[1] += if is_felt { mm } else { 0.0 };
        }
        sums
    }

    #[test]
    fn what_touches_show_of_an_outline_is_as_long_as_a_walk_along_it() {
        let mosaics = mosaics();
        let first = Se2::from_degrees(7.0, -5.0, 71.0);
        let moved = Se2::from_degrees(-6.0, 2.0, 40.0);
        let maps = [map(&first, 0.1), map(&(first * moved), 0.1)];
        let touches = [
            Drawing { map: &maps[0], first_from_sensor: Se2::IDENTITY },
            Drawing { map: &maps[1], first_from_sensor: moved },
        ];
        for n in 0..=2 {
            let found = outline_mm(&mosaics.of(0, Side::Peg), &touches[..n], &first);
            let expected = walked(&[first, first * moved][..n]);
            for (found, expected) in found.iter().zip(expected) {
                // Five cells: where it is steep the strip is narrower than a cell.
                assert!((found - expected).abs() < 1.5, "{n}: {found} {expected}");
            }
        }
    }
}

//! A finite board with a scene's parts on it.

use serde::{Deserialize, Serialize};

use super::part::Part;
use crate::error::{Error, Result};
use crate::scene::shape::relief::rectangle;
use crate::scene::shape::{Raster, Shape};

/// The largest side of a board, mm.
const MAX_SIDE_MM: f64 = 1_000.0;

/// Cell in which parts are compared with each other, mm: finer than a pixel.
const CELL_MM: f64 = 0.05;

/// A board, and where the parts' centres are on it: mm from its middle, x right and y down as the sensor
/// sees it. Either `at_mm` or `spacing_mm` is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Width and height, mm.
    pub size_mm: [f64; 2],
    /// The place of each part, in the parts' order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_mm: Option<Vec<[f64; 2]>>,
    /// Distance of the parts in x and y: they are in rows, as many in a row as the board takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<[f64; 2]>,
}

impl Board {
    /// Where the parts' centres are, mm from the board's middle.
    pub(super) fn places_mm(&self, n_parts: usize) -> Result<Vec<[f64; 2]>> {
        match (&self.at_mm, self.spacing_mm) {
            (Some(at_mm), None) if at_mm.len() == n_parts => Ok(at_mm.clone()),
            (Some(at_mm), None) => Err(Error::invalid(
                "board.at_mm",
                format!("a place for each of {n_parts} parts"),
                at_mm.len().to_string(),
            )),
            (None, Some(spacing_mm)) => {
                if !spacing_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
                    return Err(Error::invalid("board.spacing_mm", "positive lengths", format!("{spacing_mm:?}")));
                }
                let n_columns = ((self.size_mm[0] / spacing_mm[0]) as usize).clamp(1, n_parts.max(1));
                let n_rows = n_parts.div_ceil(n_columns);
                let place = |i: usize, n: usize, spacing_mm: f64| (i as f64 - 0.5 * (n - 1) as f64) * spacing_mm;
                let at = |i: usize| {
                    [place(i % n_columns, n_columns, spacing_mm[0]), place(i / n_columns, n_rows, spacing_mm[1])]
                };
                Ok((0..n_parts).map(at).collect())
            }
            (Some(_), Some(_)) => Err(Error::invalid("board", "at_mm or spacing_mm", "both")),
            (None, None) => Err(Error::invalid("board", "at_mm or spacing_mm", "none")),
        }
    }

    /// The board's outline round a part at `place_mm`.
    pub(super) fn outline_round(&self, [x, y]: [f64; 2]) -> Shape {
        let [half_x, half_y] = self.size_mm.map(|mm| 0.5 * mm);
        rectangle([-half_x - x, -half_y - y, half_x - x, half_y - y])
    }

    /// Refuses a board without size, parts that are not on it, and parts that overlap, naming the part.
    pub(super) fn validate(&self, names: &[String], parts: &[Part]) -> Result<()> {
        let [width, height] = self.size_mm;
        if !self.size_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0 && *mm <= MAX_SIDE_MM) {
            let expected = format!("0 to {MAX_SIDE_MM} mm each way");
            return Err(Error::invalid("board.size_mm", expected, format!("{width} x {height}")));
        }
        let n_standing = parts.iter().filter(|part| part.stands).count();
        if n_standing != 0 && n_standing != parts.len() {
            return Err(Error::invalid("board", "either connectors, which stand on it, or holes in it", "both"));
        }
        let places = self.places_mm(parts.len())?;
        let mut boxes: Vec<[f64; 4]> = Vec::with_capacity(parts.len());
        for ((name, part), [x, y]) in names.iter().zip(parts).zip(&places) {
            let [x_min, y_min, x_max, y_max] = part.bounds();
            let (part_width, part_height) = (x_max - x_min, y_max - y_min);
            if part_width > width || part_height > height {
                let expected = format!("room for {name}: {part_width:.1} x {part_height:.1} mm with its clearance");
                return Err(Error::invalid("board.size_mm", expected, format!("{width} x {height} mm")));
            }
            let here = [x + x_min, y + y_min, x + x_max, y + y_max];
            let within = here[0] >= -0.5 * width && here[2] <= 0.5 * width;
            if !(within && here[1] >= -0.5 * height && here[3] <= 0.5 * height) {
                let expected = format!("{name} on the board of {width} x {height} mm");
                return Err(Error::invalid("board", expected, format!("its middle at {x}, {y} mm")));
            }
            boxes.push(here);
        }
        for (i, first) in boxes.iter().enumerate() {
            for (j, second) in boxes.iter().enumerate().skip(i + 1) {
                let common = [
                    first[0].max(second[0]),
                    first[1].max(second[1]),
                    first[2].min(second[2]),
                    first[3].min(second[3]),
                ];
                let boxes_meet = common[0] < common[2] && common[1] < common[3];
                if boxes_meet && overlap([(&parts[i], places[i]), (&parts[j], places[j])], common) {
                    let got = format!("{} on {}", names[i], names[j]);
                    return Err(Error::invalid("board", "parts that do not overlap, with their clearance", got));
                }
            }
        }
        Ok(())
    }
}

/// Whether two parts share a cell of the box that both reach into; one may be in a counter of the other.
fn overlap(parts: [(&Part, [f64; 2]); 2], [x_min, y_min, x_max, y_max]: [f64; 4]) -> bool {
    let middle = [0.5 * (x_min + x_max), 0.5 * (y_min + y_max)];
    let half_mm = 0.5 * (x_max - x_min).max(y_max - y_min) + CELL_MM;
    let [first, second] = parts.map(|(part, place)| {
        let offset = [0, 1].map(|axis| place[axis] - middle[axis]);
        let moved = part.footprint().map(|[x, y]| [x + offset[0], y + offset[1]]);
        let distance = Raster::distance(&moved, half_mm, CELL_MM, part.clearance_mm + CELL_MM);
        distance.values.into_iter().map(move |away| f64::from(away) < part.clearance_mm)
    });
    first.zip(second).any(|(a, b)| a && b)
}

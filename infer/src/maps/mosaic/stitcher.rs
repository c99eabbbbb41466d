//! How a mosaic is made: the maps of touches, laid over each other at their poses.

use tactile_data::dataset::touch::OUTLINE_REACH_MM;
use tactile_data::pose::se2::Se2;

use super::corners::Corners;
use super::{CELL_MM, Cell, MOST_CELLS, cells_off};
use crate::maps::DrawnMap;
use crate::maps::align::Drawing;

/// Lays the maps of a part's touches over each other.
#[derive(Clone, Debug)]
pub struct Stitcher {
    pub(super) n: usize,
    cell_mm: f64,
    sums: Vec<Sums>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Sum of the weights of the distances: each counts by how sure it is.
    weights: f64,
    distances: f64,
    squares: f64,
    insides: f64,
    contacts: f64,
    n: f64,
}

/// How far from a part's origin touches that are made so far from it show something, mm.
fn reach_mm(farthest_mm: f64, [width, height]: [f64; 2]) -> f64 {
    farthest_mm + 0.5 * width.hypot(height)
}

impl Stitcher {
    /// For touches that are made so far from a part's origin and show so much, mm.
    pub fn around(farthest_mm: f64, view_mm: [f64; 2]) -> Self {
        Self::new(reach_mm(farthest_mm, view_mm))
    }

    /// For a part that reaches so far from its origin, mm.
    pub fn new(half_mm: f64) -> Self {
        Self::of_cells(half_mm, CELL_MM)
    }

    fn of_cells(half_mm: f64, cell_mm: f64) -> Self {
        let n = (2.0 * half_mm / cell_mm).ceil().clamp(2.0, MOST_CELLS as f64) as usize;
        Self { n, cell_mm, sums: vec![Sums::default(); n * n] }
    }

    /// Touches of one part, laid at its pose; `None` without any.
    pub fn of_touches(touches: &[Drawing<'_>], part_from_first: &Se2) -> Option<Self> {
        Self::laid(touches, part_from_first, CELL_MM)
    }

    /// The same in cells of this side, mm.
    pub(super) fn laid(touches: &[Drawing<'_>], part_from_first: &Se2, cell_mm: f64) -> Option<Self> {
        let view_mm = touches.first()?.map.view_mm;
        let poses: Vec<Se2> = touches.iter().map(|touch| *part_from_first * touch.first_from_sensor).collect();
        let farthest = poses.iter().map(|pose| pose.x_mm.abs().max(pose.y_mm.abs())).fold(0.0, f64::max);
        let mut stitcher = Self::of_cells(reach_mm(farthest, view_mm), cell_mm);
        touches.iter().zip(&poses).for_each(|(touch, pose)| stitcher.add(touch.map, pose));
        Some(stitcher)
    }

    /// Adds a touch: its map, and where it was made.
    pub fn add(&mut self, map: &DrawnMap, part_from_sensor: &Se2) {
        let ([width, height], view_mm) = (map.size_px, map.view_mm);
        let sensor_from_part = part_from_sensor.inverse();
        let reach = 0.5 * view_mm[0].hypot(view_mm[1]);
        let cells = |mm: f64| {
            let cell = |mm: f64| (mm / self.cell_mm + 0.5 * self.n as f64).clamp(0.0, self.n as f64) as usize;
            cell(mm - reach)..cell(mm + reach + self.cell_mm)
        };
        let (rows, columns) = (cells(part_from_sensor.y_mm), cells(part_from_sensor.x_mm));
        for row in rows {
            for column in columns.clone() {
                let at = sensor_from_part.apply([column, row].map(|cell| self.middle_mm(cell)));
                let place = [0, 1].map(|axis| (at[axis] / view_mm[axis] + 0.5) * map.size_px[axis] as f64 - 0.5);
                let is_seen = (0..2).all(|axis| (0.0..=(map.size_px[axis] - 1) as f64).contains(&place[axis]));
                if !is_seen {
                    continue;
                }
                let corners = Corners::of(place, [width, height]);
                let between = |values: &[f32]| f64::from(corners.between(|at| values[at]));
                let weight = between(&map.error_mm).powi(-2);
                let sum = &mut self.sums[row * self.n + column];
                sum.weights += weight;
                let mm = between(&map.distance_mm);
                sum.distances += weight * mm;
                sum.squares += weight * mm * mm;
                sum.insides += between(&map.inside);
                sum.contacts += between(&map.contact);
                sum.n += 1.0;
            }
        }
    }

    /// Where the middle of a cell is along an axis, from the part's origin, mm.
    pub(super) fn middle_mm(&self, cell: usize) -> f64 {
        cells_off(self.n, cell) * self.cell_mm
    }

    /// `[n, n]`.
    pub(super) fn cells(&self) -> impl Iterator<Item = Cell> {
        self.sums.iter().map(|sum| {
            if sum.n == 0.0 {
                return [OUTLINE_REACH_MM as f32, 0.0, 0.0, OUTLINE_REACH_MM as f32, 0.0];
            }
            let mm = sum.distances / sum.weights;
            let apart = (sum.squares / sum.weights - mm * mm).max(0.0);
            // What one touch gets wrong the next does, too: their mean is no surer than one of them.
            let error = (apart + sum.n / sum.weights).sqrt();
            [mm, sum.insides / sum.n, sum.contacts / sum.n, error, sum.n].map(|value| value as f32)
        })
    }
}

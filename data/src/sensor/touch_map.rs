//! What a touch shows of its part, place by place: what a network learns to draw from the touch's picture.
//!
//! A picture changes with the sensor and with the angle at which its lamps stand to the part; a map is in millimetres of the
//! part, so that maps of two touches can be laid over each other, and over a map of the whole part.

use std::sync::OnceLock;

use crate::dataset::touch::{OUTLINE_REACH_MM, Side};
use crate::error::{Error, Result};
use crate::pose::se2::Se2;
use crate::scene::shape::Raster;
use crate::sensor::obstacle::{Cells, obstacle};
use crate::sensor::simulator::Simulator;

/// Side of a cell in which parts are kept, mm: a fifth of a map's at 40 x 30 pixels.
const CELL_MM: f64 = 0.1;

/// Places along each side of a pixel at which contact is looked at.
const LOOKS: usize = 3;

/// What one touch shows, `[height, width]` each, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchMap {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// How far each place is from the outline of the part's peg, mm: negative inside, [`OUTLINE_REACH_MM`] at most either way. The same
    /// of a hole, which is wider by its play.
    pub distance_mm: Vec<f32>,
    /// The share of each pixel that touches the gel, 0..=1: of a peg its face, of a shell its wall, of a hole the plate round it.
    pub contact: Vec<f32>,
}

/// Makes maps of the touches of a scene's parts. What a part needs is computed when it is first asked for, and kept.
#[derive(Debug)]
pub struct TouchMaps<'a> {
    simulator: &'a Simulator,
    outlines: Vec<OnceLock<Result<Grid<i16>>>>,
    /// Where each side of each part touches the gel.
    sides: Vec<[OnceLock<Result<Grid<bool>>>; 2]>,
}

/// A raster of small values: a set of boards has hundreds of them. Distances are kept in micrometres.
#[derive(Debug)]
struct Grid<T> {
    n: usize,
    cells: Vec<T>,
}

impl<T> Grid<T> {
    fn of(raster: &Raster, value: impl Fn(f32) -> T) -> Self {
        Self { n: raster.n, cells: raster.values.iter().copied().map(value).collect() }
    }

    /// The place of a cell's centre along an axis, in cells; beyond the border the border is repeated.
    fn place(&self, mm: f64) -> f64 {
        (mm / CELL_MM + 0.5 * self.n as f64 - 0.5).clamp(0.0, (self.n - 1) as f64)
    }
}

const MICROMETRES: f32 = 1e3;

impl Grid<i16> {
    /// Between the four cells round a place, mm.
    fn between(&self, place_mm: [f64; 2]) -> f32 {
        let [x, y] = place_mm.map(|mm| self.place(mm));
        let [left, top] = [x, y].map(|v| (v as usize).min(self.n.saturating_sub(2)));
        let [across, down] = [x - left as f64, y - top as f64].map(|share| share as f32);
        let cell = |dy: usize, dx: usize| f32::from(self.cells[(top + dy) * self.n + left + dx]);
        let line = |dy: usize| (1.0 - across) * cell(dy, 0) + across * cell(dy, 1);
        ((1.0 - down) * line(0) + down * line(1)) / MICROMETRES
    }
}

impl Grid<bool> {
    fn nearest(&self, place_mm: [f64; 2]) -> bool {
        let [x, y] = place_mm.map(|mm| self.place(mm).round() as usize);
        self.cells[y * self.n + x]
    }
}

impl<'a> TouchMaps<'a> {
    /// For the parts of a simulated scene.
    pub fn new(simulator: &'a Simulator) -> Self {
        let n_parts = simulator.parts().len();
        let (outlines, sides) = (0..n_parts).map(|_| (OnceLock::new(), Default::default())).unzip();
        Self { simulator, outlines, sides }
    }

    /// The map of a touch, in the pixels of the sensor that feels this side of the part.
    ///
    /// # Errors
    /// No such part, one that cannot be pressed, or a pose that is not finite.
    pub fn of(&self, part: usize, side: Side, part_from_sensor: &Se2, size_px: [usize; 2]) -> Result<TouchMap> {
        let Some(name) = self.simulator.parts().get(part) else {
            let expected = format!("one of {} parts", self.outlines.len());
            return Err(Error::invalid("part", expected, part.to_string()));
        };
        if !part_from_sensor.is_finite() {
            return Err(Error::invalid("touch", "a finite pose", format!("{part_from_sensor:?}")));
        }
        let (scene, seed) = (self.simulator.scene(), self.simulator.board_seed());
        let spec = self.simulator.sensor_of(part, side);
        let cells = Cells { half_mm: scene.half_extent_mm(), cell_mm: CELL_MM };
        let outline = || {
            let distance = Raster::distance(&scene.shape(part, seed)?, cells.half_mm, CELL_MM, OUTLINE_REACH_MM);
            Ok(Grid::of(&distance, |mm| (mm * MICROMETRES).round() as i16))
        };
        let touching = || {
            let depth = obstacle(&scene.reliefs(part, side, seed)?, side, cells, None, spec.depth_mm);
            Ok(Grid::of(&depth, |mm| mm > 0.0))
        };
        let outline = self.outlines[part].get_or_init(outline);
        let touching = self.sides[part][usize::from(side == Side::Peg)].get_or_init(touching);
        let (outline, touching) = match (outline, touching) {
            (Ok(outline), Ok(touching)) => (outline, touching),
            (Err(e), _) | (_, Err(e)) => {
                return Err(Error::invalid(name, "a part that can be pressed", e.to_string()));
            }
        };

        let [width, height] = size_px;
        let mm_per_px = [0, 1].map(|axis| spec.field_of_view_mm[axis] / size_px[axis] as f64);
        let place = |column: f64, row: f64| {
            let from_middle = [column - 0.5 * width as f64, row - 0.5 * height as f64];
            part_from_sensor.apply([0, 1].map(|axis| from_middle[axis] * mm_per_px[axis]))
        };
        let (mut distance_mm, mut contact) = (Vec::new(), Vec::new());
        for row in 0..height {
            for column in 0..width {
                let (column, row) = (column as f64, row as f64);
                distance_mm.push(outline.between(place(column + 0.5, row + 0.5)));
                let look = |n: usize| (n as f64 + 0.5) / LOOKS as f64;
                let looks = (0..LOOKS * LOOKS).map(|n| place(column + look(n % LOOKS), row + look(n / LOOKS)));
                let n_touching = looks.filter(|place| touching.nearest(*place)).count();
                contact.push(n_touching as f32 / (LOOKS * LOOKS) as f32);
            }
        }
        Ok(TouchMap { size_px, distance_mm, contact })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Kit, Parts, Scene, Solids};

    /// The places of a map's pixels on a block of 12 x 4 mm, the map of one side of it, and the play of its hole.
    fn map_of_a_block(side: Side) -> (Vec<[f64; 2]>, TouchMap, f64) {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        let solids = Solids { names: vec!["cuboid:12x4".parse().unwrap()] };
        scene.parts = Parts::Kit(Kit { solids: Some(solids), ..Kit::default() });
        let clearance_mm = scene.clearance_mm;
        let simulator = Simulator::new(scene, 1).unwrap();
        let pose = Se2::from_degrees(0.7, -0.4, 63.0);
        let map = TouchMaps::new(&simulator).of(0, side, &pose, [20, 15]).unwrap();
        let [width, height] = simulator.sensor_of(0, side).field_of_view_mm;
        let place = |i: usize| {
            let [x, y] = [(i % 20) as f64 + 0.5 - 10.0, (i / 20) as f64 + 0.5 - 7.5];
            pose.apply([x * width / 20.0, y * height / 15.0])
        };
        ((0..300).map(place).collect(), map, clearance_mm)
    }

    /// How far a place is from the outline of the block, negative inside.
    fn from_block([x, y]: [f64; 2]) -> f64 {
        let [x, y] = [x.abs() - 6.0, y.abs() - 2.0];
        x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
    }

    #[test]
    fn distances_are_those_of_the_peg_on_either_side() {
        for side in [Side::Peg, Side::Hole] {
            let (places, map, _) = map_of_a_block(side);
            assert_eq!((map.size_px, map.distance_mm.len(), map.contact.len()), ([20, 15], 300, 300));
            for (place, found) in places.iter().zip(&map.distance_mm) {
                let expected = from_block(*place).clamp(-OUTLINE_REACH_MM, OUTLINE_REACH_MM);
                // Between cells of 0.1 mm a ridge is cut off by half a cell at most.
                assert!((f64::from(*found) - expected).abs() < 0.05, "{place:?}: {found} {expected}");
            }
        }
    }

    #[test]
    fn the_pegs_face_touches_and_the_plate_round_the_hole() {
        for side in [Side::Peg, Side::Hole] {
            let (places, map, clearance_mm) = map_of_a_block(side);
            let mut n_judged = [0, 0];
            for (place, found) in places.iter().zip(&map.contact) {
                let outside = match side {
                    Side::Peg => from_block(*place),
                    Side::Hole => clearance_mm - from_block(*place),
                };
                // Half the diagonal of a pixel and of a cell: nearer to the edge a pixel touches in part.
                if outside.abs() > 0.75 {
                    assert_eq!(*found, if outside < 0.0 { 1.0 } else { 0.0 }, "{side} {place:?}");
                    n_judged[usize::from(outside < 0.0)] += 1;
                }
            }
            assert!(n_judged.iter().all(|n| *n > 20), "{n_judged:?}");
            // The areas: 48 mm2 of the peg are in view, and as much is open where its hole is.
            let touching: f64 = map.contact.iter().map(|share| f64::from(*share)).sum();
            let [pixel, all] = [18.6 * 14.3 / 300.0, 18.6 * 14.3];
            let expected = match side {
                Side::Peg => 48.0,
                Side::Hole => all - (12.0 + 2.0 * clearance_mm) * (4.0 + 2.0 * clearance_mm),
            };
            assert!((touching * pixel - expected).abs() < 1.5, "{side}: {} {expected}", touching * pixel);
        }
    }

    #[test]
    fn what_cannot_be_touched_is_refused() {
        let simulator = Simulator::new(Scene::preset("alphabet-small").unwrap(), 1).unwrap();
        let maps = TouchMaps::new(&simulator);
        assert!(maps.of(12, Side::Peg, &Se2::IDENTITY, [20, 15]).unwrap_err().to_string().contains("one of 12 parts"));
        let nowhere = Se2::new(f64::NAN, 0.0, 0.0);
        assert!(maps.of(0, Side::Peg, &nowhere, [20, 15]).unwrap_err().to_string().contains("finite"));
    }
}

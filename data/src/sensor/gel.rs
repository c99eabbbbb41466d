//! The gel: an obstacle membrane.
//!
//! Pressed onto a part, the gel's surface is pushed in by `D(x, y) >= 0` mm, which minimises the
//! integral of `D^2 + l^2 |grad D|^2` subject to `D >= obstacle`. Next to a contact `D - l^2 lap D = 0`.
//! It is solved once for a part and side, over all that a scene's views can reach; a touch looks its view
//! up in it.
//!
//! What can be touched of a flat part is at one height: `D` is the press times the solution of a unit
//! press. Any other part is solved at three presses, and `D` between them is linear in the press. A tilt
//! takes the press of each place.
//!
//! What that costs in accuracy, pressed 0.6 mm deep with a decay length of 1.2 mm (this file's tests):
//!
//! | against | root mean square | worst |
//! |---|---|---|
//! | solving a letter's view alone, tilted by 0.7 degrees | 0.002 mm | 0.005 mm |
//! | solving steps and a dome at a press between those solved, 0.24 mm apart | 0.006 mm | 0.024 mm |
//! | cells half as large, a letter's peg | 0.002 mm | 0.024 mm |
//! | cells half as large, a letter's hole | 0.002 mm | 0.038 mm |
//!
//! The worst is where contact begins and at corners. A narrow slit, whose walls are up to a cell behind its
//! outline, is the worst for cells: 1 mm wide its middle is 1.5 % of the press too low.

use multiversion::multiversion;

use super::membrane::membrane;
use super::obstacle::{Cells, obstacle};
use super::rounding::to_whole;
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::pose::se2::Se2;
use crate::scene::shape::{Layer, Raster, Relief};

/// Largest and smallest side of a cell, mm.
const CELL_MM: [f64; 2] = [0.1, 0.025];

/// Cells in one decay length at least, as long as they need not be smaller than the smallest.
const CELLS_PER_LENGTH: f64 = 6.0;

/// Cells along a side at most; a larger board takes larger cells.
const MOST_CELLS: f64 = 2_048.0;

/// The camera's and the gel's own blur, mm.
const BLUR_MM: f64 = 0.06;

/// How deep the gel is pressed in at each place of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiltedPress {
    /// How deep in the view's middle, mm.
    pub depth_mm: f64,
    /// How much deeper for each mm to the right and downwards, mm.
    pub tilt: [f64; 2],
}

impl TiltedPress {
    /// As deep everywhere.
    pub fn level(depth_mm: f64) -> Self {
        Self { depth_mm, tilt: [0.0; 2] }
    }

    /// How deep at a place of the view, from its middle, mm.
    pub fn at(self, x_mm: f64, y_mm: f64) -> f64 {
        self.depth_mm + self.tilt[0] * x_mm + self.tilt[1] * y_mm
    }
}

/// The gel's surface pressed onto one side of one part.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Pushed in at some presses, the presses rising; or at one, to be scaled.
    solved: Vec<(f32, Raster)>,
}

impl Surface {
    /// Solves one side of a part within `half_mm` of its centre, for presses between the lowest and the
    /// highest of `depths_mm` (lowest, nominal, highest). Without a gel length only where there is contact
    /// is computed, the gel staying at rest elsewhere.
    ///
    /// Fails where a length is not positive or not finite, and where the solver does not converge.
    pub fn solve(
        reliefs: &[Relief],
        side: Side,
        half_mm: f64,
        gel_length_mm: Option<f64>,
        depths_mm: [f64; 3],
    ) -> Result<Self> {
        if !(0.5..=500.0).contains(&half_mm) {
            return Err(Error::invalid("surface", "0.5 to 500 mm round the part", format!("{half_mm} mm")));
        }
        if !gel_length_mm.is_none_or(|l| (0.01..=100.0).contains(&l)) {
            return Err(Error::invalid("gel length", "0.01 to 100 mm", format!("{gel_length_mm:?} mm")));
        }
        if !depths_mm.iter().all(|depth| (0.0..=100.0).contains(depth)) || !depths_mm.is_sorted() {
            return Err(Error::invalid("press", "0 to 100 mm, rising", format!("{depths_mm:?} mm")));
        }
        let cells = Cells { half_mm, cell_mm: cell_mm(reliefs, half_mm, gel_length_mm) };
        Self::on_cells(reliefs, side, cells, gel_length_mm, depths_mm)
    }

    fn on_cells(
        reliefs: &[Relief],
        side: Side,
        cells: Cells,
        gel_length_mm: Option<f64>,
        depths_mm: [f64; 3],
    ) -> Result<Self> {
        let press = |depth_mm: f64| {
            let obstacle = obstacle(reliefs, side, cells, gel_length_mm, depth_mm);
            let Some(gel_length_mm) = gel_length_mm else { return Ok((depth_mm as f32, obstacle)) };
            let mut pushed = membrane(&obstacle, gel_length_mm, depth_mm)?;
            blur(&mut pushed);
            Ok((depth_mm as f32, pushed))
        };
        let mut depths_mm = if reliefs.iter().all(Relief::is_flat) { vec![1.0] } else { depths_mm.to_vec() };
        depths_mm.dedup();
        Ok(Self { solved: depths_mm.into_iter().map(press).collect::<Result<_>>()? })
    }

    /// How far the gel is pushed in at each pixel of a view and one pixel round it, mm, never negative:
    /// `[height + 2, width + 2]`, as a sensor at `part_from_sensor` sees it. Beyond the solved area the surface
    /// continues as at its border.
    pub fn depths(
        &self,
        part_from_sensor: &Se2,
        frame_px: [usize; 2],
        mm_per_px: [f64; 2],
        press: TiltedPress,
    ) -> Vec<f32> {
        let [width, height] = frame_px.map(|n| n + 2);
        let Some((_, raster)) = self.solved.first() else { return vec![0.0; width * height] };
        let (sin, cos) = part_from_sensor.theta_rad.sin_cos();
        let step = [cos, sin].map(|v| (v * mm_per_px[0] / raster.cell_mm) as f32);
        let mut depths = vec![0.0; width * height];
        for (row, line) in depths.chunks_exact_mut(width).enumerate() {
            let y_mm = (row as f64 - 0.5 * (height - 1) as f64) * mm_per_px[1];
            let x_mm = -0.5 * (width - 1) as f64 * mm_per_px[0];
            let first = part_from_sensor
                .apply([x_mm, y_mm])
                .map(|mm| (mm / raster.cell_mm + 0.5 * raster.n as f64 - 0.5) as f32);
            let press = [press.at(x_mm, y_mm), press.tilt[0] * mm_per_px[0]].map(|v| v as f32);
            match self.solved.as_slice() {
                [solved] => scaled(line, solved, first, step, press),
                solved => interpolated(line, solved, first, step, press),
            }
        }
        depths
    }
}

/// The memory that one side of a part takes at least, solved within `half_mm` of its centre, bytes.
pub fn least_bytes(half_mm: f64) -> f64 {
    let cell_mm = CELL_MM[0].max(2.0 * half_mm / MOST_CELLS);
    size_of::<f32>() as f64 * (2.0 * half_mm / cell_mm).powi(2)
}

/// The side of a cell, mm: a share of the decay length, and no larger than a pixel of a height map.
fn cell_mm(reliefs: &[Relief], half_mm: f64, gel_length_mm: Option<f64>) -> f64 {
    let maps = reliefs.iter().flat_map(|relief| &relief.layers).filter_map(|layer| match layer {
        Layer::Heights(map) => Some(map.mm_per_px()[0].min(map.mm_per_px()[1])),
        Layer::Face(_) => None,
    });
    let [largest, smallest] = CELL_MM;
    let wanted = gel_length_mm.map_or(largest, |l| l / CELLS_PER_LENGTH);
    maps.fold(wanted, f64::min).clamp(smallest, largest).max(2.0 * half_mm / MOST_CELLS)
}

/// Pixels worked on together.
const LANES: usize = 32;

/// Where some pixels of a row are on a raster: the cell to their upper left, and how far they are past its
/// centre in x and y. Written as loops over lanes, which become vectors.
struct Places {
    cells: [i32; LANES],
    x: [f32; LANES],
    y: [f32; LANES],
}

/// The places of the pixels `from..from + LANES` of a row that starts at `first` and continues by `step`,
/// in cells, kept on the raster.
#[inline(always)]
fn places(n: usize, from: usize, first: [f32; 2], step: [f32; 2]) -> Places {
    let mut places = Places { cells: [0; LANES], x: [0.0; LANES], y: [0.0; LANES] };
    // The last cell that has a neighbour, and that neighbour.
    let (last_cell, last) = (n as f32 - 2.0, n as f32 - 1.0);
    for lane in 0..LANES {
        let t = (from + lane) as i32 as f32;
        let (x, y) = ((first[0] + t * step[0]).clamp(0.0, last), (first[1] + t * step[1]).clamp(0.0, last));
        let (column, row) = (to_whole((x - 0.5).clamp(0.0, last_cell)), to_whole((y - 0.5).clamp(0.0, last_cell)));
        places.cells[lane] = row * n as i32 + column;
        places.x[lane] = x - column as f32;
        places.y[lane] = y - row as f32;
    }
    places
}

/// A raster's values at some places, bilinear between cells.
#[inline(always)]
fn sample(raster: &Raster, places: &Places) -> [f32; LANES] {
    let [mut a, mut b, mut c, mut d] = [[0.0; LANES]; 4];
    for (lane, cell) in places.cells.iter().enumerate() {
        let cell = *cell as usize;
        let (above, below) = (&raster.values[cell..cell + 2], &raster.values[cell + raster.n..cell + raster.n + 2]);
        (a[lane], b[lane], c[lane], d[lane]) = (above[0], above[1], below[0], below[1]);
    }
    let mut values = [0.0; LANES];
    for (lane, value) in values.iter_mut().enumerate() {
        let above = a[lane] + places.x[lane] * (b[lane] - a[lane]);
        let below = c[lane] + places.x[lane] * (d[lane] - c[lane]);
        *value = above + places.y[lane] * (below - above);
    }
    values
}

/// A row of a view of a surface solved at one press: scaled to the press at hand.
#[multiversion(targets("x86_64+avx2"))]
fn scaled(line: &mut [f32], (solved, raster): &(f32, Raster), first: [f32; 2], step: [f32; 2], press: [f32; 2]) {
    let solved = *solved;
    let scale = if solved > 0.0 { press.map(|p| p / solved) } else { [0.0; 2] };
    for (group, pixels) in line.chunks_mut(LANES).enumerate() {
        let unit = sample(raster, &places(raster.n, group * LANES, first, step));
        for (lane, (pixel, unit)) in pixels.iter_mut().zip(unit).enumerate() {
            let here = scale[0] + (group * LANES + lane) as i32 as f32 * scale[1];
            *pixel = unit * here.max(0.0);
        }
    }
}

/// A row of a view of a surface solved at several presses: linear between the two next to the press at
/// hand, and beyond the first and the last as between the nearest two.
#[multiversion(targets("x86_64+avx2"))]
fn interpolated(line: &mut [f32], solved: &[(f32, Raster)], first: [f32; 2], step: [f32; 2], press: [f32; 2]) {
    for (group, pixels) in line.chunks_mut(LANES).enumerate() {
        let places = places(solved[0].1.n, group * LANES, first, step);
        let here: [f32; LANES] = std::array::from_fn(|lane| press[0] + (group * LANES + lane) as f32 * press[1]);
        let mut low = sample(&solved[0].1, &places);
        for (i, pair) in solved.windows(2).enumerate() {
            let (from, to) = (pair[0].0, pair[1].0);
            let high = sample(&pair[1].1, &places);
            for ((pixel, here), (low, high)) in pixels.iter_mut().zip(here).zip(low.iter().zip(high)) {
                if i == 0 || here > from {
                    *pixel = (low + (here - from) / (to - from) * (high - low)).max(0.0);
                }
            }
            low = high;
        }
    }
}

/// Gaussian blur, separable, to three and a half deviations; beyond its border the raster continues.
fn blur(field: &mut Raster) {
    let sigma = BLUR_MM / field.cell_mm;
    let radius = (3.5 * sigma).ceil() as usize;
    let weight = |i: usize| (-0.5 * ((i as f64 - radius as f64) / sigma).powi(2)).exp();
    let total: f64 = (0..=2 * radius).map(weight).sum();
    let kernel: Vec<f32> = (0..=2 * radius).map(|i| (weight(i) / total) as f32).collect();
    let n = field.n;
    let mut padded = vec![0.0_f32; n + 2 * radius];
    for line in field.values.chunks_exact_mut(n) {
        padded[..radius].fill(line[0]);
        padded[radius..radius + n].copy_from_slice(line);
        padded[radius + n..].fill(line[n - 1]);
        line.fill(0.0);
        for (i, weight) in kernel.iter().enumerate() {
            line.iter_mut().zip(&padded[i..]).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    let across = field.values.clone();
    for (row, line) in field.values.chunks_exact_mut(n).enumerate() {
        line.fill(0.0);
        for (i, weight) in kernel.iter().enumerate() {
            let from = (row + i).saturating_sub(radius).min(n - 1) * n;
            line.iter_mut().zip(&across[from..from + n]).for_each(|(sum, value)| *sum += weight * value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::{Face, HeightMap, Shape};

    const L: f64 = 1.2;

    fn box_of(x: [f64; 2], y: [f64; 2]) -> Shape {
        Shape { regions: vec![vec![vec![[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]]] }
    }

    fn peg(shape: Shape, half_mm: f64, gel_length_mm: f64) -> Surface {
        Surface::solve(&[Relief::peg(shape)], Side::Peg, half_mm, Some(gel_length_mm), [0.5, 0.6, 0.7]).unwrap()
    }

    fn hole(shape: Shape, half_mm: f64, gel_length_mm: f64) -> Surface {
        Surface::solve(&[Relief::hole(shape, 0.0)], Side::Hole, half_mm, Some(gel_length_mm), [0.5, 0.6, 0.7]).unwrap()
    }

    /// How far the gel is pushed in at one place by a level press.
    fn at(surface: &Surface, x: f64, y: f64, depth_mm: f64) -> f64 {
        f64::from(surface.depths(&Se2::new(x, y, 0.0), [1, 1], [0.1, 0.1], TiltedPress::level(depth_mm))[4])
    }

    /// A dome on a step on a lower step: nothing flat about it.
    fn knob() -> Vec<Relief> {
        let face = |half: f64, drop_mm| {
            let outline = box_of([-half, half], [-half, half]);
            Layer::Face(Face { drop_mm, ..Face::of(outline) })
        };
        let dome = |i: usize| (i as f32 * 0.1 - 2.45).powi(2);
        let heights: Vec<f32> = (0..2_500).map(|i| -(dome(i % 50) + dome(i / 50)) / 10.0).collect();
        let dome = HeightMap::new([50, 50], [0.1, 0.1], &heights).unwrap();
        let dome = Relief { layers: vec![Layer::Heights(dome)] }.shifted([5.0, 1.0]);
        vec![Relief { layers: vec![face(1.5, 0.0), face(3.0, 0.3)] }, dome]
    }

    #[test]
    fn a_side_takes_the_memory_that_is_said_before() {
        for half_mm in [5.0, 12.3] {
            let surface = peg(box_of([-2.0, 2.0], [-2.0, 2.0]), half_mm, L);
            let kept: usize = surface.solved.iter().map(|(_, raster)| size_of_val(&*raster.values)).sum();
            let ratio = kept as f64 / least_bytes(half_mm);
            assert!((1.0..1.03).contains(&ratio), "{half_mm}: {ratio}");
        }
    }

    #[test]
    fn beside_a_straight_edge_the_gel_decays_exponentially() {
        let surface = peg(box_of([-30.0, 0.0], [-30.0, 30.0]), 20.0, L);
        for s in [0.5_f64, 1.0, 2.0, 3.0] {
            let expected = 0.6 * (-s / L).exp();
            let got = at(&surface, s, 0.0, 0.6);
            // The blur's share is 0.06^2 / (2 l^2), that of the cells' size (0.1 / l)^2 s / (24 l).
            assert!((got - expected).abs() < 0.003 * expected + 1e-4, "at {s} mm: {got}, not {expected}");
        }
    }

    #[test]
    fn a_slit_keeps_its_centre_up_by_the_cosh_law() {
        for half_width in [0.5_f64, 1.0, 2.0] {
            let surface = hole(box_of([-half_width, half_width], [-40.0, 40.0]), 20.0, L);
            let expected = 1.0 / (half_width / L).cosh();
            let got = at(&surface, 0.0, 0.0, 1.0);
            assert!((got - expected).abs() < 0.02, "half width {half_width}: {got}, not {expected}");
            // The wall's slope, 0.3 mm inside: (1/l) sinh(x/l) / cosh(w/l).
            let x = half_width - 0.3;
            let slope = (at(&surface, x + 0.1, 0.0, 1.0) - at(&surface, x - 0.1, 0.0, 1.0)) / 0.2;
            let law = (x / L).sinh() / (half_width / L).cosh() / L;
            assert!((slope - law).abs() < 0.05 * law + 0.02, "slope {slope}, not {law}");
        }
    }

    #[test]
    fn an_empty_frame_leaves_the_gel_flat_and_a_full_plate_presses_it_everywhere() {
        let plate = Relief::peg(box_of([-40.0, 40.0], [-40.0, 40.0]));
        for gel_length in [0.1, L, 10.0] {
            let solve = |reliefs: &[Relief], side| {
                Surface::solve(reliefs, side, 8.0, Some(gel_length), [0.0, 0.6, 3.0]).unwrap()
            };
            let view = |surface: &Surface| {
                surface.depths(&Se2::new(1.0, 2.0, 0.3), [40, 30], [0.3, 0.3], TiltedPress::level(3.0))
            };
            assert!(view(&solve(&[], Side::Peg)).iter().all(|d| *d == 0.0));
            for surface in [solve(&[], Side::Hole), solve(std::slice::from_ref(&plate), Side::Peg)] {
                assert!(view(&surface).iter().all(|d| (*d - 3.0).abs() < 1e-5));
            }
        }
    }

    #[test]
    fn no_press_and_a_deep_one_on_walls_of_one_pixel_stay_between_nought_and_the_press() {
        let mut heights = vec![-5.0_f32; 80 * 80];
        for i in 0..80 {
            (heights[i * 80 + 40], heights[20 * 80 + i]) = (0.0, -0.4);
        }
        let walls = HeightMap::new([80, 80], [0.1, 0.1], &heights).unwrap();
        let walls = [Relief { layers: vec![Layer::Heights(walls)] }];
        let pin = [Relief::peg(box_of([-0.05, 0.05], [-0.05, 0.05]))];
        let slit = [Relief::hole(box_of([-0.03, 0.03], [-3.0, 3.0]), 0.0)];
        for gel_length in [0.1, 10.0] {
            for (reliefs, side) in [(&walls, Side::Peg), (&walls, Side::Hole), (&pin, Side::Peg), (&slit, Side::Hole)] {
                let surface = Surface::solve(reliefs, side, 5.0, Some(gel_length), [0.0, 1.0, 3.0]).unwrap();
                for depth_mm in [0.0, 0.5, 3.0] {
                    let view = surface.depths(&Se2::IDENTITY, [90, 90], [0.1, 0.1], TiltedPress::level(depth_mm));
                    let (low, high) = view.iter().fold((9.0_f32, -9.0_f32), |(l, h), d| (l.min(*d), h.max(*d)));
                    assert!(low >= 0.0 && f64::from(high) <= depth_mm * (1.0 + 1e-5), "{low}..{high} at {depth_mm}");
                    assert!(depth_mm == 0.0 || f64::from(high) > 0.2 * depth_mm);
                }
            }
        }
    }

    #[test]
    fn what_no_gel_can_be_is_refused() {
        let solve = |half_mm, gel_length_mm, depths_mm| {
            Surface::solve(&[], Side::Peg, half_mm, Some(gel_length_mm), depths_mm).unwrap_err().to_string()
        };
        assert!(solve(8.0, f64::NAN, [0.5, 0.6, 0.7]).contains("gel length"));
        assert!(solve(8.0, 0.0, [0.5, 0.6, 0.7]).contains("gel length"));
        assert!(solve(0.0, 1.2, [0.5, 0.6, 0.7]).contains("0.5 to 500 mm"));
        assert!(solve(8.0, 1.2, [0.7, 0.6, 0.5]).contains("rising"));
        assert!(solve(8.0, 1.2, [0.5, 0.6, f64::NAN]).contains("press"));
    }

    #[test]
    fn a_view_turns_with_the_sensor() {
        let surface = peg(box_of([0.0, 5.0], [-1.0, 1.0]), 15.0, L);
        // The bar points right; a sensor turned by 90 degrees sees it point up.
        let view = surface.depths(&Se2::from_degrees(0.0, 0.0, 90.0), [40, 40], [0.25, 0.25], TiltedPress::level(1.0));
        let at = |column: usize, row: usize| view[(row + 1) * 42 + column + 1];
        // 2 mm from the bar the gel is down to exp(-2 / 1.2) = 0.19.
        assert!(at(20, 8) > 0.9 && at(20, 32) < 0.25 && at(8, 20) < 0.25 && at(32, 20) < 0.25);
    }

    #[test]
    fn a_view_reads_the_surface_where_arithmetic_says() {
        let surface = peg(box_of([-2.0, 2.0], [-1.0, 3.0]), 12.0, L);
        let (pose, mm_per_px, tilt) = (Se2::from_degrees(0.8, -0.5, 33.0), [0.17, 0.21], [0.004, -0.006]);
        let view = surface.depths(&pose, [30, 20], mm_per_px, TiltedPress { depth_mm: 0.6, tilt });
        let (_, raster) = &surface.solved[0];
        for (i, got) in view.iter().enumerate() {
            let [x, y] = [((i % 32) as f64 - 15.5) * mm_per_px[0], ((i / 32) as f64 - 10.5) * mm_per_px[1]];
            let [u, v] = pose.apply([x, y]).map(|mm| mm / raster.cell_mm + 0.5 * raster.n as f64 - 0.5);
            let cell = |row: usize, column: usize| f64::from(raster.values[row * raster.n + column]);
            let (row, column) = (v as usize, u as usize);
            let (fx, fy) = (u.fract(), v.fract());
            let unit = (1.0 - fy) * ((1.0 - fx) * cell(row, column) + fx * cell(row, column + 1))
                + fy * ((1.0 - fx) * cell(row + 1, column) + fx * cell(row + 1, column + 1));
            let expected = unit * (0.6 + tilt[0] * x + tilt[1] * y);
            // Places are f32 cells, good to 1e-4 of a cell, over which the unit depth changes by 1e-5.
            assert!((f64::from(*got) - expected).abs() < 2e-5, "{got}, not {expected}");
        }
    }

    /// Largest and root mean square difference, mm.
    fn difference(a: &[f32], b: &[f32]) -> [f64; 2] {
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
        let (worst, sum) = squares.fold((0.0_f64, 0.0), |(worst, sum), square| (worst.max(square), sum + square));
        [worst.sqrt(), (sum / a.len() as f64).sqrt()]
    }

    #[test]
    fn between_solved_presses_a_part_of_several_heights_is_nearly_linear() {
        let knob = knob();
        // Jitter by 0.1 mm, and what half a degree adds in the frame's corner.
        let surface = Surface::solve(&knob, Side::Peg, 12.0, Some(L), [0.36, 0.6, 0.84]).unwrap();
        for depth_mm in [0.36, 0.42, 0.48, 0.54, 0.66, 0.72, 0.78] {
            let alone = Surface::solve(&knob, Side::Peg, 12.0, Some(L), [depth_mm; 3]).unwrap();
            let view = |surface: &Surface| {
                surface.depths(&Se2::new(2.0, 0.0, 0.0), [120, 90], [0.13; 2], TiltedPress::level(depth_mm))
            };
            let [worst, mean] = difference(&view(&surface), &view(&alone));
            assert!(worst < 0.03 && mean < 0.008, "{worst} and {mean} mm at {depth_mm} mm");
        }
    }

    #[test]
    fn one_solution_of_the_board_serves_tilted_views_as_one_of_each_view_does() {
        let letter = crate::scene::shape::glyph::glyph('R', 12.0, 16.0).unwrap();
        let (pose, frame_px, mm_per_px, depth_mm) = (Se2::from_degrees(2.0, 1.0, 30.0), [124, 95], [0.15; 2], 0.6);
        let tilt = [0.5_f64.to_radians().tan(), -0.5_f64.to_radians().tan()];
        for (side, relief) in [(Side::Peg, Relief::peg(letter.clone())), (Side::Hole, Relief::hole(letter, 0.15))] {
            let reliefs = [relief];
            let board = Surface::solve(&reliefs, side, 20.0, Some(L), [0.4, 0.6, 0.8]).unwrap();
            // The view alone: the tilted press where it touches, on a raster that ends a little beyond it.
            let mut tilted = obstacle(&reliefs, side, Cells { half_mm: 14.0, cell_mm: 0.1 }, Some(L), 1.0);
            let (n, back) = (tilted.n, pose.inverse());
            for (i, value) in tilted.values.iter_mut().enumerate() {
                let [x, y] = back.apply([i % n, i / n].map(|k| (k as f64 - 0.5 * (n - 1) as f64) * 0.1));
                *value *= (depth_mm + tilt[0] * x + tilt[1] * y) as f32;
            }
            let mut alone = membrane(&tilted, L, depth_mm).unwrap();
            blur(&mut alone);
            let alone = Surface { solved: vec![(1.0, alone)] };
            let expected = alone.depths(&pose, frame_px, mm_per_px, TiltedPress::level(1.0));
            let [worst, mean] =
                difference(&board.depths(&pose, frame_px, mm_per_px, TiltedPress { depth_mm, tilt }), &expected);
            assert!(worst < 0.012 && mean < 0.004, "{side:?}: {worst} and {mean} mm");
        }
    }

    #[test]
    fn cells_half_as_large_change_little() {
        let letter = crate::scene::shape::glyph::glyph('R', 12.0, 16.0).unwrap();
        for (side, relief) in [(Side::Peg, Relief::peg(letter.clone())), (Side::Hole, Relief::hole(letter, 0.15))] {
            for gel_length in [0.3, L, 4.0] {
                let reliefs = [relief.clone()];
                let view = |cell_mm| {
                    let surface =
                        Surface::on_cells(&reliefs, side, Cells { half_mm: 10.0, cell_mm }, Some(gel_length), [0.6; 3])
                            .unwrap();
                    surface.depths(&Se2::IDENTITY, [160, 120], [0.11; 2], TiltedPress::level(0.6))
                };
                let cell_mm = cell_mm(&reliefs, 10.0, Some(gel_length));
                let [worst, mean] = difference(&view(cell_mm), &view(0.5 * cell_mm));
                assert!(worst < 0.06 && mean < 0.01, "{side:?}, {gel_length} mm: {worst} and {mean} mm");
            }
        }
    }
}

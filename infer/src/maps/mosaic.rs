//! A map of a whole part, stitched from the maps of touches of its peg, or of its hole, at their poses: what a touch is laid over to
//! see whether it was made there. Recorded pegs need no drawing for it.

mod corners;
mod stitcher;

use half::f16;
use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::{OUTLINE_REACH_MM, Side};
use tactile_data::pose::se2::Se2;

use self::corners::Corners;
pub use self::stitcher::Stitcher;
use super::align::Drawing;
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};

/// Side of a cell, mm: two thirds of a map's at 40 x 30 pixels.
pub const CELL_MM: f64 = 0.3;

/// Values of a cell.
pub const N_VALUES: usize = 5;

/// Which of them are the error and the number of touches.
const ERROR: usize = 3;
const N_SEEN: usize = 4;

/// The values of a cell: distance, inside, contact, error and how often it was seen.
type Cell = [f32; N_VALUES];

/// More cells along a side than any part has: 150 mm.
const MOST_CELLS: usize = 512;

/// What a mosaic says of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The distance to the outline of the peg, mm, negative inside.
    pub distance_mm: f32,
    /// The probability that the place is inside the outline, 0..=1.
    pub inside: f32,
    /// The probability that the peg touches the gel there, 0..=1.
    pub contact: f32,
    /// The error that is expected of the distance, mm: what the touches state of it, and how far they are apart.
    pub error_mm: f32,
    /// How many touches showed it.
    pub n_seen: f32,
}

impl Place {
    fn of([distance_mm, inside, contact, error_mm, n_seen]: Cell) -> Self {
        Self { distance_mm, inside, contact, error_mm, n_seen }
    }

    /// Whether one of two is inside the outline, the other is not, and they are farther apart than their errors.
    pub(super) fn differs(&self, other: &Self) -> bool {
        let apart = (self.distance_mm - other.distance_mm).abs();
        (self.distance_mm < 0.0) != (other.distance_mm < 0.0) && apart > self.error_mm.hypot(other.error_mm)
    }
}

/// How much of what two mosaics show is otherwise in the other, mm².
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// What both show.
    pub seen_mm2: f64,
    /// What is inside the first one's outline and outside the second's.
    pub only_first_mm2: f64,
    /// What is inside the second one's outline and outside the first's.
    pub only_second_mm2: f64,
}

/// Places are compared where either outline is this near, mm: farther off maps are cut off.
const NEAR_MM: f32 = 2.0;

/// The side of the cells in which a misfit is measured: a drawn pixel is of some 0.46 mm, so smaller ones say nothing new.
const MISFIT_CELL_MM: f64 = 0.6;

/// No contact is believed more surely than this, or less than the rest.
const SUREST: f64 = 0.98;

/// The relative entropy of one probability of a contact from another, nats.
fn relative_entropy(of: f32, from: f32) -> f64 {
    let [p, q] = [of, from].map(|contact| f64::from(contact).clamp(1.0 - SUREST, SUREST));
    p * (p / q).ln() + (1.0 - p) * ((1.0 - p) / (1.0 - q)).ln()
}

/// The distance at a place, and how it changes along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slope {
    pub distance_mm: f64,
    pub by_xy: [f64; 2],
    pub error_mm: f64,
}

/// Whose touches mosaics may be of, in their order.
const SIDES: [Side; 2] = [Side::Peg, Side::Hole];

/// The mosaics of a bank's parts, all of one size, about each part's own origin: by touches of pegs and, where holes are known, too,
/// by touches of holes. A hole is read unlike its peg, and each time alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Mosaics {
    n_sides: usize,
    n: usize,
    /// `[n_sides, n_parts, n, n, N_VALUES]`: pegs first; rows from the top, distance, inside, contact, error and how often a cell was
    /// seen.
    values: Vec<f32>,
    /// `[n_sides, n_parts]`: [`Mosaic::outline_mm`].
    outlines_mm: Vec<Vec<[f64; 2]>>,
}

/// The mosaic of one part.
#[derive(Clone, Copy, Debug)]
pub struct Mosaic<'a> {
    /// Whose touches it is of.
    side: Side,
    n: usize,
    /// `[n, n]`.
    cells: &'a [Cell],
    outline_mm: &'a [[f64; 2]],
}

/// The middle of a cell along an axis of `n`, mm.
fn middle(n: usize, cell: usize) -> f64 {
    cells_off(n, cell) * CELL_MM
}

/// How many cells it is from the middle of the axis.
fn cells_off(n: usize, cell: usize) -> f64 {
    cell as f64 + 0.5 - 0.5 * n as f64
}

impl Mosaics {
    /// The maps of all parts, one stitcher each: of their pegs, and behind them of their holes, where those are known.
    ///
    /// # Errors
    /// None, or of several sizes; values that are not finite or beyond the range of f16.
    pub fn stitched(pegs: &[Stitcher], holes: Option<&[Stitcher]>) -> Result<Self> {
        let n = pegs.first().map_or(0, |part| part.n);
        let shape = [1 + usize::from(holes.is_some()), pegs.len(), n, n, N_VALUES];
        Self::new(shape, pegs.iter().chain(holes.unwrap_or_default()).flat_map(Stitcher::cells).flatten().collect())
    }

    /// From values `[n_sides, n_parts, n, n, N_VALUES]`, pegs before holes, which are rounded to f16, as a file keeps them.
    ///
    /// # Errors
    /// A shape that mosaics do not have; distances, shares or numbers that no touches give.
    pub fn new(shape: [usize; 5], mut values: Vec<f32>) -> Result<Self> {
        let [n_sides, n_parts, n, across, n_values] = shape;
        let is_size = (2..=MOST_CELLS).contains(&n) && across == n && n_values == N_VALUES;
        let is_number = n_parts > 0 && (1..=SIDES.len()).contains(&n_sides);
        if !(is_size && is_number) || values.len() != n_sides * n_parts * n * n * N_VALUES {
            let expected = format!("[sides, parts, n, n, {N_VALUES}] values, n at most {MOST_CELLS}");
            return Err(Error::invalid("mosaics", expected, format!("{shape:?}")));
        }
        Precision::F16.round_all("mosaics", &mut values)?;
        let is_odd = |cell: &[f32]| {
            let far = 2.0 * OUTLINE_REACH_MM as f32;
            !((-far..=far).contains(&cell[0])
                && cell[1..3].iter().all(|share| (0.0..=1.0).contains(share))
                && cell[3] > 0.0
                && cell[4] >= 0.0
                && cell[3..].iter().all(|value| value.is_finite()))
        };
        match values.chunks_exact(N_VALUES).position(is_odd) {
            Some(at) => {
                let (part, cell) = (at / (n * n) % n_parts, at % (n * n));
                let what = format!("mosaics: part {part}, cell {cell}");
                let got = format!("{:?}", &values[at * N_VALUES..][..N_VALUES]);
                Err(Error::invalid(what, "a distance, two shares, an error and a number of touches", got))
            }
            None => {
                let outlines_mm = values.chunks_exact(n * n * N_VALUES).map(|part| outline_mm(part, n)).collect();
                Ok(Self { n_sides, n, values, outlines_mm })
            }
        }
    }

    /// Number of parts.
    pub fn n_parts(&self) -> usize {
        self.values.len() / (self.n_sides * self.n * self.n * N_VALUES)
    }

    /// `[n_sides, n_parts, n, n, N_VALUES]`.
    pub fn shape(&self) -> [usize; 5] {
        [self.n_sides, self.n_parts(), self.n, self.n, N_VALUES]
    }

    /// Whose touches they are of.
    pub fn sides(&self) -> &'static [Side] {
        &SIDES[..self.n_sides]
    }

    /// The side whose mosaics touches of a side are laid over: their own, or pegs, where their own are not known.
    pub fn side_for(&self, touched: Side) -> Side {
        if self.sides().contains(&touched) { touched } else { Side::Peg }
    }

    /// Pegs before holes; rows from the top: distance, inside, contact, error and how often a cell was seen.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The values as a file has them: f16, little endian.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.values.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect()
    }

    /// The mosaic of a part by touches of one side, or of its peg where those are not known; `part` is below [`Self::n_parts`].
    pub fn of(&self, part: usize, side: Side) -> Mosaic<'_> {
        let at = usize::from(self.side_for(side) == Side::Hole);
        let (n_of_part, which) = (self.n * self.n * N_VALUES, at * self.n_parts() + part);
        let values = &self.values[which * n_of_part..][..n_of_part];
        Mosaic { side: SIDES[at], n: self.n, cells: values.as_chunks().0, outline_mm: &self.outlines_mm[which] }
    }

    /// The mosaics of some of the parts, in their order.
    pub(crate) fn of_parts(&self, parts: &[usize]) -> Self {
        let mut values = Vec::with_capacity(self.n_sides * parts.len() * self.n * self.n * N_VALUES);
        let mut outlines_mm = Vec::with_capacity(self.n_sides * parts.len());
        for part in self.sides().iter().flat_map(|side| parts.iter().map(|part| self.of(*part, *side))) {
            values.extend_from_slice(part.cells.as_flattened());
            outlines_mm.push(part.outline_mm.to_vec());
        }
        Self { values, outlines_mm, ..*self }
    }
}

/// The middles of the cells, `[n, n, N_VALUES]`, within half a cell of the outline, mm: each counts for [`CELL_MM`] of its length.
fn outline_mm(values: &[f32], n: usize) -> Vec<[f64; 2]> {
    let cells = values.as_chunks().0.iter().map(|cell| Place::of(*cell)).enumerate();
    let is_on_it = |place: &Place| place.n_seen > 0.0 && f64::from(place.distance_mm.abs()) <= 0.5 * CELL_MM;
    cells.filter(|(_, place)| is_on_it(place)).map(|(at, _)| [at % n, at / n].map(|cell| middle(n, cell))).collect()
}

impl<'a> Mosaic<'a> {
    /// Whose touches it is of.
    pub fn side(&self) -> Side {
        self.side
    }

    /// Places of the part's outline, mm about its origin, each of which counts for [`CELL_MM`] of it: cells within half a cell of it
    /// make a strip that is a cell wide.
    pub fn outline_mm(&self) -> &'a [[f64; 2]] {
        self.outline_mm
    }

    /// Cells along an axis.
    pub fn n(&self) -> usize {
        self.n
    }

    /// A cell, by its column and row, each below [`Self::n`]: the place about the part's origin, mm, and what is there.
    pub fn cell(&self, column: usize, row: usize) -> ([f64; 2], Place) {
        ([column, row].map(|cell| middle(self.n, cell)), Place::of(self.cells[row * self.n + column]))
    }

    /// What is at a place of the part, mm; `None` where no touch showed it.
    #[inline(always)]
    pub fn at(&self, place_mm: [f64; 2]) -> Option<Place> {
        let corners = self.corners(place_mm)?;
        // One by one: an array's `map` is not inlined.
        let between = |which: usize| corners.between(|at| self.cells[at][which]);
        Some(Place::of([between(0), between(1), between(2), between(3), between(4)]))
    }

    /// Whether each place is inside the outline, as pixels `step_mm` wide of a square about the middle of what is inside, turned by this
    /// angle: their number along an axis (0: nothing is inside), and rows from the top. What no touch showed is outside.
    pub fn inside_every(&self, step_mm: f64, turned_rad: f64) -> (usize, Vec<bool>) {
        let turned = Se2::new(0.0, 0.0, turned_rad);
        let is_inside = |place: &Place| place.n_seen > 0.0 && place.distance_mm < 0.0;
        let inside = (0..self.n * self.n).map(|at| self.cell(at % self.n, at / self.n));
        let places = inside.filter(|(_, place)| is_inside(place)).map(|(mm, _)| turned.inverse().apply(mm));
        let none = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        let bounds = places.fold(none, |bounds, mm| {
            std::array::from_fn(|axis| [bounds[axis][0].min(mm[axis]), bounds[axis][1].max(mm[axis])])
        });
        let extent = bounds.map(|[least, most]| most - least).into_iter().fold(f64::NEG_INFINITY, f64::max);
        let n = ((extent + 2.0 * CELL_MM) / step_mm).ceil().max(0.0) as usize;
        let middle = bounds.map(|[least, most]| 0.5 * (least + most));
        let mm = |at: usize, axis: usize| middle[axis] + (at as f64 + 0.5 - 0.5 * n as f64) * step_mm;
        let place = |at: usize| self.at(turned.apply([mm(at % n, 0), mm(at / n, 1)]));
        (n, (0..n * n).map(|at| place(at).is_some_and(|place| place.distance_mm < 0.0)).collect())
    }

    /// Whether its outline leaves what was seen: a cell inside it touches one that no touch showed.
    pub fn is_cut(&self) -> bool {
        let is_seen =
            |column: usize, row: usize| column < self.n && row < self.n && self.cell(column, row).1.n_seen > 0.0;
        let is_cut = |at: usize| {
            let (column, row) = (at % self.n, at / self.n);
            let beside =
                [(column.wrapping_sub(1), row), (column + 1, row), (column, row.wrapping_sub(1)), (column, row + 1)];
            let is_inside = is_seen(column, row) && self.cell(column, row).1.distance_mm < 0.0;
            is_inside && beside.into_iter().any(|(column, row)| !is_seen(column, row))
        };
        (0..self.n * self.n).any(is_cut)
    }

    /// How the places that it shows differ from those of another about the same origin.
    pub fn difference(&self, other: &Mosaic<'_>) -> Difference {
        let mut sum = Difference::default();
        for (column, row) in (0..self.n * self.n).map(|at| (at % self.n, at / self.n)) {
            let (place_mm, here) = self.cell(column, row);
            let Some(there) = other.at(place_mm).filter(|_| here.n_seen > 0.0) else { continue };
            let area = CELL_MM * CELL_MM;
            sum.seen_mm2 += area;
            if here.differs(&there) {
                *if here.distance_mm < 0.0 { &mut sum.only_first_mm2 } else { &mut sum.only_second_mm2 } += area;
            }
        }
        sum
    }

    /// How far the maps of touches, stitched, are from it near either outline, where the part seems larger by this strain: the mean relative
    /// entropy of what touches the gel, from that of the touches to its own, nats; `None` where they show nothing in common. Of
    /// touches of the side whose mosaic it is: what touches the gel is seen, which side of a rim is inside is not.
    pub fn misfit(&self, touches: &Stitcher, strain: f64) -> Option<f64> {
        let (mut sum, mut n) = (0.0, 0.0);
        for (at, here) in touches.cells().map(Place::of).enumerate().filter(|(_, here)| here.n_seen > 0.0) {
            let mm = |cell| (1.0 - strain) * touches.middle_mm(cell);
            let Some(there) = self.at([mm(at % touches.n), mm(at / touches.n)]) else { continue };
            if here.distance_mm.abs().min(there.distance_mm.abs()) < NEAR_MM {
                (sum, n) = (sum + relative_entropy(here.contact, there.contact), n + 1.0);
            }
        }
        (n > 0.0).then_some(sum / n).filter(|misfit| misfit.is_finite())
    }

    /// The same of touches where they were made; `None` without any, too, and of touches of the other side: a hole touches the gel where its
    /// peg does not.
    pub fn misfit_of(&self, touched: Side, touches: &[Drawing<'_>], part_from_first: &Se2, strain: f64) -> Option<f64> {
        let touches = if touched == self.side { touches } else { &[] };
        self.misfit(&Stitcher::laid(touches, part_from_first, MISFIT_CELL_MM)?, strain)
    }

    /// The distance at a place and how it changes.
    #[inline(always)]
    pub(super) fn slope(&self, place_mm: [f64; 2]) -> Option<Slope> {
        let corners = self.corners(place_mm)?;
        let distance = |corner: usize| f64::from(self.cells[corners.at[corner]][0]);
        let (a, b, c, d) = (distance(0), distance(1), distance(2), distance(3));
        let (across, down) = (f64::from(corners.across), f64::from(corners.down));
        let (top, bottom) = (a + across * (b - a), c + across * (d - c));
        let by_x = (1.0 - down) * (b - a) + down * (d - c);
        let by_xy = [by_x / CELL_MM, (bottom - top) / CELL_MM];
        let error_mm = f64::from(corners.between(|at| self.cells[at][ERROR]));
        Some(Slope { distance_mm: top + down * (bottom - top), by_xy, error_mm })
    }

    /// The four cells round a place, where all were seen.
    #[inline(always)]
    fn corners(&self, [x_mm, y_mm]: [f64; 2]) -> Option<Corners> {
        let (column, row) = (self.place(x_mm)?, self.place(y_mm)?);
        let corners = Corners::of([column, row], [self.n, self.n]);
        corners.at.iter().all(|at| self.cells[*at][N_SEEN] > 0.0).then_some(corners)
    }

    /// Where along an axis of cells a place is; `None` beyond the middles of the outermost.
    #[inline(always)]
    fn place(&self, mm: f64) -> Option<f64> {
        let place = mm / CELL_MM + 0.5 * self.n as f64 - 0.5;
        (0.0..=(self.n - 1) as f64).contains(&place).then_some(place)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::maps::DrawnMap;
    use tactile_data::pose::se2::Se2;

    const VIEW_MM: [f64; 2] = [18.6, 14.3];
    const SIZE_PX: [usize; 2] = [40, 30];

    /// Distance from an ellipse-like shape of no symmetry: smooth, so that what is between cells is known.
    pub fn outline([x, y]: [f64; 2]) -> f64 {
        (x.hypot(1.6 * y) - 5.0 + 0.25 * x + 0.1 * (0.5 * y + 0.2 * x).sin()).clamp(-OUTLINE_REACH_MM, OUTLINE_REACH_MM)
    }

    /// What a perfect drawer would draw of [`outline`] touched at a pose.
    pub fn map(part_from_sensor: &Se2, error_mm: f32) -> DrawnMap {
        map_of(&outline, part_from_sensor, error_mm)
    }

    /// The same of any distance.
    pub fn map_of(outline: &dyn Fn([f64; 2]) -> f64, part_from_sensor: &Se2, error_mm: f32) -> DrawnMap {
        let n = SIZE_PX[0] * SIZE_PX[1];
        let (distance_mm, inside) = (vec![0.0; n], vec![0.0; n]);
        let mut map = DrawnMap {
            size_px: SIZE_PX,
            view_mm: VIEW_MM,
            error_mm: vec![error_mm; n],
            contact: Vec::new(),
            inside,
            distance_mm,
        };
        for at in 0..n {
            let mm = outline(part_from_sensor.apply(map.place_mm(at))) as f32;
            (map.distance_mm[at], map.inside[at]) = (mm, if mm < 0.0 { 1.0 } else { 0.0 });
        }
        DrawnMap { contact: map.inside.clone(), ..map }
    }

    #[test]
    fn a_map_of_another_view_is_that_of_a_part_as_much_larger() {
        // What a network draws of the same picture where it shows less, and more, than the network knows.
        for ratio in [0.8, 1.15] {
            let pose = Se2::from_degrees(1.3, -2.1, 25.0);
            let of_view = map(&pose, 0.2).of_view(VIEW_MM.map(|mm| ratio * mm));
            let known = map(&pose, 0.2).of_view(VIEW_MM);
            assert_eq!(known, map(&pose, 0.2));
            let places: Vec<(usize, [f64; 2])> = known.places_mm(3).collect();
            assert_eq!((places.len(), places[15].0), (14 * 10, 3 * 40 + 3));
            assert!(places.iter().all(|(at, place_mm)| *place_mm == known.place_mm(*at)));
            let there = Se2::new(ratio * pose.x_mm, ratio * pose.y_mm, pose.theta_rad);
            let larger = |place: [f64; 2]| ratio * outline(place.map(|mm| mm / ratio));
            let mut n_near = 0;
            for at in 0..SIZE_PX[0] * SIZE_PX[1] {
                let expected = larger(there.apply(of_view.place_mm(at)));
                let found = f64::from(of_view.distance_mm[at]);
                assert!((found - expected.clamp(-OUTLINE_REACH_MM, OUTLINE_REACH_MM)).abs() < 1e-5, "{ratio}: {found}");
                n_near += usize::from(expected.abs() < 1.0);
            }
            assert!(n_near > 100 && (f64::from(of_view.error_mm[7]) - 0.2 * ratio).abs() < 1e-6);
        }
    }

    /// A part that was touched all over.
    pub fn mosaics() -> Mosaics {
        let mut stitcher = Stitcher::new(15.0);
        for at in 0..25 {
            let [x, y] = [at % 5, at / 5].map(|step| 3.0 * f64::from(step) - 6.0);
            let pose = Se2::from_degrees(x, y, 37.0 * f64::from(at));
            stitcher.add(&map(&pose, 0.1), &pose);
        }
        Mosaics::stitched(&[stitcher], None).unwrap()
    }

    #[test]
    fn touches_become_the_map_of_the_part() {
        let mosaics = mosaics();
        let mosaic = mosaics.of(0, Side::Peg);
        assert_eq!(mosaics.shape(), [1, 1, 100, 100, 5]);
        let (mut n_seen, mut most) = (0, 0.0_f64);
        for (column, row) in (0..100).flat_map(|row| (0..100).map(move |column| (column, row))) {
            let (place, of_cell) = mosaic.cell(column, row);
            assert!((place[0] - (column as f64 - 49.5) * 0.3).abs() < 1e-12);
            if of_cell.n_seen == 0.0 {
                assert!(place[0].hypot(place[1]) > 6.0, "{place:?}");
                continue;
            }
            n_seen += 1;
            // Where it is cut off its slope breaks.
            if outline(place).abs() < 2.8 {
                most = most.max((f64::from(of_cell.distance_mm) - outline(place)).abs());
            }
        }
        // Between pixels of 0.47 mm a smooth distance bends by some hundredths, most where it is sharpest, in the middle.
        assert!(n_seen > 4_000 && most < 0.15, "{n_seen} {most}");
        let at = mosaic.at([1.234, -2.345]).unwrap();
        assert!((f64::from(at.distance_mm) - outline([1.234, -2.345])).abs() < 0.03);
        assert!(mosaic.at([14.9, 14.9]).is_none() && mosaic.at([1e9, f64::NAN]).is_none());
    }

    #[test]
    fn a_slope_is_the_difference_of_values() {
        let mosaics = mosaics();
        let mosaic = mosaics.of(0, Side::Peg);
        let value = |place: [f64; 2]| mosaic.slope(place).unwrap().distance_mm;
        for place in [[1.21, -2.33], [4.47, 0.52], [-3.05, 2.9]] {
            let found = mosaic.slope(place).unwrap();
            assert!((f64::from(mosaic.at(place).unwrap().distance_mm) - found.distance_mm).abs() < 1e-5);
            for axis in 0..2 {
                let moved = |by: f64| {
                    let mut moved = place;
                    moved[axis] += by;
                    value(moved)
                };
                let expected = (moved(1e-4) - moved(-1e-4)) / 2e-4;
                assert!((found.by_xy[axis] - expected).abs() < 1e-4, "{place:?}");
            }
        }
    }

    #[test]
    fn mosaics_differ_by_the_area_between_their_outlines() {
        let disc = |radius: f64, n: usize| {
            let mut values = Vec::new();
            for (row, column) in (0..n * n).map(|at| (at / n, at % n)) {
                let mm = (middle(n, column).hypot(middle(n, row)) - radius).clamp(-3.0, 3.0);
                values.extend([mm as f32, 0.0, 0.0, 0.05, 2.0]);
            }
            Mosaics::new([1, 1, n, n, N_VALUES], values).unwrap()
        };
        let [small, large] = [disc(5.0, 60), disc(6.0, 90)];
        let found = large.of(0, Side::Peg).difference(&small.of(0, Side::Peg));
        // What lies between the two circles, but for what is nearer to either than their errors: 0.07 mm of 1.
        let between = std::f64::consts::PI * (36.0 - 25.0);
        assert!((found.only_first_mm2 - between).abs() < 2.0 && found.only_second_mm2 == 0.0, "{found:?}");
        // 60 cells of 0.3 mm, but for half a cell at each end.
        assert!((found.seen_mm2 - (59.0_f64 * 0.3).powi(2)).abs() < 12.0, "{found:?}");
        let other = small.of(0, Side::Peg).difference(&large.of(0, Side::Peg));
        assert!((other.only_second_mm2 - found.only_first_mm2).abs() < 2.0 && other.only_first_mm2 == 0.0, "{other:?}");
    }

    #[test]
    fn a_misfit_is_the_relative_entropy_of_contacts_near_either_outline() {
        let disc = |radius: f64| {
            let n = 60;
            let mm = |at: usize| middle(n, at % n).hypot(middle(n, at / n)) - radius;
            let of_all = |value: f32| vec![value; n * n];
            let map = DrawnMap {
                size_px: [n, n],
                view_mm: [CELL_MM * n as f64; 2],
                distance_mm: (0..n * n).map(|at| mm(at).clamp(-3.0, 3.0) as f32).collect(),
                error_mm: of_all(0.05),
                inside: of_all(0.0),
                contact: (0..n * n).map(|at| f32::from(u8::from(mm(at) < 0.0))).collect(),
            };
            let mut disc = Stitcher::new(0.5 * CELL_MM * n as f64);
            disc.add(&map, &Se2::IDENTITY);
            disc
        };
        let discs = [disc(5.0), disc(5.4)];
        let mosaics = Mosaics::stitched(&discs, None).unwrap();
        let [small, large] = [0, 1].map(|part| mosaics.of(part, Side::Peg));
        let found = large.misfit(&discs[0], 0.0).unwrap();
        // A ring of 5 to 5.4 mm touches the gel in one and not in the other, among places from 3 mm to 7.4 mm: by bits that are sure to 98 %.
        let sure = 0.98 * (0.98_f64 / 0.02).ln() + 0.02 * (0.02_f64 / 0.98).ln();
        let expected = sure * (5.4 * 5.4 - 25.0) / (7.4 * 7.4 - 9.0);
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
        assert!(small.misfit(&discs[0], 0.0).unwrap() < 0.02 * found);
        // A disc that seems larger by what it is larger.
        let known = small.misfit(&discs[1], 1.0 - 5.0 / 5.4).unwrap();
        assert!(known < 0.1 * found, "{known} {found}");
        assert_eq!(small.misfit(&Stitcher::new(3.0), 0.0), None);
        assert_eq!(small.misfit_of(Side::Peg, &[], &Se2::IDENTITY, 0.0), None);
    }

    #[test]
    fn what_is_inside_is_an_area_and_may_be_cut() {
        let mosaics = mosaics();
        let mosaic = mosaics.of(0, Side::Peg);
        // How many pixels are inside, and from where to where along each axis.
        let measured = |n: usize, inside: &[bool]| {
            let places: Vec<[usize; 2]> = (0..n * n).filter(|at| inside[*at]).map(|at| [at % n, at / n]).collect();
            let along = |axis: usize| places.iter().map(move |place| place[axis]);
            (places.len(), [0, 1].map(|axis| [along(axis).min().unwrap(), along(axis).max().unwrap()]))
        };
        let step = |at: usize| (at as f64 + 0.5 - 300.0) * 0.05;
        let inside: Vec<bool> = (0..600 * 600).map(|at| outline([step(at % 600), step(at / 600)]) < 0.0).collect();
        let (area, [across, down]) = measured(600, &inside);
        for (turned_deg, expected) in [(0.0_f64, [across, down]), (90.0, [down, across])] {
            let (n, inside) = mosaic.inside_every(0.05, turned_deg.to_radians());
            let (found, extents) = measured(n, &inside);
            assert!((found as f64 / area as f64 - 1.0).abs() < 0.02, "{found} {area}");
            for ([least, most], [from, to]) in extents.into_iter().zip(expected) {
                assert!((most - least).abs_diff(to - from) <= 4, "{extents:?} {expected:?}");
                // In the middle of the square.
                assert!((least + most).abs_diff(n - 1) <= 4, "{extents:?} of {n}");
            }
        }
        let nothing = Mosaics::stitched(&[Stitcher::new(3.0)], None).unwrap();
        assert_eq!(nothing.of(0, Side::Peg).inside_every(0.05, 0.0), (0, vec![]));
        assert!(!mosaic.is_cut());
        // One touch does not show all of it.
        let mut stitcher = Stitcher::new(15.0);
        let beside = Se2::from_degrees(6.0, 0.0, 0.0);
        stitcher.add(&map(&beside, 0.1), &beside);
        assert!(Mosaics::stitched(&[stitcher], None).unwrap().of(0, Side::Peg).is_cut());
    }

    #[test]
    fn a_surer_touch_counts_more() {
        let mut stitcher = Stitcher::new(15.0);
        let [right, wrong] = [Se2::IDENTITY, Se2::from_degrees(1.0, 0.0, 0.0)];
        stitcher.add(&map(&right, 0.1), &right);
        stitcher.add(&map(&wrong, 1.0), &right);
        let mosaics = Mosaics::stitched(&[stitcher], None).unwrap();
        let place = [3.9, 1.05];
        let [a, b] = [outline(place), outline(wrong.apply(place))];
        let expected = (100.0 * a + b) / 101.0;
        let found = f64::from(mosaics.of(0, Side::Peg).at(place).unwrap().distance_mm);
        assert!((found - expected).abs() < 0.02 && (a - b).abs() > 0.5, "{found} {expected}");
        // They are apart by (a - b), a hundred to one, and state errors whose mean square is 2 / (100 + 1).
        let error = ((a - b).powi(2) * 100.0 / 101.0_f64.powi(2) + 2.0 / 101.0).sqrt();
        let stated = f64::from(mosaics.of(0, Side::Peg).at(place).unwrap().error_mm);
        assert!((stated - error).abs() < 0.02, "{stated} {error}");
    }

    #[test]
    fn what_no_touches_give_is_refused() {
        let values = |of: [f32; 5]| [of, of, of, of].concat();
        let good = [1.0, 0.5, 0.0, 0.2, 3.0];
        assert!(Mosaics::new([1, 1, 2, 2, 5], values(good)).is_ok());
        for (at, value) in [(0, 7.0), (1, 1.5), (2, -0.1), (3, 0.0), (3, f32::INFINITY), (4, f32::NAN), (4, -1.0)] {
            let mut wrong = good;
            wrong[at] = value;
            let said = Mosaics::new([1, 1, 2, 2, 5], values(wrong)).unwrap_err().to_string();
            assert!(said.starts_with("mosaics: part 0, cell 0: expected a distance"), "{said}");
        }
        for shape in [
            [1, 1, 2, 3, 5],
            [1, 2, 2, 2, 5],
            [1, 1, 2, 2, 4],
            [1, 0, 2, 2, 5],
            [1, 1, 1, 1, 5],
            [0, 1, 2, 2, 5],
            [3, 1, 2, 2, 5],
        ] {
            assert!(Mosaics::new(shape, values(good)).is_err(), "{shape:?}");
        }
        assert!(Mosaics::stitched(&[], None).is_err());
        assert!(Mosaics::stitched(&[Stitcher::new(3.0), Stitcher::new(4.0)], None).is_err());
    }
}

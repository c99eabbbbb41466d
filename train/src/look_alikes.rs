//! Strangers that look like a part: its own map a little larger or smaller, stretched, with its outline moved, or with a piece more or
//! less. Parts that are drawn at random differ much more than two connectors do, so that a network that has seen no others passes such a
//! stranger; an F is an E but for a bar.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::dataset::touch::{OUTLINE_REACH_MM, Side};
use tactile_data::pose::se2::Se2;
use tactile_infer::maps::mosaic::{Mosaic, Mosaics, Place};

use crate::error::Result;

/// Look-alikes of each part: that differ all over, and by a piece.
const N_WHOLE: usize = 3;
const N_BY_A_PIECE: usize = 3;
/// All of them.
pub const N_LOOK_ALIKES: usize = N_WHOLE + N_BY_A_PIECE;

/// How far the outline of a look-alike is moved at its ends, mm: less is a hole's play, and what a map is off.
const MOVED_MM: [f64; 2] = [0.4, 1.6];

/// A part of a look-alike is at most so many times as large, or as small.
const MOST_STRETCHED: f64 = 1.5;

/// How wide a piece is that a look-alike has more or less, mm, and how many times as long.
const PIECE_MM: [f64; 2] = [1.5, 6.0];
const PIECE_LENGTHS: [f64; 2] = [1.0, 3.0];

/// Steps by which slopes of a distance are found, mm.
const STEP_MM: f64 = 0.3;

/// How a look-alike differs from its part.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Whole(Stretch),
    Piece(Piece),
}

impl Change {
    /// What a map of the look-alike has at a place, mm.
    fn at(&self, mosaic: &Mosaic<'_>, place_mm: [f64; 2]) -> Option<Place> {
        match self {
            Self::Whole(stretch) => stretch.at(mosaic, place_mm),
            Self::Piece(piece) => piece.at(mosaic, place_mm),
        }
    }
}

/// A place of a map whose outline is another now. What was drawn on either side of the outline stays there.
fn with_distance(place: Place, distance_mm: f64) -> Place {
    let reach = 2.0 * OUTLINE_REACH_MM;
    let is_inside = f32::from(u8::from(distance_mm < 0.0));
    let changed = (place.distance_mm < 0.0) != (distance_mm < 0.0);
    let share = |share: f32| if changed { is_inside } else { share };
    Place {
        distance_mm: distance_mm.clamp(-reach, reach) as f32,
        inside: share(place.inside),
        contact: share(place.contact),
        ..place
    }
}

/// A rectangle that is added to a part, or taken from it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    from_part: Se2,
    half_mm: [f64; 2],
    is_added: bool,
}

impl Piece {
    /// One whose middle is on the outline, of which `rim` has places.
    fn drawn(rim: &[[f64; 2]], rng: &mut ChaCha8Rng) -> Option<Self> {
        let [x, y] = *rim.get(rng.random_range(0..rim.len().max(1)))?;
        let half = 0.5 * rng.random_range(PIECE_MM[0]..PIECE_MM[1]);
        let half_mm = [half, half * rng.random_range(PIECE_LENGTHS[0]..PIECE_LENGTHS[1])];
        let from_part = Se2::new(x, y, rng.random_range(0.0..std::f64::consts::TAU)).inverse();
        Some(Self { from_part, half_mm, is_added: rng.random_bool(0.5) })
    }

    /// How far outside of the rectangle a place is, mm.
    fn outside_mm(&self, place_mm: [f64; 2]) -> f64 {
        let seen = self.from_part.apply(place_mm);
        let [u, v] = [0, 1].map(|axis| seen[axis].abs() - self.half_mm[axis]);
        u.max(0.0).hypot(v.max(0.0)) + u.max(v).min(0.0)
    }

    fn at(&self, mosaic: &Mosaic<'_>, place_mm: [f64; 2]) -> Option<Place> {
        let place = mosaic.at(place_mm)?;
        let (own, piece) = (f64::from(place.distance_mm), self.outside_mm(place_mm));
        Some(with_distance(place, if self.is_added { own.min(piece) } else { own.max(-piece) }))
    }
}

/// A part that is a little larger or smaller, stretched, or whose outline is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    /// How many times as long it is along a direction, rad, and across.
    along: f64,
    across: f64,
    direction_rad: f64,
    /// How far outside of the part's its outline is, mm.
    grown_mm: f64,
}

impl Stretch {
    /// One that moves the ends of a part that reaches so far from its middle by more than its play.
    fn drawn(half_mm: f64, rng: &mut ChaCha8Rng) -> Self {
        let [least, most] = MOVED_MM.map(f64::ln);
        let moved = rng.random_range(least..most).exp() * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let times = (1.0 + moved / half_mm).clamp(1.0 / MOST_STRETCHED, MOST_STRETCHED);
        let direction_rad = rng.random_range(0.0..std::f64::consts::PI);
        let same = Self { along: 1.0, across: 1.0, direction_rad, grown_mm: 0.0 };
        match rng.random_range(0..3) {
            0 => Self { along: times, across: times, ..same },
            1 => Self { along: times, ..same },
            // Twice as far at most moves both edges of a stroke by all that there is of it.
            _ => Self { grown_mm: 0.5 * moved, ..same },
        }
    }

    /// What a map of the look-alike has at a place, mm.
    fn at(&self, mosaic: &Mosaic<'_>, place_mm: [f64; 2]) -> Option<Place> {
        let (sin, cos) = self.direction_rad.sin_cos();
        let turned = |[x, y]: [f64; 2]| [cos * x + sin * y, cos * y - sin * x];
        let [along, across] = turned(place_mm);
        let [along, across] = [along / self.along, across / self.across];
        let from = [cos * along - sin * across, sin * along + cos * across];
        let place = mosaic.at(from)?;
        let beside = |[x, y]: [f64; 2]| mosaic.at([from[0] + x, from[1] + y]).map(|place| f64::from(place.distance_mm));
        let slope = |x: f64, y: f64| Some((beside([x, y])? - beside([-x, -y])?) / (2.0 * STEP_MM));
        let slopes = [slope(STEP_MM, 0.0).unwrap_or(0.0), slope(0.0, STEP_MM).unwrap_or(0.0)];
        // A distance grows as the part does along the way to the outline.
        let [u, v] = turned(slopes);
        let length = u.hypot(v);
        let shrunk = (u / self.along).hypot(v / self.across);
        let times = if shrunk > 1e-6 { length / shrunk } else { 1.0 };
        Some(with_distance(place, times * f64::from(place.distance_mm) - self.grown_mm))
    }
}

/// How far a part reaches from its origin, mm.
fn half_mm(mosaic: &Mosaic<'_>) -> f64 {
    let cells = (0..mosaic.n()).flat_map(|row| (0..mosaic.n()).map(move |column| mosaic.cell(column, row)));
    let inside = cells.filter(|(_, place)| place.n_seen > 0.0 && place.distance_mm < 0.0);
    inside.map(|([x, y], _)| x.hypot(y)).fold(2.0, f64::max)
}

/// The mosaics of some parts and, behind them, [`N_LOOK_ALIKES`] of each.
///
/// # Errors
/// None that mosaics give.
pub fn with_look_alikes(mosaics: &Mosaics, rng: &mut ChaCha8Rng) -> Result<Mosaics> {
    let [n_sides, n_parts, n, _, n_values] = mosaics.shape();
    let mut changes = Vec::with_capacity(n_parts * N_LOOK_ALIKES);
    for part in 0..n_parts {
        let mosaic = mosaics.of(part, Side::Peg);
        let (half_mm, rim) = (half_mm(&mosaic), mosaic.outline_mm());
        changes.extend((0..N_WHOLE).map(|_| (part, Change::Whole(Stretch::drawn(half_mm, rng)))));
        // A part without an outline has no piece more or less.
        let same = Stretch { along: 1.0, across: 1.0, direction_rad: 0.0, grown_mm: 0.0 };
        let piece = |_| (part, Piece::drawn(rim, rng).map_or(Change::Whole(same), Change::Piece));
        changes.extend((0..N_BY_A_PIECE).map(piece));
    }
    let n_of_side = n_parts * n * n * n_values;
    let mut values = Vec::with_capacity((1 + N_LOOK_ALIKES) * mosaics.values().len());
    for (of_side, side) in mosaics.values().chunks_exact(n_of_side).zip(mosaics.sides()) {
        values.extend_from_slice(of_side);
        for (part, change) in &changes {
            let mosaic = mosaics.of(*part, *side);
            for (row, column) in (0..n * n).map(|at| (at / n, at % n)) {
                let (place_mm, _) = mosaic.cell(column, row);
                let reach = OUTLINE_REACH_MM as f32;
                let unseen = [reach, 0.0, 0.0, reach, 0.0];
                values.extend(change.at(&mosaic, place_mm).map_or(unseen, |place| {
                    [place.distance_mm, place.inside, place.contact, place.error_mm, place.n_seen.floor()]
                }));
            }
        }
    }
    Ok(Mosaics::new([n_sides, n_parts * (1 + N_LOOK_ALIKES), n, n, n_values], values)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use tactile_infer::maps::mosaic::N_VALUES;

    /// A disc of 5 mm.
    fn disc() -> Mosaics {
        let n = 80;
        let mut values = Vec::new();
        for (row, column) in (0..n * n).map(|at| (at / n, at % n)) {
            let [x, y] = [column, row].map(|at| (at as f64 + 0.5 - 40.0) * 0.3);
            let mm = (x.hypot(y) - 5.0).clamp(-3.0, 3.0);
            let inside = f32::from(u8::from(mm < 0.0));
            values.extend([mm as f32, inside, inside, 0.1, 4.0]);
        }
        Mosaics::new([1, 1, n, n, N_VALUES], values).unwrap()
    }

    #[test]
    fn a_disc_larger_grown_or_stretched_is_what_geometry_says() {
        let disc = disc();
        let mosaic = disc.of(0, Side::Peg);
        assert!((half_mm(&mosaic) - 5.0).abs() < 0.3);
        let same = Stretch { along: 1.0, across: 1.0, direction_rad: 0.4, grown_mm: 0.0 };
        let at = |change: Stretch, place| f64::from(change.at(&mosaic, place).unwrap().distance_mm);
        let place = [3.0, 4.5];
        assert!((at(same, place) - (3.0_f64.hypot(4.5) - 5.0)).abs() < 0.02);
        let larger = Stretch { along: 1.2, across: 1.2, ..same };
        assert!((at(larger, place) - (3.0_f64.hypot(4.5) - 6.0)).abs() < 0.03);
        let grown = Stretch { grown_mm: 0.7, ..same };
        assert!((at(grown, place) - (3.0_f64.hypot(4.5) - 5.7)).abs() < 0.03);
        // Between the two outlines it is inside now.
        assert_eq!(grown.at(&mosaic, place).unwrap().inside, 1.0);
        // An ellipse of 6 and 5 mm: on its long axis and across.
        let ellipse = Stretch { along: 1.2, ..same };
        let on = |mm: f64, turn: f64| [mm * (0.4 + turn).cos(), mm * (0.4 + turn).sin()];
        assert!((at(ellipse, on(7.0, 0.0)) - 1.0).abs() < 0.03);
        assert!((at(ellipse, on(6.0, std::f64::consts::FRAC_PI_2)) - 1.0).abs() < 0.03);
    }

    #[test]
    fn a_piece_is_more_or_less_where_it_is_and_nothing_elsewhere() {
        let disc = disc();
        let mosaic = disc.of(0, Side::Peg);
        // 2 mm wide and 6 mm long, across the outline at (5, 0): it reaches from x = 2 to 8.
        let turned = Se2::from_degrees(5.0, 0.0, 90.0);
        let bar = Piece { from_part: turned.inverse(), half_mm: [1.0, 3.0], is_added: true };
        let at = |piece: Piece, place: [f64; 2]| piece.at(&mosaic, place).unwrap();
        for (place, mm) in [([7.0, 0.3], -0.7), ([7.7, 0.0], -0.3), ([9.0, 2.0], 2.0_f64.sqrt()), ([-4.0, 0.0], -1.0)] {
            let found = at(bar, place);
            assert!((f64::from(found.distance_mm) - mm).abs() < 0.03, "{place:?}: {found:?}");
            assert_eq!((found.inside, found.contact), if mm < 0.0 { (1.0, 1.0) } else { (0.0, 0.0) });
        }
        let cut = Piece { is_added: false, ..bar };
        for (place, mm) in [([3.0, 0.3], 0.7), ([2.3, 0.0], 0.3), ([0.0, 0.0], -2.0), ([-4.0, 0.0], -1.0)] {
            let found = at(cut, place);
            assert!((f64::from(found.distance_mm) - mm).abs() < 0.03, "{place:?}: {found:?}");
            assert_eq!(found.inside, if mm < 0.0 { 1.0 } else { 0.0 });
        }
        let rng = &mut ChaCha8Rng::seed_from_u64(2);
        assert_eq!(Piece::drawn(&[], rng), None);
        let drawn = Piece::drawn(&[[4.0, 3.0]], rng).unwrap();
        let shorter = drawn.half_mm.into_iter().fold(f64::INFINITY, f64::min);
        assert!((drawn.outside_mm([4.0, 3.0]) + shorter).abs() < 1e-12 && (0.75..=3.0).contains(&shorter));
    }

    #[test]
    fn each_part_has_look_alikes_that_differ_pegs_and_holes_alike() {
        let [_, _, n, ..] = disc().shape();
        let both = Mosaics::new([2, 1, n, n, N_VALUES], [disc().values(), disc().values()].concat()).unwrap();
        let all = with_look_alikes(&both, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        assert_eq!((all.n_parts(), all.sides()), (1 + N_LOOK_ALIKES, both.sides()));
        for side in [Side::Peg, Side::Hole] {
            let at = |part: usize, place: [f64; 2]| all.of(part, side).at(place);
            assert_eq!(at(0, [2.0, 1.0]), disc().of(0, Side::Peg).at([2.0, 1.0]));
            for part in 1..all.n_parts() {
                let rim = (0..60).map(|at| f64::from(at) * 0.1).map(|turn| [5.0 * turn.cos(), 5.0 * turn.sin()]);
                let off = rim.filter_map(|place| at(part, place)).map(|place| place.distance_mm.abs());
                let most = off.fold(0.0, f32::max);
                let expected = if part <= N_WHOLE { 0.15..2.6 } else { 0.4..3.1 };
                assert!(expected.contains(&most), "{part}: {most}");
                assert_eq!(at(part, [4.0, 2.0]), all.of(part, Side::Peg).at([4.0, 2.0]));
            }
        }
    }
}

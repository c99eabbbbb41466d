//! Strangers that look like a part: its own map a little larger or smaller, stretched, or with its outline moved. Parts that are
//! drawn at random differ much more than two connectors do, so that a network that has seen no others passes such a stranger.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::touch::{OUTLINE_REACH_MM, Side};
use tactile_infer::maps::mosaic::{Mosaic, Mosaics, Place};

use crate::error::Result;

/// Look-alikes of each part.
pub const N_LOOK_ALIKES: usize = 3;

/// How far the outline of a look-alike is moved at its ends, mm: less is a hole's play, and what a map is off.
const MOVED_MM: [f64; 2] = [0.4, 1.6];

/// A part of a look-alike is at most so many times as large, or as small.
const MOST_STRETCHED: f64 = 1.5;

/// Steps by which slopes of a distance are found, mm.
const STEP_MM: f64 = 0.3;

/// How a look-alike differs from its part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// How many times as long it is along a direction, rad, and across.
    along: f64,
    across: f64,
    direction_rad: f64,
    /// How far outside of the part's its outline is, mm.
    grown_mm: f64,
}

impl Change {
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
        let reach = 2.0 * OUTLINE_REACH_MM;
        let distance = (times * f64::from(place.distance_mm) - self.grown_mm).clamp(-reach, reach);
        // What was drawn on either side of the outline stays there.
        let is_inside = f64::from(u8::from(distance < 0.0));
        let changed = (f64::from(place.distance_mm) < 0.0) != (distance < 0.0);
        let share = |share: f32| if changed { is_inside as f32 } else { share };
        Some(Place {
            distance_mm: distance as f32,
            inside: share(place.inside),
            contact: share(place.contact),
            ..place
        })
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
        let half_mm = half_mm(&mosaics.of(part, Side::Peg));
        changes.extend((0..N_LOOK_ALIKES).map(|_| (part, Change::drawn(half_mm, rng))));
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
        let same = Change { along: 1.0, across: 1.0, direction_rad: 0.4, grown_mm: 0.0 };
        let at = |change: Change, place| f64::from(change.at(&mosaic, place).unwrap().distance_mm);
        let place = [3.0, 4.5];
        assert!((at(same, place) - (3.0_f64.hypot(4.5) - 5.0)).abs() < 0.02);
        let larger = Change { along: 1.2, across: 1.2, ..same };
        assert!((at(larger, place) - (3.0_f64.hypot(4.5) - 6.0)).abs() < 0.03);
        let grown = Change { grown_mm: 0.7, ..same };
        assert!((at(grown, place) - (3.0_f64.hypot(4.5) - 5.7)).abs() < 0.03);
        // Between the two outlines it is inside now.
        assert_eq!(grown.at(&mosaic, place).unwrap().inside, 1.0);
        // An ellipse of 6 and 5 mm: on its long axis and across.
        let ellipse = Change { along: 1.2, ..same };
        let on = |mm: f64, turn: f64| [mm * (0.4 + turn).cos(), mm * (0.4 + turn).sin()];
        assert!((at(ellipse, on(7.0, 0.0)) - 1.0).abs() < 0.03);
        assert!((at(ellipse, on(6.0, std::f64::consts::FRAC_PI_2)) - 1.0).abs() < 0.03);
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
                assert!((0.15..2.6).contains(&most), "{part}: {most}");
                assert_eq!(at(part, [4.0, 2.0]), all.of(part, Side::Peg).at([4.0, 2.0]));
            }
        }
    }
}

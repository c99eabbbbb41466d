//! Where to slide a peg along the plate until it goes in.

use std::f64::consts::PI;

use tactile_data::pose::se2::Se2;

use crate::decision::Estimate;
use crate::error::{Error, Result};
use crate::insertion::tried::Tried;
use crate::matrix::{Matrix, by_jacobian, determinant, information, square};

/// Poses are searched that are as near to what is believed as 95 of 100 are: the squared error by the covariance of three numbers.
pub(crate) const CHI_SQUARE_95: f64 = 7.815;

/// Steps from the middle at most, along each axis: what is known less well wants touches, not a search.
const MOST_STEPS: i32 = 30;

/// The covariance of a peg in its hole when it is brought to where the hole is believed to be, to first order, from that of the first
/// touch's pose on the part.
pub(crate) fn offset_covariance(part_from_first: &Se2, covariance: &Matrix) -> Matrix {
    // The peg is at P E^-1 for a true pose P and an estimate E.
    let Se2 { x_mm, y_mm, .. } = *part_from_first;
    by_jacobian(&[[1.0, 0.0, y_mm], [0.0, 1.0, -x_mm], [0.0, 0.0, 1.0]], covariance)
}

/// A search for a hole with a peg: the peg is pressed on the plate lightly and slides from pose to pose until it goes in.
///
/// Pushing pegs in blindly is as old as assembly by robots (a survey of such searches: Chhatpar and Branicky, IROS 2001); here the poses are
/// as near to each other as the play asks for, and come in the order of their probability.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// By what the peg is moved from where the hole is believed to be, in the part's frame, in order; the first one is not moved.
    pub offsets: Vec<Se2>,
    /// What is learnt where the peg goes in at none of them ([`Episode::did_not_fit`](crate::Episode::did_not_fit)).
    pub in_vain: Tried,
    radius_mm: f64,
}

/// A peg in the hand, above the hole that the filter named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldPeg {
    /// By how much its hole is wider on every side, mm.
    pub play_mm: f64,
    /// From the middle of its part's frame to its farthest point, mm.
    pub radius_mm: f64,
    /// How well its pose in the hand is known: covariance of x, y (mm) and the angle (rad) in the part's frame.
    pub covariance: Matrix,
}

impl Estimate {
    /// How well it is known where the named part is against where it is believed to be: the covariance of x, y (mm) and the angle (rad), in
    /// the part's frame, of a peg in its hole when it is brought there. Of touches of a held peg it is [`HeldPeg::covariance`].
    pub fn offset_covariance(&self) -> Matrix {
        offset_covariance(&self.part_from_first, &self.covariance)
    }

    /// Where to slide the peg of the named part, over at most so many poses, `most`, at least one: in the order of their probability,
    /// as near to each other as the play asks for, and as far as 95 of 100 holes are, by both covariances.
    ///
    /// # Errors
    /// A covariance that no distribution has; a play or a radius that is not above zero.
    pub fn search(&self, peg: &HeldPeg, most: usize) -> Result<Search> {
        let of_hole = self.offset_covariance();
        let covariance = [0, 1, 2].map(|row| [0, 1, 2].map(|at| of_hole[row][at] + peg.covariance[row][at]));
        let (offsets, covered) = poses(&covariance, [peg.play_mm, peg.radius_mm], most)?;
        let in_vain = Tried { part: self.part.clone(), part_from_first: self.part_from_first, covariance, covered };
        Ok(Search { offsets, in_vain, radius_mm: peg.radius_mm })
    }
}

impl Search {
    /// How far the peg slides up to one of the poses, from the first one on, mm: its middle, and its farthest point where it turns.
    pub fn slide_mm(&self, last: usize) -> f64 {
        let pairs = self.offsets.iter().zip(self.offsets.iter().skip(1)).take(last);
        pairs.map(|(a, b)| a.distance_mm(b) + self.radius_mm * (b.theta_rad - a.theta_rad).abs()).sum()
    }
}

/// The poses of a search over a covariance of the peg in its hole, and how probable it is that one of them is the hole's; with its play
/// and its radius, mm. The peg goes in where it is off by the play at most, itself and by its turn at its farthest point.
fn poses(covariance: &Matrix, [play_mm, radius_mm]: [f64; 2], most: usize) -> Result<(Vec<Se2>, f64)> {
    for (what, value) in [("play, mm", play_mm), ("radius of the peg, mm", radius_mm)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::config(what, "a number above zero", value.to_string()));
        }
    }
    let information = information(covariance).ok_or_else(|| {
        let expected = "a covariance of x, y (mm) and the angle (rad)";
        Error::config("search", expected, format!("{covariance:?}"))
    })?;
    // No pose is farther from one that is tried than half of the play by its place, and half by its turn.
    let steps = [play_mm * 0.5_f64.sqrt(), play_mm * 0.5_f64.sqrt(), play_mm / radius_mm];
    let reach = [0, 1, 2].map(|axis| {
        let steps = (CHI_SQUARE_95 * covariance[axis][axis]).sqrt() / steps[axis];
        (steps.floor() as i32).clamp(0, MOST_STEPS)
    });
    let mut found: Vec<(f64, Se2)> = Vec::new();
    for x in -reach[0]..=reach[0] {
        for y in -reach[1]..=reach[1] {
            for turn in -reach[2]..=reach[2] {
                let off = [f64::from(x) * steps[0], f64::from(y) * steps[1], f64::from(turn) * steps[2]];
                let square = square(&information, off);
                if square <= CHI_SQUARE_95 {
                    found.push((square, Se2::new(off[0], off[1], off[2])));
                }
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(most.max(1));
    let density = 1.0 / ((2.0 * PI).powi(3) * determinant(covariance)).sqrt();
    let sum: f64 = found.iter().map(|(square, _)| (-0.5 * square).exp()).sum();
    let covered = (sum * density * steps[0] * steps[1] * steps[2]).min(0.95);
    Ok((found.into_iter().map(|(_, offset)| offset).collect(), covered))
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::TAU;

    use super::*;

    /// The search of a peg that is known exactly, over a hole so well known.
    fn over(covariance: &Matrix, sizes: [f64; 2], most: usize) -> Result<Search> {
        let (offsets, covered) = poses(covariance, sizes, most)?;
        let in_vain = Tried { part: "a".into(), part_from_first: Se2::IDENTITY, covariance: *covariance, covered };
        Ok(Search { offsets, in_vain, radius_mm: sizes[1] })
    }

    /// Correlated, of 0.3 and 0.2 mm and 0.6 degrees.
    fn covariance() -> Matrix {
        let sd = [0.3, 0.2, 0.6_f64.to_radians()];
        let correlation = [[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]];
        [0, 1, 2].map(|row| [0, 1, 2].map(|at| sd[row] * sd[at] * correlation[row][at]))
    }

    /// Draws of a normal distribution: Box and Muller's, by Cholesky's factor.
    fn draws(covariance: &Matrix, n: usize) -> Vec<[f64; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut factor = [[0.0_f64; 3]; 3];
        for row in 0..3 {
            for at in 0..=row {
                let sum: f64 = (0..at).map(|k| factor[row][k] * factor[at][k]).sum();
                let rest = covariance[row][at] - sum;
                factor[row][at] = if row == at { rest.sqrt() } else { rest / factor[at][at] };
            }
        }
        let mut normal = || (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt() * (TAU * rng.random::<f64>()).cos();
        let mut one = || {
            let unit = [normal(), normal(), normal()];
            factor.map(|row| (0..3).map(|at| row[at] * unit[at]).sum())
        };
        (0..n).map(|_| one()).collect()
    }

    #[test]
    fn of_what_is_believed_so_much_goes_in_as_is_said() {
        let draws = draws(&covariance(), 4000);
        for (play_mm, most) in [(0.3, 10_000), (0.3, 40), (0.15, 10_000), (2.0, 10_000)] {
            let search = over(&covariance(), [play_mm, 20.0], most).unwrap();
            assert!(search.offsets[0] == Se2::IDENTITY && search.offsets.len() <= most);
            let goes_in = |off: &&[f64; 3]| {
                search.offsets.iter().any(|at| {
                    let [x, y, turn] = [off[0] - at.x_mm, off[1] - at.y_mm, off[2] - at.theta_rad];
                    x.hypot(y) + 20.0 * turn.abs() <= play_mm
                })
            };
            let share = draws.iter().filter(goes_in).count() as f64 / 4000.0;
            // Around the outermost poses, and around each farther than the nearest pose is, it goes in, too.
            assert!(share > search.in_vain.covered - 0.02, "{play_mm} {most}: {share} {}", search.in_vain.covered);
            assert!(most == 40 || share >= 0.94, "{play_mm}: {share}");
            assert!(play_mm > 1.0 || share < search.in_vain.covered + 0.35);
        }
    }

    #[test]
    fn with_room_enough_it_goes_straight_down() {
        let search = over(&covariance(), [2.0, 20.0], 1000).unwrap();
        assert_eq!((search.offsets.len(), search.slide_mm(0)), (1, 0.0));
        let fine = over(&covariance(), [0.2, 20.0], 1000).unwrap();
        let n = fine.offsets.len();
        assert!(n > 100 && fine.slide_mm(n - 1) > fine.slide_mm(10) && fine.slide_mm(10) > 0.0);
        let by_hand = fine.offsets[0].distance_mm(&fine.offsets[1]) + 20.0 * fine.offsets[1].theta_rad.abs();
        assert!((fine.slide_mm(1) - by_hand).abs() < 1e-12);
    }

    #[test]
    fn the_peg_is_off_as_the_estimate_is() {
        let estimate = Se2::from_degrees(7.0, -3.0, 40.0);
        let offs = draws(&covariance(), 4000);
        let pegs = offs.iter().map(|off| {
            let truth = Se2::new(estimate.x_mm + off[0], estimate.y_mm + off[1], estimate.theta_rad + off[2]);
            let peg = truth * estimate.inverse();
            [peg.x_mm, peg.y_mm, peg.theta_rad]
        });
        let mut found = [[0.0; 3]; 3];
        pegs.for_each(|off| (0..3).for_each(|row| (0..3).for_each(|at| found[row][at] += off[row] * off[at] / 4000.0)));
        let expected = offset_covariance(&estimate, &covariance());
        for (row, at) in (0..3).flat_map(|row| (0..3).map(move |at| (row, at))) {
            let scale = (expected[row][row] * expected[at][at]).sqrt();
            assert!((found[row][at] - expected[row][at]).abs() < 0.06 * scale, "{row} {at}");
        }
    }

    #[test]
    fn what_cannot_be_searched_is_refused() {
        let error = |covariance: &Matrix, play_mm, radius_mm| {
            over(covariance, [play_mm, radius_mm], 9).unwrap_err().to_string()
        };
        assert_eq!(error(&covariance(), 0.0, 1.0), "play, mm: expected a number above zero, got 0");
        assert!(error(&covariance(), 0.3, f64::NAN).starts_with("radius of the peg, mm"));
        assert!(error(&[[0.0; 3]; 3], 0.3, 1.0).contains("a covariance of x, y (mm)"));
        assert!(error(&[[f64::NAN; 3]; 3], 0.3, 1.0).contains("a covariance of x, y (mm)"));
    }
}

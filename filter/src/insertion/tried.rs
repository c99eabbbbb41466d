//! What a peg that did not go in tells of its hole.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;
use tactile_infer::Bank;

use crate::belief::refine::steps_of;
use crate::error::{Error, Result};
use crate::insertion::search::{CHI_SQUARE_95, offset_covariance};
use crate::matrix::{Matrix, information, square};

/// A peg was tried over a hole and went in nowhere: the hole is another part's, or elsewhere, or was missed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tried {
    /// The peg's part.
    pub part: String,
    /// Where the first touch was believed to be on it.
    pub part_from_first: Se2,
    /// Where the peg may have been in the hole, as it was searched: covariance of x, y (mm) and the angle (rad) in the part's frame.
    pub covariance: Matrix,
    /// How probable it was that the peg would go in, if the hole was its own and near, 0..=1.
    pub covered: f64,
}

/// A [`Tried`] over the states of a grid.
#[derive(Clone, Debug)]
pub(crate) struct TriedStates {
    part: usize,
    symmetry: Symmetry,
    first_from_part: Se2,
    information: Matrix,
    /// Log of how probable it is that the peg misses its own hole there.
    log_missed: f64,
}

impl Tried {
    /// Over the states of a grid; a state is a cell of it.
    ///
    /// # Errors
    /// A part that the bank does not have, a pose that is not finite, a covariance that no distribution has, a share that is none.
    pub(crate) fn over(&self, bank: &Bank, states: &PoseGrid) -> Result<TriedStates> {
        /// No state is farther from the nearest pose than by half a cell on each axis: their squares, added.
        const NEAREST: f64 = 0.75;
        let Self { part, part_from_first, covariance, covered } = self;
        let part = bank.parts().iter().position(|name| name == part).ok_or_else(|| {
            Error::config("tried", format!("a part of the bank: {}", bank.parts().join(" ")), part.clone())
        })?;
        if !(part_from_first.is_finite() && (0.0..1.0).contains(covered)) {
            let got = format!("{part_from_first:?}, {covered}");
            return Err(Error::config("tried", "a pose of finite numbers and a probability below 1", got));
        }
        let mut cells = [[0.0; 3]; 3];
        steps_of(states).iter().enumerate().for_each(|(axis, step)| cells[axis][axis] = NEAREST * step * step);
        let cells = offset_covariance(part_from_first, &cells);
        let wide = [0, 1, 2].map(|row| [0, 1, 2].map(|at| CHI_SQUARE_95 * covariance[row][at] + cells[row][at]));
        let is_covariance = (0..3).all(|axis| covariance[axis][axis] >= 0.0);
        let information = information(&wide).filter(|_| is_covariance).ok_or_else(|| {
            let expected = "a covariance of x, y (mm) and the angle (rad)";
            Error::config("tried", expected, format!("{covariance:?}"))
        })?;
        Ok(TriedStates {
            part,
            symmetry: bank.symmetry(part),
            first_from_part: part_from_first.inverse(),
            information,
            log_missed: (1.0 - covered).ln(),
        })
    }
}

impl TriedStates {
    /// Log of how probable it was that the peg went in nowhere, if the hole is of a part and its first touch was at a pose on it.
    pub(crate) fn log(&self, part: usize, part_from_first: &Se2) -> f64 {
        let Self { symmetry, first_from_part, information, log_missed, .. } = self;
        if part != self.part {
            return 0.0;
        }
        // A hole that is turned by the part's own symmetry takes the peg, too.
        let twin = if symmetry.is_any() {
            symmetry.nearest_twin(part_from_first, &first_from_part.inverse())
        } else {
            *part_from_first
        };
        let off = twin * *first_from_part;
        if square(information, [off.x_mm, off.y_mm, off.theta_rad]) <= 1.0 { *log_missed } else { 0.0 }
    }

    /// Adds [`Self::log`] of the states of a part at an angle, `[n_places]`.
    pub(crate) fn add_block(&self, states: &PoseGrid, part: usize, angle: usize, sums: &mut [f64]) {
        if part == self.part {
            let cells = (angle..states.len()).step_by(states.n_theta());
            sums.iter_mut().zip(cells).for_each(|(sum, cell)| *sum += self.log(part, &states.pose(cell)));
        }
    }
}

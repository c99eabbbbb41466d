//! Where a held peg is: felt by a second sensor, on which the robot presses it.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::shape::Shape;
use tactile_data::sensor::simulator::frame_rng;
use tactile_filter::{Episode, KnownStart, Observation};
use tactile_infer::Bank;

use super::attempt::Task;
use super::workcell::Workcell;
use crate::error::{Error, Result};
use crate::hole::observe;

/// What the robot believes of the peg that it holds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// The peg's pose in the hand.
    pub held_from_peg: Se2,
    /// Covariance of x, y (mm) and the angle (rad) of the peg against what is believed.
    pub covariance: [[f64; 3]; 3],
    /// How often it was pressed on the sensor, and how far the hand went between.
    pub n_touches: usize,
    /// The same, mm.
    pub travel_mm: f64,
}

impl Held {
    /// A peg that nothing felt: it is held as it should be, up to the grasp's error.
    fn unfelt(task: &Task) -> Self {
        // Each error up to the largest is as likely as another.
        let variance = |most: f64| most * most / 3.0;
        let (mm2, rad2) = (variance(task.grasp_error_mm), variance(task.grasp_error_deg.to_radians()));
        let covariance = [[mm2, 0.0, 0.0], [0.0, mm2, 0.0], [0.0, 0.0, rad2]];
        Self { held_from_peg: Se2::IDENTITY, covariance, n_touches: 0, travel_mm: 0.0 }
    }

    /// By touches of the peg that the robot holds, at the points of its outline that are farthest from each other.
    pub(super) fn felt(workcell: &Workcell<'_>, peg: &Peg<'_>) -> Result<Self> {
        let (task, before) = (workcell.task(), Self::unfelt(workcell.task()));
        let reach_mm = workcell.bank().start().xy_half_mm;
        let places = far_apart(peg.outline, task.insertion.peg_touches, reach_mm);
        let Some(first) = places.first() else { return Ok(before) };
        // Where the robot takes the sensor to be on the peg, and where it is.
        let peg_from_held = peg.held_from_peg.inverse();
        let touch = |stream: usize, place: &Se2| -> Result<Observation> {
            let mut rng = frame_rng(peg.seed ^ 0x6865_6c64, stream as u64);
            let frame = workcell.simulator().touch(peg.part, Side::Peg, &(peg_from_held * *place), &mut rng)?;
            observe(&workcell.of_pegs().sensor, &frame)
        };
        let start = KnownStart::of_part(Se2::IDENTITY, before.covariance, *first);
        let config = workcell.of_pegs().config.with_start(start);
        let mut episode = Episode::begin(config, peg.bank_of_it(workcell)?, &touch(0, first)?)?;
        let mut travel_mm = 0.0;
        for (stream, pair) in places.windows(2).enumerate() {
            let moved = pair[0].inverse() * pair[1];
            travel_mm += pair[0].distance_mm(&pair[1]);
            episode.observe(moved, &touch(stream + 1, &pair[1])?)?;
        }
        let estimate = episode.estimate();
        Ok(Self {
            held_from_peg: *first * estimate.part_from_first.inverse(),
            covariance: estimate.offset_covariance(),
            n_touches: places.len(),
            travel_mm,
        })
    }
}

/// A peg that the robot has picked up.
pub(super) struct Peg<'p> {
    /// Its part, an index into the scene's.
    pub part: usize,
    pub outline: &'p Shape,
    /// Where it is in the hand.
    pub held_from_peg: Se2,
    /// Seed of the frames' draws.
    pub seed: u64,
}

impl Peg<'_> {
    fn bank_of_it(&self, workcell: &Workcell<'_>) -> Result<Arc<Bank>> {
        let (name, bank) = (&workcell.simulator().parts()[self.part], workcell.bank());
        let part = bank.parts().iter().position(|part| part == name);
        let part = part.ok_or_else(|| Error::invalid("bank", "the peg that is held", name.clone()))?;
        Ok(Arc::new(bank.with_parts(&[part])?))
    }
}

/// Some points of an outline that are far from each other: the one farthest from the middle, and each next one where the nearest of those
/// before is farthest. As far as the sensor is known, `reach_mm` along x and y.
fn far_apart(outline: &Shape, n: usize, reach_mm: f64) -> Vec<Se2> {
    let within = |[x, y]: [f64; 2]| x.abs() <= reach_mm && y.abs() <= reach_mm;
    let points: Vec<[f64; 2]> = outline.outline_points().filter(|point| within(*point)).collect();
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let mut places: Vec<[f64; 2]> = Vec::new();
    while places.len() < n {
        let nearest =
            |point: [f64; 2]| places.iter().map(|place| distance(*place, point)).fold(f64::INFINITY, f64::min);
        let far = |point: &[f64; 2]| if places.is_empty() { distance(*point, [0.0; 2]) } else { nearest(*point) };
        let Some(next) = points.iter().copied().max_by(|a, b| far(a).total_cmp(&far(b))) else { break };
        places.push(next);
    }
    places.into_iter().map(|[x, y]| Se2::new(x, y, 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use tactile_data::scene::shape::Shape;

    use super::*;

    #[test]
    fn pegs_are_felt_where_they_are_farthest_apart() {
        let corners = vec![[-4.0, -9.0], [4.0, -9.0], [4.0, 9.0], [-4.0, 9.0]];
        let bar = Shape { regions: vec![vec![corners]] };
        let places = |n, reach| far_apart(&bar, n, reach).iter().map(|at| [at.x_mm, at.y_mm]).collect::<Vec<_>>();
        // Opposite corners first. The third is on a long side, as far from one corner as from the other: 9 + y = |(8, 9 - y)|.
        let [a, b, c] = places(3, 20.0)[..] else { panic!() };
        assert!(a[0] == -b[0] && a[1] == -b[1] && a[0].abs() == 4.0 && a[1].abs() == 9.0);
        assert!(c[0].abs() == 4.0 && (c[1].abs() - 64.0 / 36.0).abs() < 0.05, "{c:?}");
        assert!(places(0, 20.0).is_empty());
        // What the sensor does not know is not touched.
        assert!(places(3, 5.0).iter().all(|at| at[0].abs() <= 5.0 && at[1].abs() <= 5.0));
        assert!(places(2, 1.0).is_empty());
    }
}

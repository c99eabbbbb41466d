//! How dense a bank its parts ask for: what is lost between recorded poses, measured before any is recorded.
//!
//! A view between recorded poses is interpolated from the four around it on each axis ([`Around`]). How far that is off is
//! seen half way between two of them, where it is farthest off: the view is touched there, and at the four places.

use rand::RngExt;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Background;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::sensor::simulator::{Simulator, frame_rng};

use crate::bank::between::Around;
use crate::bank::similarity::dot;
use crate::calibration::BLANK_SHARE;
use crate::embedding::model::Model;
use crate::embedding::threads;
use crate::error::{Error, Result};

use super::SceneBank;

/// Poses at which each part is looked at to choose steps ...
const N_TO_CHOOSE: u64 = 24;
/// ... and to say what given steps lose: a tenth of what a bank of 2 mm and 15 degrees touches.
const N_TO_SAY: u64 = 12;

/// Fewer edged ones say too little.
const ENOUGH: usize = 6;

/// Sets these draws apart from a bank's.
const SEED: u64 = 0x6465_6e73_6974_7900;

/// What a part loses between the poses of a grid, as far as it shows edges to judge it by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lost {
    /// Cosine lost half way between two places along x or y, above what two touches of one view differ by; 0 or more.
    pub along_xy: f64,
    /// The same between two angles.
    pub along_theta: f64,
}

/// The most that a bank which chooses its own steps loses along x, y and theta each, half way between two poses, cosine: 0.65 nats
/// of a touch that is as far from its own view as touches are, for the shipped model.
pub const ALLOWED: f64 = 0.012;

impl Lost {
    /// The larger of the two.
    pub fn most(&self) -> f64 {
        self.along_xy.max(self.along_theta)
    }

    /// Whether neither is above [`ALLOWED`].
    pub fn is_little(&self) -> bool {
        self.most() <= ALLOWED
    }
}

/// The steps that a bank may choose, the coarsest first: wider ones cannot be interpolated, mm ...
const XY_STEPS_MM: [f64; 2] = [2.0, 1.0];
/// ... and degrees.
const THETA_STEPS_DEG: [f64; 2] = [15.0, 7.5];

impl SceneBank<'_> {
    /// The coarsest grid over the scene's reach, among steps of 2 and 1 mm and 15 and 7.5 degrees, between whose poses no
    /// part loses more than [`ALLOWED`], or the finest where some part loses more; and what each part loses there.
    ///
    /// # Errors
    /// A scene without a reach, one whose reach none of these steps divide, or that cannot be touched.
    pub fn asked_for(&self) -> Result<(PoseGrid, Vec<Option<Lost>>)> {
        let reach = self.reach()?;
        let divides = |grid: PoseGrid| grid.validate().is_ok();
        let xy = XY_STEPS_MM.into_iter().filter(|mm| divides(PoseGrid { xy_step_mm: *mm, ..reach }));
        let theta = THETA_STEPS_DEG.into_iter().filter(|deg| divides(PoseGrid { theta_step_deg: *deg, ..reach }));
        let (xy, theta): (Vec<f64>, Vec<f64>) = (xy.collect(), theta.collect());
        let lost = self.lost_between([&xy, &theta], N_TO_CHOOSE)?;
        let chosen = (first_fine(&lost, xy.len(), |part| &part.xy), first_fine(&lost, theta.len(), |part| &part.theta));
        let (Some(at_xy), Some(at_theta)) = chosen else {
            let expected = format!("a reach that steps of {XY_STEPS_MM:?} mm and {THETA_STEPS_DEG:?} degrees divide");
            let got = format!("{} mm and {} degrees", reach.xy_half_mm, reach.theta_half_deg);
            return Err(Error::invalid(&self.scene.name, expected, got));
        };
        let grid = PoseGrid { xy_step_mm: xy[at_xy], theta_step_deg: theta[at_theta], ..reach };
        let of_part = |part: &OfPart| Lost { along_xy: part.xy[at_xy], along_theta: part.theta[at_theta] };
        Ok((grid, lost.iter().map(|part| part.as_ref().map(of_part)).collect()))
    }

    /// What each part loses between the poses of the scene's own reach.
    ///
    /// # Errors
    /// A scene without a reach, or that cannot be touched.
    pub fn lost(&self) -> Result<Vec<Option<Lost>>> {
        let reach = self.reach()?;
        let lost = self.lost_between([&[reach.xy_step_mm], &[reach.theta_step_deg]], N_TO_SAY)?;
        Ok(lost.into_iter().map(|part| part.map(|of| Lost { along_xy: of.xy[0], along_theta: of.theta[0] })).collect())
    }

    /// What each part loses between places and angles so far apart, mm and degrees, seen at so many poses; `None` of parts that
    /// show few edges.
    fn lost_between(&self, steps: [&[f64]; 2], n_poses: u64) -> Result<Vec<Option<OfPart>>> {
        let simulator = Simulator::new(self.scene.clone(), self.seed)?;
        let at_rest = simulator.no_contact(self.seed);
        let background = self.model.background(&at_rest)?.lit_by(&self.scene.sensor.known_lamps())?;
        let pegs = Pegs { model: self.model, simulator: &simulator, background, seed: self.seed ^ SEED };
        let reach = self.reach()?;
        threads::each(0..simulator.parts().len(), |part| pegs.lost(part, (&reach, n_poses), steps))
    }
}

/// What a part loses, for each step.
struct OfPart {
    xy: Vec<f64>,
    theta: Vec<f64>,
}

/// The first of so many steps at which no part loses more than [`ALLOWED`], or the last; `None` of none.
fn first_fine(lost: &[Option<OfPart>], n_steps: usize, of: impl Fn(&OfPart) -> &[f64]) -> Option<usize> {
    let is_little = |step: &usize| lost.iter().flatten().all(|part| of(part)[*step] <= ALLOWED);
    (0..n_steps).find(is_little).or(n_steps.checked_sub(1))
}

/// Pegs that are touched at any pose.
struct Pegs<'a> {
    model: &'a Model,
    simulator: &'a Simulator,
    background: Background,
    seed: u64,
}

impl Pegs<'_> {
    /// What a part loses, at so many poses of a reach.
    fn lost(&self, part: usize, (reach, n_poses): (&PoseGrid, u64), steps: [&[f64]; 2]) -> Result<Option<OfPart>> {
        let (mut lost, mut n_edged) = (steps.map(|steps| vec![0.0; steps.len()]), 0);
        let mut twice = 0.0;
        for number in 0..n_poses {
            let mut rng = frame_rng(self.seed, (part as u64 * N_TO_CHOOSE + number) << 8);
            let mut around = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
            let pose = [around(reach.xy_half_mm), around(reach.xy_half_mm), around(reach.theta_half_deg)];
            let mut stream = (part as u64 * N_TO_CHOOSE + number) << 8;
            let mut view = |off: [f64; 3]| {
                stream += 1;
                let [x, y, theta] = [0, 1, 2].map(|axis| pose[axis] + off[axis]);
                self.view(part, &Se2::from_degrees(x, y, theta), stream)
            };
            let (Some(first), Some(second)) = (view([0.0; 3])?, view([0.0; 3])?) else { continue };
            (n_edged, twice) = (n_edged + 1, twice + 1.0 - f64::from(dot(&first, &second)));
            // Along x and along y in turn.
            let axes = [number as usize % 2, 2];
            for ((axis, steps), sums) in axes.into_iter().zip(steps).zip(&mut lost) {
                for (step, sum) in steps.iter().zip(sums) {
                    let along = |place: f64| {
                        let mut off = [0.0; 3];
                        off[axis] = place * step;
                        view(off)
                    };
                    *sum += 1.0 - between(along, &first)?;
                }
            }
        }
        let of_one = |sum: f64| (sum - NOISE * twice).max(0.0) / n_edged as f64;
        let [xy, theta] = lost.map(|sums| sums.into_iter().map(of_one).collect());
        Ok((n_edged >= ENOUGH).then_some(OfPart { xy, theta }))
    }

    /// The key of a touch, of unit length; `None` where it shows no edge.
    fn view(&self, part: usize, pose: &Se2, stream: u64) -> Result<Option<Vec<f32>>> {
        let frame = self.simulator.touch(part, Side::Peg, pose, &mut frame_rng(self.seed, stream))?;
        let image = self.background.tactile_image(&frame)?;
        Ok(if image.edge_share < BLANK_SHARE { None } else { Some(self.model.embed_side(&[image], Side::Peg)?) })
    }
}

/// Share of what two touches of one view differ by that one touch differs from four that are interpolated by: noise is
/// averaged by the squares of their weights.
const NOISE: f64 = 0.5 * (1.0 + 164.0 / 256.0);

/// The cosine of a view with what is interpolated half way between the second and the third of four, at half steps of -3, -1,
/// 1 and 3. One without an edge is nothing recorded to interpolate with, so nothing is lost there.
fn between(mut view: impl FnMut(f64) -> Result<Option<Vec<f32>>>, at: &[f32]) -> Result<f64> {
    let middle = Around::new(0.0, 1.5, 1.0, 4).weights;
    let mut sum = vec![0.0; at.len()];
    for (place, weight) in [-1.5, -0.5, 0.5, 1.5].into_iter().zip(middle) {
        let Some(view) = view(place)? else { return Ok(1.0) };
        sum.iter_mut().zip(&view).for_each(|(sum, value)| *sum += weight * value);
    }
    let length = dot(&sum, &sum).sqrt();
    Ok(if length > 0.0 { f64::from(dot(&sum, at) / length) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four places on a circle, whose middle is known: walked by an angle a step, Catmull and Rom's points are symmetric, so the
    /// direction half way is the circle's own.
    #[test]
    fn half_way_on_a_circle_nothing_is_lost_and_at_a_corner_much() {
        let circle = |place: f64| {
            let (sin, cos) = (0.3 * place).sin_cos();
            Ok(Some(vec![cos as f32, sin as f32]))
        };
        assert!((between(circle, &[1.0, 0.0]).unwrap() - 1.0).abs() < 1e-6);
        // Another view in the middle than the four know of.
        assert!((between(circle, &[0.6, 0.8]).unwrap() - 0.6).abs() < 1e-6);
        assert_eq!(between(|_| Ok(None), &[1.0, 0.0]).unwrap(), 1.0);
        let nothing = |place: f64| Ok(Some(vec![if place > 0.0 { 1.0 } else { -1.0 }, 0.0]));
        assert_eq!(between(nothing, &[1.0, 0.0]).unwrap(), 0.0);
    }
}

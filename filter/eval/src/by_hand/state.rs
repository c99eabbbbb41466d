//! What a page draws of a hole that is touched by hand.

use serde::Serialize;
use tactile_data::pose::se2::Se2;
use tactile_filter::{Estimate, StopReason};

use super::ByHand;
use crate::error::Result;
use crate::narrative::picture::belief;
use crate::narrative::{PartPicture, felt, picture, places};

/// Everything that the page draws, as JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct State {
    /// Half of the plate's side, mm.
    pub plate_half_mm: f64,
    /// Where the first touch may be: mm from the middle along x and along y, and degrees.
    pub first_reach: [f64; 2],
    /// Width and height of what a touch shows, mm.
    pub view_mm: [f64; 2],
    /// The parts that the hole may be of.
    pub parts: Vec<Part>,
    /// Where the sensor was, on the plate.
    pub touches: Vec<Placed>,
    /// What the camera saw last, a data URI; the sensor at rest before the first touch.
    pub picture: String,
    /// What changed in it.
    pub changed: Option<String>,
    /// What was felt so far, about the named part: blue inside, red outside, its outline green, what differs yellow; where maps are drawn.
    pub felt: Option<String>,
    /// What is believed, once the plate was touched.
    pub named: Option<Named>,
    /// Where the filter would touch next, on the plate; nowhere once it would stop.
    pub next: Option<Placed>,
    /// The hole, once it is shown: its part's index, and where the part's frame is on the plate.
    pub truth: Option<(usize, Placed)>,
}

/// One part that the hole may be of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// Its outline in its own frame, mm: an SVG path.
    pub outline: String,
    /// Its probability now, 0..=1; as much for each before the first touch.
    pub probability: f64,
    /// Where the first touch may have been on it, a picture as a data URI that spans `belief_half_mm` to each side.
    pub belief: Option<String>,
    /// Half of the side of that picture, mm.
    pub belief_half_mm: f64,
}

/// A pose on the plate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Placed {
    /// Along x, mm.
    pub x_mm: f64,
    /// Along y, mm.
    pub y_mm: f64,
    /// The turn, degrees.
    pub theta_deg: f64,
}

/// What the filter says now.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Named {
    /// The most probable part, an index.
    pub part: usize,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// The probability that the hole is of none of the parts; absent where no edge was felt.
    pub none: Option<f64>,
    /// Where the part's frame is on the plate.
    pub at: Placed,
    /// Standard deviations of its place along x and y, mm, and of its angle, degrees.
    pub deviations: [f64; 3],
    /// Why the filter would stop now; nothing while it would go on.
    pub stop: Option<StopReason>,
}

impl From<Se2> for Placed {
    fn from(pose: Se2) -> Self {
        Self { x_mm: pose.x_mm, y_mm: pose.y_mm, theta_deg: pose.theta_deg() }
    }
}

impl ByHand {
    /// What there is to draw now.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn state(&self) -> Result<State> {
        let hole = &self.hole;
        let estimate = hole.episode.as_ref().map(|episode| episode.estimate());
        let felt = hole.episode.as_ref().map(|episode| felt(episode, &self.bank)).transpose()?.flatten();
        let changed = hole.frame.as_ref().map(|frame| {
            let image = self.shown.tactile_image(frame)?;
            picture::difference(&image, picture::full_scale(std::iter::once(&image)))
        });
        Ok(State {
            plate_half_mm: self.reach_mm(),
            first_reach: self.first_reach(),
            view_mm: self.board.field_of_view_mm,
            parts: self.parts(estimate.as_ref())?,
            touches: hole.touches.iter().map(|pose| (*pose).into()).collect(),
            picture: picture::frame(hole.frame.as_ref().unwrap_or(&self.at_rest))?,
            changed: changed.transpose()?,
            felt: felt.map(|felt| picture::frame(&felt.picture)).transpose()?,
            named: estimate.as_ref().map(|estimate| self.named(estimate)),
            next: hole.next.map(Into::into),
            truth: hole.is_shown.then(|| (hole.part, hole.plate_from_part.into())),
        })
    }

    fn parts(&self, estimate: Option<&Estimate>) -> Result<Vec<Part>> {
        let grid = self.bank.start();
        let n_xy = grid.n_xy();
        let places = self.hole.episode.as_ref().map(|episode| places(episode.belief(), &self.bank));
        let most = places.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let part = |(index, picture): (usize, &PartPicture)| {
            let of_part = places.as_ref().map(|places| &places[index * n_xy * n_xy..][..n_xy * n_xy]);
            let belief = of_part.map(|places| belief(places, n_xy, most)).transpose()?;
            let even = 1.0 / self.board.parts.len() as f64;
            Ok(Part {
                name: picture.name.clone(),
                outline: picture.svg_path(),
                probability: estimate.map_or(even, |estimate| estimate.class_posterior[index]),
                belief,
                belief_half_mm: grid.xy_half_mm + 0.5 * grid.xy_step_mm,
            })
        };
        self.board.parts.iter().enumerate().map(part).collect()
    }

    fn named(&self, estimate: &Estimate) -> Named {
        let part = self.bank.parts().iter().position(|name| *name == estimate.part).unwrap_or(0);
        let deviation = |axis: usize| estimate.covariance[axis][axis].max(0.0).sqrt();
        Named {
            part,
            probability: estimate.probability,
            none: estimate.presence.map(|presence| presence.none()),
            at: self.plate_from_named(estimate).into(),
            deviations: [deviation(0), deviation(1), deviation(2).to_degrees()],
            stop: estimate.stop,
        }
    }
}

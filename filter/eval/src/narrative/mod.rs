//! Single episodes touch by touch, for people: what was touched, what was seen, what was believed, why it went on there.

mod drawing;
pub mod episodes;
mod next_touch;
pub mod picture;
mod rows;
pub mod viewer;

use tactile_data::frame::{Background, Frame, Preprocessing, TactileImage};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::belief::Belief;
use tactile_filter::choice::{ActionRule, Choice};
use tactile_filter::{Episode, Presence};

use tactile_infer::Bank;
use tactile_infer::maps::mosaic::Difference;

use crate::error::{Error, Result};
use crate::holes::Holes;

/// What all episodes of an evaluation share.
#[derive(Clone, Debug)]
pub struct Board {
    /// The parts, in the order of the bank.
    pub parts: Vec<PartPicture>,
    /// Where each part was recorded.
    pub grid: PoseGrid,
    /// Width and height of what a frame shows, mm.
    pub field_of_view_mm: [f64; 2],
}

/// A part as it is drawn.
#[derive(Clone, Debug)]
pub struct PartPicture {
    /// Its name.
    pub name: String,
    /// Closed contours in the part's frame, mm, filled where their winding number is not zero.
    pub outline_mm: Vec<Vec<[f64; 2]>>,
}

/// One episode, touch by touch.
#[derive(Clone, Debug)]
pub struct Narrative {
    /// What to call it: its number; no two of a page are called the same.
    pub name: String,
    /// Why it is shown, in a few words.
    pub why: String,
    /// The true part, an index into [`Board::parts`].
    pub truth: usize,
    /// Why it ended, in a few words.
    pub stop: String,
    /// Whether it ended because no part explains the touches.
    pub refused: bool,
    /// The touches, in order; at least one.
    pub touches: Vec<NarrativeTouch>,
}

/// One touch: where it was, what was seen and what was believed after it.
#[derive(Clone, Debug)]
pub struct NarrativeTouch {
    /// True pose of the sensor on the true part.
    pub part_from_sensor: Se2,
    /// What the camera saw.
    pub frame: Frame,
    /// What the network saw.
    pub difference: TactileImage,
    /// The part named after it, an index into [`Board::parts`].
    pub guess: usize,
    /// Probability of `guess`, 0..=1.
    pub probability: f64,
    /// Believed pose of the sensor on `guess`.
    pub guess_from_sensor: Se2,
    /// Whether `guess` is there at all ([`tactile_filter::Estimate::presence`]); `None` where no edge was felt.
    pub presence: Option<Presence>,
    /// Probability of each place of the first touch, summed over the angle; sums to 1.
    ///
    /// `[part, x, y]`, y fastest: the order of [`PoseGrid::pose`] without its angle.
    pub belief: Vec<f64>,
    /// How the next touch was chosen; `None` after the last.
    pub next: Option<NextTouch>,
    /// What was felt, after the last touch, where maps were drawn.
    pub felt: Option<Felt>,
}

/// What the touches of an episode show of what they were made on.
#[derive(Clone, Debug)]
pub struct Felt {
    /// A picture of it ([`tactile_filter::FeltMap::picture`]).
    pub picture: Frame,
    /// How it differs from the named part.
    pub difference: Option<Difference>,
}

/// The choice of a next touch.
#[derive(Clone, Debug)]
pub struct NextTouch {
    /// The rule that chose.
    pub rule: ActionRule,
    /// Motions that the reach allowed.
    pub n_candidates: usize,
    /// What was chosen, and why.
    pub choice: Choice,
}

impl PartPicture {
    /// Its outline as an SVG path, mm.
    pub fn svg_path(&self) -> String {
        let contour = |points: &Vec<[f64; 2]>| {
            let places: Vec<_> = points.iter().map(|[x, y]| format!("{x:.2} {y:.2}")).collect();
            format!("M{}Z", places.join("L"))
        };
        self.outline_mm.iter().map(contour).collect()
    }
}

impl Board {
    /// What all episodes of some holes share.
    ///
    /// # Errors
    /// A part whose shape cannot be made.
    pub fn new(holes: Holes<'_>, bank: &Bank) -> Result<Self> {
        let part = |(index, name): (usize, &String)| {
            Ok(PartPicture { name: name.clone(), outline_mm: holes.outline_mm(index)? })
        };
        Ok(Self {
            parts: holes.parts().iter().enumerate().map(part).collect::<Result<_>>()?,
            grid: *bank.start(),
            field_of_view_mm: holes.field_of_view_mm(),
        })
    }

    /// A board without parts, for a page without episodes.
    pub fn empty() -> Self {
        Self { parts: Vec::new(), grid: PoseGrid::SMALL, field_of_view_mm: [1.0; 2] }
    }
}

impl Narrative {
    /// Refuses an episode that does not fit a board.
    fn check(&self, board: &Board) -> Result<()> {
        let n_parts = board.parts.len();
        let n_values = n_parts * board.grid.n_xy().pow(2);
        if self.touches.is_empty() {
            return Err(Error::invalid(&self.name, "at least one touch", "none"));
        }
        let pairs = self.touches.iter().filter_map(|touch| touch.next.as_ref()?.choice.expected?.pair);
        let pair_parts = pairs.flat_map(|(pair, _)| pair);
        let named = self.touches.iter().map(|touch| touch.guess).chain([self.truth]).chain(pair_parts);
        if let Some(part) = named.into_iter().find(|part| *part >= n_parts) {
            return Err(Error::invalid(&self.name, format!("one of {n_parts} parts"), format!("part {part}")));
        }
        match self.touches.iter().zip(1..).find(|(touch, _)| touch.belief.len() != n_values) {
            Some((touch, n)) => {
                let (what, got) = (format!("{}: touch {n}", self.name), touch.belief.len().to_string());
                Err(Error::invalid(what, format!("a belief of {n_values} places"), got))
            }
            None => Ok(()),
        }
    }
}

/// What an episode felt, as a page shows it.
pub(crate) fn felt(episode: &Episode, bank: &Bank) -> Result<Option<Felt>> {
    let map = episode.felt_map();
    let felt = map.map(|map| Ok(Felt { picture: map.picture(bank, 2)?, difference: map.difference }));
    felt.transpose()
}

/// What the network sees of frames, at the size that a page shows.
pub(crate) fn shown_background(at_rest: &Frame) -> Result<Background> {
    let size = [80.min(at_rest.width_px()), 60.min(at_rest.height_px())];
    Ok(Background::new(at_rest, &Preprocessing::counts(size))?)
}

/// Probability of each recorded place of the first touch, `[part, x, y]`, summed over the angle.
pub(crate) fn places(belief: &Belief, bank: &Bank) -> Vec<f64> {
    let grid = bank.start();
    let n_places = grid.n_xy().pow(2);
    let mut places = vec![0.0; n_places * bank.parts().len()];
    for (hypothesis, mass) in belief.posterior().states() {
        if let Some(cell) = grid.nearest(&belief.posterior().grid().pose(hypothesis.cell)) {
            places[hypothesis.part * n_places + cell / grid.n_theta()] += mass;
        }
    }
    places
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use tactile_filter::choice::{Action, Expected, Scored};

    pub(crate) fn board() -> Board {
        let square = vec![[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
        let part = |name: &str| PartPicture { name: name.into(), outline_mm: vec![square.clone()] };
        Board { parts: vec![part("A<B"), part("C")], grid: PoseGrid::SMALL, field_of_view_mm: [17.0, 13.0] }
    }

    fn next() -> NextTouch {
        let scored = |x, score| Scored { sensor_from_next: Se2::from_degrees(x, 0.0, 0.0), score, by_all_draws: true };
        let scored = vec![scored(4.0, Some(0.75)), scored(-4.0, None)];
        let action = Action { sensor_from_next: scored[0].sensor_from_next };
        let expected = Some(Expected { nats: 0.75, part_nats: 0.5, pair: Some(([1, 0], 0.5)) });
        let choice = Choice { action, scored, expected, presence_nats: None };
        NextTouch { rule: ActionRule::Information, n_candidates: 3, choice }
    }

    pub(crate) fn episode() -> Narrative {
        let frame = Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (i / 6) as u8).collect()).unwrap();
        let background = Background::new(&frame, &Preprocessing::counts([8, 6])).unwrap();
        let touch = NarrativeTouch {
            part_from_sensor: Se2::from_degrees(4.0, 0.0, 30.0),
            difference: background.tactile_image(&frame).unwrap(),
            frame,
            guess: 1,
            probability: 0.5,
            presence: Some(Presence { log_odds: 0.0, stranger_rate: 0.125, present_rate: 0.5 }),
            guess_from_sensor: Se2::from_degrees(0.0, 4.0, 0.0),
            belief: vec![1.0 / 50.0; 50],
            next: Some(next()),
            felt: None,
        };
        let touches = vec![touch.clone(), NarrativeTouch { presence: None, next: None, ..touch }];
        Narrative {
            name: "episode 3".into(),
            why: "as one of the first".into(),
            truth: 0,
            stop: "limit".into(),
            refused: false,
            touches,
        }
    }

    #[test]
    fn an_episode_of_another_board_is_refused() {
        let error = |episode: &Narrative| episode.check(&board()).unwrap_err().to_string();
        let mut short = episode();
        short.touches[1].belief.pop();
        assert_eq!(error(&short), "episode 3: touch 2: expected a belief of 50 places, got 49");
        let mut unknown = episode();
        unknown.touches[0].guess = 2;
        assert!(error(&unknown).contains("one of 2 parts, got part 2"));
    }
}

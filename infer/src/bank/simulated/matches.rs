//! How well the touches of each part match its own views, and the metric in which they do best, measured in simulation.

use rand::RngExt;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Background;
use tactile_data::pose::se2::Se2;
use tactile_data::sensor::simulator::{Simulator, frame_rng};

use crate::bank::Bank;
use crate::bank::between::is_fine;
use crate::bank::matches::{Matches, PartMatch};
use crate::bank::metric::{Measured, Metric, Pair};
use crate::calibration::{BLANK_SHARE, Spread};
use crate::embedding::model::Model;
use crate::embedding::threads;
use crate::error::Result;

/// Touches of each side of each part.
const N_TOUCHES: u64 = 64;

/// Fewer edged ones say too little.
const ENOUGH: usize = 16;

/// Touches that a bank made of its own parts: of their holes and of their pegs.
#[derive(Debug)]
pub(super) struct OwnTouches {
    sides: [Vec<Touches>; 2],
}

/// The edged touches of one side of one part whose views are known.
type Touches = Vec<Pair>;

/// The touches of some parts, by which a bank of these learns.
pub(super) struct OfParts<'a> {
    /// `[side][part]`
    sides: [Vec<&'a Touches>; 2],
}

/// What a bank's own touches say.
pub(super) struct Learnt {
    /// How well each part matches, in the metric where there is one.
    pub matches: Matches,
    /// The metric in which they match best.
    pub metric: Option<Metric>,
}

impl OwnTouches {
    /// Touches each part of a bank that compares by the cosine alone, anywhere within the bank's poses, or at them
    /// where they are too far apart to be interpolated. `parts` says where they are in the simulator. The frames are of
    /// another session than the bank's.
    ///
    /// # Errors
    /// A touch that cannot be made or seen.
    pub fn new(model: &Model, bank: &Bank, (simulator, parts): (&Simulator, &[usize]), seed: u64) -> Result<Self> {
        let seed = seed ^ 0x6d61_7463_6865_7300;
        let lamps = simulator.scene().sensor.known_lamps();
        let background = model.background(&simulator.no_contact(seed))?.lit_by(&lamps)?;
        let toucher = Toucher { model, bank, simulator, parts, seed, background };
        let of_side = |side| threads::each(0..parts.len(), |part| toucher.touch_part(part, side));
        Ok(Self { sides: [of_side(Side::Hole)?, of_side(Side::Peg)?] })
    }

    /// The touches of some of the parts, in their order.
    pub fn of_parts(&self, parts: &[usize]) -> OfParts<'_> {
        OfParts { sides: self.sides.each_ref().map(|side| parts.iter().map(|part| &side[*part]).collect()) }
    }
}

impl OfParts<'_> {
    /// What the touches say, made at the views of a bank of just these parts that compares embeddings, `[dim]`, by the cosine
    /// alone. The metric is learnt from the touches of some sides.
    ///
    /// What a touch matches like is measured in the metric that the other half of the touches gives: one that it taught
    /// itself would flatter it.
    pub fn learn(&self, dim: usize, from: &[Side]) -> Learnt {
        let place = |side: Side| usize::from(side == Side::Peg);
        let learnt: Vec<&[&Touches]> = from.iter().map(|side| &*self.sides[place(*side)]).collect();
        let halves = [1, 0].map(|half| metric_of(dim, &learnt, |touch| touch % 2 == half));
        // Without one of them there is no metric at all.
        let halves = if let [Some(odd), Some(even)] = halves { Some([odd, even]) } else { None };
        let in_other_half = |touches: &&Touches| {
            let halves = |touch: usize| halves.as_ref().map(|halves| &halves[touch % 2]);
            touches.iter().enumerate().map(|(touch, pair)| pair.cosine(halves(touch))).collect()
        };
        let cosines = self.sides.each_ref().map(|parts| parts.iter().map(in_other_half).collect::<Vec<Vec<f64>>>());
        let metric = halves.as_ref().and_then(|_| metric_of(dim, &learnt, |_| true)).map(|metric| {
            let of_learnt = from.iter().flat_map(|side| &cosines[place(*side)]).flatten();
            let error: f64 = of_learnt.map(|cosine| 1.0 - cosine).sum();
            let touches = learnt.iter().flat_map(|parts| parts.iter().copied().flatten());
            let plain: f64 = touches.map(|pair| 1.0 - pair.cosine(None)).sum();
            let error_scale = if plain > 0.0 && error > 0.0 { error / plain } else { 1.0 };
            metric.with_measured(Measured { error_scale })
        });
        let spread =
            |cosines: Vec<f64>| (cosines.len() >= ENOUGH).then(|| PartMatch { matched: Spread::from_values(&cosines) });
        let [holes, pegs] = cosines.map(|parts| parts.into_iter().map(spread).collect());
        Learnt { matches: Matches { holes, pegs }, metric }
    }
}

/// The metric that some touches of each part give, chosen by their number.
fn metric_of(dim: usize, sides: &[&[&Touches]], is_chosen: impl Fn(usize) -> bool) -> Option<Metric> {
    let mut chosen = Vec::new();
    for parts in sides {
        let touches = parts.iter().flat_map(|touches| touches.iter().enumerate());
        chosen.push(touches.filter(|(touch, _)| is_chosen(*touch)).map(|(_, pair)| pair).collect());
    }
    Metric::of_touches(dim, &chosen)
}

/// Touches the parts of a bank.
struct Toucher<'a> {
    model: &'a Model,
    bank: &'a Bank,
    simulator: &'a Simulator,
    /// Where the bank's parts are in the simulator.
    parts: &'a [usize],
    seed: u64,
    background: Background,
}

impl Toucher<'_> {
    /// A part's edged touches where their view is known.
    fn touch_part(&self, part: usize, side: Side) -> Result<Touches> {
        let first = 1 + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg));
        let touches = (first..first + N_TOUCHES).map(|stream| self.touch(part, side, stream));
        Ok(touches.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect())
    }

    fn touch(&self, part: usize, side: Side, stream: u64) -> Result<Option<Pair>> {
        let mut rng = frame_rng(self.seed, stream);
        let pose = self.pose(&mut rng);
        let frame = self.simulator.touch(self.parts[part], side, &pose, &mut rng)?;
        let image = self.background.tactile_image(&frame)?;
        if image.edge_share < BLANK_SHARE {
            return Ok(None);
        }
        let touch = self.model.embed_side(&[image], side)?;
        let view = self.bank.row_between(part, &pose);
        Ok(view.map(|view| Pair { touch, view }))
    }

    fn pose(&self, rng: &mut impl RngExt) -> Se2 {
        let grid = self.bank.grid();
        if !is_fine(grid) {
            return grid.pose(rng.random_range(0..grid.len()));
        }
        grid.draw(rng)
    }
}

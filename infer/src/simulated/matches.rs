//! How well the touches of each part match its own views, and the metric in which they do best, measured in simulation.

use rand::RngExt;
use tactile_data::frame::Background;
use tactile_data::se2::Se2;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::between::is_fine;
use crate::calibration::{BLANK_SHARE, Spread};
use crate::error::Result;
use crate::matches::{Matches, PartMatch};
use crate::metric::{Measured, Metric, Pair};
use crate::model::Model;
use crate::threads;

use super::temperature::Tried;

/// Touches of each side of each part.
const N_TOUCHES: u64 = 64;

/// Fewer edged ones say too little.
const ENOUGH: usize = 16;

/// Of these touches of all parts the temperature is found.
const N_JUDGED: usize = 512;

/// Touches that a bank makes of its own parts.
pub(super) struct OwnTouches<'a> {
    model: &'a Model,
    bank: &'a Bank,
    simulator: &'a Simulator,
    /// Where the bank's parts are in the simulator.
    parts: &'a [usize],
    seed: u64,
    background: Background,
}

/// What a bank's own touches say.
pub(super) struct Learnt {
    /// How well each part matches, in the metric where there is one.
    pub matches: Matches,
    /// The metric in which they match best.
    pub metric: Option<Metric>,
}

/// An edged touch whose view is known.
struct Touch {
    part: usize,
    pair: Pair,
}

/// The touches of a side, `[part][touch]`.
type OfSide = Vec<Vec<Touch>>;

impl<'a> OwnTouches<'a> {
    /// Nothing is touched yet. The frames are of another session than the bank's.
    ///
    /// # Errors
    /// A sensor at rest that cannot be seen.
    pub fn new(
        model: &'a Model,
        bank: &'a Bank,
        (simulator, parts): (&'a Simulator, &'a [usize]),
        seed: u64,
    ) -> Result<Self> {
        let seed = seed ^ 0x6d61_7463_6865_7300;
        let lamps = simulator.scene().sensor.known_lamps();
        let background = model.background(&simulator.no_contact(seed))?.lit_by(&lamps)?;
        Ok(Self { model, bank, simulator, parts, seed, background })
    }

    /// Touches each part anywhere within the bank's poses, or at them where they are too far apart to be interpolated. The
    /// metric is learnt from the touches of some sides.
    ///
    /// What a touch matches like is measured in the metric that the other half of the touches gives: one that it taught
    /// itself would flatter it.
    ///
    /// # Errors
    /// A touch that cannot be made or seen.
    pub fn learn(&self, from: &[Side]) -> Result<Learnt> {
        let of_side = |side| threads::each(0..self.parts.len(), |part| self.touch_part(part, side));
        let place = |side: Side| usize::from(side == Side::Peg);
        let sides: [OfSide; 2] = [of_side(Side::Hole)?, of_side(Side::Peg)?];
        let learnt: Vec<&OfSide> = from.iter().map(|side| &sides[place(*side)]).collect();
        let halves = [1, 0].map(|half| self.metric_of(&learnt, |touch| touch % 2 == half));
        // Without one of them there is no metric at all.
        let halves = if let [Some(odd), Some(even)] = halves { Some([odd, even]) } else { None };
        let in_other_half = |touches: &Vec<Touch>| {
            let halves = |touch: usize| halves.as_ref().map(|halves| &halves[touch % 2]);
            touches.iter().enumerate().map(|(touch, Touch { pair, .. })| pair.cosine(halves(touch))).collect()
        };
        let cosines = sides.each_ref().map(|parts| parts.iter().map(in_other_half).collect::<Vec<Vec<f64>>>());
        let metric = match &halves {
            Some(halves) => {
                let of_learnt = from.iter().flat_map(|side| &cosines[place(*side)]).flatten();
                let error: f64 = of_learnt.map(|cosine| 1.0 - cosine).sum();
                let touches = learnt.iter().flat_map(|parts| parts.iter().flatten());
                let plain: f64 = touches.map(|touch| 1.0 - touch.pair.cosine(None)).sum();
                let error_scale = if plain > 0.0 && error > 0.0 { error / plain } else { 1.0 };
                let measured = Measured { error_scale, temperature: self.temperature(&learnt, halves)? };
                self.metric_of(&learnt, |_| true).map(|metric| metric.with_measured(measured))
            }
            None => None,
        };
        let spread = |cosines: Vec<f64>| (cosines.len() >= ENOUGH).then(|| PartMatch { matched: Spread::of(&cosines) });
        let [holes, pegs] = cosines.map(|parts| parts.into_iter().map(spread).collect());
        Ok(Learnt { matches: Matches { holes, pegs }, metric })
    }

    /// The metric that some touches of each part give, chosen by their number.
    fn metric_of(&self, sides: &[&OfSide], is_chosen: impl Fn(usize) -> bool) -> Option<Metric> {
        let mut chosen = Vec::new();
        for parts in sides {
            let touches = parts.iter().flat_map(|touches| touches.iter().enumerate());
            chosen.push(touches.filter(|(touch, _)| is_chosen(*touch)).map(|(_, touch)| &touch.pair).collect());
        }
        Metric::of_touches(self.bank.dim(), &chosen)
    }

    /// The temperature at which the touches of each half tell their parts best, in the metric that the other half gives.
    fn temperature(&self, sides: &[&OfSide], halves: &[Metric; 2]) -> Result<Option<f64>> {
        let (edged, n_cells, mut tried) = (self.bank.edged_rows(), self.bank.grid().len(), Tried::new());
        for (half, metric) in halves.iter().enumerate() {
            let parts = sides.iter().flat_map(|parts| parts.iter());
            let touches: Vec<&Touch> = parts.flat_map(|touches| touches.iter().skip(half).step_by(2)).collect();
            let stride = (2 * touches.len()).div_ceil(N_JUDGED).max(1);
            let judged = touches.iter().step_by(stride);
            let judged: Vec<_> = judged.map(|touch| (touch.part, metric.apply(&touch.pair.touch))).collect();
            tried.add(&judged, (&metric.rows(self.bank.rows())?, &edged, n_cells));
        }
        Ok(tried.best())
    }

    /// A part's edged touches where their view is known.
    fn touch_part(&self, part: usize, side: Side) -> Result<Vec<Touch>> {
        let first = 1 + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg));
        let touches = (first..first + N_TOUCHES).map(|stream| self.touch(part, side, stream));
        Ok(touches.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect())
    }

    fn touch(&self, part: usize, side: Side, stream: u64) -> Result<Option<Touch>> {
        let mut rng = frame_rng(self.seed, stream);
        let pose = self.pose(&mut rng);
        let frame = self.simulator.touch(self.parts[part], side, &pose, &mut rng)?;
        let image = self.background.tactile_image(&frame)?;
        if image.edge_share < BLANK_SHARE {
            return Ok(None);
        }
        let touch = self.model.embed_side(&[image], side)?;
        let view = self.bank.row_between(part, &pose);
        Ok(view.map(|view| Touch { part, pair: Pair { touch, view } }))
    }

    fn pose(&self, rng: &mut impl RngExt) -> Se2 {
        let grid = self.bank.grid();
        if !is_fine(grid) {
            return grid.pose(rng.random_range(0..grid.len()));
        }
        let mut around = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
        Se2::from_degrees(around(grid.xy_half_mm), around(grid.xy_half_mm), around(grid.theta_half_deg))
    }
}

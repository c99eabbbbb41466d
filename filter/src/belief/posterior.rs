//! S: the probability of each hypothesis after the touches so far. Both engines return one, a new one after each touch.
//!
//! States come in blocks of one length: for the exact engine the states of a part at one angle, for particles the states of
//! a part.
//! What is asked of all states is answered by what each block says of itself.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::pose::grid::PoseGrid;

use crate::belief::hypothesis::{Hypothesis, Layout};
use crate::simd;

/// What is known of the states of a block together. All zero where the block holds none of the belief.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Block {
    /// Probability of all its states, 0..=1.
    pub share: f64,
    /// Probability of its likeliest state, 0..=1.
    pub top: f64,
    /// What its likeliest state has among [`Values`].
    pub largest: f64,
    /// The sum of -p ln p over its states, nats.
    pub entropy: f64,
}

/// What the probability of each state comes from, `[n_blocks, length]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    /// `top e^(log - largest)`, with the block's `top` and `largest`: found where it is asked for.
    Logs(Arc<Vec<f64>>),
    /// The probability.
    Probabilities(Vec<f64>),
}

/// The likeliest state of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Best {
    /// Its log-posterior accumulated over all touches, up to a constant of all states.
    pub score: f64,
    /// The state; the lowest of equals.
    pub state: Hypothesis,
}

/// S: the probability of each hypothesis given the touches so far. It never changes: the next touch makes another.
#[derive(Clone, Debug, PartialEq)]
pub struct Posterior {
    grid: PoseGrid,
    layout: Layout,
    blocks: Vec<Block>,
    values: Values,
    by_part: Vec<f64>,
    best: Vec<Option<Best>>,
    left_out: f64,
}

/// What an engine knows after a touch.
pub(crate) struct Weighed {
    /// `[n_blocks]`.
    pub blocks: Vec<Block>,
    /// `[n_blocks, length]`.
    pub values: Values,
    /// `[n_parts]`; `None` where no state of the part is held.
    pub best: Vec<Option<Best>>,
    /// [`Posterior::left_out`].
    pub left_out: f64,
}

impl Posterior {
    /// What is believed of states at the poses of a grid, in the order of a layout.
    pub(crate) fn new(grid: PoseGrid, layout: Layout, weighed: Weighed) -> Self {
        let Weighed { blocks, values, best, left_out } = weighed;
        let mut by_part = vec![0.0; blocks.len() / layout.n_angles];
        blocks.iter().enumerate().for_each(|(at, block)| by_part[at / layout.n_angles] += block.share);
        Self { grid, layout, blocks, values, by_part, best, left_out }
    }

    /// Lets go of the states, so that an engine that shares them may change them without a copy.
    pub(crate) fn release(&mut self) {
        self.values = Values::Probabilities(Vec::new());
    }

    /// The grid of the states: the bank's, or a finer one.
    pub fn grid(&self) -> &PoseGrid {
        &self.grid
    }

    /// The number of states, held or not.
    pub fn n_states(&self) -> usize {
        self.blocks.len() * self.layout.n_places
    }

    /// The probability of each part, `[n_parts]`, which sum to 1 (paper, Eq. 7).
    pub fn by_part(&self) -> &[f64] {
        &self.by_part
    }

    /// The total variation from the posterior over all states is at most this, 0..=1: what was left out of the belief
    /// because it cannot hold more together. At most [`ALLOWED_ERROR`](crate::belief::ALLOWED_ERROR); of particles
    /// nothing is known, and it is 0.
    pub fn left_out(&self) -> f64 {
        self.left_out
    }

    /// Shannon entropy over the states, nats.
    pub fn entropy_nats(&self) -> f64 {
        self.blocks.iter().map(|block| block.entropy).sum::<f64>().max(0.0)
    }

    /// The state of largest log-posterior accumulated over all touches, among the states that the engine
    /// holds; where `part` is given, among the states of that part. The lowest of equals.
    ///
    /// `None` only where no state of `part` is held.
    pub fn best(&self, part: Option<usize>) -> Option<Hypothesis> {
        let parts = part.map_or(0..self.best.len(), |part| part..part + 1);
        let found = self.best[parts].iter().flatten().copied();
        let best = found.reduce(|best, next| if next.score > best.score { next } else { best });
        best.map(|best| best.state)
    }

    /// The distinct states of positive probability in ascending order, with their probabilities, which sum to 1.
    pub fn states(&self) -> Vec<(Hypothesis, f64)> {
        self.states_from(0.0)
    }

    /// The states among [`Self::states`] that have at least a probability.
    pub fn states_from(&self, least: f64) -> Vec<(Hypothesis, f64)> {
        let parts = 0..self.by_part.len();
        parts.flat_map(|part| self.states_of(part)).filter(|(_, probability)| *probability >= least).collect()
    }

    /// The states of a part among [`Self::states`].
    pub(crate) fn states_of(&self, part: usize) -> Vec<(Hypothesis, f64)> {
        let Layout { n_angles, n_places } = self.layout;
        let of_angle = |angle| Some((angle, self.probabilities(part * n_angles + angle)?));
        let held: Vec<(usize, Cow<[f64]>)> = (0..n_angles).filter_map(of_angle).collect();
        let mut states = Vec::new();
        for place in 0..n_places {
            let state = |(angle, of_angle): &(usize, Cow<[f64]>)| {
                (Hypothesis { part, cell: place * n_angles + angle }, of_angle[place])
            };
            states.extend(held.iter().map(state).filter(|(_, probability)| *probability > 0.0));
        }
        states
    }

    /// The likeliest of [`Self::states_from`], `most` at most, ascending. Blocks whose likeliest state is not among them
    /// are passed over.
    pub fn heaviest_states(&self, least: f64, most: usize) -> Vec<(Hypothesis, f64)> {
        let mut order: Vec<usize> = (0..self.blocks.len()).filter(|at| self.blocks[*at].top > 0.0).collect();
        order.sort_by(|a, b| self.blocks[*b].top.total_cmp(&self.blocks[*a].top));
        let (mut heaviest, mut least) = (Vec::new(), least.max(f64::MIN_POSITIVE));
        for at in order {
            if self.blocks[at].top < least {
                break;
            }
            self.take_likely(at, least, &mut heaviest);
            if heaviest.len() > 2 * most {
                least = keep_heaviest(&mut heaviest, most).max(least);
            }
        }
        keep_heaviest(&mut heaviest, most);
        let mut heaviest: Vec<(Hypothesis, f64)> =
            heaviest.into_iter().map(|(state, probability)| (self.layout.hypothesis(state), probability)).collect();
        heaviest.sort_unstable_by_key(|(hypothesis, _)| *hypothesis);
        heaviest
    }

    /// `n` states drawn from the belief, ascending, each about as often as it is probable.
    pub fn draw(&self, n: usize, rng: &mut ChaCha8Rng) -> Vec<Hypothesis> {
        let mut drawn = self.draw_at(n, rng.random());
        drawn.sort_unstable();
        drawn
    }

    /// Systematic resampling: `n` states, block by block, each about as often as it is probable. `offset`: one uniform
    /// draw in 0..1.
    fn draw_at(&self, n: usize, offset: f64) -> Vec<Hypothesis> {
        let mut drawn = Vec::with_capacity(n);
        let position = |k: usize| (k as f64 + offset) / n as f64;
        // Rounding may leave the last position above the sum of all.
        let mut last = self.best(None).unwrap_or(Hypothesis { part: 0, cell: 0 });
        let mut passed = 0.0;
        for (at, block) in self.blocks.iter().enumerate().filter(|(_, block)| block.top > 0.0) {
            let end = passed + block.share;
            let mut cumulative = passed;
            passed = end;
            if drawn.len() == n || position(drawn.len()) >= end {
                continue;
            }
            for (state, probability) in self.range(at).zip(self.probabilities(at).as_deref().unwrap_or_default()) {
                if drawn.len() == n || position(drawn.len()) >= end {
                    break;
                }
                cumulative += probability;
                last = if *probability > 0.0 { self.layout.hypothesis(state) } else { last };
                while drawn.len() < n && position(drawn.len()) < cumulative {
                    drawn.push(last);
                }
            }
            // Rounding may leave a position between the sum of the states and that of the block.
            while drawn.len() < n && position(drawn.len()) < end {
                drawn.push(last);
            }
        }
        drawn.resize(n, last);
        drawn
    }

    /// The states of a block.
    fn range(&self, block: usize) -> Range<usize> {
        block * self.layout.n_places..(block + 1) * self.layout.n_places
    }

    /// The probabilities of the states of a block, `[length]`; `None` where it holds none of the belief.
    fn probabilities(&self, at: usize) -> Option<Cow<'_, [f64]>> {
        let Block { top, largest, .. } = self.blocks[at];
        (top > 0.0).then(|| match &self.values {
            Values::Logs(logs) => {
                let mut probabilities = simd::powers(&logs[self.range(at)], largest, 1.0);
                probabilities.iter_mut().for_each(|of_state| *of_state *= top);
                probabilities.into()
            }
            Values::Probabilities(probabilities) => probabilities[self.range(at)].into(),
        })
    }

    /// Adds the states of a block that have at least a probability, which is positive, with it.
    fn take_likely(&self, at: usize, least: f64, taken: &mut Vec<(usize, f64)>) {
        let Block { top, largest, .. } = self.blocks[at];
        let states = self.range(at);
        match &self.values {
            Values::Logs(logs) => {
                // Below, no state has so much: a billionth more than rounding takes.
                let log_least = largest + (least / top).ln() - 1e-9;
                let held = states.clone().zip(&logs[states]).filter(|(_, log)| **log >= log_least);
                let weighed = held.map(|(state, log)| (state, top * simd::power(*log, largest)));
                taken.extend(weighed.filter(|(_, probability)| *probability >= least));
            }
            Values::Probabilities(probabilities) => {
                let held = states.clone().zip(probabilities[states].iter().copied());
                taken.extend(held.filter(|(_, probability)| *probability >= least));
            }
        }
    }
}

/// Drops all but the likeliest of some states; returns the least probability that was kept.
fn keep_heaviest<T>(states: &mut Vec<(T, f64)>, most: usize) -> f64 {
    if states.len() > most {
        states.select_nth_unstable_by(most, |a, b| b.1.total_cmp(&a.1));
        states.truncate(most);
    }
    states.iter().map(|(_, probability)| *probability).fold(f64::INFINITY, f64::min)
}

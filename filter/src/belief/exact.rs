//! Exact Bayes, where it matters: the default engine.
//!
//! States come in blocks. A touch is judged first in the blocks that may hold most of the belief, then in the next,
//! until all that are left can hold no more of it together than is allowed. They are left out: their states have no
//! probability until, after some later touch, they may matter; the touches that they missed are then judged there, too.

use std::ops::Range;
use std::sync::Arc;

use crate::belief::hypothesis::Layout;
use crate::belief::posterior::{Best, Block, Values, Weighed};
use crate::belief::resample::log_sum_exp;
use crate::simd;

/// Some states that are judged together, and how far they are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Judged {
    /// Touches judged there, from the first on.
    n_touches: usize,
    /// The largest of its states' sums over those touches.
    largest: f64,
    /// The log of the sum over its states of the likelihood of all touches, as far as each counts: this at most.
    most: f64,
    /// Probability of all its states, 0..=1; 0 where it is left out.
    share: f64,
    /// Probability of its likeliest state.
    scale: f64,
    /// The sum over its states of `p ln p`, which is 0 or less, where its likeliest state has a p of 1.
    log_sum: f64,
}

/// What the touches say of every state; blocks of one length, `[n_blocks, length]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Exact {
    layout: Layout,
    /// What may be left out at each touch, as a share of the belief.
    allowed: f64,
    blocks: Vec<Judged>,
    /// log p(touches | state) of the touches judged there; shared with the posterior after the latest of them.
    sums: Arc<Vec<f64>>,
    n_touches: usize,
    /// log p(all touches), as far as each counts.
    log_evidence: f64,
    left_out: f64,
}

impl Exact {
    /// Before any touch: what is asked of it counts from the first [`Self::update`] on. `allowed`: the share of the
    /// belief that may be left out at each touch, 0..=1; zero: none.
    pub fn uniform(layout: Layout, n_blocks: usize, allowed: f64) -> Self {
        let (n_states, most) = (n_blocks * layout.n_places, (layout.n_places as f64).ln());
        let block = Judged { n_touches: 0, largest: 0.0, most, share: 0.0, scale: 0.0, log_sum: 0.0 };
        Self {
            layout,
            allowed,
            blocks: vec![block; n_blocks],
            sums: Arc::new(vec![0.0; n_states]),
            n_touches: 0,
            log_evidence: 0.0,
            left_out: 0.0,
        }
    }

    /// Bayes' rule (paper, Eq. 4) for one more touch; returns its log-evidence, log p(touch | touches before).
    ///
    /// `highest`: the touch's log-likelihood in each block is at most this, `[n_blocks]`. `add` adds the
    /// log-likelihood, finite, of one touch to the sum of each state of a block.
    pub fn update(&mut self, highest: &[f64], add: &mut dyn FnMut(usize, usize, &mut [f64])) -> f64 {
        self.n_touches += 1;
        for (block, highest) in self.blocks.iter_mut().zip(highest) {
            block.most += highest;
            (block.share, block.scale) = (0.0, 0.0);
        }
        let mut order: Vec<usize> = (0..self.blocks.len()).collect();
        order.sort_by(|a, b| self.blocks[*b].most.total_cmp(&self.blocks[*a].most));
        let n_judged = self.judge(&order, add);
        let most = |blocks: &[usize]| log_sum_exp(&blocks.iter().map(|at| self.blocks[*at].most).collect::<Vec<_>>());
        let (log_judged, log_left) = (most(&order[..n_judged]), most(&order[n_judged..]));
        self.left_out = (log_left - log_judged).exp();
        for at in &order[..n_judged] {
            let block = &mut self.blocks[*at];
            block.share = (block.most - log_judged).exp();
            block.scale = (block.largest - log_judged).exp();
        }
        self.normalize();
        let before = self.log_evidence;
        self.log_evidence = log_judged - (self.sums.len() as f64).ln();
        self.log_evidence - before
    }

    /// Judges the touches that each block has missed, in this order, until those left may be left out; returns how many
    /// blocks it judged, at least one.
    fn judge(&mut self, order: &[usize], add: &mut dyn FnMut(usize, usize, &mut [f64])) -> usize {
        // What may be in each block and all after it.
        let mut log_left = vec![f64::NEG_INFINITY; order.len() + 1];
        for (index, at) in order.iter().enumerate().rev() {
            log_left[index] = log_add(log_left[index + 1], self.blocks[*at].most);
        }
        let mut log_judged = f64::NEG_INFINITY;
        for (n_judged, at) in order.iter().enumerate() {
            if n_judged > 0 && self.allowed > 0.0 && log_left[n_judged] <= self.allowed.ln() + log_judged {
                return n_judged;
            }
            self.judge_block(*at, add);
            log_judged = log_add(log_judged, self.blocks[*at].most);
        }
        order.len()
    }

    /// At the coldest temperatures logs are of the order of 1e12, and each is rounded by a ten-thousandth.
    fn normalize(&mut self) {
        let all: f64 = self.shares().sum();
        if (all - 1.0).abs() > 1e-9 && all > 0.0 {
            for block in &mut self.blocks {
                (block.share, block.scale) = (block.share / all, block.scale / all);
            }
        }
    }

    fn judge_block(&mut self, at: usize, add: &mut dyn FnMut(usize, usize, &mut [f64])) {
        let states = self.states(at);
        let (block, sums) = (&mut self.blocks[at], &mut Arc::make_mut(&mut self.sums)[states]);
        (block.n_touches..self.n_touches).for_each(|touch| add(at, touch, sums));
        block.n_touches = self.n_touches;
        block.largest = simd::largest(sums);
        let [sum, log_sum] = simd::sums_of_powers(sums, block.largest);
        (block.most, block.log_sum) = (block.largest + sum.ln(), log_sum);
    }

    fn states(&self, block: usize) -> Range<usize> {
        block * self.layout.n_places..(block + 1) * self.layout.n_places
    }

    fn shares(&self) -> impl Iterator<Item = f64> {
        self.blocks.iter().map(|block| block.share)
    }

    /// What is known now.
    pub fn weighed(&self) -> Weighed {
        let n_parts = self.blocks.len() / self.layout.n_angles;
        Weighed {
            blocks: self.blocks.iter().map(Judged::summary).collect(),
            values: Values::Logs(self.sums.clone()),
            best: (0..n_parts).map(|part| self.best(part)).collect(),
            left_out: self.left_out,
        }
    }

    /// The likeliest state of a part; `None` where all its blocks are left out.
    fn best(&self, part: usize) -> Option<Best> {
        let Layout { n_angles, .. } = self.layout;
        let held = || (part * n_angles..(part + 1) * n_angles).filter(|at| self.blocks[*at].scale > 0.0);
        let score = held().map(|at| self.blocks[at].largest).reduce(f64::max)?;
        let tops = held().filter(|at| self.blocks[*at].largest == score);
        let first = |at: usize| self.states(at).find(|state| self.sums[*state] == score);
        let state = tops.filter_map(first).map(|state| self.layout.hypothesis(state)).min()?;
        Some(Best { score, state })
    }
}

impl Judged {
    /// What the belief in its states is, together.
    fn summary(&self) -> Block {
        let Self { share, scale, largest, log_sum, .. } = *self;
        // -log p: what the block's likeliest state has, and how far the state is below it.
        let entropy = if scale > 0.0 { -scale * log_sum - share * scale.ln() } else { 0.0 };
        Block { share, top: scale, largest, entropy }
    }
}

/// log(e^a + e^b).
fn log_add(a: f64, b: f64) -> f64 {
    let (less, more) = (a.min(b), a.max(b));
    if less > f64::NEG_INFINITY { more + (less - more).exp().ln_1p() } else { more }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::belief::posterior::Posterior;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;
    use tactile_data::pose::grid::PoseGrid;

    /// States of a block.
    const LENGTH: usize = 3;

    /// Tables of p(touch | state) of some touches.
    struct Touches {
        tables: Vec<Vec<f64>>,
    }

    impl Touches {
        /// Takes in the touch of an index; returns its log-evidence and the blocks judged for it or touches before.
        fn take_in(&self, exact: &mut Exact, index: usize) -> (f64, usize) {
            let largest = |block: &[f64]| block.iter().copied().fold(0.0, f64::max).ln();
            let highest: Vec<f64> = self.tables[index].chunks(LENGTH).map(largest).collect();
            let mut n_judged = 0;
            let log_evidence = exact.update(&highest, &mut |block, touch, sums| {
                n_judged += 1;
                let of_block = self.tables[touch].chunks(LENGTH).nth(block).unwrap();
                sums.iter_mut().zip(of_block).for_each(|(sum, p)| *sum += p.ln());
            });
            (log_evidence, n_judged)
        }

        /// The posterior after so many touches by its definition, and the log of the mean over all states.
        fn posterior(&self, n_touches: usize) -> (Vec<f64>, f64) {
            let n_states = self.tables[0].len();
            let product = |state: usize| -> f64 { self.tables[..n_touches].iter().map(|table| table[state]).product() };
            let sum: f64 = (0..n_states).map(product).sum();
            ((0..n_states).map(|state| product(state) / sum).collect(), (sum / n_states as f64).ln())
        }
    }

    /// Blocks that are each the only one of a part, none of whose states may be left out but for a share.
    fn uniform(n_blocks: usize, allowed: f64) -> Exact {
        Exact::uniform(Layout { n_angles: 1, n_places: LENGTH }, n_blocks, allowed)
    }

    /// What is believed after the touches so far.
    fn posterior_of(exact: &Exact) -> Posterior {
        let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 1.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
        Posterior::new(grid, exact.layout, exact.weighed())
    }

    /// The probability of each state.
    fn probabilities(exact: &Exact) -> Vec<f64> {
        let mut all = vec![0.0; exact.sums.len()];
        let held = posterior_of(exact).states();
        held.into_iter().for_each(|(state, p)| all[state.part * LENGTH + state.cell] = p);
        all
    }

    fn total_variation(exact: &Exact, posterior: &[f64]) -> f64 {
        let apart = posterior.iter().zip(probabilities(exact)).map(|(p, found)| (found - p).abs());
        apart.sum::<f64>() / 2.0
    }

    /// Up to eight touches of six blocks.
    fn tables(least: f64) -> impl Strategy<Value = Vec<Vec<f64>>> {
        prop::collection::vec(prop::collection::vec(least..1.0_f64, 6 * LENGTH), 1..9)
    }

    proptest! {
        #[test]
        fn the_posterior_of_all_states_is_the_normalised_product(tables in tables(0.01)) {
            let touches = Touches { tables: tables.clone() };
            let (mut exact, mut total) = (uniform(6, 0.0), 0.0);
            for index in 0..tables.len() {
                total += touches.take_in(&mut exact, index).0;
                let (posterior, log_mean) = touches.posterior(index + 1);
                for (found, p) in probabilities(&exact).iter().zip(&posterior) {
                    prop_assert!((found - p).abs() < 1e-12);
                }
                let entropy: f64 = posterior.iter().map(|p| -p * p.ln()).sum();
                prop_assert!((posterior_of(&exact).entropy_nats() - entropy).abs() < 1e-10);
                prop_assert!((total - log_mean).abs() < 1e-10);
                prop_assert_eq!(exact.left_out, 0.0);
            }
        }

        /// Touches that contradict each other bring back what was left out.
        #[test]
        fn what_is_left_out_is_within_what_is_allowed(
            logs in tables(-9.0),
            allowed in prop::sample::select(vec![1e-6, 1e-3, 0.05, 0.5]),
        ) {
            // From 1e-9 to 10: each touch alone rules states out.
            let tables: Vec<Vec<f64>> =
                logs.iter().map(|table| table.iter().map(|log| 10.0_f64.powf(*log)).collect()).collect();
            let touches = Touches { tables };
            let mut exact = uniform(6, allowed);
            for index in 0..touches.tables.len() {
                touches.take_in(&mut exact, index);
                let apart = total_variation(&exact, &touches.posterior(index + 1).0);
                prop_assert!(apart <= exact.left_out + 1e-12 && exact.left_out <= allowed, "{apart}");
                prop_assert!((exact.shares().sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }

        #[test]
        fn the_heaviest_are_those_of_all_states_in_order(
            tables in tables(0.01),
            least in 0.0..0.1_f64,
            most in 1..20_usize,
        ) {
            let touches = Touches { tables: tables.clone() };
            let mut exact = uniform(6, 0.01);
            (0..tables.len()).for_each(|index| {
                touches.take_in(&mut exact, index);
            });
            let of_states = probabilities(&exact);
            let mut all = of_states.clone();
            all.sort_by(|a, b| b.total_cmp(a));
            all.retain(|p| *p > 0.0 && *p >= least);
            all.truncate(most);
            let mut heaviest = posterior_of(&exact).heaviest_states(least, most);
            prop_assert!(heaviest.is_sorted_by_key(|(state, _)| *state));
            heaviest.sort_by(|a, b| b.1.total_cmp(&a.1));
            prop_assert_eq!(heaviest.len(), all.len());
            for ((state, p), expected) in heaviest.into_iter().zip(all) {
                prop_assert!((p - expected).abs() < 1e-15 && (p - of_states[state.part * LENGTH + state.cell]).abs() < 1e-15);
            }
        }

        #[test]
        fn states_are_drawn_as_often_as_they_are_probable(tables in tables(0.01), seed in any::<u64>()) {
            let touches = Touches { tables: tables.clone() };
            let mut exact = uniform(6, 0.01);
            (0..tables.len()).for_each(|index| {
                touches.take_in(&mut exact, index);
            });
            let drawn = posterior_of(&exact).draw(1000, &mut ChaCha8Rng::seed_from_u64(seed));
            prop_assert!(drawn.is_sorted() && drawn.len() == 1000);
            for (state, p) in probabilities(&exact).into_iter().enumerate() {
                let n = drawn.iter().filter(|drawn| drawn.part * LENGTH + drawn.cell == state).count() as f64;
                // Systematic: the number is the expectation rounded up or down.
                prop_assert!((n - 1000.0 * p).abs() <= 1.0 + 1e-9);
            }
        }
    }

    #[test]
    fn a_block_that_cannot_matter_is_not_judged_until_it_may() {
        let table = |of_blocks: [f64; 2]| of_blocks.iter().flat_map(|p| [*p; LENGTH]).collect::<Vec<f64>>();
        let touches = Touches { tables: vec![table([0.9, 1e-6]), table([0.9, 0.5]), table([1e-9, 0.9])] };
        let mut exact = uniform(2, 1e-3);
        assert_eq!([0, 1].map(|index| touches.take_in(&mut exact, index).1), [1, 1]);
        assert_eq!(exact.shares().collect::<Vec<_>>(), [1.0, 0.0]);
        assert_eq!(posterior_of(&exact).best(Some(1)), None);
        // Either block missed or is judged by the third touch; the second by the two before it, too.
        assert_eq!(touches.take_in(&mut exact, 2).1, 1 + 3);
        let by_hand = 1e-6 * 0.5 * 0.9 / (1e-6 * 0.5 * 0.9 + 0.9 * 0.9 * 1e-9);
        assert!((exact.shares().nth(1).unwrap() - by_hand).abs() < 1e-12);
    }

    #[test]
    fn the_evidence_is_the_average_likelihood() {
        let touches = Touches { tables: vec![vec![0.2, 0.6, 0.4]] };
        let log_evidence = touches.take_in(&mut uniform(1, 0.0), 0).0;
        assert!((log_evidence - 0.4_f64.ln()).abs() < 1e-12);
    }
}

//! Judges candidates: how much the views from the states that are believed differ, where a candidate leads.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::pose::grid::NearestCell;
use tactile_data::pose::se2::Se2;

use super::inputs::ChoiceInputs;
use super::pairing::Pairing;
use super::rule::ActionRule;
use crate::belief::Hypothesis;
use crate::likelihood::{Nearest, trusted};

/// What a touch is expected to tell that is new, nats: how much the true state's log-probability is expected to grow.
/// Estimated from the same draws as the choice, so on the high side for the candidate chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// In all: which part it is and where on it.
    pub nats: f64,
    /// The share of `nats` about which part it is; the rest is about where on it.
    pub part_nats: f64,
    /// The two likeliest parts of the bank and the share of `part_nats` about which of the two it is; `None`
    /// where the bank has one part.
    pub pair: Option<([usize; 2], f64)>,
}

/// A state drawn from the belief: its part, which of the distinct poses it has, and how often it was drawn.
#[derive(Clone, Copy)]
struct Draw {
    hypothesis: Hypothesis,
    pose: usize,
    count: f64,
}

/// Judges candidates against states drawn from the belief.
pub(super) struct Scorer<'a> {
    inputs: &'a ChoiceInputs<'a>,
    pairing: Pairing<'a>,
    /// Where the sensor would be by each distinct pose of the draws, with the sine and cosine of its angle.
    part_from_sensor: Vec<(Se2, [f64; 2])>,
    draws: Vec<Draw>,
    supposed: Vec<Draw>,
    cells: NearestCell,
    /// The cells of those of them at which parts are touched first.
    start: NearestCell,
    tolerance: f64,
}

impl<'a> Scorer<'a> {
    /// A scorer by `n_draws` states drawn from the belief; it supposes `n_suppositions` of them true in turn.
    pub(super) fn new(
        inputs: &'a ChoiceInputs<'a>,
        n_draws: usize,
        n_suppositions: usize,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let ChoiceInputs { config, belief, .. } = *inputs;
        let drawn = belief.posterior().draw(n_draws, rng);
        let mut supposed: Vec<Hypothesis> =
            (0..n_suppositions).map(|_| drawn[rng.random_range(0..drawn.len())]).collect();
        if let (ActionRule::Paper | ActionRule::RandomEdge, Some(best)) =
            (config.method.rule, belief.posterior().best(None))
        {
            supposed[0] = best;
        }
        let draws = drawn.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as f64)).collect();
        let pairing = Pairing::new(inputs, rng);
        let supposed = supposed.into_iter().map(|hypothesis| (hypothesis, 1.0)).collect();
        Self::of(inputs, pairing, draws, supposed)
    }

    fn of(
        inputs: &'a ChoiceInputs<'a>,
        pairing: Pairing<'a>,
        draws: Vec<(Hypothesis, f64)>,
        supposed: Vec<(Hypothesis, f64)>,
    ) -> Self {
        let ChoiceInputs { model, belief, bank, .. } = *inputs;
        let mut cells: Vec<usize> = draws.iter().chain(&supposed).map(|(hypothesis, _)| hypothesis.cell).collect();
        cells.sort_unstable();
        cells.dedup();
        let first_from_sensor = belief.first_from_sensor();
        let placed = |states: Vec<(Hypothesis, f64)>| -> Vec<Draw> {
            let pose_of = |hypothesis: &Hypothesis| cells.partition_point(|cell| *cell < hypothesis.cell);
            let draw = |(hypothesis, count)| Draw { hypothesis, pose: pose_of(&hypothesis), count };
            states.into_iter().map(draw).collect()
        };
        // Between the poses of a grid that can be interpolated the nearest view is near enough to choose by.
        let tolerance = if model.interpolation.is_cubic(bank.grid()) { 1.0 } else { model.nearest_tolerance };
        let stood = |cell: &usize| {
            let pose = belief.posterior().grid().pose(*cell) * first_from_sensor;
            (pose, pose.theta_rad.sin_cos().into())
        };
        Self {
            inputs,
            pairing,
            draws: placed(draws),
            supposed: placed(supposed),
            part_from_sensor: cells.iter().map(stood).collect(),
            cells: NearestCell::on(bank.grid()),
            start: NearestCell::on(bank.start()),
            tolerance,
        }
    }

    /// A judge by about `n_draws` of the draws, evenly taken, and the first `n_suppositions`.
    pub(super) fn thinned(&self, n_draws: usize, n_suppositions: usize) -> Self {
        let every = self.draws.len().div_ceil(n_draws.max(1)).max(1);
        let state = |draw: &Draw| (draw.hypothesis, draw.count);
        let draws = self.draws.iter().step_by(every).map(state).collect();
        let supposed = self.supposed.iter().take(n_suppositions.max(1)).map(state).collect();
        Self::of(self.inputs, self.pairing, draws, supposed)
    }

    /// The score of a candidate; `None` where it would show contact from no supposed state.
    pub(super) fn score(&self, candidate: &Se2) -> Option<f64> {
        let Sums { total, n_supposed, n_contacts } = self.sum(candidate, |_, _, _| ());
        (n_contacts > 0).then(|| total / n_supposed - self.travel_nats(candidate))
    }

    /// What a candidate is expected to tell, by the sums of [`Self::score`] taken separately: which part it is, and of
    /// that, which of `pair`. By Bayes' rule a true state's log-probability grows by log(own / mean of all), the sum
    /// of log(mean of its part / mean of all), which is about the part, and log(own / mean of its part), which is about
    /// where; which of two parts it is grows in the same way by log(mean of its part / mean of both).
    ///
    /// `None` for other rules than expected information, and where no contact is expected.
    pub(super) fn expected(&self, candidate: &Se2, pair: Option<[usize; 2]>) -> Option<Expected> {
        if self.inputs.config.method.rule != ActionRule::Information {
            return None;
        }
        let n_parts = self.inputs.bank.parts().len();
        let mut counts = vec![0.0; n_parts];
        self.draws.iter().for_each(|draw| counts[draw.hypothesis.part] += draw.count);
        let mut sums = vec![0.0; self.supposed.len() * n_parts];
        let report = |truth: usize, draw: &Draw, value: f64| {
            sums[truth * n_parts + draw.hypothesis.part] += value;
        };
        let Sums { total, n_supposed, n_contacts } = self.sum(candidate, report);
        let (mut part_nats, mut pair_nats) = (0.0, 0.0);
        for (truth, sums) in self.supposed.iter().zip(sums.chunks_exact(n_parts)) {
            let own = truth.hypothesis.part;
            let mean = |parts: &[usize]| {
                let sum = |of: &[f64]| parts.iter().map(|part| of[*part]).sum::<f64>();
                sum(sums) / sum(&counts)
            };
            let all: Vec<usize> = (0..n_parts).collect();
            // A supposed state without contact was not weighed: it gives no information.
            if mean(&[own]) > 0.0 {
                part_nats += (mean(&[own]) / mean(&all)).ln();
                let both = pair.filter(|pair| pair.contains(&own));
                pair_nats += both.map_or(0.0, |both| (mean(&[own]) / mean(&both)).ln());
            }
        }
        (n_contacts > 0).then(|| Expected {
            nats: total / n_supposed,
            part_nats: part_nats / n_supposed,
            pair: pair.map(|pair| (pair, pair_nats / n_supposed)),
        })
    }

    /// What the way to a candidate costs, nats.
    fn travel_nats(&self, candidate: &Se2) -> f64 {
        match self.inputs.config.method.rule {
            ActionRule::Information => {
                self.inputs.config.settings.travel_nats_per_mm * candidate.x_mm.hypot(candidate.y_mm)
            }
            _ => 0.0,
        }
    }

    /// Weighs the views from the draws against the view from each supposed state. `report` is given each pair:
    /// which supposed state, which draw, and how much it counts.
    fn sum(&self, candidate: &Se2, mut report: impl FnMut(usize, &Draw, f64)) -> Sums {
        let ChoiceInputs { config, model, bank, belief, .. } = *self.inputs;
        let grid = bank.grid();
        let pairing = self.pairing.with_new_share(belief.new_share(&(belief.first_from_sensor() * *candidate)));
        // The product of both motions, its sine and cosine at hand.
        let moved = |(pose, [sin, cos]): &(Se2, [f64; 2])| {
            let Se2 { x_mm: x, y_mm: y, theta_rad } = *candidate;
            Se2::new(pose.x_mm + cos * x - sin * y, pose.y_mm + sin * x + cos * y, pose.theta_rad + theta_rad)
        };
        let seen: Vec<Option<Nearest>> =
            self.part_from_sensor.iter().map(|from| trusted(grid, &self.cells, &moved(from), self.tolerance)).collect();
        let near = |draw: &Draw| seen[draw.pose].map(|s| (draw.hypothesis.part * grid.len() + s.cell, s.trust));
        let view = |draw: &Draw| near(draw).filter(|(row, _)| bank.is_recorded(*row));
        let (mut rows, of_draws) = Rows::of(self.draws.iter().map(view));
        let mut sums = Sums::default();
        for (index, truth) in self.supposed.iter().enumerate() {
            // Where every candidate leads to a pose at which parts are touched first, a supposition that it leads elsewhere is wrong.
            if !config.method.between_poses && self.start.of(&moved(&self.part_from_sensor[truth.pose])).is_none() {
                continue;
            }
            sums.n_supposed += 1.0;
            // What is not recorded gives no information.
            let Some((row, trust)) = view(truth) else { continue };
            if bank.edge_shares()[row] <= model.blank_share {
                continue;
            }
            sums.n_contacts += 1;
            let ratios = rows.ratios(&pairing, row);
            let (mut sum, mut n_states) = (0.0, 0.0);
            for (draw, view) in self.draws.iter().zip(&of_draws) {
                if config.method.rule == ActionRule::Paper && draw.hypothesis == truth.hypothesis {
                    continue; // S without s*
                }
                let value = draw.count * pairing.mixed(view.map(|(at, trust)| (ratios[at], trust)));
                report(index, draw, value);
                sum += value;
                n_states += draw.count;
            }
            let of_truth = match config.method.rule {
                ActionRule::Information => (pairing.value(Some((row, trust)), row) * n_states / sum).ln(),
                _ => sum,
            };
            sums.total += of_truth;
        }
        sums
    }
}

/// The distinct rows that the draws see where a candidate leads, few of them though the draws are many, compared once
/// with each row that would be touched.
struct Rows {
    seen: Vec<usize>,
    /// Rows that would be touched, each with [`Pairing::ratios`] of the rows seen.
    touched: Vec<(usize, Vec<f64>)>,
}

impl Rows {
    /// By the row that each draw sees and how far that is trusted; with it the same with the row's index here instead.
    fn of(views: impl Iterator<Item = Option<(usize, f64)>>) -> (Self, Vec<Option<(usize, f64)>>) {
        let mut seen: Vec<usize> = Vec::new();
        let mut index_of = |row: usize| {
            seen.iter().position(|other| *other == row).unwrap_or_else(|| {
                seen.push(row);
                seen.len() - 1
            })
        };
        let of_draws = views.map(|view| view.map(|(row, trust)| (index_of(row), trust))).collect();
        (Self { seen, touched: Vec::new() }, of_draws)
    }

    /// [`Pairing::ratios`] of the rows seen where the row `touched` would be seen.
    fn ratios(&mut self, pairing: &Pairing, touched: usize) -> &[f64] {
        let known = self.touched.iter().position(|(row, _)| *row == touched);
        let at = known.unwrap_or_else(|| {
            self.touched.push((touched, pairing.ratios(&self.seen, touched)));
            self.touched.len() - 1
        });
        &self.touched[at].1
    }
}

/// A candidate weighed: the sum over the supposed states, how many they are, and from how many it shows contact.
#[derive(Default)]
struct Sums {
    total: f64,
    n_supposed: f64,
    n_contacts: usize,
}

#[cfg(test)]
mod tests {
    use super::super::choose::explain;
    use super::super::choose::tests::GRID;
    use super::*;
    use crate::belief::{Belief, EngineConfig};
    use crate::config::EpisodeConfig;
    use crate::likelihood::TouchLikelihood;
    use crate::touch::Observation;
    use tactile_infer::Bank;
    use tactile_infer::bank::rows::Rows;

    const X: [f32; 3] = [1.0, 0.0, 0.0];
    const Y: [f32; 3] = [0.0, 1.0, 0.0];
    const UP: [f32; 3] = [0.0, 0.0, 1.0];
    const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

    /// What a turn is expected to tell after a first touch that looks like X; the rows of each part are its views at
    /// -30, 0 and 30 degrees.
    fn expected_of_turning(degrees: f64, parts: &[[[f32; 3]; 3]]) -> Expected {
        // Enough draws that rounding a third of them matters little.
        let config = EpisodeConfig::default().changed(|settings, model, method| {
            (settings.n_draws, settings.n_suppositions) = (3000, 3000);
            (model.outlier_share, model.shared_mm) = (0.0, 0.0);
            method.between_poses = false;
        });
        let names: Vec<String> = (0..parts.len()).map(|part| part.to_string()).collect();
        let shares = vec![0.2; 3 * parts.len()];
        let rows = parts.concat().concat();
        let bank = Bank::from_rows(names, GRID, Rows::new(3, rows).unwrap(), shares, "").unwrap();
        let touch = Observation::new(X.to_vec(), 0.2);
        let belief =
            Belief::new(&bank, EngineConfig::Exact, 1, 1, TouchLikelihood::new(&touch, &bank, &config.model).unwrap());
        let candidates = [Se2::from_degrees(0.0, 0.0, degrees)];
        let inputs = ChoiceInputs {
            config: &config,
            model: &config.model,
            belief: &belief,
            bank: &bank,
            candidates: &candidates,
            unfelt: None,
        };
        explain(&inputs, 1).unwrap().expected.unwrap()
    }

    /// 3000 suppositions: a share of them is off by about 1 %.
    fn assert_near(got: f64, nats: f64) {
        assert!((got - nats).abs() < 0.03, "{got} nats, expected {nats}");
    }

    #[test]
    fn two_parts_told_apart_are_a_bit_all_of_it_between_them() {
        let expected = expected_of_turning(60.0, &[[X, Y, UP], [X, Y, DOWN]]);
        let bit = std::f64::consts::LN_2;
        let Some(([0, 1], between)) = expected.pair else { panic!("{expected:?}") };
        [expected.nats, expected.part_nats, between].into_iter().for_each(|nats| assert_near(nats, bit));
    }

    #[test]
    fn a_third_part_told_from_two_says_nothing_between_the_two() {
        let expected = expected_of_turning(60.0, &[[X, Y, UP], [X, Y, UP], [X, Y, DOWN]]);
        // Three equal parts, then two left in two of three cases: ln 3 - 2/3 ln 2.
        let nats = 3.0_f64.ln() - 2.0 / 3.0 * 2.0_f64.ln();
        [expected.nats, expected.part_nats].into_iter().for_each(|got| assert_near(got, nats));
        let (pair, between) = expected.pair.unwrap();
        assert_eq!(pair, [0, 1]);
        assert_near(between, 0.0);
    }

    #[test]
    fn parts_alike_tell_nothing() {
        let expected = expected_of_turning(60.0, &[[X, Y, UP], [X, Y, UP]]);
        [expected.nats, expected.part_nats].into_iter().for_each(|nats| assert_near(nats, 0.0));
    }

    #[test]
    fn where_on_the_one_part_is_no_news_of_the_part() {
        // At -30 or 0 degrees; 30 degrees on, the one shows X and the other UP.
        let expected = expected_of_turning(30.0, &[[X, X, UP]]);
        assert_near(expected.nats, std::f64::consts::LN_2);
        assert_near(expected.part_nats, 0.0);
        assert_eq!(expected.pair, None);
    }
}

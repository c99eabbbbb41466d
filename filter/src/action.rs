//! Where to touch next: the paper's rule (Sec. IV-C), expected information, or chance.
//!
//! Only recorded peg views are compared, so an action costs look-ups and inner products. States are drawn
//! from the belief, not taken from its top: after one touch the mass lies on thousands of states. Touches
//! are kept apart, because two overlapping views share most of what they show and most of their error.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use tactile_data::se2::{Se2, wrap_angle};
use tactile_infer::bank::Bank;
use tactile_infer::similarity::peg_similarity;

use crate::belief::{Belief, Hypothesis};
use crate::likelihood::LikelihoodConfig;
use crate::lookup::{Nearest, look_up};

/// a: a motion of the sensor, in its own frame at the latest touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Action {
    /// Where the sensor goes, seen from where it is.
    pub sensor_from_next: Se2,
}

/// How the next touch is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActionRule {
    /// The largest sum of 1 / f_PP between the view from a likely state and the views from the states
    /// drawn from the belief (paper, Eq. 5 and 6), with f_PP = exp(cosine / temperature) > 0.
    Paper,
    /// The largest expected gain of the true state's log-probability, under the filter's own likelihood.
    #[default]
    Information,
    /// Any action allowed, each equally likely.
    Random,
}

/// How actions are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActionConfig {
    /// The rule.
    pub rule: ActionRule,
    /// States drawn from the belief, against which an action is judged; at least 1.
    pub n_draws: usize,
    /// States supposed true in turn, s* of the paper; at least 1. For the paper's rule the first is the
    /// likeliest state and the others are drawn; for expected information all are drawn.
    pub n_suppositions: usize,
    /// Candidates judged by all draws, the best by a first look at a sixth of them; at least 1.
    pub n_finalists: usize,
    /// delta_act: an action counts only from those supposed states where it would show a larger share of
    /// edge pixels than this, 0..=1.
    pub contact_threshold: f32,
    /// A touch keeps at least this far from every earlier one, mm, not negative ...
    pub min_separation_mm: f64,
    /// ... or is turned against it by at least this much, degrees; above 180 only the distance counts.
    pub min_separation_deg: f64,
    /// What a millimetre of travel must tell to be worth it, nats, not negative; expected information only.
    pub travel_nats_per_mm: f64,
}

impl Default for ActionConfig {
    /// 160 draws as measured on a prototype, 24 suppositions on random contours; 4 mm on the tuning letters,
    /// where 12 mm drove touches out of the recorded area of small parts.
    fn default() -> Self {
        Self {
            rule: ActionRule::default(),
            n_draws: 160,
            n_suppositions: 24,
            n_finalists: 24,
            contact_threshold: 0.01,
            min_separation_mm: 4.0,
            min_separation_deg: 360.0,
            travel_nats_per_mm: 0.0,
        }
    }
}

impl ActionConfig {
    /// Alg. 1, lines 9-10: the likeliest state against the K = 100 particles, any pose, those with contact.
    pub fn paper() -> Self {
        Self {
            rule: ActionRule::Paper,
            n_draws: 100,
            n_suppositions: 1,
            n_finalists: usize::MAX,
            min_separation_mm: 0.0,
            ..Self::default()
        }
    }
}

/// What a choice is made in: what is believed, recorded and offered.
pub struct Situation<'a> {
    /// Rule and effort.
    pub config: &'a ActionConfig,
    /// The likelihood that the belief was made with.
    pub likelihood: &'a LikelihoodConfig,
    /// What is known of part and pose.
    pub belief: &'a Belief,
    /// The recorded views.
    pub bank: &'a Bank,
    /// Motions `sensor_from_next` that the reach allows.
    pub candidates: &'a [Se2],
    /// Whether every candidate leads to a recorded pose of the true part, as in the paper's protocol:
    /// a supposition that it leads out of is then known to be wrong.
    pub only_recorded: bool,
}

/// Chooses the next touch. Same input, same choice: the earliest of equals.
///
/// Every candidate is judged by a few draws, the best `n_finalists` by all. `keep_going` is asked before
/// each candidate; once it says no, the best found so far is taken.
///
/// Where every candidate lies too close to an earlier touch, the separation is halved until one does not.
/// `None` where no candidate is left even so: none offered, none finite, or all where a touch was made.
pub fn choose(situation: &Situation, seed: u64, keep_going: &mut dyn FnMut() -> bool) -> Option<Action> {
    let Situation { config, belief, .. } = situation;
    let far = far_candidates(config, belief, situation.candidates);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let chance = *far.get(rng.random_range(0..far.len().max(1)))?;
    if config.rule == ActionRule::Random {
        return Some(Action { sensor_from_next: chance });
    }
    let judge = Judge::new(situation, config.n_draws.max(1), config.n_suppositions.max(1), &mut rng);
    let judged = |judge: &Judge, candidates: &[Se2], keep_going: &mut dyn FnMut() -> bool| {
        let asked = candidates.iter().map_while(|candidate| keep_going().then(|| (judge.score(candidate), *candidate)));
        asked.filter_map(|(score, candidate)| Some((score?, candidate))).collect::<Vec<_>>()
    };
    let finals = if far.len() > config.n_finalists.max(1) {
        let first_look = judge.thinned(config.n_draws.div_ceil(6), config.n_suppositions.div_ceil(6));
        let mut ranked = judged(&first_look, &far, keep_going);
        // Stable: the earliest of equals stays first.
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        ranked.truncate(config.n_finalists.max(1));
        let finalists: Vec<Se2> = ranked.iter().map(|(_, candidate)| *candidate).collect();
        let judged_by_all = judged(&judge, &finalists, keep_going);
        if judged_by_all.is_empty() { ranked } else { judged_by_all }
    } else {
        judged(&judge, &far, keep_going)
    };
    let best = finals.into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best });
    // No view with contact is expected anywhere: any touch may tell more than the bank does.
    Some(Action { sensor_from_next: best.map_or(chance, |(_, candidate)| candidate) })
}

/// The candidates apart from every earlier touch, by the smallest halving of the separation that leaves any.
fn far_candidates(config: &ActionConfig, belief: &Belief, candidates: &[Se2]) -> Vec<Se2> {
    let first_from_sensor = belief.first_from_sensor();
    let is_far = |candidate: &&Se2, share: f64| {
        let first_from_next = first_from_sensor * **candidate;
        belief.touches().iter().all(|touched| {
            let turn = wrap_angle(touched.first_from_sensor.theta_rad - first_from_next.theta_rad).to_degrees();
            touched.first_from_sensor.distance_mm(&first_from_next) >= share * config.min_separation_mm
                || turn.abs() >= share * config.min_separation_deg
        })
    };
    // The tenth halving asks for 0.1 % of the separation: what is nearer is the same place.
    (0..=10)
        .map(|halvings| 0.5_f64.powi(halvings))
        .map(|share| candidates.iter().filter(|c| c.is_finite() && is_far(c, share)).copied().collect::<Vec<_>>())
        .find(|far| !far.is_empty())
        .unwrap_or_default()
}

/// A state drawn from the belief: its part, which of the distinct poses it has, and how often it was drawn.
#[derive(Clone, Copy)]
struct Draw {
    hypothesis: Hypothesis,
    pose: usize,
    count: f64,
}

/// Judges candidates against states drawn from the belief.
struct Judge<'a> {
    situation: &'a Situation<'a>,
    pairing: Pairing<'a>,
    /// Where the sensor would be by each distinct pose of the draws.
    part_from_sensor: Vec<Se2>,
    draws: Vec<Draw>,
    supposed: Vec<Draw>,
    tolerance: f64,
}

impl<'a> Judge<'a> {
    fn new(situation: &'a Situation<'a>, n_draws: usize, n_suppositions: usize, rng: &mut ChaCha8Rng) -> Self {
        let Situation { config, likelihood, belief, bank, .. } = *situation;
        let drawn = belief.draw(n_draws, rng);
        let mut supposed: Vec<Hypothesis> =
            (0..n_suppositions).map(|_| drawn[rng.random_range(0..drawn.len())]).collect();
        if let (ActionRule::Paper, Some(best)) = (config.rule, belief.best(None)) {
            supposed[0] = best;
        }
        let draws = drawn.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as f64)).collect();
        let pairing = Pairing::new(config.rule, likelihood, bank, rng);
        let supposed = supposed.into_iter().map(|hypothesis| (hypothesis, 1.0)).collect();
        Self::of(situation, pairing, draws, supposed)
    }

    fn of(
        situation: &'a Situation<'a>,
        pairing: Pairing<'a>,
        draws: Vec<(Hypothesis, f64)>,
        supposed: Vec<(Hypothesis, f64)>,
    ) -> Self {
        let Situation { likelihood, belief, bank, .. } = *situation;
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
        let tolerance = if likelihood.look_up.is_cubic(bank.grid()) { 1.0 } else { likelihood.lookup_tolerance };
        Self {
            situation,
            pairing,
            draws: placed(draws),
            supposed: placed(supposed),
            part_from_sensor: cells.iter().map(|cell| belief.grid().pose(*cell) * first_from_sensor).collect(),
            tolerance,
        }
    }

    /// A judge by about `n_draws` of the draws, evenly taken, and the first `n_suppositions`.
    fn thinned(&self, n_draws: usize, n_suppositions: usize) -> Self {
        let every = self.draws.len().div_ceil(n_draws.max(1)).max(1);
        let state = |draw: &Draw| (draw.hypothesis, draw.count);
        let draws = self.draws.iter().step_by(every).map(state).collect();
        let supposed = self.supposed.iter().take(n_suppositions.max(1)).map(state).collect();
        Self::of(self.situation, self.pairing, draws, supposed)
    }

    /// The score of a candidate; `None` where it would show contact from no supposed state.
    fn score(&self, candidate: &Se2) -> Option<f64> {
        let Situation { config, bank, only_recorded, .. } = *self.situation;
        let grid = bank.grid();
        let seen: Vec<Option<Nearest>> =
            self.part_from_sensor.iter().map(|pose| look_up(grid, &(*pose * *candidate), self.tolerance)).collect();
        let view = |draw: &Draw| seen[draw.pose].map(|s| (draw.hypothesis.part * grid.len() + s.cell, s.trust));
        let (mut total, mut n_supposed, mut n_contacts) = (0.0, 0.0, 0);
        for truth in &self.supposed {
            let Some((row, trust)) = view(truth) else {
                // What is not recorded tells nothing.
                n_supposed += if only_recorded { 0.0 } else { 1.0 };
                continue;
            };
            n_supposed += 1.0;
            if bank.edge_shares()[row] <= config.contact_threshold {
                continue;
            }
            n_contacts += 1;
            let (mut sum, mut n_states) = (0.0, 0.0);
            for draw in &self.draws {
                if config.rule == ActionRule::Paper && draw.hypothesis == truth.hypothesis {
                    continue; // S without s*
                }
                sum += draw.count * self.pairing.value(view(draw), row);
                n_states += draw.count;
            }
            total += match config.rule {
                ActionRule::Information => (self.pairing.value(Some((row, trust)), row) * n_states / sum).ln(),
                _ => sum,
            };
        }
        let travel = match config.rule {
            ActionRule::Information => config.travel_nats_per_mm * candidate.x_mm.hypot(candidate.y_mm),
            _ => 0.0,
        };
        (n_contacts > 0).then_some(total / n_supposed - travel)
    }
}

/// How a recorded view counts against the view that would be touched.
#[derive(Clone, Copy)]
struct Pairing<'a> {
    rule: ActionRule,
    likelihood: &'a LikelihoodConfig,
    bank: &'a Bank,
    /// Mean of [`Self::look`] over two edged views at random.
    average: f64,
}

impl<'a> Pairing<'a> {
    /// Pairs sampled for the average: its relative error, some 6 %, moves no score by more.
    const N_SAMPLED: usize = 256;

    fn new(rule: ActionRule, likelihood: &'a LikelihoodConfig, bank: &'a Bank, rng: &mut ChaCha8Rng) -> Self {
        let shares = bank.edge_shares();
        let edged: Vec<usize> = (0..shares.len()).filter(|row| !likelihood.is_blank(shares[*row])).collect();
        let mut pairing = Self { rule, likelihood, bank, average: 1.0 };
        if !edged.is_empty() {
            let mut any = || edged[rng.random_range(0..edged.len())];
            let looks = (0..Self::N_SAMPLED).map(|_| pairing.look(any(), any()));
            pairing.average = looks.sum::<f64>() / Self::N_SAMPLED as f64;
        }
        pairing
    }

    /// For the paper's rule 1 / f_PP, scaled so that it cannot overflow; else the filter's likelihood of
    /// seeing one view where the other is recorded, without its blank part.
    fn look(&self, row_a: usize, row_b: usize) -> f64 {
        let cosine = f64::from(peg_similarity(self.bank, row_a, row_b)).clamp(-1.0, 1.0);
        match self.rule {
            ActionRule::Paper => (-(cosine + 1.0) / self.likelihood.temperature).exp(),
            _ => ((cosine - 1.0) / self.likelihood.temperature).exp() + self.likelihood.outlier_floor,
        }
    }

    /// What a state whose recorded view (row, trust) is `view` adds, where row `touched` would be seen. An
    /// unknown view adds the average.
    fn value(&self, view: Option<(usize, f64)>, touched: usize) -> f64 {
        let Some((row, trust)) = view else { return if self.rule == ActionRule::Paper { self.average } else { 1.0 } };
        if self.rule == ActionRule::Paper {
            return self.look(row, touched);
        }
        let is_blank = |row: usize| self.likelihood.is_blank(self.bank.edge_shares()[row]);
        let agreement = self.likelihood.blank_agreement;
        let ratio = match (is_blank(row), is_blank(touched)) {
            (false, false) => agreement * self.look(row, touched) / self.average,
            (true, true) => agreement,
            _ => 1.0 - agreement,
        };
        trust * ratio + 1.0 - trust
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::belief::EngineConfig;
    use crate::likelihood::{Observation, TouchLikelihood};
    use tactile_data::grid::PoseGrid;

    /// Three angles at one place.
    const GRID: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    /// Two parts alike at -30 and 0 degrees and unlike at +30.
    fn bank(share_at_30: f32) -> Bank {
        let rows =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let shares = vec![0.2, 0.2, share_at_30, 0.2, 0.2, share_at_30];
        Bank::from_rows(vec!["A".into(), "B".into()], GRID, 3, rows.concat(), shares, String::new()).unwrap()
    }

    /// A belief sure of -30 degrees and of no part.
    fn belief(bank: &Bank) -> Belief {
        let touch = Observation { query: vec![1.0, 0.0, 0.0], edge_share: 0.2 };
        let first = TouchLikelihood::new(&touch, bank, &LikelihoodConfig::default()).unwrap();
        Belief::new(bank, EngineConfig::Exact, 1, 1, first)
    }

    fn turn(degrees: f64) -> Se2 {
        Se2::from_degrees(0.0, 0.0, degrees)
    }

    fn chosen(config: ActionConfig, bank: &Bank, candidates: &[Se2], seed: u64) -> Option<Se2> {
        let (likelihood, belief) = (LikelihoodConfig::default(), belief(bank));
        let situation = Situation {
            config: &config,
            likelihood: &likelihood,
            belief: &belief,
            bank,
            candidates,
            only_recorded: true,
        };
        choose(&situation, seed, &mut || true).map(|action| action.sensor_from_next)
    }

    const ANY_PLACE: ActionConfig = ActionConfig {
        rule: ActionRule::Paper,
        n_draws: 160,
        n_suppositions: 1,
        n_finalists: 8,
        contact_threshold: 0.01,
        min_separation_mm: 0.0,
        min_separation_deg: 360.0,
        travel_nats_per_mm: 0.0,
    };

    #[test]
    fn both_rules_touch_where_the_parts_differ() {
        for rule in [ActionRule::Paper, ActionRule::Information] {
            let config = ActionConfig { rule, n_suppositions: 4, ..ANY_PLACE };
            for candidates in [[turn(30.0), turn(60.0)], [turn(60.0), turn(30.0)]] {
                assert_eq!(chosen(config, &bank(0.2), &candidates, 1), Some(turn(60.0)));
            }
        }
    }

    #[test]
    fn an_action_without_contact_is_not_chosen() {
        // The printed indicator selects what shows no contact; the prose says "exceeds".
        assert_eq!(chosen(ANY_PLACE, &bank(0.0), &[turn(60.0), turn(30.0)], 1), Some(turn(30.0)));
    }

    #[test]
    fn the_papers_score_agrees_with_hand_arithmetic() {
        let bank = bank(0.2);
        let likelihood = LikelihoodConfig { temperature: 0.5, ..LikelihoodConfig::default() };
        let pairing = Pairing::new(ActionRule::Paper, &likelihood, &bank, &mut ChaCha8Rng::seed_from_u64(1));
        // 1 / exp(cos / tau), scaled by exp(-1 / tau): cosines -1, 0 and 1.
        for (row, cosine) in [(5, -1.0_f64), (1, 0.0), (2, 1.0)] {
            assert!((pairing.value(Some((row, 1.0)), 2) - (-(cosine + 1.0) / 0.5).exp()).abs() < 1e-6);
        }
        assert_eq!(pairing.value(None, 2), pairing.average);
    }

    #[test]
    fn touches_keep_apart_as_long_as_they_can() {
        let bank = bank(0.2);
        let [near, far] = [3.0, 20.0].map(|x| Se2::from_degrees(x, 0.0, 0.0));
        let config = ActionConfig { rule: ActionRule::Random, min_separation_mm: 12.0, ..ANY_PLACE };
        for seed in 0..20 {
            assert_eq!(chosen(config, &bank, &[near, far], seed), Some(far));
        }
        // Nothing is 12 mm away: 12 is halved to 3, and the better half is taken.
        assert_eq!(chosen(config, &bank, &[Se2::from_degrees(1.0, 0.0, 0.0), near], 1), Some(near));
    }

    #[test]
    fn travel_counts_against_what_is_learnt() {
        let bank = bank(0.2);
        // Both tell the same; one lies 1 mm away, which the grid's one place still holds.
        let [near, far] = [0.0, 1.0].map(|x| Se2::from_degrees(x, 0.0, 60.0));
        for (travel_nats_per_mm, expected) in [(0.0, far), (0.5, near)] {
            let config = ActionConfig { rule: ActionRule::Information, travel_nats_per_mm, ..ANY_PLACE };
            assert_eq!(chosen(config, &bank, &[far, near], 1), Some(expected));
        }
    }

    #[test]
    fn an_empty_budget_still_gives_an_action() {
        let (bank, likelihood, config) = (bank(0.2), LikelihoodConfig::default(), ANY_PLACE);
        let belief = belief(&bank);
        let candidates = &[turn(30.0), turn(60.0)];
        let situation = Situation {
            config: &config,
            likelihood: &likelihood,
            belief: &belief,
            bank: &bank,
            candidates,
            only_recorded: true,
        };
        assert!(choose(&situation, 1, &mut || false).is_some_and(|a| candidates.contains(&a.sensor_from_next)));
        // Enough for one candidate only: the first.
        let mut left = 1;
        let once = choose(&situation, 1, &mut || {
            left -= 1;
            left >= 0
        });
        assert_eq!(once.map(|a| a.sensor_from_next), Some(candidates[0]));
    }

    #[test]
    fn nothing_left_to_touch_is_none() {
        let bank = bank(0.2);
        let config = ActionConfig { min_separation_mm: 12.0, ..ANY_PLACE };
        for candidates in [vec![], vec![Se2::IDENTITY], vec![Se2 { x_mm: f64::NAN, ..Se2::IDENTITY }]] {
            assert_eq!(chosen(config, &bank, &candidates, 1), None);
        }
    }

    #[test]
    fn of_equal_actions_the_earliest_is_chosen() {
        let same = [turn(60.0), turn(60.0 + 1e-9), turn(60.0 - 1e-9)];
        assert_eq!(chosen(ANY_PLACE, &bank(0.2), &same, 1), Some(same[0]));
    }
}

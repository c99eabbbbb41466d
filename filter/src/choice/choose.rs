//! Where to touch next: the paper's rule (Sec. IV-C), expected information, or chance.
//!
//! Only recorded peg views are compared, so an action costs inner products. States are drawn
//! from the belief, not taken from its top: after one touch the mass is spread over thousands of states. Touches
//! are kept apart, because two overlapping views share most of what they show and most of their error.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::{Se2, wrap_angle};

use super::inputs::ChoiceInputs;
use super::rule::ActionRule;
use super::scorer::{Expected, Scorer};
use crate::belief::Belief;
use crate::decision::Unfelt;
use crate::touch_model::TouchModel;

/// a: a motion of the sensor, in its own frame at the latest touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Action {
    /// Where the sensor goes, seen from where it is.
    pub sensor_from_next: Se2,
}

/// A candidate as the rule saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored {
    /// The motion, one of those offered.
    pub sensor_from_next: Se2,
    /// The more, the better. [`ActionRule::Information`]: the expected gain of the true state's log-probability, nats,
    /// less the price of the way. [`ActionRule::Paper`]: the sum
    /// of 1 / f_PP, times exp(-1 / temperature).
    /// `None` where contact is expected from no supposed state; such a candidate is not chosen.
    pub score: Option<f64>,
    /// Whether all draws judged it; else a sixth of them did, in the first pass.
    pub by_all_draws: bool,
}

/// A choice with its reasons.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// What [`choose`] chooses.
    pub action: Action,
    /// The candidates judged, in the order offered: those far enough from earlier touches. None for
    /// [`ActionRule::Random`] and [`ActionRule::RandomEdge`].
    pub scored: Vec<Scored>,
    /// What `action` is expected to tell; `None` for other rules than expected information, and where no candidate
    /// is expected to show contact.
    pub expected: Option<Expected>,
    /// What `action` is expected to tell of whether the named part is there, nats, where it was chosen for that.
    pub presence_nats: Option<f64>,
}

/// Chooses the next touch. Same input, same choice: the earliest of equals.
///
/// Every candidate is judged by a few draws, the best `n_finalists` by all. `keep_going` is asked before
/// each candidate; once it says no, the best found so far is taken.
///
/// Where every candidate is too close to an earlier touch, the separation is halved until one does not.
/// `None` where no candidate is left even so: none offered, none finite, or all where a touch was made.
pub fn choose(inputs: &ChoiceInputs, seed: u64, keep_going: &mut dyn FnMut() -> bool) -> Option<Action> {
    pick(inputs, seed, keep_going).map(|chosen| chosen.action)
}

/// Like [`choose`], which it asks, with what was thought of each candidate.
pub fn explain(inputs: &ChoiceInputs, seed: u64) -> Option<Choice> {
    let Chosen { action, scored, scorer, presence_nats } = pick(inputs, seed, &mut || true)?;
    let likelihoods = inputs.belief.posterior().by_part();
    let mut parts: Vec<usize> = (0..likelihoods.len()).collect();
    parts.sort_by(|a, b| likelihoods[*b].total_cmp(&likelihoods[*a]));
    let pair = parts.first_chunk().copied();
    let expected = scorer.and_then(|scorer| scorer.expected(&action.sensor_from_next, pair));
    Some(Choice { action, scored, expected, presence_nats })
}

/// An action with what it was picked from and by whom; nobody where chance picks.
struct Chosen<'a> {
    action: Action,
    scored: Vec<Scored>,
    scorer: Option<Scorer<'a>>,
    presence_nats: Option<f64>,
}

fn pick<'a>(inputs: &'a ChoiceInputs<'a>, seed: u64, keep_going: &mut dyn FnMut() -> bool) -> Option<Chosen<'a>> {
    let ChoiceInputs { config, belief, .. } = inputs;
    let far = far_candidates(inputs.model, belief, inputs.candidates);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let chance = *far.get(rng.random_range(0..far.len().max(1)))?;
    let chosen = |sensor_from_next, scored, scorer| {
        let action = Action { sensor_from_next };
        Chosen { action, scored, scorer, presence_nats: None }
    };
    let by_chance = |to| chosen(to, Vec::new(), None);
    match config.method.rule {
        ActionRule::Random => return Some(by_chance(chance)),
        ActionRule::RandomEdge => {
            let scorer = Scorer::new(inputs, 1, 1, &mut rng);
            let edged: Vec<Se2> =
                far.iter().take_while(|_| keep_going()).filter(|to| scorer.score(to).is_some()).copied().collect();
            let chosen = edged.get(rng.random_range(0..edged.len().max(1)));
            return Some(by_chance(chosen.copied().unwrap_or(chance)));
        }
        ActionRule::Paper => (),
        ActionRule::Information => {
            if let Some(chosen) =
                inputs.unfelt.as_ref().and_then(|unfelt| most_unfelt(inputs, unfelt, &far, keep_going))
            {
                return Some(chosen);
            }
        }
    }
    let scorer = Scorer::new(inputs, config.settings.n_draws.max(1), config.settings.n_suppositions.max(1), &mut rng);
    let n_finalists = config.settings.n_finalists.unwrap_or(far.len()).max(1);
    let has_finals = far.len() > n_finalists;
    let first_pass = has_finals
        .then(|| scorer.thinned(config.settings.n_draws.div_ceil(6), config.settings.n_suppositions.div_ceil(6)));
    let score_first = |candidate: &Se2| {
        let score = first_pass.as_ref().unwrap_or(&scorer).score(candidate);
        Scored { sensor_from_next: *candidate, score, by_all_draws: !has_finals }
    };
    let asked = far.iter().map_while(|candidate| keep_going().then(|| score_first(candidate)));
    let mut scored: Vec<Scored> = asked.collect();
    let mut ranked: Vec<usize> = (0..scored.len()).filter(|index| scored[*index].score.is_some()).collect();
    if has_finals {
        let score = |index: usize| scored[index].score.unwrap_or(f64::NEG_INFINITY);
        // Stable: the earliest of equals stays first.
        ranked.sort_by(|a, b| score(*b).total_cmp(&score(*a)));
        ranked.truncate(n_finalists);
        let asked = ranked.iter().take_while(|_| keep_going());
        let scored_by_all: Vec<usize> =
            asked.filter(|index| score_again(&scorer, &mut scored[**index])).copied().collect();
        ranked = if scored_by_all.is_empty() { ranked } else { scored_by_all };
    }
    let scored_best = ranked.iter().map(|index| scored[*index]);
    let best = scored_best.reduce(|best, next| if next.score > best.score { next } else { best });
    // No view with contact is expected anywhere: any touch may tell more than the bank does.
    let sensor_from_next = best.map_or(chance, |best| best.sensor_from_next);
    Some(chosen(sensor_from_next, scored, Some(scorer)))
}

/// The candidate that tells most of whether the named part is there; `None` where none shows any of the rest of it.
fn most_unfelt<'a>(
    inputs: &ChoiceInputs<'_>,
    unfelt: &Unfelt,
    far: &[Se2],
    keep_going: &mut dyn FnMut() -> bool,
) -> Option<Chosen<'a>> {
    let first_from_sensor = inputs.belief.first_from_sensor();
    let score = |to: &Se2| {
        let nats = unfelt.nats(&(first_from_sensor * *to));
        let score = (nats > 0.0).then(|| nats - inputs.config.settings.travel_nats_per_mm * to.x_mm.hypot(to.y_mm));
        Scored { sensor_from_next: *to, score, by_all_draws: true }
    };
    let scored: Vec<Scored> = far.iter().map_while(|to| keep_going().then(|| score(to))).collect();
    let showing = scored.iter().filter(|candidate| candidate.score.is_some());
    let sensor_from_next =
        showing.reduce(|best, next| if next.score > best.score { next } else { best })?.sensor_from_next;
    let presence_nats = Some(unfelt.nats(&(first_from_sensor * sensor_from_next)));
    Some(Chosen { action: Action { sensor_from_next }, scored, scorer: None, presence_nats })
}

/// Judges a candidate again, by all draws; whether that gives it a score.
fn score_again(scorer: &Scorer, candidate: &mut Scored) -> bool {
    let score = scorer.score(&candidate.sensor_from_next);
    if score.is_some() {
        *candidate = Scored { score, by_all_draws: true, ..*candidate };
    }
    score.is_some()
}

/// A touch turned by this much is another one: no turn reaches it until the separation is halved.
const FULL_TURN_DEG: f64 = 360.0;

/// The candidates apart from every earlier touch, by the smallest halving of the separation that leaves any.
fn far_candidates(model: &TouchModel, belief: &Belief, candidates: &[Se2]) -> Vec<Se2> {
    let first_from_sensor = belief.first_from_sensor();
    let is_far = |candidate: &&Se2, share: f64| {
        let first_from_next = first_from_sensor * **candidate;
        belief.touches().iter().all(|touched| {
            let turn = wrap_angle(touched.first_from_sensor.theta_rad - first_from_next.theta_rad).to_degrees();
            touched.first_from_sensor.distance_mm(&first_from_next) >= share * model.min_separation_mm
                || turn.abs() >= share * FULL_TURN_DEG
        })
    };
    // The tenth halving asks for 0.1 % of the separation: what is nearer is the same place.
    (0..=10)
        .map(|halvings| 0.5_f64.powi(halvings))
        .map(|share| candidates.iter().filter(|c| c.is_finite() && is_far(c, share)).copied().collect::<Vec<_>>())
        .find(|far| !far.is_empty())
        .unwrap_or_default()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::belief::EngineConfig;
    use crate::config::{EpisodeConfig, Method};
    use crate::likelihood::TouchLikelihood;
    use crate::settings::Settings;
    use crate::touch::Observation;
    use tactile_data::pose::grid::PoseGrid;
    use tactile_infer::Bank;
    use tactile_infer::bank::rows::Rows;

    /// Three angles at one place.
    pub(in crate::choice) const GRID: PoseGrid =
        PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    /// Two parts alike at -30 and 0 degrees and unlike at +30.
    pub(in crate::choice) fn bank(share_at_30: f32) -> Bank {
        let rows =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let shares = vec![0.2, 0.2, share_at_30, 0.2, 0.2, share_at_30];
        Bank::from_rows(vec!["A".into(), "B".into()], GRID, Rows::new(3, rows.concat()).unwrap(), shares, "").unwrap()
    }

    /// A belief sure of -30 degrees and of no part.
    fn belief(bank: &Bank) -> Belief {
        let touch = Observation::new(vec![1.0, 0.0, 0.0], 0.2);
        let first = TouchLikelihood::new(&touch, bank, &TouchModel::default()).unwrap();
        Belief::new(bank, EngineConfig::Exact, 1, 1, first)
    }

    fn turn(degrees: f64) -> Se2 {
        Se2::from_degrees(0.0, 0.0, degrees)
    }

    fn chosen(config: EpisodeConfig, bank: &Bank, candidates: &[Se2], seed: u64) -> Option<Se2> {
        let belief = belief(bank);
        let inputs =
            ChoiceInputs { config: &config, model: &config.model, belief: &belief, bank, candidates, unfelt: None };
        choose(&inputs, seed, &mut || true).map(|action| action.sensor_from_next)
    }

    /// Recorded poses, at places that were touched too, by a rule.
    fn any_place(rule: ActionRule) -> EpisodeConfig {
        EpisodeConfig {
            settings: Settings { n_suppositions: 1, n_finalists: Some(8), ..Settings::default() },
            model: TouchModel { min_separation_mm: 0.0, ..TouchModel::default() },
            method: Method { rule, between_poses: false, ..Method::default() },
            ..EpisodeConfig::default()
        }
    }

    /// The same with touches 12 mm apart.
    fn apart(rule: ActionRule) -> EpisodeConfig {
        any_place(rule).changed(|_, model, _| model.min_separation_mm = 12.0)
    }

    #[test]
    fn both_rules_touch_where_the_parts_differ() {
        for rule in [ActionRule::Paper, ActionRule::Information] {
            let config = any_place(rule).changed(|settings, _, _| settings.n_suppositions = 4);
            for candidates in [[turn(30.0), turn(60.0)], [turn(60.0), turn(30.0)]] {
                assert_eq!(chosen(config, &bank(0.2), &candidates, 1), Some(turn(60.0)));
            }
        }
    }

    #[test]
    fn what_is_left_to_feel_is_felt_next_and_else_the_parts_are_told_apart() {
        let (bank, config) = (bank(0.2), any_place(ActionRule::Information));
        let belief = belief(&bank);
        let ahead = Se2::from_degrees(12.0, 0.0, 0.0);
        let candidates = [turn(60.0), ahead, Se2::from_degrees(9.0, 0.0, 0.0)];
        // A view reaches 9.3 mm ahead: one of the two places is in view from 9 mm, both are from 12, and none from here.
        for (places_mm, chosen, tells) in
            [(vec![[13.0, 0.0], [20.0, 3.0]], ahead, true), (vec![[-13.0, 0.0]], turn(60.0), false)]
        {
            // 2 mm at its edges do not count.
            let unfelt = Some(Unfelt { places_mm, view_mm: [22.6, 18.3], none: 0.2 });
            let (config, candidates) = (&config, &candidates);
            let inputs =
                ChoiceInputs { config, model: &config.model, belief: &belief, bank: &bank, candidates, unfelt };
            let found = explain(&inputs, 1).unwrap();
            assert_eq!(found.action.sensor_from_next, chosen);
            assert_eq!(found.presence_nats.is_some(), tells);
            assert_eq!(choose(&inputs, 1, &mut || true), Some(found.action));
            // All that is left is shown: all the doubt goes.
            let doubt = 0.2_f64 * 5.0_f64.ln() + 0.8 * 1.25_f64.ln();
            assert!(found.presence_nats.is_none_or(|nats| (nats - doubt).abs() < 1e-12));
            // A long way costs.
            let far = config.changed(|settings, _, _| settings.travel_nats_per_mm = 1.0);
            let dear = choose(&ChoiceInputs { config: &far, ..inputs }, 1, &mut || true).unwrap();
            assert_eq!(dear.sensor_from_next, if tells { candidates[2] } else { chosen });
        }
    }

    #[test]
    fn an_action_without_contact_is_not_chosen() {
        // The printed indicator selects what shows no contact; the prose says "exceeds".
        assert_eq!(chosen(any_place(ActionRule::Paper), &bank(0.0), &[turn(60.0), turn(30.0)], 1), Some(turn(30.0)));
    }

    #[test]
    fn chance_may_be_asked_for_an_edge() {
        // From the likeliest state, -30 degrees, a turn of 60 leads to a blank view, one of 30 to an edge and one of 90
        // to none that was recorded.
        let blank = bank(0.0);
        let offered = [turn(60.0), turn(30.0), turn(0.0), turn(90.0)];
        let often = |rule, bank: &Bank, candidates: &[Se2]| {
            let mut counts = vec![0; candidates.len()];
            for seed in 0..400 {
                let to = chosen(any_place(rule), bank, candidates, seed).unwrap();
                counts[candidates.iter().position(|candidate| *candidate == to).unwrap()] += 1;
            }
            counts
        };
        let counts = often(ActionRule::RandomEdge, &blank, &offered);
        assert_eq!((counts[0], counts[3]), (0, 0));
        // 200 +- 10 each, five times that allowed.
        assert!((150..=250).contains(&counts[1]), "{counts:?}");
        assert!(often(ActionRule::Random, &blank, &offered).into_iter().all(|n| (57..=143).contains(&n)));
        // None shows an edge: any.
        let counts = often(ActionRule::RandomEdge, &blank, &[turn(60.0), turn(90.0)]);
        assert!((150..=250).contains(&counts[0]), "{counts:?}");
        assert_eq!(serde_json::to_value(ActionRule::RandomEdge).unwrap(), "random-edge");
    }

    #[test]
    fn touches_keep_apart_as_long_as_they_can() {
        let bank = bank(0.2);
        let [near, far] = [3.0, 20.0].map(|x| Se2::from_degrees(x, 0.0, 0.0));
        let config = apart(ActionRule::Random);
        for seed in 0..20 {
            assert_eq!(chosen(config, &bank, &[near, far], seed), Some(far));
        }
        // Nothing is 12 mm away: 12 is halved to 3, and the better half is taken.
        assert_eq!(chosen(config, &bank, &[Se2::from_degrees(1.0, 0.0, 0.0), near], 1), Some(near));
    }

    #[test]
    fn travel_counts_against_what_is_learnt() {
        let bank = bank(0.2);
        // Both give the same information; one is 1 mm away, which the grid's one place still holds.
        let [near, far] = [0.0, 1.0].map(|x| Se2::from_degrees(x, 0.0, 60.0));
        for (travel_nats_per_mm, expected) in [(0.0, far), (0.5, near)] {
            let config = any_place(ActionRule::Information);
            let config = config.changed(|settings, _, _| settings.travel_nats_per_mm = travel_nats_per_mm);
            assert_eq!(chosen(config, &bank, &[far, near], 1), Some(expected));
        }
    }

    #[test]
    fn an_empty_budget_still_gives_an_action() {
        let (bank, config) = (bank(0.2), any_place(ActionRule::Paper));
        let belief = belief(&bank);
        let candidates = &[turn(30.0), turn(60.0)];
        let inputs = ChoiceInputs {
            config: &config,
            model: &config.model,
            belief: &belief,
            bank: &bank,
            candidates,
            unfelt: None,
        };
        assert!(choose(&inputs, 1, &mut || false).is_some_and(|a| candidates.contains(&a.sensor_from_next)));
        // Enough for one candidate only: the first.
        let mut left = 1;
        let once = choose(&inputs, 1, &mut || {
            left -= 1;
            left >= 0
        });
        assert_eq!(once.map(|a| a.sensor_from_next), Some(candidates[0]));
    }

    #[test]
    fn nothing_left_to_touch_is_none() {
        let bank = bank(0.2);
        let config = apart(ActionRule::Paper);
        for candidates in [vec![], vec![Se2::IDENTITY], vec![Se2 { x_mm: f64::NAN, ..Se2::IDENTITY }]] {
            assert_eq!(chosen(config, &bank, &candidates, 1), None);
        }
    }

    #[test]
    fn of_equal_actions_the_earliest_is_chosen() {
        let same = [turn(60.0), turn(60.0 + 1e-9), turn(60.0 - 1e-9)];
        assert_eq!(chosen(any_place(ActionRule::Paper), &bank(0.2), &same, 1), Some(same[0]));
    }
}
